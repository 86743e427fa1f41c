"""Spectral windows at any position in a band, so that tones may be missing or uneven."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


def boxcar(position: FloatArray) -> FloatArray:
    """Return equal weights of all tones; ``position`` in [-1, 1] across the band."""
    return np.ones_like(position)


def hann(position: FloatArray) -> FloatArray:
    """Return a raised cosine that is zero at the band edges; ``position`` is in [-1, 1]."""
    return np.asarray(np.cos(np.pi * position / 2) ** 2, dtype=np.float64)


def hamming(position: FloatArray) -> FloatArray:
    """Return a raised cosine on a pedestal of 0.08; ``position`` in [-1, 1] across the band."""
    return np.asarray(0.54 + 0.46 * np.cos(np.pi * position), dtype=np.float64)


def taylor(position: FloatArray, nbar: int = 4, sidelobe_db: float = 35.0) -> FloatArray:
    """Return weights for ``nbar`` sidelobes ``sidelobe_db`` below the peak of one (Taylor 1955)."""
    a = np.arccosh(10 ** (sidelobe_db / 20)) / np.pi
    sigma2 = nbar**2 / (a**2 + (nbar - 0.5) ** 2)
    orders = np.arange(1, nbar)
    coefficients = np.empty(nbar - 1)
    for i, m in enumerate(orders):
        remaining = orders[orders != m]
        numerator = (-1) ** (m + 1) * np.prod(1 - m**2 / sigma2 / (a**2 + (orders - 0.5) ** 2))
        coefficients[i] = numerator / (2 * np.prod(1 - m**2 / remaining**2))
    weight = 1 + 2 * np.cos(np.pi * orders * position[:, None]) @ coefficients
    return np.asarray(weight / (1 + 2 * coefficients.sum()), dtype=np.float64)


def ramp(frequency: FloatArray) -> FloatArray:
    """Return weights in proportion to the tones (Hz), with a maximum of one.

    This is filtered backprojection.

    Aspects and tones sample the ground's wavenumber plane in polar coordinates, where the area of a
    sample is ``k dk dθ``: the inverse transform, the image, is the backprojection of data weighed
    by ``k ∝ f``. It holds for data whose amplitude does not depend on frequency otherwise.
    """
    return np.asarray(frequency / frequency.max(), dtype=np.float64)


WINDOWS: dict[str, Callable[[FloatArray], FloatArray]] = {
    "boxcar": boxcar,
    "hann": hann,
    "hamming": hamming,
    "taylor": taylor,
}


def band_weights(
    frequency: FloatArray,
    subbands: tuple[tuple[float, float], ...],
    window: Callable[[FloatArray], FloatArray],
) -> FloatArray:
    """Return the weights (subband, tone); a band without a tone is a row of zeros.

    ``frequency`` (tone,) Hz; each sub-band takes the tones in [lo, hi], edges included to one part
    in a million, and spreads the window from its first to its last tone.
    """
    weights = np.zeros((len(subbands), frequency.size))
    for row, (lo, hi) in zip(weights, subbands, strict=True):
        slack = 1e-6 * hi
        inside = (frequency >= lo - slack) & (frequency <= hi + slack)
        if not inside.any():
            continue
        tones = frequency[inside]
        centre = (tones[0] + tones[-1]) / 2
        half = (tones[-1] - tones[0]) / 2
        row[inside] = window((tones - centre) / half if half > 0 else np.zeros(1))
    return weights
