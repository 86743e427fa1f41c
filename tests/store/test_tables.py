"""Tables, lanes and GeoJSON: what is written comes back, and what is too large is refused."""

import json

import numpy as np
import pandas as pd
import pytest

from flgpr.model import Lane
from flgpr.store import lane_text, read_lane, read_table, write_geojson, write_table
from flgpr.store.dialects import TableReading
from flgpr.store.tables import (
    parse_columns,
    parse_own_table,
    parse_table,
    read_table_in,
    split_alarm_rows,
)
from flgpr.store.writing import json_value

ALARMS = pd.DataFrame(
    {"alarm_id": ["007", "=b"], "x": [0.1, -1 / 3], "y": [2.0, 1e-9], "confidence": [3.0, 2.0]}
)


def test_a_table_comes_back_to_the_last_digit(tmp_path):
    write_table(ALARMS, tmp_path / "a.csv")
    table = read_table(tmp_path / "a.csv", "alarms")
    pd.testing.assert_frame_equal(table[ALARMS.columns], ALARMS, check_exact=True)
    assert read_table_in(tmp_path, "a.csv", "alarms").equals(table)


@pytest.mark.parametrize(("separator", "decimal"), [(",", "."), (";", ",")])
def test_every_number_is_parsed_as_the_nearest_one(separator, decimal):
    """pandas before 3.1 errs in the last bit of one number in three unless it is asked not to."""
    rng = np.random.default_rng(0)
    numbers = rng.random((300, 2)) * 10.0 ** rng.integers(-8, 8, (300, 2))
    rows = [separator.join(repr(float(number)) for number in row) for row in numbers]
    text = "\n".join([separator.join("xy"), *rows]).replace(".", decimal)
    np.testing.assert_array_equal(parse_columns(text.encode()).to_numpy(), numbers)


def test_our_own_tables_have_our_own_names():
    with pytest.raises(ValueError, match=r"a\.csv: alarms must have the columns x; got quer"):
        parse_own_table(b"quer,y,confidence\n1,2,3\n", "alarms", "a.csv")


def test_a_lane_comes_back(tmp_path):
    lane = Lane(-2.0, 2.0, 0.1, 60.0)
    (tmp_path / "lane.toml").write_text(lane_text(lane))
    assert read_lane(tmp_path / "lane.toml") == lane
    with pytest.raises(FileNotFoundError, match="lane file not found"):
        read_lane(tmp_path / "none.toml")


def test_points_say_that_they_are_no_longitudes(tmp_path):
    write_geojson(ALARMS.assign(depth=[np.nan, 0.1]), tmp_path / "a.json")
    collection = json.loads((tmp_path / "a.json").read_text())
    assert "not longitude and latitude" in collection["flgpr_frame"]
    first, second = collection["features"]
    assert first["geometry"]["coordinates"] == [0.1, 2.0]
    assert first["properties"] == {"alarm_id": "007", "confidence": 3.0, "depth": None}
    assert second["properties"]["depth"] == 0.1


@pytest.mark.parametrize(
    ("value", "expected"), [(np.float32(0.5), 0.5), (np.inf, None), (np.int64(3), 3), ("a", "a")]
)
def test_numbers_fit_for_json(value, expected):
    result = json_value(value)
    assert result == expected
    assert type(result) is type(expected)


def test_columns_of_text_stay_text():
    table = parse_columns(b"name;value\n007;1,5\n", "name")
    assert table["name"].tolist() == ["007"]
    assert table["value"].tolist() == [1.5]


@pytest.mark.parametrize(
    ("data", "rule"),
    [
        (b"a;b\n1,5;1.5\n", "must have decimal commas or decimal points, got both"),
        (b"a;b,c\n1;2\n", "must be separated by commas or by semicolons, got both"),
        (b"a" + b",a" * 5000 + b"\n", "at most 4096 columns, got 5001"),
        (b"a\n" + b"1\n" * 2_000_001, "at most 2000000 rows"),
    ],
)
def test_tables_that_are_ambiguous_or_too_large_are_refused(data, rule):
    with pytest.raises(ValueError, match=rule):
        parse_columns(data)


def test_rows_that_cannot_be_read_are_parted_by_their_lines_in_the_file():
    data = b'# by ACME\nname;x;y;score\n"a\nb";1,5;2;3\nc;;2;3\n\nd;1;2\n#e;1;2;inf\nf;4;5;6\n'
    readable, lines, faults = split_alarm_rows(data, TableReading())
    assert lines == [3, 9]
    assert faults == [
        (5, "x is empty"),
        (7, "3 cells where the header has 4"),
        (8, 'confidence is no number: "inf"'),
    ]
    table = parse_table(readable, "alarms", "a.csv")
    assert table[["x", "y", "confidence"]].to_numpy().tolist() == [[1.5, 2, 3], [4, 5, 6]]


def test_a_kind_of_table_that_is_not_known_is_named(tmp_path):
    (tmp_path / "t.csv").write_text("target_id,x,y,depth\nm,0,1,0.1\n")
    with pytest.raises(ValueError, match="kind must be one of alarms, truth, objects, got 'mines'"):
        read_table(tmp_path / "t.csv", "mines")
