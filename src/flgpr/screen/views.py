"""The run-view: all scan images of a run brought together in the lane frame (Wang et al. 2007, Sec. II-B)."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from flgpr.kernels.sampling import bilinear
from flgpr.model import Grid, lane_to_scan, scan_to_lane


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


class RunViewSums:
    """The largest and second largest magnitude at every pixel of the lane, scan by scan.

    Parameters
    ----------
    grid : Grid
        Pixels in the lane frame.
    y_max : float
        Farthest distance ahead of the array that counts, m.
    rows : slice, optional
        Rows of the grid that are kept, for a part of the lane; default all.
    """

    def __init__(self, grid: Grid, y_max: float, rows: slice | None = None) -> None:
        self.grid, self.y_max = grid, y_max
        self._window = range(grid.ny)[rows] if rows is not None else range(grid.ny)
        self._points = np.zeros((len(self._window), grid.nx, 3))
        self._points[..., 0] = grid.x[None, :]
        self._points[..., 1] = grid.y[self._window.start : self._window.stop, None]
        self._looks = np.zeros(self._points.shape[:2], np.int64)
        self._first: NDArray[np.float32] | None = None
        self._second: NDArray[np.float32] | None = None

    def add(self, magnitude: NDArray[np.float32], grid: Grid, pose: NDArray[np.float64]) -> None:
        """Take one scan in.

        Parameters
        ----------
        magnitude : (..., y, x) ndarray of float32
            Cleaned magnitudes.
        grid : Grid
            Their pixels in the scan frame.
        pose : (6,) ndarray
            Pose of the scan.
        """
        if self._first is None or self._second is None:
            shape = (*magnitude.shape[:-2], *self._looks.shape)
            self._first, self._second = np.full(shape, -np.inf, np.float32), np.full(shape, -np.inf, np.float32)
        reached, start = self.reach(grid, pose), self._window.start
        rows = slice(max(reached.start - start, 0), max(reached.stop - start, 0))
        local = lane_to_scan(self._points[rows], pose)
        row, column = (local[..., 1] - grid.y_min) / grid.dy, (local[..., 0] - grid.x_min) / grid.dx
        values = bilinear(magnitude, row, column).astype(np.float32)
        values[..., local[..., 1] > self.y_max] = np.nan
        seen = np.isfinite(values)
        self._looks[rows] += seen.all(axis=tuple(range(seen.ndim - 2)))
        values = np.where(seen, values, -np.inf)
        first, second = self._first[..., rows, :], self._second[..., rows, :]
        np.maximum(second, np.minimum(first, values), out=second)
        np.maximum(first, values, out=first)

    def result(self) -> tuple[NDArray[np.float32], NDArray[np.int64]]:
        """Compute the run-view.

        Returns
        -------
        view : (..., y, x) ndarray of float32
            Second largest magnitude; the only one where a single scan sees the pixel; NaN where none does.
        looks : (y, x) ndarray of int
            Number of scans that see each pixel.

        Raises
        ------
        ValueError
            If no scan was added.
        """
        if self._first is None or self._second is None:
            raise ValueError("images must hold at least one scan, got none")
        view = np.where(self._looks > 1, self._second, self._first)
        return np.where(self._looks > 0, view, np.nan).astype(np.float32), self._looks

    def state(self) -> dict[str, NDArray[Any]]:
        """Give what was gathered, to be taken in by another.

        Returns
        -------
        dict
            ``first`` and ``second`` (..., y, x), the largest and second largest magnitudes, -inf where there are none,
            ``looks`` (y, x), and ``row``, the first row.

        Raises
        ------
        ValueError
            If no scan was added.
        """
        if self._first is None or self._second is None:
            raise ValueError("images must hold at least one scan, got none")
        row = np.array(self._window.start)
        return {"first": self._first, "second": self._second, "looks": self._looks, "row": row}

    def merge(self, state: dict[str, NDArray[Any]]) -> None:
        """Take in what another gathered of other scans of the same lane, as far as it lies in the rows kept here.

        Parameters
        ----------
        state : dict
            From :meth:`state`.
        """
        if self._first is None or self._second is None:
            shape = (*state["first"].shape[:-2], *self._looks.shape)
            self._first, self._second = np.full(shape, -np.inf, np.float32), np.full(shape, -np.inf, np.float32)
        start = int(state["row"]) - self._window.start
        rows = slice(max(start, 0), max(start + len(state["looks"]), 0))
        theirs = slice(rows.start - start, rows.start - start + len(self._looks[rows]))
        self._looks[rows] += state["looks"][theirs]
        first, second = self._first[..., rows, :], self._second[..., rows, :]
        one, two = state["first"][..., theirs, :], state["second"][..., theirs, :]
        np.maximum(second, two, out=second)
        np.maximum(second, np.minimum(first, one), out=second)
        np.maximum(first, one, out=first)

    def reach(self, grid: Grid, pose: NDArray[np.float64]) -> slice:
        """Tell which rows of the run-view a scan can reach.

        Parameters
        ----------
        grid : Grid
            Pixels of the scan image.
        pose : (6,) ndarray
            Pose of the scan.

        Returns
        -------
        slice
            Rows of the whole grid.
        """
        x_min, x_max, y_min, y_max = grid.extent()
        corners = np.zeros((4, 3))
        corners[:, :2] = [(x, y) for x in (x_min, x_max) for y in (y_min, min(y_max, self.y_max + grid.dy))]
        along = scan_to_lane(corners, pose)[:, 1]
        first = math.floor((along.min() - self.grid.y_min) / self.grid.dy)
        last = math.ceil((along.max() - self.grid.y_min) / self.grid.dy) + 1
        return slice(min(max(first, 0), self.grid.ny), min(max(last, 0), self.grid.ny))


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

    Examples
    --------
    The second largest magnitude stands where two scans or more see a pixel: a flash in one scan does not.

    >>> import numpy as np
    >>> import xarray as xr
    >>> from flgpr.model import Grid
    >>> from flgpr.screen import run_view
    >>> ahead = Grid.spanning((-1.0, 1.0), (1.0, 4.0), 0.5)  # of the vehicle
    >>> def scan(y, values):
    ...     pose = np.array([0.0, y, 1.5, 0.0, 0.0, 0.0])
    ...     axes = {"y": ahead.y, "x": ahead.x}
    ...     return xr.DataArray(values, dims=("y", "x"), coords=axes, attrs={"pose": pose})
    >>> still, flash = np.ones(ahead.shape, complex), np.ones(ahead.shape, complex)
    >>> flash[2, 2] = 9.0
    >>> lane = Grid.spanning((0.0, 0.5), (2.0, 3.0), 0.5)
    >>> view = run_view([scan(0.0, flash), scan(0.5, still), scan(1.0, still)], lane, y_max=4.0)
    >>> view.values
    array([[1., 1.],
           [1., 1.],
           [1., 1.]], dtype=float32)
    >>> view.looks.values
    array([[3, 3],
           [3, 3],
           [3, 3]])
    """
    sums = RunViewSums(grid, y_max)
    template: xr.DataArray | None = None
    for image in images:
        template = image
        sums.add(np.abs(image.values), _grid_of(image), np.asarray(image.attrs["pose"]))
    result, looks = sums.result()
    if template is None:
        raise ValueError("images must hold at least one scan, got none")
    return view_array(result, looks, grid, {str(n): template[n].values for n in template.dims if n not in ("y", "x")})


def view_array(
    view: NDArray[np.float32],
    looks: NDArray[np.int64],
    grid: Grid,
    channels: Mapping[str, Any],
    rows: slice | None = None,
) -> xr.DataArray:
    """Attach coordinates to a run-view.

    Parameters
    ----------
    view : (..., y, x) ndarray of float32
        Run-view.
    looks : (y, x) ndarray of int
        Number of scans that see each pixel.
    grid : Grid
        Pixels in the lane frame.
    channels : mapping of str to sequence
        Names and labels of the leading dimensions.
    rows : slice, optional
        Rows of the grid that the run-view holds; default all.

    Returns
    -------
    xarray.DataArray
        As :func:`run_view` returns it.
    """
    return xr.DataArray(
        view,
        dims=(*channels, "y", "x"),
        coords={**channels, "y": grid.y[rows or slice(None)], "x": grid.x, "looks": (("y", "x"), looks)},
        name="run_view",
    )


def _grid_of(image: xr.DataArray) -> Grid:
    y, x = image["y"].values, image["x"].values
    return Grid(float(x[0]), float(y[0]), x.size, y.size, float(x[1] - x[0]), float(y[1] - y[0]))


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
