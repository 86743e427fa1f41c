"""No cell of a table that leaves is a formula for a spreadsheet, and reading gives back what was written."""

import csv
import io
import re

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st

from damage import FUZZ
from flgpr.geo import write_earth_csv
from flgpr.store import read_table, write_table
from flgpr.store.tables import parse_columns
from flgpr.store.text_tables import read_text_table
from flgpr.store.writing import csv_text

RUN_BY_SPREADSHEETS = [
    "=1+1",
    "=cmd|' /C calc'!A0",
    "+a",
    "-b",
    "@SUM(A1)",
    "\t=1",
    "\r=1",
    "\n=1",
    "＝1",
    "＋a",
    "－b",
    "＠c",
]
NUMBERS = ["-5", "+5", "-1.5", "-.5", "+1e3", "-2.5E-7", "-7."]
PLAIN = ["a", "'a", "mine-3", "a=1", " =1", "", "'"]
QUOTED_BEFORE = ["'=1", "''=1", "'-5", "'\t"]


def cells_of(text):
    return [cell for row in csv.reader(io.StringIO(text, newline="")) for cell in row]


def is_formula(cell):
    """Tell what a spreadsheet runs, character by character: a slow twin of the regular expression."""
    if cell[:1] not in set("=+-@\t\r\n＝＋－＠"):
        return False
    try:
        float(cell.strip())
    except ValueError:
        return True
    return not cell[1:2].isdigit() and cell[1:2] != "."


def table(texts):
    return pd.DataFrame(
        {
            "alarm_id": texts,
            "x": -np.arange(len(texts)),
            "y": 0.5,
            "confidence": -np.inf,
            "kind": texts,
        }
    )


@pytest.mark.parametrize("text", RUN_BY_SPREADSHEETS)
def test_formulas_are_quoted(text):
    written = cells_of(csv_text(table([text])))
    assert written.count(f"'{text}") == 2
    assert not [cell for cell in written if is_formula(cell) and not re.fullmatch(r"-inf", cell)]


@pytest.mark.parametrize("text", [*NUMBERS, *PLAIN])
def test_numbers_and_plain_text_are_as_they_are(text):
    assert text in cells_of(csv_text(table([text])))


def test_all_of_it_reads_back(tmp_path):
    texts = [
        *RUN_BY_SPREADSHEETS,
        *NUMBERS,
        *QUOTED_BEFORE,
        "a",
        "'a",
        "mine-3",
        "a=1",
        "-nan",
        "a\rb",
        'b"=',
        "c,=d",
    ]
    alarms = table(texts).assign(confidence=1.0).rename(columns={"kind": "=kind"})
    write_table(alarms, tmp_path / "alarms.csv")
    back = read_table(tmp_path / "alarms.csv", "alarms")
    assert list(back["alarm_id"]) == texts
    assert list(back["=kind"]) == texts
    np.testing.assert_array_equal(back["x"], alarms["x"])


@FUZZ
@given(
    texts=st.lists(
        st.text(st.sampled_from("=+-@\t\r\n'\"a5., ＝"), min_size=1, max_size=6),
        min_size=1,
        max_size=5,
    )
)
def test_any_text_reads_back_and_is_no_formula(texts):
    text = csv_text(pd.DataFrame({"target_id": texts, "x": 1.0}))
    assert not [cell for cell in cells_of(text) if is_formula(cell)]
    assert list(parse_columns(text.encode(), "target_id")["target_id"]) == texts


def test_semicolons_give_back_what_was_quoted():
    back = parse_columns(b"alarm_id;x\n'=1;0,5\n'a;1,5\n", "alarm_id")
    assert list(back["alarm_id"]) == ["=1", "'a"]
    assert list(back["x"]) == [0.5, 1.5]


def test_names_of_columns_are_quoted_too(tmp_path):
    write_table(pd.DataFrame({"=a": [1.0, 2.0], "b": [3.0, 4.0]}), tmp_path / "a.csv")
    assert (tmp_path / "a.csv").read_text().startswith("'=a,b\n")
    assert set(read_text_table(tmp_path / "a.csv")) == {"table", "=a", "b"}


def test_what_goes_to_the_earth_is_quoted(tmp_path):
    points = pd.DataFrame({"alarm_id": ["=1+1"], "longitude": [-7.5], "latitude": [-51.0]})
    write_earth_csv(points, tmp_path / "a.csv")
    assert (tmp_path / "a.csv").read_text() == "alarm_id,longitude,latitude\n'=1+1,-7.5,-51.0\n"


def test_numbers_are_written_as_ever():
    frame = pd.DataFrame({"x": [-0.1, np.nan, -np.inf], "n": [-1, 2, 3], "b": [True, False, True]})
    assert csv_text(frame) == frame.to_csv(index=False, lineterminator="\n")
    assert csv_text(frame.iloc[:0]) == "x,n,b\n"
