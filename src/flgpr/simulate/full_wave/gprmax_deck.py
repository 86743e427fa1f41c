"""A small scene as input files of gprMax, the open full-wave solver, so that others' physics can check ours.

Only text is written here; nothing of gprMax is needed. A run per transmitter and polarization has
the scene, another only air: its field is the direct wave, which the reader takes off.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flgpr.model import SPEED_OF_LIGHT, Sensor, pose_matrix, vehicle_to_lane
from flgpr.model.arrays import FloatArray
from flgpr.simulate.full_wave.gprmax_grid import (
    Grid,
    GridPoint,
    RelaxingMedium,
    fit_relaxation,
    rectangles,
)
from flgpr.simulate.ground.roughness import surface_heights
from flgpr.simulate.ground.subsurface import buried_clutter
from flgpr.simulate.scene.scene import Scene, SceneObject, Target
from flgpr.simulate.scene.world import World, draw_track, draw_world

FORMAT = "flgpr-gprmax-1"
SCENE_FILE = "scene.txt"
_ABSORBER = 10  # cells
_MARGIN = 15  # cells between anything and the absorbing layers
_BYTES_PER_CELL = 70  # six fields, their material numbers and the solid, single precision
_ROCK = 6.0  # permittivity, as the simulator's own rocks


@dataclass
class Decks:
    """Input files of a scene."""

    files: dict[str, str] = field(default_factory=dict)  #: name and text of every file
    #: what the reader needs to put the results together, as JSON values
    manifest: dict[str, Any] = field(default_factory=dict)
    omissions: list[str] = field(
        default_factory=list
    )  #: parts of scene and sensor that are not in the files, in words
    summary: list[str] = field(default_factory=list)  #: size and cost, in words


def make_decks(
    scene: Scene,
    sensor: Sensor,
    seed: int,
    cells_per_wavelength: float = 10.0,
    max_cells: float = 3e8,
) -> Decks:
    """Write a scene as gprMax input files; a ValueError if the model is too large or too coarse, or for some soils.

    Parameters
    ----------
    scene : Scene
        A small one; give it ``track.positions``, for every scan is a run per transmitter and
        polarization.
    sensor : Sensor
        Its antennas become ideal short dipoles across its axis: H along the array, V upright and
        tilted with it.
    seed : int
        Draws the same world, track and surface heights as :func:`flgpr.simulate.simulate`.
    cells_per_wavelength, max_cells : float
        Cells per wavelength at the highest tone in the slowest soil, and those of the largest model
        that is written.
    """
    if not cells_per_wavelength >= 4:
        raise ValueError(f"cells_per_wavelength must be at least 4, got {cells_per_wavelength:g}")
    world = draw_world(scene, seed)
    poses, times = draw_track(scene, sensor.height, seed)
    tones = sensor.tones.axis()
    media = scene.soil.media(tones)
    slowest = max(float(np.sqrt(np.abs(eps)).max()) for eps in media)
    wavelength = SPEED_OF_LIGHT / tones[-1]
    cell = min(wavelength / slowest, wavelength) / cells_per_wavelength
    digits = 10.0 ** (math.floor(math.log10(cell)) - 1)
    cell = round(
        math.floor(cell / digits + 1e-9) * digits, 9
    )  # rounded down, so that files and grids are readable
    antennas = vehicle_to_lane(np.concatenate([sensor.tx, sensor.rx]), poses)
    grid = _grid(scene, world, antennas, cell)
    count = math.prod(grid.shape)
    if count > max_cells:
        raise ValueError(
            f"the model must have at most {max_cells:.3g} cells, got {' x '.join(map(str, grid.shape))} = {count:.3g} "
            f"of {1000 * cell:g} mm for {' x '.join(f'{s:.1f}' for s in grid.size)} m: take a shorter or narrower "
            "lane, track.positions closer to it, lower tones or fewer cells per wavelength"
        )
    relaxing = [fit_relaxation(tones, eps, 1.5 * grid.time_step) for eps in media]
    decks = Decks()
    # gprMax refuses a pulse that has 1 % of its peak where a wavelength holds less than three
    # cells: at 3.76 times its centre.
    centre = min(
        float(tones[0] + tones[-1]) / 2, wavelength / slowest / cell * float(tones[-1]) / (3 * 3.85)
    )
    window = _time_window(grid, antennas, slowest, centre)
    decks.files[SCENE_FILE], rough = _scene_text(
        scene, world, grid, relaxing, seed, decks.omissions
    )
    decks.omissions[:0] = _left_out(scene, world, sensor)
    runs = _runs(decks, scene, sensor, poses, antennas, grid, centre, window)
    tx, rx = sensor.pairs()
    decks.manifest = {
        "format": FORMAT,
        "title": scene.name,
        "seed": seed,
        "sensor": sensor.name,
        "polarization": list(sensor.polarization),
        "tones": {
            "start": sensor.tones.start,
            "step": sensor.tones.step,
            "count": sensor.tones.count,
        },
        "tx_position": tx.tolist(),
        "rx_position": rx.tolist(),
        "pose": poses.tolist(),
        "time": times.tolist(),
        "waveform": {"type": "gaussiandotnorm", "frequency": centre},
        "grid": {
            "origin": list(grid.origin),
            "cell": cell,
            "shape": list(grid.shape),
            "time_window": window,
        },
        "soil": [dict(zip(RelaxingMedium._fields, one, strict=True)) for one in relaxing],
        "surface": rough,
        "omissions": decks.omissions,
        "runs": runs,
    }
    decks.summary = [
        f"{len(runs)} runs and {len({run['free'] for run in runs})} of air alone",
        f"{' x '.join(map(str, grid.shape))} cells of {1000 * cell:g} mm: {count * _BYTES_PER_CELL / 2**30:.2g} GiB",
        f"{window / grid.time_step:.0f} time steps, {count * window / grid.time_step:.2g} cell updates per run",
        *(
            f"soil {k + 1}: {len(one.poles)} Debye poles, off by at most {100 * one.error_real:.2g} % in ε' and "
            f"{100 * one.error_loss:.2g} % in ε''"
            for k, one in enumerate(relaxing)
        ),
    ]
    return decks


def _grid(scene: Scene, world: World, antennas: FloatArray, cell: float) -> Grid:
    points = antennas.reshape(-1, 3)
    room = (_ABSORBER + _MARGIN) * cell
    low = np.minimum([scene.x_min, 0.0, 0.0], points.min(axis=0))
    high = np.maximum([scene.x_max, scene.length, 0.0], points.max(axis=0))
    for target in world.targets:
        if scene.lane.contains(target.x, target.y):
            radius, height = target.extent
            reach = radius + height * abs(math.sin(target.tilt))
            low = np.minimum(low, [target.x - reach, target.y - reach, -(target.depth + height)])
            high = np.maximum(high, [target.x + reach, target.y + reach, -target.depth])
    for thing in world.objects:
        if scene.lane.contains(thing.x, thing.y):
            high[2] = max(high[2], thing.height, thing.radius if thing.kind == "rock" else 0.0)
    low[2] = min(low[2], -sum(layer.thickness for layer in scene.soil.layers))
    # The first antenna across and along, and the ground in height, lie on nodes.
    anchor = np.array([*antennas[0, 0, :2], 0.0])
    first = anchor - np.ceil((anchor - low + room) / cell) * cell
    shape = np.ceil((high + room - first) / cell).astype(int)
    return _make_grid(first, cell, shape)


def _make_grid(first: FloatArray, cell: float, shape: NDArray[Any]) -> Grid:
    x, y, z = (float(v) for v in first)
    i, j, k = (int(n) for n in shape)
    return Grid((x, y, z), cell, (i, j, k), _ABSORBER)


def _time_window(grid: Grid, antennas: FloatArray, index: float, centre: float) -> float:
    ends = [(low, low + size) for low, size in zip(grid.origin[:2], grid.size[:2], strict=True)]
    corners = np.array([(x, y) for x in ends[0] for y in ends[1]])
    across = np.linalg.norm(antennas[..., None, :2] - corners, axis=-1).max()
    high = antennas[..., 2].max()
    deep = -grid.origin[2]
    path = 2 * math.hypot(across, high) + 2 * index * deep
    return float(1.1 * path / SPEED_OF_LIGHT + 4 / centre)


def _scene_text(
    scene: Scene,
    world: World,
    grid: Grid,
    soils: list[RelaxingMedium],
    seed: int,
    omissions: list[str],
) -> tuple[str, dict[str, float]]:
    """Write everything that does not change from run to run: soil, surface, objects, targets."""
    lines = []
    for k, soil in enumerate(soils):
        lines.append(f"#material: {soil.permittivity:.9g} {soil.conductivity:.9g} 1 0 soil{k + 1}")
        if soil.poles:
            poles = " ".join(f"{delta:.9g} {tau:.9g}" for delta, tau in soil.poles)
            lines.append(f"#add_dispersion_debye: {len(soil.poles)} {poles} soil{k + 1}")
    ground, rough = _ground(scene, grid, seed, len(soils))
    lines += ground
    outside = [t for t in world.targets if not grid.contains((t.x, t.y, 0.0), t.extent[0])]
    if outside:
        raise ValueError(
            f"every target must lie on the lane, got one at x = {outside[0].x:g}, y = {outside[0].y:g} m"
        )
    lines += _objects(world.objects, grid, rough["rms_height"], omissions)
    bodies: dict[float, str] = {}
    for target in world.targets:
        lines += _target(target, grid, bodies, omissions)
    materials = [f"#material: {eps:g} 0 1 0 {name}" for eps, name in bodies.items()]
    return "\n".join([*materials, *lines]) + "\n", rough


def _ground(scene: Scene, grid: Grid, seed: int, soils: int) -> tuple[list[str], dict[str, float]]:
    surface = scene.surface
    cell = grid.cell
    level = round(-grid.origin[2] / cell)
    steps = np.zeros(grid.shape[:2], dtype=int)
    wanted = 0.0
    if surface.rms_height + surface.unevenness > 0 and (surface.echo or surface.phase_screen):
        heights = surface_heights(surface, seed)
        # Inside the absorbing layers the ground goes on as it enters them.
        axes = [
            np.clip(np.arange(n), grid.absorber, n - 1 - grid.absorber) + 0.5
            for n in grid.shape[:2]
        ]
        x, y = (axis * cell + start for axis, start in zip(axes, grid.origin[:2], strict=True))
        exact = np.stack([heights(x[i], y) for i in range(x.size)])
        steps = np.rint(exact / cell).astype(int)
        wanted = float(exact.std())
    low = int(steps.min())
    high = int(steps.max())
    lines = []
    top = level + low
    below = level * cell
    bottoms = []
    for layer in scene.soil.layers:
        below -= layer.thickness
        bottoms.append(max(round(below / cell), 0))
    tops = [top, *bottoms]
    for k in range(soils):
        floor = bottoms[k] if k < len(bottoms) else 0
        if tops[k] > floor:
            lines.append(
                _box(0, grid.shape[0], 0, grid.shape[1], floor, tops[k], cell, f"soil{k + 1}")
            )
    for step in range(low + 1, high + 1):
        lines += [
            _box(*area, level + step - 1, level + step, cell, "soil1")
            for area in rectangles(steps >= step)
        ]
    return lines, {"rms_height": wanted, "rms_height_on_grid": float(steps.std() * cell)}


def _box(i0: int, i1: int, j0: int, j1: int, k0: int, k1: int, cell: float, material: str) -> str:
    corners = " ".join(f"{n * cell:.9g}" for n in (i0, j0, k0, i1, j1, k1))
    return f"#box: {corners} {material}"


def _objects(
    things: tuple[SceneObject, ...], grid: Grid, rms_height: float, omissions: list[str]
) -> list[str]:
    lines = []
    away = 0
    kinds: dict[str, int] = {}
    for thing in things:
        if not grid.contains((thing.x, thing.y, 0.0), thing.radius):
            away += 1
        elif thing.kind == "rock":
            place = " ".join(f"{v:.9g}" for v in grid.local((thing.x, thing.y, 0.0)))
            lines.append(f"#sphere: {place} {thing.radius:.9g} rock")
        elif thing.kind == "post" and thing.height >= grid.cell:
            foot = -grid.cell * math.ceil(3 * rms_height / grid.cell)
            lines.append(
                _rod(
                    (thing.x, thing.y, thing.height),
                    (thing.x, thing.y, foot),
                    thing.radius,
                    grid,
                    "pec",
                )
            )
        else:
            kinds[thing.kind] = kinds.get(thing.kind, 0) + 1
    if any(line.startswith("#sphere") for line in lines):
        lines.insert(0, f"#material: {_ROCK:g} 0 1 0 rock")
    omissions += [f"{count} of kind {kind}: no body to write" for kind, count in kinds.items()]
    if away:
        omissions.append(f"{away} objects that stand outside the model")
    return lines


def _rod(
    top: Iterable[float], bottom: Iterable[float], radius: float, grid: Grid, material: str
) -> str:
    ends = " ".join(f"{v:.9g}" for v in (*grid.local(list(top)), *grid.local(list(bottom))))
    return f"#cylinder: {ends} {radius:.9g} {material}"


def _target(
    target: Target, grid: Grid, bodies: dict[float, str], omissions: list[str]
) -> list[str]:
    """Write a body of revolution about its leaning axis: discs of its profile, the air gap under its top last."""
    lean = math.sin(target.tilt) * np.array([math.sin(target.azimuth), math.cos(target.azimuth)])
    axis = np.array([*lean, math.cos(target.tilt)])
    top = np.array([target.x, target.y, -target.depth])
    material = "pec"
    if target.dielectric is not None:
        material = bodies.setdefault(target.dielectric, f"body{len(bodies) + 1}")
    least = grid.cell / math.cos(target.tilt)  # gprMax wants the ends of a disc on different nodes
    where = f"the {target.kind} at ({target.x:g}, {target.y:g}) m"
    height = target.extent[1]
    if height < least:
        omissions.append(
            f"the height of {where}: {1000 * height:.0f} mm became a cell, {1000 * least:.0f} mm"
        )
    discs = _discs(target.outline, max(least, 1e-9))
    lines = [_rod(top - a * axis, top - b * axis, r, grid, material) for r, a, b in discs]
    gap = min(target.air_gap, 0.9 * target.height) if target.dielectric is not None else 0.0
    if 0 < gap < least:
        omissions.append(
            f"the air gap of {where}: {1000 * gap:.0f} mm became a cell, {1000 * least:.0f} mm"
        )
        gap = least
    if gap > 0:
        lines.append(_rod(top, top - gap * axis, discs[0][0], grid, "free_space"))
    return lines


def _discs(profile: Any, least: float) -> list[tuple[float, float, float]]:
    """Cut a body of revolution into discs (radius, upper drop, lower drop) no thinner than ``least``."""
    radius, drop = (np.array(column, dtype=float) for column in zip(*profile, strict=True))
    height = max(float(drop[-1]), least)
    edges = np.linspace(0.0, height, max(1, math.floor(height / least + 1e-9)) + 1)
    discs: list[tuple[float, float, float]] = []
    for a, b in itertools.pairwise(edges.tolist()):
        wide = _widest(radius, drop, min((a + b) / 2, 0.999 * float(drop[-1])))
        if discs and abs(discs[-1][0] - wide) < 1e-12:
            discs[-1] = (wide, discs[-1][1], b)
        elif wide > 0:
            discs.append((wide, a, b))
    return discs


def _widest(radius: FloatArray, drop: FloatArray, at: float) -> float:
    best = 0.0
    for r0, r1, d0, d1 in zip(radius[:-1], radius[1:], drop[:-1], drop[1:], strict=True):
        if min(d0, d1) <= at <= max(d0, d1) and d0 != d1:
            best = max(best, r0 + (r1 - r0) * (at - d0) / (d1 - d0))
    return float(best)


def _left_out(scene: Scene, world: World, sensor: Sensor) -> list[str]:
    surface = scene.surface
    omitted = []
    if sensor.antenna.kind == "horn":
        omitted.append("the horns' pattern and gain: ideal short dipoles stand in for them")
    omitted.append(
        "the sensor's errors: leakage, self-signature, drift, noise, interference, lost sweeps, pose errors"
    )
    if surface.echo:
        omitted.append(
            "what the surface has beside its heights (slope, texture, cross_db, correlation, level_db): the ground "
            "scatters as its heights do"
        )
    if world.patches:
        omitted.append(f"{len(world.patches)} wet patches")
    if not scene.terrain.flat:
        omitted.append(
            "the terrain (slope, undulation, ruts): the ground is level but for its roughness"
        )
    if scene.grass.grown:
        omitted.append("the grass")
    buried = [*buried_clutter(scene), *(["refilled holes"] if world.holes else [])]
    if buried:
        omitted.append(f"what lies under the surface: {', '.join(buried)}")
    return omitted


def _runs(
    decks: Decks, scene: Scene, sensor: Sensor, poses: FloatArray, antennas: FloatArray, grid: Grid, centre: float,
    window: float,
) -> list[dict[str, Any]]:  # fmt: skip
    """Write the input file of every scan, transmitter and polarization, and those of air alone that they need."""
    runs: list[dict[str, Any]] = []
    free_files: dict[str, str] = {}
    first, second = sensor.pair_indices()
    for scan, pose in enumerate(poses):
        turn = pose_matrix(pose)
        directions = {
            "H": turn[:, 0],
            "V": turn @ np.array([0.0, math.sin(sensor.tilt), math.cos(sensor.tilt)]),
        }
        places = antennas[scan]
        air = _air_grid(grid, places)
        widest = np.linalg.norm(places[:, None] - places, axis=-1).max()
        air_window = float(1.1 * widest / SPEED_OF_LIGHT + 4 / centre)
        for tx in sorted(set(first.tolist())):
            pairs = np.flatnonzero(first == tx)
            receivers = [
                _receiver(places[len(sensor.tx) + second[p]], directions, grid) for p in pairs
            ]
            for label in sorted({name[0] for name in sensor.polarization}):
                source = grid.spread(places[tx], directions[label])
                name = f"scan{scan:03d}-tx{tx:02d}-{label}"
                title = f"{scene.name}, {name}"
                decks.files[f"{name}.in"] = _deck(title, grid, source, receivers, centre, window)
                shifted = _shift(source, receivers, grid, air)
                text = _deck("air alone", air, *shifted, centre, air_window, scene=False)
                free = free_files.setdefault(text, f"air-{name}")
                decks.files[f"{free}.in"] = text
                runs.append(
                    {
                        "file": name,
                        "free": free,
                        "scan": scan,
                        "transmit": label,
                        "pairs": pairs.tolist(),
                        "source": [[point.component, point.weight] for point in source],
                        "receivers": [
                            {end: [[_name(q, n), point.component, point.weight] for n, point in which]
                             for end, which in one.items()}
                            for q, one in enumerate(receivers)
                        ],
                    }
                )  # fmt: skip
    return runs


Receiver = dict[str, list[tuple[int, GridPoint]]]


def _receiver(position: FloatArray, directions: dict[str, FloatArray], grid: Grid) -> Receiver:
    """Give every field component of a receiver's two polarizations a number, those in common once."""
    known: dict[tuple[str, tuple[int, int, int]], int] = {}
    return {
        label: [
            (known.setdefault((p.component, p.node), len(known)), p)
            for p in grid.spread(position, direction)
        ]
        for label, direction in directions.items()
    }


