"""From a scene and a sensor to a run and its truth, scan by scan."""

from __future__ import annotations

import copy
import dataclasses
import functools
import math
import warnings
from collections.abc import Iterable, Iterator, Sequence
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from flgpr.jit.threads import blas_on_one_thread
from flgpr.model import (
    SPEED_OF_LIGHT,
    Sensor,
    Tones,
    image_paths,
    make_run,
    pose_matrix,
    vehicle_to_lane,
)
from flgpr.simulate.bodies.echoes import Echo, LayeredGround, incidence, sum_echoes
from flgpr.simulate.bodies.standing import object_echoes
from flgpr.simulate.bodies.targets import target_echoes
from flgpr.simulate.ground.field import SurfaceField
from flgpr.simulate.ground.holes import hole_factor
from flgpr.simulate.ground.layers import (
    GrassLayer,
    ScanView,
    ScattererLayer,
    SineSpectra,
    Skeleton,
    SurfaceLayer,
    sum_layers,
    through_grass,
)
from flgpr.simulate.ground.roughness import surface_backscatter, surface_heights
from flgpr.simulate.ground.shadow import Shadows, Strip, shadow_strips
from flgpr.simulate.ground.specular import SpecularEcho
from flgpr.simulate.ground.subsurface import subsurface_layers
from flgpr.simulate.ground.terrain import TerrainHeights
from flgpr.simulate.radar.coupling import direct_wave
from flgpr.simulate.radar.impair import Impairments, signature_end
from flgpr.simulate.radar.spread import ArrayState, Spreader
from flgpr.simulate.scene.scene import Scene, SceneObject, Soil, Surface, Target
from flgpr.simulate.scene.scene_tables import Grass
from flgpr.simulate.scene.world import draw_track, draw_world
from flgpr.types import ComplexArray, FloatArray

PER_CELL = 3
"""Scatterers of the surface in the sensor's finest resolution cell."""
_RANKS = 3  # functions of frequency for the surface's spectra
_REACH = 45.0  # m beyond which single objects are left out
_CHANNELS = ("HH", "HV", "VH", "VV")


