"""The background of images in memory, step by step (Wang et al. 2007, Sec. II-A, Eq. 2-5).

A detection does not come here: it takes :class:`flgpr.clutter.BackgroundEstimator`
(``clutter/estimator.py``) scan by scan, whose steps these functions take for all scans at once.

With v_k = m_k exp(iθ_k) the image of scan k, of one polarization and sub-band, μ_k and σ_k the mean
and the standard deviation of m_k over its pixels, and r_k the rms of the lowest 75 % of m_k:

- B1 = 1/N Σ_k 1/r_k min[m_k, μ_k + 5σ_k] exp(iθ_k)  (Eq. 2) is :func:`self_signature`,
- m'_k = |v_k/r_k - B1|  (Eq. 3) is filtered, first by the median and then by the mean, in
- B2 = 1/N Σ_k m'_k  (Eq. 4), which is :func:`gain_background`, and
- m''_k = |(v_k/r_k - B1)/B2|  (Eq. 5) is the modulus of :func:`remove_background`.

Both are patterns of the radar, fixed in the scan frame and independent of where the vehicle is.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np

from flgpr.clutter.estimator import (
    BackgroundEstimator,
    SelfSignature,
    check_method,
    check_windows,
    clean,
    mean_filtered,
    measure,
    smoothed_residual,
)
from flgpr.kernels.background import subtract_and_divide
from flgpr.types import AnyArray, ComplexArray, Float32Array, FloatArray


def _in_subbands(image: AnyArray) -> ComplexArray:
    """Return an image (..., y, x) with all its channels as sub-bands of one polarization."""
    return np.asarray(image, np.complex64).reshape(1, -1, *np.shape(image)[-2:])


def scan_gain(image: ComplexArray) -> FloatArray:
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
    v_k = _in_subbands(image)
    r_k, _ = measure(v_k, slice(None), v_k.shape)
    return r_k.reshape(*image.shape[:-2], 1, 1)


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
    estimator = BackgroundEstimator(method=method)
    shape: tuple[int, ...] | None = None
    for v_k in images:
        estimator.add_signature(_in_subbands(v_k))
        shape = np.shape(v_k)
    if shape is None:
        raise ValueError("images must hold at least one scan, got none")
    return estimator.signature().reshape(shape)


def gain_background(
    images: Iterable[ComplexArray],
    signature: ComplexArray,
    median_size: tuple[int, int] = (21, 21),
    mean_size: tuple[int, int] = (51, 51),
) -> Float32Array:
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
    B1 = _in_subbands(signature)
    total: Any = 0.0
    count = 0
    for image in images:
        v_k = _in_subbands(image)
        r_k, _ = measure(v_k, slice(None), B1.shape)
        total = total + smoothed_residual(v_k, r_k, B1, median_size, 1)
        count += 1
    if not count:
        raise ValueError("images must hold at least one scan, got none")
    return mean_filtered(total / count, B1.shape, mean_size, 1).reshape(signature.shape)


def remove_background(
    image: ComplexArray, signature: ComplexArray, gain: Float32Array
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
    level = np.asarray(gain, np.float32)
    v_k, B1 = _in_subbands(image), _in_subbands(signature)
    cleaned = clean(subtract_and_divide, np.complex64, v_k, scan_gain(image), B1, level)
    return cleaned.reshape(np.shape(image))
