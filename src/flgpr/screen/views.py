"""The run-view: all scan images of a run in the lane frame (Wang et al. 2007, Sec. II-B).

What the looks at a place are combined to has a class each: :class:`RunViewSums` keeps the largest
and the second largest, which it shows, :class:`MeanViewSums` the weighted mean,
:class:`RangeViewSums` one look for each distance ahead.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import xarray as xr

from flgpr.kernels.sampling import bilinear
from flgpr.model import Grid, lane_to_scan, scan_to_lane
from flgpr.model.constants import IMAGE_ATTRS
from flgpr.model.run import described
from flgpr.types import (
    AnyArray,
    ArrayLike,
    Arrays,
    BoolArray,
    Float32Array,
    FloatArray,
    IndexArray,
    IntArray,
    floats,
)


def sample_scan(image: xr.DataArray, points: FloatArray) -> Float32Array:
    """Sample the magnitude of a scan image at points of its frame.

    Parameters
    ----------
    image : (..., y, x) xarray.DataArray
        Scan image, complex or magnitude.
    points : (..., 2 or 3) ndarray
        Positions in the scan frame, m.

    Returns
    -------
    ndarray of float32
        Magnitudes, leading axes of the image first; NaN outside.
    """
    return sampled(np.abs(image.values), grid_of(image), points)


def pixels_at(grid: Grid, x: ArrayLike, y: ArrayLike) -> tuple[IndexArray, IndexArray]:
    """Return rows and columns of the pixels of a grid that are nearest to points."""
    row = np.rint((floats(y) - grid.y_min) / grid.dy).astype(np.intp)
    return row, np.rint((floats(x) - grid.x_min) / grid.dx).astype(np.intp)


def sampled(images: AnyArray, grid: Grid, points: FloatArray) -> AnyArray:
    """Return images (..., y, x) on a grid at points (..., 2 or 3), bilinear; NaN outside."""
    row = (points[..., 1] - grid.y_min) / grid.dy
    column = (points[..., 0] - grid.x_min) / grid.dx
    return bilinear(images, row, column)


def reached_rows(view: Grid, y_max: float, image: Grid, pose: FloatArray) -> slice:
    """Return the rows of a run-view that a scan can reach.

    Parameters
    ----------
    view : Grid
        Pixels of the run-view, in the lane frame.
    y_max : float
        Farthest distance ahead of the array that counts, m.
    image : Grid
        Pixels of the scan in its frame.
    pose : (6,) ndarray
        Pose of the scan, m and rad.
    """
    lowest, highest = seen_along(image, pose, y_max + image.dy)
    first = math.floor((lowest - view.y_min) / view.dy)
    end = math.ceil((highest - view.y_min) / view.dy) + 1
    return slice(min(max(first, 0), view.ny), min(max(end, 0), view.ny))


def seen_along(grid: Grid, pose: FloatArray, y_max: float) -> tuple[float, float]:
    """Return the first and last y of the lane, m, that a scan sees up to ``y_max`` ahead."""
    along = scan_to_lane(grid.corners(y_max), pose)[:, 1]
    return float(along.min()), float(along.max())


class ScanSamples(NamedTuple):
    """Magnitudes of a scan at some pixels of the lane."""

    values: Float32Array  #: magnitudes (..., y, x)
    known: BoolArray  #: where they are finite (..., y, x)
    known_by_all: BoolArray  #: where all channels are finite (y, x): such a pixel is seen
    local: FloatArray  #: positions in the scan frame (y, x, 3), m


class LaneSums:
    """Combine the samples of all scans at the pixels of the lane; a subclass says how.

    Parameters
    ----------
    grid : Grid
        Pixels of the lane frame.
    y_max : float
        Farthest distance ahead of the array that counts, m.
    rows : slice, optional
        Rows of the grid that are combined, for a section of the lane; by default all.
    """

    def __init__(self, grid: Grid, y_max: float, rows: slice | None = None) -> None:
        self.grid = grid
        self.y_max = y_max
        self._window = range(grid.ny)[rows] if rows is not None else range(grid.ny)
        self._points = np.zeros((len(self._window), grid.nx, 3))
        self._points[..., 0] = grid.x[None, :]
        self._points[..., 1] = grid.y[self._window.start : self._window.stop, None]
        self._looks = np.zeros(self._points.shape[:2], np.int64)
        self._sums: Arrays = {}

    def add(self, magnitude: Float32Array, grid: Grid, pose: FloatArray) -> None:
        """Add one scan.

        Parameters
        ----------
        magnitude : (..., y, x) ndarray of float32
            Magnitudes.
        grid : Grid
            Their pixels in the scan frame.
        pose : (6,) ndarray
            Pose of the scan, m and rad.
        """
        if not self._sums:
            self._sums = self._begin(magnitude.shape[:-2])
        reached = self.reach(grid, pose)
        start = self._window.start
        rows = slice(max(reached.start - start, 0), max(reached.stop - start, 0))

        local = lane_to_scan(self._points[rows], pose)
        values = sampled(magnitude, grid, local).astype(np.float32)
        values[..., local[..., 1] > self.y_max] = np.nan
        known = np.isfinite(values)
        leading_axes = tuple(range(known.ndim - 2))
        known_by_all = np.asarray(known.all(axis=leading_axes))

        self._looks[rows] += known_by_all
        self._add_samples(
            _rows_of(self._sums, rows), ScanSamples(values, known, known_by_all, local)
        )

    def result(self) -> tuple[Float32Array, IntArray]:
        """Return the run-view (..., y, x) and the number of looks (y, x).

        The view is NaN where no scan sees the pixel. Without any scan it is a ValueError.
        """
        view = self._view(self._begun_sums())
        return np.where(self._looks > 0, view, np.nan).astype(np.float32), self._looks

    def state(self) -> Arrays:
        """Return the sums for :meth:`merge`, with ``looks`` (y, x) and ``row``, the first row."""
        return {**self._begun_sums(), "looks": self._looks, "row": np.array(self._window.start)}

    def merge(self, state: Mapping[str, AnyArray]) -> None:
        """Add the sums (:meth:`state`) of other scans of the same lane, where the rows overlap."""
        other_sums = {name: state[name] for name in state if name not in ("looks", "row")}
        if not self._sums:
            self._sums = self._begin(self._channels(other_sums))

        # The rows that both hold, counted from the first row of these sums and of the others.
        start = int(state["row"]) - self._window.start
        rows = slice(max(start, 0), max(start + len(state["looks"]), 0))
        first = rows.start - start
        other_rows = slice(first, first + len(self._looks[rows]))

        self._looks[rows] += state["looks"][other_rows]
        self._add_sums(_rows_of(self._sums, rows), _rows_of(other_sums, other_rows))

    def reach(self, grid: Grid, pose: FloatArray) -> slice:
        """Return the rows of the grid that a scan can reach, see :func:`reached_rows`."""
        return reached_rows(self.grid, self.y_max, grid, pose)

    def _begun_sums(self) -> Arrays:
        """Return the sums of at least one scan."""
        if not self._sums:
            raise ValueError("images must hold at least one scan, got none")
        return self._sums

    def _channels(self, sums: Mapping[str, AnyArray]) -> tuple[int, ...]:
        """Return the leading shape of the magnitudes from sums of them."""
        return next(iter(sums.values())).shape[:-2]

    def _begin(self, channels: tuple[int, ...]) -> Arrays:
        """Return the sums (..., y, x) before the first scan."""
        raise NotImplementedError

    def _add_samples(self, sums: Mapping[str, AnyArray], samples: ScanSamples) -> None:
        """Add a scan's samples to the sums of the same rows."""
        raise NotImplementedError

    def _add_sums(self, sums: Mapping[str, AnyArray], other: Mapping[str, AnyArray]) -> None:
        """Add sums of other scans to those of the same rows."""
        raise NotImplementedError

    def _view(self, sums: Mapping[str, AnyArray]) -> AnyArray:
        """Return the run-view (..., y, x) that follows from the sums."""
        raise NotImplementedError


