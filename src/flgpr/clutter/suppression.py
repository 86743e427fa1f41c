"""Model-based suppression: fit what lies under a mask by the forward model and subtract it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from flgpr.types import ArrayLike, ComplexArray, Float32Array, FloatArray


class Operator(Protocol):
    """What suppression needs of an imaging operator: A and its exact transpose."""

    def adjoint(self, data: ArrayLike) -> ComplexArray:
        """Apply A^H."""

    def forward(self, image: ArrayLike) -> ComplexArray:
        """Apply A."""


@dataclass(frozen=True)
class Suppression:
    """Outcome of a suppression."""

    #: (..., polarization, pair, frequency): data less the modelled response
    data: ComplexArray
    #: weighted norm of what the fit leaves over that of the data, 1 before the first iteration
    residual: FloatArray


def suppress_by_model(
    data: ArrayLike,
    operator: Operator,
    iterations: int = 10,
    weight: ArrayLike | None = None,
    spared: ArrayLike | None = None,
) -> Suppression:
    """Subtract the best fit of data by reflectivities under a mask.

    Minimises ``||w (b - A x)||`` over the reflectivity x of the operator's pixels, which are the
    mask, by conjugate gradients on the normal equations (Hestenes and Stiefel 1952), stopped after
    a few iterations: what converges first is what is strong under the mask. This is the
    least-squares form of Fuse et al. 2018, Eq. 5-6; it needs no amplitude B. The iterates are those
    of LSQR (Paige and Saunders 1982) on A restricted to the mask. The residual never rises.

    Parameters
    ----------
    data : (..., polarization, pair, frequency) array_like of complex
        Received field b; leading axes as the operator takes them.
    operator : imaging operator
        A on the pixels of the mask alone, one band, no window; and on those that are spared.
    iterations : int
        Number of iterations.
    weight : (frequency,) array_like, optional
        w, a taper over the band: it keeps strong echoes far from the mask, such as the direct
        coupling between antennas, from leaking into the fit. Default: one.
    spared : (...,) array_like of bool, optional
        Pixels of the operator that are fitted and not subtracted, such as the road's. What they
        explain is then not taken for a response of the mask that is not orthogonal to theirs.
        Default: none.

    Returns
    -------
    Suppression
        The cleaned data and the residual of every iteration.

    Raises
    ------
    ValueError
        If there is no iteration, or ``spared`` does not have the shape of the pixels.

    Examples
    --------
    A bright bush beside the lane is fitted and subtracted; a mine outside the mask keeps the level
    that it has alone.

    >>> import numpy as np
    >>> from flgpr.clutter import suppress_by_model
    >>> from flgpr.imaging import ImagingOperator
    >>> frequency = 0.5e9 + 10e6 * np.arange(101)
    >>> rx = np.column_stack([np.linspace(-0.8, 0.8, 9), np.zeros(9), np.full(9, 1.5)])
    >>> tx = np.zeros((9, 3)) + [0.0, 0.0, 1.5]
    >>> def at(x):
    ...     return ImagingOperator(frequency, tx, rx, [[[x, 5.0, 0.0]]], dtype="complex128")
    >>> scatterer = np.ones((1, 1, 1, 1))
    >>> bush = 10 * at(1.5).forward(scatterer)
    >>> mine = at(0.0).forward(scatterer)
    >>> cleaned = suppress_by_model(bush + mine, at(1.5), iterations=5).data
    >>> def level(data):  # at the bush and at the mine, over 9 pairs and 101 tones
    ...     return [round(abs(at(x).adjoint(data).item()) / 909, 2) for x in (1.5, 0.0)]
    >>> level(bush + mine), level(mine), level(cleaned)
    ([10.02, 1.3], [0.06, 1.0], [0.0, 1.0])
    """
    if iterations < 1:
        raise ValueError(f"iterations must be at least 1, got {iterations}")
    remainder = np.array(data, dtype=np.complex64)
    spared_pixels = None if spared is None else np.asarray(spared, dtype=np.float32)
    w = np.ones(1, np.float32) if weight is None else np.asarray(weight, dtype=np.float32)
    norm = np.sqrt(_power(w * remainder))
    residuals = [1.0]
    gradient = operator.adjoint(w * w * remainder)
    if spared_pixels is not None and spared_pixels.shape != gradient.shape[2:]:
        raise ValueError(
            f"spared must have the shape of the pixels, {gradient.shape[2:]}, "
            f"got {spared_pixels.shape}"
        )
    if spared_pixels is not None and not spared_pixels.any():
        spared_pixels = None  # saves the forward model of an empty image

    spared_image = np.zeros_like(gradient)
    for step, left in _fit_steps(remainder, operator, iterations, w, gradient):
        remainder = left
        if spared_pixels is not None:
            spared_image += spared_pixels * step
        residuals.append(float(np.sqrt(_power(w * remainder)) / norm))

    if spared_pixels is not None:
        remainder = (remainder + operator.forward(spared_image)).astype(np.complex64)
    return Suppression(remainder, np.asarray(residuals))


def fit_by_model(data: ArrayLike, operator: Operator, iterations: int = 8) -> ComplexArray:
    """Return the reflectivity that explains data, by the steps of :func:`suppress_by_model`.

    Parameters
    ----------
    data : (polarization, pair, frequency) array_like of complex
        Received field b.
    operator : imaging operator
        A on the pixels, one band, no window.
    iterations : int
        Number of iterations. What the array sees well comes first, noise where it hardly sees last.

    Returns
    -------
    (polarization, 1, ...) ndarray of complex64
        The reflectivity x.
    """
    signal = np.asarray(data, dtype=np.complex64)
    w = np.ones(1, np.float32)
    gradient = operator.adjoint(signal)
    image = np.zeros_like(gradient)
    for step, _ in _fit_steps(signal, operator, iterations, w, gradient):
        image += step
    return image


def _fit_steps(
    data: ComplexArray, operator: Operator, iterations: int, w: Float32Array, gradient: ComplexArray
) -> Iterator[tuple[ComplexArray, ComplexArray]]:
    """Yield by what every iteration changes the reflectivity, and the data that remain.

    The gradient is that of the data, ``A^H w² b``.
    """
    remainder = data
    direction = gradient
    power = _power(gradient)
    for _ in range(iterations):
        if power == 0.0:
            return
        response = operator.forward(direction)
        step = np.float32(power / _power(w * response))
        remainder = (remainder - step * response).astype(np.complex64)
        yield step * direction, remainder
        gradient = operator.adjoint(w * w * remainder)
        last_power = power
        power = _power(gradient)
        direction = gradient + np.float32(power / last_power) * direction


def _power(array: ComplexArray) -> float:
    """Sum the squared magnitudes in double precision."""
    return float(np.sum(np.abs(array.astype(np.complex128)) ** 2))
