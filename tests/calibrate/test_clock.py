import numpy as np
import pytest

from calibrate.echoes import echo
from flgpr.calibrate import (
    brightest_points,
    estimate_clock,
    estimate_range_bias,
    sharpness,
    synthetic_aperture,
    with_track,
)
from flgpr.imaging import ImagingOperator
from flgpr.model import make_run, way_weights
from flgpr.model.track import make_track

FREQUENCY = np.linspace(1.0e9, 2.5e9, 60)
TARGETS = np.array([[-0.6, 6.0, 0.0], [0.9, 7.5, 0.0]])
OFFSET = 3.37
BIAS = 0.21


@pytest.fixture(scope="module")
def moving():
    """One antenna that goes sideways at uneven speed; its positions are on a clock 3.37 s ahead, ranges 0.21 m long."""
    stamp = np.linspace(0, 14, 600)
    way = -1.5 + 3.0 / (1 + np.exp(-(stamp - 7.5) / 0.8))
    track = make_track(stamp, np.stack([way, np.zeros_like(way), np.full_like(way, 1.5)], axis=1))
    time = np.arange(0, 9, 0.05)
    place = np.stack([np.interp(time + OFFSET, stamp, track[n]) for n in "xyz"], axis=1)
    signal = echo(place, place, TARGETS, FREQUENCY) * np.exp(
        -2j * np.pi * FREQUENCY * 2 * BIAS / 299_792_458.0
    )
    run = make_run(
        signal[:, None, None], FREQUENCY, ["VV"], [[0, 0, 0]], [[0, 0, 0]], np.zeros((180, 6)), time
    )
    return run, track


def test_the_clock_is_found_by_focus_alone(moving):
    run, track = moving
    x = np.arange(-1.5, 1.8, 0.06)
    y = np.arange(5.5, 8.5, 0.06)
    pixels = np.stack([*np.meshgrid(x, y), np.zeros((y.size, x.size))], axis=-1)
    fit = estimate_clock(run, track, pixels, np.arange(2.6, 4.4, 0.1), ImagingOperator)
    assert fit.offset == pytest.approx(OFFSET, abs=0.02)
    assert fit.trials["sharpness"].max() > 1.5 * fit.trials["sharpness"].median()


def test_the_range_bias_is_found_from_known_reflectors(moving):
    run, track = moving
    fit = estimate_range_bias(with_track(run, track, OFFSET), TARGETS, ImagingOperator)
    assert fit.bias == pytest.approx(BIAS, abs=0.01)
    assert np.ptp(fit.points["bias"]) < 0.02


def test_offsets_outside_the_track_are_refused(moving):
    run, track = moving
    with pytest.raises(ValueError, match="offsets must put the scans inside the track"):
        estimate_clock(run, track, np.zeros((1, 3)), [100.0], ImagingOperator)
    with pytest.raises(ValueError, match="is the clock offset right"):
        with_track(run, track, 50.0)


def test_a_standing_vehicle_counts_once():
    weights = way_weights([[0, 0, 0]] * 5 + [[1, 0, 0], [2, 0, 0]])
    assert weights[:4].max() == 0
    assert weights.mean() == pytest.approx(1)
    assert way_weights(np.zeros((3, 3))).tolist() == [1, 1, 1]


def test_incomplete_scans_stay_out_of_the_aperture(moving):
    run, track = moving
    run = with_track(run, track, OFFSET).copy(deep=True)
    run["valid"][3] = False
    assert synthetic_aperture(run)[1].shape == (179, 3)


def test_sharpness_and_brightest_points():
    image = np.zeros(100)
    assert sharpness(image) == 0
    image[[3, 4, 60]] = 5, 4, 3
    assert sharpness(np.eye(1)) == 1
    assert sharpness(np.ones(100)) == pytest.approx(0.01)
    pixels = np.stack([np.arange(100.0), np.zeros(100), np.zeros(100)], axis=1)
    assert brightest_points(image, pixels, 2, 5.0)[:, 0].tolist() == [3, 60]
