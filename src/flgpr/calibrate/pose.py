"""Lever arm and latency of a positioning antenna, from a second track of the same drive."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike, NDArray

from flgpr.model.frames import attitude_matrix, heading_matrix
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

    Latency and the lever arm along the way are told apart only by turns and changes of speed: a straight drive at one
    speed is refused, and so are tracks that do not overlap.

    Parameters
    ----------
    antenna, reference : DataFrame
        Tracks of the positioning antenna, and of the array's reference point with attitude, such as by a total station,
        which may be shorter.
    latencies : (trial,) array_like
        Latencies to try, s; more than one makes it be found, with steps halved ``refine`` times.
    """
    check_track(antenna)
    check_track(reference)
    trials = np.sort(np.asarray(latencies, dtype=np.float64))
    fits = [fit for fit in (_fit(antenna, reference, float(t)) for t in trials) if fit is not None]
    if not fits:
        raise ValueError("the tracks must overlap in time by three fixes or more at some latency, they do not")
    best = min(fits, key=lambda fit: fit.rms)
    if trials.size == 1:
        return best
    if max(fit.rms for fit in fits) < 1.001 * best.rms + 1e-9:
        raise ValueError("the drive must turn or change its speed for the latency to be told, it does not")
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
    turns = np.concatenate([heading_matrix(p[3]) @ attitude_matrix(p[4], p[5]) for p in pose])
    lever, *_ = np.linalg.lstsq(turns, apart.ravel(), rcond=None)
    rest = apart.ravel() - turns @ lever
    return LeverFit(lever, latency, float(np.sqrt(np.mean(rest**2) * 3)))
