"""Local contrast of alarms (Wang et al. 2007, Eq. 7)."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr
from numpy.typing import NDArray

from flgpr.features.patch import PatchShape
from flgpr.features.regions import patch_statistics
from flgpr.kernels.patches import OUTER_MEAN, OUTER_STD, PEAK
from flgpr.kernels.sampling import bilinear
from flgpr.model import Grid, ground_points, lane_to_scan


class ContrastSums:
    """Compute :func:`local_contrast` scan by scan from plain arrays.

    Parameters
    ----------
    alarms : DataFrame
        x, y in the lane frame, m.
    grid : Grid
        Pixels of the scan images.
    y_max : float
        Farthest distance ahead of the array that counts, m.
    patch : PatchShape, optional
        Patch; default the paper's.
    """

    def __init__(
        self, alarms: pd.DataFrame, grid: Grid, y_max: float, patch: PatchShape | None = None
    ) -> None:
        self._grid = grid
        self._y_max = y_max
        self._patch = patch or PatchShape()
        self._index = alarms.index
        self._centres = ground_points(alarms)
        self._weighted = np.zeros(len(alarms))
        self._weight = np.zeros(len(alarms))
        self._scans = np.zeros(len(alarms))

    def add(self, magnitude: NDArray[np.float32], pose: NDArray[np.float64]) -> None:
        """Add the cleaned magnitudes (y, x) of the channel in one scan, and its pose (6,)."""
        grid = self._grid
        local = lane_to_scan(self._centres, pose)
        in_reach = np.flatnonzero(local[:, 1] <= self._y_max)
        if not in_reach.size:
            return
        row = (local[in_reach, 1] - grid.y_min) / grid.dy
        column = (local[in_reach, 0] - grid.x_min) / grid.dx
        statistics = patch_statistics(self._patch, magnitude[None], row, column, grid.dx)[:, 0]
        known = np.isfinite(statistics[:, PEAK]) & (statistics[:, OUTER_STD] > 0)
        alarm = in_reach[known]
        peak = statistics[known, PEAK]
        mean = statistics[known, OUTER_MEAN]
        deviation = statistics[known, OUTER_STD]
        self._weighted[alarm] += peak * (peak - mean) / deviation
        self._weight[alarm] += peak
        self._scans[alarm] += 1

    def state(self) -> dict[str, NDArray[Any]]:
        """Return the sums for :meth:`merge`: ``row``, the alarms with a scan, and their sums."""
        row = np.flatnonzero(self._scans)
        return {
            "row": row,
            "weighted": self._weighted[row],
            "weight": self._weight[row],
            "scans": self._scans[row],
        }

    def merge(self, state: Mapping[str, NDArray[Any]]) -> None:
        """Add the sums (:meth:`state`) of other scans for the same alarms."""
        row = state["row"]
        self._weighted[row] += state["weighted"]
        self._weight[row] += state["weight"]
        self._scans[row] += state["scans"]

    def table(self) -> pd.DataFrame:
        """Return the contrast that follows from the sums, as :func:`local_contrast` does."""
        with np.errstate(invalid="ignore"):
            columns = {"contrast": self._weighted / self._weight, "scans": self._scans}
            return pd.DataFrame(columns, index=self._index)


def local_contrast(
    images: Iterable[xr.DataArray],
    alarms: pd.DataFrame,
    polarization: str,
    subband: str,
    y_max: float,
    patch: PatchShape | None = None,
) -> pd.DataFrame:
    """Compute the local contrast C of alarms, a mean over scans (Wang et al. 2007, Eq. 7).

    Unlike the paper's patches, which lie well inside the images, a patch here may reach over the
    border: its outer region is then what is left of it.

    Parameters
    ----------
    images : iterable of xarray.DataArray
        Cleaned scan images (polarization, subband, y, x) in the scan frame with their ``pose``.
    alarms : DataFrame
        x, y in the lane frame, m.
    polarization, subband : str
        Channel; the paper's C_HH is HH in its lowest sub-band.
    y_max : float
        Farthest distance ahead of the array that counts, m.
    patch : PatchShape, optional
        Patch; default the paper's 25 x 25 pixels of 10 cm.

    Returns
    -------
    DataFrame
        ``contrast``, NaN where no scan sees the alarm, and ``scans``, how many count, with the
        index of ``alarms``.
    """
    shape = patch or PatchShape()
    inner = shape.region(shape.inner)
    outer = ~shape.region(shape.guard)
    weighted = np.zeros(len(alarms))
    weight = np.zeros(len(alarms))
    scans = np.zeros(len(alarms))
    for image in images:
        values = np.abs(image.sel(polarization=polarization, subband=subband).values)
        y = image["y"].values
        x = image["x"].values
        centres = lane_to_scan(ground_points(alarms), np.asarray(image.attrs["pose"]))
        local = centres[:, None, None, :2] + shape.offsets()
        row = (local[..., 1] - y[0]) / (y[1] - y[0])
        column = (local[..., 0] - x[0]) / (x[1] - x[0])
        patches = bilinear(values, row, column)
        too_far = local[:, shape.size // 2, shape.size // 2, 1] > y_max
        for i in np.flatnonzero(~too_far):
            peak, contrast = _contrast(np.asarray(patches[i], dtype=np.float64), inner, outer)
            if np.isfinite(contrast):
                weighted[i] += peak * contrast
                weight[i] += peak
                scans[i] += 1
    with np.errstate(invalid="ignore"):
        return pd.DataFrame({"contrast": weighted / weight, "scans": scans}, index=alarms.index)


def _contrast(
    patch: NDArray[np.float64], inner: NDArray[np.bool_], outer: NDArray[np.bool_]
) -> tuple[float, float]:
    """Return the peak of the inner region and its contrast to the outer one; NaN if undefined."""
    around = patch[outer & np.isfinite(patch)]
    if not np.isfinite(patch[inner]).all() or around.size < 2:
        return np.nan, np.nan
    peak = float(patch[inner].max())
    deviation = float(around.std())
    if not deviation > 0:
        return peak, np.nan
    return peak, (peak - float(around.mean())) / deviation
