"""An image less what earlier images of the same ground predict."""

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from flgpr.clutter import moved, offset_between, predicted

SHAPE = (80, 90)


def speckle(seed, width=2.0):
    """Draw a complex field of mean square one that is correlated over some pixels."""
    rng = np.random.default_rng(seed)
    white = rng.normal(size=SHAPE) + 1j * rng.normal(size=SHAPE)
    field = gaussian_filter(white.real, width) + 1j * gaussian_filter(white.imag, width)
    return (field / np.sqrt(np.mean(np.abs(field) ** 2))).astype(np.complex64)


def power(image):
    """Return the mean square in dB, away from the border."""
    return 10 * np.log10(np.mean(np.abs(image[8:-8, 8:-8]) ** 2))


@pytest.mark.parametrize(("rows", "columns"), [(0, 0), (3, -5), (-4, 2)])
def test_offset_is_what_the_earlier_image_was_moved_by(rows, columns):
    ground = speckle(1)
    earlier = moved(ground, -rows, -columns)
    found = offset_between(ground[None], earlier[None] * 0.3j, (6, 6))
    assert found == (rows, columns)


def test_offset_is_looked_for_no_farther_than_asked():
    ground = speckle(1)
    rows, columns = offset_between(ground[None], moved(ground, -5, 0)[None], (2, 2))
    assert max(abs(rows), abs(columns)) <= 2


def test_same_ground_is_predicted_whatever_its_gain_and_a_part_of_a_pixel():
    ground = speckle(2)
    gain = 1.4 * np.exp(1j * np.linspace(0, 1, SHAPE[0]))[:, None]  # slowly along the road
    half_a_pixel = (ground + moved(ground, 0, 1)) / 2
    left = gain * half_a_pixel - predicted(gain * half_a_pixel, [ground], (40, 40))
    assert power(left) < power(gain * half_a_pixel) - 20


def test_what_is_new_stays():
    ground = speckle(3)
    new = np.zeros(SHAPE, np.complex64)
    new[40, 45] = 30
    new = gaussian_filter(new.real, 2.0).astype(np.complex64)
    left = ground + new - predicted(ground + new, [ground], (40, 40))
    at_it = np.abs(left[40, 45]) / np.abs(new[40, 45])
    assert 0.8 < at_it < 1.1
    away = np.abs(left)
    away[30:51, 35:56] = 0
    assert away.max() < 0.3 * np.abs(left[40, 45])


def test_other_ground_is_hardly_predicted():
    ground = speckle(4)
    left = ground - predicted(ground, [speckle(5)], (40, 40))
    assert power(left) > power(ground) - 2


def test_two_drives_predict_better_than_one_where_each_has_noise():
    ground = speckle(6)
    drives = [ground + 0.3 * speckle(seed, 0.5) for seed in (7, 8)]
    one = ground - predicted(ground, drives[:1], (40, 40))
    both = ground - predicted(ground, drives, (40, 40))
    assert power(both) < power(one) - 1


def test_ground_that_no_drive_saw_stays_as_it_is():
    ground = speckle(9)
    assert not predicted(ground, [np.zeros(SHAPE, np.complex64)], (40, 40)).any()


def test_stretch_with_too_few_pixels_is_refused():
    with pytest.raises(
        ValueError, match=r"stretch must hold 18 fitted pixels for 9 copies .* got 4"
    ):
        predicted(speckle(1), [speckle(2)], (4, 4))
