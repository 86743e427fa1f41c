"""Iterated model-based suppression with an amplitude per sub-region (Fuse et al. 2018).

It follows Eq. 5 to 8 and Table II.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np

from flgpr.clutter.suppression import Operator
from flgpr.types import ArrayLike, BoolArray, ComplexArray, FloatArray, IntArray, floats

OperatorOn = Callable[[FloatArray], Operator]
Amplitude = Literal["region", "whole"]

TABLE_II: dict[int, tuple[int, ...]] = {
    0: (0,),
    1: (1, 2),
    2: (2, 3),
    3: (3, 4),
    4: (4, 5),
    5: (5, 6),
    6: (6, 7),
}
"""Iterations whose images each combination averages (Table II); 0 is the original."""
_ROUNDING = 1e-3  # of the energy subtracted: smaller changes of the residual may be rounding


@dataclass(frozen=True)
class Iterated:
    """Outcome of an iterated suppression, iteration by iteration."""

    #: (..., polarization, pair, frequency): data after 0, 1, ... iterations
    data: tuple[ComplexArray, ...]
    #: (iteration + 1, polarization): norm of the cleaned data over that of the data
    residual: FloatArray
    #: (iteration, region, polarization): B of Eq. 7
    amplitude: FloatArray
    #: (iteration + 1, polarization): energy of the cleaned data less that of the data, over the
    #: latter
    energy: FloatArray
    #: (iteration, polarization): smallest change of ``energy`` that is more than rounding
    rounding: FloatArray

    @property
    def iterations(self) -> int:
        """Number of iterations."""
        return len(self.data) - 1

    @property
    def rise(self) -> float:
        """Largest relative rise of the residual from one iteration to the next, 0 without any."""
        rose = self._rises()
        if not rose.any():
            return 0.0
        relative_rise = _ratio(self.residual[1:], self.residual[:-1]) - 1
        return float(relative_rise[rose].max())

    @property
    def rises(self) -> int:
        """Number of iterations that raised the residual of a polarization."""
        return int(self._rises().any(axis=1).sum())

    def _rises(self) -> BoolArray:
        """Mark the iterations that raised the residual, (iteration, polarization)."""
        return np.asarray(np.diff(self.energy, axis=0) > self.rounding)

    def best(self, last: int) -> IntArray:
        """Return the iteration of the least residual up to ``last``, for every polarization.

        It is ``last`` itself if that is no worse within rounding. A residual that rose for a while
        and then fell below all earlier ones has done no harm: only the last one counts.
        """
        best = self.energy[: last + 1].argmin(axis=0)
        for polarization, least in enumerate(best):
            rounding = self.rounding[least:last, polarization].max(initial=0.0)
            if self.energy[last, polarization] <= self.energy[least, polarization] + rounding:
                best[polarization] = last
        return np.asarray(best, dtype=np.int64)

    @property
    def diverged(self) -> bool:
        """Whether the last iteration leaves more than an earlier one."""
        return bool((self.best(self.iterations) < self.iterations).any())

    def summary(self) -> str:
        """Return a sentence on the residual and whether it rose."""
        text = f"{self.iterations} iterations, residual {self.residual[-1].max():.3f}"
        if self.rises:
            text += f"; {self.rises} of them raised it, by up to {100 * self.rise:.2g} %"
        if self.diverged:
            least = ", ".join(str(number) for number in self.best(self.iterations))
            text += f"; the last is worse than iteration {least}"
        return text


def iterate_suppression(
    data: ArrayLike,
    operator_on: OperatorOn,
    pixels: ArrayLike,
    mask: ArrayLike,
    region: ArrayLike,
    iterations: int = 7,
    amplitude: Amplitude = "region",
) -> Iterated:
    """Suppress what lies under a mask by iterating Eq. 5 to 8 of Fuse et al. 2018.

    With m_r the part of the mask in sub-region r, an iteration takes x = A^H b and ``x̂_r =
    m_r∘x``, and subtracts, all at once, ``B_r b̂_r`` with ``b̂_r = A x̂_r`` (Eq. 5) and ``B_r =
    max|x̂_r| / max|x'_2|`` (Eq. 7), the second maximum over all pixels of the sub-region. The paper
    wants B "in each sub-region area, respectively", which can be read in two ways: ``x'_2 = A^H
    b̂_r`` (Eq. 8) of the sub-region's own response, so that sidelobes of a strong one elsewhere do
    not enter, or ``x'_2 = A^H Σ b̂_r`` of the whole response, the b̂ of Eq. 5 to the letter.

    The iteration is stable while the spectrum of ``Σ B_r m_r A^H A m_r`` lies within 0 to 2, which
    Eq. 7 does not warrant: B follows the one pixel that is strongest, and where another takes its
    place the residual can rise for an iteration and fall below all earlier ones afterwards. All
    iterations are therefore run, as in the paper, and the residual of every polarization is kept;
    :func:`averaged` falls back to the best iteration where all went wrong. The residual is followed
    by ``|b - r|² - |b|²`` in double precision against ``|r|²``, r being what is subtracted, so that
    echoes outside the mask, however strong, hide no rise.

    Parameters
    ----------
    data : (..., polarization, pair, frequency) array_like of complex
        Received field b; leading axes as the operators take them.
    operator_on : callable
        Makes A, one band without a window, on any pixels (pixel, 3).
    pixels : (y, x, 3) array_like
        Pixel centres, m.
    mask, region : (y, x) array_like of bool, of int
        Where to suppress, and the sub-region of every pixel: -1 for none, which the mask must not
        hold.
    iterations : int
        How many.
    amplitude : {"region", "whole"}
        Which response the second maximum of Eq. 7 is taken of: "region", ``b̂_r`` of the sub-region
        alone; "whole", ``b̂ = Σ b̂_r`` of all sub-regions, both over the sub-region's pixels.

    Returns
    -------
    Iterated
        The data, residual and amplitudes of every iteration.

    Raises
    ------
    ValueError
        If there is no iteration, the amplitude is unknown, the shapes differ, or the mask reaches
        beyond the sub-regions.
    """
    points = floats(pixels)
    masked = np.asarray(mask, dtype=bool)
    region_of = np.asarray(region)
    _check_masked_regions(points, masked, region_of, iterations, amplitude)

    b = np.array(data, dtype=np.complex64)
    regions = _MaskedRegions(operator_on, points, masked, region_of)
    start = _norms(b) ** 2
    cleaned = [b]
    energy = [np.zeros_like(start)]
    rounding = []
    amplitudes = np.zeros((iterations, int(region_of.max(initial=-1)) + 1, b.shape[-3]))
    for B in amplitudes:
        x_hat = regions.images(b)
        b_hat = {r: regions.on_mask[r].forward(x_hat[r]) for r in x_hat}  # Eq. 5
        all_regions = np.sum(list(b_hat.values()), axis=0) if amplitude == "whole" else None
        subtracted = np.zeros_like(b)
        for r in x_hat:
            response = b_hat[r] if all_regions is None else all_regions
            x_2 = regions.on_region[r].adjoint(response)  # Eq. 8
            B[r] = _ratio(_peaks(x_hat[r]), _peaks(x_2))  # Eq. 7
            subtracted += B[r].astype(np.float32)[:, None, None] * b_hat[r]

        change, size = _energy_change(b, subtracted)
        energy.append(energy[-1] + _ratio(change, start))
        rounding.append(_ROUNDING * _ratio(size, start))
        b = (b - subtracted).astype(np.complex64)  # Eq. 6, whose image is x'
        cleaned.append(b)
    residual = np.sqrt(np.maximum((start > 0) + np.array(energy), 0.0))
    return Iterated(tuple(cleaned), residual, amplitudes, np.array(energy), np.array(rounding))


class _MaskedRegions:
    """Imaging operators of the sub-regions that a mask touches."""

    def __init__(
        self,
        operator_on: OperatorOn,
        points: FloatArray,
        mask: BoolArray,
        region: IntArray,
    ) -> None:
        numbers = np.unique(region[mask])
        masked_points = [points[mask & (region == r)] for r in numbers]
        # One operator images all of the mask at once, which is quicker than region by region.
        self._on_all = operator_on(np.concatenate(masked_points)) if masked_points else None
        self._ends = np.cumsum([len(pixels_of_r) for pixels_of_r in masked_points])[:-1]
        self.on_mask: dict[int, Operator] = {}  # of the part of the mask in each sub-region
        self.on_region: dict[int, Operator] = {}  # of all pixels of each sub-region
        for r, pixels_of_r in zip(numbers, masked_points, strict=True):
            self.on_mask[int(r)] = operator_on(pixels_of_r)
            self.on_region[int(r)] = operator_on(points[region == r])

    def images(self, data: ComplexArray) -> dict[int, ComplexArray]:
        """Return the image x̂_r of data under the mask in every sub-region."""
        if self._on_all is None:
            return {}
        images = np.split(self._on_all.adjoint(data), self._ends, axis=-1)
        return dict(zip(self.on_mask, images, strict=True))


def _check_masked_regions(
    points: FloatArray,
    mask: BoolArray,
    region: IntArray,
    iterations: int,
    amplitude: str,
) -> None:
    """Refuse what :func:`iterate_suppression` cannot work on."""
    if iterations < 1:
        raise ValueError(f"iterations must be at least 1, got {iterations}")
    if amplitude not in ("region", "whole"):
        raise ValueError(f"amplitude must be region or whole, got {amplitude!r}")
    if mask.shape != points.shape[:-1] or region.shape != mask.shape:
        raise ValueError(
            f"mask and region must have the shape of the pixels, {points.shape[:-1]}, "
            f"got {mask.shape} and {region.shape}"
        )
    outside = int((region[mask] < 0).sum())
    if outside:
        raise ValueError(f"mask must lie within the sub-regions, got {outside} pixels outside")


def averaged(iterated: Iterated, combination: int, fall_back: bool = True) -> ComplexArray:
    """Average the iterations of a combination of Table II.

    The mean of images is the image of the mean of their data, so that one image needs to be made.

    Parameters
    ----------
    iterated : Iterated
        From :func:`iterate_suppression`.
    combination : int
        Index in ``TABLE_II``.
    fall_back : bool
        Whether the best iteration replaces the mean where the mean is worse, see
        :func:`fallen_back`; the paper always takes the mean.

    Returns
    -------
    (..., polarization, pair, frequency) ndarray of complex64
        Averaged data.

    Raises
    ------
    ValueError
        If there is no such combination, or it needs more iterations than there are.
    """
    numbers = _averaged_iterations(iterated, combination)
    total = np.sum([iterated.data[number] for number in numbers], axis=0)
    mean = np.asarray(total / len(numbers), dtype=np.complex64)
    if fall_back:
        for polarization, number in fallen_back(iterated, combination).items():
            mean[..., polarization, :, :] = iterated.data[number][..., polarization, :, :]
    return mean


def fallen_back(iterated: Iterated, combination: int) -> dict[int, int]:
    """Return the polarizations whose average of Table II is no good, with the iteration to use.

    An average is no good where its last iteration leaves more than an earlier one and so does the
    average itself. The latter counts because iterations that overshoot change sign from one to the
    next: each leaves more than was there, and the mean of two leaves little.

    Parameters
    ----------
    iterated : Iterated
        From :func:`iterate_suppression`.
    combination : int
        Index in ``TABLE_II``.

    Returns
    -------
    dict of int to int
        Best iteration by number of the polarization; empty if all averages are good.

    Raises
    ------
    ValueError
        If there is no such combination, or it needs more iterations than there are.
    """
    numbers = _averaged_iterations(iterated, combination)
    best = iterated.best(max(numbers))
    first = iterated.data[numbers[0]]
    last = iterated.data[numbers[-1]]
    # |(u + v)/2|² = (|u|² + |v|²)/2 - |u - v|²/4: the energies in it are those that strong echoes
    # elsewhere do not hide.
    difference = _ratio(_norms(last - first) ** 2, _norms(iterated.data[0]) ** 2)
    energy = iterated.energy[list(numbers)].mean(axis=0) - difference / 4
    replaced = {}
    for polarization, number in enumerate(best):
        average_is_worse = energy[polarization] > iterated.energy[number, polarization]
        if number < max(numbers) and average_is_worse:
            replaced[polarization] = int(number)
    return replaced


def _averaged_iterations(iterated: Iterated, combination: int) -> tuple[int, ...]:
    """Return the iterations that a combination averages, all of which must exist."""
    if combination not in TABLE_II:
        raise ValueError(
            f"combination must be one of {', '.join(map(str, TABLE_II))}, got {combination}"
        )
    numbers = TABLE_II[combination]
    if max(numbers) > iterated.iterations:
        raise ValueError(
            f"combination {combination} needs {max(numbers)} iterations, got {iterated.iterations}"
        )
    return numbers


def equal_cost(iterations: int, mask: BoolArray, region: IntArray) -> int:
    """Return the number of least-squares iterations of at most the cost of an iterated suppression.

    The cost is counted in pixels. An iteration of Eq. 5 to 8 images the mask, models it and images
    the sub-regions it touches; one of least squares images the mask and models it.

    Parameters
    ----------
    iterations : int
        Iterations of :func:`iterate_suppression`.
    mask, region : (y, x) ndarray of bool, of int
        As there.

    Returns
    -------
    int
        Iterations of :func:`suppress_by_model`, at least one.
    """
    mask_pixels = int(mask.sum())
    if mask_pixels == 0:
        return 1
    region_pixels = int(np.isin(region, np.unique(region[mask])).sum())
    return max(1, iterations * (2 * mask_pixels + region_pixels) // (2 * mask_pixels))


def _norms(data: ComplexArray) -> FloatArray:
    """Compute the norm of every polarization in double precision."""
    power = np.square(data.real, dtype=np.float64) + np.square(data.imag, dtype=np.float64)
    return np.asarray(np.sqrt(power.sum(axis=_all_but_polarization(data))))


def _energy_change(data: ComplexArray, response: ComplexArray) -> tuple[FloatArray, FloatArray]:
    """Compute ``|b - r|² - |b|²`` and ``|r|²`` of every polarization."""
    size = _norms(response) ** 2
    overlap = np.multiply(data.real, response.real, dtype=np.float64)
    overlap += np.multiply(data.imag, response.imag, dtype=np.float64)
    change = size - 2 * overlap.sum(axis=_all_but_polarization(data))
    return change, size


def _all_but_polarization(data: ComplexArray) -> tuple[int, ...]:
    """Return all axes of data (..., polarization, pair, frequency) but the polarization's."""
    return tuple(axis for axis in range(data.ndim) if axis != data.ndim - 3)


def _peaks(image: ComplexArray) -> FloatArray:
    """Return the largest magnitude of every polarization of (polarization, subband, pixel)."""
    return np.abs(image).reshape(image.shape[0], -1).max(axis=1).astype(np.float64)


def _ratio(numerator: FloatArray, denominator: FloatArray) -> FloatArray:
    """Divide, with zero where the denominator is not positive."""
    return np.divide(numerator, denominator, out=np.zeros_like(numerator), where=denominator > 0)
