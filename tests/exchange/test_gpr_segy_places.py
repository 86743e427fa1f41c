"""Places of the traces of a SEG-Y by the coordinates of their headers."""

import numpy as np
import pytest

from flgpr.formats import gpr_run, read_gpr
from io_gpr import (
    SAMPLES,
    STEP,
    write_segy,
)
from io_open import write_su
from io_recordings import ALONG, COUNTS, TRACES, notes_with, patched, segy_words


@pytest.mark.parametrize(("name", "offset"), [("source", 72), ("group", 80), ("CDP", 180)])
def test_coordinates_wherever_they_stand(name, offset, tmp_path):
    path = write_segy(tmp_path / "a.sgy", COUNTS, place=[(0, 0)] * TRACES)
    segy_words(
        path,
        TRACES,
        x=(offset, ">i", lambda k: 50_000_000 + round(100 * STEP * k)),
        y=(offset + 4, ">i", 5),
    )
    read = read_gpr(path)
    np.testing.assert_allclose(read.distance, ALONG, atol=1e-6)
    assert notes_with(read, f"{name} coordinates (bytes {offset + 1}-{offset + 8})")


def test_source_and_group_tell_the_separation(tmp_path):
    path = write_segy(tmp_path / "a.sgy", COUNTS)
    segy_words(path, TRACES, x=(80, ">i", lambda k: round(100 * STEP * k)), y=(84, ">i", 20))
    read = read_gpr(path)
    assert read.separation == pytest.approx(0.2)
    assert notes_with(read, "the antennas' separation is the distance of source and group")


@pytest.mark.parametrize("kind", ["sgy", "su"])
@pytest.mark.parametrize("form", ["midpoint stays", "source stays", "zigzag"])
def test_places_of_source_and_group_that_move_apart_make_no_line(kind, form, tmp_path):
    """Cm: both go away from the midpoint of a CMP, the group alone from the source of a WARR."""
    write = write_su if kind == "su" else write_segy
    path = write(tmp_path / f"a.{kind}", COUNTS)
    step = {"midpoint stays": 5, "source stays": 10, "zigzag": 0}[form]
    words = {
        "source_x": ("i", 72, lambda k: 5000 - 5 * k if form == "midpoint stays" else 5000),
        "source_y": ("i", 76, 900),
        "group_x": ("i", 80, lambda k: 5020 + step * k + (30 * (k % 3) if form == "zigzag" else 0)),
        "group_y": ("i", 84, lambda k: 900 + (k if form == "zigzag" else 0)),
    }
    order = "<" if kind == "su" else ">"
    start = 0 if kind == "su" else 3600
    record = 240 + (4 if kind == "su" else 2) * SAMPLES
    patches = []
    for trace in range(TRACES):
        for letter, offset, value in words.values():
            number = value(trace) if callable(value) else value
            patches.append((start + trace * record + offset, order + letter, number))
    read = read_gpr(patched(path, *patches))
    if form == "zigzag":
        assert not read.gather
        assert notes_with(read, "m apart, which is not used")
        return
    assert read.gather == "antennas 0.2 to 3.1 m apart"
    assert notes_with(read, "it is no line of one offset")
    with pytest.raises(ValueError, match="its antennas move apart"):
        gpr_run(read)


@pytest.mark.parametrize(("unit", "scalar"), [(2, 1000), (3, 10_000), (4, 1000)])
def test_positions_of_segy_in_every_angular_unit(unit, scalar, tmp_path):
    degrees = np.stack([11 + np.arange(TRACES) / 3600, np.full(TRACES, 47.5125)], axis=1)
    values = degrees * (3600 if unit == 2 else 1)
    if unit == 4:  # 47 degrees, 30 minutes and 45 seconds are 473045
        whole = np.floor(degrees)
        minutes = degrees % 1 * 60
        values = (
            whole * 10_000
            + np.floor(minutes + 1e-9) * 100
            + (minutes - np.floor(minutes + 1e-9)) * 60
        )
    place = np.round(values * scalar).astype(int)
    read = read_gpr(write_segy(tmp_path / "a.sgy", COUNTS, unit=unit, scalar=-scalar, place=place))
    np.testing.assert_allclose(read.fixes[:, 1:3], degrees, atol=1e-4 if unit == 3 else 1e-6)
    assert notes_with(read, f"{TRACES} of {TRACES} positions tell no height: 0 m is taken")


