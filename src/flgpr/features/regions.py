"""Statistics of the regions of patches about alarms (Wang et al. 2007, Eq. 6-8)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from flgpr.features.patch import PatchShape
from flgpr.kernels.patches import INNER, OUTER, region_statistics
from flgpr.types import Float32Array, FloatArray


def patch_statistics(
    shape: PatchShape,
    magnitude: Float32Array,
    row: FloatArray,
    column: FloatArray,
    spacing: float,
) -> FloatArray:
    """Compute the statistics of the regions of patches in images.

    Parameters
    ----------
    shape : PatchShape
        Size and regions of the patches.
    magnitude : (channel, y, x) ndarray of float32
        Images.
    row, column : (patch,) ndarray
        Centres of the patches, in pixels of the images.
    spacing : float
        Pixel spacing of the images, m.

    Returns
    -------
    (patch, channel, 4) ndarray
        At the positions PEAK, MEAN, OUTER_MEAN and OUTER_STD of :mod:`flgpr.kernels.patches`; NaN
        where the images do not hold the region.
    """
    out = np.empty((row.size, len(magnitude), 1, 4))
    offset = (np.arange(shape.size) - shape.size // 2) * shape.spacing / spacing
    images = np.ascontiguousarray(magnitude)
    region_statistics(images, row, column, offset, region_codes(shape)[None], out)
    return out[:, :, 0]


def region_codes(shape: PatchShape) -> NDArray[np.int8]:
    """Return the code of every pixel's region (y, x), as :func:`region_statistics` takes them."""
    codes = np.where(shape.region(shape.guard), 0, OUTER)
    return np.where(shape.region(shape.inner), INNER, codes).astype(np.int8)
