"""From a scene and a sensor to a run and its truth, scan by scan, and what memory and time that takes."""

from __future__ import annotations

import dataclasses
import functools
import itertools
import math
import warnings
from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
import xarray as xr
from numpy.typing import NDArray

from flgpr.kernels.threads import blas_on_one_thread
from flgpr.model import (
    SPEED_OF_LIGHT,
    Sensor,
    Tones,
    image_paths,
    make_run,
    pose_matrix,
    vehicle_to_lane,
)
from flgpr.model.arrays import FloatArray
from flgpr.simulate.bodies.echoes import Echoes, Ground, add_object, incidence, sum_echoes
from flgpr.simulate.bodies.targets import add_target
from flgpr.simulate.ground.field import TILES_KEPT, SurfaceField
from flgpr.simulate.ground.holes import hole_factor
from flgpr.simulate.ground.layers import (
    GrassLayer,
    Layer,
    SineSpectra,
    Skeleton,
    SurfaceLayer,
    View,
    sum_layers,
    through_grass,
)
from flgpr.simulate.ground.roughness import surface_backscatter, surface_heights
from flgpr.simulate.ground.shadow import Shadows, Strip, shadow_strips
from flgpr.simulate.ground.subsurface import subsurface_layers
from flgpr.simulate.ground.terrain import Terrain
from flgpr.simulate.radar.impair import Impairments
from flgpr.simulate.radar.spread import ArrayState, Spreader
from flgpr.simulate.scene.scene import Scene, SceneObject, Soil, Surface, Target
from flgpr.simulate.scene.scene_tables import Grass
from flgpr.simulate.scene.world import MARGIN, draw_track, draw_world

_RANKS = 3
PER_CELL = 3
"""Scatterers of the surface in the sensor's finest resolution cell."""
_REACH = 45.0  # m beyond which single objects are left out


