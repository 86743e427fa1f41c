"""Vendors' lists are looked at row by row, before any truth is opened."""

import pytest

from flgpr.geo import read_anchor
from flgpr.model import Lane
from flgpr.store.dialects import TableReading
from flgpr_trials.intake import read_vendor_list

LANES = {"": Lane(-2, 2, 0, 60)}


def read(text, lanes=LANES, reading=None, unit=None):
    return read_vendor_list(
        text.encode(), "acme.csv", "ACME", lanes, 1.0, reading or TableReading(), unit
    )


def rows(places, factor=1.0):
    return "x,y,confidence\n" + "".join(
        f"{x / factor},{y / factor},{number}\n" for number, (x, y) in enumerate(places)
    )


SPREAD = [(-1.5 + 0.3 * number, 5.5 * number) for number in range(11)]


def test_rows_that_cannot_be_used_are_dropped_with_line_and_reason():
    taken = read(
        "# vendor: ACME\nx,y,confidence\n0,10,1\n0,n/a,2\n1,20\n\n0,30,3\n5,40,4\n2.5,50,5\n1e999,1,1\n0,1,\n"
    )
    assert taken.in_words() == (
        "3 of 8 rows of ACME's list are used: 4 are unreadable and 1 lies outside the lane"
    )
    told = [(row.line, row.reason) for row in taken.dropped]
    assert told == [
        (4, 'y is no number: "n/a"'),
        (5, "2 cells where the header has 3"),
        (8, "outside the lane: x 5.00 m, y 40.00 m"),
        (10, 'x is no number: "1e999"'),
        (11, "confidence is empty"),
    ]
    assert taken.used["y"].tolist() == [10, 30, 50]
    assert taken.doubts[0].startswith(
        "Of the rows that are used 1 lie outside the lane by less than"
    )


def test_a_list_without_faults_is_used_as_a_whole_whatever_its_dialect():
    taken = read(
        "# a comment\nNr;Quer (cm);Längs (cm);Güte\n1;10,5;1000,0;0,5\n2;-20,0;2000,0;0,7\n"
    )
    assert taken.in_words() == "All 2 rows of ACME's list are used"
    assert taken.used["x"].tolist() == pytest.approx([0.105, -0.2])
    assert "y taken from cm to m" in taken.notes
    with pytest.raises(ValueError, match="unit must not be given where the header states one"):
        read("x_cm,y_cm,confidence\n0,10,1\n", unit="cm")
    with pytest.raises(ValueError, match="unit must not be given where the header states one"):
        read("x_m,y_m,confidence\n0,10,1\n", unit="ft")
    with pytest.raises(ValueError, match=r"unit must be one of m, .* got 'ell'"):
        read(rows(SPREAD), unit="ell")


LONG = {"": Lane(-2, 2, 0, 200)}
# A search wider than the lane: two of seven alarms lie beside it, in its halo or farther out.
WIDE = [((number % 7 - 3) * 1.1, 3.0 * number) for number in range(66)]


@pytest.mark.parametrize(
    ("unit", "words", "factor"),
    [
        ("ft", "feet", 0.3048),
        ("in", "inches", 0.0254),
        ("cm", "centimetres", 0.01),
        ("mm", "millimetres", 0.001),
    ],
)
def test_a_list_in_another_unit_is_told_and_taken_when_it_is_stated(unit, words, factor):
    for places, lanes in ((SPREAD, LANES), (WIDE, LONG)):
        taken = read(rows(places, factor), lanes)
        assert taken.unit == unit
        assert f"Places look like {words}" in taken.doubts[0]
        used = len(read(rows(places), lanes).used)
        assert len(read(rows(places, factor), lanes, unit=unit).used) == used
        assert read(rows(places), lanes).unit == ""
        assert read(rows([(y, x) for x, y in places]), lanes).unit == ""  # but swapped


def test_places_of_a_map_are_told():
    taken = read(rows([(500000.0 + x, 5400000.0 + y) for x, y in SPREAD]))
    assert taken.unit == "UTM"
    assert taken.in_words().startswith("None of 11 rows of ACME's list are used")
    assert "easting and northing" in taken.doubts[0]


def test_repeated_alarms_equal_confidences_and_swapped_axes_are_told():
    taken = read("x,y,confidence\n0,10,1\n0,10,1\n1,20,1\n")
    assert taken.doubts == [
        "1 of 3 alarms repeat another one at the same place; all are kept",
        "All confidences are equal (1): the list has one operating point",
    ]
    taken = read(rows([(y, x) for x, y in SPREAD]))
    assert taken.doubts[-1].endswith("axes swapped? If so, give `--columns x=y,y=x`")
    again = read(rows([(y, x) for x, y in SPREAD]), reading=TableReading({"x": "y", "y": "x"}))
    assert len(again.used) == len(SPREAD)
    unranked = read("x,y\n0,10\n1,20\n", reading=TableReading(unranked=True))
    assert len(unranked.used) == 2


def test_why_no_row_of_a_list_is_used_is_told():
    taken = read("x,y,confidence\n0,10,90 %\n0,20,80 %\n")
    assert taken.doubts == [
        'The first unreadable row is in line 2: confidence is no number: "90 %"'
    ]
    with pytest.raises(
        ValueError, match=r"used to be signed: None of 2 .* in line 2: confidence is"
    ):
        taken.require_clear()


def test_a_list_of_one_row_or_none_is_told_in_words():
    assert read("x,y,confidence\n0,10,1\n").in_words() == "The only row of ACME's list is used"
    assert read("x,y,confidence\n").in_words() == "ACME's list has no row"


def test_rows_of_no_lane_of_the_test_are_dropped():
    lanes = {"a": Lane(-2, 2, 0, 60), "b": Lane(-2, 2, 0, 60)}
    taken = read("lane,x,y,confidence\na,0,10,1\nc,0,10,2\nb,0,20,3\n", lanes)
    assert taken.in_words().endswith("used: 1 is of no lane of this test")
    assert taken.dropped[0].reason == 'lane is "c"'
    with pytest.raises(ValueError, match="must have the column lane, for there are 2 lanes"):
        read(rows(SPREAD), lanes)


def test_places_by_an_anchor_are_metres_whatever_unit_is_given(tmp_path):
    (tmp_path / "anchor.toml").write_text(
        'crs = "EPSG:4326"\naccuracy = 0.02\nazimuth_deg = 0.0\nazimuth_accuracy_deg = 0.1\n'
        "[[point]]\nlane = [0.0, 0.0]\nlongitude = 15.0\nlatitude = 48.0\n"
    )
    reading = TableReading(anchor=read_anchor(tmp_path / "anchor.toml"))
    with pytest.raises(ValueError, match=r"unit must not be given .* places come by an anchor"):
        read("longitude,latitude,confidence\n15,48.0001,1\n", reading=reading, unit="ft")
