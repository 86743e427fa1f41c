"""What of a list is doubted before it is scored, and that the command line tells it."""

import json

import pandas as pd
import pytest
from typer.testing import CliRunner

from flgpr.commands.app import app
from flgpr.commands.reach import refuse_elsewhere, table_doubts
from flgpr.model import Lane

LANE = Lane(-1.5, 1.5, 0.0, 20.0)
GOOD = pd.DataFrame({"x": [0.5, -0.5, 1.0], "y": [3.0, 9.0, 15.0], "confidence": [1.0, 2.0, 3.0]})


def test_a_good_list_is_not_doubted():
    assert table_doubts(GOOD, "alarms", LANE) == []


def test_an_empty_list_is_told():
    assert table_doubts(GOOD.iloc[:0], "alarms", LANE) == [
        "it holds no alarms: a header and no row"
    ]
    assert table_doubts(GOOD.iloc[:0], "truth", LANE) == [
        "it holds no targets: a header and no row"
    ]


def test_rows_that_repeat_are_counted():
    twice = pd.concat([GOOD, GOOD.iloc[:2]])
    assert table_doubts(twice, "alarms", LANE) == [
        "2 of 5 alarms repeat another one at the same place; all are kept"
    ]
    named = pd.concat([GOOD.assign(lane="a"), GOOD.assign(lane="b")])
    assert table_doubts(named, "alarms", {"a": LANE, "b": LANE}) == []


def test_swapped_axes_are_told_and_a_list_elsewhere_too():
    swapped = GOOD.rename(columns={"x": "y", "y": "x"})
    assert table_doubts(swapped, "alarms", LANE) == [
        "3 of 3 alarms lie outside the lane; with x and y swapped, 3 would lie inside: are the axes swapped?"
    ]
    assert table_doubts(GOOD.assign(y=900.0), "truth", LANE) == [
        "all 3 targets lie outside the lane"
    ]
    assert table_doubts(GOOD.assign(lane="b"), "alarms", {"a": LANE, "b": LANE}) == []


def test_outsiders_are_counted():
    assert table_doubts(GOOD.assign(x=[0.5, -0.5, 1.6]), "alarms", LANE) == [
        "1 of 3 alarms lie outside the lane"
    ]
    assert refuse_elsewhere(GOOD, LANE, "a.csv") == {}
    assert refuse_elsewhere(GOOD.assign(x=[0.5, -0.5, 1.6]), LANE, "a.csv") == {"alarms_outside": 1}


@pytest.mark.parametrize("x", [1.51, -1.6, 3.0, 500.0])
def test_a_list_of_outsiders_alone_is_refused_however_near_they_are(x):
    with pytest.raises(ValueError, match=r"alarms must lie in the lane .*all 3 of a\.csv lie outs"):
        refuse_elsewhere(GOOD.assign(x=x), LANE, "a.csv")


def test_great_depths_are_told():
    truth = GOOD.assign(depth=[0.05, 5.0, float("nan")])
    [doubt] = table_doubts(truth, "truth", LANE)
    assert doubt.startswith("1 of 3 targets have a depth of more than 1 m, such as 5 m")
    assert table_doubts(truth.assign(depth=float("nan")), "truth", LANE) == []


@pytest.fixture
def files(tmp_path):
    (tmp_path / "lane.toml").write_text("x_min = -1.5\nx_max = 1.5\ny_min = 0.0\ny_max = 20.0\n")
    (tmp_path / "truth.csv").write_text(
        "Nr;Rechts;längs;Art;Tiefe\n1;0,5;3;metal;0,05\n2;-0,5;9;metal;0,1\n"
    )
    (tmp_path / "alarms.csv").write_text("# ours\nq,l,Score\n0.5,3.1,7\n0.5,3.1,7\n-0.5,9,9\n")
    (tmp_path / "swapped.csv").write_text("x,y,confidence\n3,0.5,7\n9,-0.5,9\n1,1,5\n")
    return tmp_path


def run(*words):
    return CliRunner().invoke(app, [str(word) for word in words])


def score(files, name, *more):
    place = files / "score"
    return run(
        "score",
        files / name,
        "--truth",
        files / "truth.csv",
        "--lane",
        files / "lane.toml",
        "-o",
        place,
        *more,
    )


@pytest.mark.slow("runs a whole command more than once")
def test_the_command_line_tells_what_was_read_and_doubted(files):
    done = score(files, "alarms.csv", "--columns", "x=q,y=l")
    assert done.exit_code == 0, done.output
    for line in (
        "note: alarms.csv: 1 lines that begin with # left out", "note: alarms.csv: x is the column 'q'",
        "note: alarms.csv: 1 of 3 alarms repeat another one at the same place; all are kept",
        "note: truth.csv: depth is the column 'Tiefe'",
    ):  # fmt: skip
        assert line in done.stderr
    notes = json.loads((files / "score" / "roc.json").read_text())["notes"]
    assert "x is the column 'q'" in notes["alarms_read"]
    assert "x is the column 'Rechts'" in notes["truth_read"]
    assert "x is the column &#39;q&#39;" in (files / "score" / "report.html").read_text()


@pytest.mark.slow("runs a whole command more than once")
def test_swapped_axes_are_told_on_the_command_line_unless_it_shall_be_quiet(files):
    assert "are the axes swapped?" in score(files, "swapped.csv").stderr
    again = score(files, "swapped.csv", "--quiet", "--overwrite")
    assert again.exit_code == 0
    assert again.output == ""


def test_a_list_of_another_lane_is_refused_on_the_command_line(files):
    (files / "beside.csv").write_text("x,y,confidence\n1.6,3,7\n-1.7,9,9\n")
    refused = score(files, "beside.csv")
    assert refused.exit_code == 2
    assert "alarms must lie in the lane" in refused.stderr
    assert "all 2 of beside.csv lie outside" in refused.stderr
    assert not (files / "score").exists()


def test_a_table_is_written_as_flgpr_reads_it(files):
    done = run(
        "import", "table", files / "alarms.csv", "--columns", "x=q,y=l", "-o", files / "mine.csv"
    )
    assert done.exit_code == 0, done.output
    assert (
        files / "mine.csv"
    ).read_text() == "x,y,confidence\n0.5,3.1,7.0\n0.5,3.1,7.0\n-0.5,9.0,9.0\n"
    assert "3 rows" in done.stdout
    truth = run(
        "import", "table", files / "truth.csv", "--kind", "truth", "-o", files / "targets.csv"
    )
    assert truth.exit_code == 0, truth.output
    assert (
        (files / "targets.csv")
        .read_text()
        .startswith("target_id,x,y,kind,depth\n1,0.5,3.0,metal,0.05\n")
    )
    assert (
        run(
            "import", "table", files / "alarms.csv", "--kind", "rocks", "-o", files / "b.csv"
        ).exit_code
        == 2
    )