def _name(receiver: int, number: int) -> str:
    return f"r{receiver}n{number}"


def _air_grid(grid: Grid, places: FloatArray) -> Grid:
    """Cut the box around the antennas out of the grid, its nodes in place."""
    room = _ABSORBER + _MARGIN
    low = np.floor(grid.local(places).min(axis=0) / grid.cell).astype(int) - room
    high = np.ceil(grid.local(places).max(axis=0) / grid.cell).astype(int) + room
    origin = np.asarray(grid.origin) + low * grid.cell
    return _make_grid(origin, grid.cell, high - low)


def _shift(
    source: list[GridPoint], receivers: list[Receiver], grid: Grid, air: Grid
) -> tuple[list[GridPoint], list[Receiver]]:
    by = np.rint((np.asarray(air.origin) - np.asarray(grid.origin)) / grid.cell).astype(int)

    def moved(point: GridPoint) -> GridPoint:
        i, j, k = (int(n) for n in np.asarray(point.node) - by)
        return point._replace(node=(i, j, k))

    return [moved(p) for p in source], [
        {end: [(n, moved(p)) for n, p in which] for end, which in one.items()} for one in receivers
    ]


def _deck(
    title: str, grid: Grid, source: list[GridPoint], receivers: list[Receiver], centre: float, window: float,
    scene: bool = True,
) -> str:  # fmt: skip
    cell = grid.cell
    lines = [
        f"#title: {title}",
        "#domain: " + " ".join(f"{v:.9g}" for v in grid.size),
        f"#dx_dy_dz: {cell:.9g} {cell:.9g} {cell:.9g}",
        f"#time_window: {window:.9g}",
        f"#pml_cells: {grid.absorber}",
    ]
    if scene:
        lines.append(f"#include_file: {SCENE_FILE}")
    for k, point in enumerate(source):
        lines.append(f"#waveform: gaussiandotnorm {point.weight:.12g} {centre:.9g} pulse{k + 1}")
        lines.append(f"#hertzian_dipole: {point.component} {_node(point, cell)} pulse{k + 1}")
    for q, one in enumerate(receivers):
        wanted = {n: point for which in one.values() for n, point in which}
        for n, point in sorted(wanted.items()):
            lines.append(f"#rx: {_node(point, cell)} {_name(q, n)} E{point.component}")
    return "\n".join(lines) + "\n"


def _node(point: GridPoint, cell: float) -> str:
    return " ".join(f"{n * cell:.9g}" for n in point.node)