class Simulator:
    """A scene seen by a sensor.

    The same seed gives the same run. The world does not depend on the sensor, so that two sensors
    with one seed see the same targets and objects.

    Parameters
    ----------
    scene : Scene
        The scene.
    sensor : Sensor
        The sensor.
    seed : int
        Seed of the world and of the sensor's errors.
    errors : bool
        Whether the sensor's own errors are added.

    Attributes
    ----------
    world : World
        What the seed makes of the scene.
    pose : ndarray (scan, 6)
        True poses, m and rad.
    time : ndarray (scan,)
        Times, s.
    frequency : ndarray (frequency,)
        Tones, Hz.
    truth, objects : DataFrame
        Tables of the lane's targets and of all else.
    """

    def __init__(self, scene: Scene, sensor: Sensor, seed: int, errors: bool = True) -> None:
        self.scene = scene
        self.sensor = sensor
        self.seed = seed

        # The world, which does not depend on the sensor but for the height of the track.
        self.world = draw_world(scene, seed)
        self.truth = self.world.truth()
        self.objects = self.world.objects_table()
        self._terrain = TerrainHeights(scene.terrain, scene.lane, seed)
        self._height = functools.cache(self._terrain.height)  # bodies stand in many scans
        level_pose, self.time = draw_track(scene, sensor.height, seed)
        self.pose = self._terrain.follow(level_pose)
        self._strips: list[Strip] = []
        if scene.shadow.on:
            self._strips = shadow_strips(
                self.world.targets, self.world.objects, self._terrain, scene.shadow.foliage
            )

        # The ground and all that scatters, at the sensor's tones.
        self.frequency = sensor.tones.axis()
        surface = scene.surface
        heights = None
        if surface.phase_screen and surface.rms_height + surface.unevenness > 0:
            heights = surface_heights(surface, seed)
        self._ground = LayeredGround(scene.soil, heights, self.frequency)
        self._spreader = Spreader(sensor.tones.start, sensor.tones.step, sensor.tones.count)
        self._layers = self._make_layers()
        self._hole_over = {hole.target: hole for hole in self.world.holes}

        # The radar.
        self.response = system_response(sensor, self.frequency)
        self._errors = Impairments(sensor, seed, scene.drive, scene.change) if errors else None
        sweep_time = sensor.errors.sweep_time if errors else 0.0
        self._drift = sweep_drift(self.pose, self.time, sweep_time)
        self._specular = self._make_specular_echo()
        self._direct = None
        if sensor.has_direct_wave:  # the antennas stand still to each other in all scans
            self._direct = direct_wave(self._array(0), self.frequency, sensor.antenna.side_db)
        first_view = self._view(self._array(0), self.pose[0])
        self._skeleton = Skeleton(self._layers, first_view, self.frequency)

    def __len__(self) -> int:
        return len(self.pose)

    def scan(self, index: int) -> ComplexArray:
        """Simulate a scan.

        Returns
        -------
        ndarray (polarization, pair, frequency) of complex64
            Received over transmitted wave.
        """
        return self.received(self.echoes(index), index)

    def echoes(self, index: int) -> ComplexArray:
        """Simulate what comes back in a scan from the ground and all that stands on it.

        Returns
        -------
        ndarray (4, pair, frequency) of complex64
            HH, HV, VH and VV, before the radar: neither its response nor its errors are in them.
        """
        array = self._array(index)
        view = self._view(array, self.pose[index])
        with blas_on_one_thread():  # its threads would compete with those of our kernels
            layers = sum_layers(self._layers, view, self._spreader, self._skeleton)
            channels = sum_echoes(self._single_echoes(view), array, self.frequency)
        if not array.dipoles:
            hh, vv, cross = layers
            layers = np.stack([hh, cross, cross, vv])
        channels = channels + layers
        if self._specular is not None:
            channels = channels + self._specular(array)
        return channels

    def received(self, echoes: ComplexArray, index: int) -> ComplexArray:
        """Return a scan as the radar records it, with its direct wave and its errors.

        Parameters
        ----------
        echoes : ndarray (4, pair, frequency) of complex64
            As :meth:`echoes` returns them.
        index : int
            Number of the scan.

        Returns
        -------
        ndarray (polarization, pair, frequency) of complex64
            As :meth:`scan` returns it.
        """
        if self._direct is not None:
            drift = 0 if self._errors is None else self._errors.direct_drift(index)
            echoes = echoes + self._direct * (1 + drift)
        return self._received(echoes, index)

    def with_other_errors(self, seed: int) -> Simulator:
        """Return a simulator of the same drive over the same world, its radar's errors drawn anew.

        Noise, drifts, interference, lost sweeps and the navigation's errors are those of another
        seed; the echoes are the same. ``self`` is left as it is.
        """
        other = copy.copy(self)
        other._errors = Impairments(self.sensor, seed, self.scene.drive, self.scene.change)
        return other

    def bodies(self, index: int) -> ComplexArray:
        """Simulate what the targets' bodies alone add to a scan.

        They lie in the ground and the holes of the scene; the shape is that of :meth:`scan`.
        """
        array = self._array(index)
        view = self._view(array, self.pose[index])
        with blas_on_one_thread():
            echoes = self._single_echoes(view, targets_only=True)
            channels = sum_echoes(echoes, array, self.frequency)
        return self._received(channels, index) - self._received(0 * channels, index)

    def _received(self, channels: ComplexArray, index: int) -> ComplexArray:
        """Return the sensor's polarizations of HH, HV, VH, VV, as its radar receives them."""
        channels = channels * self.response.astype(np.complex64)
        if self._errors is not None:
            channels = self._errors.apply(channels, index)
        return channels[[_CHANNELS.index(name) for name in self.sensor.polarization]]

    def scans(self, first: int = 0) -> Iterator[ComplexArray]:
        """Yield the scans from number ``first`` on, as :meth:`scan` returns them."""
        for index in range(first, len(self)):
            yield self.scan(index)

    def reported_pose(self) -> FloatArray:
        """Return the poses (scan, 6) as the navigation reports them: true ones with its errors."""
        if self._errors is None:
            return self.pose.copy()
        return self._errors.reported_pose(self.pose)

    def attributes(self) -> dict[str, Any]:
        """Return the attributes that describe the run."""
        attributes = {
            "lane": self.scene.name,
            "sensor": self.sensor.name,
            "seed": self.seed,
            "simulated": "flgpr",
        }
        return attributes | ({"drive": self.scene.drive} if self.scene.drives else {})

    def limits(self) -> dict[str, Any]:
        """Return where the simulated echoes end, which those of a real radar do not.

        ``footprint_m`` are the least and the largest x and y of the ground that scatters, in the
        vehicle frame, m; ``own_echoes_path_m`` is the path at which the echoes of the vehicle
        itself end, m, or None where there are none.
        """
        errors = self.sensor.errors
        has_own_echoes = self._errors is not None and errors.self_signature_db is not None
        return {
            "footprint_m": list(self.sensor.ground_in_view),
            "own_echoes_path_m": signature_end(self.sensor) if has_own_echoes else None,
        }

    def run(self, bodies: bool = False, echoes: Sequence[ComplexArray] | None = None) -> xr.Dataset:
        """Simulate all scans into a run held in memory.

        Parameters
        ----------
        bodies : bool
            Whether the scans hold only what the targets' bodies add to them.
        echoes : sequence of ndarray, optional
            Those of every scan, as :meth:`echoes` returns them, where they are known.
        """
        if echoes is not None:
            scans = np.stack([self.received(each, index) for index, each in enumerate(echoes)])
        else:
            simulate_scan = self.bodies if bodies else self.scan
            scans = np.stack([simulate_scan(index) for index in range(len(self))])
        tx, rx = self.sensor.pairs()
        return make_run(
            scans,
            self.frequency,
            list(self.sensor.polarization),
            tx,
            rx,
            self.reported_pose(),
            self.time,
            self.attributes(),
        )

    def _array(self, index: int) -> ArrayState:
        """Return the antennas of a scan, with their drift during its sweep."""
        array = array_state(self.sensor, self.pose[index])
        return dataclasses.replace(array, drift=self._drift[index])

    def _view(self, array: ArrayState, pose: FloatArray) -> ScanView:
        """Return what a scan sees its scatterers by."""
        shadows = None
        if self._strips:
            strips = [strip for strip in self._strips if _in_view(strip, pose)]
            shadows = Shadows(strips, array, self.frequency)
        return ScanView(self.sensor.ground_in_view, pose, array, self._terrain, shadows)

    def _single_echoes(self, view: ScanView, targets_only: bool = False) -> list[Echo]:
        """Return the echoes of targets and, unless they alone count, of all that is no layer."""
        echoes: list[Echo] = []
        for index, target in enumerate(self.world.targets):
            if _in_view(target, view.pose):
                array = self._above(target, view.array)
                buried = target_echoes(target, self._ground, array)
                through_hole = self._through_hole(buried, index, array)
                echoes += self._raised(through_hole, target, view)
        if targets_only:
            return echoes
        for scene_object in self.world.objects:
            if _in_view(scene_object, view.pose):
                array = self._above(scene_object, view.array)
                standing = object_echoes(scene_object, self._ground, array, self.seed)
                echoes += self._raised(standing, scene_object, view)
        return echoes

    def _through_hole(
        self, echoes: Iterable[Echo], index: int, array: ArrayState
    ) -> Iterable[Echo]:
        """Return a target's echoes as the loosened soil over it passes them."""
        hole = self._hole_over.get(index)
        if hole is None:
            return echoes
        target = self.world.targets[index]
        sine = incidence(target.x, target.y, 0.0, array)
        extra, factor = hole_factor(hole, target.depth, sine, self._ground)
        return [
            echo._replace(path=echo.path + 2 * extra, spectrum=echo.spectrum * factor)
            for echo in echoes
        ]

    def _above(self, body: Target | SceneObject, array: ArrayState) -> ArrayState:
        """Return the antennas with heights counted from the ground at a body.

        A body stands on that ground as on a plane.
        """
        ground = np.array([0.0, 0.0, self._height(body.x, body.y)])
        return dataclasses.replace(array, position=array.position - ground)

    def _raised(
        self, echoes: Iterable[Echo], body: Target | SceneObject, view: ScanView
    ) -> list[Echo]:
        """Return a body's echoes raised to the ground it stands on.

        They pass the grass around it and the shadow on it.
        """
        echoes = list(echoes)
        if not echoes:
            return echoes
        grass = self.scene.grass
        ground = self._height(body.x, body.y)
        through = np.ones((4, self.frequency.size), complex)
        if view.shadows is not None:
            mean_height = max(np.array([echo.position for echo in echoes])[:, 2].mean(), 0.0)
            through *= view.shadows.body_factor(np.array([body.x, body.y, ground + mean_height]))
        sine = view.sine(np.array([[body.x, body.y, 0.0]])).item() if grass.grown else 0.0
        raised = []
        for echo in echoes:
            factor = through
            if grass.grown:
                above = min(max(1 - echo.position[2] / grass.height, 0.0), 1.0)
                hh, vv, cross = through_grass(grass, self.frequency, sine, above)
                factor = through * np.stack([hh, vv, cross, cross])
            position = echo.position + np.array([0.0, 0.0, ground])
            raised.append(echo._replace(position=position, spectrum=echo.spectrum * factor))
        return raised

    def _make_specular_echo(self) -> SpecularEcho | None:
        """Return the echo of the mean surface, None where sensor or scene has none."""
        surface = self.scene.surface
        if not self.sensor.has_specular_echo or not surface.echo:
            return None
        side_db = self.sensor.antenna.side_db
        return SpecularEcho(surface, self.scene.grass, self._ground, self._terrain, side_db)

    def _make_layers(self) -> list[ScattererLayer]:
        """Return all that is summed as point scatterers; further layers are added here."""
        layers: list[ScattererLayer] = []
        surface = self.scene.surface
        grass = self.scene.grass
        density = surface.density or PER_CELL / finest_cell(self.sensor)
        drive, change = self.scene.drive, self.scene.change
        if surface.echo:
            field = SurfaceField(
                surface, self.world.patches, density, self.seed, renewed=(change.surface, drive)
            )
            spectra = _surface_spectra(surface, self.scene.soil, grass, self.sensor.tones)
            layers.append(SurfaceLayer(field, spectra))
        if grass.grown:
            grass_density = grass.density or density / 2
            layers.append(
                GrassLayer(grass, grass_density, self.seed, self.frequency, (change.grass, drive))
            )
        layers += subsurface_layers(
            self.scene, self.world.holes, self._ground, density / 4, self.seed
        )
        return layers


