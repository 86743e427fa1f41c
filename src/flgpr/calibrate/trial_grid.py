"""The trials of a calibration: the pixels that are focused, and the offsets of the clock."""

from __future__ import annotations

import numpy as np

from flgpr.model import SPEED_OF_LIGHT
from flgpr.types import ArrayLike, FloatArray

MOST_PIXELS = 2_000_000
"""Pixels of an area that is focused for every trial."""
MOST_OFFSETS = 10_000
"""Offsets of a clock, a trial each."""


def pixels_of_area(
    frequency: ArrayLike,
    area: tuple[float, float, float, float],
    height: float,
    spacing: float | None = None,
) -> FloatArray:
    """Return the pixels of a level area that is focused for every trial.

    Parameters
    ----------
    frequency : (frequency,) array_like of float
        Tones, increasing, Hz.
    area : tuple of float
        x_min, x_max, y_min, y_max in the lane frame, m.
    height : float
        z of the area, m.
    spacing : float, optional
        Of pixels, m; by default a quarter of the shortest wavelength.

    Returns
    -------
    (y, x, 3) ndarray of float
        Pixels in the lane frame, m.

    Raises
    ------
    ValueError
        If limits do not increase, or the area has more than ``MOST_PIXELS``.
    """
    x_min, x_max, y_min, y_max = area
    highest_tone = float(np.asarray(frequency)[-1])
    spacing = spacing or SPEED_OF_LIGHT / highest_tone / 4
    if not (x_max > x_min and y_max > y_min and spacing > 0):
        raise ValueError(f"area must have x_max > x_min and y_max > y_min, got {area}")

    # Half a pixel more: rounding must not cost the last one.
    x = np.arange(x_min, x_max + spacing / 2, spacing)
    y = np.arange(y_min, y_max + spacing / 2, spacing)
    if x.size * y.size > MOST_PIXELS:
        raise ValueError(
            f"area must hold at most {MOST_PIXELS:,} pixels, got {x.size} x {y.size} of "
            f"{spacing:.3g} m: take a smaller one or a wider spacing"
        )
    return np.stack([*np.meshgrid(x, y), np.full((y.size, x.size), height)], axis=-1)


def offsets_to_try(limits: tuple[float, float], step: float) -> FloatArray:
    """Return the offsets of a clock that are tried.

    Parameters
    ----------
    limits : tuple of float
        Least and greatest offset, s; equal limits give a single offset.
    step : float
        Step, s.

    Returns
    -------
    (offset,) ndarray of float
        Offsets, s.

    Raises
    ------
    ValueError
        If limits decrease, the step is not positive or wider than they are apart, or there are more
        than ``MOST_OFFSETS``.
    """
    low, high = limits
    if not (np.isfinite(limits).all() and high >= low and step > 0):
        raise ValueError(f"offsets must increase and step be positive, got {limits} and {step:g}")
    if high > low and step > high - low:
        raise ValueError(
            f"step must not be wider than the offsets, {low:g} to {high:g} s, got {step:g} s: the first "
            "offset alone would be tried"
        )
    if (high - low) / step > MOST_OFFSETS:
        raise ValueError(
            f"offsets must be at most {MOST_OFFSETS:,}, got {low:g} to {high:g} s by {step:g} s"
        )
    # Half a step more: rounding must not cost the last offset.
    return np.arange(low, high + step / 2, step)
