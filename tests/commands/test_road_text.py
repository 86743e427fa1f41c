"""The road on the terminal: marks where targets and false alarms lie."""

import pandas as pd

from flgpr.commands.road_text import road_lines
from flgpr.model import Lane
from flgpr.scoring import Rules, score

LANE = Lane(-2.0, 2.0, 0.0, 60.0)


def scored(kinds=("metal", "plastic")):
    truth = pd.DataFrame({"target_id": ["a", "b"], "x": [-1.9, 1.9], "y": [0.5, 59.5]})
    truth = truth.assign(kind=list(kinds), depth=[0.05, 0.1])
    alarms = pd.DataFrame({"x": [-1.9, 0.0], "y": [0.6, 30.0], "confidence": [3.0, 2.0]})
    return score(alarms, truth, LANE, Rules(far=0.01, draws=20))


def test_marks_lie_where_things_are():
    lines = road_lines(scored(), "utf-8")
    assert {len(line) for line in lines[:-1]} == {62}
    road = [line[1:-1] for line in lines[1:-2]]
    assert road[0].index("●") == 0  # the left edge of the road is above, the beginning on the left
    assert road[-1].index("○") == 59
    assert road[len(road) // 2].index("×") == 30
    assert lines[-1].startswith(
        "● mine found   ○ mine missed   × false alarm   4 m by 60 m of road"
    )


def test_simulants_are_no_mines_and_every_terminal_can_show_it():
    lines = road_lines(scored(("simulant", "metal")), "cp1252")
    assert "O target found   o target missed   x false alarm" in lines[-1]
    assert all(line.isascii() for line in lines)
