"""Clock offset between a radar and its positioning instrument, estimated by focus alone."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from operator import attrgetter
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
import xarray as xr

from flgpr.model.aperture import synthetic_aperture
from flgpr.model.phase import lengthen
from flgpr.model.run import with_signal
from flgpr.model.track import poses_at
from flgpr.types import ArrayLike, FloatArray, floats

Operator = Callable[..., Any]
"""Makes an imaging operator of frequency, tx_position, rx_position and pixels.

This is ``flgpr.imaging.ImagingOperator``.
"""
# Least sharpness of a trusted image over that of the worst; noise alone reached 1.13 at most.
_LEAST_SHARPNESS_RATIO = 1.3


@dataclass(frozen=True)
class ClockFit:
    """Clock of the track against the radar's."""

    offset: float  #: time on the track's clock is ``offset + rate·(radar's time)``, s
    rate: float  #: as there, 1
    lowest: float  #: least sharpness of the offsets given; the greatest must stand out from it
    trials: pd.DataFrame  #: all trials: offset (s), rate, sharpness
    doubt: str  #: why the answer is not to be trusted; empty if it is
    skipped: int = 0  #: offsets given that leave the track, at all rates: they were not tried

    @property
    def rate_at_edge(self) -> bool:
        """Whether a better rate may lie beyond those that were tried."""
        rates = self.trials["rate"]
        return bool(rates.min() < rates.max()) and self.rate in (rates.min(), rates.max())


def with_track(
    run: xr.Dataset, track: pd.DataFrame, offset: float, rate: float = 1.0
) -> xr.Dataset:
    """Return a run with the poses of a track of the array's reference point.

    Parameters
    ----------
    run : xarray.Dataset
        A run with times.
    track : DataFrame
        Track of the array's reference point.
    offset, rate : float
        Time on the track's clock is ``offset + rate·(radar's time)``, s.

    Returns
    -------
    xarray.Dataset
        The run with poses.

    Raises
    ------
    ValueError
        If a time is missing or outside the track.
    """
    pose = poses_at(track, run["time"].values, offset, rate)
    return run.assign(pose=(("scan", "component"), pose))


def remove_range_bias(run: xr.Dataset, bias: float) -> xr.Dataset:
    """Shorten all one-way ranges of a run by ``bias`` (m), by which they are measured too long."""
    signal = lengthen(run["signal"].values, run["frequency"].values, -2.0 * bias)
    return with_signal(run, signal)


def sharpness(image: ArrayLike) -> float:
    """Compute the sharpness of an image, ``Σ|x|⁴ / (Σ|x|²)²``.

    It is 1 for a single bright pixel and 0 for an empty image.
    """
    power = np.abs(np.asarray(image, dtype=np.complex128)) ** 2
    total = float(power.sum())
    return float((power**2).sum()) / total**2 if total > 0 else 0.0


def estimate_clock(
    run: xr.Dataset,
    track: pd.DataFrame,
    pixels: ArrayLike,
    offsets: ArrayLike,
    operator: Operator,
    rates: ArrayLike = (1.0,),
    refine: int = 4,
) -> ClockFit:
    """Estimate the clock offset at which the run focuses best, without a known reflector.

    All offsets are tried, then the best one's neighbourhood with steps halved ``refine`` times. The
    offset's step must be short enough for the focus to show: a fraction of the time in which the
    vehicle moves by the image's resolution.

    Parameters
    ----------
    run, track : xarray.Dataset, DataFrame
        A run with times, and the track of the array's reference point.
    pixels : (..., 3) array_like
        Area to image, in the lane frame, m.
    offsets, rates : (trial,), (rate,) array_like
        Clock offsets (s) and rates to try. Offsets that leave the track are skipped.
    operator : callable
        ``flgpr.imaging.ImagingOperator``.

    Returns
    -------
    ClockFit
        With the reason in ``doubt`` if the sharpest image is less than 1.3 times as sharp as the
        worst one, or lies at the edge of the offsets. It does not show whether the ranges are
        right: see :func:`estimate_joint`.

    Raises
    ------
    ValueError
        If all offsets leave the track.
    """
    trials: list[_Trial] = []
    area = floats(pixels)
    run = run.compute()

    def attempt(offset: float, rate: float) -> None:
        """Append the sharpness at an offset and a rate, unless they leave the track."""
        try:
            shifted = with_track(run, track, offset, rate)
        except ValueError:
            return
        data, tx, rx = synthetic_aperture(shifted)
        image = operator(run["frequency"].values, tx, rx, area, tolerance=1e-2).adjoint(data)
        trials.append(_Trial(offset, rate, sharpness(image)))

    steps = floats(offsets)
    for rate in floats(rates):
        for offset in steps:
            attempt(float(offset), float(rate))
    if not trials:
        raise ValueError(_outside(run, track, steps))

    first_trials = pd.DataFrame(trials)
    width = float(np.diff(np.sort(steps)).mean()) if steps.size > 1 else 0.0
    for level in range(refine if width else 0):
        best = max(trials, key=attrgetter("sharpness"))
        for sign in (-1, 1):
            attempt(best.offset + sign * width / 2 ** (level + 1), best.rate)

    best = max(trials, key=attrgetter("sharpness"))
    lowest = float(first_trials["sharpness"].min())
    # A single offset has no others to stand out from.
    doubt = _doubt(best, first_trials) if steps.size > 1 else ""
    skipped = steps.size * floats(rates).size - len(first_trials)
    return ClockFit(best.offset, best.rate, lowest, pd.DataFrame(trials), doubt, skipped)


