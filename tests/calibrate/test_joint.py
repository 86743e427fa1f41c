"""Range bias and clock offset from reflectors: found where they are, doubted where they are not."""

import numpy as np
import pytest

from calibrate.echoes import echo
from flgpr.calibrate import (
    estimate_joint,
    estimate_range_bias,
    fields_over_bias,
    remove_range_bias,
    with_track,
)
from flgpr.clutter import subtract_mean_scan
from flgpr.imaging import ImagingOperator
from flgpr.model import make_run
from flgpr.model.track import make_track
from reference import slow_calibration

C = 299_792_458.0
FREQUENCY = np.linspace(1.0e9, 2.5e9, 101)  # ranges repeat after 10 m
MARKS = np.array([[-0.6, 6.0, 0.0], [0.9, 7.5, 0.0]])
OFFSETS = np.arange(-1.5, 1.51, 0.1)
NOWHERE = np.empty((0, 3))


def rail(bias=0.0, offset=0.0, targets=MARKS, amplitude=None, noise=0.3, coupling=5.0, seed=0):
    """An antenna that goes sideways at uneven speed, its track, and what stands still in all scans."""
    rng = np.random.default_rng(seed)
    stamp = np.linspace(-4, 14, 400)
    time = np.arange(0, 9, 0.1)
    way = -1.5 + 3.0 / (1 + np.exp(-(stamp - 4.5) / 0.8))
    track = make_track(stamp, np.stack([way, np.zeros_like(way), np.full_like(way, 1.5)], axis=1))
    pose = np.zeros((time.size, 6))
    pose[:, :3] = np.stack([np.interp(time + offset, stamp, track[n]) for n in "xyz"], axis=1)
    signal = noise * (rng.normal(size=(90, 101)) + 1j * rng.normal(size=(90, 101)))
    if len(targets):
        signal += echo(pose[:, :3], pose[:, :3], targets, FREQUENCY, amplitude) * turned(bias)
    signal += coupling * (turned(0.3) + 0.6 * turned(8.0))
    run = make_run(signal[:, None, None], FREQUENCY, ["VV"], [[0, 0, 0]], [[0, 0, 0]], pose, time)
    return run, track


def turned(bias):
    return np.exp(-4j * np.pi * FREQUENCY * bias / C)


def found(run, points=MARKS, **more):
    return estimate_range_bias(subtract_mean_scan(run), points, ImagingOperator, **more)


@pytest.mark.parametrize("kind", ["even", "gap", "uneven"])
def test_sums_over_all_biases_are_the_slow_ones(kind):
    rng = np.random.default_rng(3)
    tones = 1e9 + 20e6 * np.delete(np.arange(12), [] if kind == "even" else [4, 5])
    tones += rng.uniform(0, 3e6, tones.size) * (kind == "uneven")
    shape = (4, 2, 3, tones.size)
    signal = rng.normal(size=shape) + 1j * rng.normal(size=shape)
    pose = np.zeros((4, 6))
    pose[:, :3] = np.cumsum(rng.uniform(0, 0.5, (4, 3)), axis=0)
    tx, rx = rng.uniform(-1, 1, (2, 3, 3))
    run = make_run(signal, tones, ["HH", "VV"], tx, rx, pose, np.arange(4.0))
    run["valid"][1] = False
    points = np.array([[1.0, 4.0, 0.0], [-2.0, 5.0, 0.3]])
    fast, biases = fields_over_bias(run, [pose, pose + 0.0], points, (-1.5, 1.5))
    slow = slow_calibration.fields_over_bias(run, points, biases)
    assert biases[0] <= -1.5
    assert biases[-1] >= 1.5
    assert np.diff(biases).max() <= C / 2 / np.ptp(tones) / 4
    np.testing.assert_array_equal(fast[0], fast[1])
    # Neighbours in a profile are joined by straight lines: 2 % of the largest sum.
    assert np.abs(np.abs(fast[0]) - np.abs(slow)).max() < 0.02 * np.abs(slow).max()


@pytest.mark.parametrize("bias", [-2.6, -0.78, 0.0, 1.92])
@pytest.mark.parametrize("search", [2.9, 4.5])
def test_the_bias_is_found_and_a_larger_search_finds_the_same(bias, search):
    fit = found(rail(bias)[0], search=search)
    assert not fit.doubt
    assert fit.bias == pytest.approx(bias, abs=0.01)
    assert fit.spread < 0.02
    assert fit.over_runner_up > 10
    assert fit.over_moved > 10
    assert fit.offset is None


def test_a_known_bias_added_is_added_to_the_answer():
    run = rail(0.4, noise=1.0)[0]
    first = found(run)
    for more in (-2.0, 0.013, 1.7):
        assert found(remove_range_bias(run, -more)).bias - first.bias == pytest.approx(
            more, abs=0.002
        )


