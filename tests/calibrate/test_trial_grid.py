"""The pixels and the offsets of the trials of a calibration."""

import numpy as np
import pytest

from flgpr.calibrate.trial_grid import offsets_to_try, pixels_of_area

FREQUENCY = np.array([1e9, 1.5e9])


def test_pixels_cover_the_area_to_its_last_row():
    pixels = pixels_of_area(FREQUENCY, (-1.0, 1.0, 2.0, 3.0), 0.2, 0.5)
    assert pixels.shape == (3, 5, 3)
    np.testing.assert_allclose(pixels[0, 0], [-1.0, 2.0, 0.2])
    np.testing.assert_allclose(pixels[-1, -1], [1.0, 3.0, 0.2])


def test_pixels_lie_a_quarter_of_the_shortest_wavelength_apart():
    pixels = pixels_of_area(FREQUENCY, (0.0, 1.0, 0.0, 1.0), 0.0)
    assert pixels[0, 1, 0] - pixels[0, 0, 0] == pytest.approx(299792458 / 1.5e9 / 4)


def test_an_area_that_is_empty_or_too_large_is_refused():
    with pytest.raises(ValueError, match="area must have x_max > x_min"):
        pixels_of_area(FREQUENCY, (1.0, 1.0, 0.0, 1.0), 0.0)
    with pytest.raises(ValueError, match="area must hold at most 2,000,000 pixels"):
        pixels_of_area(FREQUENCY, (0.0, 100.0, 0.0, 100.0), 0.0, 0.05)


def test_offsets_reach_the_last_one():
    np.testing.assert_allclose(offsets_to_try((3.2, 3.6), 0.1), [3.2, 3.3, 3.4, 3.5, 3.6])
    np.testing.assert_allclose(offsets_to_try((3.2, 3.2), 0.1), [3.2])


@pytest.mark.parametrize(
    ("limits", "step", "message"),
    [
        ((1.0, 0.0), 0.1, "offsets must increase and step be positive"),
        ((0.0, 1.0), 0.0, "offsets must increase and step be positive"),
        ((0.0, np.inf), 0.1, "offsets must increase and step be positive"),
        ((0.0, 1.0), 1e-5, "offsets must be at most 10,000"),
        ((4.0, 7.0), 10.0, "step must not be wider than the offsets, 4 to 7 s, got 10 s"),
    ],
)
def test_offsets_that_cannot_be_tried_are_refused(limits, step, message):
    with pytest.raises(ValueError, match=message):
        offsets_to_try(limits, step)
