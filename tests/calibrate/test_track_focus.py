"""Poses by the ground that several scans see, against the true ones."""

import numpy as np
import pytest

from calibrate.rough_ground import HEIGHT, drive
from flgpr.calibrate import focus_poses
from flgpr.calibrate.track_focus import _slope_of_height
from flgpr.imaging import ImagingOperator
from flgpr.model.run import with_signal

SIGHT = np.array([0.0, 0.92, -0.39])  # of the ground ahead, from 3 m above it


@pytest.fixture(scope="module")
def true():
    return drive()


def moved(run, size, seed=5):
    """Return the run with wrong positions, and by how much they are wrong."""
    error = np.random.default_rng(seed).normal(0, size, (run.sizes["scan"], 3))
    pose = run["pose"].values.copy()
    pose[:, :3] += error
    return run.assign(pose=(run["pose"].dims, pose)), error


def against_next(error):
    """Return the error of a scan against its neighbours along the sight, m."""
    return np.std(np.diff(error @ SIGHT)) / np.sqrt(2)


def left(fit, run):
    return (fit.pose - run["pose"].values)[:, :3]


@pytest.mark.parametrize("size", [0.003, 0.01, 0.025])
def test_errors_from_scan_to_scan_are_found(true, size):
    run, error = moved(true, size)
    fit = focus_poses(run, ImagingOperator, size)
    assert fit.doubt == ""
    assert fit.alone == 0
    assert against_next(left(fit, true)) < min(2.5e-3, 0.6 * against_next(error))
    assert fit.before == pytest.approx(against_next(error), rel=0.5)
    # The uncertainty that is stated is that of the errors that are left.
    assert 0.3 < np.sqrt(np.mean((left(fit, true) / fit.sigma) ** 2)) < 2.0
    np.testing.assert_array_equal(fit.pose[:, 3:], true["pose"].values[:, 3:])


def test_a_perfect_track_stays_so(true):
    fit = focus_poses(true, ImagingOperator, 0.01)
    assert against_next(left(fit, true)) < 1.5e-3
    assert fit.after < 2e-3


def test_what_all_scans_have_in_common_is_not_found(true):
    pose = true["pose"].values.copy()
    pose[:, :2] += 0.02
    fit = focus_poses(true.assign(pose=(true["pose"].dims, pose)), ImagingOperator, 0.01)
    np.testing.assert_allclose(fit.correction.mean(axis=0), 0.0, atol=1e-3)


@pytest.mark.slow("many scans")
def test_many_scans_of_the_same_ground_are_no_more_sure_than_they_should_be():
    true = drive(scans=40, step=0.2)
    fit = focus_poses(true, ImagingOperator)
    assert fit.position == pytest.approx(0.0286, abs=1e-4)
    assert np.sqrt(np.mean((left(fit, true) / fit.sigma) ** 2)) < 2.0


def test_missing_sweeps_are_left_out(true):
    signal = true["signal"].values.copy()
    signal[2, :, :3] = np.nan
    signal[4] = np.nan
    run, error = moved(with_signal(true, signal), 0.01)
    fit = focus_poses(run, ImagingOperator, 0.01)
    assert fit.alone == 1
    np.testing.assert_allclose(fit.correction[4], 0.0, atol=1e-9)
    rest = np.array([0, 1, 2, 3])
    assert against_next(left(fit, true)[rest]) < 0.4 * against_next(error[rest])


def test_ground_that_does_not_stay_the_same_is_doubted(true):
    rng = np.random.default_rng(3)
    shape = true["signal"].shape
    noise = rng.normal(size=shape) + 1j * rng.normal(size=shape)
    fit = focus_poses(with_signal(true, noise), ImagingOperator, 0.01)
    assert fit.alike < fit.pairs / 2
    assert fit.doubt.startswith(f"only {fit.alike} of {fit.pairs} pairs of scans see the ground")


def test_larger_errors_than_were_assumed_are_doubted(true):
    run, _ = moved(true, 0.025)
    fit = focus_poses(run, ImagingOperator, 0.002)
    assert "are these larger than 0.002 m?" in fit.doubt


@pytest.mark.parametrize("position", [0.0, -0.01, np.nan, np.inf])
def test_errors_of_the_navigation_are_a_length(true, position):
    with pytest.raises(ValueError, match=f"position must be positive, got {position:g}"):
        focus_poses(true, ImagingOperator, position)


def test_what_cannot_be_compared_is_refused(true):
    with pytest.raises(ValueError, match=r"position must be at most 0.029 m for the phases"):
        focus_poses(true, ImagingOperator, 0.2)
    pose = true["pose"].values.copy()
    pose[:, 1] *= 10
    with pytest.raises(ValueError, match=r"scans at most 2\.7 m apart to be compared, got none"):
        focus_poses(true.assign(pose=(true["pose"].dims, pose)), ImagingOperator)
    pose[:, 2] = -1.0
    with pytest.raises(ValueError, match="antennas must be above the ground, got a height of -1 m"):
        focus_poses(true.assign(pose=(true["pose"].dims, pose)), ImagingOperator)


def test_higher_ground_is_seen_at_pixels_of_the_same_mean_range():
    """The slope by the height, against ranges of a raised point and of the pixel where it shows."""
    places = np.array([[0.0, 0.0, HEIGHT], [0.0, 1.5, HEIGHT]])

    def ranges(point):
        return np.linalg.norm(places - point, axis=1)

    pixel, height = np.array([0.0, 7.0, 0.0]), 1e-4
    slopes = [((place - pixel) / np.linalg.norm(place - pixel))[None] for place in places]
    near, far = pixel + [0, 0.0, height], pixel + [0, 0.01, height]
    # The raised point whose mean range is that of the pixel lies farther on.
    short, long = (ranges(point).mean() - ranges(pixel).mean() for point in (near, far))
    share = -short / (long - short)
    raised = near + share * (far - near)
    expected = -np.diff(ranges(raised) - ranges(pixel))[0] / height
    assert _slope_of_height(*slopes)[0] == pytest.approx(expected, rel=1e-2)


def test_a_vehicle_that_waits_spoils_nothing(true):
    """Scans of one place, with errors of their own, between those of a vehicle that drives."""
    order = [0, 1, 2, *[3] * 12, 4, 5, 6]
    waiting = true.isel(scan=order)
    run, error = moved(waiting, 0.01)
    fit = focus_poses(run, ImagingOperator, 0.01)
    assert against_next(left(fit, waiting)) < 0.25 * against_next(error)
