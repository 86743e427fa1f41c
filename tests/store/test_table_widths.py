"""Every row of a table has as many cells as its header: a cell too many would move all columns."""

import ast
import re

import pytest

from flgpr import budget
from flgpr.commands.scoring import read_lanes
from flgpr.model import as_lane
from flgpr.store import read_table
from flgpr.store.tables import parse_columns, parse_csv, parse_own_table
from flgpr.store.text_tables import read_text_table
from sources import ROOT

OTHER_READERS = ("pd.read_csv", "pd.read_table", "np.loadtxt", "np.genfromtxt")


@pytest.mark.parametrize(
    ("text", "rule"),
    [
        ("x,y,confidence\n0.5,5,3,9\n-0.5,15,2,9\n", "line 2 must have 3 cells .*, got 4"),
        ("x,y,confidence\n0,5,5,1,3\n", "line 2 .* got 5; decimal commas need semicolons or tabs"),
        ("x,y,confidence\n0.5,5,3\n\n0.5,15,2,\n", "line 4 must have 3 cells .*, got 4"),
        ("x,y,confidence\n0.5,5,3\n0.5,15\n", "line 3 must have 3 cells .*, got 2"),
        ('x,y,confidence,note\n0.5,5,3,"a\nb"\n0.5,15,2,"c",\n', "line 4 .* 4 cells .* got 5"),
        ("# ours\n\nquer;längs;Score\n0,5;5;3\n# half\n0,5;15;2;\n", "line 6 .* 3 cells .* got 4$"),
        ("sep=;\nx;y;confidence\n0,5;5\n", "line 3 must have 3 cells like the header, got 2$"),
        ("x\ty\tconfidence\r\n1\t5\t3\r\n1\t5\t3\t\r\n", "line 3 .* 3 cells .* got 4$"),
    ],
)
def test_a_row_of_more_or_fewer_cells_is_refused_by_its_line(text, rule, tmp_path):
    path = tmp_path / "alarms.csv"
    path.write_text(text, newline="")
    with pytest.raises(ValueError, match=f"{re.escape(str(path))}: {rule}"):
        read_table(path, "alarms")


def test_so_is_one_of_any_other_table(tmp_path):
    with pytest.raises(ValueError, match=r"a\.csv: line 3 must have 3 cells"):
        parse_own_table(b"x,y,confidence\n0,5,3\n0,5,3,9\n", "alarms", "a.csv")
    with pytest.raises(ValueError, match="line 2 must have 2 cells"):
        parse_columns(b"name,value\n1,2,3\n")
    (tmp_path / "lane.csv").write_text("lane,x_min,x_max,y_min,y_max\na,-2,2,0,20,9\n")
    with pytest.raises(ValueError, match=r"lane\.csv: line 2 must have 5 cells like the header"):
        read_lanes(tmp_path / "lane.csv")


def test_cells_may_be_empty_quoted_and_hold_marks():
    table = parse_columns(b'name,note,value\n1,"a,\nb",\n2,,7\n   \n"3","say ""x""",8\n', "name")
    assert table["name"].tolist() == ["1", "2", "3"]
    assert table["note"].fillna("").tolist() == ["a,\nb", "", 'say "x"']
    assert table["value"].fillna(0).tolist() == [0, 7, 8]


def test_a_cell_without_end_is_told_in_our_words():
    with pytest.raises(ValueError, match="line 2 must hold cells of text: field larger"):
        parse_csv('a,b\n"' + "x" * 200_000 + '",2\n')


def test_no_table_is_read_by_another_function():
    """``parse_csv`` alone calls pandas: the check of the widths is in it."""
    callers = []
    for path in sorted(ROOT.parent.rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if not isinstance(node, ast.Attribute):
                continue
            owner = node.value.id if isinstance(node.value, ast.Name) else ""
            if f"{owner}.{node.attr}" in OTHER_READERS:
                callers.append(path.name)
    assert callers == ["tables.py"]


@pytest.mark.parametrize(
    ("border", "shown"),
    [
        ("2026-01-01", "got 2026-01-01"),
        ("true", "got True"),
        ("[1, 2]", r"got \[1, 2\]"),
        ("inf", "must be finite"),
        ("nan", "must be finite"),
        ("7" * 4000, "numbers must have fewer than 300 digits"),
        ("7" * 5000, "numbers must have fewer than 300 digits"),
        ("7_" * 400 + "7", "numbers must have fewer than 300 digits"),
    ],
)
def test_a_lane_that_is_no_numbers_is_told_in_our_words(border, shown, tmp_path):
    path = tmp_path / "lane.toml"
    path.write_text(f"x_min = -2\nx_max = {border}\ny_min = 0\ny_max = 20\n")
    with pytest.raises(ValueError, match=f"{re.escape(str(path))}: .*{shown}"):
        read_lanes(path)


def test_borders_of_other_types_are_told_too():
    borders = {"x_min": -2, "x_max": 10**400, "y_min": 0, "y_max": 20}
    with pytest.raises(ValueError, match=r"lane\.x_max must be a number \(m\), got 1000"):
        as_lane(borders)


@pytest.mark.parametrize("mark", [",", ";", "\t", " 1 ", "\n1"])
def test_a_text_table_of_too_many_cells_is_refused_before_it_is_parsed(mark, tmp_path, monkeypatch):
    monkeypatch.setattr(budget, "VALUE", 2 * 10**6)  # of a table that may have 1000 cells
    (tmp_path / "few.csv").write_text("1" + f"{mark}1" * 400 + "\n")
    assert read_text_table(tmp_path / "few.csv")["table"].size > 400
    (tmp_path / "many.csv").write_text("1" + f"{mark}1" * 3000 + "\n")
    with pytest.raises(ValueError, match=r"the table would take .* MB of memory or more"):
        read_text_table(tmp_path / "many.csv")


def test_cells_behind_a_comment_count_whatever_their_mark_is():
    with pytest.raises(ValueError, match="at most 10000000 cells, got 10000002"):
        parse_columns(b"# ours\n" + b";" * 10_000_001)
