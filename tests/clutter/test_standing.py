"""What stands still is subtracted and what moves stays: of scans, of runs and of recorded traces."""

import numpy as np
import pytest

from clutter.test_traces import TONES, level_at, run_of
from flgpr.clutter import (
    remove_mean_trace,
    remove_standing,
    standing_field,
    subtract_mean_scan,
    subtract_standing,
)
from flgpr.model import SPEED_OF_LIGHT
from flgpr.model.phase import path_phase

RNG = np.random.default_rng(3)


def test_the_standing_field_is_the_median_and_follows_the_gain_of_each_scan():
    field = RNG.normal(size=(2, 3, 8)) + 1j * RNG.normal(size=(2, 3, 8))
    gain = (1 + 0.1 * RNG.normal(size=(7, 2, 1, 1))) * np.exp(0.2j * RNG.normal(size=(7, 2, 1, 1)))
    signal = np.repeat(field[None], 7, axis=0)
    signal[2] += 100.0  # what passes by in a single scan does not enter a median
    np.testing.assert_allclose(standing_field(signal), field, atol=1e-6)
    remainder = subtract_standing(gain * field, field.astype(np.complex64))
    assert np.abs(remainder).max() < 1e-5
    with pytest.raises(ValueError, match="at least three scans to tell what stands still, got 2"):
        standing_field(signal[:2])


def test_what_stands_still_goes_and_what_moves_stays():
    moving = np.stack([path_phase(TONES, SPEED_OF_LIGHT * (30 + 3 * k) * 1e-9) for k in range(9)])
    still = 100 * path_phase(TONES, SPEED_OF_LIGHT * 10e-9)
    both = run_of((moving + still)[:, None, None])
    for scans in (None, 5):
        left = remove_standing(both, scans)
        assert level_at(left, 10).max() < 0.6
        assert level_at(left, 30 + 3 * 4)[4] > 0.6


def test_a_slow_change_goes_with_a_window_only():
    drift = np.exp(1j * np.linspace(0, 3, 60))[:, None] * np.linspace(1, 2, 60)[:, None]
    ground = 100 * path_phase(TONES, SPEED_OF_LIGHT * (10 + 0.02 * np.arange(60)) * 1e-9) * drift
    run = run_of(ground[:, None, None])
    by_all_scans = np.abs(remove_standing(run)["signal"].values).mean()
    by_five_scans = np.abs(remove_standing(run, 5)["signal"].values).mean()
    assert by_five_scans < 0.1 * by_all_scans


def test_an_incomplete_scan_stays_as_it_is_and_does_not_count():
    signal = np.ones((5, 1, 1, TONES.size))
    signal[2] = np.nan
    cleaned = remove_standing(run_of(signal))
    assert cleaned["valid"].values.ravel().tolist() == [True, True, False, True, True]
    assert np.isnan(cleaned["signal"].values[2]).all()
    assert np.abs(cleaned["signal"].values[[0, 1, 3, 4]]).max() < 1e-6
    with pytest.raises(ValueError, match="at least 3 scans, got 2"):
        remove_standing(run_of(signal), 2)


def test_a_vehicle_that_waits_leaves_no_ghost_in_the_mean_scan():
    """300 scans at one place and 90 on the way: a plain mean would hold the echo of where it waited."""
    delay = (30 + np.r_[np.zeros(300), 0.2 * np.arange(90)]) * 1e-9
    moving = path_phase(TONES, SPEED_OF_LIGHT * delay)
    coupling = 5 * path_phase(TONES, SPEED_OF_LIGHT * 10e-9)
    run = run_of((moving + coupling)[:, None, None])
    subtracted = run["signal"].values - subtract_mean_scan(run)["signal"].values
    ghost = moving.mean(axis=0)
    assert np.linalg.norm(subtracted[0, 0, 0] - coupling) < 0.4 * np.linalg.norm(ghost)
    with pytest.raises(ValueError, match="five complete scans"):
        subtract_mean_scan(run.isel(scan=slice(4)))


def test_what_is_the_same_in_all_traces_goes_and_the_rest_stays():
    standing = RNG.normal(size=40)
    target = np.zeros((6, 40))
    target[2, 20] = 6.0
    left = remove_mean_trace(target + standing)
    np.testing.assert_allclose(left, target - target.mean(axis=0), atol=1e-12)


def test_a_trace_without_data_stays_so_and_does_not_count_in_the_mean():
    traces = RNG.normal(size=(6, 40))
    gaps = traces.copy()
    gaps[3] = np.nan
    cleaned = remove_mean_trace(gaps)
    with_data = [0, 1, 2, 4, 5]
    assert np.isnan(cleaned[3]).all()
    np.testing.assert_allclose(cleaned[with_data], remove_mean_trace(traces[with_data]), atol=1e-12)
    with pytest.raises(ValueError, match="at least 2 traces with data, got 1"):
        remove_mean_trace(traces[:1])
