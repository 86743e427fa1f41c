"""Bilinear sampling of images between their pixel centres."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray


def bilinear(images: NDArray[Any], row: NDArray[np.float64], column: NDArray[np.float64]) -> NDArray[Any]:
    """Sample images (..., y, x) at fractional pixels of any shape; NaN outside the outermost pixel centres."""
    ny, nx = images.shape[-2:]
    inside = (row >= -1e-9) & (row <= ny - 1 + 1e-9) & (column >= -1e-9) & (column <= nx - 1 + 1e-9)
    r = np.clip(row, 0, ny - 1)
    c = np.clip(column, 0, nx - 1)
    r0 = np.minimum(r.astype(np.intp), max(ny - 2, 0))
    c0 = np.minimum(c.astype(np.intp), max(nx - 2, 0))
    r1, c1 = np.minimum(r0 + 1, ny - 1), np.minimum(c0 + 1, nx - 1)
    fr, fc = (r - r0).astype(np.float32), (c - c0).astype(np.float32)
    top = images[..., r0, c0] * (1 - fc) + images[..., r0, c1] * fc
    bottom = images[..., r1, c0] * (1 - fc) + images[..., r1, c1] * fc
    return np.where(inside, top * (1 - fr) + bottom * fr, np.nan).astype(images.dtype)
