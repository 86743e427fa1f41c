"""Images over a synthetic aperture: many scans, each from its own pose, summed coherently in the lane frame."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike, NDArray

from flgpr.imaging.operator import ImagingOperator
from flgpr.model import antennas_in_lane, as_aperture, check_run

FloatArray = NDArray[np.float64]
_PAIRS = 256  # pairs whose operator is made at once


def aperture_blocks(run: xr.Dataset, scans: ArrayLike) -> list[NDArray[np.intp]]:
    """Split scans into the blocks that :func:`aperture_image` images at once."""
    chosen = np.asarray(scans, dtype=np.intp)
    size = max(_PAIRS // run.sizes["pair"], 1)
    return [chosen[first : first + size] for first in range(0, chosen.size, size)]


def aperture_image(
    run: xr.Dataset, points: ArrayLike, blocks: Iterable[NDArray[np.intp]], weights: ArrayLike | None = None,
    reach: float = np.inf, **operator: Any,
) -> NDArray[np.complex64]:  # fmt: skip
    """Image points (..., 3) of the lane frame (m) by the coherent sum over scans: complex64 (polarization, ...).

    A run that is not valid is a ValueError; so is what :class:`ImagingOperator` refuses.

    Parameters
    ----------
    run : xarray.Dataset
        A run; the scans must have no missing sweep.
    points : (..., 3) array_like
        Pixels: ground, section or volume.
    blocks : iterable of (scan,) arrays
        Scans, see :func:`aperture_blocks`; one block is in memory at a time.
    weights : (all scans,) array_like, optional
        Weight of every scan of the run, by default one.
    reach : float
        How far (m, level with the ground) an antenna may be from a pixel that it helps to image.
    **operator
        Of :class:`ImagingOperator`: ``window``, ``permittivity``, ``half_space``, ``tolerance``,
        ``subbands`` of length one.
    """
    check_run(run)
    pixels = np.asarray(points, dtype=np.float64)
    flat = pixels.reshape(-1, 3)
    share = np.ones(run.sizes["scan"]) if weights is None else np.asarray(weights, dtype=np.float64)
    total = np.zeros((run.sizes["polarization"], len(flat)), np.complex64)
    for block in blocks:
        tx, rx = antennas_in_lane(run, run["pose"].values[block])
        near: Any = slice(None)
        limits: dict[str, Any] = {}
        if np.isfinite(reach):
            box = (flat[:, :2] >= tx[:, :2].min(axis=0) - reach) & (
                flat[:, :2] <= tx[:, :2].max(axis=0) + reach
            )
            near = np.flatnonzero(box.all(axis=1))
            limits = {"tx_pattern": _within(reach)}
        if not len(flat[near]):
            continue
        data, _, _ = as_aperture(run.isel(scan=block), share[block])
        made = ImagingOperator(run["frequency"].values, tx, rx, flat[near], **limits, **operator)
        total[:, near] += made.adjoint(data)[:, 0]
    return total.reshape(-1, *pixels.shape[:-1])


def _within(reach: float) -> Callable[[FloatArray, FloatArray], FloatArray]:
    """Amplitude of an antenna that sees no farther than ``reach``: a cosine that ends there."""

    def amplitude(position: FloatArray, pixels: FloatArray) -> FloatArray:
        away = np.hypot(*(pixels[:, :2] - position[:2]).T) / reach
        return np.asarray(np.where(away < 1, np.cos(np.pi / 2 * np.minimum(away, 1)) ** 2, 0.0))

    return amplitude
