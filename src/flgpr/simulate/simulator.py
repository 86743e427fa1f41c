"""From a scene and a sensor to a run and its truth, scan by scan."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr
from numpy.typing import NDArray

from flgpr.model import SPEED_OF_LIGHT, Sensor, attitude_matrix, heading_matrix, make_run, vehicle_to_lane
from flgpr.simulate.draw import stream
from flgpr.simulate.echoes import Echoes, Ground, add_object, add_target, sum_echoes
from flgpr.simulate.field import SurfaceField
from flgpr.simulate.impair import Impairments
from flgpr.simulate.roughness import HeightField, surface_backscatter
from flgpr.simulate.scene import Scene
from flgpr.simulate.spread import ArrayState, Spreader
from flgpr.simulate.track import draw_track
from flgpr.simulate.world import draw_world

FloatArray = NDArray[np.float64]
_RANKS = 3
_REACH = 45.0  # m beyond which single objects are left out


class Simulator:
    """A scene seen by a sensor.

    Parameters
    ----------
    scene : Scene
        What is there.
    sensor : Sensor
        What looks at it.
    seed : int
        The same seed gives the same run; the world does not depend on the sensor, so that two sensors with one seed
        see the same targets and objects.
    errors : bool
        Whether the sensor's errors are added.

    Attributes
    ----------
    pose, time : ndarray
        True pose (scan, 6) and time (scan,) of every scan.
    truth, objects : DataFrame
        The targets of the lane, and all else.
    """

    def __init__(self, scene: Scene, sensor: Sensor, seed: int, errors: bool = True) -> None:
        self.scene, self.sensor, self.seed = scene, sensor, seed
        self.world = draw_world(scene, seed)
        self.pose, self.time = draw_track(scene, sensor.height, seed)
        self.frequency = sensor.tones.axis()
        self.truth, self.objects = self.world.truth(), self.world.objects_table()
        surface = scene.surface
        rough = surface.phase_screen and surface.rms_height > 0
        heights = HeightField(surface.rms_height, surface.correlation_length, stream(seed, "heights"))
        self._ground = Ground(scene.soil, heights if rough else None, self.frequency)
        self._spreader = Spreader(sensor.tones.start, sensor.tones.step, sensor.tones.count)
        density = surface.density or 10 / finest_cell(sensor)
        self._field = SurfaceField(surface, self.world.patches, density, seed)
        self._sines, self._weights, self._basis = self._spectral_basis()
        self.response = system_response(sensor, self.frequency)
        self._errors = Impairments(sensor, seed) if errors else None

    def __len__(self) -> int:
        return len(self.pose)

    def scan(self, index: int) -> NDArray[np.complex64]:
        """Simulate one scan.

        Parameters
        ----------
        index : int
            Number of the scan; scans may be asked for in any order.

        Returns
        -------
        (polarization, pair, frequency) ndarray of complex64
            Received over transmitted wave.
        """
        array = array_state(self.sensor, self.pose[index])
        signal = sum_echoes(self._single_echoes(array, self.pose[index]), array, self.frequency)
        if self.scene.surface.echo:
            signal = signal + self._surface_echo(array, self.pose[index])
        signal = signal * self.response.astype(np.complex64)
        channels = _four_channels(signal, array.dipoles)
        if self._errors is not None:
            channels = self._errors.apply(channels, index)
        order = [("HH", "HV", "VH", "VV").index(name) for name in self.sensor.polarization]
        return channels[order]

    def scans(self, first: int = 0) -> Iterator[NDArray[np.complex64]]:
        """Yield the scans from number ``first`` on, each as :meth:`scan` gives it."""
        for index in range(first, len(self)):
            yield self.scan(index)

    def reported_pose(self) -> FloatArray:
        """Poses (scan, 6) as the navigation reports them: true ones with its errors."""
        return self.pose.copy() if self._errors is None else self._errors.reported_pose(self.pose)

    def attributes(self) -> dict[str, Any]:
        """Describe the run."""
        return {"lane": self.scene.name, "sensor": self.sensor.name, "seed": self.seed, "simulated": "flgpr"}

    def run(self) -> xr.Dataset:
        """Simulate all scans into a run held in memory."""
        tx, rx = self.sensor.pairs()
        polarization = list(self.sensor.polarization)
        signal = np.stack(list(self.scans()))
        return make_run(
            signal, self.frequency, polarization, tx, rx, self.reported_pose(), self.time, self.attributes()
        )

    def _single_echoes(self, array: ArrayState, pose: FloatArray) -> Echoes:
        echoes = Echoes()
        ahead = np.array([math.sin(pose[3]), math.cos(pose[3])])
        for target in self.world.targets:
            if _in_view(target.x, target.y, pose, ahead):
                add_target(echoes, target, self._ground, array)
        for thing in self.world.objects:
            if _in_view(thing.x, thing.y, pose, ahead):
                add_object(echoes, thing, self._ground, array, self.seed)
        return echoes

    def _surface_echo(self, array: ArrayState, pose: FloatArray) -> NDArray[np.complex64]:
        x_min, x_max, y_min, y_max = self.sensor.footprint
        turn = heading_matrix(pose[3])[:2, :2]
        corners = np.array([[x_min, y_min], [x_max, y_min], [x_min, y_max], [x_max, y_max]]) @ turn.T + pose[:2]
        found = self._field.within(corners)
        local = (found.xy - pose[:2]) @ turn
        inside = (local[:, 0] >= x_min) & (local[:, 0] <= x_max) & (local[:, 1] >= y_min) & (local[:, 1] <= y_max)
        points = np.zeros((np.count_nonzero(inside), 3))
        points[:, :2] = found.xy[inside]
        offset = points - array.position.mean(axis=0)
        sine = np.hypot(offset[:, 0], offset[:, 1]) / np.linalg.norm(offset, axis=1)
        step = self._sines[1] - self._sines[0]
        place = np.clip((sine - self._sines[0]) / step, 0, self._sines.size - 1.001)
        cell = place.astype(int)
        part = (place - cell)[:, None, None]
        weight = self._weights[cell] * (1 - part) + self._weights[cell + 1] * part
        coefficient = (weight * found.amplitude[inside][:, None, :]).astype(np.complex64)
        return self._spreader(points, coefficient, self._basis, array)

    def _spectral_basis(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Factor sqrt(σ⁰(f, θ)) of HH, VV and cross into weights (sine, rank, 3) and functions (rank, 3, frequency)."""
        surface = self.scene.surface
        sines = np.linspace(0.02, 0.999, 256)
        eps = self._ground.media[0]
        hh, vv = surface_backscatter(
            self.frequency[None, :], sines[:, None], eps, surface.rms_height, surface.correlation_length, surface.slope
        )
        weights = np.zeros((sines.size, _RANKS, 3))
        basis = np.zeros((_RANKS, 3, self.frequency.size))
        for channel, power in enumerate((hh, vv, hh)):
            u, s, vt = np.linalg.svd(np.sqrt(power), full_matrices=False)
            ranks = min(_RANKS, s.size)
            weights[:, :ranks, channel] = u[:, :ranks] * s[:ranks]
            basis[:ranks, channel] = vt[:ranks]
        return sines, weights, basis


