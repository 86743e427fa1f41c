import numpy as np
import pytest

from flgpr.clutter import gain_background, remove_background, scan_gain, self_signature
from reference import wang2007


@pytest.fixture
def scans():
    rng = np.random.default_rng(7)
    fixed = rng.normal(size=(30, 24)) + 1j * rng.normal(size=(30, 24))
    images = []
    for k in range(4):
        image = fixed + 0.3 * (rng.normal(size=fixed.shape) + 1j * rng.normal(size=fixed.shape))
        image[5 * k + 3, 12] += 40  # a target that moves through the scan frame
        images.append(((0.5 + k) * image).astype(np.complex64))
    return images


def test_gain_is_the_rms_of_the_lowest_three_quarters(scans):
    for image in scans:
        assert scan_gain(image).item() == pytest.approx(wang2007.r_k(image), rel=1e-6)


def test_self_signature_is_equation_2(scans):
    np.testing.assert_allclose(
        self_signature(scans), wang2007.equation_2_self_signature(scans), atol=2e-6
    )


def test_clipping_lowers_what_a_bright_target_leaves_in_the_self_signature(scans):
    plain = np.mean([image / wang2007.r_k(image) for image in scans], axis=0)
    assert abs(self_signature(scans)[3, 12]) < 0.7 * abs(plain[3, 12])


def test_median_ignores_a_target_that_passes_through(scans):
    without = [image.copy() for image in scans]
    for k, image in enumerate(without):
        image[5 * k + 3, 12] = image[29, 0]
    with_target = self_signature(scans, "median")
    neighbours = np.abs(self_signature(without, "median"))
    assert np.abs(with_target[3::5, 12]).max() < 1.5 * neighbours.max()
    assert not self_signature(scans, "none").any()


def test_gain_background_is_equation_4_and_removal_equation_5(scans):
    b1 = self_signature(scans)
    b2 = gain_background(scans, b1, (5, 5), (9, 7))
    want = wang2007.equation_4_gain_background(scans, b1, (5, 5), (9, 7))
    np.testing.assert_allclose(b2, want, rtol=1e-5)
    for image in scans:
        got = np.abs(remove_background(image, b1, b2))
        np.testing.assert_allclose(
            got, wang2007.equation_5_magnitude(image, b1, b2), rtol=2e-5, atol=1e-5
        )


def test_channels_do_not_mix(scans):
    other = [2 * image[::-1] for image in scans]
    both = [np.stack([a, b]) for a, b in zip(scans, other, strict=True)]
    np.testing.assert_allclose(self_signature(both)[0], self_signature(scans), atol=1e-6)
    np.testing.assert_allclose(self_signature(both)[1], self_signature(other), atol=1e-6)


def test_calibration_gain_cancels(scans):
    louder = [100 * image for image in scans]
    b1 = self_signature(scans)
    b1_louder = self_signature(louder)
    np.testing.assert_allclose(b1_louder, b1, atol=1e-5)
    cleaned = [
        remove_background(s, b, gain_background(s_all, b, (5, 5), (9, 9)))
        for s, b, s_all in ((scans[1], b1, scans), (louder[1], b1_louder, louder))
    ]
    np.testing.assert_allclose(cleaned[1], cleaned[0], rtol=1e-3, atol=1e-4)


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda s: self_signature(s, "mode"), "none, mean or median"),
        (lambda _: self_signature([]), "at least one scan"),
        (lambda s: gain_background(s, np.zeros_like(s[0]), (4, 5)), "odd"),
        (lambda s: scan_gain(np.zeros_like(s[0])), "gain"),
        (lambda s: self_signature(s[:1], "median"), "two scans"),
        (lambda s: gain_background([1j * np.ones((9, 9))], 1j * np.ones((9, 9))), "zero"),
    ],
)
def test_bad_input(scans, call, words):
    with pytest.raises(ValueError, match=words):
        call(scans)
