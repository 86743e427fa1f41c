"""A picture of the road for the terminal: its targets and alarms from above."""

from __future__ import annotations

import sys
from dataclasses import dataclass

import pandas as pd

from flgpr.model import Lane
from flgpr.scoring import Score

_COLUMNS = 60  # of the road
_CHARACTER = 2.0  # height over width of a character on a terminal
_MOST_ROWS = 16
_LEAST_ROWS = 3
_PLAIN = str.maketrans("●○×─│┌┐└┘→", "Oox-|++++>")


@dataclass(frozen=True)
class Mark:
    """What is drawn at some places: a character, and its label in the legend."""

    character: str
    label: str
    places: pd.DataFrame  #: ``x``, ``y``, m


def road_lines(scored: Score, encoding: str | None = None) -> list[str]:
    """Return lines of text that show the first lane of a score with its targets and false alarms.

    Parameters
    ----------
    scored : Score
        The score, whose targets and alarms are shown at its operating point.
    encoding : str, optional
        Encoding of the output, by default that of the process. Other than Unicode's it gets letters
        and signs that every terminal has.
    """
    lane = next(iter(scored.matched.lanes.values()))
    threshold = scored.point["threshold"]
    labels = scored.labels[scored.matched.alarm_lane == 0]
    is_false = labels["label"] == "false"
    is_false &= labels["confidence"] >= threshold
    targets = scored.outcomes[scored.matched.target_lane == 0]
    noun = scored.noun
    marks = [
        Mark("×", "false alarm", labels[is_false]),
        Mark("○", f"{noun} missed", targets[~targets["found"]]),
        Mark("●", f"{noun} found", targets[targets["found"]]),
    ]
    lines = _drawn(lane, marks)
    name = encoding or sys.stdout.encoding or "ascii"
    return lines if name.lower().startswith("utf") else [line.translate(_PLAIN) for line in lines]


def _drawn(lane: Lane, marks: list[Mark]) -> list[str]:
    """Return the road with its marks, driving to the right, and the legend."""
    width = lane.x_max - lane.x_min
    length = lane.y_max - lane.y_min
    # Rows to scale; a long lane would have none, a square one more than a terminal shows.
    rows_to_scale = round(_COLUMNS * width / length / _CHARACTER)
    rows = min(max(rows_to_scale, _LEAST_ROWS), _MOST_ROWS)
    ground = [[" "] * _COLUMNS for _ in range(rows)]
    for mark in marks:
        for mark_place in mark.places.to_dict("records"):
            row = _cell(mark_place["x"] - lane.x_min, width, rows)
            column = _cell(mark_place["y"] - lane.y_min, length, _COLUMNS)
            ground[row][column] = mark.character
    edge = "─" * _COLUMNS
    lines = [f"┌{edge}┐"]
    for cells_of_row in ground:
        cells = "".join(cells_of_row)
        lines.append(f"│{cells}│")
    lines.append(f"└{edge}┘")

    legend = []
    for mark in reversed(marks):
        if len(mark.places):
            legend.append(f"{mark.character} {mark.label}")
    legend.append(f"{width:.3g} m by {length:.3g} m of road, driving →")
    lines.append("   ".join(legend))
    return lines


def _cell(distance: float, extent: float, count: int) -> int:
    """Return the cell of a distance along an extent, m; what lies beyond is at the border."""
    cell = int(count * distance / extent)
    return min(max(cell, 0), count - 1)