@functools.lru_cache(maxsize=16)
def _surface_spectra(surface: Surface, soil: Soil, grass: Grass, tones: Tones) -> SineSpectra:
    """Return sqrt(σ⁰(f, θ)) of HH, VV and cross, the same on every lane of a site."""
    frequency = tones.axis()
    sines = np.linspace(0.02, 0.999, 256)
    hh, vv = surface_backscatter(
        frequency[None, :],
        sines[:, None],
        soil.media(frequency)[0],
        surface.rms_height,
        surface.correlation_length,
        surface.slope,
        surface.unevenness,
        surface.waviness,
    )
    spectra = np.sqrt([hh, vv, hh])
    if grass.grown:
        spectra = spectra * through_grass(grass, frequency, sines)
    return SineSpectra(sines, spectra, _RANKS)


def simulate(
    scene: Scene, sensor: Sensor, seed: int, errors: bool = True
) -> tuple[xr.Dataset, pd.DataFrame]:
    """Simulate a run over a scene.

    Parameters
    ----------
    scene : Scene
        The scene.
    sensor : Sensor
        The sensor.
    seed : int
        Seed of the world and of the sensor's errors.
    errors : bool
        Whether the sensor's own errors are added.

    Returns
    -------
    run : xarray.Dataset
        The run.
    truth : pandas.DataFrame
        Truth table of the lane's targets.
    """
    simulator = Simulator(scene, sensor, seed, errors)
    return simulator.run(), simulator.truth


