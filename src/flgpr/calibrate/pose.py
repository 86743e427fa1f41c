"""Lever arm and latency of a positioning antenna, and motion of the vehicle within a scan."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pandas as pd
import xarray as xr

from flgpr.model import check_run
from flgpr.model.frames import pose_matrix
from flgpr.model.phase import lengthen
from flgpr.model.run import with_signal
from flgpr.model.track import check_track, poses_at
from flgpr.types import ArrayLike, FloatArray, floats


@dataclass(frozen=True)
class LeverFit:
    """Lever arm and latency."""

    lever_arm: FloatArray  #: positioning antenna in the vehicle frame, m
    latency: float  #: how late its time stamps are, s
    rms: float  #: root mean square of the residual, m


def estimate_lever_arm(
    antenna: pd.DataFrame, reference: pd.DataFrame, latencies: ArrayLike = (0.0,), refine: int = 12
) -> LeverFit:
    """Estimate lever arm and latency by least squares.

    Only turns and changes of speed separate the latency from the lever arm along the track.

    Parameters
    ----------
    antenna, reference : DataFrame
        Tracks of the positioning antenna, and of the array's reference point with attitude, such as
        by a total station, which may be shorter.
    latencies : (trial,) array_like
        Latencies to try, s.
    refine : int
        How often the step of several latencies is halved around the best.

    Returns
    -------
    LeverFit
        Lever arm and latency.

    Raises
    ------
    ValueError
        If the tracks do not overlap, or the drive is straight and at one speed.
    """
    check_track(antenna)
    check_track(reference)
    trials = np.sort(floats(latencies))
    fits = []
    for latency in trials:
        fit = _fit(antenna, reference, float(latency))
        if fit is not None:
            fits.append(fit)
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
        earlier = _fit(antenna, reference, best.latency - step)
        later = _fit(antenna, reference, best.latency + step)
        for fit in (earlier, later):
            if fit is not None and fit.rms < best.rms:
                best = fit
    return best


def _fit(antenna: pd.DataFrame, reference: pd.DataFrame, latency: float) -> LeverFit | None:
    """Fit the lever arm for one latency; None if fewer than three fixes overlap."""
    shifted = antenna.assign(time=antenna["time"] - latency)
    time = reference["time"].to_numpy()
    inside = (time >= shifted["time"].iloc[0]) & (time <= shifted["time"].iloc[-1])
    if np.count_nonzero(inside) < 3:
        return None
    pose = poses_at(reference, time[inside])
    difference = poses_at(shifted, time[inside])[:, :3] - pose[:, :3]
    # antenna - reference = R·lever, at every fix
    rotations = pose_matrix(pose).reshape(-1, 3)
    lever, *_ = np.linalg.lstsq(rotations, difference.ravel(), rcond=None)
    residual = difference.ravel() - rotations @ lever
    rms = float(np.sqrt(np.mean(residual**2) * 3))  # of vectors, not of their components
    return LeverFit(floats(lever), latency, rms)


def vehicle_velocity(run: xr.Dataset) -> FloatArray:
    """Return the velocity (scan, 3) in the vehicle frame, m/s, from poses and times of a run.

    Fewer than two scans, or times that are missing or do not increase, are a ValueError.
    """
    pose = run["pose"].values
    time = run["time"].values
    if len(time) < 2 or not np.isfinite(time).all() or (np.diff(time) <= 0).any():
        raise ValueError("run must have two scans or more with increasing times to tell a velocity")
    lane = np.gradient(pose[:, :3], time, axis=0)
    return floats(np.einsum("sij,si->sj", pose_matrix(pose), lane))


def remove_in_scan_motion(
    run: xr.Dataset,
    focus: ArrayLike,
    pair_time: ArrayLike,
    tone_time: ArrayLike,
    velocity: ArrayLike | None = None,
) -> xr.Dataset:
    """Move all tones and pairs of a scan to the scan's time, as if the vehicle had stood still.

    A sample taken at ``pair_time + tone_time`` after the pose was measured with the antennas
    displaced by velocity times that. Its phase is turned by the difference of the path to the
    focus: exact there, and elsewhere off by the displacement times the difference of the
    directions.

    Parameters
    ----------
    run : xarray.Dataset
        A run.
    focus : (3,) array_like
        Point that stays exact, in the vehicle frame, m; on the ground in the middle of the images.
    pair_time, tone_time : (pair,), (frequency,) array_like
        When each pair is measured after the time of the pose, and each tone sent after that, s.
    velocity : (scan, 3) array_like, optional
        Velocity in the vehicle frame, m/s. Default: from poses and times.

    Returns
    -------
    xarray.Dataset
        The corrected run.

    Raises
    ------
    ValueError
        If a shape does not fit the run, or a value is not finite.
    """
    check_run(run)
    if velocity is None:
        velocity = vehicle_velocity(run)
    sizes = run.sizes
    speed = _checked("velocity", velocity, (sizes["scan"], 3))
    pair_delay = _checked("pair_time", pair_time, (sizes["pair"],))
    tone_delay = _checked("tone_time", tone_time, (sizes["frequency"],))
    point = _checked("focus", focus, (3,))

    time = pair_delay[:, None] + tone_delay
    frequency = run["frequency"].values
    signal = np.empty(run["signal"].shape, run["signal"].dtype)
    for scan in range(sizes["scan"]):
        displacement = time[..., None] * speed[scan]
        longer = np.zeros(time.shape)
        for name in ("tx_position", "rx_position"):
            antenna = run[name].values[:, None]
            displaced = np.linalg.norm(antenna + displacement - point, axis=-1)
            longer += displaced - np.linalg.norm(antenna - point, axis=-1)
        sweeps = run["signal"][scan].values
        signal[scan] = lengthen(sweeps[..., None], frequency[:, None], -longer)[..., 0]
    return with_signal(run, signal)


def _checked(name: str, values: ArrayLike, shape: tuple[int, ...]) -> FloatArray:
    """Return values as an array, which must be finite and have a shape."""
    array = floats(values)
    if array.shape != shape or not np.isfinite(array).all():
        raise ValueError(f"{name} must be finite with the shape {shape}, got {array.shape}")
    return array
