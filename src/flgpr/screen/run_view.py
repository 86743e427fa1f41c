"""The run-view: all scan images of a run brought together in the lane frame (Wang et al. 2007, Sec. II-B)."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from flgpr.kernels.sampling import bilinear
from flgpr.model import Grid, lane_to_scan


def sample_scan(image: xr.DataArray, points: NDArray[np.float64]) -> NDArray[np.float32]:
    """Sample the magnitude of a scan image at points of the scan frame.

    Parameters
    ----------
    image : xarray.DataArray
        Scan image (..., y, x) with uniform coordinates in the scan frame.
    points : (..., 2 or 3) ndarray
        Points in the scan frame, m.

    Returns
    -------
    ndarray
        Magnitudes by bilinear interpolation, shape image's leading dimensions plus the points'; NaN outside the image.
    """
    y, x = image["y"].values, image["x"].values
    row = (points[..., 1] - y[0]) / (y[1] - y[0])
    column = (points[..., 0] - x[0]) / (x[1] - x[0])
    return bilinear(np.abs(image.values), row, column)


def run_view(images: Iterable[xr.DataArray], grid: Grid, y_max: float) -> xr.DataArray:
    """Bring scan images together: the second largest magnitude over the scans that see a pixel.

    Second largest, to be rid of spurious bright pixels; where a single scan sees the pixel, its value stands.

    Parameters
    ----------
    images : iterable of xarray.DataArray
        Cleaned scan images (..., y, x) in the scan frame, each with its ``pose`` among the attributes.
    grid : Grid
        Pixels in the lane frame.
    y_max : float
        Farthest distance ahead of the array that counts, m.

    Returns
    -------
    xarray.DataArray
        Float32 (..., y, x) in the lane frame; NaN where no scan saw the pixel. Coordinate ``looks`` (y, x) counts the
        scans.

    Raises
    ------
    ValueError
        If there is no image.
    """
    points = grid.points()
    first: NDArray[np.float32] | None = None
    looks = np.zeros(grid.shape, np.int64)
    template: xr.DataArray | None = None
    for image in images:
        local = lane_to_scan(points, np.asarray(image.attrs["pose"]))
        values = sample_scan(image, local).astype(np.float32)
        values[..., local[..., 1] > y_max] = np.nan
        seen = np.isfinite(values)
        looks += seen.reshape(-1, *grid.shape).all(axis=0)
        values = np.where(seen, values, -np.inf)
        if first is None or template is None:
            template, first, second = image, values, np.full_like(values, -np.inf)
        else:
            second = np.maximum(second, np.minimum(first, values))
            first = np.maximum(first, values)
    if first is None or template is None:
        raise ValueError("images must hold at least one scan, got none")
    result = np.where(looks > 1, second, first)
    result = np.where(looks > 0, result, np.nan).astype(np.float32)
    return xr.DataArray(
        result,
        dims=template.dims,
        coords={
            **{name: template[name] for name in template.dims if name not in ("y", "x")},
            "y": grid.y,
            "x": grid.x,
            "looks": (("y", "x"), looks),
        },
        name="run_view",
    )


def select(view: xr.DataArray, polarization: str, subband: str) -> xr.DataArray:
    """Take one polarization and sub-band of a run-view.

    Parameters
    ----------
    view : xarray.DataArray
        Run-view (polarization, subband, y, x).
    polarization, subband : str
        Names.

    Returns
    -------
    xarray.DataArray
        Run-view (y, x).

    Raises
    ------
    ValueError
        If the run has no such polarization or sub-band.
    """
    for name, value in (("polarization", polarization), ("subband", subband)):
        known: Sequence[str] = [str(label) for label in view[name].values]
        if value not in known:
            raise ValueError(f"{name} must be one of {', '.join(known)}, got {value!r}")
    return view.sel(polarization=polarization, subband=subband)
