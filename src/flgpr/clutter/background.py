"""The background by the paper, to read and compare with (Wang et al. 2007, Sec. II-A, Eq. 2-5).

With v_k = m_k exp(iθ_k) the image of scan k, of one polarization and sub-band, μ_k and σ_k the mean
and the standard deviation of m_k over its pixels, and r_k the rms of the lowest 75 % of m_k:

- B1 = 1/N Σ_k 1/r_k min[m_k, μ_k + 5σ_k] exp(iθ_k)  (Eq. 2) is :func:`self_signature`,
- m'_k = |v_k/r_k - B1|  (Eq. 3) is filtered, first by the median and then by the mean, in
- B2 = 1/N Σ_k m'_k  (Eq. 4), which is :func:`gain_background`, and
- m''_k = |(v_k/r_k - B1)/B2|  (Eq. 5) is the modulus of :func:`remove_background`.

Both are patterns of the radar, fixed in the scan frame and independent of where the vehicle is.
A detection runs :mod:`flgpr.clutter.streaming`, which computes the same for all channels at once,
with one scan in memory at a time; its loops over pixels are in :mod:`flgpr.kernels.background`.
"""

from __future__ import annotations

from collections.abc import Iterable
from itertools import chain, islice
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from flgpr.kernels.filters import mean_filter, median_filter

ComplexArray = NDArray[np.complex64]
SelfSignature = Literal["none", "mean", "median"]


def check_method(method: str) -> None:
    """Refuse an unknown method of estimating the self-signature."""
    if method not in get_args(SelfSignature):
        raise ValueError(f"self_signature method must be none, mean or median, got {method!r}")


def check_windows(median_size: tuple[int, int], mean_size: tuple[int, int]) -> None:
    """Refuse windows (y, x) of the gain background whose sides are not odd numbers of pixels."""
    for name, size in (("median_size", median_size), ("mean_size", mean_size)):
        if any(n < 1 or n % 2 == 0 for n in size):
            raise ValueError(f"{name} must be odd numbers of pixels, got {size}")


def check_gain(gain: NDArray[np.float64]) -> None:
    """Refuse a scan without a gain r_k."""
    if not (np.isfinite(gain).all() and (gain > 0).all()):
        raise ValueError(
            "image must be finite and not zero everywhere to have a gain, "
            f"got a gain of {gain.min()}"
        )


def scan_gain(image: ComplexArray) -> NDArray[np.float64]:
    """Compute the scan-to-scan gain r_k, the rms of the lowest 75 % of the magnitudes.

    The gain is defined below Eq. 2 of Wang et al. 2007.

    Parameters
    ----------
    image : (..., y, x) ndarray of complex
        Scan image.

    Returns
    -------
    (..., 1, 1) ndarray
        Gain of every channel, in units of the image.

    Raises
    ------
    ValueError
        If a channel is zero or not finite.
    """
    magnitude = np.sort(np.abs(image).reshape(*image.shape[:-2], -1).astype(np.float64), axis=-1)
    lowest = magnitude[..., : max(1, int(0.75 * magnitude.shape[-1]))]
    r_k = np.sqrt(np.mean(lowest**2, axis=-1))
    check_gain(r_k)
    return np.asarray(r_k[..., None, None])


