"""Local contrast of alarms (Wang et al. 2007, Eq. 7)."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np
import pandas as pd
import xarray as xr

from flgpr.features.patch import PatchShape
from flgpr.features.regions import patch_statistics
from flgpr.kernels.patches import OUTER_MEAN, OUTER_STD, PEAK
from flgpr.model import Grid, ground_points, lane_to_scan
from flgpr.types import AnyArray, Arrays, Float32Array, FloatArray


class ContrastSums:
    """Compute the local contrast of alarms scan by scan from plain arrays (:func:`local_contrast`).

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

    def add(self, magnitude: Float32Array, pose: FloatArray) -> None:
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

    def state(self) -> Arrays:
        """Return the sums for :meth:`merge`: ``row``, the alarms with a scan, and their sums."""
        row = np.flatnonzero(self._scans)
        return {
            "row": row,
            "weighted": self._weighted[row],
            "weight": self._weight[row],
            "scans": self._scans[row],
        }

    def merge(self, state: Mapping[str, AnyArray]) -> None:
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
    sums: ContrastSums | None = None
    for image in images:
        if sums is None:
            x = image["x"].values
            y = image["y"].values
            grid = Grid(x[0], y[0], x.size, y.size, x[1] - x[0], y[1] - y[0])
            sums = ContrastSums(alarms, grid, y_max, patch)
        channel = image.sel(polarization=polarization, subband=subband).values
        sums.add(np.abs(channel).astype(np.float32), np.asarray(image.attrs["pose"]))
    if sums is None:
        return pd.DataFrame({"contrast": np.nan, "scans": 0.0}, index=alarms.index)
    return sums.table()
