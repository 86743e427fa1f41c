"""The streaming estimator against the plain functions and the slow twins."""

import numpy as np
import pytest
from drive_images import SHAPE, WINDOWS

from flgpr.clutter import (
    BackgroundEstimator,
    gain_background,
    remove_background,
    scan_gain,
    self_signature,
)
from flgpr.clutter.estimator import mean_filtered
from reference import wang2007


def estimate(scans, step=1):
    tool = BackgroundEstimator(*WINDOWS, step=step)
    for image in scans:
        tool.add_signature(image)
    for image in scans:
        tool.add_gain(image)
    return tool, tool.result()


def test_streaming_equals_the_plain_functions(scans):
    tool, background = estimate(scans)
    b1 = self_signature(scans)
    np.testing.assert_allclose(background.signature, b1, atol=1e-5)
    np.testing.assert_allclose(background.gain, gain_background(scans, b1, *WINDOWS), rtol=1e-4)
    for gain, image in zip(tool.gains, scans, strict=True):
        np.testing.assert_allclose(gain, scan_gain(image)[..., 0, 0], rtol=1e-6)
        want = remove_background(image, background.signature, background.gain)
        np.testing.assert_allclose(
            background.magnitude(image, gain), np.abs(want), rtol=1e-4, atol=1e-5
        )
        np.testing.assert_allclose(background.own_coherent(image, gain), want, rtol=1e-4, atol=1e-5)


def test_the_shared_branch_is_its_definition(scans):
    tool, background = estimate(scans)
    for b in range(2):
        common = [
            np.sqrt(np.mean([wang2007.r_k(image[p, b]) ** 2 for p in range(3)])) for image in scans
        ]
        for p in range(3):
            clipped = [
                wang2007.clipped(image[p, b]) / r for image, r in zip(scans, common, strict=True)
            ]
            np.testing.assert_allclose(
                background.shared_signature[p, b], np.mean(clipped, axis=0), atol=1e-5
            )
    cleaned = background.coherent(scans[2], tool.gains[2])
    r = np.sqrt(np.mean(tool.gains[2] ** 2, axis=0))[None, :, None, None]
    want = (scans[2] / r - background.shared_signature) / background.shared_gain
    np.testing.assert_allclose(cleaned, want, rtol=1e-4, atol=1e-5)


def test_the_shared_branch_keeps_the_ratio_of_the_polarizations_and_the_own_one_does_not(scans):
    gain = np.array([3.0, 0.5, 7.0])[:, None, None, None].astype(np.float32)
    without = [image * 0 + image for image in scans]
    changed = [gain * image for image in scans]
    (tool, a), (louder, b) = estimate(without), estimate(changed)
    first = a.coherent(scans[1], tool.gains[1])
    second = b.coherent(changed[1], louder.gains[1])
    ratio = (second / first)[:, :, 20, 20]
    # Not exact: with other weights among the polarizations the scans weigh a little differently in
    # B1.
    np.testing.assert_allclose(ratio / ratio[:1], gain[:, :, 0, 0] / 3 * np.ones(2), rtol=0.05)
    own = a.magnitude(scans[1], tool.gains[1]), b.magnitude(changed[1], louder.gains[1])
    np.testing.assert_allclose(own[1], own[0], rtol=1e-3, atol=1e-4)


def test_every_third_median_changes_the_gain_background_little():
    # A run's own sizes: 21 and 51 pixels, speckle smoothed to the resolution, a level that falls
    # with range.
    rng = np.random.default_rng(3)
    shape = (1, 1, 150, 120)
    level = (1 + np.linspace(0, 4, shape[2]))[:, None]
    noise = [level * (rng.normal(size=shape) + 1j * rng.normal(size=shape)) for _ in range(4)]
    scans = [
        (one + np.roll(one, 1, -1) + np.roll(one, 1, -2)).astype(np.complex64) for one in noise
    ]
    results = []
    for step in (1, 3):
        tool = BackgroundEstimator(step=step)
        for add in (tool.add_signature, tool.add_gain):
            for image in scans:
                add(image)
        results.append(tool.result().gain)
    assert np.abs(results[1] / results[0] - 1).max() < 0.02


def test_cropping_keeps_the_nearest_rows(scans):
    tool, background = estimate(scans)
    near = background.cropped(25)
    part = np.ascontiguousarray(scans[3][..., :25, :])
    for name in ("magnitude", "coherent", "own_coherent"):
        whole = getattr(background, name)(scans[3], tool.gains[3])
        np.testing.assert_array_equal(getattr(near, name)(part, tool.gains[3]), whole[..., :25, :])


@pytest.mark.parametrize("method", ["mean", "median"])
def test_the_background_of_the_nearest_rows_has_the_bits_of_the_whole(scans, method):
    """Gains are those of whole images; the second pass need not see the rest."""
    rows = 20
    reach = 20 + WINDOWS[0][0] // 2 + WINDOWS[1][0] // 2
    whole = BackgroundEstimator(*WINDOWS, 2, method)
    near = BackgroundEstimator(*WINDOWS, 2, method, reach)
    for tool, seen in ((whole, SHAPE[2]), (near, reach)):
        for image in scans:
            tool.add_signature(image)
        for image in scans:
            tool.add_gain(image[..., :seen, :])
    np.testing.assert_array_equal(near.gains, whole.gains)
    for name, value in vars(whole.result().cropped(rows)).items():
        np.testing.assert_array_equal(getattr(near.result().cropped(rows), name), value)


@pytest.mark.parametrize("power", [-100, 80])
def test_the_background_does_not_hang_on_the_unit_of_the_data(scans, power):
    plain, background = estimate(scans)
    other, same = estimate([image * np.float32(2.0) ** power for image in scans])
    np.testing.assert_array_equal(np.stack(other.gains), np.stack(plain.gains) * 2.0**power)
    for name, value in vars(background).items():
        np.testing.assert_array_equal(getattr(same, name), value)


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda s: BackgroundEstimator((4, 5)), "odd"),
        (lambda s: BackgroundEstimator(step=0), "step"),
        (lambda s: estimate(s[:1]), "two scans"),
        (lambda s: estimate([s[0], s[1][..., :-1]]), "shape"),
        (lambda s: estimate([s[0], 0 * s[1]]), "gain"),
        (lambda s: estimate(s)[0].add_gain(s[0]), "once per scan"),
    ],
)
def test_bad_input(scans, call, words):
    with pytest.raises(ValueError, match=words):
        call(scans)


@pytest.mark.parametrize("step", [1, 2, 3, 4])
@pytest.mark.parametrize("plane", [(40, 34), (9, 31)])
def test_spreading_out_is_the_mean_over_the_pixels_that_were_looked_at(step, plane):
    coarse = np.random.default_rng(4).uniform(1, 2, (2, -(-plane[0] // step), -(-plane[1] // step)))
    level = mean_filtered(coarse, (1, 2, *plane), WINDOWS[1], step)[0]
    for y, x in ((0, 0), (5, 7), (plane[0] - 1, plane[1] - 1), (plane[0] // 2, 3)):
        near = [
            coarse[:, v // step, u // step]
            for v in range(max(y - 5, 0), min(y + 6, plane[0]))
            for u in range(max(x - 4, 0), min(x + 5, plane[1]))
            if v % step == 0 and u % step == 0
        ]
        np.testing.assert_allclose(level[:, y, x], np.mean(near, axis=0), rtol=1e-6)
