"""Clock offset and range bias between a radar and the instrument that tells its positions."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr
from numpy.typing import ArrayLike, NDArray

from flgpr.model import check_run, complete_scans, vehicle_to_lane
from flgpr.model.phase import lengthen
from flgpr.model.track import poses_at

Operator = Callable[..., Any]
"""Makes an imaging operator from frequency, tx_position, rx_position and pixels: ``flgpr.imaging.ImagingOperator``."""


@dataclass(frozen=True)
class ClockFit:
    """Clock of the track against the radar's."""

    #: offset, rate: time on the track's clock is ``offset + rate·(radar's time)``, s and 1
    offset: float
    rate: float
    trials: pd.DataFrame  #: what was tried: offset (s), rate, sharpness


@dataclass(frozen=True)
class BiasFit:
    """Range bias of a radar."""

    bias: float  #: by how much one-way ranges are measured too long, m
    #: per reflector: its place x, y, z, where its image peaks (x_peak, y_peak), and the bias it tells, m
    points: pd.DataFrame


def with_track(run: xr.Dataset, track: pd.DataFrame, offset: float, rate: float = 1.0) -> xr.Dataset:
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


def synthetic_aperture(run: xr.Dataset) -> tuple[NDArray[Any], NDArray[np.float64], NDArray[np.float64]]:
    """Take all complete scans of a run as one aperture: field (polarization, scan·pair, frequency) and antennas, m.

    The antennas' places (scan·pair, 3), transmitting and receiving, are in the lane frame. Each scan is weighted by the
    way it stands for (half the distance to its neighbours; the mean is one), so that a vehicle that stands still for a
    while is not counted for every scan. A run without a complete scan is a ValueError.
    """
    check_run(run)
    scans = np.flatnonzero(complete_scans(run))
    if not scans.size:
        raise ValueError(f"run must have a scan without missing sweeps, got none among {run.sizes['scan']}")
    pose = run["pose"].values[scans]
    tx, rx = (
        np.concatenate([vehicle_to_lane(run[name].values, one) for one in pose])
        for name in ("tx_position", "rx_position")
    )
    data = run["signal"].values[scans] * way_weights(pose[:, :3])[:, None, None, None]
    return data.transpose(1, 0, 2, 3).reshape(data.shape[1], -1, data.shape[3]), tx, rx


def way_weights(position: ArrayLike) -> NDArray[np.float64]:
    """Share of the way that each position (scan, 3) stands for, half the way to both neighbours over the mean."""
    points = np.asarray(position, dtype=np.float64)
    step = np.linalg.norm(np.diff(points, axis=0), axis=1)
    share = 0.5 * (np.append(step, 0.0) + np.append(0.0, step))
    return share / share.mean() if share.sum() > 0 else np.ones(len(points))


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

    All offsets are tried, then the best one's neighbourhood with steps halved ``refine`` times. The offset's step must
    be short enough for the focus to be seen: a fraction of what the vehicle needs for the image's resolution.

    Parameters
    ----------
    run, track : xarray.Dataset, DataFrame
        A run with times, and the track of the array's reference point.
    pixels : (..., 3) array_like
        Where to look, in the lane frame, m.
    offsets, rates : (trial,), (rate,) array_like
        Clock offsets (s) and rates to try. Offsets that leave the track are passed over; if all do, it is a ValueError.
    operator : callable
        ``flgpr.imaging.ImagingOperator``.
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
        raise ValueError(f"offsets must put the scans inside the track, none from {steps.min():g} to {steps.max():g} s")
    width = float(np.diff(np.sort(steps)).mean()) if steps.size > 1 else 0.0
    for level in range(refine if width else 0):
        offset, rate, _ = max(trials, key=lambda trial: trial[2])
        for sign in (-1, 1):
            attempt(offset + sign * width / 2 ** (level + 1), rate)
    table = pd.DataFrame(trials, columns=["offset", "rate", "sharpness"])
    best = max(trials, key=lambda trial: trial[2])
    return ClockFit(best[0], best[1], table)


def estimate_range_bias(
    run: xr.Dataset, points: ArrayLike, operator: Operator, search: float = 0.6, spacing: float = 0.02, passes: int = 3
) -> BiasFit:
    """Find the range bias from reflectors at known places.

    Around each reflector the image's brightest pixel is found; the bias is by how much it lies farther from the
    aperture than the reflector, on average over the aperture and the reflectors. Where the brightest pixel lies across
    the line of sight does not enter, so the reflectors' separation across it remains a check.

    Parameters
    ----------
    run : xarray.Dataset
        A run with the poses of the right clock; one without a complete scan is a ValueError.
    points : (reflector, 3) array_like
        Places of the reflectors in the lane frame, m, at least one.
    operator : callable
        ``flgpr.imaging.ImagingOperator``.
    search, spacing : float
        Half width of the squares searched and their pixel spacing, m.
    passes : int
        How often the bias found is removed and looked for again.
    """
    places = np.asarray(points, dtype=np.float64)
    if places.ndim != 2 or places.shape[1] != 3 or not len(places):
        raise ValueError(f"points must have the shape (reflector, 3) with at least one, got {places.shape}")
    data, tx, rx = synthetic_aperture(run)
    weight = np.abs(data).sum(axis=(0, 2)) + np.finfo(float).tiny
    side = np.arange(-search, search + spacing / 2, spacing)
    square = np.stack([*np.meshgrid(side, side), np.zeros((side.size, side.size))], axis=-1)
    bias = 0.0
    rows: list[tuple[float, ...]] = []
    for _ in range(passes):
        rows, found = [], []
        moved = lengthen(data, run["frequency"].values, -2.0 * bias)
        for place in places:
            pixels = place + square
            image = operator(run["frequency"].values, tx, rx, pixels).adjoint(moved)
            power = (np.abs(image) ** 2).sum(axis=(0, 1))
            peak = pixels[np.unravel_index(power.argmax(), power.shape)]
            off = float(np.average(_paths(tx, rx, peak) - _paths(tx, rx, place), weights=weight)) / 2
            found.append(off)
            rows.append((*place, *peak[:2], bias + off))
        bias += float(np.mean(found))
    return BiasFit(bias, pd.DataFrame(rows, columns=["x", "y", "z", "x_peak", "y_peak", "bias"]))


def brightest_points(image: ArrayLike, pixels: ArrayLike, count: int, apart: float) -> NDArray[np.float64]:
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


def _paths(tx: NDArray[np.float64], rx: NDArray[np.float64], point: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.asarray(np.linalg.norm(tx - point, axis=1) + np.linalg.norm(rx - point, axis=1), dtype=np.float64)
