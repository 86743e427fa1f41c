"""The usual steps on recorded traces for a radargram, in their order, and the window they take.

The steps themselves are in :mod:`flgpr.clutter.recorded` and :mod:`flgpr.clutter.standing`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from flgpr.clutter.recorded import dewow_traces, level_traces
from flgpr.clutter.standing import remove_mean_trace
from flgpr.types import FloatArray

PERIODS = 2.0
"""Periods of the antenna's frequency in a window that nobody states; assumed."""
SHARE_OF_RECORD = 0.1
"""Such a window as a share of the record, where the frequency is unknown, too; assumed."""


@dataclass(frozen=True)
class ProcessedTraces:
    """Traces after the steps, and what was done to them."""

    values: FloatArray  #: (trace, sample)
    unit: str  #: of the values, in words
    steps: tuple[str, ...]  #: what was done, in words and in order


def process_traces(
    traces: FloatArray, window: int, dewow: bool, background: bool, gain: bool
) -> ProcessedTraces:
    """Take the steps that are asked for: dewow, removal of the mean trace, and gain, in this order.

    Parameters
    ----------
    traces : (trace, sample) ndarray of float
        Amplitudes in counts of the recorder; NaN without data.
    window : int
        Samples of the window of dewow and gain, see :func:`window_samples`.
    dewow, background, gain : bool
        Which steps are taken.

    Returns
    -------
    ProcessedTraces
        Amplitudes in counts; after ``gain`` over the line's level at each time.

    Raises
    ------
    ValueError
        As the steps themselves.
    """
    values = traces
    unit = "counts of the recorder"
    steps = []
    if dewow:
        values = dewow_traces(values, window)
        steps.append(f"dewow over {window} samples")
    if background:
        values = remove_mean_trace(values)
        steps.append("mean trace removed")
    if gain:
        values = level_traces(values, window)
        unit = "amplitude over the line's level at that time"
        steps.append(f"gain: divided by the line's level over {window} samples")
    return ProcessedTraces(values, unit, tuple(steps))


def window_samples(delay: FloatArray, frequency: float | None, window: float | None) -> int:
    """Return the odd number of samples, at least 3, in the window of dewow and gain.

    Parameters
    ----------
    delay : (sample,) ndarray of float
        Two-way times of the samples, evenly spaced, s.
    frequency : float or None
        Nominal frequency of the antenna, Hz; None where it is unknown.
    window : float or None
        Length that is asked for, s. None takes ``PERIODS`` of the frequency, or
        ``SHARE_OF_RECORD``.

    Raises
    ------
    ValueError
        If the length is not positive or exceeds the record.
    """
    interval = float(delay[1] - delay[0])
    record = interval * delay.size
    if window is not None:
        if not 0 < window <= record:
            raise ValueError(
                f"window must be from 0 to the record's {record * 1e9:g} ns, "
                f"got {window * 1e9:g} ns"
            )
        length = window
    elif frequency is not None:
        length = min(PERIODS / frequency, record)
    else:
        length = SHARE_OF_RECORD * record
    return max(2 * round(length / interval / 2) + 1, 3)


def assumed_window(frequency: float | None) -> str:
    """Return in words which window was assumed for a nominal frequency (Hz) of the antenna."""
    if frequency is None:
        share = f"{100 * SHARE_OF_RECORD:g} % of the record"
        return f"window of dewow and gain assumed: {share}, no antenna's frequency is known"
    periods = f"{PERIODS:g} periods of the antenna's {frequency / 1e6:g} MHz"
    return f"window of dewow and gain assumed: {periods}"


def samples_until(delay: FloatArray, until: float | None) -> int:
    """Count the samples up to a two-way time, s; None takes all.

    Fewer than two samples are a ValueError.
    """
    if until is None:
        return delay.size
    # Half a sample more: a header's rounding must not cost the last one.
    half_sample = 0.5 * float(delay[1] - delay[0])
    count = int(np.searchsorted(delay, until + half_sample, side="right"))
    if count < 2:
        raise ValueError(
            f"until must be a time after the first two samples, {delay[1] * 1e9:g} ns, "
            f"got {until * 1e9:g} ns"
        )
    return count
