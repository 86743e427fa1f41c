"""The run: raw stepped-frequency multistatic data of one pass over a lane."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike, NDArray

from flgpr.model.constants import AXES, POLARIZATIONS, POSE_COMPONENTS

# Hz; anything below is a unit other than hertz, for no ground-penetrating radar works there
_LOWEST_FREQUENCY = 1e6
# m and rad, s; runs of one vehicle are told apart by their heights alone
_MOUNT = 1e-6
_LATE = 1e-3


def make_run(
    signal: ArrayLike, frequency: ArrayLike, polarization: ArrayLike, tx_position: ArrayLike, rx_position: ArrayLike,
    pose: ArrayLike, time: ArrayLike | None = None, attrs: Mapping[str, Any] | None = None,
) -> xr.Dataset:  # fmt: skip
    """Assemble and validate a run: a ValueError names the parameter, the rule it breaks and the value received.

    Parameters
    ----------
    signal : (scan, polarization, pair, frequency) array_like of complex
        Received field over transmitted field, arbitrary common scale. A sweep that holds a value
        which is not finite counts as missing: it is kept as it is and flagged in ``valid``.
    frequency : (frequency,) array_like
        Tones in Hz, strictly increasing; they need not be uniform.
    polarization : (polarization,) array_like of str
        Each of HH, HV, VH, VV at most once; "HV" transmits H and receives V.
    tx_position, rx_position : (pair, 3) array_like
        Antenna positions x, y, z of each pair in the vehicle frame, m.
    pose : (scan, 6) array_like
        x, y, z (m), heading, pitch, roll (rad) of the vehicle frame in the lane frame.
    time : (scan,) array_like, optional
        Time of each scan, s; NaN where unknown (the default).
    attrs : mapping, optional
        Free description, kept with the run; must be writable as JSON.

    Returns
    -------
    xarray.Dataset
        Variables ``signal`` (complex64), ``valid`` (scan, polarization, pair), ``tx_position``,
        ``rx_position``, ``pose``; coordinates ``frequency``, ``polarization``, ``time``.

    Examples
    --------
    >>> import numpy as np
    >>> from flgpr.model import make_run
    >>> frequency = 0.5e9 + 5e6 * np.arange(64)  # Hz
    >>> antennas = [[-0.5, 0.0, 0.0], [0.5, 0.0, 0.0]]  # m in the vehicle frame, a row per pair
    >>> pose = [[0, 0, 1.5, 0, 0, 0], [0, 0.5, 1.5, 0, 0, 0]]  # x, y, z, heading, pitch, roll
    >>> run = make_run(np.zeros((2, 1, 2, 64)), frequency, ["VV"], antennas, antennas, pose)
    >>> dict(run["signal"].sizes)
    {'scan': 2, 'polarization': 1, 'pair': 2, 'frequency': 64}
    """
    data = np.asarray(signal)
    if data.ndim != 4:
        raise ValueError(
            f"signal must have the dimensions (scan, polarization, pair, frequency), got shape {data.shape}"
        )
    if not (
        np.issubdtype(data.dtype, np.complexfloating) or np.issubdtype(data.dtype, np.floating)
    ):
        raise ValueError(f"signal must be complex numbers, got {data.dtype}")
    data = data.astype(np.complex64, copy=False)
    scans, polarizations, pairs, tones = data.shape
    if data.size == 0:
        raise ValueError(
            f"signal must hold at least one scan, polarization, pair and frequency, got shape {data.shape}"
        )
    valid = np.isfinite(data).all(axis=-1)
    if not valid.any():
        raise ValueError("signal must hold at least one sweep of finite values, got none")
    return xr.Dataset(
        data_vars={
            "signal": (("scan", "polarization", "pair", "frequency"), data),
            "valid": (("scan", "polarization", "pair"), valid),
            "tx_position": (("pair", "axis"), _positions(tx_position, "tx_position", pairs)),
            "rx_position": (("pair", "axis"), _positions(rx_position, "rx_position", pairs)),
            "pose": (("scan", "component"), check_poses(pose, scans)),
        },
        coords={
            "frequency": ("frequency", check_frequency(frequency, tones)),
            "polarization": ("polarization", _polarization_labels(polarization, polarizations)),
            "time": ("scan", _times(time, scans)),
            "axis": ("axis", list(AXES)),
            "component": ("component", list(POSE_COMPONENTS)),
        },
        attrs=dict(attrs or {}),
    )


def check_frequency(frequency: ArrayLike, count: int | None = None) -> NDArray[np.float64]:
    """Validate a frequency axis, Hz: finite, strictly increasing, as long as ``count``; give it as float64."""
    tones = np.asarray(frequency, dtype=np.float64)
    if tones.ndim != 1 or tones.size == 0 or (count is not None and tones.size != count):
        want = "at least one tone" if count is None else f"{count} tones"
        raise ValueError(f"frequency must be one-dimensional with {want}, got shape {tones.shape}")
    if not np.isfinite(tones).all():
        raise ValueError(
            f"frequency must be finite, got {np.count_nonzero(~np.isfinite(tones))} values that are not"
        )
    if tones.min() < _LOWEST_FREQUENCY:
        raise ValueError(
            f"frequency must be in hertz (at least {_LOWEST_FREQUENCY:.0e} Hz), "
            f"got {tones.min():g} to {tones.max():g}: is it in {'GHz' if tones.max() < 100 else 'MHz or kHz'}?"
        )
    if (np.diff(tones) <= 0).any():
        first = int(np.argmax(np.diff(tones) <= 0))
        raise ValueError(
            f"frequency must increase strictly, got {tones[first]:g} Hz followed by {tones[first + 1]:g} Hz at {first}"
        )
    return tones


def check_run(run: xr.Dataset) -> xr.Dataset:
    """Validate that a dataset is a run, as :func:`make_run` makes it, and give it back; the signal itself is not read.

    A variable or dimension that is missing or holds values a run may not hold is a ValueError.
    """
    needed = (
        "signal",
        "valid",
        "tx_position",
        "rx_position",
        "pose",
        "frequency",
        "polarization",
        "time",
    )
    missing = [name for name in needed if name not in run.variables]
    if missing:
        raise ValueError(
            f"run must hold the variables {', '.join(needed)}; missing: {', '.join(missing)}"
        )
    order = ("scan", "polarization", "pair", "frequency")
    if run["signal"].dims != order:
        raise ValueError(f"run.signal must have the dimensions {order}, got {run['signal'].dims}")
    check_frequency(run["frequency"].values, run.sizes["frequency"])
    _polarization_labels(run["polarization"].values, run.sizes["polarization"])
    _positions(run["tx_position"].values, "tx_position", run.sizes["pair"])
    _positions(run["rx_position"].values, "rx_position", run.sizes["pair"])
    check_poses(run["pose"].values, run.sizes["scan"])
    return run


def complete_scans(run: xr.Dataset) -> NDArray[np.bool_]:
    """Tell which scans have every sweep (scan,): a gap changes the array, and the scan is left out of processing."""
    return np.asarray(run["valid"].values.all(axis=(1, 2)), dtype=np.bool_)


def _positions(value: ArrayLike, name: str, pairs: int) -> NDArray[np.float64]:
    array = np.asarray(value, dtype=np.float64)
    if array.shape != (pairs, 3):
        raise ValueError(f"{name} must have the shape (pair, 3) = ({pairs}, 3), got {array.shape}")
    if not np.isfinite(array).all():
        bad = np.flatnonzero(~np.isfinite(array).all(axis=1))
        raise ValueError(
            f"{name} must be finite, got other values for pair {', '.join(map(str, bad[:5]))}"
        )
    return array


def check_poses(value: ArrayLike, scans: int) -> NDArray[np.float64]:
    """Validate poses (scan, 6) of so many scans: finite, angles in radians; give them as float64."""
    if value is None:
        raise ValueError("pose must give x, y, z, heading, pitch, roll of every scan, got none")
    array = np.asarray(value, dtype=np.float64)
    if array.shape != (scans, 6):
        raise ValueError(
            f"pose must have the shape (scan, 6) = ({scans}, 6): x, y, z, heading, pitch, roll of every scan, "
            f"got {array.shape}"
        )
    missing = np.flatnonzero(~np.isfinite(array).all(axis=1))
    if missing.size:
        raise ValueError(
            f"pose must be finite for every scan, got a missing pose for {missing.size} of {scans} scans "
            f"(first: scan {missing[0]}); drop those scans or interpolate their poses before"
        )
    if np.abs(array[:, 3]).max() > 2 * np.pi or np.abs(array[:, 4:]).max() > np.pi / 2:
        raise ValueError(
            "pose must have its heading within ±2π and its pitch and roll within ±π/2 radians, got up to "
            f"{np.abs(array[:, 3]).max():g} and {np.abs(array[:, 4:]).max():g}: are they in degrees?"
        )
    return array


def _polarization_labels(value: ArrayLike, count: int) -> list[str]:
    labels = [str(label) for label in np.atleast_1d(np.asarray(value))]
    unknown = [label for label in labels if label not in POLARIZATIONS]
    if unknown:
        raise ValueError(
            f"polarization must be among {', '.join(POLARIZATIONS)}, got {', '.join(map(repr, unknown))}"
        )
    if len(labels) != count or len(set(labels)) != count:
        raise ValueError(f"polarization must name {count} different polarizations, got {labels}")
    return labels


def _times(value: ArrayLike | None, scans: int) -> NDArray[np.float64]:
    if value is None:
        return np.full(scans, np.nan)
    array = np.asarray(value, dtype=np.float64)
    if array.shape != (scans,):
        raise ValueError(f"time must have the shape (scan,) = ({scans},), got {array.shape}")
    if (np.diff(array) < 0).any():
        raise ValueError("time must not decrease from scan to scan")
    return array


def check_shared_poses(runs: Mapping[str, xr.Dataset]) -> None:
    """Make sure that runs, by name and at least one, were taken together: one vehicle, each at its own height.

    Scans, poses or times that differ by more than that height are a ValueError.
    """
    (first, one), *others = runs.items()
    for name, other in others:
        a = one["pose"].values
        b = other["pose"].values
        if a.shape != b.shape:
            raise ValueError(
                f"runs must share their poses: {first} has {len(a)} scans, {name} has {len(b)}"
            )
        apart = np.abs(np.delete(a - b, 2, axis=1)).max()
        height = np.ptp(a[:, 2] - b[:, 2])
        late = np.nan_to_num(
            np.abs(one["time"].values - other["time"].values)
        ).max()  # NaN where there are no times
        if not (max(apart, height) <= _MOUNT and late <= _LATE):
            raise ValueError(
                f"runs must share their poses: {first} and {name} are up to {apart:.3g} m or rad apart, their heights "
                f"by {height:.3g} m from scan to scan, their times by {late:.3g} s"
            )
