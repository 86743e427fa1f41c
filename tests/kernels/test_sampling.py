"""Bilinear sampling is exact on a plane and unknown outside the pixel centres."""

import numpy as np

from flgpr.kernels.sampling import bilinear


def test_a_plane_is_sampled_exactly():
    y, x = np.mgrid[0:6, 0:9].astype(float)
    images = np.stack([2 * x - y, x + 1j * y])
    row = np.array([[0.0, 2.25], [4.5, 5.0]])
    column = np.array([[0.0, 3.5], [7.75, 8.0]])
    got = bilinear(images, row, column)
    assert got.shape == (2, 2, 2)
    np.testing.assert_allclose(got[0], 2 * column - row, atol=1e-6)
    np.testing.assert_allclose(got[1], column + 1j * row, atol=1e-6)


def test_outside_the_outermost_centres_nothing_is_known():
    image = np.ones((4, 5))
    got = bilinear(image, np.array([-0.1, 3.1, 1.0, 1.0]), np.array([1.0, 1.0, -0.1, 4.1]))
    assert np.isnan(got).all()