def array_state(sensor: Sensor, pose: FloatArray) -> ArrayState:
    """Return a sensor's antennas in the lane frame for a pose (6,)."""
    first, second = sensor.pair_indices()
    turn = pose_matrix(pose)
    antenna = sensor.antenna
    exponent = -1.0 if antenna.kind == "dipole" else antenna.exponent
    growth = 0.0
    if antenna.kind == "horn" and antenna.beam == "aperture":
        growth = (antenna.exponent + 1) / antenna.gain_frequency**2
    return ArrayState(
        position=vehicle_to_lane(np.concatenate([sensor.tx, sensor.rx]), pose),
        tx=first,
        rx=second + len(sensor.tx),
        boresight=turn @ np.array([0.0, math.cos(sensor.tilt), -math.sin(sensor.tilt)]),
        horizontal=turn[:, 0].copy(),
        vertical=turn[:, 2].copy(),
        exponent=exponent,
        growth=growth,
    )


def sweep_drift(pose: FloatArray, time: FloatArray, sweep_time: float) -> FloatArray:
    """Return how far the vehicle drives in each sweep (scan, 3), m.

    The drift is level, and zero for a single scan.

    Parameters
    ----------
    pose : ndarray (scan, 6)
        Poses, m and rad.
    time : ndarray (scan,)
        Times, s.
    sweep_time : float
        Time of a sweep over all tones, s.
    """
    drift = np.zeros((len(pose), 3))
    if sweep_time > 0 and len(pose) > 1:
        drift[:, :2] = np.gradient(pose[:, :2], time, axis=0) * sweep_time
    return drift


