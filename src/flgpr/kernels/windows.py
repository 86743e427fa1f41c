"""Spectral windows at any position in a band, so that tones may be missing or uneven."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from flgpr.types import FloatArray


def boxcar(position: FloatArray) -> FloatArray:
    """Return equal weights of all tones; ``position`` in [-1, 1] across the band."""
    return np.ones_like(position)


def hann(position: FloatArray) -> FloatArray:
    """Return a raised cosine that is zero at the band edges; ``position`` is in [-1, 1]."""
    return np.cos(np.pi * position / 2) ** 2


def hamming(position: FloatArray) -> FloatArray:
    """Return a raised cosine on a pedestal of 0.08; ``position`` in [-1, 1] across the band."""
    return 0.54 + 0.46 * np.cos(np.pi * position)


def taylor(position: FloatArray, nbar: int = 4, sidelobe_db: float = 35.0) -> FloatArray:
    """Return the weights of a Taylor window, whose peak is one (Taylor 1955).

    Parameters
    ----------
    position : (tone,) ndarray
        Positions across the band, in [-1, 1].
    nbar : int
        Number of sidelobes of nearly equal height next to the main lobe.
    sidelobe_db : float
        Height of these sidelobes below the main lobe, dB.
    """
    a = np.arccosh(10 ** (sidelobe_db / 20)) / np.pi
    # Stretch of the first zeros, so that they meet those of a uniform band at zero number nbar.
    sigma2 = nbar**2 / (a**2 + (nbar - 0.5) ** 2)
    orders = np.arange(1, nbar)

    # F_m = (-1)^(m+1) Π_n (1 - m²/σ²/(a² + (n - 1/2)²)) / (2 Π_{n≠m} (1 - m²/n²))
    coefficients = np.empty(nbar - 1)
    for i, m in enumerate(orders):
        other_orders = orders[orders != m]
        zeros = np.prod(1 - m**2 / sigma2 / (a**2 + (orders - 0.5) ** 2))
        numerator = (-1) ** (m + 1) * zeros
        coefficients[i] = numerator / (2 * np.prod(1 - m**2 / other_orders**2))

    weight = 1 + 2 * np.cos(np.pi * orders * position[:, None]) @ coefficients
    return weight / (1 + 2 * coefficients.sum())


def ramp(frequency: FloatArray) -> FloatArray:
    """Return weights in proportion to the tones (Hz), with a maximum of one.

    This is filtered backprojection.

    Aspects and tones sample the ground's wavenumber plane in polar coordinates, where the area of a
    sample is ``k dk dθ``: the inverse transform, the image, is the backprojection of data weighed
    by ``k ∝ f``. It holds for data whose amplitude does not depend on frequency otherwise.
    """
    return frequency / frequency.max()


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
    """Return the weights of the tones in every sub-band.

    A window reaches from the first to the last tone of its sub-band.

    Parameters
    ----------
    frequency : (tone,) ndarray
        Frequencies in increasing order, Hz.
    subbands : tuple of (float, float)
        Lowest and highest frequency of every sub-band, Hz; tones on the edges, to one part in a
        million, belong to it.
    window : callable
        Weights at positions in [-1, 1], one of ``WINDOWS``.

    Returns
    -------
    (subband, tone) ndarray
        Weights; a band without a tone is a row of zeros.
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
        if half > 0:
            position = (tones - centre) / half
        else:
            position = np.zeros(1)  # a single tone is the centre of its band
        row[inside] = window(position)
    return weights
