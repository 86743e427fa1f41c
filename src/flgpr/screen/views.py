"""The run-view: all scan images of a run brought together in the lane frame (Wang et al. 2007, Sec. II-B)."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from flgpr.kernels.sampling import bilinear
from flgpr.model import Grid, lane_to_scan, scan_to_lane


def sample_scan(image: xr.DataArray, points: NDArray[np.float64]) -> NDArray[np.float32]:
    """Sample the magnitude of a scan image (..., y, x) at points (..., 2 or 3) of its frame, m; NaN outside."""
    grid = grid_of(image)
    row, column = (points[..., 1] - grid.y_min) / grid.dy, (points[..., 0] - grid.x_min) / grid.dx
    return bilinear(np.abs(image.values), row, column)


def seen_along(grid: Grid, pose: NDArray[np.float64], y_max: float) -> tuple[float, float]:
    """Tell which part of the lane a scan with this grid and pose sees up to ``y_max``: first and last y, m."""
    along = scan_to_lane(grid.corners(y_max), pose)[:, 1]
    return float(along.min()), float(along.max())


class Samples(NamedTuple):
    """What a scan shows of some pixels of the lane."""

    values: NDArray[np.float32]  #: magnitudes (..., y, x)
    seen: NDArray[np.bool_]  #: where they are known
    whole: NDArray[np.bool_]  #: where all channels are known (y, x): there a pixel counts as seen
    local: NDArray[np.float64]  #: places in the scan frame (y, x, 3), m


class LaneSums:
    """Samples of all scans at the pixels of the lane; what becomes of them is told by the kind of look.

    ``y_max`` is the farthest distance ahead of the array that counts, m; ``rows`` of the grid are kept, for a part of
    the lane, by default all.
    """

    def __init__(self, grid: Grid, y_max: float, rows: slice | None = None) -> None:
        self.grid = grid
        self.y_max = y_max
        self._window = range(grid.ny)[rows] if rows is not None else range(grid.ny)
        self._points = np.zeros((len(self._window), grid.nx, 3))
        self._points[..., 0] = grid.x[None, :]
        self._points[..., 1] = grid.y[self._window.start : self._window.stop, None]
        self._looks = np.zeros(self._points.shape[:2], np.int64)
        self._kept: dict[str, NDArray[Any]] = {}

    def add(self, magnitude: NDArray[np.float32], grid: Grid, pose: NDArray[np.float64]) -> None:
        """Take in one scan: magnitudes (..., y, x) on a grid of the scan frame, and its pose (6,)."""
        if not self._kept:
            self._kept = self._begin(magnitude.shape[:-2])
        reached = self.reach(grid, pose)
        start = self._window.start
        rows = slice(max(reached.start - start, 0), max(reached.stop - start, 0))
        local = lane_to_scan(self._points[rows], pose)
        row, column = (local[..., 1] - grid.y_min) / grid.dy, (local[..., 0] - grid.x_min) / grid.dx
        values = bilinear(magnitude, row, column).astype(np.float32)
        values[..., local[..., 1] > self.y_max] = np.nan
        seen = np.isfinite(values)
        whole = np.asarray(seen.all(axis=tuple(range(seen.ndim - 2))))
        self._looks[rows] += whole
        self._take(
            {name: one[..., rows, :] for name, one in self._kept.items()},
            Samples(values, seen, whole, local),
        )

    def result(self) -> tuple[NDArray[np.float32], NDArray[np.int64]]:
        """Compute the run-view (..., y, x), NaN where no scan sees the pixel, and the number of looks (y, x)."""
        view = self._view(self._gathered())
        return np.where(self._looks > 0, view, np.nan).astype(np.float32), self._looks

    def state(self) -> dict[str, NDArray[Any]]:
        """Give what was gathered, with ``looks`` (y, x) and ``row``, the first row, to be taken in by another."""
        return {**self._gathered(), "looks": self._looks, "row": np.array(self._window.start)}

    def merge(self, state: Mapping[str, NDArray[Any]]) -> None:
        """Take in what another gathered of other scans of the same lane, as far as it lies in the rows kept here."""
        gathered = {name: state[name] for name in state if name not in ("looks", "row")}
        if not self._kept:
            self._kept = self._begin(self._channels(gathered))
        start = int(state["row"]) - self._window.start
        rows = slice(max(start, 0), max(start + len(state["looks"]), 0))
        theirs = slice(rows.start - start, rows.start - start + len(self._looks[rows]))
        self._looks[rows] += state["looks"][theirs]
        own = {name: one[..., rows, :] for name, one in self._kept.items()}
        self._fold(own, {name: one[..., theirs, :] for name, one in gathered.items()})

    def reach(self, grid: Grid, pose: NDArray[np.float64]) -> slice:
        """Tell which rows of the whole run-view a scan with these pixels can reach."""
        low, high = seen_along(grid, pose, self.y_max + grid.dy)
        first = math.floor((low - self.grid.y_min) / self.grid.dy)
        last = math.ceil((high - self.grid.y_min) / self.grid.dy) + 1
        return slice(min(max(first, 0), self.grid.ny), min(max(last, 0), self.grid.ny))

    def _gathered(self) -> dict[str, NDArray[Any]]:
        if not self._kept:
            raise ValueError("images must hold at least one scan, got none")
        return self._kept

    def _channels(self, gathered: Mapping[str, NDArray[Any]]) -> tuple[int, ...]:
        """Tell the leading shape of the magnitudes from what another gathered of them."""
        return next(iter(gathered.values())).shape[:-2]

    def _begin(self, channels: tuple[int, ...]) -> dict[str, NDArray[Any]]:
        """Make the arrays (..., y, x) that gather."""
        raise NotImplementedError

    def _take(self, kept: Mapping[str, NDArray[Any]], samples: Samples) -> None:
        """Take in a scan's samples of some rows."""
        raise NotImplementedError

    def _fold(self, own: Mapping[str, NDArray[Any]], theirs: Mapping[str, NDArray[Any]]) -> None:
        """Take in what another gathered of the same rows."""
        raise NotImplementedError

    def _view(self, kept: Mapping[str, NDArray[Any]]) -> NDArray[Any]:
        """Make the run-view of what was gathered."""
        raise NotImplementedError


