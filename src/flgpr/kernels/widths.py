"""Widths of peaks."""

from __future__ import annotations

import math

import numpy as np

from flgpr.types import FloatArray


def half_power(offset: FloatArray, amplitude: FloatArray, peak: int | None = None) -> float:
    """Return the full width between the first half-power points on both sides of a peak.

    Parameters
    ----------
    offset : (n,) ndarray
        Increasing positions.
    amplitude : (n,) ndarray
        Amplitudes relative to the peak, interpolated linearly.
    peak : int, optional
        Number of the peak, by default the middle.

    Returns
    -------
    float
        Width in units of the offset; NaN where a side does not fall to half power.
    """
    top = offset.size // 2 if peak is None else peak
    level = math.sqrt(0.5)
    edges = []
    for side in (1, -1):
        values = amplitude[top::side]
        offsets = offset[top::side]
        below = np.flatnonzero(values < level)
        if not below.size or below[0] == 0:
            return math.nan
        k = int(below[0])
        fraction = (values[k - 1] - level) / (values[k - 1] - values[k])
        edges.append(offsets[k - 1] + fraction * (offsets[k] - offsets[k - 1]))
    return float(abs(edges[0] - edges[1]))
