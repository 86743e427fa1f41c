"""The scan at which imaging is timed, and the sums that are its truth."""

import numpy as np
import pytest

from flgpr.model import SPEED_OF_LIGHT
from imaging_speed import cases


def test_the_scan_is_that_of_the_sensor():
    scan = cases.sri_scan()
    assert scan.data.shape == (3, 36, 1024)
    assert np.ptp(scan.frequency) == pytest.approx(1023 * 2.5e6)
    assert len(scan.pixels) == 91_200


def test_the_scan_is_the_same_each_time(few_pixels):
    first = cases.sri_scan()
    second = cases.sri_scan()
    np.testing.assert_array_equal(first.data, second.data)
    np.testing.assert_array_equal(first.image, second.image)
    depth = first.pixels[:, 2] - first.buried_pixels()[:, 2]
    np.testing.assert_allclose(depth, cases.BURIAL)


def test_sums_are_those_of_the_matched_filter(few_pixels):
    """One channel of the scan, summed by hand over pairs and tones at one pixel."""
    scan = cases.sri_scan()
    exact = cases.direct_sums(scan)
    assert exact.images.shape[-1] == exact.pixel.size == 40
    assert exact.tone.size == 11
    at = 7
    point = scan.pixels[exact.pixel[at]]
    path = np.linalg.norm(scan.tx - point, axis=1) + np.linalg.norm(scan.rx - point, axis=1)
    phase = np.exp(2j * np.pi * np.outer(path, scan.frequency) / SPEED_OF_LIGHT)
    expected = (scan.data[0] * phase).sum()
    assert exact.channel[0, 0, at] == pytest.approx(expected, rel=1e-6)
