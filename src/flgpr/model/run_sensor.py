"""The sensor of a run: its own antennas, tones, polarizations and height, as a sensor's file has.

A run does not hold the antennas' pattern, their tilt and the radar's errors: these are those of
another sensor.
"""

from __future__ import annotations

import numpy as np
import xarray as xr

from flgpr.model.frames import vehicle_to_scan
from flgpr.model.run import complete_scan_numbers, polarizations_of
from flgpr.model.sensor import Footprint, Sensor, load_sensor, sensor_presets
from flgpr.types import FloatArray

_SAME_PLACE = 0.01  # m between antennas that are the same
_RASTER = 0.01  # of a step: as far may a tone lie off an even raster
# The height is rounded, so that lanes of one vehicle have one sensor.
_HEIGHTS_PER_METRE = 20
_NOISE_HEIGHTS = 3.2  # heights ahead at which the noise is given, as of sri-array


def has_array_of(sensor: Sensor, run: xr.Dataset) -> bool:
    """Return whether a sensor has the antennas and the tones of a run, and its polarizations."""
    tones = sensor.tones.axis()
    if (
        not set(polarizations_of(run)) <= set(sensor.polarization)
        or tones.size != run.sizes["frequency"]
    ):
        return False
    if not np.array_equal(np.round(tones), np.round(run["frequency"].values)):
        return False
    for end, places in zip(("tx", "rx"), sensor.pairs(), strict=True):
        of_run = run[f"{end}_position"].values
        if of_run.shape != places.shape or not np.allclose(of_run, places, atol=_SAME_PLACE):
            return False
    return True


def preset_of(run: xr.Dataset) -> str:
    """Return the packaged sensor that has the antennas and tones of a run; "" if none has.

    Examples
    --------
    >>> from flgpr.model.run_sensor import preset_of
    >>> from flgpr.store import open_run, sample_lane
    >>> preset_of(open_run(sample_lane() / "run.zarr"))
    'full-wave'
    """
    for name in sensor_presets():
        if has_array_of(load_sensor(name), run):
            return name
    return ""


def sensor_of_run(run: xr.Dataset, antennas: Sensor, footprint: Footprint | None = None) -> Sensor:
    """Return the sensor that took a run, as far as the run tells.

    Places of antennas, tones, polarizations and height are those of the run. The height is rounded
    to 5 cm. Tones that are missing on an even raster are among the sensor's.

    Parameters
    ----------
    run : xarray.Dataset
        A run.
    antennas : Sensor
        A sensor whose antennas' pattern and tilt, and whose errors the run is assumed to have.
    footprint : tuple of float, optional
        Ground that the simulator fills with clutter, m, in the scan frame; by default that of
        ``antennas``.

    Returns
    -------
    Sensor
        The sensor.

    Raises
    ------
    ValueError
        If no scan is complete, the antennas are not above the ground, or the tones lie on no even
        raster.
    """
    poses = run["pose"].values[complete_scan_numbers(run)]
    pose = np.median(poses, axis=0)
    height = round(_HEIGHTS_PER_METRE * float(pose[2])) / _HEIGHTS_PER_METRE
    tx = run["tx_position"].values
    rx = run["rx_position"].values
    antenna_places = vehicle_to_scan(np.concatenate([tx, rx]), pose)
    lowest = float(antenna_places[:, 2].min())
    if height <= 0 or lowest <= 0:
        raise ValueError(
            "run.pose must put the vehicle's reference point and the antennas above the ground, "
            f"got {pose[2]:.3g} m and {lowest:.3g} m"
        )
    entries = antennas.model_dump()
    entries |= _places(tx, rx)
    entries |= {
        "name": "run",
        "source": f"antennas and tones of a run; pattern, tilt and errors of {antennas.name}",
        "tones": _even_tones(run["frequency"].values),
        "polarization": polarizations_of(run),
        "height": height,
        "footprint": antennas.footprint if footprint is None else footprint,
    }
    entries["errors"] = _errors(antennas, run["frequency"].values, height)
    return Sensor.model_validate(entries)


def _even_tones(frequency: FloatArray) -> dict[str, float | int]:
    """Return the entries of the even raster (Hz) on which tones lie."""
    if frequency.size == 1:
        return {"start": float(frequency[0]), "step": 1e6, "count": 1}
    usual = float(np.median(np.diff(frequency)))
    numbers = np.rint((frequency - frequency[0]) / usual)
    step = float((frequency[-1] - frequency[0]) / numbers[-1])
    off = np.abs(frequency - frequency[0] - step * numbers).max()
    if off > _RASTER * step:
        raise ValueError(
            "run.frequency must lie on an even raster for the sensor of a run, got tones up to "
            f"{off / 1e6:.3g} MHz off one of {step / 1e6:.4g} MHz: name the file of a sensor"
        )
    return {"start": float(frequency[0]), "step": step, "count": int(numbers[-1]) + 1}


def _places(tx: FloatArray, rx: FloatArray) -> dict[str, object]:
    """Return the entries of antennas: every transmitter with every receiver, or pairs alone."""
    transmitters = list(dict.fromkeys(map(tuple, tx.tolist())))
    receivers = list(dict.fromkeys(map(tuple, rx.tolist())))
    all_tx = np.repeat(transmitters, len(receivers), axis=0)
    all_rx = np.tile(receivers, (len(transmitters), 1))
    if all_tx.shape == tx.shape and np.array_equal(all_tx, tx) and np.array_equal(all_rx, rx):
        return {"tx": transmitters, "rx": receivers, "scanned": False}
    return {"tx": tx.tolist(), "rx": rx.tolist(), "scanned": True}


def _errors(antennas: Sensor, frequency: FloatArray, height: float) -> dict[str, object]:
    """Return the entries of the errors, with the noise given in the run's band and distance."""
    errors = antennas.errors.model_dump()
    low, high = errors["noise_band"]
    if np.count_nonzero((frequency >= low) & (frequency <= high)) < 2:
        errors["noise_band"] = (float(frequency[0]), float(frequency[-1]))
    errors["noise_range"] = _NOISE_HEIGHTS * height
    return errors