class Simulator:
    """A scene seen by a sensor.

    The same seed gives the same run; the world does not depend on the sensor, so that two sensors
    with one seed see the same targets and objects. ``errors`` adds the sensor's own. ``pose``
    (scan, 6) and ``time`` (scan,) are the true ones of every scan, ``truth`` and ``objects`` the
    tables of the lane's targets and of all else.
    """

    def __init__(self, scene: Scene, sensor: Sensor, seed: int, errors: bool = True) -> None:
        self.scene = scene
        self.sensor = sensor
        self.seed = seed
        self.world = draw_world(scene, seed)
        self._terrain = terrain = Terrain(scene.terrain, scene.lane, seed)
        self._height = functools.cache(
            lambda x, y: terrain(x, y).item()
        )  # bodies stand in many scans
        level, self.time = draw_track(scene, sensor.height, seed)
        self.pose = self._terrain.follow(level)
        shadow = (self.world.targets, self.world.objects, self._terrain, scene.shadow.foliage)
        self._strips = shadow_strips(*shadow) if scene.shadow.on else []
        self.frequency = sensor.tones.axis()
        self.truth, self.objects = self.world.truth(), self.world.objects_table()
        surface = scene.surface
        rough = surface.phase_screen and surface.rms_height + surface.unevenness > 0
        heights = surface_heights(surface, seed)
        self._ground = Ground(scene.soil, heights if rough else None, self.frequency)
        self._spreader = Spreader(sensor.tones.start, sensor.tones.step, sensor.tones.count)
        self._layers = self._make_layers()
        self._dug = {hole.target: hole for hole in self.world.holes}
        self.response = system_response(sensor, self.frequency)
        self._errors = Impairments(sensor, seed) if errors else None
        self._drift = sweep_drift(self.pose, self.time, sensor.errors.sweep_time if errors else 0.0)
        self._skeleton = Skeleton(
            self._layers, self._view(self._array(0), self.pose[0]), self.frequency
        )

    def __len__(self) -> int:
        return len(self.pose)

    def scan(self, index: int) -> NDArray[np.complex64]:
        """Simulate any scan: (polarization, pair, frequency) of received over transmitted wave."""
        array = self._array(index)
        view = self._view(array, self.pose[index])
        with blas_on_one_thread():  # whose threads would spin on beside our kernels'
            layers = sum_layers(self._layers, view, self._spreader, self._skeleton)
            channels = sum_echoes(self._single_echoes(view), array, self.frequency)
        layers = layers if array.dipoles else layers[[0, 2, 2, 1]]  # HH, HV, VH, VV
        return self._received(channels + layers, index)

    def bodies(self, index: int) -> NDArray[np.complex64]:
        """Simulate what the targets' bodies alone add to a scan, in the ground and the holes that they lie in."""
        array = self._array(index)
        view = self._view(array, self.pose[index])
        with blas_on_one_thread():
            channels = sum_echoes(self._single_echoes(view, things=False), array, self.frequency)
        return self._received(channels, index) - self._received(0 * channels, index)

    def _received(self, channels: NDArray[np.complex64], index: int) -> NDArray[np.complex64]:
        """Give the sensor's polarizations of HH, HV, VH, VV, through the radar and with its errors."""
        channels = channels * self.response.astype(np.complex64)
        if self._errors is not None:
            channels = self._errors.apply(channels, index)
        return channels[[("HH", "HV", "VH", "VV").index(name) for name in self.sensor.polarization]]

    def scans(self, first: int = 0) -> Iterator[NDArray[np.complex64]]:
        """Yield the scans from number ``first`` on, each as :meth:`scan` gives it."""
        for index in range(first, len(self)):
            yield self.scan(index)

    def reported_pose(self) -> FloatArray:
        """Poses (scan, 6) as the navigation reports them: true ones with its errors."""
        return self.pose.copy() if self._errors is None else self._errors.reported_pose(self.pose)

    def attributes(self) -> dict[str, Any]:
        """Describe the run."""
        return {
            "lane": self.scene.name,
            "sensor": self.sensor.name,
            "seed": self.seed,
            "simulated": "flgpr",
        }

    def run(self, bodies: bool = False) -> xr.Dataset:
        """Simulate all scans into a run held in memory; if wanted what the targets' bodies alone add to them."""
        tx, rx = self.sensor.pairs()
        axes = self.frequency, list(self.sensor.polarization)
        scans = np.stack(
            [(self.bodies if bodies else self.scan)(index) for index in range(len(self))]
        )
        return make_run(scans, *axes, tx, rx, self.reported_pose(), self.time, self.attributes())

    def _array(self, index: int) -> ArrayState:
        return dataclasses.replace(
            array_state(self.sensor, self.pose[index]), drift=self._drift[index]
        )

    def _view(self, array: ArrayState, pose: FloatArray) -> View:
        """Gather what a scan sees its scatterers by."""
        shadows = None
        if self._strips:
            shadows = Shadows(
                [strip for strip in self._strips if _in_view(strip, pose)], array, self.frequency
            )
        return View(self.sensor.footprint, pose, array, self._terrain, shadows)

    def _single_echoes(self, view: View, things: bool = True) -> Echoes:
        """Gather the echoes of targets and, if wanted, of all else that is no layer."""
        objects = self.world.objects if things else ()
        echoes = Echoes()
        for index, one in enumerate(
            itertools.chain[Target | SceneObject](self.world.targets, objects)
        ):
            if _in_view(one, view.pose):
                first = len(echoes.path)
                array = self._above(one.x, one.y, view.array)
                if isinstance(one, Target):
                    add_target(echoes, one, self._ground, array)
                    self._through_hole(echoes, first, index, array)
                else:
                    add_object(echoes, one, self._ground, array, self.seed)
                self._cover(echoes, first, one.x, one.y, view)
        return echoes

    def _through_hole(self, echoes: Echoes, first: int, index: int, array: ArrayState) -> None:
        """Lead a target's echoes, from number ``first`` on, through the loosened soil over it."""
        hole = self._dug.get(index)
        target = self.world.targets[index]
        if hole is not None:
            sine = incidence(target.x, target.y, 0.0, array)
            extra, factor = hole_factor(hole, target.depth, sine, self._ground)
            for i in range(first, len(echoes.path)):
                echoes.path[i] = echoes.path[i] + 2 * extra
                echoes.spectrum[i] = echoes.spectrum[i] * factor

    def _above(self, x: float, y: float, array: ArrayState) -> ArrayState:
        """Count the antennas' heights from the ground at a place, on which a body stands as on a plane."""
        down = np.array([0.0, 0.0, self._height(x, y)])
        return dataclasses.replace(array, position=array.position - down)

    def _cover(self, echoes: Echoes, first: int, x: float, y: float, view: View) -> None:
        """Raise a body's echoes, from number ``first`` on, to the ground it stands on, through grass and shadow."""
        grass = self.scene.grass
        ground = self._height(x, y)
        places = np.array(echoes.place[first:]).reshape(-1, 3)
        if not len(places):
            return
        through = np.ones((4, self.frequency.size), complex)
        if view.shadows is not None:
            through *= view.shadows.body_factor(
                np.array([x, y, ground + max(places[:, 2].mean(), 0.0)])
            )
        sine = view.sine(np.array([[x, y, 0.0]])).item() if grass.grown else 0.0
        for i, place in enumerate(places, first):
            factor = through
            if grass.grown:
                above = min(max(1 - place[2] / grass.height, 0.0), 1.0)
                factor = through * through_grass(grass, self.frequency, sine, above)[[0, 1, 2, 2]]
            echoes.spectrum[i] = echoes.spectrum[i] * factor
            echoes.place[i] = place + np.array([0.0, 0.0, ground])

    def _make_layers(self) -> list[Layer]:
        """Make all that is summed as point scatterers; further layers are added to this list."""
        layers: list[Layer] = []
        surface = self.scene.surface
        grass = self.scene.grass
        density = surface.density or PER_CELL / finest_cell(self.sensor)
        if surface.echo:
            field = SurfaceField(surface, self.world.patches, density, self.seed)
            spectra = _surface_spectra(surface, self.scene.soil, grass, self.sensor.tones)
            layers.append(SurfaceLayer(field, spectra))
        if grass.grown:
            layers.append(
                GrassLayer(grass, grass.density or density / 2, self.seed, self.frequency)
            )
        return layers + subsurface_layers(
            self.scene, self.world.holes, self._ground, density / 4, self.seed
        )


