"""Tables of alarms and truth as other programs and languages write them; what is taken otherwise is told."""

import logging
import re

import numpy as np
import pandas as pd
import pytest

from flgpr.geo.anchor import fit_anchor
from flgpr.store import read_table
from flgpr.store.dialects import TableReading, _split_unit, parse_columns_option
from flgpr.store.tables import parse_table
from io_geodesy import LANE, on_the_ellipsoid

PLACES = np.array([[0.25, 3.5], [-0.5, 10.25]])


def read(tmp_path, text, kind="alarms", encoding="utf-8", **reading):
    path = tmp_path / "a.csv"
    path.write_bytes(text.encode(encoding))
    return read_table(path, kind, TableReading(**reading) if reading else None)


def places(table):
    np.testing.assert_allclose(table[["x", "y"]].to_numpy(), PLACES, atol=1e-9)
    return table


@pytest.mark.parametrize(
    "head",
    [
        "x,y,confidence",
        "X,Y,Score",
        "x [m],y [m],confidence",
        "x_m,y_m,conf",
        "Rechts,Vorwärts,Konfidenz",
        "quer [m],längs [m],Wahrscheinlichkeit",
        "travers,avant,confiance",
        "través,adelante,puntuación",
        "traverso,avanti,punteggio",
        "direita,frente,confiança",
        "cross-track (m),down-track (m),probability",
    ],
)
def test_columns_are_known_in_six_languages(head, tmp_path):
    table = places(read(tmp_path, f"{head}\n0.25,3.5,7\n-0.5,10.25,9\n"))
    assert table["confidence"].tolist() == [7, 9]
    own = head.split(",")
    renamed = [name for name in own if name not in ("x", "y", "confidence")]
    for name in renamed:
        assert any(repr(name) in note for note in table.attrs["notes"])


@pytest.mark.parametrize(
    ("text", "encoding", "note"),
    [
        (
            "x\ty\tconfidence\n0,25\t3,5\t7\n-0,5\t10,25\t9\n",
            "utf-8",
            "columns are separated by tabs",
        ),
        (
            "x\ty\tconfidence\n0.25\t3.5\t7\n-0.5\t10.25\t9\n",
            "utf-8",
            "columns are separated by tabs",
        ),
        (
            "# made by us\n# twice\nx,y,confidence\n0.25,3.5,7\n#-1,2,3\n-0.5,10.25,9\n",
            "utf-8",
            "3 lines that begin",
        ),
        (
            "# x,y,confidence\n0.25,3.5,7\n-0.5,10.25,9\n",
            "utf-8",
            "the header is commented out by a #",
        ),
        ("sep=;\nx;y;confidence\n0,25;3,5;7\n-0,5;10,25;9\n", "utf-8", None),
        (
            "x;längs;confidence\n0,25;3,5;7\n-0,5;10,25;9\n",
            "latin-1",
            "the table is text in Latin-1, which is assumed",
        ),
        ("x,längs,confidence\n0.25,3.5,7\n-0.5,10.25,9\n", "utf-16", "the table is text in UTF-16"),
        ("x [cm],y [mm],confidence\n25,3500,7\n-50,10250,9\n", "utf-8", "x taken from cm to m"),
    ],
)
def test_dialects_are_read_and_told(text, encoding, note, tmp_path):
    table = places(read(tmp_path, text, encoding=encoding))
    assert note is None or any(one.startswith(note) for one in table.attrs["notes"])


def test_what_is_read_otherwise_is_told_as_a_line(tmp_path, caplog):
    with caplog.at_level(logging.INFO, "flgpr.notes"):
        read(tmp_path, "quer,y,confidence\n1,2,3\n")
    assert caplog.messages == ["a.csv: x is the column 'quer'"]


def test_a_plain_table_is_read_without_a_word(tmp_path, caplog):
    with caplog.at_level(logging.INFO, "flgpr.notes"):
        table = read(tmp_path, "alarm_id,x,y,confidence\n#1,1,2,3\n001,4,5,6\n")
    assert table["alarm_id"].tolist() == ["#1", "001"]  # a name that begins so is no comment
    assert caplog.messages == []


def test_a_truth_of_another_language_keeps_its_names_and_depths(tmp_path):
    text = "Nr;Rechts;längs;Art;Tiefe [cm]\n007;0,25;3,5;metal;5\nb;-0,5;10,25;plastic;\n"
    table = places(read(tmp_path, text, "truth"))
    assert table["target_id"].tolist() == ["007", "b"]
    assert table["depth"].iloc[0] == pytest.approx(0.05)
    assert np.isnan(table["depth"].iloc[1])
    assert "depth taken from cm to m" in table.attrs["notes"]


def test_what_the_user_says_comes_first(tmp_path):
    text = "x,y,u,v,confidence\n9,9,0.25,3.5,7\n9,9,-0.5,10.25,9\n"
    table = read(tmp_path, text.replace("x,y", "a,b"), columns={"x": "u", "y": "v"})
    places(table)
    assert parse_columns_option("x=Rechts, y=Hoch") == {"x": "Rechts", "y": "Hoch"}


@pytest.fixture
def anchor():
    return fit_anchor(LANE, on_the_ellipsoid(LANE), "EPSG:4326", 0.02)


