"""What a full-wave model is made of: its grid, points on the nodes around them, relaxing media."""

from __future__ import annotations

import itertools
import math
from typing import Any, NamedTuple

import numpy as np
from scipy.optimize import nnls

from flgpr.simulate.ground.soil import VACUUM_PERMITTIVITY
from flgpr.types import ArrayLike, BoolArray, Complex128Array, FloatArray, floats

# Errors of ε' and of ε'' at which no further pole is tried.
_TOLERANCE_REAL = 0.002
_TOLERANCE_LOSS = 0.03
_MOST_POLES = 3


def numbers(*values: float) -> str:
    """Return numbers as the input files write them."""
    return " ".join(f"{value:.9g}" for value in values)


class GridPoint(NamedTuple):
    """One component of the field at one node, and its weight.

    The component lies half a cell along its own axis (Yee 1966).
    """

    component: str
    node: tuple[int, int, int]
    weight: float


class CellGrid(NamedTuple):
    """A box of cubic cells in the lane frame."""

    origin: tuple[float, float, float]  #: lane coordinates of node (0, 0, 0), m
    cell: float  #: edge of a cell, m
    shape: tuple[int, int, int]
    absorber: int  #: cells of the absorbing layer on every side

    @property
    def size(self) -> FloatArray:
        """Edges of the box, m, shape (3,)."""
        return floats(self.shape) * self.cell

    @property
    def time_step(self) -> float:
        """Largest stable time step of cubic cells in air, s."""
        return self.cell / (299_792_458.0 * math.sqrt(3.0))

    def local(self, point: ArrayLike) -> FloatArray:
        """Return points (..., 3) of the lane in the box's own coordinates, m."""
        return floats(point) - np.asarray(self.origin)

    def contains(self, point: ArrayLike, reach: float = 0.0) -> bool:
        """Return whether a point lies inside the absorbing layers, with all around it.

        Parameters
        ----------
        point : array_like (3,)
            In the lane frame, m; its height does not count.
        reach : float
            Distance around it, across, m.
        """
        xy = self.local(point)[:2]
        edge = self.absorber * self.cell + reach
        return bool((xy >= edge).all() and (xy <= self.size[:2] - edge).all())

    def spread(self, point: ArrayLike, direction: ArrayLike) -> list[GridPoint]:
        """Return a vector at a point of the lane as components on nodes around it.

        Each component lies on its own lattice, half a cell off along its axis, so that dipoles in
        different directions at one point would sit at different places if they were snapped to the
        grid. Spread by cubic interpolation, they sit at the point: with ten cells per wavelength a
        wave loses at most 0.4 % of its amplitude per axis, and no phase. The weights of a component
        sum to the vector's component along it.
        """
        in_cells = self.local(point) / self.cell
        vector = floats(direction)
        points = []
        for axis, component in enumerate("xyz"):
            size = vector[axis]
            if abs(size) < 1e-9:
                continue
            # Rounded, so that a position on a node is one.
            on_lattice = np.round(in_cells - 0.5 * (np.arange(3) == axis), 9)
            in_x, in_y, in_z = (_cubic(float(coordinate)) for coordinate in on_lattice)
            for (i, u), (j, v), (k, w) in itertools.product(in_x, in_y, in_z):
                points.append(GridPoint(component, (i, j, k), float(size * u * v * w)))
        return points


def _cubic(position: float) -> list[tuple[int, float]]:
    """Return the four nodes around a position, in cells, with their weights of Lagrange's cubic.

    A position on a node has this node alone.
    """
    first = math.floor(position)
    t = position - first
    if t == 0:
        return [(first, 1.0)]
    weights = (
        -t * (t - 1) * (t - 2) / 6,
        (t + 1) * (t - 1) * (t - 2) / 2,
        -(t + 1) * t * (t - 2) / 2,
        (t + 1) * t * (t - 1) / 6,
    )
    return list(enumerate(weights, start=first - 1))


def rectangles(mask: BoolArray) -> list[tuple[int, int, int, int]]:
    """Return rectangles that cover the true cells of a mask, each cell once.

    Parameters
    ----------
    mask : ndarray (i, j) of bool
        The cells.

    Returns
    -------
    list of tuple
        Half-open (i_0, i_1, j_0, j_1).
    """
    # Runs of true cells that rows have in common, by the row where they begin.
    open_runs: dict[tuple[int, int], int] = {}
    covered = []
    closing_row = np.zeros(mask.shape[1], bool)
    for i, row in enumerate([*mask, closing_row]):
        padded = np.concatenate([[False], row, [False]]).astype(np.int8)
        edges = np.flatnonzero(np.diff(padded))
        runs = {(int(first), int(last)) for first, last in edges.reshape(-1, 2)}
        for run, start in list(open_runs.items()):
            if run not in runs:
                covered.append((start, i, *run))
                del open_runs[run]
        for run in sorted(runs):
            open_runs.setdefault(run, i)
    return covered


