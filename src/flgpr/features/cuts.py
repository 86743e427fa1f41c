"""Feature vectors of pixels: range cuts, or chips, of all channels (Cosgrove et al. 2004, III)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import xarray as xr
from scipy.ndimage import maximum_filter

from flgpr.kernels.correlate import chip_sums, chips
from flgpr.types import ArrayLike, BoolArray, ComplexArray, FloatArray, IntArray, floats

PAPER_CUT = (28, 1)
"""Pixels down-track and cross-track of the paper's range cut, at 2 cm."""


def stack_channels(
    image: xr.DataArray, channels: Sequence[str] | None = None
) -> tuple[ComplexArray, tuple[str, ...]]:
    """Stack the polarizations and sub-bands of an image as channels.

    Parameters
    ----------
    image : ([polarization,] [subband,] y, x) xarray.DataArray
        Image.
    channels : sequence of str, optional
        Channels to take, in this order; by default all, polarization by polarization.

    Returns
    -------
    stack : (channel, y, x) ndarray of complex64
        Channels.
    names : tuple of str
        "HH", or "HH 0.45-1.5" with the sub-band's name where the image has several sub-bands.

    Raises
    ------
    ValueError
        If the image has other dimensions or a channel is missing.
    """
    if set(image.dims) - {"polarization", "subband", "y", "x"} or not {"y", "x"} <= set(image.dims):
        raise ValueError(
            f"image must have the dimensions ([polarization,] [subband,] y, x), got {image.dims}"
        )
    missing_axes = [axis for axis in ("polarization", "subband") if axis not in image.dims]
    full = image.expand_dims(missing_axes).transpose("polarization", "subband", "y", "x")
    names = _channel_names(image)
    stack = full.values.reshape(len(names), *full.shape[-2:]).astype(np.complex64, copy=False)
    if channels is None:
        return stack, tuple(names)
    missing = [name for name in channels if name not in names]
    if missing:
        raise ValueError(
            f"channels must be among {', '.join(names)}; missing: {', '.join(missing)}"
        )
    return stack[[names.index(name) for name in channels]], tuple(channels)


def _channel_names(image: xr.DataArray) -> list[str]:
    """Return the names of all channels, polarization by polarization."""
    polarizations = ["image"]
    if "polarization" in image.dims:
        polarizations = [str(label) for label in image["polarization"].values]
    if "subband" not in image.dims or image.sizes["subband"] <= 1:
        return polarizations
    bands = [str(label) for label in image["subband"].values]
    return [f"{polarization} {band}" for polarization in polarizations for band in bands]


def cuts_at(
    image: ComplexArray, rows: ArrayLike, columns: ArrayLike, shape: tuple[int, int] = PAPER_CUT
) -> ComplexArray:
    """Return the feature vectors of pixels, which are the chips about them.

    The chip of pixel i reaches from ``i - n//2`` on over n pixels each way. Its samples are stacked
    channel by channel, row by row: with HH and VV a range cut is the paper's vector of HH then VV
    (Cosgrove et al. 2004, Fig. 5).

    Parameters
    ----------
    image : (channel, y, x) ndarray of complex64
        Image.
    rows, columns : (n_samples,) array_like of int
        Pixels.
    shape : tuple of int
        Pixels of a chip down-track and cross-track.

    Returns
    -------
    (n_samples, n_features) ndarray of complex64
        Feature vectors, NaN where the chip leaves the image.
    """
    first = _corners(rows, shape[0])
    second = _corners(columns, shape[1])
    features = image.shape[0] * shape[0] * shape[1]
    out = np.full((first.size, features), np.nan, dtype=np.complex64)
    inside = (first >= 0) & (second >= 0)
    inside &= (first + shape[0] <= image.shape[1]) & (second + shape[1] <= image.shape[2])
    if inside.any():
        out[inside] = chips(image, shape)[first[inside], second[inside]].reshape(-1, features)
    return out


def range_cuts(
    image: xr.DataArray,
    points: ArrayLike,
    shape: tuple[int, int] = PAPER_CUT,
    channels: Sequence[str] | None = None,
    search: float = 0.0,
) -> ComplexArray:
    """Return the feature vectors about points of an image.

    Parameters
    ----------
    image, channels
        As for :func:`stack_channels`.
    points : (n_samples, 2) array_like
        x and y in the image's frame, m; the nearest pixel is taken.
    shape : (int, int)
        Pixels of a chip down-track and cross-track.
    search : float
        Half side of the square, m, within which the chip with the most energy is taken instead: the
        position of a buried object in the image differs from the true one by refraction and by the
        survey's error.

    Returns
    -------
    (n_samples, n_features) ndarray of complex64
        Feature vectors, NaN where a chip leaves the image.

    Raises
    ------
    ValueError
        If ``search`` is negative, the image has other dimensions or a channel is missing.
    """
    if not search >= 0:
        raise ValueError(f"search must be at least 0, got {search}")
    stack, _ = stack_channels(image, channels)
    position = floats(points).reshape(-1, 2)
    x = image["x"].values
    y = image["y"].values
    rows = _nearest(y, position[:, 1])
    columns = _nearest(x, position[:, 0])
    if search > 0:
        reach = (
            int(search / abs(float(np.diff(y[:2])[0]))),
            int(search / abs(float(np.diff(x[:2])[0]))),
        )
        rows, columns = _strongest(stack, rows, columns, shape, reach)
    return cuts_at(stack, rows, columns, shape)


