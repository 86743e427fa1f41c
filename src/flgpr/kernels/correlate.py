"""Correlation of images with a bank of small filters."""

from __future__ import annotations

import numpy as np
from scipy.fft import fft, fft2, ifft, ifft2, next_fast_len

from flgpr.types import AnyArray

WORKERS = 2


def correlate_bank(image: AnyArray, bank: AnyArray) -> AnyArray:
    """Correlate all channels of an image with every filter and sum over channels.

    The result is ``out[j, y, x] = Σ conj(bank[j, c, v, u]) image[c, y + v, x + u]``, where the
    filter lies inside the image. Filters one pixel wide, the range cuts of Cosgrove et al. 2004,
    are transformed along y only.

    Parameters
    ----------
    image : (channel, y, x) ndarray
        Image.
    bank : (filter, channel, v, u) ndarray
        Filters, not larger than the image.

    Returns
    -------
    (filter, y - v + 1, x - u + 1) ndarray
        Correlation, complex.
    """
    rows = image.shape[1] - bank.shape[2] + 1
    columns = image.shape[2] - bank.shape[3] + 1
    # Not padded by the filter's length: the wrapped values lie beyond ``rows`` and ``columns``.
    size = next_fast_len(image.shape[1])

    if bank.shape[3] == 1:
        spectrum = fft(image, size, axis=1, workers=WORKERS)
        filters = fft(bank[..., 0], size, axis=2).conj()
        product = np.einsum("jcy,cyx->jyx", filters, spectrum)
        correlation = ifft(product, axis=1, workers=WORKERS, overwrite_x=True)
        return correlation[:, :rows]

    shape = (size, next_fast_len(image.shape[2]))
    spectrum = fft2(image, shape, workers=WORKERS)
    filters = fft2(bank, shape).conj()
    product = np.einsum("jcyx,cyx->jyx", filters, spectrum)
    correlation = ifft2(product, workers=WORKERS, overwrite_x=True)
    return correlation[:, :rows, :columns]


def chips(image: AnyArray, shape: tuple[int, int]) -> AnyArray:
    """Return a view of every chip of an image; nothing is copied.

    Parameters
    ----------
    image : (channel, y, x) ndarray
        Image.
    shape : tuple of int
        Size (v, u) of a chip, pixels.

    Returns
    -------
    (y - v + 1, x - u + 1, channel, v, u) ndarray
        Chips by their first pixel.
    """
    windows = np.lib.stride_tricks.sliding_window_view(image, shape, axis=(1, 2))
    return np.moveaxis(windows, 0, 2)


def chip_sums(pixels: AnyArray, shape: tuple[int, int]) -> AnyArray:
    """Sum pixels (y, x) over every chip, (y - v + 1, x - u + 1), by a summed-area table."""
    v, u = shape
    table = np.pad(pixels.cumsum(0).cumsum(1), ((1, 0), (1, 0)))
    return table[v:, u:] - table[:-v, u:] - table[v:, :-u] + table[:-v, :-u]
