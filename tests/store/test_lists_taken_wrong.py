"""Lists that were read in silence as something else: quoted lines, columns twice, lanes as numbers."""

import pytest

from flgpr.commands.scoring import read_lanes
from flgpr.model import Lane
from flgpr.scoring import match
from flgpr.store import read_table
from flgpr.store.dialects import TableReading

ALARMS = "x,y,confidence\n0.1,10.2,3\n1.2,44.0,2\n-1.5,30.1,1\n"
TRUTH = "target_id,x,y,kind,depth\na,0,10,metal,0\nb,-1,30,plastic,0.05\nc,1,50,metal,0.1\n"
TWO = {"7.1": Lane(-2, 2, 0, 60), "7.10": Lane(-2, 2, 0, 60)}


def put(folder, text, name="a.csv"):
    path = folder / name
    path.write_text(text, encoding="utf-8")
    return path


def read(folder, text, kind="alarms", **reading):
    return read_table(put(folder, text), kind, TableReading(**reading) if reading else None)


def test_a_line_of_a_quoted_cell_that_begins_with_a_number_sign_is_no_comment(tmp_path):
    rows = ['0.1,10.2,3,"dug 3 times\n#2 is a can"', "1.2,44.0,2,none", '-1.5,30.1,1,"old"']
    table = read(tmp_path, "\n".join(["x,y,confidence,remark", *rows]) + "\n# the end\n")
    assert table["y"].tolist() == [10.2, 44.0, 30.1]
    assert table["remark"].tolist() == ["dug 3 times\n#2 is a can", "none", "old"]
    assert "1 lines that begin with # left out" in table.attrs["notes"]


@pytest.mark.parametrize("mark", ["\f", "\u2028", "\x85"])
def test_a_cell_may_hold_what_a_text_calls_the_end_of_a_line(mark, tmp_path):
    text = f"# a list\nx,y,confidence,remark\n0.1,10.2,3,one{mark}two\n1.2,44.0,2,none\n"
    assert len(read(tmp_path, text)) == 2


@pytest.mark.parametrize(
    ("header", "row", "name"),
    [("x,y,y,confidence", "0,1,2,3", "y"), ("x,y,confidence,confidence", "0,1,2,3", "confidence")],
)
def test_a_column_that_stands_twice_is_refused(header, row, name, tmp_path):
    with pytest.raises(ValueError, match=f"{name} is 2 times in the header: give each column"):
        read(tmp_path, f"{header}\n{row}\n")


def test_a_column_that_the_user_names_must_be_there(tmp_path):
    with pytest.raises(ValueError, match="the file has no column 'Score' for confidence"):
        read(tmp_path, ALARMS, columns={"confidence": "Score"})
    with pytest.raises(ValueError, match="the file has no column 'burial' for depth"):
        read(tmp_path, TRUTH, "truth", columns={"depth": "burial"})


def test_a_column_that_the_user_names_goes_before_one_of_that_name(tmp_path):
    text = "x,y,confidence,magnitude\n0,1,9,2\n0,2,8,3\n"
    table = read(tmp_path, text, columns={"confidence": "magnitude"})
    assert table["confidence"].tolist() == [2, 3]
    assert list(table.columns) == ["x", "y", "confidence"]
    assert "the column 'confidence' of the file is not used" in table.attrs["notes"]


def test_names_of_lanes_and_targets_stay_as_they_are_written(tmp_path):
    truth = read(
        tmp_path,
        "target_id,x,y,kind,depth,lane\n01,0,10,metal,0,7.1\nNA,0,30,None,0,7.1\nc,0,40,metal,,7.10\n",
        "truth",
    )
    assert truth["lane"].tolist() == ["7.1", "7.1", "7.10"]
    assert truth["target_id"].tolist() == ["01", "NA", "c"]
    assert truth["kind"].tolist() == ["metal", "None", "metal"]
    alarms = read(tmp_path, "x,y,confidence,lane\n0,10,3,7.1\n0,30,2,7.10\n")
    matched = match(alarms, truth, TWO, 1.0)
    assert matched.false.tolist() == [False, True]


def test_of_several_lanes_every_row_names_its_own(tmp_path):
    truth = read(
        tmp_path, "target_id,x,y,kind,depth,lane\na,0,10,metal,0,7.1\nb,0,30,metal,0,\n", "truth"
    )
    alarms = read(tmp_path, "x,y,confidence,lane\n0,10,3,7.1\n")
    with pytest.raises(ValueError, match=r"truth\.lane must name the lane .* none in row 2 below"):
        match(alarms, truth, TWO, 1.0)
    one = {"7.1": TWO["7.1"]}
    assert len(match(alarms, truth, one, 1.0).truth) == 2


def test_alarms_of_one_lane_are_not_scored_by_the_truth_of_another(tmp_path):
    alarms = read(tmp_path, "x,y,confidence,lane\n0,10,3,A\n")
    truth = read(tmp_path, "target_id,x,y,kind,depth,lane\na,0,10,metal,0,B\n", "truth")
    with pytest.raises(ValueError, match="alarms and truth must be of one lane, got A and B"):
        match(alarms, truth, Lane(-2, 2, 0, 60), 1.0)


@pytest.mark.parametrize(
    ("row", "column"), [("b,-1,30,,0.05", "kind"), (",-1,30,plastic,0.05", "target_id")]
)
def test_a_target_without_a_name_or_a_kind_is_refused_with_its_row(row, column, tmp_path):
    text = TRUTH.replace("b,-1,30,plastic,0.05", row)
    with pytest.raises(ValueError, match=rf"truth\.{column} must be filled .* none in row 2 below"):
        read(tmp_path, text, "truth")


def test_blanks_about_the_names_of_columns_do_not_matter(tmp_path):
    assert read(tmp_path, ALARMS.replace("x,y,confidence", "x, y, confidence"))["y"][0] == 10.2


def test_a_list_as_json_is_called_so(tmp_path):
    with pytest.raises(ValueError, match=r"must be a table as text .* got JSON: save it as CSV"):
        read(tmp_path, '{"type": "FeatureCollection", "features": []}')


def test_lanes_of_a_table_stay_as_they_are_written_and_name_each_border_once(tmp_path):
    path = put(tmp_path, "lane,x_min,x_max,y_min,y_max\n01,-2,2,0,60\n02,-2,2,0,60\n", "lanes.csv")
    assert list(read_lanes(path)) == ["01", "02"]
    put(tmp_path, "lane,x_min,x_max,y_min,y_max,y_max\n01,-2,2,0,60,100\n", "lanes.csv")
    with pytest.raises(ValueError, match=r"lanes\.csv: the header must name each column once"):
        read_lanes(path)
