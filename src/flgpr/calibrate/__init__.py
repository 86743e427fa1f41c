"""Calibration: what stands between a recorded signal and the field of the papers."""

from flgpr.calibrate.clock import (
    BiasFit,
    ClockFit,
    brightest_points,
    estimate_clock,
    estimate_range_bias,
    remove_range_bias,
    sharpness,
    synthetic_aperture,
    way_weights,
    with_track,
)

__all__ = [
    "BiasFit",
    "ClockFit",
    "brightest_points",
    "estimate_clock",
    "estimate_range_bias",
    "remove_range_bias",
    "sharpness",
    "synthetic_aperture",
    "way_weights",
    "with_track",
]
