"""How much memory and time a simulation takes, told before anything of it is drawn."""

from __future__ import annotations

import math
from typing import NamedTuple

from flgpr.model import Sensor
from flgpr.simulate.field import TILES_KEPT
from flgpr.simulate.scene import Scene
from flgpr.simulate.simulator import PER_CELL, finest_cell
from flgpr.simulate.world import MARGIN

MOST_MEMORY, MOST_HOURS = 4e9, 48.0
"""What a simulation may take unless it is forced: bytes, and hours on one core."""
_PROGRAM, _BEGIN = 400e6, 20.0  # interpreter, libraries, kernels: bytes, and seconds to compile
_PER_THING = 4000.0, 5e-5  # a drawn object: bytes, and seconds to draw it and its row of the tables
_PER_POINT, _PER_KEPT = 600.0, 60.0  # a scatterer in view, and one of a tile that is kept, bytes
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
    side, span, clutter = scene.clutter.roadside[1], scene.length + 2 * MARGIN, scene.clutter
    things = float(len(scene.targets) + len(scene.objects) + len(scene.patches) + sum(d.count for d in scene.draws))
    things += ((clutter.rocks + clutter.patches) * 2 * side + clutter.bushes + clutter.posts) * span
    things += scene.holes.empty * scene.length * (scene.x_max - scene.x_min) if scene.holes.on else 0.0
    return Effort(0.0, things, 0.0, _PROGRAM + _PER_THING[0] * things, _BEGIN + _PER_THING[1] * things)


def simulation_effort(scene: Scene, sensor: Sensor) -> Effort:
    """Estimate what a scene seen by a sensor takes; the factors are from above of measured ones."""
    drawn, scans = drawing_effort(scene), _scans(scene)
    x_min, x_max, y_min, y_max = sensor.footprint
    reach = max(math.hypot(x, y) for x in (x_min, x_max) for y in (y_min, y_max))
    area = min((x_max - x_min + 2) * (y_max - y_min + 2) * 2, 4 * (reach + 2) ** 2)  # about a footprint that is turned
    density = _density(scene, sensor)
    points = max(density, _FEWEST) * area
    pairs = len(sensor.tx) if sensor.scanned else len(sensor.tx) * len(sensor.rx)
    tones, near = sensor.tones.count, drawn.things * min(1.0, _SEEN / (scene.length + 2 * MARGIN))
    memory = drawn.memory + _PER_POINT * points + _PER_KEPT * density * max(area, TILES_KEPT)
    memory += _PER_SAMPLE[0] * pairs * tones + (_PER_ECHO[0] * tones + 60.0 * pairs) * near + 200.0 * scans
    each = _PER_PATH * points * pairs + _PER_SAMPLE[1] * pairs * tones + _PER_ECHO[1] * pairs * tones * near
    each += 2e-6 * drawn.things + ((_PER_SHADOW[0] * points + _PER_SHADOW[1] * near) * near if scene.shadow.on else 0.0)
    return Effort(scans, drawn.things, points, memory, drawn.seconds + scans * each)


def check_effort(scene: Scene, sensor: Sensor | None = None, force: bool = False) -> None:
    """Refuse what takes more than ``MOST_MEMORY`` or ``MOST_HOURS``, to be drawn or, with a sensor, to be simulated."""
    effort = drawing_effort(scene) if sensor is None else simulation_effort(scene, sensor)
    hours = effort.seconds / 3600
    if not force and not (effort.memory <= MOST_MEMORY and hours <= MOST_HOURS):
        what = f"{effort.scans:.3g} scans, {effort.points:.3g} scatterers in view, " if sensor is not None else ""
        raise ValueError(
            f"scene {scene.name!r} must take at most {MOST_MEMORY / 1e9:g} GB and {MOST_HOURS:g} hours, got "
            f"{effort.memory / 1e9:.3g} GB and {hours:.3g} hours ({what}{effort.things:.3g} targets and objects); "
            "--force goes beyond"
        )


def _scans(scene: Scene) -> float:
    track = scene.track
    if track.positions is not None:
        return float(len(track.positions))
    start = -20.0 if track.start is None else track.start
    stop = scene.length - 5.0 if track.stop is None else track.stop
    return max(stop - start, 0.0) / (sum(track.step) / 2) + 1.0 + sum(count for _, count in track.stops)


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
