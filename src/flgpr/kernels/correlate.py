"""Correlation of images with a bank of small filters."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.fft import fft, fft2, ifft, ifft2, next_fast_len

WORKERS = 2


def correlate_bank(image: NDArray[Any], bank: NDArray[Any]) -> NDArray[Any]:
    """Correlate all channels of an image with every filter and sum over channels.

    ``image`` (channel, y, x), ``bank`` (filter, channel, v, u); returns (filter, y - v + 1, x - u +
    1) with ``out[j, y, x] = Σ conj(bank[j, c, v, u]) image[c, y + v, x + u]``. Filters one pixel
    wide, the range cuts of Cosgrove et al. 2004, are transformed along y only.
    """
    rows = image.shape[1] - bank.shape[2] + 1
    columns = image.shape[2] - bank.shape[3] + 1
    size = next_fast_len(image.shape[1])
    if bank.shape[3] == 1:
        spectrum = fft(image, size, axis=1, workers=WORKERS)
        filters = fft(bank[..., 0], size, axis=2).conj()
        product = np.einsum("jcy,cyx->jyx", filters, spectrum)
        return ifft(product, axis=1, workers=WORKERS, overwrite_x=True)[:, :rows]
    shape = (size, next_fast_len(image.shape[2]))
    spectrum = fft2(image, shape, workers=WORKERS)
    product = np.einsum("jcyx,cyx->jyx", fft2(bank, shape).conj(), spectrum)
    return ifft2(product, workers=WORKERS, overwrite_x=True)[:, :rows, :columns]


def chips(image: NDArray[Any], shape: tuple[int, int]) -> NDArray[Any]:
    """Return a view of every chip of ``image`` (channel, y, x).

    It is (y - v + 1, x - u + 1, channel, v, u); nothing is copied.
    """
    windows = np.lib.stride_tricks.sliding_window_view(image, shape, axis=(1, 2))
    return np.moveaxis(windows, 0, 2)