@functools.lru_cache(maxsize=16)
def _surface_spectra(surface: Surface, soil: Soil, grass: Grass, tones: Tones) -> SineSpectra:
    """Factor sqrt(σ⁰(f, θ)) of HH, VV and cross: the same on every lane of a site."""
    frequency = tones.axis()
    sines = np.linspace(0.02, 0.999, 256)
    shape = (
        surface.rms_height,
        surface.correlation_length,
        surface.slope,
        surface.unevenness,
        surface.waviness,
    )
    hh, vv = surface_backscatter(
        frequency[None, :], sines[:, None], soil.media(frequency)[0], *shape
    )
    spectra = np.sqrt([hh, vv, hh])
    if grass.grown:
        spectra = spectra * through_grass(grass, frequency, sines)
    return SineSpectra(sines, spectra, _RANKS)


def simulate(
    scene: Scene, sensor: Sensor, seed: int, errors: bool = True
) -> tuple[xr.Dataset, pd.DataFrame]:
    """Simulate a run over a scene, and give it with the truth table of the lane's targets; see :class:`Simulator`."""
    simulator = Simulator(scene, sensor, seed, errors)
    return simulator.run(), simulator.truth


def array_state(sensor: Sensor, pose: FloatArray) -> ArrayState:
    """Place a sensor's antennas in the lane frame for a pose (6,)."""
    first, second = sensor.pair_indices()
    turn = pose_matrix(pose)
    position = vehicle_to_lane(np.concatenate([sensor.tx, sensor.rx]), pose)
    axis = turn @ np.array([0.0, math.cos(sensor.tilt), -math.sin(sensor.tilt)])
    antenna = sensor.antenna
    exponent = -1.0 if antenna.kind == "dipole" else antenna.exponent
    narrows = antenna.kind == "horn" and antenna.beam == "aperture"
    growth = (antenna.exponent + 1) / antenna.gain_frequency**2 if narrows else 0.0
    look = (axis, turn[:, 0].copy(), turn[:, 2].copy(), exponent, growth)
    return ArrayState(position, first, second + len(sensor.tx), *look)


def sweep_drift(pose: FloatArray, time: FloatArray, sweep_time: float) -> FloatArray:
    """How far the vehicle drives in each sweep, (scan, 3) along the lane's axes: level, zero for a single scan."""
    drift = np.zeros((len(pose), 3))
    if sweep_time > 0 and len(pose) > 1:
        drift[:, :2] = np.gradient(pose[:, :2], time, axis=0) * sweep_time
    return drift