class RunViewSums(LaneSums):
    """The second largest magnitude at every pixel of the lane, to be rid of flashes (Wang et al. 2007, Sec. II-B).

    Where a single scan sees the pixel its value stands.
    """

    def _begin(self, channels: tuple[int, ...]) -> dict[str, NDArray[Any]]:
        shape = (*channels, *self._looks.shape)
        return {name: np.full(shape, -np.inf, np.float32) for name in ("first", "second")}

    def _take(self, kept: Mapping[str, NDArray[Any]], samples: Samples) -> None:
        values = np.where(samples.seen, samples.values, -np.inf)
        np.maximum(kept["second"], np.minimum(kept["first"], values), out=kept["second"])
        np.maximum(kept["first"], values, out=kept["first"])

    def _fold(self, own: Mapping[str, NDArray[Any]], theirs: Mapping[str, NDArray[Any]]) -> None:
        np.maximum(own["second"], theirs["second"], out=own["second"])
        np.maximum(own["second"], np.minimum(own["first"], theirs["first"]), out=own["second"])
        np.maximum(own["first"], theirs["first"], out=own["first"])

    def _view(self, kept: Mapping[str, NDArray[Any]]) -> NDArray[Any]:
        return np.where(self._looks > 1, kept["second"], kept["first"])


class MeanViewSums(LaneSums):
    """The mean over the scans that see a pixel; of log-likelihoods their fusion as if looks were independent.

    A look weighs as :func:`look_weight` tells, of its distance.
    """

    def __init__(
        self, grid: Grid, y_max: float, rows: slice | None = None, falloff: float = 0.0
    ) -> None:
        super().__init__(grid, y_max, rows)
        self.falloff = falloff

    def _begin(self, channels: tuple[int, ...]) -> dict[str, NDArray[Any]]:
        return {
            "sum": np.zeros((*channels, *self._looks.shape)),
            "weight": np.zeros(self._looks.shape),
        }

    def _take(self, kept: Mapping[str, NDArray[Any]], samples: Samples) -> None:
        distance = np.hypot(samples.local[..., 0], samples.local[..., 1])
        weight = np.where(samples.whole, look_weight(distance, self.falloff), 0.0)
        kept["sum"][...] += weight * np.where(samples.whole, samples.values, 0.0)
        kept["weight"][...] += weight

    def _fold(self, own: Mapping[str, NDArray[Any]], theirs: Mapping[str, NDArray[Any]]) -> None:
        own["sum"][...] += theirs["sum"]
        own["weight"][...] += theirs["weight"]

    def _view(self, kept: Mapping[str, NDArray[Any]]) -> NDArray[Any]:
        return kept["sum"] / np.where(self._looks > 0, kept["weight"], 1.0)


