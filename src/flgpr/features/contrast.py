"""Local contrast of alarms (Wang et al. 2007, Eq. 7)."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr
from numpy.typing import NDArray

from flgpr.features.patch import PatchShape
from flgpr.kernels.patches import INNER, OUTER, OUTER_MEAN, OUTER_STD, PEAK, region_statistics
from flgpr.kernels.sampling import bilinear
from flgpr.model import Grid, ground_points, lane_to_scan


class ContrastSums:
    """What :func:`local_contrast` computes, gathered scan by scan from plain arrays on ``grid``; ``y_max`` in m."""

    def __init__(
        self, alarms: pd.DataFrame, grid: Grid, y_max: float, patch: PatchShape | None = None
    ) -> None:
        self._grid = grid
        self._y_max = y_max
        self._patch = patch or PatchShape()
        self._index = alarms.index
        self._centres = ground_points(alarms)
        self._weighted, self._weight, self._scans = (np.zeros(len(alarms)) for _ in range(3))

    def add(self, magnitude: NDArray[np.float32], pose: NDArray[np.float64]) -> None:
        """Take in one scan's cleaned magnitudes (y, x) of the channel."""
        grid = self._grid
        patch = self._patch
        local = lane_to_scan(self._centres, pose)
        seen = np.flatnonzero(local[:, 1] <= self._y_max)
        if not seen.size:
            return
        row, column = (
            (local[seen, 1] - grid.y_min) / grid.dy,
            (local[seen, 0] - grid.x_min) / grid.dx,
        )
        offset = (np.arange(patch.size) - patch.size // 2) * patch.spacing / grid.dx
        out = np.empty((seen.size, 1, 1, 4))
        region_statistics(
            np.ascontiguousarray(magnitude)[None],
            row,
            column,
            offset,
            region_codes(patch)[None],
            out,
        )
        peak, mean, spread = (out[:, 0, 0, name] for name in (PEAK, OUTER_MEAN, OUTER_STD))
        good = np.isfinite(peak) & (spread > 0)
        seen = seen[good]
        peak = peak[good]
        mean = mean[good]
        spread = spread[good]
        self._weighted[seen] += peak * (peak - mean) / spread
        self._weight[seen] += peak
        self._scans[seen] += 1

    def state(self) -> dict[str, NDArray[Any]]:
        """Give what was gathered, to be merged into another: ``row``, the alarms that were seen, and their sums."""
        row = np.flatnonzero(self._scans)
        return {
            "row": row,
            "weighted": self._weighted[row],
            "weight": self._weight[row],
            "scans": self._scans[row],
        }

    def merge(self, state: Mapping[str, NDArray[Any]]) -> None:
        """Take in what another gathered (:meth:`state`) of other scans for the same alarms."""
        for name, value in (
            ("weighted", self._weighted),
            ("weight", self._weight),
            ("scans", self._scans),
        ):
            value[state["row"]] += state[name]

    def table(self) -> pd.DataFrame:
        """Compute the contrast from the sums, as :func:`local_contrast` gives it."""
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
    """Local contrast C of alarms, weighted over the scans that see them (Wang et al. 2007, Eq. 7).

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
    weighted, weight, scans = (np.zeros(len(alarms)) for _ in range(3))
    for image in images:
        values = np.abs(image.sel(polarization=polarization, subband=subband).values)
        y = image["y"].values
        x = image["x"].values
        centres = lane_to_scan(ground_points(alarms), np.asarray(image.attrs["pose"]))
        local = centres[:, None, None, :2] + shape.offsets()
        patches = bilinear(
            values, (local[..., 1] - y[0]) / (y[1] - y[0]), (local[..., 0] - x[0]) / (x[1] - x[0])
        )
        far = local[:, shape.size // 2, shape.size // 2, 1] > y_max
        for i in np.flatnonzero(~far):
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
    around = patch[outer & np.isfinite(patch)]
    if not np.isfinite(patch[inner]).all() or around.size < 2:
        return np.nan, np.nan
    peak = float(patch[inner].max())
    spread = float(around.std())
    return peak, (peak - float(around.mean())) / spread if spread > 0 else np.nan


def region_codes(patch: PatchShape) -> NDArray[np.int8]:
    """Tell the regions of a patch's pixels (y, x) as ``region_statistics`` wants them."""
    codes = np.where(patch.region(patch.guard), 0, OUTER)
    return np.where(patch.region(patch.inner), INNER, codes).astype(np.int8)
