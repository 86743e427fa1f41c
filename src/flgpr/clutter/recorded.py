"""The usual steps on recorded traces in time, for a plain radargram.

They act on arrays (trace, sample) of real amplitudes; :mod:`flgpr.clutter.traces` has the same steps on the tones of a
run. A trace of NaN, which is no data, stays NaN and does not count.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
HIGHEST_GAIN = 1e3
"""Largest ratio of two gains of :func:`level_traces`: 60 dB."""


def dewow_traces(traces: FloatArray, window: int) -> FloatArray:
    """Subtract from every trace its running mean over ``window`` samples, made odd; at the ends over those there are.

    Parameters
    ----------
    traces : (trace, sample) array
        Amplitudes, in any unit.
    window : int
        Samples to average, at least 3.

    Returns
    -------
    (trace, sample) array
        Amplitudes without their slow swing, in the same unit.

    Raises
    ------
    ValueError
        If the window is shorter than 3 samples.
    """
    if window < 3:
        raise ValueError(f"window of dewow must be at least 3 samples, got {window}")
    return traces - _running_mean(traces, window)


def remove_mean_trace(traces: FloatArray) -> FloatArray:
    """Subtract the mean of all traces (trace, sample) from each: what stays the same along the line goes.

    Raises
    ------
    ValueError
        If fewer than two traces hold data.
    """
    known = _known(traces)
    count = int(np.count_nonzero(known))
    if count < 2:
        raise ValueError(
            f"background must be estimated from at least 2 traces with data, got {count}"
        )
    return traces - traces[known].mean(axis=0)


def level_traces(traces: FloatArray, window: int) -> FloatArray:
    """Divide all traces by the line's root mean square level at each time: late echoes come up beside early ones.

    One curve serves all traces (trace, sample), so that amplitudes along the line stay comparable.
    The level is that of the power over traces and over ``window`` samples; it is never taken as
    less than 1/1000 of its greatest value.

    Raises
    ------
    ValueError
        If no trace holds data, or the window is shorter than 3 samples.
    """
    if window < 3:
        raise ValueError(f"window of gain must be at least 3 samples, got {window}")
    known = _known(traces)
    if not known.any():
        raise ValueError("gain must be estimated from at least 1 trace with data, got 0")
    power = (traces[known] ** 2).mean(axis=0)
    level = np.sqrt(_running_mean(power[None], window)[0])
    floor = level.max() / HIGHEST_GAIN
    if floor == 0:
        return traces
    return traces / np.maximum(level, floor)


def _known(traces: FloatArray) -> NDArray[np.bool_]:
    return np.asarray(np.isfinite(traces).all(axis=1))


def _running_mean(traces: FloatArray, window: int) -> FloatArray:
    """Average over a window of odd length around every sample, or over what of it lies in the trace."""
    half = window // 2
    samples = traces.shape[1]
    total = np.zeros((len(traces), samples + 1))
    np.cumsum(traces, axis=1, out=total[:, 1:])
    first = np.maximum(np.arange(samples) - half, 0)
    behind = np.minimum(np.arange(samples) + half + 1, samples)
    return np.asarray((total[:, behind] - total[:, first]) / (behind - first), dtype=np.float64)