def test_coordinates_that_never_change_are_told(tmp_path):
    read = read_gpr(write_segy(tmp_path / "a.sgy", COUNTS, place=[(7, 9)] * TRACES))
    assert read.distance is None
    assert notes_with(
        read, "source coordinates (bytes 73-80) are the same in all traces: they are not used"
    )


def float_words(**values):
    """Words of a trace header as IEEE floats: name=(offset, function of the trace)."""
    return {name: (offset, ">f", value) for name, (offset, value) in values.items()}


@pytest.mark.parametrize("offset", [72, 80, 180])
@pytest.mark.parametrize("step", [0.7, 0.03125])
def test_coordinates_as_floats_are_known_by_their_size(offset, step, tmp_path):
    path = write_segy(tmp_path / "a.sgy", COUNTS, scalar=1, place=[(0, 0)] * TRACES)
    x = (offset, lambda k: 565_000 + step * k)
    y = (offset + 4, lambda k: 6_020_000.5)
    segy_words(path, TRACES, **float_words(x=x, y=y))
    read = read_gpr(path)
    np.testing.assert_allclose(read.distance, step * np.arange(TRACES), atol=0.04)
    assert notes_with(read, "are read as floating point, as some programs write them")


def test_degrees_as_floats_place_a_line(tmp_path):
    path = write_segy(tmp_path / "a.sgy", COUNTS, scalar=1, unit=3, place=[(0, 0)] * TRACES)
    words = float_words(x=(72, lambda k: 11 + 1e-4 * k), y=(76, lambda k: -47.5))
    segy_words(path, TRACES, **words)
    read = read_gpr(path)
    np.testing.assert_allclose(read.fixes[:, 1], 11 + 1e-4 * np.arange(TRACES), atol=1e-6)
    np.testing.assert_allclose(read.fixes[:, 2], -47.5)


def test_whole_numbers_that_are_places_stay_whole_numbers(tmp_path):
    """Numbers beyond 1e9 that their scalar makes an easting and a northing."""
    place = [(1_100_000_000 + round(1000 * STEP * k), 1_200_000_000) for k in range(TRACES)]
    read = read_gpr(write_segy(tmp_path / "a.sgy", COUNTS, scalar=-1000, place=place))
    np.testing.assert_allclose(read.distance, ALONG, atol=1e-6)
    assert not notes_with(read, "floating point")


@pytest.mark.parametrize(
    ("offset", "scalar", "apart", "manner"),
    [(334, -1000, 0.334, "scaled as the coordinates are"), (2, 1, 2.0, "scaled"),
     (334, 1, 0.334, "in millimetres"), (-50, -100, 0.5, "scaled")],
)  # fmt: skip
def test_the_distance_from_source_to_receiver_is_the_separation(
    offset, scalar, apart, manner, tmp_path
):
    path = write_segy(tmp_path / "a.sgy", COUNTS, scalar=scalar)
    segy_words(path, TRACES, offset=(36, ">i", offset))
    read = read_gpr(path)
    assert read.separation == pytest.approx(apart)
    assert notes_with(read, manner)


def test_a_distance_that_no_antennas_have_is_told(tmp_path):
    path = write_segy(tmp_path / "a.sgy", COUNTS)
    segy_words(path, TRACES, offset=(36, ">i", 99_999_999))
    read = read_gpr(path)
    assert read.separation is None
    assert notes_with(read, "is none of antennas and not used")