def system_response(sensor: Sensor, frequency: FloatArray) -> FloatArray:
    """Compute what multiplies ``sqrt(σ)·pattern/(R_t·R_r)`` at every tone (frequency,).

    Horns: ``G(f)·λ/(4π)^1.5`` with G growing as f². Dipoles: ``ωμ0/(4π)^1.5``, the field per unit
    current moment.
    """
    if sensor.antenna.kind == "dipole":
        return np.asarray(2 * np.pi * frequency * 4e-7 * np.pi / (4 * np.pi) ** 1.5)
    gain = 10 ** (sensor.antenna.gain_db / 10) * (frequency / sensor.antenna.gain_frequency) ** 2
    return np.asarray(gain * SPEED_OF_LIGHT / frequency / (4 * np.pi) ** 1.5)


def finest_cell(sensor: Sensor, distance: float = 10.0) -> float:
    """Area, m², of a sensor's finest cell at a ground range: ``c/(2B·sinθ)`` times ``λ_min·R/(D_t + D_r)``."""
    tones = sensor.tones.axis()
    slant = math.hypot(distance, sensor.height)
    down = SPEED_OF_LIGHT / (2 * max(tones[-1] - tones[0], sensor.tones.step)) * slant / distance
    tx, rx = sensor.pairs()
    aperture = (
        2 * float(np.ptp((tx + rx)[:, 0]) / 2)
        if sensor.scanned
        else float(np.ptp(tx[:, 0]) + np.ptp(rx[:, 0]))
    )
    return float(down * SPEED_OF_LIGHT / tones[-1] * slant / max(aperture, 0.1))


def _in_view(one: Target | SceneObject | Strip, pose: FloatArray) -> bool:
    dx = one.x - pose[0]
    dy = one.y - pose[1]
    forward = dx * math.sin(pose[3]) + dy * math.cos(pose[3])
    return bool(0.5 < forward < _REACH and math.hypot(dx, dy) < _REACH)


MOST_MEMORY = 4e9
MOST_HOURS = 48.0
"""What a simulation may take unless it is forced: bytes, and hours on one core."""
# interpreter, libraries, kernels: bytes, and seconds to compile
_PROGRAM = 400e6
_BEGIN = 20.0
_PER_THING = 4000.0, 5e-5  # a drawn object: bytes, and seconds to draw it and its row of the tables
# a scatterer in view, and one of a tile that is kept, bytes
_PER_POINT = 600.0
_PER_KEPT = 60.0
_PER_SAMPLE = 300.0, 4e-7  # a pair's tone: bytes, seconds in each scan
_PER_ECHO = 200.0, 1e-8  # a tone of a body in view, bytes; of each of its pairs, seconds
_PER_PATH = 6e-8  # a scatterer as a pair sees it, seconds
_PER_SHADOW = 1e-7, 1e-5  # a scatterer, and a body, behind a thing that throws a shadow, seconds
_SEEN = 90.0  # m of ground on which single bodies are in view
_FEWEST = 25.0  # nodes of the relief under the scatterers, per m²


class Effort(NamedTuple):
    """An estimate from above."""

    scans: float
    things: float  #: targets, objects, patches and holes
    points: float  #: scatterers that a scan sees
    memory: float  #: bytes
    seconds: float  #: on one core


def drawing_effort(scene: Scene) -> Effort:
    """Estimate what it takes to draw a scene's world, without a radar."""
    side = scene.clutter.roadside[1]
    span = scene.length + 2 * MARGIN
    clutter = scene.clutter
    things = float(
        len(scene.targets)
        + len(scene.objects)
        + len(scene.patches)
        + sum(d.count for d in scene.draws)
    )
    things += ((clutter.rocks + clutter.patches) * 2 * side + clutter.bushes + clutter.posts) * span
    things += (
        scene.holes.empty * scene.length * (scene.x_max - scene.x_min) if scene.holes.on else 0.0
    )
    return Effort(
        0.0, things, 0.0, _PROGRAM + _PER_THING[0] * things, _BEGIN + _PER_THING[1] * things
    )