def self_signature(images: Iterable[ComplexArray], method: SelfSignature = "mean") -> ComplexArray:
    """Estimate the self-signature B1 of a run (Wang et al. 2007, Eq. 2).

    Parameters
    ----------
    images : iterable of (..., y, x) ndarray of complex
        Scan images of a run, at least two unless the method is "none".
    method : {"none", "mean", "median"}
        "mean" is Eq. 2: the mean of the images with magnitudes clipped at μ + 5σ. "median" takes
        the median of the real and of the imaginary part, which a target that is elsewhere in the
        other scans does not enter; it holds all images in memory. "none" is zero: for windows that
        keep the direct coupling out of sight.

    Returns
    -------
    (..., y, x) ndarray of complex
        B1, in units of the scan gain.

    Raises
    ------
    ValueError
        If the method is unknown, there are too few scans, or an image has no gain.

    Examples
    --------
    What is the same in every scan makes up the self-signature. A target that passes through counts
    in the mean by its share of the scans, and not at all in the median.

    >>> import numpy as np
    >>> from flgpr.clutter import self_signature
    >>> images = np.full((8, 5, 5), 2.0 + 0.0j)
    >>> images[3, 2, 2] += 16.0  # in one of eight scans
    >>> signature = self_signature(images)
    >>> robust = self_signature(images, method="median")
    >>> round(float(abs(signature[2, 2] / signature[0, 0])), 2)
    2.0
    >>> round(float(abs(robust[2, 2] / robust[0, 0])), 2)
    1.0
    """
    check_method(method)
    scans = iter(images)
    first = list(islice(scans, 2))
    if not first:
        raise ValueError("images must hold at least one scan, got none")
    if method == "none":
        return np.zeros(np.shape(first[0]), np.complex64)
    if len(first) == 1:
        raise ValueError(
            f"self_signature by {method} needs at least two scans, got one: "
            "it would be all of the image"
        )
    scans = chain(first, scans)
    if method == "median":
        return complex_median(np.stack([v_k / scan_gain(v_k) for v_k in scans]))
    total = np.zeros(np.shape(first[0]), np.complex128)
    count = 0
    for v_k in scans:
        m_k = np.abs(v_k).astype(np.float64)
        limit = m_k.mean(axis=(-2, -1), keepdims=True) + 5 * m_k.std(axis=(-2, -1), keepdims=True)
        clipped = v_k * np.minimum(1.0, limit / np.maximum(m_k, np.finfo(np.float64).tiny))
        total += clipped / scan_gain(v_k)
        count += 1
    return (total / count).astype(np.complex64)


def complex_median(stack: NDArray[Any]) -> ComplexArray:
    """Compute the median of the real and of the imaginary part over the first axis."""
    return np.asarray(
        np.median(stack.real, axis=0) + 1j * np.median(stack.imag, axis=0), dtype=np.complex64
    )


def gain_background(
    images: Iterable[ComplexArray],
    signature: ComplexArray,
    median_size: tuple[int, int] = (21, 21),
    mean_size: tuple[int, int] = (51, 51),
) -> NDArray[np.float32]:
    """Estimate the gain background B2 of a run (Wang et al. 2007, Eq. 3 and 4).

    The paper does not say how it filters at the border; here both windows shrink there to the
    pixels that exist.

    Parameters
    ----------
    images : iterable of (..., y, x) ndarray of complex
        Scan images of a run, at least one.
    signature : (..., y, x) ndarray of complex
        Self-signature B1 of the same run, in units of the scan gain.
    median_size, mean_size : tuple of int
        Windows (y, x) of the two filters, odd numbers of pixels; the paper's are 1 m and 2.5 m at
        5 cm.

    Returns
    -------
    (..., y, x) ndarray of float32
        B2, in units of the scan gain, positive everywhere.

    Raises
    ------
    ValueError
        If a window is not odd, there is no scan, or B2 is zero at a pixel.
    """
    check_windows(median_size, mean_size)
    total = np.zeros(signature.shape)
    count = 0
    for v_k in images:
        m_k = np.abs(v_k / scan_gain(v_k) - signature)  # Eq. 3
        channels = m_k.reshape(-1, *m_k.shape[-2:])
        smooth = [mean_filter(median_filter(m, median_size), mean_size) for m in channels]
        total += np.stack(smooth).reshape(m_k.shape)
        count += 1
    if not count:
        raise ValueError("images must hold at least one scan, got none")
    B2 = total / count
    if not (B2 > 0).all():
        raise ValueError(
            "gain background must be positive everywhere, got zero: "
            "the images equal their self-signature"
        )
    return B2.astype(np.float32)


def remove_background(
    image: ComplexArray, signature: ComplexArray, gain: NDArray[np.float32]
) -> ComplexArray:
    """Subtract the self-signature B1 of an image and divide by the gain background B2.

    Parameters
    ----------
    image, signature : (..., y, x) ndarray of complex
        Scan image, and B1 in units of the scan gain.
    gain : (..., y, x) ndarray of float
        B2, in units of the scan gain.

    Returns
    -------
    (..., y, x) ndarray of complex
        Cleaned image; its modulus, in units of the background, is Eq. 5 of Wang et al. 2007.

    Raises
    ------
    ValueError
        If the image is zero or not finite.
    """
    return ((image / scan_gain(image) - signature) / gain).astype(np.complex64)
