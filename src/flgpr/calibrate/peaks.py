"""The brightest points of a focused image, and how wide they are."""

from __future__ import annotations

import math

import numpy as np
import pandas as pd
import xarray as xr
from scipy.ndimage import maximum_filter

from flgpr.calibrate.clock import brightest_points
from flgpr.kernels.widths import half_power
from flgpr.model import SPEED_OF_LIGHT
from flgpr.types import FloatArray


def image_peaks(image: xr.DataArray, count: int) -> pd.DataFrame:
    """Return the brightest local maxima of the first polarization of a focused image.

    Parameters
    ----------
    image : xarray.DataArray
        Image (polarization, z, y, x) with the attribute ``band_hz``.
    count : int
        Most points, which lie apart by more than the range resolution.

    Returns
    -------
    pandas.DataFrame
        Brightest first: x, y, z (m), level (dB re the first), over_median (dB), and the width at
        -3 dB along every axis that is imaged, m; NaN where it does not fall so far.
    """
    level = np.abs(image.values[0]).astype(np.float64)
    axes = {axis: image[axis].values for axis in ("z", "y", "x")}
    pixels = np.stack(np.meshgrid(*axes.values(), indexing="ij")[::-1], axis=-1)
    top = float(level.max())
    if top == 0:
        return pd.DataFrame(columns=["x", "y", "z", "level", "over_median"])
    median = float(np.median(level[level > 0]))  # of the pixels that were imaged

    band = image.attrs["band_hz"]
    # Twice the range resolution c/2B; of a narrow band that of a quarter of its highest tone.
    apart = SPEED_OF_LIGHT / max(band[1] - band[0], band[1] / 4)
    is_maximum = maximum_filter(level, 3) == level
    maxima = np.where(is_maximum, level, 0.0)
    rows: list[dict[str, float]] = []
    for x, y, z, value in brightest_points(maxima, pixels, count, apart):
        if value == 0 or (rows and value < median):  # no bright point
            break
        row = {"x": x, "y": y, "z": z, "level": 20 * math.log10(value / top)}
        row["over_median"] = 20 * math.log10(value / median) if median > 0 else math.inf
        rows.append(row | _widths(level, axes, {"x": x, "y": y, "z": z}))
    return pd.DataFrame(rows)


def _widths(
    level: FloatArray, axes: dict[str, FloatArray], peak: dict[str, float]
) -> dict[str, float]:
    """Return the widths of a peak, m, as columns, along every axis of more than one pixel."""
    pixel = {}
    for axis, values in axes.items():
        pixel[axis] = int(np.argmin(np.abs(values - peak[axis])))
    widths = {}
    for axis in ("x", "y", "z"):
        if axes[axis].size > 1:
            through_peak: dict[str, int | slice] = {**pixel, axis: slice(None)}
            line = level[tuple(through_peak.values())]
            widths[f"width_{axis}"] = half_power(axes[axis], line / line[pixel[axis]], pixel[axis])
    return widths
