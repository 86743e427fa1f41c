"""Lever arm and latency of a positioning antenna; motion in a scan: a vehicle that drives while its array switches."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pandas as pd
import xarray as xr
from numpy.typing import ArrayLike, NDArray

from flgpr.model import check_run
from flgpr.model.arrays import FloatArray
from flgpr.model.frames import pose_matrix
from flgpr.model.phase import lengthen
from flgpr.model.track import check_track, poses_at


@dataclass(frozen=True)
class LeverFit:
    """Lever arm and latency."""

    lever_arm: NDArray[np.float64]  #: positioning antenna in the vehicle frame, m
    latency: float  #: how late its time stamps are, s
    rms: float  #: root mean square of what is left, m


def estimate_lever_arm(
    antenna: pd.DataFrame, reference: pd.DataFrame, latencies: ArrayLike = (0.0,), refine: int = 12
) -> LeverFit:
    """Find lever arm and latency by least squares.

    Latency and the lever arm along the way are told apart only by turns and changes of speed: a
    straight drive at one speed is refused, and so are tracks that do not overlap.

    Parameters
    ----------
    antenna, reference : DataFrame
        Tracks of the positioning antenna, and of the array's reference point with attitude, such as
        by a total station, which may be shorter.
    latencies : (trial,) array_like
        Latencies to try, s; more than one makes it be found, with steps halved ``refine`` times.
    """
    check_track(antenna)
    check_track(reference)
    trials = np.sort(np.asarray(latencies, dtype=np.float64))
    fits = [fit for fit in (_fit(antenna, reference, float(t)) for t in trials) if fit is not None]
    if not fits:
        raise ValueError(
            "the tracks must overlap in time by three fixes or more at some latency, they do not"
        )
    best = min(fits, key=lambda fit: fit.rms)
    if trials.size == 1:
        return best
    if max(fit.rms for fit in fits) < 1.001 * best.rms + 1e-9:
        raise ValueError(
            "the drive must turn or change its speed for the latency to be told, it does not"
        )
    step = float(np.diff(trials).max())
    for _ in range(refine):
        step /= 2
        near = [_fit(antenna, reference, best.latency + sign * step) for sign in (-1, 1)]
        best = min([best, *(fit for fit in near if fit is not None)], key=lambda fit: fit.rms)
    return best


def _fit(antenna: pd.DataFrame, reference: pd.DataFrame, latency: float) -> LeverFit | None:
    shifted = antenna.assign(time=antenna["time"] - latency)
    time = reference["time"].to_numpy()
    inside = (time >= shifted["time"].iloc[0]) & (time <= shifted["time"].iloc[-1])
    if np.count_nonzero(inside) < 3:
        return None
    pose = poses_at(reference, time[inside])
    apart = poses_at(shifted, time[inside])[:, :3] - pose[:, :3]
    turns = pose_matrix(pose).reshape(-1, 3)
    lever, *_ = np.linalg.lstsq(turns, apart.ravel(), rcond=None)
    rest = apart.ravel() - turns @ lever
    return LeverFit(
        np.asarray(lever, dtype=np.float64), latency, float(np.sqrt(np.mean(rest**2) * 3))
    )


def vehicle_velocity(run: xr.Dataset) -> FloatArray:
    """Velocity (scan, 3) in the vehicle frame, m/s, from a run's poses and times, which must be there and increase."""
    pose = run["pose"].values
    time = run["time"].values
    if len(time) < 2 or not np.isfinite(time).all() or (np.diff(time) <= 0).any():
        raise ValueError("run must have two scans or more with increasing times to tell a velocity")
    lane = np.gradient(pose[:, :3], time, axis=0)
    return np.asarray(np.einsum("sij,si->sj", pose_matrix(pose), lane), dtype=np.float64)


def remove_in_scan_motion(
    run: xr.Dataset,
    focus: ArrayLike,
    pair_time: ArrayLike,
    tone_time: ArrayLike,
    velocity: ArrayLike | None = None,
) -> xr.Dataset:
    """Bring all tones and pairs of a scan to the scan's time, as if the vehicle had stood still in it.

    A sample taken at ``pair_time + tone_time`` after the pose was measured with the antennas
    displaced by velocity times that. Its phase is turned by the difference of the path to the
    focus: exact there, and elsewhere off by the displacement times the difference of the
    directions.

    Parameters
    ----------
    run : xarray.Dataset
        A run. A shape below that does not fit it, or a value that is not finite, is a ValueError.
    focus : (3,) array_like
        The place that stays exact, in the vehicle frame, m; on the ground in the middle of the
        images.
    pair_time, tone_time : (pair,), (frequency,) array_like
        When each pair is measured after the time of the pose, and each tone sent after that, s.
    velocity : (scan, 3) array_like, optional
        Velocity in the vehicle frame, m/s. Default: from poses and times.
    """
    check_run(run)
    speed = vehicle_velocity(run) if velocity is None else np.asarray(velocity, dtype=np.float64)
    when = [np.asarray(t, dtype=np.float64) for t in (pair_time, tone_time)]
    place = np.asarray(focus, dtype=np.float64)
    sizes = run.sizes
    for name, value, shape in (
        ("velocity", speed, (sizes["scan"], 3)),
        ("pair_time", when[0], (sizes["pair"],)),
        ("tone_time", when[1], (sizes["frequency"],)),
        ("focus", place, (3,)),
    ):
        if value.shape != shape or not np.isfinite(value).all():
            raise ValueError(f"{name} must be finite with the shape {shape}, got {value.shape}")
    time = when[0][:, None] + when[1]
    frequency = run["frequency"].values
    signal = np.empty(run["signal"].shape, run["signal"].dtype)
    for scan in range(sizes["scan"]):
        moved = time[..., None] * speed[scan]
        longer = np.zeros(time.shape)
        for name in ("tx_position", "rx_position"):
            antenna = run[name].values[:, None]
            longer += np.linalg.norm(antenna + moved - place, axis=-1) - np.linalg.norm(
                antenna - place, axis=-1
            )
        one = run["signal"][scan].values
        signal[scan] = lengthen(one[..., None], frequency[:, None], -longer)[..., 0]
    return run.assign(signal=(run["signal"].dims, signal))