class RelaxingMedium(NamedTuple):
    """A medium of permittivity ``ε∞ + Σ Δε/(1 + jωτ) - jσ/(ωε0)``.

    Poles are pairs of Δε and τ, s; the conductivity is in S/m. Errors are the largest over the
    band, of ε' relative to it, of ε'' relative to the larger of ε'' and ε'/1000.
    """

    permittivity: float
    conductivity: float
    poles: tuple[tuple[float, float], ...]
    error_real: float
    error_loss: float

    def __call__(self, frequency: ArrayLike) -> Complex128Array:
        """Return the complex permittivity at frequencies (Hz), in their shape."""
        omega = 2 * np.pi * floats(frequency)
        total = self.permittivity - 1j * self.conductivity / (omega * VACUUM_PERMITTIVITY)
        relaxing: Any = 0
        for delta, tau in self.poles:
            relaxing = relaxing + delta / (1 + 1j * omega * tau)
        return np.asarray(total + relaxing)

    def excess(self) -> float:
        """Return the greater of both errors over their tolerances."""
        return max(self.error_real / _TOLERANCE_REAL, self.error_loss / _TOLERANCE_LOSS)


def fit_relaxation(
    frequency: ArrayLike, permittivity: ArrayLike, shortest: float
) -> RelaxingMedium:
    """Fit a relaxing medium to a permittivity ε' - jε'' over a band.

    It has as few Debye poles as bring ε' within 0.2 % and ε'' within 3 %, by least squares without
    negative terms, over a grid of relaxation times. A medium so fitted is causal and passive;
    outside the band it means nothing.

    Parameters
    ----------
    frequency : array_like
        Frequencies of the band, Hz.
    permittivity : array_like of complex
        ε' from 1 on, ε'' not negative.
    shortest : float
        Shortest relaxation time, s, that the solver's time step allows.

    Raises
    ------
    ValueError
        If the permittivity is below 1 or has a negative loss.
    """
    f = np.atleast_1d(np.asarray(frequency, float))
    eps = np.atleast_1d(np.asarray(permittivity, complex))
    if (eps.imag > 1e-12).any() or (eps.real < 1).any():
        raise ValueError(
            f"permittivity must have ε' >= 1 and no negative loss, got {eps[np.argmax(eps.imag)]:g}"
        )
    longest = 10 / (2 * math.pi * f.min())
    times = np.geomspace(shortest, max(longest, 1.01 * shortest), 25)
    best = _fit_terms(f, eps, ())
    for count in range(1, _MOST_POLES + 1):
        if best.excess() <= 1:
            break
        # Triples of all times would be too many.
        candidates = times[:: 1 if count < 3 else 3]
        fits = (_fit_terms(f, eps, chosen) for chosen in itertools.combinations(candidates, count))
        best = min((best, *fits), key=RelaxingMedium.excess)
    return best


def _fit_terms(f: FloatArray, eps: Complex128Array, times: tuple[float, ...]) -> RelaxingMedium:
    """Fit a medium with poles at given relaxation times, s."""
    omega = 2 * np.pi * f
    # ε∞ is 1 plus a term, so that no term may be negative.
    columns = [np.ones(f.size, complex), -1j / (omega * VACUUM_PERMITTIVITY)]
    columns += [1 / (1 + 1j * omega * tau) for tau in times]
    matrix = np.stack(columns, axis=1)
    loss = np.maximum(-eps.imag, 1e-3 * eps.real)
    weight = np.concatenate([1 / (_TOLERANCE_REAL * eps.real), 1 / (_TOLERANCE_LOSS * loss)])
    size = np.concatenate([[1.0, VACUUM_PERMITTIVITY * omega.mean()], np.ones(len(times))])
    rows = np.concatenate([matrix.real, matrix.imag]) * size
    target = np.concatenate([eps.real - 1, eps.imag])
    constant, conductivity, *deltas = nnls(rows * weight[:, None], target * weight)[0] * size
    poles = tuple((float(d), float(tau)) for d, tau in zip(deltas, times, strict=True) if d > 0)
    medium = RelaxingMedium(1 + float(constant), float(conductivity), poles, 0.0, 0.0)
    error = medium(f) - eps
    return medium._replace(
        error_real=float((np.abs(error.real) / eps.real).max()),
        error_loss=float((np.abs(error.imag) / loss).max()),
    )
