"""The grid of a full-wave model: where it lies in the lane, and how a point between its nodes is put on them."""

from __future__ import annotations

import itertools
import math
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flgpr.model.arrays import FloatArray


class GridPoint(NamedTuple):
    """One component of the field at one node, and its weight; it lies half a cell along its own axis (Yee 1966)."""

    component: str
    node: tuple[int, int, int]
    weight: float


class Grid(NamedTuple):
    """A box of cubic cells in the lane frame."""

    origin: tuple[float, float, float]  #: lane coordinates of node (0, 0, 0), m
    cell: float  #: edge of a cell, m
    shape: tuple[int, int, int]
    absorber: int  #: cells of the absorbing layer on every side

    @property
    def size(self) -> FloatArray:
        """Edges of the box, m, shape (3,)."""
        return np.asarray(self.shape, dtype=np.float64) * self.cell

    @property
    def time_step(self) -> float:
        """Largest stable time step of cubic cells in air, s."""
        return self.cell / (299_792_458.0 * math.sqrt(3.0))

    def local(self, point: ArrayLike) -> FloatArray:
        """Take points (..., 3) from the lane to the box's own coordinates, m."""
        return np.asarray(point, dtype=np.float64) - np.asarray(self.origin)

    def contains(self, point: ArrayLike, reach: float = 0.0) -> bool:
        """Tell whether a point (3,) with all within ``reach`` (m) of it across lies inside the absorbing layers."""
        at = self.local(point)[:2]
        edge = self.absorber * self.cell + reach
        return bool((at >= edge).all() and (at <= self.size[:2] - edge).all())

    def spread(self, point: ArrayLike, direction: ArrayLike) -> list[GridPoint]:
        """Put a vector at a point of the lane on the components around it, by cubic interpolation.

        Each component lies on its own lattice, half a cell off along its axis, so that dipoles in different directions
        at one point would sit at different places if they were snapped to the grid. Spread, they sit at the point: with
        ten cells per wavelength a wave loses at most 0.4 % of its amplitude per axis, and no phase. The weights of a
        component sum to the vector's part along it.
        """
        place = self.local(point) / self.cell
        points = []
        for axis, (component, part) in enumerate(zip("xyz", np.asarray(direction, dtype=np.float64), strict=True)):
            if abs(part) < 1e-9:
                continue
            at = np.round(place - 0.5 * (np.arange(3) == axis), 9)
            for (i, u), (j, v), (k, w) in itertools.product(*(_cubic(float(p)) for p in at)):
                points.append(GridPoint(component, (i, j, k), float(part * u * v * w)))
        return points


def _cubic(place: float) -> list[tuple[int, float]]:
    """Give the four nodes around a place, in cells, their weights of Lagrange's cubic; a node alone is itself."""
    first = math.floor(place)
    t = place - first
    if t == 0:
        return [(first, 1.0)]
    weights = (
        -t * (t - 1) * (t - 2) / 6,
        (t + 1) * (t - 1) * (t - 2) / 2,
        -(t + 1) * t * (t - 2) / 2,
        (t + 1) * t * (t - 1) / 6,
    )
    return [(first + k - 1, weight) for k, weight in enumerate(weights)]


def rectangles(mask: NDArray[np.bool_]) -> list[tuple[int, int, int, int]]:
    """Cover the true cells of a mask (i, j) by rectangles, each cell once: half-open (i_0, i_1, j_0, j_1)."""
    open_runs: dict[tuple[int, int], int] = {}
    found = []
    for i, row in enumerate([*mask, np.zeros(mask.shape[1], bool)]):
        edges = np.flatnonzero(np.diff(np.concatenate([[False], row, [False]]).astype(np.int8)))
        runs = {(int(a), int(b)) for a, b in edges.reshape(-1, 2)}
        for (a, b), start in list(open_runs.items()):
            if (a, b) not in runs:
                found.append((start, i, a, b))
                del open_runs[(a, b)]
        for run in sorted(runs):
            open_runs.setdefault(run, i)
    return found
