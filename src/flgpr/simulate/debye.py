"""Soils as relaxing media: the form in which time-domain solvers take a permittivity that changes with frequency."""

from __future__ import annotations

import itertools
import math
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import nnls

from flgpr.simulate.soil import VACUUM_PERMITTIVITY

_TOLERANCE = (0.002, 0.03)  # of ε' and of ε'', before another pole is tried


class RelaxingMedium(NamedTuple):
    """``ε∞ + Σ Δε/(1 + jωτ) - jσ/(ωε0)``, poles being pairs of Δε and τ.

    Errors are the largest over the band, of ε' relative to it, of ε'' relative to the larger of ε'' and ε'/1000.
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

    As few Debye poles as bring ε' within 0.2 % and ε'' within 3 %, by least squares with no negative part, over a grid
    of relaxation times from ``shortest`` on, which the solver's time step allows. A medium so fitted is causal and
    passive; outside the band it means nothing.
    """
    f, eps = np.atleast_1d(np.asarray(frequency, float)), np.atleast_1d(np.asarray(permittivity, complex))
    if (eps.imag > 1e-12).any() or (eps.real < 1).any():
        raise ValueError(f"permittivity must have ε' >= 1 and no negative loss, got {eps[np.argmax(eps.imag)]:g}")
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


def _solve(f: NDArray[np.float64], eps: NDArray[np.complex128], times: tuple[float, ...]) -> RelaxingMedium:
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
        error_real=float((np.abs(error.real) / eps.real).max()), error_loss=float((np.abs(error.imag) / loss).max())
    )