def test_offset_and_bias_are_found_together():
    run, track = rail(1.92, 0.43)
    fit = estimate_joint(subtract_mean_scan(run), MARKS, ImagingOperator, (-3, 3), track, OFFSETS)
    assert not fit.doubt
    assert fit.bias == pytest.approx(1.92, abs=0.01)
    assert fit.offset == pytest.approx(0.43, abs=0.02)
    assert 0 < fit.offset_sigma < 0.02
    # With the wrong clock the bias alone is not told, or not wrongly.
    alone = found(with_track(run, track, -0.8))
    assert alone.doubt


def test_what_stands_still_would_pass_for_an_echo():
    """Coupling at the distance that one reflector keeps from an antenna that hardly moves in range."""
    mark = MARKS[:1]
    run = rail(-1.0, targets=MARKS[:1], coupling=60.0)[0]
    assert found(run, mark).bias == pytest.approx(-1.0, abs=0.01)
    kept = estimate_range_bias(run, mark, ImagingOperator)
    assert kept.doubt or abs(kept.bias + 1.0) > 0.1


def test_without_a_reflector_nothing_is_told():
    for seed in range(5):
        assert found(rail(targets=NOWHERE, seed=seed, noise=1.0)[0]).doubt
    assert found(rail(targets=NOWHERE, noise=0.0, coupling=0.0)[0]).doubt


def test_a_wrong_place_is_noticed_by_two_reflectors():
    wrong = MARKS + [[0.0, 0.0, 0.0], [0.0, 0.25, 0.0]]
    assert "disagree" in found(rail(0.5)[0], wrong).doubt
    assert not found(rail(0.5)[0], wrong, tolerance=0.5).doubt
    assert found(rail(0.5)[0], MARKS + [[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0]]).doubt


def test_something_as_bright_beside_the_reflector_is_noticed():
    beside = np.array([[-0.6, 6.0, 0.0], [1.2, 6.3, 0.0]])
    assert "moved sideways" in found(rail(0.5, targets=beside)[0], MARKS[:1]).doubt
    assert not found(rail(0.5, targets=beside, amplitude=[1.0, 0.2])[0], MARKS[:1]).doubt


def test_the_edges_of_the_search_are_not_answers():
    run, track = rail(2.0, 0.3)
    assert found(run, search=1.0).doubt
    assert "edge" in found(run, search=2.03).doubt
    late = estimate_joint(
        subtract_mean_scan(run), MARKS, ImagingOperator, (-3, 3), track, np.arange(0.3, 1.0, 0.1)
    )
    assert late.doubt.startswith("the best clock offset")
    assert "edge" in late.doubt


def test_a_clock_that_cannot_be_told_from_the_bias_is_not_told():
    """Straight towards a reflector at one speed: an offset is a bias."""
    time = np.arange(0, 9, 0.1)
    stamp = np.linspace(-4, 14, 400)
    track = make_track(stamp, np.stack([0 * stamp, 0.3 * stamp, 0 * stamp], axis=1))
    pose = np.zeros((90, 6))
    pose[:, 1] = 0.3 * time
    mark = np.array([[0.0, 8.0, 0.0]])
    signal = echo(pose[:, :3], pose[:, :3], mark, FREQUENCY)[:, None, None]
    run = make_run(signal, FREQUENCY, ["VV"], [[0, 0, 0]], [[0, 0, 0]], pose, time)
    assert estimate_joint(
        subtract_mean_scan(run), mark, ImagingOperator, (-2, 2), track, OFFSETS
    ).doubt


def test_the_standard_deviations_are_of_the_errors_size():
    errors = []
    for seed in range(7):
        run, track = rail(0.7, 0.2, noise=4.0, seed=seed)
        fit = estimate_joint(
            subtract_mean_scan(run), MARKS, ImagingOperator, (-2, 2), track, OFFSETS[10:23]
        )
        assert not fit.doubt
        errors.append([(fit.bias - 0.7) / fit.bias_sigma, (fit.offset - 0.2) / fit.offset_sigma])
    size = np.sqrt(np.mean(np.square(errors), axis=0))
    assert (size > 0.15).all()
    assert (size < 2.0).all()


def test_faults_are_told():
    run, track = rail()
    for match, points, biases, more in (
        (r"\(reflector, 3\)", np.zeros((0, 3)), (-1, 1), {}),
        ("finite", [[0.0, np.nan, 0.0]], (-1, 1), {}),
        ("ranges of this run repeat", MARKS, (-6, 6), {}),
        ("eight times the range resolution", MARKS, (0, 0.1), {}),
        ("tolerance must be positive", MARKS, (-1, 1), {"tolerance": np.nan}),
        ("none from 50 to 50", MARKS, (-1, 1), {"track": track, "offsets": [50.0]}),
        ("a time for every scan", MARKS, (-1, 1), {"track": track, "offsets": []}),
    ):
        with pytest.raises(ValueError, match=match):
            estimate_joint(run, points, ImagingOperator, biases, **more)
    with pytest.raises(ValueError, match="two tones or more"):
        found(run.isel(frequency=[0]))