def test_channels_that_trace_headers_count_come_apart(tmp_path):
    both = np.stack([COUNTS, -2 * COUNTS], axis=1).reshape(2 * TRACES, -1)
    place = [(round(100 * STEP * (k // 2)), 0) for k in range(2 * TRACES)]
    path = write_segy(tmp_path / "a.seg", both, code=2, place=place)
    segy_words(
        path,
        2 * TRACES,
        width=4,
        record=(8, ">i", lambda k: 1 + k // 2),
        channel=(12, ">i", lambda k: 1 + k % 2),
    )
    read = read_gpr(path)
    np.testing.assert_array_equal(read.traces[:, 0], COUNTS)
    np.testing.assert_array_equal(read.traces[:, 1], -2 * COUNTS)
    np.testing.assert_allclose(read.distance, ALONG)


def test_channels_of_trace_headers_have_places_and_separations_of_their_own(tmp_path):
    """Channel 0 is 0.25 m to the left of the course and 0.25 m long, channel 1 the mirror, 0.6 m."""
    both = np.stack([COUNTS, -2 * COUNTS], axis=1).reshape(2 * TRACES, -1)
    place = [(-25 if k % 2 == 0 else 25, round(100 * STEP * (k // 2))) for k in range(2 * TRACES)]
    path = write_segy(tmp_path / "a.seg", both, code=2, place=place)
    segy_words(
        path,
        2 * TRACES,
        width=4,
        record=(8, ">i", lambda k: 1 + k // 2),
        channel=(12, ">i", lambda k: 1 + k % 2),
        offset=(36, ">i", lambda k: 25 if k % 2 == 0 else 60),
    )
    read = read_gpr(path)
    np.testing.assert_allclose(read.offsets, [[-0.25, 0], [0.25, 0]], atol=1e-12)
    np.testing.assert_allclose(read.distance, ALONG, atol=1e-9)
    assert read.separation == pytest.approx(0.25)
    assert notes_with(read, "antennas of channel 1 are 0.6 m apart, those of channel 0 0.25 m")
    assert not notes_with(read, "is no common-offset line")


def test_degrees_whose_unit_says_lengths_place_a_line(tmp_path):
    path = write_segy(tmp_path / "a.sgy", COUNTS, scalar=1)
    words = float_words(x=(72, lambda k: 11 + 2e-5 * k), y=(76, lambda k: 48.0))
    segy_words(path, TRACES, **words)
    read = read_gpr(path)
    assert read.distance is None
    np.testing.assert_allclose(read.fixes[:, 1], 11 + 2e-5 * np.arange(TRACES), atol=1e-6)
    assert notes_with(read, "are taken as degrees, though their unit is 1: as lengths all traces")


@pytest.mark.parametrize("kind", ["noise", "whole decimetres"])
def test_coordinates_that_scatter_do_not_make_a_straight_line_longer(kind, tmp_path):
    """5 cm from trace to trace, at 30 degrees to the grid: 2.7 m."""
    count = 4 * TRACES
    along = 0.05 * np.arange(count)
    xy = along[:, None] * [np.cos(np.pi / 6), np.sin(np.pi / 6)]
    xy = (
        np.round(xy, 1)
        if kind != "noise"
        else xy + np.random.default_rng(1).normal(0, 0.02, xy.shape)
    )
    place = [(round(100 * x), round(100 * y)) for x, y in xy]
    path = write_segy(tmp_path / "a.sgy", np.tile(COUNTS, (4, 1)), place=place)
    read = read_gpr(path)
    assert np.abs(read.distance - along).max() < 0.12
    assert notes_with(read, "distances are those along the straight course")
    bent = [(x, y + 3 * k) for k, (x, y) in enumerate(place)]
    bent = [(x, y if k < count / 2 else -y) for k, (x, y) in enumerate(bent)]
    crooked = read_gpr(write_segy(tmp_path / "b.sgy", np.tile(COUNTS, (4, 1)), place=bent))
    assert notes_with(crooked, "the former is taken, for the line is not straight")
