"""Feature vectors of image pixels: range cuts, or chips, of all channels stacked (Cosgrove et al. 2004, Sec. III)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike, NDArray
from scipy.ndimage import maximum_filter

from flgpr.kernels.correlate import chips

ComplexArray = NDArray[np.complex64]

PAPER_CUT = (28, 1)
"""Pixels down-track and cross-track of the paper's range cut, at 2 cm."""


def stack_channels(
    image: xr.DataArray, channels: Sequence[str] | None = None
) -> tuple[ComplexArray, tuple[str, ...]]:
    """Line up polarizations and sub-bands of an image ([polarization,] [subband,] y, x) as channels (channel, y, x).

    It gives the stack and the channels' names: "HH", or "HH 0.45-1.5" with its sub-band's name where the image has
    several sub-bands. ``channels`` are those to take, in this order; None takes all, polarization by polarization.
    Other dimensions or a missing channel are a ValueError.
    """
    if set(image.dims) - {"polarization", "subband", "y", "x"} or not {"y", "x"} <= set(image.dims):
        raise ValueError(
            f"image must have the dimensions ([polarization,] [subband,] y, x), got {image.dims}"
        )
    full = image.expand_dims([d for d in ("polarization", "subband") if d not in image.dims])
    full = full.transpose("polarization", "subband", "y", "x")
    bands = [str(name) for name in full["subband"].values] if "subband" in image.dims else [""]
    labels = (
        [str(name) for name in full["polarization"].values]
        if "polarization" in image.dims
        else ["image"]
    )
    names = [f"{label} {band}" if len(bands) > 1 else label for label in labels for band in bands]
    stack = full.values.reshape(len(names), *full.shape[-2:]).astype(np.complex64, copy=False)
    if channels is None:
        return stack, tuple(names)
    missing = [name for name in channels if name not in names]
    if missing:
        raise ValueError(
            f"channels must be among {', '.join(names)}; missing: {', '.join(missing)}"
        )
    return stack[[names.index(name) for name in channels]], tuple(channels)


