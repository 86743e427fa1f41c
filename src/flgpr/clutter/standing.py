"""Removal of what stands still on the vehicle: direct coupling and echoes of the vehicle itself.

Four estimates serve four purposes:

- :func:`standing_field` with :func:`subtract_standing`, before imaging: the median over the scans,
  fitted to the gain of every scan;
- :func:`remove_standing`, the same for a run, over all scans or over those around each;
- :func:`subtract_mean_scan`, before a search by echoes: a mean in which a vehicle that waits does
  not count for every scan;
- :func:`remove_mean_trace`, for recorded traces in time: their plain mean.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import xarray as xr

from flgpr.clutter.estimator import complex_median
from flgpr.clutter.recorded import has_data
from flgpr.model import complete_scans
from flgpr.model.aperture import half_steps
from flgpr.model.run import with_signal
from flgpr.types import ArrayLike, ComplexArray, FloatArray


def standing_field(signal: ArrayLike) -> ComplexArray:
    """Estimate the field that is the same in all scans.

    It is the median of the real and of the imaginary part of every sample: ground that passes by
    does not enter it.

    Parameters
    ----------
    signal : (scan, polarization, pair, frequency) array_like of complex
        Data of at least three scans.

    Returns
    -------
    (polarization, pair, frequency) ndarray of complex64
        Standing field, in units of the signal.

    Raises
    ------
    ValueError
        If there are fewer than three scans.
    """
    data = np.asarray(signal, dtype=np.complex64)
    if len(data) < 3:
        raise ValueError(
            f"signal must hold at least three scans to tell what stands still, got {len(data)}"
        )
    # One polarization at a time: the median copies what it sorts.
    return np.stack([complex_median(channel) for channel in data.swapaxes(0, 1)])


def subtract_standing(data: ArrayLike, field: ComplexArray) -> ComplexArray:
    """Subtract the standing field, fitted to the complex gain of every scan and polarization.

    Parameters
    ----------
    data : (..., polarization, pair, frequency) array_like of complex
        Received field.
    field : (polarization, pair, frequency) ndarray of complex
        From :func:`standing_field`.

    Returns
    -------
    (..., polarization, pair, frequency) ndarray of complex64
        Data without the standing field.

    Examples
    --------
    >>> import numpy as np
    >>> from flgpr.clutter import standing_field, subtract_standing
    >>> coupling = np.array([[[1.0 + 2.0j, -3.0j, 2.0]]])
    >>> scans = np.array([0.9, 1.0, 1.1])[:, None, None, None] * coupling
    >>> np.abs(subtract_standing(scans, standing_field(scans))).max() < 1e-6
    np.True_
    """
    signal = np.asarray(data, dtype=np.complex64)
    power = np.sum(np.abs(field) ** 2, axis=(1, 2), dtype=np.float64)
    gain = np.einsum("...pnk,pnk->...p", signal, field.conj()) / np.where(power > 0, power, 1.0)
    return np.asarray(signal - gain[..., None, None] * field, dtype=np.complex64)


def remove_standing(run: xr.Dataset, scans: int | None = None) -> xr.Dataset:
    """Subtract what stands still from scan to scan, see :func:`standing_field`.

    Parameters
    ----------
    run : xarray.Dataset
        A run with at least three complete scans.
    scans : int, optional
        Scans around each from which it is estimated, at least three; by default all of the run.
        With fewer, a slowly changing ground surface is subtracted too, and whatever else is longer.

    Returns
    -------
    xarray.Dataset
        The run without the standing field; incomplete scans stay as they are.

    Raises
    ------
    ValueError
        If there are fewer than three complete scans, or ``scans`` is less than three.
    """
    signal = run["signal"].values.copy()
    complete = np.flatnonzero(complete_scans(run))
    known = signal[complete]
    if scans is None or scans >= len(known):
        signal[complete] = subtract_standing(known, standing_field(known))
    elif scans < 3:
        raise ValueError(f"background must be estimated from at least 3 scans, got {scans}")
    else:
        for number, scan in enumerate(complete):
            start = int(np.clip(number - scans // 2, 0, len(known) - scans))
            field = standing_field(known[start : start + scans])
            signal[scan] = subtract_standing(known[number], field)
    return with_signal(run, signal)


def subtract_mean_scan(run: xr.Dataset) -> xr.Dataset:
    """Subtract the mean scan before a search by echoes.

    Scans are weighted by the change to their neighbours. A vehicle that waits is known from the
    track alone, whose clock such a search has still to find: in a plain mean, and in the median of
    :func:`remove_standing`, the echoes of where it waited would remain.

    Parameters
    ----------
    run : xarray.Dataset
        A run with at least five complete scans: of fewer the mean would be as much echo as
        coupling.

    Returns
    -------
    xarray.Dataset
        The run, from every scan of which the weighted mean is subtracted.

    Raises
    ------
    ValueError
        If there are fewer than five complete scans.
    """
    scans = np.flatnonzero(complete_scans(run))
    if scans.size < 5:
        raise ValueError(
            f"run must have five complete scans to tell what stands still in them, got {scans.size}"
        )
    signal = run["signal"].values
    change = [np.linalg.norm(signal[b] - signal[a]) for a, b in pairwise(scans)]
    weight = half_steps(np.array(change)) / scans.size
    field = np.tensordot(weight, signal[scans], axes=1).astype(signal.dtype)
    return with_signal(run, signal - field)


def remove_mean_trace(traces: FloatArray) -> FloatArray:
    """Subtract the mean of all recorded traces from each: what stays the same along the line goes.

    Parameters
    ----------
    traces : (trace, sample) array
        Amplitudes, in any unit; a trace of NaN holds no data and stays NaN.

    Returns
    -------
    (trace, sample) array
        Amplitudes without the mean trace, in the same unit.

    Raises
    ------
    ValueError
        If fewer than two traces hold data.
    """
    known = has_data(traces)
    count = int(np.count_nonzero(known))
    if count < 2:
        raise ValueError(
            f"background must be estimated from at least 2 traces with data, got {count}"
        )
    return traces - traces[known].mean(axis=0)
