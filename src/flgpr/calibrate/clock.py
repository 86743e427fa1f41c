"""Clock offset, by focus alone, between a radar and the instrument that tells its positions."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr
from numpy.typing import ArrayLike, NDArray

from flgpr.model.aperture import synthetic_aperture
from flgpr.model.arrays import FloatArray
from flgpr.model.phase import lengthen
from flgpr.model.track import poses_at

Operator = Callable[..., Any]
"""Makes an imaging operator from frequency, tx_position, rx_position and pixels: ``flgpr.imaging.ImagingOperator``."""
# least sharpness of a trusted image over that of the worst; of noise alone 1.13 was the most seen
_SHARPER = 1.3


@dataclass(frozen=True)
class ClockFit:
    """Clock of the track against the radar's."""

    #: offset, rate: time on the track's clock is ``offset + rate·(radar's time)``, s and 1
    offset: float
    rate: float
    lowest: float  #: least sharpness of the offsets asked for; the greatest is to stand out from it
    trials: pd.DataFrame  #: what was tried: offset (s), rate, sharpness
    doubt: str  #: why the answer is not to be trusted; empty if it is


def with_track(
    run: xr.Dataset, track: pd.DataFrame, offset: float, rate: float = 1.0
) -> xr.Dataset:
    """Give a run with times the poses of a track of the array's reference point.

    Time on the track's clock is ``offset + rate·(radar's time)``, s; a time that is missing or outside the track is a
    ValueError.
    """
    pose = poses_at(track, run["time"].values, offset, rate)
    return run.assign(pose=(("scan", "component"), pose))


def remove_range_bias(run: xr.Dataset, bias: float) -> xr.Dataset:
    """Make all one-way ranges of a run shorter by ``bias`` (m), by how much they are measured too long."""
    signal = lengthen(run["signal"].values, run["frequency"].values, -2.0 * bias)
    return run.assign(signal=(run["signal"].dims, signal))


def sharpness(image: ArrayLike) -> float:
    """Sharpness of an image: ``Σ|x|⁴ / (Σ|x|²)²``, one for a single bright pixel, 0 for an empty image."""
    power = np.abs(np.asarray(image, dtype=np.complex128)) ** 2
    total = float(power.sum())
    return float((power**2).sum()) / total**2 if total > 0 else 0.0


def estimate_clock(
    run: xr.Dataset, track: pd.DataFrame, pixels: ArrayLike, offsets: ArrayLike, operator: Operator,
    rates: ArrayLike = (1.0,), refine: int = 4,
) -> ClockFit:  # fmt: skip
    """Find the clock offset at which the run focuses best; no reflector need be known.

    All offsets are tried, then the best one's neighbourhood with steps halved ``refine`` times. The
    offset's step must be short enough for the focus to be seen: a fraction of what the vehicle
    needs for the image's resolution.

    Parameters
    ----------
    run, track : xarray.Dataset, DataFrame
        A run with times, and the track of the array's reference point.
    pixels : (..., 3) array_like
        Where to look, in the lane frame, m.
    offsets, rates : (trial,), (rate,) array_like
        Clock offsets (s) and rates to try. Offsets that leave the track are passed over; if all do,
        it is a ValueError.
    operator : callable
        ``flgpr.imaging.ImagingOperator``.

    Returns
    -------
    ClockFit
        With the reason in ``doubt`` if the sharpest image is less than 1.3 times as sharp as the
        worst one, or lies at the edge of the offsets. That the ranges are right it cannot tell: see
        :func:`estimate_joint`.
    """
    trials: list[tuple[float, float, float]] = []
    grid = np.asarray(pixels, dtype=np.float64)
    run = run.compute()

    def attempt(offset: float, rate: float) -> None:
        try:
            moved = with_track(run, track, offset, rate)
        except ValueError:
            return
        data, tx, rx = synthetic_aperture(moved)
        image = operator(run["frequency"].values, tx, rx, grid, tolerance=1e-2).adjoint(data)
        trials.append((offset, rate, sharpness(image)))

    steps = np.asarray(offsets, dtype=np.float64)
    for rate in np.asarray(rates, dtype=np.float64):
        for offset in steps:
            attempt(float(offset), float(rate))
    if not trials:
        raise ValueError(_outside(run, track, steps))
    tried = len(trials)
    width = float(np.diff(np.sort(steps)).mean()) if steps.size > 1 else 0.0
    for level in range(refine if width else 0):
        offset, rate, _ = max(trials, key=lambda trial: trial[2])
        for sign in (-1, 1):
            attempt(offset + sign * width / 2 ** (level + 1), rate)
    table = pd.DataFrame(trials, columns=["offset", "rate", "sharpness"])
    offset, rate, top = max(trials, key=lambda trial: trial[2])
    asked = table[:tried]
    lowest = float(asked["sharpness"].min())
    doubt = ""
    if steps.size > 1 and top < _SHARPER * lowest:
        doubt = (
            f"no offset stands out: the sharpest image is but {top / lowest:.2f} times as sharp as the worst, "
            f"{_SHARPER:g} times are asked for: is there anything bright in the area?"
        )
    elif steps.size > 1 and not asked["offset"].min() < offset < asked["offset"].max():
        doubt = f"the best offset, {offset:.3f} s, lies at the edge of those tried: look farther"
    return ClockFit(offset, rate, lowest, table, doubt)


def track_trials(
    run: xr.Dataset, track: pd.DataFrame, offsets: ArrayLike
) -> tuple[FloatArray, list[FloatArray]]:
    """Clock offsets at which all scans lie within the track, and the poses there; no such offset is a ValueError."""
    found: list[tuple[float, FloatArray]] = []
    for offset in np.asarray(offsets, dtype=np.float64):
        with suppress(ValueError):
            found.append((float(offset), poses_at(track, run["time"].values, float(offset))))
    if not found:
        raise ValueError(_outside(run, track, offsets))
    return np.array([offset for offset, _ in found]), [pose for _, pose in found]


def _outside(run: xr.Dataset, track: pd.DataFrame, offsets: ArrayLike) -> str:
    time = run["time"].values
    steps = np.asarray(offsets)
    if not (np.isfinite(time).all() and steps.size):
        return "run must have a time for every scan to take poses from a track, and there must be offsets to try"
    return (
        f"offsets must put the scans inside the track, none from {steps.min():g} to {steps.max():g} s does: scans from "
        f"{time.min():g} to {time.max():g} s, track from {track['time'].iloc[0]:g} to {track['time'].iloc[-1]:g} s"
    )


def brightest_points(
    image: ArrayLike, pixels: ArrayLike, count: int, apart: float
) -> NDArray[np.float64]:
    """Find the brightest pixels, ``apart`` m or more from each other: at most ``count`` rows of x, y, z (m), magnitude.

    ``pixels`` (..., 3) are those of the image (...); the brightest come first.
    """
    level = np.abs(np.asarray(image)).ravel().astype(np.float64)
    places = np.asarray(pixels, dtype=np.float64).reshape(-1, 3)
    points: list[Sequence[float]] = []
    while len(points) < count and np.isfinite(level.max()):
        top = int(level.argmax())
        points.append([*places[top], level[top]])
        level[np.linalg.norm(places - places[top], axis=1) < apart] = -np.inf
    return np.array(points).reshape(-1, 4)
