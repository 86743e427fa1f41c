"""Delay and gain of every pair from a reflector at a known place."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike, NDArray

from flgpr.model import SPEED_OF_LIGHT, check_run, complete_scans, vehicle_to_lane
from flgpr.model.phase import lengthen, path_phase

SLOPES = {"sphere": 0.0, "corner": 1.0}
"""Power of frequency the echo's amplitude follows: a sphere many wavelengths wide, a trihedral corner."""


@dataclass(frozen=True)
class PairFit:
    """Delay and gain of every pair."""

    polarization: tuple[str, ...]  #: polarizations the reflector answers in
    delay: NDArray[np.float64]  #: (polarization, pair): how late the pair's echo comes, s
    #: (polarization, pair): echo over that of a unit reflector, after the delay is removed
    gain: NDArray[np.complex128]
    #: (polarization, pair): height of the echo over the median level within the search, 1; below 3 hardly more than
    #: chance
    contrast: NDArray[np.float64]


def estimate_pairs(run: xr.Dataset, point: ArrayLike, kind: str = "sphere", search: float = 0.5) -> PairFit:
    """Find delay and gain of every pair, in HH and VV, from the echo of a reflector at a known place.

    The echo of a unit reflector is ``f^slope·exp(-j2πfL/c)/(R_t·R_r)``, R in metres and f over its mean. Scans are
    averaged after each is brought to its own path, so that clutter at other places averages out. A corner sends its
    echo back to where it came from: for pairs far apart take a sphere. Neither answers in HV and VH.

    Parameters
    ----------
    run : xarray.Dataset
        A run; without a complete scan, or with neither HH nor VV, it is a ValueError.
    point : (3,) array_like
        Phase centre of the reflector in the lane frame, m.
    kind : {"sphere", "corner"}
        The reflector.
    search : float
        Path lengths to either side of the right one where the echo is looked for, m.
    """
    check_run(run)
    place = np.asarray(point, dtype=np.float64)
    if place.shape != (3,) or not np.isfinite(place).all():
        raise ValueError(f"point must be x, y, z, got {place}")
    if kind not in SLOPES:
        raise ValueError(f"kind must be one of {', '.join(SLOPES)}, got {kind!r}")
    if not search > 0:
        raise ValueError(f"search must be positive, got {search}")
    labels = [str(label) for label in run["polarization"].values]
    rows = [k for k, label in enumerate(labels) if label in ("HH", "VV")]
    scans = np.flatnonzero(complete_scans(run))
    if not rows or not scans.size:
        raise ValueError(f"run must have HH or VV and a complete scan, got {labels} and {scans.size} complete scans")
    frequency = run["frequency"].values
    aligned = np.zeros((len(rows), run.sizes["pair"], frequency.size), np.complex128)
    for scan in scans:
        pose = run["pose"].values[scan]
        legs = [
            np.linalg.norm(vehicle_to_lane(run[name].values, pose) - place, axis=1)
            for name in ("tx_position", "rx_position")
        ]
        data = run["signal"][scan].values[rows].astype(np.complex128)
        aligned += lengthen(data, frequency, -(legs[0] + legs[1])) * (legs[0] * legs[1])[:, None]
    aligned /= scans.size * (frequency / frequency.mean()) ** SLOPES[kind]
    return _fit(tuple(labels[k] for k in rows), aligned, frequency, search)


def _fit(
    labels: tuple[str, ...], aligned: NDArray[np.complex128], frequency: NDArray[np.float64], search: float
) -> PairFit:
    resolution = SPEED_OF_LIGHT / max(float(np.ptp(frequency)), 1.0)
    offsets = np.arange(-search, search + resolution / 16, resolution / 8)
    level = np.abs(aligned @ path_phase(frequency, -offsets).T) / frequency.size
    best = offsets[level.argmax(axis=-1)]
    step = resolution / 8
    while step > 1e-6:
        tries = best[..., None] + np.array([-step, 0.0, step])
        size = np.abs((aligned[..., None, :] * path_phase(frequency, -tries)).sum(axis=-1))
        best = np.take_along_axis(tries, size.argmax(axis=-1)[..., None], axis=-1)[..., 0]
        step /= 2
    gain = lengthen(aligned, frequency, -best).mean(axis=-1)
    contrast = np.abs(gain) / np.maximum(np.median(level, axis=-1), np.finfo(float).tiny)
    return PairFit(labels, best / SPEED_OF_LIGHT, gain, contrast)


def apply_pairs(run: xr.Dataset, fit: PairFit) -> xr.Dataset:
    """Take delays out and make the gains equal, to their root mean square.

    Polarizations that the fit does not hold stay as they are; another number of pairs, or a gain of zero, is a
    ValueError.
    """
    if fit.delay.shape[1] != run.sizes["pair"]:
        raise ValueError(f"run must have {fit.delay.shape[1]} pairs as the calibration has, got {run.sizes['pair']}")
    if (np.abs(fit.gain) == 0).any():
        dead = np.argwhere(np.abs(fit.gain) == 0)[0]
        raise ValueError(
            f"gain must not be zero, it is for {fit.polarization[dead[0]]} pair {dead[1]}: a dead channel?"
        )
    labels = [str(label) for label in run["polarization"].values]
    signal = run["signal"].values.copy()
    scale = np.sqrt(np.mean(np.abs(fit.gain) ** 2))
    for k, label in enumerate(fit.polarization):
        if label in labels:
            row = labels.index(label)
            shifted = lengthen(signal[:, row], run["frequency"].values, -fit.delay[k] * SPEED_OF_LIGHT)
            signal[:, row] = shifted * (scale / fit.gain[k])[:, None]
    return run.assign(signal=(run["signal"].dims, signal))