def _rows_of(sums: Mapping[str, AnyArray], rows: slice) -> Arrays:
    """Return views of some rows of arrays (..., y, x)."""
    return {name: array[..., rows, :] for name, array in sums.items()}


class RunViewSums(LaneSums):
    """Keep the two largest magnitudes over the scans at every pixel, and show the second largest.

    That is the run-view of Wang et al. 2007, Sec. II-B. A flash, which is bright in a single scan,
    does not show. Two arrays are stored, ``first`` and ``second``: the largest and the second
    largest magnitude of the scans so far. A new value is compared with both, and only so is the
    second largest known after any number of scans. The run-view is ``second`` where two scans or
    more see the pixel, and ``first``, the only value, where a single one does.

    The n-th largest takes n arrays in descending order: a new value passes down through them
    (``_add_samples``), those of other scans likewise (``_add_sums``), and where fewer scans see a
    pixel the last array that has a value is shown (``_view``). The roadside's mask and the view
    before the background is removed take this class, too. So another rank is a class of its own,
    with a name in the stub ``screen/__init__.pyi``. ``Steps.view_sums`` (``method/steps.py``)
    chooses it by a further name of ``RunViewTable.look`` (``recipe/tables.py``), which has
    its row in ``docs/guide/systems.md`` and in the schema that ``evidence/make_schemas.py`` writes.
    Nothing else changes but the frozen table of settings (``tests/freeze``): passes, live detection
    and the cache follow.
    """

    def _begin(self, channels: tuple[int, ...]) -> Arrays:
        shape = (*channels, *self._looks.shape)
        return {name: np.full(shape, -np.inf, np.float32) for name in ("first", "second")}

    def _add_samples(self, sums: Mapping[str, AnyArray], samples: ScanSamples) -> None:
        values = np.where(samples.known, samples.values, -np.inf)
        # The smaller of the largest so far and the new value: it may be the second largest.
        smaller = np.minimum(sums["first"], values)
        np.maximum(sums["second"], smaller, out=sums["second"])
        np.maximum(sums["first"], values, out=sums["first"])

    def _add_sums(self, sums: Mapping[str, AnyArray], other: Mapping[str, AnyArray]) -> None:
        smaller_first = np.minimum(sums["first"], other["first"])
        np.maximum(sums["second"], other["second"], out=sums["second"])
        np.maximum(sums["second"], smaller_first, out=sums["second"])
        np.maximum(sums["first"], other["first"], out=sums["first"])

    def _view(self, sums: Mapping[str, AnyArray]) -> AnyArray:
        return np.where(self._looks > 1, sums["second"], sums["first"])


