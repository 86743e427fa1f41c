"""Likelihood maps against the score of every pixel's chip."""

import numpy as np
import pytest

from flgpr.detect import (
    ChipDetector,
    DeflectionDetector,
    NeymanPearsonDetector,
    PolarimetricWhiteningFilter,
    deflection_form,
)
from reference.cosgrove2004 import circular, likelihood_map


@pytest.fixture
def rng():
    return np.random.default_rng(7)


def draw(rng, *shape):
    return rng.normal(size=shape) + 1j * rng.normal(size=shape)


def trained(rng, channels, shape, detector):
    features = channels * shape[0] * shape[1]
    form = detector.fit(draw(rng, 5, features)).forms_[0]
    return form.after(draw(rng, features), draw(rng, features, features) / features)


@pytest.mark.parametrize(
    ("channels", "shape"), [(2, (7, 1)), (1, (6, 1)), (3, (5, 4)), (2, (1, 1)), (1, (1, 3))]
)
@pytest.mark.parametrize(
    "detector", [DeflectionDetector(2), NeymanPearsonDetector(3), DeflectionDetector(0)]
)
def test_map_is_the_score_of_every_chip(rng, channels, shape, detector):
    form = trained(rng, channels, shape, detector)
    image = draw(rng, channels, 23, 9).astype(np.complex64)
    found = form.likelihood(image, shape)
    expected = likelihood_map(image, shape, lambda cut: form(cut[None])[0])
    assert np.array_equal(np.isnan(found), np.isnan(expected))
    assert np.allclose(
        found, expected, rtol=1e-4, atol=1e-4 * np.nanmax(np.abs(expected)), equal_nan=True
    )


def test_pixels_that_were_not_imaged_leave_holes(rng):
    form = trained(rng, 2, (5, 3), DeflectionDetector())
    image = draw(rng, 2, 20, 12).astype(np.complex64)
    image[0, 8, 4] = np.nan
    image[:, 15:, :2] = np.nan
    found = form.likelihood(image, (5, 3))
    expected = likelihood_map(image, (5, 3), lambda cut: form(cut[None])[0])
    assert np.array_equal(np.isnan(found), np.isnan(expected))
    assert np.allclose(
        found, expected, rtol=1e-3, atol=1e-3 * np.nanmax(np.abs(expected)), equal_nan=True
    )


def test_image_smaller_than_a_chip_gives_no_score(rng):
    form = trained(rng, 1, (9, 1), DeflectionDetector())
    assert np.isnan(form.likelihood(draw(rng, 1, 5, 4), (9, 1))).all()
    with pytest.raises(ValueError, match="9 features"):
        form.likelihood(draw(rng, 2, 20, 4), (9, 1))


def test_polarimetric_whitening_maps_pixel_by_pixel(rng):
    X = draw(rng, 300, 2)
    found = PolarimetricWhiteningFilter().fit(X)
    image = draw(rng, 2, 6, 5)
    expected = found.decision_function(image.reshape(2, -1).T).reshape(6, 5)
    assert np.allclose(found.forms_[0].likelihood(image, (1, 1)), expected, rtol=1e-4)


def chip_detector(rng, count=1):
    forms = tuple(
        deflection_form(draw(rng, 8), np.diag(rng.uniform(size=8)), rank=3).after(
            draw(rng, 8), draw(rng, 8, 8)
        )
        for _ in range(count)
    )
    return ChipDetector(forms, ("HH", "VV"), (4, 1), (0.02, 0.05), {"site": "one", "depths": [0.1]})


def test_several_forms_score_by_the_largest(rng):
    detector = chip_detector(rng, 3)
    image = draw(rng, 2, 12, 5)
    each = [form.likelihood(image, (4, 1)) for form in detector.forms]
    assert np.array_equal(detector.likelihood(image), np.max(each, axis=0), equal_nan=True)


def test_detector_refuses_other_images(rng):
    detector = chip_detector(rng)
    image = draw(rng, 2, 12, 5)
    with pytest.raises(ValueError, match="channels"):
        detector.likelihood(image, channels=("VV", "HH"))
    with pytest.raises(ValueError, match="spacing"):
        detector.likelihood(image, spacing=(0.05, 0.05))
    detector.likelihood(image, channels=("HH", "VV"), spacing=(0.02, 0.1))
    with pytest.raises(ValueError, match="16 features"):
        ChipDetector(detector.forms, ("HH", "VV"), (8, 1), (0.02, 0.05))


def test_clutter_gives_a_false_alarm_rate_that_theory_tells(rng):
    """With rank one and no linear part the score on white clutter is exponential."""
    form = deflection_form(np.zeros(4), np.diag([3.0, 0, 0, 0]), rank=1)
    clutter = circular(rng, np.zeros(1), np.eye(1), 40_000).reshape(1, -1, 1)
    score = form.likelihood(clutter, (4, 1))
    share = np.nanmean(score > 3 * np.log(10))
    assert abs(share - 0.1) < 4 * np.sqrt(0.1 * 0.9 / 10_000)
