"""Images over a synthetic aperture: many scans summed coherently in the lane frame."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from typing import Any, NamedTuple

import numpy as np
import xarray as xr

from flgpr.imaging.operator import ImagingOperator
from flgpr.model import SPEED_OF_LIGHT, antennas_in_lane, as_aperture, check_run
from flgpr.types import AnyArray, ArrayLike, BoolArray, ComplexArray, FloatArray, IndexArray, floats

_PAIRS_AT_ONCE = 256  # in one operator
_EVEN = 1e-6  # share of a step by which the steps of even tones differ, at most


class Record(NamedTuple):
    """The time that tones stand for: they repeat after the period, and hold no more than that."""

    first: float  #: delay of the first sample, s
    end: float  #: delay of the end, s; infinite where no record was taken to frequency
    period: float  #: after which the tones' phases repeat, s


def record_of(run: xr.Dataset) -> Record | None:
    """Return the record that the tones of a run stand for; None where they are not even."""
    tones = run["frequency"].values
    steps = np.diff(tones)
    if tones.size < 2 or np.ptp(steps) > _EVEN * steps.mean():
        return None
    period = float((tones.size - 1) / (tones[-1] - tones[0]))
    window = run.attrs.get("time_window_s")
    first = run.attrs.get("first_sample_s")
    if window is None or first is None or not (0 < window < np.inf and np.isfinite(first)):
        return Record(0.0, math.inf, period)
    return Record(float(first), float(first + min(window, period)), period)


def aperture_blocks(run: xr.Dataset, scans: ArrayLike) -> list[IndexArray]:
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
    blocks: Iterable[IndexArray],
    weights: ArrayLike | None = None,
    reach: float = np.inf,
    **operator: Any,
) -> ComplexArray:
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
    pixels = floats(points)
    flat = pixels.reshape(-1, 3)
    record = record_of(run)
    index = math.sqrt(operator.get("permittivity") or 1.0)
    index_of_ground = math.sqrt(operator.get("half_space") or 0.0)
    recorded = math.inf
    if record is not None:
        recorded = SPEED_OF_LIGHT * record.end / (2 * index)
    weight = np.ones(run.sizes["scan"])
    if weights is not None:
        weight = floats(weights)
    total = np.zeros((run.sizes["polarization"], len(flat)), np.complex64)
    for block in blocks:
        tx, rx = antennas_in_lane(run, run["pose"].values[block])
        in_reach: Any = slice(None)
        limits: dict[str, Any] = {}
        if np.isfinite(reach) or np.isfinite(recorded):
            # No echo of the record is from farther away than its middle antenna sees by its end.
            near = _box(tx, reach), _box((tx + rx) / 2, recorded)
            is_near = [_is_in(box, flat) for box in near]
            in_reach = np.flatnonzero(is_near[0] & is_near[1])
        if np.isfinite(reach):
            limits = {"tx_pattern": _tapered_pattern(reach)}
        if not len(flat[in_reach]):
            continue
        data, _, _ = as_aperture(run.isel(scan=block), weight[block])
        tones = run["frequency"].values
        if record is not None and np.isfinite(record.end):
            longest = _longest_path(tx, rx, flat[in_reach]) * max(index, index_of_ground)
            data, tones = without_folds(data, tones, record, longest / SPEED_OF_LIGHT)
        block_operator = ImagingOperator(tones, tx, rx, flat[in_reach], **limits, **operator)
        total[:, in_reach] += block_operator.adjoint(data)[:, 0]
    return total.reshape(-1, *pixels.shape[:-1])


def _box(places: FloatArray, margin: float) -> FloatArray:
    """Return the least and greatest x and y (2, 2) of places (place, 3) with a margin, m."""
    level = places[:, :2]
    return np.stack([level.min(axis=0) - margin, level.max(axis=0) + margin])


def _is_in(box: FloatArray, points: FloatArray) -> BoolArray:
    """Return which points (point, 3) lie in a box, by x and y."""
    level = points[:, :2]
    return ((level >= box[0]) & (level <= box[1])).all(axis=1)


def _longest_path(tx: FloatArray, rx: FloatArray, points: FloatArray) -> float:
    """Return a bound of the paths from transmitter by a point to receiver, m."""
    low = points.min(axis=0)
    high = points.max(axis=0)
    lengths = []
    for antenna in (tx, rx):
        farthest = np.maximum(np.abs(antenna - low), np.abs(high - antenna))
        lengths.append(np.linalg.norm(farthest, axis=1))
    return float((lengths[0] + lengths[1]).max())


def without_folds(
    field: AnyArray, tones: FloatArray, record: Record, longest: float
) -> tuple[AnyArray, FloatArray]:
    """Return a field on denser tones, whose phases do not repeat within the longest delay.

    The record is followed by zeros, as nothing was recorded there: else its begin, the direct wave
    above all, is read again as an echo from farther away than it reaches.

    Parameters
    ----------
    field : (..., frequency) ndarray of complex
        Field on even tones.
    tones : (frequency,) ndarray
        The tones, Hz.
    record : Record
        The record that they stand for.
    longest : float
        Longest delay of a sum, s.

    Returns
    -------
    field : (..., frequency) ndarray of complex
        The field; sums of it are as large as before.
    tones : (frequency,) ndarray
        Its tones, Hz.
    """
    dense = math.ceil((longest - record.first) / record.period)
    if dense <= 1:
        return field, tones
    count = tones.size
    begin = np.exp(2j * np.pi * tones * record.first)
    samples = np.fft.ifft(field * begin, axis=-1)
    spectrum = np.fft.fft(samples, count * dense, axis=-1)[..., : (count - 1) * dense + 1]
    denser = np.interp(np.arange(spectrum.shape[-1]) / dense, np.arange(count), tones)
    turned = spectrum * (np.exp(-2j * np.pi * denser * record.first) / dense)
    return turned.astype(field.dtype), denser


def _tapered_pattern(reach: float) -> Callable[[FloatArray, FloatArray], FloatArray]:
    """Return the amplitude of an antenna that falls as a cosine and ends at a distance, m."""

    def amplitude(position: FloatArray, pixels: FloatArray) -> FloatArray:
        """Return the amplitude at pixels (pixel, 3)."""
        distance = np.hypot(*(pixels[:, :2] - position[:2]).T) / reach
        taper = np.cos(np.pi / 2 * np.minimum(distance, 1)) ** 2
        return np.where(distance < 1, taper, 0.0)

    return amplitude
