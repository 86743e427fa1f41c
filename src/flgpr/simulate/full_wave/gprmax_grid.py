"""What a full-wave model is made of: its grid, points put on the nodes around them, soils as relaxing media."""

from __future__ import annotations

import itertools
import math
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import nnls

from flgpr.model.arrays import FloatArray
from flgpr.simulate.ground.soil import VACUUM_PERMITTIVITY


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

        Each component lies on its own lattice, half a cell off along its axis, so that dipoles in
        different directions at one point would sit at different places if they were snapped to the
        grid. Spread, they sit at the point: with ten cells per wavelength a wave loses at most 0.4
        % of its amplitude per axis, and no phase. The weights of a component sum to the vector's
        part along it.
        """
        place = self.local(point) / self.cell
        points = []
        for axis, (component, part) in enumerate(
            zip("xyz", np.asarray(direction, dtype=np.float64), strict=True)
        ):
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


_TOLERANCE = (0.002, 0.03)  # of ε' and of ε'', before another pole is tried


class RelaxingMedium(NamedTuple):
    """``ε∞ + Σ Δε/(1 + jωτ) - jσ/(ωε0)``, poles being pairs of Δε and τ.

    Errors are the largest over the band, of ε' relative to it, of ε'' relative to the larger of ε''
    and ε'/1000.
    """

    permittivity: float
    conductivity: float
    poles: tuple[tuple[float, float], ...]
    error_real: float
    error_loss: float

    def __call__(self, frequency: ArrayLike) -> NDArray[np.complex128]:
        """Complex permittivity at frequencies (Hz), in their shape."""
        omega = 2 * np.pi * np.asarray(frequency, dtype=np.float64)
        total = self.permittivity - 1j * self.conductivity / (omega * VACUUM_PERMITTIVITY)
        return np.asarray(total + sum(d / (1 + 1j * omega * tau) for d, tau in self.poles))


def fit_relaxation(
    frequency: ArrayLike, permittivity: ArrayLike, shortest: float, most_poles: int = 3
) -> RelaxingMedium:
    """Fit a relaxing medium to a permittivity ε' - jε'' over a band; ε' from 1, ε'' not negative.

    As few Debye poles as bring ε' within 0.2 % and ε'' within 3 %, by least squares with no
    negative part, over a grid of relaxation times from ``shortest`` on, which the solver's time
    step allows. A medium so fitted is causal and passive; outside the band it means nothing.
    """
    f = np.atleast_1d(np.asarray(frequency, float))
    eps = np.atleast_1d(np.asarray(permittivity, complex))
    if (eps.imag > 1e-12).any() or (eps.real < 1).any():
        raise ValueError(
            f"permittivity must have ε' >= 1 and no negative loss, got {eps[np.argmax(eps.imag)]:g}"
        )
    longest = 10 / (2 * math.pi * f.min())
    times = np.geomspace(shortest, max(longest, 1.01 * shortest), 25)
    best = _solve(f, eps, ())
    for count in range(1, most_poles + 1):
        if best.error_real <= _TOLERANCE[0] and best.error_loss <= _TOLERANCE[1]:
            break
        step = 1 if count < 3 else 3
        tries = (_solve(f, eps, chosen) for chosen in itertools.combinations(times[::step], count))
        best = min((best, *tries), key=_badness)
    return best


def _badness(medium: RelaxingMedium) -> float:
    return max(medium.error_real / _TOLERANCE[0], medium.error_loss / _TOLERANCE[1])


def _solve(
    f: NDArray[np.float64], eps: NDArray[np.complex128], times: tuple[float, ...]
) -> RelaxingMedium:
    omega = 2 * np.pi * f
    # ε∞ is 1 plus something, so that no part may be negative.
    columns = [np.ones(f.size, complex), -1j / (omega * VACUUM_PERMITTIVITY)]
    columns += [1 / (1 + 1j * omega * tau) for tau in times]
    matrix = np.stack(columns, axis=1)
    loss = np.maximum(-eps.imag, 1e-3 * eps.real)
    weight = np.concatenate([1 / (_TOLERANCE[0] * eps.real), 1 / (_TOLERANCE[1] * loss)])
    size = np.concatenate([[1.0, VACUUM_PERMITTIVITY * omega.mean()], np.ones(len(times))])
    rows = np.concatenate([matrix.real, matrix.imag]) * size
    wanted = np.concatenate([eps.real - 1, eps.imag])
    part = nnls(rows * weight[:, None], wanted * weight)[0] * size
    poles = tuple((float(d), float(t)) for d, t in zip(part[2:], times, strict=True) if d > 0)
    medium = RelaxingMedium(1 + float(part[0]), float(part[1]), poles, 0.0, 0.0)
    error = medium(f) - eps
    return medium._replace(
        error_real=float((np.abs(error.real) / eps.real).max()),
        error_loss=float((np.abs(error.imag) / loss).max()),
    )
