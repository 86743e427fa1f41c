"""The brightest points of a focused image, and how wide they are."""

from __future__ import annotations

import math

import numpy as np
import pandas as pd
import xarray as xr
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter

from flgpr.calibrate.clock import brightest_points
from flgpr.model import SPEED_OF_LIGHT


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
    grid = np.stack(np.meshgrid(*axes.values(), indexing="ij")[::-1], axis=-1)
    middle = float(np.median(level))
    top = float(level.max())
    rows: list[dict[str, float]] = []
    if top == 0:
        return pd.DataFrame(columns=["x", "y", "z", "level", "over_median"])
    band = image.attrs["band_hz"]
    apart = SPEED_OF_LIGHT / max(band[1] - band[0], band[1] / 4)
    maxima = np.where(maximum_filter(level, 3) == level, level, 0.0)
    for x, y, z, value in brightest_points(maxima, grid, count, apart):
        if value == 0:
            break
        row = {"x": x, "y": y, "z": z, "level": 20 * math.log10(value / top)}
        row["over_median"] = 20 * math.log10(value / middle) if middle > 0 else math.inf
        place = tuple(
            int(np.argmin(np.abs(axes[axis] - at)))
            for axis, at in zip("zyx", (z, y, x), strict=True)
        )
        for number, (axis, values) in reversed(list(enumerate(axes.items()))):
            if values.size > 1:
                line = level[
                    tuple(slice(None) if k == number else one for k, one in enumerate(place))
                ]
                row[f"width_{axis}"] = _width(values, line, place[number])
        rows.append(row)
    return pd.DataFrame(rows)


def _width(axis: NDArray[np.float64], line: NDArray[np.float64], top: int) -> float:
    """Width of a peak at half its power, m, between pixels; NaN where it does not fall so far."""
    half = line[top] / math.sqrt(2)
    ends = []
    for step in (-1, 1):
        k = top
        while 0 <= k + step < line.size and line[k + step] > half:
            k += step
        if not 0 <= k + step < line.size:
            return math.nan
        part = (line[k] - half) / (line[k] - line[k + step])
        ends.append(axis[k] + part * (axis[k + step] - axis[k]))
    return float(ends[1] - ends[0])
