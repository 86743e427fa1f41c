"""Local contrast of alarms (Wang et al. 2007, Eq. 7)."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
import pandas as pd
import xarray as xr
from numpy.typing import NDArray

from flgpr.kernels.sampling import bilinear
from flgpr.model import lane_to_scan


@dataclass(frozen=True)
class PatchShape:
    """Size and regions of an incoherent patch.

    Attributes
    ----------
    size : int
        Pixels along a side, odd; the paper's patch has 25.
    spacing : float
        Pixel spacing, m.
    inner : tuple of int
        Inner region, pixels cross-track x down-track.
    guard : tuple of int
        Inner and guard region together; what lies outside it is the outer region.
    """

    size: int = 25
    spacing: float = 0.1
    inner: tuple[int, int] = (5, 3)
    guard: tuple[int, int] = (9, 7)

    def __post_init__(self) -> None:
        sizes = (self.size, *self.inner, *self.guard)
        if any(n < 1 or n % 2 == 0 for n in sizes):
            raise ValueError(f"patch size, inner and guard must be odd numbers of pixels, got {sizes}")
        if not all(i <= g < self.size for i, g in zip(self.inner, self.guard, strict=True)):
            raise ValueError(f"patch must have inner <= guard < size, got {self.inner}, {self.guard}, {self.size}")
        if not self.spacing > 0:
            raise ValueError(f"patch spacing must be positive, got {self.spacing}")

    def offsets(self) -> NDArray[np.float64]:
        """Pixel centres about the patch's centre, m, shape (size, size, 2): x, y."""
        along = (np.arange(self.size) - self.size // 2) * self.spacing
        return np.stack(np.meshgrid(along, along), axis=-1)

    def region(self, pixels: tuple[int, int]) -> NDArray[np.bool_]:
        """Mask (y, x) of the central ``pixels`` (cross-track, down-track)."""
        offset = np.abs(np.arange(self.size) - self.size // 2)
        return (offset[:, None] <= pixels[1] // 2) & (offset[None, :] <= pixels[0] // 2)


def local_contrast(
    images: Iterable[xr.DataArray],
    alarms: pd.DataFrame,
    polarization: str,
    subband: str,
    y_max: float,
    patch: PatchShape | None = None,
) -> pd.DataFrame:
    """Local contrast C of alarms, weighted over the scans that see them (Wang et al. 2007, Eq. 7).

    Unlike the paper's patches, which lie well inside the images, a patch here may reach over the border: its outer
    region is then what is left of it.

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
        ``contrast`` and ``scans`` (number of scans that count), with the index of ``alarms``. Contrast is NaN where no
        scan sees the alarm.
    """
    shape = patch or PatchShape()
    inner, outer = shape.region(shape.inner), ~shape.region(shape.guard)
    weighted, weight, scans = (np.zeros(len(alarms)) for _ in range(3))
    for image in images:
        values = np.abs(image.sel(polarization=polarization, subband=subband).values)
        y, x = image["y"].values, image["x"].values
        centres = np.zeros((len(alarms), 3))
        centres[:, :2] = alarms[["x", "y"]].to_numpy(dtype=np.float64)
        local = lane_to_scan(centres, np.asarray(image.attrs["pose"]))[:, None, None, :2] + shape.offsets()
        patches = bilinear(values, (local[..., 1] - y[0]) / (y[1] - y[0]), (local[..., 0] - x[0]) / (x[1] - x[0]))
        far = local[:, shape.size // 2, shape.size // 2, 1] > y_max
        for i in np.flatnonzero(~far):
            peak, contrast = _contrast(np.asarray(patches[i], dtype=np.float64), inner, outer)
            if np.isfinite(contrast):
                weighted[i] += peak * contrast
                weight[i] += peak
                scans[i] += 1
    with np.errstate(invalid="ignore"):
        return pd.DataFrame({"contrast": weighted / weight, "scans": scans}, index=alarms.index)


def _contrast(patch: NDArray[np.float64], inner: NDArray[np.bool_], outer: NDArray[np.bool_]) -> tuple[float, float]:
    around = patch[outer & np.isfinite(patch)]
    if not np.isfinite(patch[inner]).all() or around.size < 2:
        return np.nan, np.nan
    peak = float(patch[inner].max())
    spread = float(around.std())
    return peak, (peak - float(around.mean())) / spread if spread > 0 else np.nan
