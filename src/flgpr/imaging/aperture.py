"""Images over a synthetic aperture: many scans summed coherently in the lane frame."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike, NDArray

from flgpr.imaging.operator import ImagingOperator
from flgpr.model import antennas_in_lane, as_aperture, check_run

FloatArray = NDArray[np.float64]
_PAIRS_AT_ONCE = 256  # in one operator


def aperture_blocks(run: xr.Dataset, scans: ArrayLike) -> list[NDArray[np.intp]]:
    """Split scans into the blocks that :func:`aperture_image` images at once.

    Parameters
    ----------
    run : xarray.Dataset
        A run, for its number of pairs.
    scans : (scan,) array_like of int
        Numbers of the scans.

    Returns
    -------
    list of (scan,) ndarray
        The blocks, in the order of the scans.
    """
    numbers = np.asarray(scans, dtype=np.intp)
    size = max(_PAIRS_AT_ONCE // run.sizes["pair"], 1)
    return [numbers[first : first + size] for first in range(0, numbers.size, size)]


def aperture_image(
    run: xr.Dataset,
    points: ArrayLike,
    blocks: Iterable[NDArray[np.intp]],
    weights: ArrayLike | None = None,
    reach: float = np.inf,
    **operator: Any,
) -> NDArray[np.complex64]:
    """Image points of the lane frame by the coherent sum over scans.

    Parameters
    ----------
    run : xarray.Dataset
        A run; the scans must have no missing sweep.
    points : (..., 3) array_like
        Pixels in the lane frame, m: ground, section or volume.
    blocks : iterable of (scan,) arrays
        Scans, see :func:`aperture_blocks`; one block is in memory at a time.
    weights : (all scans,) array_like, optional
        Weight of every scan of the run, by default one.
    reach : float
        How far (m, level with the ground) an antenna may be from a pixel that it helps to image.
    **operator
        Of :class:`ImagingOperator`: ``window``, ``permittivity``, ``half_space``, ``tolerance``,
        ``subbands`` of length one.

    Returns
    -------
    (polarization, ...) ndarray of complex64
        Image.

    Raises
    ------
    ValueError
        If the run is not valid, or :class:`ImagingOperator` refuses a parameter.
    """
    check_run(run)
    pixels = np.asarray(points, dtype=np.float64)
    flat = pixels.reshape(-1, 3)
    weight = np.ones(run.sizes["scan"])
    if weights is not None:
        weight = np.asarray(weights, dtype=np.float64)
    total = np.zeros((run.sizes["polarization"], len(flat)), np.complex64)
    for block in blocks:
        tx, rx = antennas_in_lane(run, run["pose"].values[block])
        in_reach: Any = slice(None)
        limits: dict[str, Any] = {}
        if np.isfinite(reach):
            in_box = flat[:, :2] >= tx[:, :2].min(axis=0) - reach
            in_box &= flat[:, :2] <= tx[:, :2].max(axis=0) + reach
            in_reach = np.flatnonzero(in_box.all(axis=1))
            limits = {"tx_pattern": _tapered_pattern(reach)}
        if not len(flat[in_reach]):
            continue
        data, _, _ = as_aperture(run.isel(scan=block), weight[block])
        block_operator = ImagingOperator(
            run["frequency"].values, tx, rx, flat[in_reach], **limits, **operator
        )
        total[:, in_reach] += block_operator.adjoint(data)[:, 0]
    return total.reshape(-1, *pixels.shape[:-1])


def _tapered_pattern(reach: float) -> Callable[[FloatArray, FloatArray], FloatArray]:
    """Return the amplitude of an antenna that falls as a cosine and ends at a distance, m."""

    def amplitude(position: FloatArray, pixels: FloatArray) -> FloatArray:
        """Return the amplitude at pixels (pixel, 3)."""
        distance = np.hypot(*(pixels[:, :2] - position[:2]).T) / reach
        taper = np.cos(np.pi / 2 * np.minimum(distance, 1)) ** 2
        return np.asarray(np.where(distance < 1, taper, 0.0))

    return amplitude
