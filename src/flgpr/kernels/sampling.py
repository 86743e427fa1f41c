"""Bilinear sampling of images between their pixel centres."""

from __future__ import annotations

from typing import Any

import numpy as np

from flgpr.jit.compiled import njit
from flgpr.types import AnyArray, FloatArray


def bilinear(images: AnyArray, row: FloatArray, column: FloatArray) -> AnyArray:
    """Return images at fractional pixels, interpolated between the four pixels about each.

    Parameters
    ----------
    images : (..., y, x) ndarray
        Images of one size; real or complex numbers.
    row, column : array of float
        Fractional pixel numbers along y and x, 0 at the centre of the first pixel; they are
        broadcast against each other.

    Returns
    -------
    (..., points) ndarray
        Values of the images' type, in the shape of the broadcast points; NaN outside the outermost
        pixel centres.
    """
    row, column = np.broadcast_arrays(row, column)
    flat = np.ascontiguousarray(images).reshape(-1, *images.shape[-2:])
    out = np.empty((len(flat), row.size), images.dtype)
    _sample(flat, row.ravel().astype(np.float64), column.ravel().astype(np.float64), out)
    return out.reshape(*images.shape[:-2], *row.shape)


@njit(nogil=True, cache=True)
def _sample(images: Any, row: Any, column: Any, out: Any) -> None:
    """Fill ``out`` (image, point) by bilinear interpolation; NaN outside an image."""
    ny, nx = images.shape[1:]
    for i in range(row.size):
        # Rounding puts points on the outermost centres a little outside them.
        inside = (
            (row[i] >= -1e-9)
            & (row[i] <= ny - 1 + 1e-9)
            & (column[i] >= -1e-9)
            & (column[i] <= nx - 1 + 1e-9)
        )
        if not inside:
            out[:, i] = np.nan
            continue
        r = min(max(row[i], 0.0), ny - 1.0)
        c = min(max(column[i], 0.0), nx - 1.0)
        # The second pixel must exist, also for a point on the last one, and in an image of one row.
        r0 = min(int(r), max(ny - 2, 0))
        c0 = min(int(c), max(nx - 2, 0))
        r1 = min(r0 + 1, ny - 1)
        c1 = min(c0 + 1, nx - 1)
        fr = np.float32(r - r0)
        fc = np.float32(c - c0)
        gr = np.float32(1) - fr
        gc = np.float32(1) - fc
        for k in range(images.shape[0]):
            top = images[k, r0, c0] * gc + images[k, r0, c1] * fc
            bottom = images[k, r1, c0] * gc + images[k, r1, c1] * fc
            out[k, i] = top * gr + bottom * fr
