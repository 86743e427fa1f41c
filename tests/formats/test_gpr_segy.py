"""SEG-Y as radars write it: revisions, sample counts, coordinates."""

import numpy as np
import pytest

from flgpr.formats import gpr_run, read_gpr
from io_gpr import (
    INTERVAL,
    SAMPLES,
    STEP,
    write_segy,
)
from io_open import write_su
from io_recordings import ALONG, COUNTS, TRACES, notes_with, patched, segy_words, with_extra_headers


@pytest.mark.parametrize(
    ("revision", "count", "form"),
    [(b"\2\0", 1, ">i"), (b"\2\0", 1, ">h"), (b"\2\1", 2, ">h"), (b"\2\1", 1, ">i")],
)
def test_extra_headers_of_revision_2_are_passed_over(revision, count, form, tmp_path):
    path = with_extra_headers(write_segy(tmp_path / "a.sgy", COUNTS), TRACES, revision, count, form)
    read = read_gpr(path)
    np.testing.assert_array_equal(read.traces[:, 0], COUNTS)
    assert notes_with(read, f"every trace has {count} extra headers")
    np.testing.assert_allclose(read.distance, ALONG, atol=1e-9)


def test_a_revision_that_does_not_exist_stays_readable(tmp_path):
    path = patched(
        write_segy(tmp_path / "a.sgy", COUNTS),
        (3500, ">H", 0x2425),
        (3504, ">h", 3),
        (3506, ">i", 77),
    )
    read = read_gpr(path)
    np.testing.assert_array_equal(read.traces[:, 0], COUNTS)
    assert notes_with(read, "its revision word is 36.37, which does not exist")
    assert notes_with(read, "its traces begin at byte 3600, not at 13200")


def test_samples_and_interval_of_the_trace_headers(tmp_path):
    path = write_segy(tmp_path / "a.sgy", COUNTS)
    segy_words(path, TRACES, samples=(114, ">H", SAMPLES), interval=(116, ">H", 200))
    read = read_gpr(patched(path, (3220, ">H", 0), (3216, ">H", 0)))
    np.testing.assert_array_equal(read.traces[:, 0], COUNTS)
    np.testing.assert_allclose(read.delay, np.arange(SAMPLES) * INTERVAL, atol=1e-16)
    assert notes_with(read, f"the number of samples, {SAMPLES}, is that of the trace headers")
    assert notes_with(read, "the sample interval, 200, is that of the first trace header")
    wrong = read_gpr(patched(path, (3220, ">H", 100), (3216, ">H", 200)))
    np.testing.assert_array_equal(wrong.traces[:, 0], COUNTS)
    bare = patched(write_segy(tmp_path / "b.sgy", COUNTS), (3220, ">H", 0))
    with pytest.raises(ValueError, match="it must tell the number of samples"):
        read_gpr(bare)
    with pytest.raises(ValueError, match="it must tell the sample interval"):
        read_gpr(patched(write_segy(tmp_path / "c.sgy", COUNTS), (3216, ">H", 0)))


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


def test_words_that_change_the_meaning_of_a_trace_are_told(tmp_path):
    path = write_segy(tmp_path / "a.sgy", COUNTS)
    segy_words(
        path, TRACES, dead=(28, ">h", lambda k: 2 if k == 3 else 1), offset=(36, ">i", lambda k: k)
    )
    read = read_gpr(path)
    assert np.isnan(read.traces[3]).all()
    np.testing.assert_array_equal(
        np.delete(read.traces[:, 0], 3, axis=0), np.delete(COUNTS, 3, axis=0)
    )
    assert notes_with(read, "1 traces without data")
    assert notes_with(read, "the distance from source to receiver (bytes 37-40) goes from 0 to 29")
    odd = patched(write_segy(tmp_path / "b.sgy", COUNTS), (3254, ">H", 9), (3600 + 88, ">h", 1))
    assert notes_with(read_gpr(odd), "its measurement system is 9, which does not exist")


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
