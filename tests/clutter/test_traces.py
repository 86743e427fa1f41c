"""Steps on raw data against what they mean for a trace in time."""

import numpy as np
import pytest

from flgpr.clutter import (
    band_pass,
    dewow,
    gate,
    shift_time,
    subtract_run,
    time_gain,
)
from flgpr.model import SPEED_OF_LIGHT, make_run
from flgpr.model.phase import path_phase

TONES = 0.2e9 + 10e6 * np.arange(100)  # an unambiguous time of 100 ns in steps of 1 ns


def run_of(signal, **attrs):
    signal = np.asarray(signal, np.complex64)
    scans = len(signal)
    pose = np.zeros((scans, 6))
    pose[:, 1] = 0.1 * np.arange(scans)
    antennas = np.zeros((signal.shape[2], 3))
    return make_run(signal, TONES, ["HH"], antennas, antennas, pose, attrs=attrs)


def echoes(*delays_and_levels, scans=1):
    one = sum(
        level * path_phase(TONES, SPEED_OF_LIGHT * delay * 1e-9)
        for delay, level in delays_and_levels
    )
    return run_of(np.broadcast_to(one, (scans, 1, 1, TONES.size)))


def level_at(run, delay):
    """Magnitude at a delay (ns), summed term by term."""
    turn = np.exp(2j * np.pi * TONES * delay * 1e-9)
    return np.abs((run["signal"].values * turn).mean(axis=-1)).squeeze()


def test_later_time_zero_makes_echoes_come_earlier():
    moved = shift_time(echoes((20, 1)), 5e-9)
    assert level_at(moved, 15) == pytest.approx(1, abs=1e-5)
    assert level_at(moved, 20) < 0.1


@pytest.mark.parametrize("frequency", [0.2e9, 0.5e9, 1.1e9])
def test_dewow_takes_the_running_mean_off(frequency):
    length = 3e-9
    time = 7e-9
    wave = lambda at: np.exp(2j * np.pi * frequency * at)  # noqa: E731
    around = time + length * (np.arange(20000) + 0.5) / 20000 - length / 2
    wanted = wave(time) - wave(around).mean()
    tone = int(np.argmin(np.abs(TONES - frequency)))
    factor = dewow(run_of(np.ones((1, 1, 1, TONES.size))), length)["signal"].values[0, 0, 0, tone]
    assert factor * wave(time) == pytest.approx(wanted, abs=1e-5)


def test_a_band_keeps_its_tones_and_falls_off_at_both_ends():
    kept = band_pass(echoes((20, 1)), 0.4e9, 0.8e9, taper=0.5)
    assert kept["frequency"].values[[0, -1]] == pytest.approx([0.4e9, 0.8e9])
    size = np.abs(kept["signal"].values[0, 0, 0])
    assert size[[0, -1]] == pytest.approx(0, abs=1e-6)
    assert size[size.size // 2] == pytest.approx(1, abs=1e-6)
    assert (np.diff(size[:10]) > 0).all()
    with pytest.raises(
        ValueError, match=r"band must hold a tone of the run, 2e\+08 to 1.19e\+09 Hz, got 2e\+09"
    ):
        band_pass(echoes((20, 1)), 2e9, 3e9)


def test_a_band_that_ends_beyond_the_tones_cuts_nothing_there():
    run = echoes((20, 1))
    kept, beyond = band_pass(run, 0.4e9, 1.19e9), band_pass(run, 0.4e9, 100e9)
    size, size_beyond = (np.abs(one["signal"].values[0, 0, 0]) for one in (kept, beyond))
    np.testing.assert_allclose(size_beyond[:40], size[:40], atol=1e-6)  # the lower edge is the same
    assert size_beyond[-1] == pytest.approx(1, abs=1e-6)
    assert size[-1] == pytest.approx(0, abs=1e-6)


def with_pairs_reversed(run):
    """Return a run whose receivers stand in another order."""
    return run.assign(rx_position=run["rx_position"] + 0.3)


def test_another_run_is_subtracted_scan_by_scan_or_by_its_mean():
    both = echoes((20, 1), (40, 2), scans=4)
    empty = echoes((40, 2), scans=4)
    assert level_at(subtract_run(both, empty), 40).max() < 0.1
    one = run_of(empty["signal"].values[:1])
    np.testing.assert_allclose(
        subtract_run(both, one)["signal"], subtract_run(both, empty)["signal"], atol=1e-5
    )
    with pytest.raises(ValueError, match="subtract must be a run of the same frequency"):
        subtract_run(both, band_pass(empty, 0.4e9, 0.8e9))
    with pytest.raises(ValueError, match="a run of 1 pairs, got 2"):
        subtract_run(both, run_of(np.ones((4, 1, 2, TONES.size))))


def test_a_gate_silences_what_is_outside():
    inside = gate(echoes((10, 100), (40, 1), (80, 50)), 25e-9, 60e-9, 2e-9)
    assert level_at(inside, 40) == pytest.approx(1, abs=0.1)
    assert max(level_at(inside, 10), level_at(inside, 80)) < 0.1
    assert level_at(gate(echoes((40, 1)), 25e-9), 40) == pytest.approx(1, abs=0.1)


def test_gain_by_a_power_of_time_is_that_power():
    grown = time_gain(echoes((20, 1), (60, 1)), "power", 2)
    assert level_at(grown, 60) / level_at(grown, 20) == pytest.approx(9, rel=0.05)


def test_agc_brings_echoes_to_one_level():
    level = time_gain(echoes((20, 100), (60, 1)), "agc", 8e-9)
    assert 0.5 < level_at(level, 60) / level_at(level, 20) < 2


def test_missing_sweeps_stay_missing_and_do_not_spread():
    signal = echoes((20, 1), scans=5)["signal"].values.copy()
    signal[2] = np.nan
    run = run_of(signal)
    for made in (
        shift_time(run, 1e-9), dewow(run, 1e-9), gate(run, 5e-9), time_gain(run, "agc", 5e-9),
        band_pass(run, 0.3e9, 1e9), subtract_run(run, echoes((30, 1))),
    ):  # fmt: skip
        assert np.isfinite(made["signal"].values).all(axis=(1, 2, 3)).tolist() == [
            True,
            True,
            False,
            True,
            True,
        ]
        assert made["valid"].values.ravel().tolist() == [True, True, False, True, True]


@pytest.mark.parametrize(
    ("call", "rule"),
    [
        (lambda run: dewow(run, 0), "dewow must be a positive time, got 0 s"),
        (lambda run: gate(run, 5e-9, 2e-9), "gate must have start < stop"),
        (lambda run: time_gain(run, "log", 1), "gain must be one of power, agc, got 'log'"),
        (lambda run: time_gain(run, "agc", -1), "gain agc must have a positive value, got -1"),
        (lambda run: band_pass(run, 2, 1), "band must have 0 <= low < high"),
        (lambda run: gate(run.isel(frequency=[0, 1, 5]), 5e-9), "even to tell times"),
        (lambda run: gate(run, 2e-6, 3e-6), "gate must hold a time of the record, 0 to 1e-07 s"),
        (lambda run: gate(run, -3e-9, -1e-9), "gate must hold a time of the record"),
        (lambda run: shift_time(run, 2e-7), "time zero must move by less than the record, 1e-07 s"),
        (lambda run: subtract_run(run, with_pairs_reversed(run)), "same pairs in the same order"),
    ],
)
def test_what_does_not_fit_is_told(call, rule):
    with pytest.raises(ValueError, match=rule):
        call(echoes((20, 1), scans=5))
