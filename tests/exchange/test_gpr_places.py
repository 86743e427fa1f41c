"""Places and clocks of traces: what was measured stays, and what is replaced is counted."""

import warnings

import numpy as np
import pytest

from flgpr.formats import explain_file, gpr_run, read_gpr
from io_gpr import STEP, write_dt1, write_dzt, write_mala
from io_recordings import ALONG, COUNTS, TRACES, dt1_at, notes_with, patched, set_dt1_words


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({11: 10, 12: 10}, "2 traces stand where the one before was and 0 lie behind it"),
        ({20: 18}, "0 traces stand where the one before was and 1 lie behind it"),
        ({29: 3000}, "jump 1 times, by up to 148.6 m (usually 0.05 m): kept as measured"),
    ],
)
def test_places_of_the_trace_headers_stay_as_they_were_measured(change, words, tmp_path):
    places = ALONG.copy()
    for trace, step in change.items():
        places[trace] = STEP * step
    read = read_gpr(dt1_at(tmp_path / "a.dt1", COUNTS, places))
    np.testing.assert_allclose(read.distance, places, rtol=1e-6)
    assert notes_with(read, words)
    np.testing.assert_allclose(gpr_run(read)["pose"].values[:, 1], places, rtol=1e-6)


def test_places_that_are_no_numbers_are_put_between_their_neighbours(tmp_path):
    places = ALONG.copy()
    places[[4, 5]] = np.nan
    read = read_gpr(dt1_at(tmp_path / "a.dt1", COUNTS, places))
    np.testing.assert_allclose(read.distance, ALONG, atol=1e-6)
    assert notes_with(read, f"2 of {TRACES} positions of the trace headers are no numbers")


def test_places_that_all_are_the_same_tell_nothing(tmp_path):
    read = read_gpr(dt1_at(tmp_path / "a.dt1", COUNTS, np.full(TRACES, 7.0)))
    np.testing.assert_allclose(read.distance, ALONG)
    assert notes_with(read, "equal steps of 0.05 m, by STEP SIZE USED in the header")


def test_a_cart_that_turned_round_went_the_whole_way(tmp_path):
    places = np.minimum(ALONG, ALONG[::-1])
    told = explain_file(dt1_at(tmp_path / "a.dt1", COUNTS, places))
    assert f"length {np.abs(np.diff(places)).sum():.6g} m" in "\n".join(told.lines)


@pytest.mark.parametrize(
    ("unit", "metre"),
    [
        ("cm", 0.01),
        ("mm", 1e-3),
        ("in", 0.0254),
        ("Feet", 0.3048),
        ("metres", 1.0),
        ("meter(s)", 1.0),
        ("yards", 0.9144),
    ],
)
def test_positions_are_in_the_unit_that_the_header_tells(unit, metre, tmp_path):
    read = read_gpr(
        dt1_at(
            tmp_path / "a.dt1",
            COUNTS,
            ALONG / metre,
            POSITION_UNITS=unit,
            ANTENNA_SEPARATION=0.2 / metre,
        )
    )
    np.testing.assert_allclose(read.distance, ALONG, rtol=1e-5)
    assert read.separation == pytest.approx(0.2)


def test_a_unit_that_is_not_known_places_nothing(tmp_path):
    read = read_gpr(write_dt1(tmp_path / "a.dt1", COUNTS, POSITION_UNITS="paces"))
    assert (read.distance, read.separation) == (None, None)
    assert notes_with(read, "POSITION UNITS are 'paces', which is no unit that is known")
    told = read_gpr(
        write_dt1(tmp_path / "b.dt1", COUNTS, POSITION_UNITS="cm", ANTENNA_SEPARATION=0.2)
    )
    assert told.separation == 0.2
    assert notes_with(told, "ANTENNA SEPARATION 0.2 is taken as metres")


def test_a_clock_goes_on_over_midnight_and_is_not_used_where_it_goes_back(tmp_path):
    path = write_dt1(tmp_path / "a.dt1", COUNTS)
    set_dt1_words(path, "second", [(86_390 + k) % 86_400 for k in range(TRACES)])
    read = read_gpr(path)
    np.testing.assert_allclose(read.time, 86_390 + np.arange(TRACES))
    assert notes_with(read, "the clock passes midnight 1 times")
    set_dt1_words(path, "second", [k if k != 9 else 3 for k in range(TRACES)])
    back = read_gpr(path)
    assert back.time is None
    assert notes_with(back, "the clock goes back 1 times, by up to 5 s: not used")


def test_a_signalling_nan_in_an_unused_word_warns_nobody(tmp_path):
    path = write_dt1(tmp_path / "a.dt1", COUNTS)
    set_dt1_words(path, "receiver", [b"\x01\x00\xa0\x7f"] * TRACES)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        np.testing.assert_array_equal(read_gpr(path).traces[:, 0], COUNTS)


def test_a_line_that_was_triggered_by_time_has_a_clock(tmp_path):
    read = read_gpr(write_mala(tmp_path / "a.rd3", COUNTS, DISTANCE_FLAG=0, TIME_FLAG=1))
    np.testing.assert_allclose(read.time, 0.1 * np.arange(TRACES))
    assert notes_with(read, "a trace every 0.1 s, by TIME INTERVAL in the header")
    assert notes_with(read, "DISTANCE FLAG is 0: no wheel was used")


def test_a_clock_that_is_set_back_over_midnight_is_not_used(tmp_path):
    """Two hours back from a second after midnight is a time of the day before."""
    path = write_dt1(tmp_path / "a.dt1", COUNTS)
    seconds = [86_395 + k if k < 10 else 86_395 + k - 7200 for k in range(TRACES)]
    set_dt1_words(path, "second", [second % 86_400 for second in seconds])
    read = read_gpr(path)
    assert read.time is None
    assert notes_with(read, "the clock goes back 1 times, by up to 7199 s: not used")


@pytest.mark.parametrize(
    ("per_metre", "per_second"), [(np.nan, 50.0), (1e9, np.inf), (-1e-9, -3.0)]
)
def test_spacings_and_rates_that_are_none_are_told(per_metre, per_second, tmp_path):
    path = write_dzt(tmp_path / "a.dzt", COUNTS[:, None], per_metre=per_metre)
    read = read_gpr(patched(path, (10, "<f", per_second)))
    assert read.distance is None
    assert notes_with(read, "scans per metre in the header are no spacing and are not used")
    assert bool(notes_with(read, "are no rate and are not used")) == (per_second != 50.0)
