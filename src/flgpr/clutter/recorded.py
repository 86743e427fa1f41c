"""Processing of recorded traces in time, for a plain radargram.

The functions take arrays (trace, sample) of real amplitudes. :mod:`flgpr.clutter.traces` has the
same steps on the tones of a run, and :func:`flgpr.clutter.remove_mean_trace` removes the
background. A trace of NaN holds no data: it stays NaN and does not count.
"""

from __future__ import annotations

import numpy as np

from flgpr.types import BoolArray, FloatArray, floats

HIGHEST_GAIN = 1e3
"""Largest ratio of two gains of :func:`level_traces`: 60 dB."""


def dewow_traces(traces: FloatArray, window: int) -> FloatArray:
    """Subtract from every trace its running mean.

    Parameters
    ----------
    traces : (trace, sample) array
        Amplitudes, in any unit.
    window : int
        Samples to average, at least 3; an even number is raised by one. At the ends of a trace the
        mean is over the samples that exist.

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


def level_traces(traces: FloatArray, window: int) -> FloatArray:
    """Divide all traces by the root mean square level of the line at each time.

    Late echoes become as bright as early ones. One curve serves all traces, so that amplitudes
    along the line stay comparable.

    Parameters
    ----------
    traces : (trace, sample) array
        Amplitudes, in any unit.
    window : int
        Samples over which the power is averaged, besides all traces; at least 3.

    Returns
    -------
    (trace, sample) array
        Amplitudes over the level, 1. The level is never taken as less than 1/1000 of its greatest
        value.

    Raises
    ------
    ValueError
        If no trace holds data, or the window is shorter than 3 samples.
    """
    if window < 3:
        raise ValueError(f"window of gain must be at least 3 samples, got {window}")
    known = has_data(traces)
    if not known.any():
        raise ValueError("gain must be estimated from at least 1 trace with data, got 0")
    power = (traces[known] ** 2).mean(axis=0)
    level = np.sqrt(_running_mean(power[None], window)[0])
    floor = level.max() / HIGHEST_GAIN
    if floor == 0:
        return traces
    return traces / np.maximum(level, floor)


def has_data(traces: FloatArray) -> BoolArray:
    """Mark the traces (trace, sample) all of whose samples are finite."""
    return np.asarray(np.isfinite(traces).all(axis=1))


def _running_mean(traces: FloatArray, window: int) -> FloatArray:
    """Average over a window of odd length around every sample, cut off at the ends of the trace."""
    half = window // 2
    samples = traces.shape[1]
    total = np.zeros((len(traces), samples + 1))
    np.cumsum(traces, axis=1, out=total[:, 1:])
    first = np.maximum(np.arange(samples) - half, 0)
    end = np.minimum(np.arange(samples) + half + 1, samples)
    return floats((total[:, end] - total[:, first]) / (end - first))