class _Trial(NamedTuple):
    """Sharpness of the image at a clock offset and a rate."""

    offset: float  #: s
    rate: float
    sharpness: float


def _doubt(best: _Trial, first_trials: pd.DataFrame) -> str:
    """Return why the best trial is not to be trusted, by the trials before it was refined."""
    lowest = float(first_trials["sharpness"].min())
    if best.sharpness < _LEAST_SHARPNESS_RATIO * lowest:
        return (
            f"no offset stands out: the sharpest image is but {best.sharpness / lowest:.2f} times "
            f"as sharp as the worst, {_LEAST_SHARPNESS_RATIO:g} times are asked for: "
            "is there anything bright in the area?"
        )
    if not first_trials["offset"].min() < best.offset < first_trials["offset"].max():
        return (
            f"the best offset, {best.offset:.3f} s, lies at the edge of those tried: look farther"
        )
    return ""


def track_trials(
    run: xr.Dataset, track: pd.DataFrame, offsets: ArrayLike
) -> tuple[FloatArray, list[FloatArray]]:
    """Return the clock offsets at which all scans lie within the track, and the poses there.

    If there is none, it is a ValueError.
    """
    inside = []
    poses = []
    for offset in floats(offsets):
        with suppress(ValueError):
            poses.append(poses_at(track, run["time"].values, float(offset)))
            inside.append(float(offset))
    if not inside:
        raise ValueError(_outside(run, track, offsets))
    return np.array(inside), poses


def _outside(run: xr.Dataset, track: pd.DataFrame, offsets: ArrayLike) -> str:
    """Return why no offset puts the scans inside the track."""
    time = run["time"].values
    steps = np.asarray(offsets)
    if not (np.isfinite(time).all() and steps.size):
        return (
            "run must have a time for every scan to take poses from a track, "
            "and there must be offsets to try"
        )
    return (
        f"offsets must put the scans inside the track, none from {steps.min():g} to "
        f"{steps.max():g} s does: scans from {time.min():g} to {time.max():g} s, "
        f"track from {track['time'].iloc[0]:g} to {track['time'].iloc[-1]:g} s"
    )


def brightest_points(image: ArrayLike, pixels: ArrayLike, count: int, apart: float) -> FloatArray:
    """Return the brightest pixels that keep a distance from each other.

    Parameters
    ----------
    image : (...) array_like
        Image, complex or magnitude.
    pixels : (..., 3) array_like
        Its pixels, m.
    count : int
        Largest number of them.
    apart : float
        Least distance of two, m.

    Returns
    -------
    (n, 4) ndarray
        x, y, z (m) and magnitude, the brightest first.
    """
    level = np.abs(np.asarray(image)).ravel().astype(np.float64)
    positions = floats(pixels).reshape(-1, 3)
    points: list[Sequence[float]] = []
    while len(points) < count and np.isfinite(level.max()):
        top = int(level.argmax())
        points.append([*positions[top], level[top]])
        level[np.linalg.norm(positions - positions[top], axis=1) < apart] = -np.inf
    return np.array(points).reshape(-1, 4)
