"""Iterated model-based suppression with an amplitude per sub-region (Fuse et al. 2018, Eq. 5-8 and Table II)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flgpr.clutter.suppression import Operator

ComplexArray = NDArray[np.complex64]
OperatorOn = Callable[[NDArray[np.float64]], Operator]

TABLE_II: dict[int, tuple[int, ...]] = {0: (0,), 1: (1, 2), 2: (2, 3), 3: (3, 4), 4: (4, 5), 5: (5, 6), 6: (6, 7)}
"""Iterations whose images each combination averages (Table II); 0 is the original."""
_ROUNDING = 1e-3


@dataclass(frozen=True)
class Iterated:
    """Course of an iterated suppression."""

    data: tuple[ComplexArray, ...]  #: (..., polarization, pair, frequency): data after 0, 1, ... iterations
    #: (iteration + 1, polarization): norm of the cleaned data over that of the data, of the iterations kept
    residual: NDArray[np.float64]
    amplitude: NDArray[np.float64]  #: (iteration, region, polarization): B of Eq. 7
    asked: int  #: number of iterations asked for
    #: relative rise of the residual at which the iteration was stopped; None if it ran to its end
    rise: float | None = None

    @property
    def iterations(self) -> int:
        """Number of iterations kept."""
        return len(self.data) - 1

    def told(self) -> str:
        """Say in words how the iteration ended."""
        if self.rise is None:
            return f"{self.iterations} iterations, residual {self.residual[-1].max():.3f}"
        return (
            f"stopped after {self.iterations} of {self.asked} iterations: the next would have raised the residual by "
            f"{100 * self.rise:.2g} %"
        )


def iterate_suppression(
    data: ArrayLike,
    operator_on: OperatorOn,
    pixels: ArrayLike,
    mask: ArrayLike,
    region: ArrayLike,
    iterations: int = 7,
) -> Iterated:
    """Suppress what lies under a mask by iterating Eq. 5 to 8 of Fuse et al. 2018.

    With m_r the part of the mask in sub-region r, an iteration takes x = A^H b and ``x̂_r = m_r∘x``, and subtracts, all
    at once, ``B_r b̂_r`` with ``b̂_r = A x̂_r`` (Eq. 5) and ``B_r = max|x̂_r| / max|x'_2|``, ``x'_2 = A^H b̂_r`` (Eq. 7
    and 8), the second maximum over all pixels of the sub-region. The paper wants B "in each sub-region area,
    respectively"; here each B_r is made of its own sub-region's response alone, so that sidelobes of a strong one do
    not enter.

    The iteration is stable while the spectrum of ``Σ B_r m_r A^H A m_r`` lies within 0 to 2, which Eq. 7 does not
    warrant. The residual of every polarization is watched: an iteration that would raise one is dropped, none
    follows, and the result says so. Watched is ``|b - r|² - |b|²`` in double precision against ``|r|²``, r being what
    is subtracted, so that echoes outside the mask, however strong, hide no rise.

    Parameters
    ----------
    data : (..., polarization, pair, frequency) array_like of complex
        Received field b; leading axes as the operators take them.
    operator_on : callable
        Gives A, one band without a window, on any pixels (pixel, 3).
    pixels : (y, x, 3) array_like
        Pixel centres, m.
    mask, region : (y, x) array_like of bool, of int
        Where to suppress, and the sub-region of every pixel: -1 for none, which the mask must not hold.
    iterations : int
        How many.
    """
    points, chosen, part = np.asarray(pixels, dtype=np.float64), np.asarray(mask, dtype=bool), np.asarray(region)
    if iterations < 1:
        raise ValueError(f"iterations must be at least 1, got {iterations}")
    if chosen.shape != points.shape[:-1] or part.shape != chosen.shape:
        raise ValueError(
            f"mask and region must have the shape of the pixels, {points.shape[:-1]}, got {chosen.shape} and "
            f"{part.shape}"
        )
    if (part[chosen] < 0).any():
        raise ValueError(f"mask must lie within the sub-regions, got {int((part[chosen] < 0).sum())} pixels outside")
    b = np.array(data, dtype=np.complex64)
    used = np.unique(part[chosen])
    under = [points[chosen & (part == r)] for r in used]
    on_mask = operator_on(np.concatenate(under)) if under else None
    on_mask_of = {int(r): operator_on(one) for r, one in zip(used, under, strict=True)}
    on_region = {int(r): operator_on(points[part == r]) for r in used}
    ends = np.cumsum([len(one) for one in under])[:-1]
    rise: float | None = None
    start = _norms(b)
    kept, course = [b], [np.where(start > 0, 1.0, 0.0)]
    amplitudes = np.zeros((iterations, int(part.max(initial=-1)) + 1, b.shape[-3]))
    for B in amplitudes:
        subtracted = np.zeros_like(b)
        masked = [] if on_mask is None else np.split(on_mask.adjoint(b), ends, axis=-1)
        for r, x_hat in zip(on_mask_of, masked, strict=True):
            b_hat = on_mask_of[r].forward(x_hat)  # Eq. 5
            x_2 = on_region[r].adjoint(b_hat)  # Eq. 8
            B[r] = _ratio(_peaks(x_hat), _peaks(x_2))  # Eq. 7
            subtracted += B[r].astype(np.float32)[:, None, None] * b_hat
        change, size = _energy_change(b, subtracted)
        power = np.maximum(course[-1] ** 2 + _ratio(change, start**2), 0.0)
        if (change > _ROUNDING * size).any():
            rise = float((_ratio(np.sqrt(power), course[-1]) - 1).max())
            break
        b = (b - subtracted).astype(np.complex64)  # Eq. 6, whose image is x'
        kept.append(b)
        course.append(np.sqrt(power))
    return Iterated(tuple(kept), np.array(course), amplitudes[: len(kept) - 1].copy(), iterations, rise)


def averaged(course: Iterated, combination: int) -> ComplexArray:
    """Average the iterations of a combination of Table II, by its index in ``TABLE_II``.

    The mean of images is the image of the mean of their data, so that one image needs to be made. Where the iteration
    was stopped before, its last kept iteration stands in; one that would need more than were asked for is a ValueError.
    """
    if combination not in TABLE_II:
        raise ValueError(f"combination must be one of {', '.join(map(str, TABLE_II))}, got {combination}")
    wanted = TABLE_II[combination]
    if max(wanted) > course.asked:
        raise ValueError(f"combination {combination} needs {max(wanted)} iterations, got {course.asked}")
    last = course.iterations
    total = np.sum([course.data[min(i, last)] for i in wanted], axis=0)
    return np.asarray(total / len(wanted), dtype=np.complex64)


def equal_cost(course: Iterated, mask: NDArray[np.bool_], region: NDArray[np.int64]) -> int:
    """Count the least-squares iterations that cost no more than an iterated suppression, in pixels.

    An iteration of Eq. 5 to 8 images the mask, models it and images the sub-regions it touches; one of least squares
    images the mask and models it.
    """
    under = int(mask.sum())
    if under == 0:
        return 1
    area = int(np.isin(region, np.unique(region[mask])).sum())
    return max(1, course.asked * (2 * under + area) // (2 * under))


def _norms(data: ComplexArray) -> NDArray[np.float64]:
    """Norm of every polarization."""
    power = np.square(data.real, dtype=np.float64) + np.square(data.imag, dtype=np.float64)
    return np.asarray(np.sqrt(power.sum(axis=_but_polarization(data))))


def _energy_change(data: ComplexArray, response: ComplexArray) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Compute ``|b - r|² - |b|²`` and ``|r|²`` of every polarization."""
    size = _norms(response) ** 2
    overlap = np.multiply(data.real, response.real, dtype=np.float64)
    overlap += np.multiply(data.imag, response.imag, dtype=np.float64)
    return size - 2 * overlap.sum(axis=_but_polarization(data)), size


def _but_polarization(data: ComplexArray) -> tuple[int, ...]:
    return tuple(axis for axis in range(data.ndim) if axis != data.ndim - 3)


def _peaks(image: ComplexArray) -> NDArray[np.float64]:
    """Largest magnitude of every polarization; images are (polarization, subband, pixel)."""
    return np.abs(image).reshape(image.shape[0], -1).max(axis=1).astype(np.float64)


def _ratio(top: NDArray[np.float64], bottom: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.divide(top, bottom, out=np.zeros_like(top), where=bottom > 0)
