"""What memory and time a simulation takes, estimated from above before anything is drawn."""

from __future__ import annotations

import math
from typing import NamedTuple

from flgpr.model import Sensor
from flgpr.simulate.ground.field import TILES_KEPT
from flgpr.simulate.scene.scene import Scene
from flgpr.simulate.scene.world import MARGIN
from flgpr.simulate.simulator import PER_CELL, finest_cell

MOST_MEMORY = 4e9
"""Memory that a simulation may take unless it is forced, bytes."""
MOST_HOURS = 48.0
"""Time that a simulation may take unless it is forced, hours on one core."""
# All factors are from above of measured ones; bytes, and seconds on one core.
_PROGRAM_BYTES = 400e6  # interpreter, libraries, kernels
_PROGRAM_SECONDS = 20.0  # to compile the kernels
# A drawn object and its row of the tables.
_OBJECT_BYTES = 4000.0
_OBJECT_SECONDS = 5e-5
_POINT_BYTES = 600.0  # a scatterer in view
_STORED_POINT_BYTES = 60.0  # a scatterer of a tile that stays in memory
# A pair's tone; its seconds are those of each scan, as all below.
_SAMPLE_BYTES = 300.0
_SAMPLE_SECONDS = 4e-7
_ECHO_TONE_BYTES = 200.0  # a tone of a body in view
_ECHO_TONE_SECONDS = 1e-8  # a tone of a body in view, in each pair
_ECHO_PAIR_BYTES = 60.0  # a body in view, in each pair
_SCAN_BYTES = 200.0
_PATH_SECONDS = 6e-8  # a scatterer as a pair sees it
_OBJECT_TEST_SECONDS = 2e-6  # whether an object is in view
# A scatterer, and a body, behind an object that throws a shadow.
_POINT_SHADOW_SECONDS = 1e-7
_BODY_SHADOW_SECONDS = 1e-5
_BODY_VIEW = 90.0  # m of ground on which single bodies are in view
_RELIEF_DENSITY = 25.0  # nodes of the relief under the scatterers, per m²


class Effort(NamedTuple):
    """An estimate from above."""

    scans: float
    objects: float  #: targets, objects, patches and holes
    points: float  #: scatterers that a scan sees
    memory: float  #: bytes
    seconds: float  #: on one core


def drawing_effort(scene: Scene) -> Effort:
    """Estimate what it takes to draw a scene's world, without a radar."""
    objects = _object_count(scene)
    memory = _PROGRAM_BYTES + _OBJECT_BYTES * objects
    seconds = _PROGRAM_SECONDS + _OBJECT_SECONDS * objects
    return Effort(0.0, objects, 0.0, memory, seconds)


def _object_count(scene: Scene) -> float:
    """Return the number of targets, objects, patches and holes, those to be drawn by their mean."""
    clutter = scene.clutter
    width = 2 * clutter.roadside[1]
    span = scene.length + 2 * MARGIN
    count = len(scene.targets) + len(scene.objects) + len(scene.patches)
    count += sum(draw.count for draw in scene.draws)
    per_metre = (clutter.rocks + clutter.patches) * width + clutter.bushes + clutter.posts
    total = float(count) + per_metre * span
    if scene.holes.on:
        total += scene.holes.empty * scene.length * (scene.x_max - scene.x_min)
    return total


def simulation_effort(scene: Scene, sensor: Sensor) -> Effort:
    """Estimate what it takes to simulate a scene seen by a sensor."""
    drawn = drawing_effort(scene)
    scans = _scan_count(scene)
    area = _area_in_view(sensor)
    density = _scatterer_density(scene, sensor)
    points = max(density, _RELIEF_DENSITY) * area
    pairs = len(sensor.tx) if sensor.scanned else len(sensor.tx) * len(sensor.rx)
    tones = sensor.tones.count
    bodies = drawn.objects * min(1.0, _BODY_VIEW / (scene.length + 2 * MARGIN))
    memory = drawn.memory + _POINT_BYTES * points
    memory += _STORED_POINT_BYTES * density * max(area, TILES_KEPT)
    bodies_bytes = (_ECHO_TONE_BYTES * tones + _ECHO_PAIR_BYTES * pairs) * bodies
    memory += _SAMPLE_BYTES * pairs * tones + bodies_bytes + _SCAN_BYTES * scans
    per_scan = (
        _PATH_SECONDS * points * pairs
        + _SAMPLE_SECONDS * pairs * tones
        + _ECHO_TONE_SECONDS * pairs * tones * bodies
    )
    shadow = 0.0
    if scene.shadow.on:
        shadow = (_POINT_SHADOW_SECONDS * points + _BODY_SHADOW_SECONDS * bodies) * bodies
    per_scan += _OBJECT_TEST_SECONDS * drawn.objects + shadow
    return Effort(scans, drawn.objects, points, memory, drawn.seconds + scans * per_scan)


def check_effort(scene: Scene, sensor: Sensor | None = None, force: bool = False) -> None:
    """Refuse a scene that takes too much memory or time.

    Parameters
    ----------
    scene : Scene
        The scene.
    sensor : Sensor, optional
        Without it the scene is only drawn.
    force : bool
        Whether to allow any effort.

    Raises
    ------
    ValueError
        If the effort is beyond ``MOST_MEMORY`` or ``MOST_HOURS``.
    """
    effort = drawing_effort(scene) if sensor is None else simulation_effort(scene, sensor)
    hours = effort.seconds / 3600
    if force or (effort.memory <= MOST_MEMORY and hours <= MOST_HOURS):
        return
    counts = f"{effort.objects:.3g} targets and objects"
    if sensor is not None:
        counts = f"{effort.scans:.3g} scans, {effort.points:.3g} scatterers in view, {counts}"
    raise ValueError(
        f"scene {scene.name!r} must take at most {MOST_MEMORY / 1e9:g} GB and {MOST_HOURS:g} "
        f"hours, got {effort.memory / 1e9:.3g} GB and {hours:.3g} hours ({counts}); "
        "`force` goes beyond"
    )


def _area_in_view(sensor: Sensor) -> float:
    """Return the area of the tiles that a scan sees, m²: about a footprint that is turned."""
    x_min, x_max, y_min, y_max = sensor.ground_in_view
    corners = [(x, y) for x in (x_min, x_max) for y in (y_min, y_max)]
    reach = max(math.hypot(x, y) for x, y in corners)
    return min((x_max - x_min + 2) * (y_max - y_min + 2) * 2, 4 * (reach + 2) ** 2)


def _scan_count(scene: Scene) -> float:
    """Return the number of scans, by the mean distance between them."""
    track = scene.track
    if track.positions is not None:
        return float(len(track.positions))
    start, stop = scene.track_ends
    mean_step = sum(track.step) / 2
    standing = sum(count for _, count in track.stops)
    return max(stop - start, 0.0) / mean_step + 1.0 + standing


def _scatterer_density(scene: Scene, sensor: Sensor) -> float:
    """Return the scatterers of all layers per m²."""
    usual = scene.surface.density or PER_CELL / finest_cell(sensor)
    density = usual if scene.surface.echo else 0.0
    if scene.grass.grown:
        density += scene.grass.density or usual / 2
    uneven = scene.heterogeneity
    if uneven.on and uneven.deviation > 0:
        density += uneven.density or usual / 4
    buried = 0.0
    for table in (scene.stones, scene.roots, scene.lenses):
        if table.on:
            buried += table.density
    return density + 6 * buried