class MeanViewSums(LaneSums):
    """Average over the scans that see a pixel, weighted by :func:`look_weight` of their distances.

    Of log-likelihoods this is their fusion as if looks were independent.

    Parameters
    ----------
    grid, y_max, rows
        As for ``LaneSums``.
    falloff : float
        Power of the distance by which weights fall.
    """

    def __init__(
        self, grid: Grid, y_max: float, rows: slice | None = None, falloff: float = 0.0
    ) -> None:
        super().__init__(grid, y_max, rows)
        self.falloff = falloff

    def _begin(self, channels: tuple[int, ...]) -> Arrays:
        return {
            "sum": np.zeros((*channels, *self._looks.shape)),
            "weight": np.zeros(self._looks.shape),
        }

    def _add_samples(self, sums: Mapping[str, AnyArray], samples: ScanSamples) -> None:
        distance = np.hypot(samples.local[..., 0], samples.local[..., 1])
        weight = np.where(samples.known_by_all, look_weight(distance, self.falloff), 0.0)
        sums["sum"][...] += weight * np.where(samples.known_by_all, samples.values, 0.0)
        sums["weight"][...] += weight

    def _add_sums(self, sums: Mapping[str, AnyArray], other: Mapping[str, AnyArray]) -> None:
        sums["sum"][...] += other["sum"]
        sums["weight"][...] += other["weight"]

    def _view(self, sums: Mapping[str, AnyArray]) -> AnyArray:
        return sums["sum"] / np.where(self._looks > 0, sums["weight"], 1.0)


def look_weight(distance: FloatArray, falloff: float) -> FloatArray:
    """Compute the weights of looks, the power -``falloff`` of their distances.

    Parameters
    ----------
    distance : ndarray
        Distances of the looks, m; those below a metre count as a metre.
    falloff : float
        Power.

    Returns
    -------
    ndarray
        Weights, in the shape of the distances.
    """
    return np.asarray(np.maximum(distance, 1.0) ** -falloff)


class RangeViewSums(LaneSums):
    """Select, for each of several distances ahead, the scan that sees a pixel nearest to it.

    There is one view per distance (flsar2004, Sec. 2).

    Parameters
    ----------
    grid, y_max, rows
        As for :class:`RunViewSums`.
    ranges : sequence of float
        Distances ahead of the array, m.
    within : float
        Farthest from its distance that a scan may see a pixel, m.
    """

    def __init__(
        self,
        grid: Grid,
        y_max: float,
        rows: slice | None = None,
        ranges: Sequence[float] = (),
        within: float = math.inf,
    ) -> None:
        super().__init__(grid, y_max, rows)
        self.ranges = tuple(ranges)
        self.within = within

    def _begin(self, channels: tuple[int, ...]) -> Arrays:
        shape = (*channels, len(self.ranges), *self._looks.shape)
        return {"value": np.full(shape, np.nan, np.float32), "off": np.full(shape[-3:], np.inf)}

    def _channels(self, sums: Mapping[str, AnyArray]) -> tuple[int, ...]:
        return sums["value"].shape[:-3]

    def _add_samples(self, sums: Mapping[str, AnyArray], samples: ScanSamples) -> None:
        off = np.abs(samples.local[..., 1] - np.reshape(self.ranges, (-1, 1, 1)))
        off = np.where(samples.known_by_all & (off <= self.within), off, np.inf)
        self._add_sums(sums, {"value": samples.values[..., None, :, :], "off": off})

    def _add_sums(self, sums: Mapping[str, AnyArray], other: Mapping[str, AnyArray]) -> None:
        nearer = other["off"] < sums["off"]  # of equally near scans the first stays
        sums["value"][...] = np.where(nearer, other["value"], sums["value"])
        sums["off"][...] = np.minimum(sums["off"], other["off"])

    def _view(self, sums: Mapping[str, AnyArray]) -> AnyArray:
        return sums["value"]


