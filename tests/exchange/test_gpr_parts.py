"""What the readers of commercial radars share: headers, records, distances and clocks."""

import numpy as np
import pytest

from flgpr_exchange.gpr.along_line import (
    DAY,
    equal_steps,
    gather_of_separations,
    measured_clock,
    measured_distance,
)
from flgpr_exchange.gpr.parts import (
    Header,
    MissingHeaderError,
    exact_floats,
    is_header_line,
    length_unit,
    numbers_in,
    read_header,
    read_records,
)


def test_a_header_is_found_in_any_case_and_names_what_it_lacks(tmp_path):
    (tmp_path / "A.Rad").write_text("Samples: 12,5 points\nno entry\n")
    head = read_header(tmp_path / "a.rd3", ".rad", ":", [])
    assert head.number("SAMPLES", 0, 100) == 12.5
    assert head.number("STEP", 0, 1) is None
    with pytest.raises(ValueError, match=r"A\.Rad must hold STEP, which it does not"):
        head.needed("STEP", 0, 1)
    with pytest.raises(ValueError, match="SAMPLES must be a number from 0 to 10, got '12,5'"):
        head.number("SAMPLES", 0, 10)
    with pytest.raises(MissingHeaderError, match=r"its header b\.rad must lie beside it"):
        read_header(tmp_path / "b.rd3", ".rad", ":", [])


def test_the_first_entry_that_is_not_empty_is_the_text(tmp_path):
    head = Header(tmp_path, {"ANTENNAS": "", "ANTENNA": "500 MHz"})
    assert head.text("ANTENNAS", "ANTENNA") == "500 MHz"
    assert head.text("SITE") == ""


@pytest.mark.parametrize(
    ("text", "metres"),
    [
        ("m", 1.0),
        (" Feet ", 0.3048),
        ("meter(s)", 1.0),
        ("in.", 0.0254),
        ('"', 0.0254),
        ("px", None),
    ],
)
def test_units_of_length(text, metres):
    assert length_unit(text) == metres


def test_traces_are_counted_before_anything_is_read(tmp_path):
    path = tmp_path / "a.bin"
    path.write_bytes(bytes(10 + 3 * 8 + 5))
    notes = []
    trace = np.dtype(("<i2", 4))
    assert read_records(path, 10, trace, 9, notes, 1000).shape == (3, 4)
    assert notes == [
        "the last trace is cut off and left out (5 of 8 bytes)",
        "truncated: the header tells 9 traces, the file holds 3",
    ]
    with pytest.raises(
        ValueError, match="at least one trace of 50 bytes after 10, the file has 39"
    ):
        read_records(path, 10, np.dtype(("<i2", 25)), None, [], 1000)
    with pytest.raises(ValueError, match=r"must fit into 4e-08 GB, its traces take 4\.8e-08 GB"):
        read_records(path, 10, trace, None, [], 40)


def test_every_count_is_exact_in_floating_point():
    assert exact_floats(np.array([[65535]], "<u2"), []).dtype == np.float32
    wide = exact_floats(np.array([[2**31 - 1]], "<i4"), [])
    assert wide.dtype == np.float64
    assert wide[0, 0] == 2**31 - 1
    notes = []
    exact_floats(np.array([[1.0, np.nan], [2.0, 3.0]], np.float32), notes)
    assert notes == ["1 of 2 traces hold samples that are no numbers"]
    with pytest.raises(ValueError, match=r"samples must be below 1e30 in magnitude, got 1e\+35"):
        exact_floats(np.array([[1e35]], np.float32), [])


def test_distances_stay_as_measured():
    notes = []
    distance = np.array([0.0, 1.0, np.nan, 3.0, 2.5, 2.5])
    found = measured_distance(distance, None, "positions", "the step", notes)
    np.testing.assert_array_equal(found, [0.0, 1.0, 2.0, 3.0, 2.5, 2.5])
    assert notes[0] == "1 of 6 positions are no numbers: put between their neighbours"
    assert "1 traces stand where the one before was and 1 lie behind it" in notes[1]
    falling = measured_distance(np.array([9.0, 7.0, 4.0]), None, "positions", "the step", notes)
    np.testing.assert_array_equal(falling, [0.0, 2.0, 5.0])
    standing = measured_distance(np.full(3, 7.0), -0.5, "positions", "the step", notes)
    np.testing.assert_array_equal(standing, [0.0, 0.5, 1.0])
    assert notes[-1].endswith("by the step, counted towards smaller positions")
    assert equal_steps(3, None, "the step", notes) is None


def test_a_clock_goes_on_over_midnight_and_never_back():
    notes = []
    found = measured_clock(np.array([DAY - 1, DAY - 0.5, 0.5]), notes)
    np.testing.assert_allclose(found, [DAY - 1, DAY - 0.5, DAY + 0.5])
    assert notes == ["the clock passes midnight 1 times: it is counted on"]
    assert measured_clock(np.array([1.0, 0.5, 2.0]), notes) is None
    assert notes[-1] == "the clock goes back 1 times, by up to 0.5 s: not used"
    assert measured_clock(np.full(4, 3.0), notes) is None
    assert measured_clock(np.array([1.0, np.nan]), notes) is None


def test_antennas_that_only_move_apart_make_a_gather():
    notes = []
    assert (
        gather_of_separations(np.array([0.2, 0.4, 0.6]), " m", notes)
        == "antennas 0.2 to 0.6 m apart"
    )
    assert gather_of_separations(np.array([0.2, 0.201]), " m", notes) == ""
    assert notes == []
    assert gather_of_separations(np.array([0.2, 0.6, 0.4]), " m", notes) == ""
    assert notes == ["the trace headers put the antennas 0.2 to 0.6 m apart, which is not used"]


def test_numbers_in_fields_of_bytes():
    first, second, third = numbers_in(b"1.5\0x 2e3nope", [5, 4, 4])
    assert (first, second) == (1.5, 2000.0)
    assert np.isnan(third)


@pytest.mark.parametrize(
    ("line", "is_header"),
    [("", True), ("# 12", True), ("x,y,z", True), ("1,2", False), ("  %3", True), ("a1", False)],
)
def test_lines_that_are_no_data(line, is_header):
    assert is_header_line(line) == is_header