def simulate(scene: Scene, sensor: Sensor, seed: int, errors: bool = True) -> tuple[xr.Dataset, pd.DataFrame]:
    """Simulate a run over a scene.

    Parameters
    ----------
    scene : Scene
        What is there.
    sensor : Sensor
        What looks at it.
    seed : int
        Seed of the world and of the errors.
    errors : bool
        Whether the sensor's errors are added.

    Returns
    -------
    run : xarray.Dataset
        The run.
    truth : DataFrame
        The lane's targets.
    """
    simulator = Simulator(scene, sensor, seed, errors)
    return simulator.run(), simulator.truth


def array_state(sensor: Sensor, pose: FloatArray) -> ArrayState:
    """Place a sensor's antennas in the lane frame for a pose (6,)."""
    first, second = sensor.pair_indices()
    turn = heading_matrix(pose[3]) @ attitude_matrix(pose[4], pose[5])
    position = vehicle_to_lane(np.concatenate([sensor.tx, sensor.rx]), pose)
    axis = turn @ np.array([0.0, math.cos(sensor.tilt), -math.sin(sensor.tilt)])
    exponent = -1.0 if sensor.antenna.kind == "dipole" else sensor.antenna.exponent
    return ArrayState(position, first, second + len(sensor.tx), axis, turn[:, 0].copy(), turn[:, 2].copy(), exponent)


def system_response(sensor: Sensor, frequency: FloatArray) -> FloatArray:
    """Compute what multiplies ``sqrt(σ)·pattern/(R_t·R_r)`` at every tone (frequency,).

    Horns: ``G(f)·λ/(4π)^1.5`` with G growing as f². Dipoles: ``ωμ0/(4π)^1.5``, the field per unit current moment.
    """
    if sensor.antenna.kind == "dipole":
        return np.asarray(2 * np.pi * frequency * 4e-7 * np.pi / (4 * np.pi) ** 1.5)
    gain = 10 ** (sensor.antenna.gain_db / 10) * (frequency / sensor.antenna.gain_frequency) ** 2
    return np.asarray(gain * SPEED_OF_LIGHT / frequency / (4 * np.pi) ** 1.5)


def finest_cell(sensor: Sensor, distance: float = 10.0) -> float:
    """Area of the finest resolution cell of a sensor.

    Parameters
    ----------
    sensor : Sensor
        The sensor.
    distance : float
        Ground range, m.

    Returns
    -------
    float
        m²: ``c/(2B·sinθ)`` down-range times ``λ_min·R/(D_t + D_r)`` cross-range.
    """
    tones = sensor.tones.axis()
    slant = math.hypot(distance, sensor.height)
    down = SPEED_OF_LIGHT / (2 * max(tones[-1] - tones[0], sensor.tones.step)) * slant / distance
    tx, rx = sensor.pairs()
    aperture = 2 * float(np.ptp((tx + rx)[:, 0]) / 2) if sensor.scanned else float(np.ptp(tx[:, 0]) + np.ptp(rx[:, 0]))
    return float(down * SPEED_OF_LIGHT / tones[-1] * slant / max(aperture, 0.1))


def _in_view(x: float, y: float, pose: FloatArray, ahead: FloatArray) -> bool:
    dx, dy = x - pose[0], y - pose[1]
    forward = dx * ahead[0] + dy * ahead[1]
    return bool(0.5 < forward < _REACH and math.hypot(dx, dy) < _REACH)


def _four_channels(signal: NDArray[np.complex64], dipoles: bool) -> NDArray[np.complex64]:
    """Bring the channels into the order HH, HV, VH, VV."""
    return signal if dipoles else signal[[0, 2, 2, 1]]