def simulation_effort(scene: Scene, sensor: Sensor) -> Effort:
    """Estimate what a scene seen by a sensor takes; the factors are from above of measured ones."""
    drawn = drawing_effort(scene)
    scans = _scans(scene)
    x_min, x_max, y_min, y_max = sensor.footprint
    reach = max(math.hypot(x, y) for x in (x_min, x_max) for y in (y_min, y_max))
    area = min(
        (x_max - x_min + 2) * (y_max - y_min + 2) * 2, 4 * (reach + 2) ** 2
    )  # about a footprint that is turned
    density = _density(scene, sensor)
    points = max(density, _FEWEST) * area
    pairs = len(sensor.tx) if sensor.scanned else len(sensor.tx) * len(sensor.rx)
    tones = sensor.tones.count
    near = drawn.things * min(1.0, _SEEN / (scene.length + 2 * MARGIN))
    memory = drawn.memory + _PER_POINT * points + _PER_KEPT * density * max(area, TILES_KEPT)
    memory += (
        _PER_SAMPLE[0] * pairs * tones
        + (_PER_ECHO[0] * tones + 60.0 * pairs) * near
        + 200.0 * scans
    )
    each = (
        _PER_PATH * points * pairs
        + _PER_SAMPLE[1] * pairs * tones
        + _PER_ECHO[1] * pairs * tones * near
    )
    each += 2e-6 * drawn.things + (
        (_PER_SHADOW[0] * points + _PER_SHADOW[1] * near) * near if scene.shadow.on else 0.0
    )
    return Effort(scans, drawn.things, points, memory, drawn.seconds + scans * each)


def check_effort(scene: Scene, sensor: Sensor | None = None, force: bool = False) -> None:
    """Refuse what takes more than ``MOST_MEMORY`` or ``MOST_HOURS``, to be drawn or, with a sensor, to be simulated."""
    effort = drawing_effort(scene) if sensor is None else simulation_effort(scene, sensor)
    hours = effort.seconds / 3600
    if not force and not (effort.memory <= MOST_MEMORY and hours <= MOST_HOURS):
        what = (
            f"{effort.scans:.3g} scans, {effort.points:.3g} scatterers in view, "
            if sensor is not None
            else ""
        )
        raise ValueError(
            f"scene {scene.name!r} must take at most {MOST_MEMORY / 1e9:g} GB and {MOST_HOURS:g} hours, got "
            f"{effort.memory / 1e9:.3g} GB and {hours:.3g} hours ({what}{effort.things:.3g} targets and objects); "
            "--force goes beyond"
        )


def warn_of_aliases(sensor: Sensor) -> None:
    """Warn of tones whose steps let far ground of a sensor's footprint lie over its near ground in the data.

    Real radars are built so, and a simulated one shows what their data look like: no error.
    """
    tx, rx = (side + [0.0, 0.0, sensor.height] for side in sensor.pairs())
    x_min, x_max, y_min, y_max = sensor.footprint
    paths = image_paths(sensor.tones.axis(), tx, rx, (x_min, x_max), (y_min, y_max))
    if paths.repeats:
        step = SPEED_OF_LIGHT / (paths.farthest - paths.nearest)
        warnings.warn(
            f"tones.step should be below {step / 1e6:.3g} MHz for the footprint of sensor {sensor.name!r}, got "
            f"{sensor.tones.step / 1e6:g} MHz: echoes repeat after {paths.unambiguous:.4g} m of path, and paths by way "
            f"of the footprint are {paths.nearest:.4g} to {paths.farthest:.4g} m long, so that its far ground lies "
            "over its near ground in the data; take finer steps, or a footprint that ends nearer",
            stacklevel=2,
        )


def _scans(scene: Scene) -> float:
    track = scene.track
    if track.positions is not None:
        return float(len(track.positions))
    start = -20.0 if track.start is None else track.start
    stop = scene.length - 5.0 if track.stop is None else track.stop
    return (
        max(stop - start, 0.0) / (sum(track.step) / 2)
        + 1.0
        + sum(count for _, count in track.stops)
    )


def _density(scene: Scene, sensor: Sensor) -> float:
    """Scatterers of all layers per m²."""
    usual = scene.surface.density or PER_CELL / finest_cell(sensor)
    found = usual if scene.surface.echo else 0.0
    if scene.grass.grown:
        found += scene.grass.density or usual / 2
    uneven = scene.heterogeneity
    if uneven.on and uneven.deviation > 0:
        found += uneven.density or usual / 4
    parts = scene.stones, scene.roots, scene.lenses
    return found + 6 * sum(part.density for part in parts if part.on)
