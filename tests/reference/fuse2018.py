"""Fuse et al. 2018, Eq. 1, 2 and 5, term by term in double precision."""

import numpy as np

C = 299792458.0


def equation_2_path(tx, rx, pixels):
    return np.linalg.norm(pixels - tx, axis=-1) + np.linalg.norm(pixels - rx, axis=-1)


def equation_1_image(b, frequency, tx, rx, pixels, weight=None):
    """Image (pixel,) of data (pair, frequency)."""
    weight = np.ones(len(frequency)) if weight is None else weight
    x = np.zeros(len(pixels), complex)
    for n in range(len(tx)):
        path = equation_2_path(tx[n], rx[n], pixels)
        for k, f in enumerate(frequency):
            x += weight[k] * b[n, k] * np.exp(2j * np.pi * f * path / C)
    return x


def equation_5_data(x, frequency, tx, rx, pixels, weight=None):
    """Data (pair, frequency) of an image (pixel,)."""
    weight = np.ones(len(frequency)) if weight is None else weight
    b = np.zeros((len(tx), len(frequency)), complex)
    for n in range(len(tx)):
        path = equation_2_path(tx[n], rx[n], pixels)
        for k, f in enumerate(frequency):
            b[n, k] = weight[k] * np.sum(x * np.exp(-2j * np.pi * f * path / C))
    return b