def clutter_cuts(
    image: ComplexArray,
    clean: BoolArray,
    shape: tuple[int, int] = PAPER_CUT,
    step: tuple[int, int] = (14, 8),
) -> ComplexArray:
    """Return the feature vectors of clutter: all chips on a lattice that hold clean pixels only.

    Parameters
    ----------
    image : (channel, y, x) ndarray of complex64
        Image.
    clean : (y, x) ndarray of bool
        Pixels without a target.
    shape, step : tuple of int
        Pixels of a chip, and from chip to chip, down-track and cross-track.

    Returns
    -------
    (n_samples, n_features) ndarray of complex64
        Feature vectors.

    Raises
    ------
    ValueError
        If the shapes differ or a step is less than one pixel.
    """
    if clean.shape != image.shape[1:]:
        raise ValueError(f"clean must have the image's shape {image.shape[1:]}, got {clean.shape}")
    if min(step) < 1:
        raise ValueError(f"step must be at least one pixel each way, got {step}")
    features = image.shape[0] * shape[0] * shape[1]
    if image.shape[1] < shape[0] or image.shape[2] < shape[1]:
        return np.empty((0, features), dtype=np.complex64)
    usable = clean & np.isfinite(image).all(axis=0)
    all_usable = chips(usable[None], shape)[:: step[0], :: step[1]].all(axis=(2, 3, 4))
    return chips(image, shape)[:: step[0], :: step[1]][all_usable].reshape(-1, features)


def clean_pixels(x: ArrayLike, y: ArrayLike, points: ArrayLike, radius: float) -> BoolArray:
    """Mark the pixels that lie farther from all known targets than a radius.

    Parameters
    ----------
    x, y : (x,) and (y,) array_like
        Axes of the image, m.
    points : (n, 2) array_like
        x, y of the targets, m.
    radius : float
        Radius, m.

    Returns
    -------
    (y, x) ndarray of bool
        True for clean pixels.

    Raises
    ------
    ValueError
        If the radius is negative.
    """
    if not radius >= 0:
        raise ValueError(f"radius must be at least 0, got {radius}")
    across, along = np.meshgrid(floats(x), floats(y))
    clean = np.ones(across.shape, dtype=bool)
    for px, py in floats(points).reshape(-1, 2):
        clean &= np.hypot(across - px, along - py) > radius
    return clean


def quiet_pixels(
    image: ComplexArray, quantile: float = 0.98, grow: tuple[int, int] = PAPER_CUT
) -> BoolArray:
    """Mark the pixels that may serve as clutter when no truth is known.

    Pixels brighter than the quantile in any channel may bear a target; they are left out with all
    pixels in a rectangle around them (Cosgrove et al. 2004, footnote 1). This also cuts the bright
    tail of the clutter, so that its level comes out low.

    Parameters
    ----------
    image : (channel, y, x) ndarray of complex64
        Image.
    quantile : float
        Above 0 and up to 1.
    grow : tuple of int
        Pixels of the rectangle down-track and cross-track.

    Returns
    -------
    (y, x) ndarray of bool
        True for quiet pixels that are finite in all channels.

    Raises
    ------
    ValueError
        If the quantile is out of range.
    """
    if not 0 < quantile <= 1:
        raise ValueError(f"quantile must lie above 0 and up to 1, got {quantile}")
    magnitude = np.abs(image)
    known = np.isfinite(magnitude).all(axis=0)
    limits: ArrayLike = 0.0
    if known.any():
        limits = np.nanquantile(np.where(known, magnitude, np.nan), quantile, axis=(1, 2))
    bright = (np.where(known, magnitude, 0) > np.reshape(limits, (-1, 1, 1))).any(axis=0)
    size = (2 * (grow[0] // 2) + 1, 2 * (grow[1] // 2) + 1)
    near_bright = maximum_filter(bright, size=size)
    return np.asarray(known & ~near_bright)


def _corners(index: ArrayLike, size: int) -> IntArray:
    """Return the first pixel, along an axis, of chips of a size about pixels."""
    if size < 1:
        raise ValueError(f"shape must be at least one pixel each way, got {size}")
    return np.asarray(index, dtype=np.int64).reshape(-1) - size // 2


def _nearest(axis: FloatArray, value: FloatArray) -> IntArray:
    """Return the pixels of an even axis that are nearest to values, also beyond its ends."""
    step = (axis[-1] - axis[0]) / (axis.size - 1) if axis.size > 1 else 1.0
    return np.rint((value - axis[0]) / step).astype(np.int64)


def _strongest(
    image: ComplexArray,
    rows: IntArray,
    columns: IntArray,
    shape: tuple[int, int],
    reach: tuple[int, int],
) -> tuple[IntArray, IntArray]:
    """Return the pixels within reach whose chips hold the most energy, all channels weighed alike.

    A pixel without a chip within reach stays.
    """
    power = np.abs(image).astype(np.float64) ** 2
    power /= np.maximum(power.mean(axis=(1, 2), keepdims=True), np.finfo(np.float64).tiny)
    v, u = shape
    energy = chip_sums(power.sum(axis=0), shape)
    rows = rows.copy()
    columns = columns.copy()
    for k, (row, column) in enumerate(zip(rows - v // 2, columns - u // 2, strict=True)):
        top = max(row - reach[0], 0)
        left = max(column - reach[1], 0)
        bottom = max(row + reach[0] + 1, 0)
        right = max(column + reach[1] + 1, 0)
        window = energy[top:bottom, left:right]
        if window.size and np.isfinite(window).any():
            best = np.unravel_index(np.nanargmax(window), window.shape)
            rows[k] = top + best[0] + v // 2
            columns[k] = left + best[1] + u // 2
    return rows, columns