def test_longitude_and_latitude_come_to_the_lane_by_the_anchor(tmp_path, anchor):
    earth = anchor.to_geodetic(np.column_stack([PLACES, [0, 0]]))
    rows = "".join(f"{lon:.10f},{lat:.10f},7\n" for lon, lat, _ in earth)
    table = read(tmp_path, f"Longitude,Latitude,score\n{rows}", anchor=anchor)
    np.testing.assert_allclose(table[["x", "y"]].to_numpy(), PLACES, atol=1e-4)
    assert (
        "2 places taken from longitude and latitude to the lane by the anchor"
        in table.attrs["notes"]
    )
    with pytest.raises(ValueError, match="longitude and latitude need an anchor"):
        read(tmp_path, f"Longitude,Latitude,score\n{rows}")
    with pytest.raises(ValueError, match="are they swapped"):
        read(
            tmp_path,
            "lat,lon,score\n190,52,7\n",
            anchor=anchor,
            columns={"longitude": "lon", "latitude": "lat"},
        )


def test_a_tables_own_places_come_before_those_on_the_earth(tmp_path):
    table = places(read(tmp_path, "x,y,lon,lat,Score\n0.25,3.5,1,2,7\n-0.5,10.25,1,2,9\n"))
    assert {"lon", "lat"} <= set(table.columns)  # kept as they stand


@pytest.mark.parametrize(
    ("text", "columns", "rule"),
    [
        (
            "x,y,score,conf\n1,2,3,4\n",
            {},
            "confidence could be the column 'score' or 'conf': say which",
        ),
        ("x,y,score\n1,2,3\n", {"z": "y"}, "columns must name one of .*, got 'z'"),
        ("a,y,score\n1,2,3\n", {"x": "b"}, "the file has no column 'b' for x; it has a, y, score"),
        ("x [yd],y,score\n1,2,3\n", {}, r"the unit of 'x \[yd\]' must be one of m, cm"),
        (
            "q,r,s\n1,2,3\n",
            {},
            "alarms must have the columns x, y, confidence; got q, r, s; `columns` x=NAME says",
        ),
        ("ACME Radar;;\n\nx;y;score\n1;2;3\n", {}, "lines above the header begin with #"),
        ("x,y,rank\n1,2,3\n", {}, "got x, y, rank; `columns` confidence=NAME says which it is"),
        ('x,y,score\n"0,4",2,3\n', {}, "got '0,4' in row 1 .*; decimal commas need semicolons"),
        ("x;y;score\n0,4;1;2\n0.5;1;2\n", {}, "decimal points, got both, 0,4 and 0.5"),
        ("", {}, "alarms must have a header, got an empty file"),
        ("# nothing\n", {}, "alarms must have a header, got an empty file"),
    ],
)
def test_what_is_unclear_is_refused(text, columns, rule, tmp_path):
    with pytest.raises(ValueError, match=f"a.csv: .*{rule}"):
        read(tmp_path, text, columns=columns) if columns else read(tmp_path, text)


@pytest.mark.parametrize("text", ["x", "x=", "=a", "x=a,x=b", "x=a,,y=b"])
def test_a_list_of_columns_that_is_none_is_refused(text):
    with pytest.raises(ValueError, match="columns must be NAME=COLUMN"):
        parse_columns_option(text)


def test_every_number_stays(tmp_path):
    rng = np.random.default_rng(0)
    values = rng.normal(size=(50, 3))
    rows = "\n".join(",".join(map(repr, row)) for row in values.tolist())
    table = read(tmp_path, f"# c\nquer,längs,Score\n{rows}\n")
    expected = pd.DataFrame(values, columns=["x", "y", "confidence"])
    pd.testing.assert_frame_equal(table, expected, check_exact=True)


UNIT_IN_BRACKETS = re.compile(r"\s*(?P<name>.*?)\s*[\[(]\s*(?P<unit>[^\])]*?)\s*[\])]\s*")
"""The rule as a regular expression, whose time grows with the square of the length."""


@pytest.mark.parametrize(
    "name",
    ["x (m)", " Tiefe [ cm ] ", "a (b) [m]", "a [b (m)", "(m)", "x m", "x)", "x (m", "()", ""],
)
def test_a_unit_in_brackets_is_what_the_slow_rule_finds(name):
    check_unit(name)


def test_units_of_random_names_are_what_the_slow_rule_finds():
    rng = np.random.default_rng(0)
    for length in rng.integers(0, 12, size=2000):
        check_unit("".join(rng.choice(list("x m[]()"), size=length)))


def check_unit(name):
    expected = UNIT_IN_BRACKETS.fullmatch(name)
    found = _split_unit(name)
    if expected is not None:
        assert found == (expected["name"], expected["unit"]), name
    else:
        assert "(" not in found[1], name
        assert found[1] in ("", "m"), name


@pytest.mark.parametrize("text", ["[" * 20_000, "x" + " " * 20_000 + "(", "(" * 20_000 + ")"])
def test_a_header_of_thousands_of_brackets_is_refused(text):
    with pytest.raises(ValueError, match="alarms must have the columns"):
        parse_table(f"{text},y\n1,2\n".encode(), "alarms", "alarms.csv")