def system_response(sensor: Sensor, frequency: FloatArray) -> FloatArray:
    """Return what multiplies ``sqrt(σ)·pattern/(R_t·R_r)`` at every tone (frequency,).

    Horns: ``G(f)·λ/(4π)^1.5`` with G growing as f². Dipoles: ``ωμ0/(4π)^1.5``, the field per unit
    current moment.
    """
    if sensor.antenna.kind == "dipole":
        return 2 * np.pi * frequency * 4e-7 * np.pi / (4 * np.pi) ** 1.5
    gain = 10 ** (sensor.antenna.gain_db / 10) * (frequency / sensor.antenna.gain_frequency) ** 2
    return gain * SPEED_OF_LIGHT / frequency / (4 * np.pi) ** 1.5


def finest_cell(sensor: Sensor, distance: float = 10.0) -> float:
    """Return the area of a sensor's finest resolution cell, m².

    ``c/(2B·sinθ)`` times ``λ_min·R/(D_t + D_r)`` at a ground range, m.
    """
    tones = sensor.tones.axis()
    slant = math.hypot(distance, sensor.height)
    bandwidth = max(tones[-1] - tones[0], sensor.tones.step)
    down_range = SPEED_OF_LIGHT / (2 * bandwidth) * slant / distance
    tx, rx = sensor.pairs()
    aperture = float(np.ptp(tx[:, 0]) + np.ptp(rx[:, 0]))
    if sensor.scanned:
        aperture = 2 * float(np.ptp((tx + rx)[:, 0]) / 2)
    return float(down_range * SPEED_OF_LIGHT / tones[-1] * slant / max(aperture, 0.1))


def _in_view(scene_object: Target | SceneObject | Strip, pose: FloatArray) -> bool:
    """Return whether something stands in front of the array and not too far off."""
    dx = scene_object.x - pose[0]
    dy = scene_object.y - pose[1]
    forward = dx * math.sin(pose[3]) + dy * math.cos(pose[3])
    return bool(0.5 < forward < _REACH and math.hypot(dx, dy) < _REACH)


def warn_of_aliases(sensor: Sensor) -> None:
    """Warn of tones whose steps let far ground of the footprint lie over near ground in the data.

    Real radars are built so, and a simulated one shows what their data look like: no error.
    """
    height = [0.0, 0.0, sensor.height]
    tx, rx = sensor.pairs()
    x_min, x_max, y_min, y_max = sensor.ground_in_view
    paths = image_paths(
        sensor.tones.axis(), tx + height, rx + height, (x_min, x_max), (y_min, y_max)
    )
    if not paths.repeats:
        return
    step = SPEED_OF_LIGHT / (paths.farthest - paths.nearest)
    warnings.warn(
        f"tones.step should be below {step / 1e6:.3g} MHz for the footprint of sensor "
        f"{sensor.name!r}, got {sensor.tones.step / 1e6:g} MHz: echoes repeat after "
        f"{paths.unambiguous:.4g} m of path, and paths by way of the footprint are "
        f"{paths.nearest:.4g} to {paths.farthest:.4g} m long, so that its far ground lies over its "
        "near ground in the data; take finer steps, or a footprint that ends nearer",
        stacklevel=2,
    )
