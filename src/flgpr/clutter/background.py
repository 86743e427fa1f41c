"""Self-signature and gain background (Wang et al. 2007, Sec. II-A).

Both are patterns of the radar, fixed in the scan frame and independent of where the vehicle is, so they are estimated
over the scans of a run, for each polarization and sub-band on its own.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from flgpr.kernels.filters import mean_filter, median_filter

ComplexArray = NDArray[np.complex64]
SelfSignature = Literal["none", "mean", "median"]


def scan_gain(image: ComplexArray) -> NDArray[np.float64]:
    """Scan-to-scan gain r_k: rms of the lowest 75 % of the magnitudes (Wang et al. 2007, below Eq. 2).

    Parameters
    ----------
    image : (..., y, x) ndarray of complex
        Images of one scan.

    Returns
    -------
    (..., 1, 1) ndarray
        Gain of every image.

    Raises
    ------
    ValueError
        If an image is zero or not finite, so that it has no gain.
    """
    magnitude = np.sort(np.abs(image).reshape(*image.shape[:-2], -1).astype(np.float64), axis=-1)
    lowest = magnitude[..., : max(1, int(0.75 * magnitude.shape[-1]))]
    gain = np.sqrt(np.mean(lowest**2, axis=-1))
    if not (np.isfinite(gain).all() and (gain > 0).all()):
        raise ValueError(f"image must be finite and not zero everywhere to have a gain, got a gain of {gain.min()}")
    return np.asarray(gain[..., None, None])


def self_signature(images: Iterable[ComplexArray], method: SelfSignature = "mean") -> ComplexArray:
    """Estimate the self-signature B1, in units of the scan gain.

    Parameters
    ----------
    images : iterable of (..., y, x) ndarray of complex
        Scan images of a run.
    method : {"none", "mean", "median"}
        "mean" is Eq. 2 of Wang et al. 2007: the mean of the images with magnitudes clipped at μ + 5σ. "median" takes
        the median of the real and of the imaginary part, which a target that is elsewhere in the other scans does not
        enter; it holds all images in memory. "none" is zero: for windows that keep the direct coupling out of sight.

    Returns
    -------
    (..., y, x) ndarray of complex64
        B1.

    Raises
    ------
    ValueError
        If there is no image, only one and the method is not "none", or the method is unknown.

    Examples
    --------
    What stays in place from scan to scan is the self-signature; a target that passes through enters it with its share
    only.

    >>> import numpy as np
    >>> from flgpr.clutter import self_signature
    >>> images = np.full((8, 5, 5), 2.0 + 0.0j)
    >>> images[3, 2, 2] += 16.0  # in one of eight scans
    >>> signature = self_signature(images)
    >>> robust = self_signature(images, method="median")
    >>> [round(float(abs(one[2, 2] / one[0, 0])), 2) for one in (signature, robust)]
    [2.0, 1.0]
    """
    if method not in ("none", "mean", "median"):
        raise ValueError(f"self_signature method must be none, mean or median, got {method!r}")
    total: NDArray[np.complex128] | None = None
    stack: list[NDArray[np.complex128]] = []
    count = 0
    for image in images:
        if method == "none":
            return np.zeros(np.shape(image), np.complex64)
        scaled = _clipped(image) / scan_gain(image)
        if method == "median":
            stack.append(np.asarray(image / scan_gain(image), dtype=np.complex128))
        total = scaled if total is None else total + scaled
        count += 1
    if total is None:
        raise ValueError("images must hold at least one scan, got none")
    if count == 1:
        raise ValueError(f"self_signature by {method} needs at least two scans, got one: it would be all of the image")
    if method == "median":
        together = np.stack(stack)
        return (np.median(together.real, axis=0) + 1j * np.median(together.imag, axis=0)).astype(np.complex64)
    return (total / count).astype(np.complex64)


def gain_background(
    images: Iterable[ComplexArray],
    signature: ComplexArray,
    median_size: tuple[int, int] = (21, 21),
    mean_size: tuple[int, int] = (51, 51),
) -> NDArray[np.float32]:
    """Estimate the gain background B2 (Wang et al. 2007, Eq. 3 and 4).

    The paper does not say how it filters at the border; here both windows shrink there to the pixels that exist.

    Parameters
    ----------
    images : iterable of (..., y, x) ndarray of complex
        Scan images of a run.
    signature : (..., y, x) ndarray of complex
        B1 from :func:`self_signature`.
    median_size, mean_size : tuple of int
        Windows (y, x) in pixels, odd; the paper's are 1 m and 2.5 m at 5 cm.

    Returns
    -------
    (..., y, x) ndarray of float32
        B2, positive.

    Raises
    ------
    ValueError
        If a window is not odd, there is no image, or the background vanishes somewhere.
    """
    for name, size in (("median_size", median_size), ("mean_size", mean_size)):
        if any(n < 1 or n % 2 == 0 for n in size):
            raise ValueError(f"{name} must be odd numbers of pixels, got {size}")
    total: NDArray[np.float64] | None = None
    count = 0
    for image in images:
        magnitude = np.abs(image / scan_gain(image) - signature)
        flat = magnitude.reshape(-1, *magnitude.shape[-2:])
        smooth = np.stack([mean_filter(median_filter(one, median_size), mean_size) for one in flat])
        smooth = smooth.reshape(magnitude.shape)
        total = smooth if total is None else total + smooth
        count += 1
    if total is None:
        raise ValueError("images must hold at least one scan, got none")
    background = total / count
    if not (background > 0).all():
        raise ValueError("gain background must be positive everywhere, got zero: the images equal their self-signature")
    return background.astype(np.float32)


def remove_background(image: ComplexArray, signature: ComplexArray, gain: NDArray[np.float32]) -> ComplexArray:
    """Subtract the self-signature and divide by the gain background; the modulus is Wang et al. 2007, Eq. 5.

    Parameters
    ----------
    image : (..., y, x) ndarray of complex
        Scan image.
    signature : (..., y, x) ndarray of complex
        B1.
    gain : (..., y, x) ndarray
        B2.

    Returns
    -------
    (..., y, x) ndarray of complex64
        Cleaned image, in units of the background.
    """
    return ((image / scan_gain(image) - signature) / gain).astype(np.complex64)


def _clipped(image: ComplexArray) -> NDArray[np.complex128]:
    magnitude = np.abs(image).astype(np.float64)
    limit = magnitude.mean(axis=(-2, -1), keepdims=True) + 5 * magnitude.std(axis=(-2, -1), keepdims=True)
    factor = np.minimum(1.0, limit / np.maximum(magnitude, np.finfo(np.float64).tiny))
    return np.asarray(image * factor, dtype=np.complex128)
