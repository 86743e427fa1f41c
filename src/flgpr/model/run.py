"""The run: raw stepped-frequency multistatic data of one pass over a lane.

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

from __future__ import annotations

import warnings
from collections.abc import Mapping
from importlib import import_module
from typing import Any, TypeVar

import numpy as np
import xarray as xr

from flgpr.model.constants import AXES, DIMS, POLARIZATIONS, POSE_COMPONENTS, VARIABLE_ATTRS
from flgpr.types import AnyArray, ArrayLike, BoolArray, ComplexArray, FloatArray, IndexArray, floats

# Hz; smaller numbers are in another unit, for no ground-penetrating radar works there
_LOWEST_FREQUENCY = 1e6
REAL = (
    "signal is real, its imaginary part is zero everywhere: every echo shows a second time, at its "
    "mirrored path, and phases say nothing; import I and Q, or amplitude and phase, of each tone"
)
"""What real data mean."""
Described = TypeVar("Described", xr.Dataset, xr.DataArray)
# Poses and times of runs of one vehicle agree to so much, m and rad, and s.
_POSE_TOLERANCE = 1e-6
_MOST_LABELS = 8  # of polarizations that an error shows
_LONGEST_LABEL = 40  # characters
_TIME_TOLERANCE = 1e-3


@xr.register_dataset_accessor("flgpr")  # type: ignore[no-untyped-call, untyped-decorator]
def _accessor(run: xr.Dataset) -> Any:
    """Return ``run.flgpr``, plots and checks of a run; their modules are loaded for the first."""
    return import_module("flgpr.accessor").RunAccessor(run)


def make_run(
    signal: ArrayLike,
    frequency: ArrayLike,
    polarization: ArrayLike,
    tx_position: ArrayLike,
    rx_position: ArrayLike,
    pose: ArrayLike,
    time: ArrayLike | None = None,
    attrs: Mapping[str, Any] | None = None,
) -> xr.Dataset:
    """Assemble and validate a run.

    Parameters
    ----------
    signal : (scan, polarization, pair, frequency) array_like of complex
        Received field over transmitted field. Sweeps with values that are not finite are missing, and
        so are those of a scan of zeros beside other scans. A real signal is warned of.
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

    Raises
    ------
    ValueError
        If a parameter breaks its rule.
    """
    data = _checked_signal(signal)
    if is_real(data):
        warnings.warn(REAL, stacklevel=2)
    scans, polarizations, pairs, tones = data.shape
    valid = measured_sweeps(data)
    if not valid.any():  # scans of zeros alone are kept, and lost sweeps are not
        valid = np.asarray(np.isfinite(data).all(axis=-1))
    if not valid.any():
        raise ValueError("signal must hold at least one sweep of finite values, got none")
    run = xr.Dataset(
        data_vars={
            "signal": (DIMS["signal"], data),
            "valid": (DIMS["valid"], valid),
            "tx_position": (DIMS["tx_position"], _positions(tx_position, "tx_position", pairs)),
            "rx_position": (DIMS["rx_position"], _positions(rx_position, "rx_position", pairs)),
            "pose": (DIMS["pose"], check_poses(pose, scans)),
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
    return described(run, VARIABLE_ATTRS)


def is_real(signal: ComplexArray) -> bool:
    """Return whether a signal has no imaginary part, though it changes from tone to tone."""
    if signal.imag.any():
        return False
    steps = np.diff(signal.real)
    return bool((steps[np.isfinite(steps)] != 0).any())


def described(data: Described, attrs: Mapping[str, Mapping[str, str]]) -> Described:
    """Give the variables of a run or an image their units and names, by which they are plotted."""
    if isinstance(data, xr.DataArray):
        data.attrs.update(attrs.get(str(data.name), {}))
    for name in data.variables if isinstance(data, xr.Dataset) else data.coords:
        data[name].attrs.update(attrs.get(str(name), {}))
    return data


def _checked_signal(signal: ArrayLike) -> ComplexArray:
    """Return a signal as complex64, which must have four dimensions and hold a number."""
    data = np.asarray(signal)
    if data.ndim != 4:
        raise ValueError(
            "signal must have the dimensions (scan, polarization, pair, frequency), "
            f"got shape {data.shape}"
        )
    if not np.issubdtype(data.dtype, np.inexact):
        raise ValueError(f"signal must be complex numbers, got {data.dtype}")
    if data.size == 0:
        raise ValueError(
            "signal must hold at least one scan, polarization, pair and frequency, "
            f"got shape {data.shape}"
        )
    return data.astype(np.complex64, copy=False)


def measured_sweeps(signal: ComplexArray) -> BoolArray:
    """Mark the sweeps (..., polarization, pair) that were measured, of one scan or of several.

    All their tones are finite, and their scan holds more than zeros.
    """
    holds_something = np.asarray(signal.any(axis=(-3, -2, -1)))[..., None, None]
    return np.asarray(np.isfinite(signal).all(axis=-1) & holds_something, dtype=np.bool_)


def check_frequency(frequency: ArrayLike, count: int | None = None) -> FloatArray:
    """Return a validated frequency axis, Hz, as float64.

    It must be finite, strictly increasing and as long as ``count``; else it is a ValueError.
    """
    tones = floats(frequency)
    if tones.ndim != 1 or tones.size == 0 or (count is not None and tones.size != count):
        expected = "at least one tone" if count is None else f"{count} tones"
        raise ValueError(
            f"frequency must be one-dimensional with {expected}, got shape {tones.shape}"
        )
    infinite = np.count_nonzero(~np.isfinite(tones))
    if infinite:
        raise ValueError(f"frequency must be finite, got {infinite} values that are not")
    if tones.min() < _LOWEST_FREQUENCY:
        unit = "GHz" if tones.max() < 100 else "MHz or kHz"
        raise ValueError(
            f"frequency must be in hertz (at least {_LOWEST_FREQUENCY:.0e} Hz), "
            f"got {tones.min():g} to {tones.max():g}: is it in {unit}?"
        )
    if (np.diff(tones) <= 0).any():
        first = int(np.argmax(np.diff(tones) <= 0))
        raise ValueError(
            f"frequency must increase strictly, got {tones[first]:g} Hz followed by "
            f"{tones[first + 1]:g} Hz at {first}"
        )
    return tones


def check_run(run: xr.Dataset) -> xr.Dataset:
    """Return a dataset that is a run, as :func:`make_run` makes it; the signal itself is not read.

    A variable or dimension that is missing or holds values a run may not hold is a ValueError.
    """
    missing = [name for name in VARIABLE_ATTRS if name not in run.variables]
    if missing:
        raise ValueError(
            f"run must hold the variables {', '.join(VARIABLE_ATTRS)}; "
            f"missing: {', '.join(missing)}"
        )
    order = DIMS["signal"]
    if run["signal"].dims != order:
        raise ValueError(f"run.signal must have the dimensions {order}, got {run['signal'].dims}")
    check_frequency(run["frequency"].values, run.sizes["frequency"])
    _polarization_labels(run["polarization"].values, run.sizes["polarization"])
    _positions(run["tx_position"].values, "tx_position", run.sizes["pair"])
    _positions(run["rx_position"].values, "rx_position", run.sizes["pair"])
    check_poses(run["pose"].values, run.sizes["scan"])
    return run


def polarizations_of(data: xr.Dataset | xr.DataArray) -> list[str]:
    """Return the labels of the polarizations of a run, an image or a run-view."""
    return [str(label) for label in data["polarization"].values]


def complete_scans(run: xr.Dataset) -> BoolArray:
    """Mark the scans (scan,) with every sweep; a gap changes the array, so it is not processed."""
    return np.asarray(run["valid"].values.all(axis=(1, 2)), dtype=np.bool_)


def complete_scan_numbers(run: xr.Dataset) -> IndexArray:
    """Return the numbers of the scans with every sweep; a run without one is a ValueError."""
    numbers = np.flatnonzero(complete_scans(run))
    if not numbers.size:
        raise ValueError(
            f"run must have a scan without missing sweeps, got none among {run.sizes['scan']}"
        )
    return numbers


def with_signal(run: xr.Dataset, signal: AnyArray) -> xr.Dataset:
    """Return a run with another signal of the same shape, in the precision of its own."""
    of_run = run["signal"]
    signal = signal.astype(of_run.dtype, copy=False)
    return run.assign(signal=(of_run.dims, signal, of_run.attrs))


def _positions(value: ArrayLike, name: str, pairs: int) -> FloatArray:
    """Return checked antenna positions (pair, 3)."""
    array = floats(value)
    if array.shape != (pairs, 3):
        raise ValueError(f"{name} must have the shape (pair, 3) = ({pairs}, 3), got {array.shape}")
    if not np.isfinite(array).all():
        bad = np.flatnonzero(~np.isfinite(array).all(axis=1))
        raise ValueError(
            f"{name} must be finite, got other values for pair {', '.join(map(str, bad[:5]))}"
        )
    return array


def check_poses(value: ArrayLike, scans: int) -> FloatArray:
    """Return checked poses (scan, 6) of so many scans, finite and in radians, as float64."""
    if value is None:
        raise ValueError("pose must give x, y, z, heading, pitch, roll of every scan, got none")
    array = floats(value)
    if array.shape != (scans, 6):
        raise ValueError(
            f"pose must have the shape (scan, 6) = ({scans}, 6): "
            f"x, y, z, heading, pitch, roll of every scan, got {array.shape}"
        )
    missing = np.flatnonzero(~np.isfinite(array).all(axis=1))
    if missing.size:
        raise ValueError(
            f"pose must be finite for every scan, got a missing pose for {missing.size} of {scans} "
            f"scans (first: scan {missing[0]}); drop those scans or interpolate their poses before"
        )
    heading = np.abs(array[:, 3]).max()
    tilt = np.abs(array[:, 4:]).max()
    if heading > 2 * np.pi or tilt > np.pi / 2:
        raise ValueError(
            "pose must have its heading within ±2π and its pitch and roll within ±π/2 radians, "
            f"got up to {heading:g} and {tilt:g}: are they in degrees?"
        )
    return array


def _polarization_labels(value: ArrayLike, count: int) -> list[str]:
    """Return checked labels of so many polarizations, all known and different."""
    labels = [str(label) for label in np.atleast_1d(np.asarray(value))]
    check_polarization(labels, count)
    return labels


def check_polarization(labels: list[str], count: int | None = None) -> None:
    """Refuse labels of polarizations that are unknown, repeated, or of another number.

    Parameters
    ----------
    labels : list of str
        The labels.
    count : int, optional
        How many there must be; by default any number.

    Raises
    ------
    ValueError
        If one is unknown or repeated, or there are more or fewer.
    """
    unknown = [label for label in labels if label not in POLARIZATIONS]
    if unknown:
        listed = ", ".join(repr(label[:_LONGEST_LABEL]) for label in unknown[:_MOST_LABELS])
        raise ValueError(f"polarization must be among {', '.join(POLARIZATIONS)}, got {listed}")
    expected = len(labels) if count is None else count
    if len(labels) != expected or len(set(labels)) != expected:
        raise ValueError(
            f"polarization must name {expected} different polarizations, "
            f"got {labels[:_MOST_LABELS]}"
        )


def _times(value: ArrayLike | None, scans: int) -> FloatArray:
    """Return checked times (scan,), NaN if there are none."""
    if value is None:
        return np.full(scans, np.nan)
    array = floats(value)
    if array.shape != (scans,):
        raise ValueError(f"time must have the shape (scan,) = ({scans},), got {array.shape}")
    if (np.diff(array) < 0).any():
        raise ValueError("time must not decrease from scan to scan")
    return array


def check_shared_poses(runs: Mapping[str, xr.Dataset]) -> None:
    """Check that runs, by name and at least one, were taken together by one vehicle.

    Each may have its own height. Scans, poses or times that differ otherwise are a ValueError.
    """
    names = list(runs)
    first = runs[names[0]]
    for name in names[1:]:
        run = runs[name]
        pose = first["pose"].values
        other_pose = run["pose"].values
        if pose.shape != other_pose.shape:
            raise ValueError(
                f"runs must share their poses: {names[0]} has {len(pose)} scans, "
                f"{name} has {len(other_pose)}"
            )
        distance = np.abs(np.delete(pose - other_pose, 2, axis=1)).max()
        height = np.ptp(pose[:, 2] - other_pose[:, 2])
        # NaN where there are no times
        delay = np.nan_to_num(np.abs(first["time"].values - run["time"].values)).max()
        if not (max(distance, height) <= _POSE_TOLERANCE and delay <= _TIME_TOLERANCE):
            raise ValueError(
                f"runs must share their poses: {names[0]} and {name} are up to {distance:.3g} m or "
                f"rad apart, their heights by {height:.3g} m from scan to scan, "
                f"their times by {delay:.3g} s"
            )