def look_weight(distance: NDArray[np.float64], falloff: float) -> NDArray[np.float64]:
    """Weigh looks by distances, m: their power -``falloff``; what is nearer than a metre counts as a metre off."""
    return np.asarray(np.maximum(distance, 1.0) ** -falloff)


class RangeViewSums(LaneSums):
    """One view per distance ahead: at every pixel the scan that sees it nearest to that distance (flsar2004, Sec. 2).

    ``ranges`` are the distances ahead of the array, ``within`` how far from its distance a scan may see a pixel, m.
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

    def _begin(self, channels: tuple[int, ...]) -> dict[str, NDArray[Any]]:
        shape = (*channels, len(self.ranges), *self._looks.shape)
        return {"value": np.full(shape, np.nan, np.float32), "off": np.full(shape[-3:], np.inf)}

    def _channels(self, gathered: Mapping[str, NDArray[Any]]) -> tuple[int, ...]:
        return gathered["value"].shape[:-3]

    def _take(self, kept: Mapping[str, NDArray[Any]], samples: Samples) -> None:
        off = np.abs(samples.local[..., 1] - np.reshape(self.ranges, (-1, 1, 1)))
        off = np.where(samples.whole & (off <= self.within), off, np.inf)
        self._fold(kept, {"value": samples.values[..., None, :, :], "off": off})

    def _fold(self, own: Mapping[str, NDArray[Any]], theirs: Mapping[str, NDArray[Any]]) -> None:
        nearer = theirs["off"] < own["off"]  # of equally near scans the first stays
        own["value"][...] = np.where(nearer, theirs["value"], own["value"])
        own["off"][...] = np.minimum(own["off"], theirs["off"])

    def _view(self, kept: Mapping[str, NDArray[Any]]) -> NDArray[Any]:
        return kept["value"]


def run_view(images: Iterable[xr.DataArray], grid: Grid, y_max: float) -> xr.DataArray:
    """Bring scan images together: the second largest magnitude over the scans that see a pixel.

    Second largest, to be rid of spurious bright pixels; where a single scan sees the pixel, its
    value stands.

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
    return view_array(
        result,
        looks,
        grid,
        {str(n): template[n].values for n in template.dims if n not in ("y", "x")},
    )


def view_array(
    view: NDArray[np.float32],
    looks: NDArray[np.int64],
    grid: Grid,
    channels: Mapping[str, Any],
    rows: slice | None = None,
) -> xr.DataArray:
    """Attach coordinates to a run-view (..., y, x) and its looks (y, x): names and labels of the leading dimensions.

    ``rows`` of the grid, in the lane frame, are those that the run-view holds, by default all.
    """
    return xr.DataArray(
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


def grid_of(image: xr.DataArray) -> Grid:
    """Tell the pixels of an image (..., y, x) by its axes."""
    y = image["y"].values
    x = image["x"].values
    return Grid(float(x[0]), float(y[0]), x.size, y.size, float(x[1] - x[0]), float(y[1] - y[0]))


def select(view: xr.DataArray, polarization: str, subband: str) -> xr.DataArray:
    """Take one polarization and sub-band of a run-view (polarization, subband, y, x), which must have them."""
    for name, value in (("polarization", polarization), ("subband", subband)):
        known: Sequence[str] = [str(label) for label in view[name].values]
        if value not in known:
            raise ValueError(f"{name} must be one of {', '.join(known)}, got {value!r}")
    return view.sel(polarization=polarization, subband=subband)