def cuts_at(
    image: ComplexArray, rows: ArrayLike, columns: ArrayLike, shape: tuple[int, int] = PAPER_CUT
) -> ComplexArray:
    """Feature vectors (n_samples, n_features) of pixels of an image (channel, y, x); NaN where the chip leaves it.

    The chip of pixel i reaches from ``i - n//2`` on over n pixels each way, ``shape`` being (down-track, cross-track).
    Its samples are stacked channel by channel, row by row: with HH and VV a range cut is the paper's vector of HH then
    VV (Cosgrove et al. 2004, Fig. 5).
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
    """Feature vectors (n_samples, n_features) about points of an image; NaN where a chip leaves the image.

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
        position of a buried object in the image differs from its place by refraction and the
        survey's error.
    """
    if not search >= 0:
        raise ValueError(f"search must be at least 0, got {search}")
    stack, _ = stack_channels(image, channels)
    place = np.asarray(points, dtype=np.float64).reshape(-1, 2)
    rows, columns = (_nearest(image[axis].values, place[:, k]) for axis, k in (("y", 1), ("x", 0)))
    if search > 0:
        reach = tuple(
            int(search / abs(float(np.diff(image[axis].values[:2])[0]))) for axis in ("y", "x")
        )
        rows, columns = _strongest(stack, rows, columns, shape, (reach[0], reach[1]))
    return cuts_at(stack, rows, columns, shape)


def clutter_cuts(
    image: ComplexArray,
    clean: NDArray[np.bool_],
    shape: tuple[int, int] = PAPER_CUT,
    step: tuple[int, int] = (14, 8),
) -> ComplexArray:
    """Feature vectors (n_samples, n_features) of clutter: all chips on a lattice that hold clean pixels only.

    The image is (channel, y, x), ``clean`` (y, x) is true where there is no target; ``shape`` are the pixels of a chip
    and ``step`` those from chip to chip, down-track and cross-track.
    """
    if clean.shape != image.shape[1:]:
        raise ValueError(f"clean must have the image's shape {image.shape[1:]}, got {clean.shape}")
    if min(step) < 1:
        raise ValueError(f"step must be at least one pixel each way, got {step}")
    features = image.shape[0] * shape[0] * shape[1]
    if image.shape[1] < shape[0] or image.shape[2] < shape[1]:
        return np.empty((0, features), dtype=np.complex64)
    usable = clean & np.isfinite(image).all(axis=0)
    whole = chips(usable[None], shape)[:: step[0], :: step[1]].all(axis=(2, 3, 4))
    return chips(image, shape)[:: step[0], :: step[1]][whole].reshape(-1, features)


def clean_pixels(x: ArrayLike, y: ArrayLike, points: ArrayLike, radius: float) -> NDArray[np.bool_]:
    """Tell which pixels (y, x) keep a distance ``radius`` from known targets at ``points`` (n, 2); all in m."""
    if not radius >= 0:
        raise ValueError(f"radius must be at least 0, got {radius}")
    across, along = np.meshgrid(np.asarray(x, dtype=np.float64), np.asarray(y, dtype=np.float64))
    clean = np.ones(across.shape, dtype=bool)
    for px, py in np.asarray(points, dtype=np.float64).reshape(-1, 2):
        clean &= np.hypot(across - px, along - py) > radius
    return clean


def quiet_pixels(
    image: ComplexArray, quantile: float = 0.98, grow: tuple[int, int] = PAPER_CUT
) -> NDArray[np.bool_]:
    """Tell which pixels (y, x) of an image (channel, y, x) may serve as clutter when no truth is known.

    Pixels brighter than the quantile in any channel may bear a target; they are left out with all pixels in the
    rectangle ``grow`` (down-track, cross-track) around them (Cosgrove et al. 2004, footnote 1). This cuts the clutter's
    own bright tail too, so that its level comes out low. False where a channel is not finite.
    """
    if not 0 < quantile <= 1:
        raise ValueError(f"quantile must lie above 0 and up to 1, got {quantile}")
    magnitude = np.abs(image)
    seen = np.isfinite(magnitude).all(axis=0)
    limits = (
        np.nanquantile(np.where(seen, magnitude, np.nan), quantile, axis=(1, 2))
        if seen.any()
        else 0.0
    )
    bright = (np.where(seen, magnitude, 0) > np.reshape(limits, (-1, 1, 1))).any(axis=0)
    around = maximum_filter(bright, size=(2 * (grow[0] // 2) + 1, 2 * (grow[1] // 2) + 1))
    return np.asarray(seen & ~around)


def _corners(index: ArrayLike, size: int) -> NDArray[np.int64]:
    if size < 1:
        raise ValueError(f"shape must be at least one pixel each way, got {size}")
    return np.asarray(index, dtype=np.int64).reshape(-1) - size // 2


def _nearest(axis: NDArray[np.float64], value: NDArray[np.float64]) -> NDArray[np.int64]:
    step = (axis[-1] - axis[0]) / (axis.size - 1) if axis.size > 1 else 1.0
    return np.rint((value - axis[0]) / step).astype(np.int64)


def _strongest(
    image: ComplexArray,
    rows: NDArray[np.int64],
    columns: NDArray[np.int64],
    shape: tuple[int, int],
    reach: tuple[int, int],
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Pixels within reach whose chips hold the most energy, channels weighed alike; those without one stay."""
    power = np.abs(image).astype(np.float64) ** 2
    power /= np.maximum(power.mean(axis=(1, 2), keepdims=True), np.finfo(np.float64).tiny)
    table = np.zeros((power.shape[1] + 1, power.shape[2] + 1))
    table[1:, 1:] = power.sum(axis=0).cumsum(0).cumsum(1)
    v, u = shape
    energy = table[v:, u:] - table[:-v, u:] - table[v:, :-u] + table[:-v, :-u]
    rows = rows.copy()
    columns = columns.copy()
    for k, (row, column) in enumerate(zip(rows - v // 2, columns - u // 2, strict=True)):
        top = max(row - reach[0], 0)
        left = max(column - reach[1], 0)
        part = energy[top : max(row + reach[0] + 1, 0), left : max(column + reach[1] + 1, 0)]
        if part.size and np.isfinite(part).any():
            best = np.unravel_index(np.nanargmax(part), part.shape)
            rows[k] = top + best[0] + v // 2
            columns[k] = left + best[1] + u // 2
    return rows, columns