def run_view(images: Iterable[xr.DataArray], grid: Grid, y_max: float) -> xr.DataArray:
    """Return the run-view, the second largest magnitude over the scans that see a pixel.

    The second largest removes spurious bright pixels (Wang et al. 2007, Sec. II-B); where a single
    scan sees the pixel, its value is taken.

    Parameters
    ----------
    images : iterable of xarray.DataArray
        Cleaned scan images (..., y, x) in the scan frame, each with its ``pose`` among the
        attributes.
    grid : Grid
        Pixels in the lane frame.
    y_max : float
        Farthest distance ahead of the array that counts, m.

    Returns
    -------
    xarray.DataArray
        Float32 (..., y, x) in the lane frame; NaN where no scan saw the pixel. Coordinate ``looks``
        (y, x) counts the scans.

    Raises
    ------
    ValueError
        If there is no image.

    Examples
    --------
    Where two scans or more see a pixel, a flash in one of them does not show.

    >>> import numpy as np
    >>> import xarray as xr
    >>> from flgpr.model import Grid
    >>> from flgpr.screen import run_view
    >>> ahead = Grid.spanning((-1.0, 1.0), (1.0, 4.0), 0.5)  # of the vehicle
    >>> def scan(y, values):
    ...     pose = np.array([0.0, y, 1.5, 0.0, 0.0, 0.0])
    ...     axes = {"y": ahead.y, "x": ahead.x}
    ...     return xr.DataArray(values, dims=("y", "x"), coords=axes, attrs={"pose": pose})
    >>> flat = np.ones(ahead.shape, complex)
    >>> flash = flat.copy()
    >>> flash[2, 2] = 9.0
    >>> lane = Grid.spanning((0.0, 0.5), (2.0, 3.0), 0.5)
    >>> view = run_view([scan(0.0, flash), scan(0.5, flat), scan(1.0, flat)], lane, y_max=4.0)
    >>> float(view.max()), view.looks.values.tolist()
    (1.0, [[3, 3], [3, 3], [3, 3]])
    """
    sums = RunViewSums(grid, y_max)
    template: xr.DataArray | None = None
    for image in images:
        template = image
        sums.add(np.abs(image.values), grid_of(image), np.asarray(image.attrs["pose"]))
    result, looks = sums.result()
    if template is None:
        raise ValueError("images must hold at least one scan, got none")
    channels = {str(name): template[name].values for name in template.dims[:-2]}
    return view_array(result, looks, grid, channels)


def view_array(
    view: Float32Array,
    looks: IntArray,
    grid: Grid,
    channels: Mapping[str, Any],
    rows: slice | None = None,
) -> xr.DataArray:
    """Return a run-view with its coordinates.

    Parameters
    ----------
    view : (..., y, x) ndarray of float32
        Magnitudes.
    looks : (y, x) ndarray of int
        Number of scans that see the pixel.
    grid : Grid
        Pixels in the lane frame.
    channels : mapping of str to array_like
        Names and labels of the leading dimensions.
    rows : slice, optional
        Rows of the grid that the view holds, by default all.

    Returns
    -------
    xarray.DataArray
        The run-view, named ``run_view``.
    """
    labelled = xr.DataArray(
        view,
        dims=(*channels, "y", "x"),
        coords={
            **channels,
            "y": grid.y[rows or slice(None)],
            "x": grid.x,
            "looks": (("y", "x"), looks),
        },
        name="run_view",
    )
    return described(labelled, IMAGE_ATTRS)


def grid_of(image: xr.DataArray) -> Grid:
    """Return the pixels of an image (..., y, x) according to its axes."""
    y = image["y"].values
    x = image["x"].values
    dx = float(x[1] - x[0])
    dy = float(y[1] - y[0])
    return Grid(float(x[0]), float(y[0]), x.size, y.size, dx, dy)


def select(view: xr.DataArray, polarization: str, subband: str) -> xr.DataArray:
    """Return one polarization and sub-band of a run-view (polarization, subband, y, x).

    A label that the view does not have is a ValueError.
    """
    for name, value in (("polarization", polarization), ("subband", subband)):
        known: Sequence[str] = [str(label) for label in view[name].values]
        if value not in known:
            raise ValueError(f"{name} must be one of {', '.join(known)}, got {value!r}")
    return view.sel(polarization=polarization, subband=subband)
