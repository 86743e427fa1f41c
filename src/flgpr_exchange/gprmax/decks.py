"""A small scene as input files of gprMax, the open full-wave solver.

Only text is written here; nothing of gprMax is needed. A run per transmitter and polarization has
the scene, another only air: its field is the direct wave, which the reader takes off.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass, field

import numpy as np

from flgpr.model import SPEED_OF_LIGHT, Sensor, pose_matrix, vehicle_to_lane
from flgpr.simulate.ground.subsurface import buried_clutter
from flgpr.simulate.scene.scene import Scene
from flgpr.simulate.scene.world import World, draw_track, draw_world
from flgpr.types import AnyArray, Entries, FloatArray, Notes
from flgpr_exchange.gprmax.deck_results import FORMAT
from flgpr_exchange.gprmax.grid import CellGrid, GridPoint, fit_relaxation, numbers
from flgpr_exchange.gprmax.scene import densest_body, scene_text

SCENE_FILE = "scene.txt"
_ABSORBER = 10  # cells
_MARGIN = 15  # cells between anything and the absorbing layers
_BYTES_PER_CELL = 70  # six fields, their material numbers and the solid, single precision


@dataclass
class Decks:
    """Input files of a scene."""

    files: dict[str, str] = field(default_factory=dict)  #: name and text of every file
    #: what the reader needs to put the results together, as JSON values
    manifest: Entries = field(default_factory=dict)
    #: what of scene and sensor is not in the files, in words
    omissions: list[str] = field(default_factory=list)
    summary: list[str] = field(default_factory=list)  #: size and cost, in words


def make_decks(
    scene: Scene,
    sensor: Sensor,
    seed: int,
    cells_per_wavelength: float = 10.0,
    max_cells: float = 3e8,
    time_window: float | None = None,
) -> Decks:
    """Write a scene as gprMax input files.

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
    time_window : float, optional
        Recorded time, s. None records until the echo of the model's farthest corner has ended.
        A shorter one saves as much time; echoes that come later are lost.

    Returns
    -------
    Decks
        The files, and what a reader of their results needs.

    Raises
    ------
    ValueError
        If the model is too large or its cells are too coarse, if a target does not lie on the lane,
        or if a soil cannot be fitted.
    """
    if not cells_per_wavelength >= 4:
        raise ValueError(f"cells_per_wavelength must be at least 4, got {cells_per_wavelength:g}")
    if time_window is not None and not 0 < time_window < math.inf:
        raise ValueError(f"time_window must be positive, got {time_window:g} s")
    world = draw_world(scene, seed)
    poses, times = draw_track(scene, sensor.height, seed)
    tones = sensor.tones.axis()
    media = scene.soil.media(tones)
    slowest = max(float(np.sqrt(np.abs(eps)).max()) for eps in media)
    wavelength = SPEED_OF_LIGHT / tones[-1]
    cell = _round_down(min(wavelength / slowest, wavelength) / cells_per_wavelength)
    antennas = vehicle_to_lane(np.concatenate([sensor.tx, sensor.rx]), poses)
    grid = _grid(scene, world, antennas, cell)
    shape = " x ".join(map(str, grid.shape))
    cells = math.prod(grid.shape)
    if cells > max_cells:
        size = " x ".join(f"{edge:.1f}" for edge in grid.size)
        raise ValueError(
            f"the model must have at most {max_cells:.3g} cells, got {shape} = {cells:.3g} of "
            f"{1000 * cell:g} mm for {size} m: take a shorter or narrower lane, track.positions "
            "closer to it, lower tones or fewer cells per wavelength"
        )
    soils = [fit_relaxation(tones, eps, 1.5 * grid.time_step) for eps in media]
    decks = Decks()
    # gprMax refuses a pulse that has 1 % of its peak where a wavelength holds less than three
    # cells: at 3.76 times its centre.
    band_centre = float(tones[0] + tones[-1]) / 2
    index = max(slowest, math.sqrt(densest_body(world)))
    highest_centre = wavelength / index / cell * float(tones[-1]) / (3 * 3.85)
    centre = min(band_centre, highest_centre)
    window = time_window or _time_window(grid, antennas, slowest, centre)
    omissions: Notes = []
    decks.files[SCENE_FILE], surface = scene_text(scene, world, grid, soils, seed, omissions)
    decks.omissions = _left_out(scene, world, sensor) + omissions
    runs = _runs(decks, scene, sensor, poses, antennas, grid, centre, window)
    tx, rx = sensor.pairs()
    decks.manifest = {
        "format": FORMAT,
        "title": scene.name,
        "seed": seed,
        "sensor": sensor.name,
        "polarization": list(sensor.polarization),
        "tones": sensor.tones.model_dump(),
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
        "soil": [soil._asdict() for soil in soils],
        "surface": surface,
        "omissions": decks.omissions,
        "runs": runs,
    }
    steps = window / grid.time_step
    memory = cells * _BYTES_PER_CELL / 2**30
    decks.summary = [
        f"{len(runs)} runs and {len({run['free'] for run in runs})} of air alone",
        f"{shape} cells of {1000 * cell:g} mm: {memory:.2g} GiB",
        f"{steps:.0f} time steps, {cells * window / grid.time_step:.2g} cell updates per run",
    ]
    for number, soil in enumerate(soils, start=1):
        decks.summary.append(
            f"soil {number}: {len(soil.poles)} Debye poles, off by at most "
            f"{100 * soil.error_real:.2g} % in ε' and {100 * soil.error_loss:.2g} % in ε''"
        )
    return decks


def _round_down(cell: float) -> float:
    """Return a length, m, rounded down to two digits, so that files and grids are readable."""
    unit = 10.0 ** (math.floor(math.log10(cell)) - 1)
    return round(math.floor(cell / unit + 1e-9) * unit, 9)


def _grid(scene: Scene, world: World, antennas: FloatArray, cell: float) -> CellGrid:
    """Return the grid around lane, antennas, targets and objects, with room at its edges."""
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
    for scene_object in world.objects:
        if scene.lane.contains(scene_object.x, scene_object.y):
            rock_top = scene_object.radius if scene_object.kind == "rock" else 0.0
            high[2] = max(high[2], scene_object.height, rock_top)
    low[2] = min(low[2], -sum(layer.thickness for layer in scene.soil.layers))
    # The first antenna across and along, and the ground in height, lie on nodes.
    anchor = np.array([*antennas[0, 0, :2], 0.0])
    first = anchor - np.ceil((anchor - low + room) / cell) * cell
    return _make_grid(first, cell, np.ceil((high + room - first) / cell))


def _make_grid(first: FloatArray, cell: float, shape: AnyArray) -> CellGrid:
    """Return a grid whose first node lies at a place, m."""
    x, y, z = map(float, first)
    i, j, k = map(int, shape)
    return CellGrid((x, y, z), cell, (i, j, k), _ABSORBER)


def _time_window(grid: CellGrid, antennas: FloatArray, index: float, centre: float) -> float:
    """Return the time in which the echo of the farthest corner and the pulse end, s."""
    corners = np.array(grid.origin)[:2] + np.array([(0, 0), (0, 1), (1, 0), (1, 1)]) * grid.size[:2]
    across = np.linalg.norm(antennas[..., None, :2] - corners, axis=-1).max()
    high = antennas[..., 2].max()
    deep = -grid.origin[2]
    path = 2 * math.hypot(across, high) + 2 * index * deep
    return float(1.1 * path / SPEED_OF_LIGHT + 4 / centre)


def _left_out(scene: Scene, world: World, sensor: Sensor) -> list[str]:
    """Return what of scene and sensor no file holds, in words."""
    surface = scene.surface
    buried = buried_clutter(scene) + (["refilled holes"] if world.holes else [])
    omissions = {
        "the horns' pattern and gain: ideal short dipoles stand in for them": (
            sensor.antenna.kind == "horn"
        ),
        "the sensor's errors: leakage, self-signature, drift, noise, interference, lost sweeps, "
        "pose errors": True,
        "what the surface has beside its heights (slope, texture, cross_db, correlation, "
        "level_db): the ground scatters as its heights do": surface.echo,
        f"{len(world.patches)} wet patches": world.patches,
        "the terrain (slope, undulation, ruts): the ground is level but for its roughness": (
            not scene.terrain.flat
        ),
        "the grass": scene.grass.grown,
        f"what lies under the surface: {', '.join(buried)}": buried,
    }
    return [words for words, is_there in omissions.items() if is_there]


def _runs(
    decks: Decks,
    scene: Scene,
    sensor: Sensor,
    poses: FloatArray,
    antennas: FloatArray,
    grid: CellGrid,
    centre: float,
    window: float,
) -> list[Entries]:
    """Write the input file of every scan, transmitter and polarization, and return their list.

    Those of air alone that they need are written too, equal ones once.
    """
    runs: list[Entries] = []
    air_files: dict[str, str] = {}
    first, second = sensor.pair_indices()
    upright = np.array([0.0, math.sin(sensor.tilt), math.cos(sensor.tilt)])
    transmitted = sorted({name[0] for name in sensor.polarization})
    for scan, pose in enumerate(poses):
        turn = pose_matrix(pose)
        directions = {"H": turn[:, 0], "V": turn @ upright}
        places = antennas[scan]
        air, offset = _air_grid(grid, places)
        widest = np.linalg.norm(places[:, None] - places, axis=-1).max()
        air_window = float(1.1 * widest / SPEED_OF_LIGHT + 4 / centre)
        for tx in sorted(set(first.tolist())):
            pairs = np.flatnonzero(first == tx)
            receivers = [
                _receiver(number, places[len(sensor.tx) + second[pair]], directions, grid)
                for number, pair in enumerate(pairs)
            ]
            for label in transmitted:
                source = grid.spread(places[tx], directions[label])
                name = f"scan{scan:03d}-tx{tx:02d}-{label}"
                title = f"{scene.name}, {name}"
                decks.files[f"{name}.in"] = _deck(title, grid, source, receivers, centre, window)
                text = _deck("air alone", air, source, receivers, centre, air_window, offset)
                air_file = air_files.setdefault(text, f"air-{name}")
                decks.files[f"{air_file}.in"] = text
                run = {
                    "file": name,
                    "free": air_file,
                    "scan": scan,
                    "transmit": label,
                    "pairs": pairs.tolist(),
                    "source": [[point.component, point.weight] for point in source],
                    "receivers": [
                        {
                            label: [[name, one.component, one.weight] for name, one in points]
                            for label, points in receiver.items()
                        }
                        for receiver in receivers
                    ],
                }
                runs.append(run)
    return runs


Receiver = dict[str, list[tuple[str, GridPoint]]]
"""Field components of a receiver by polarization, each with its name in the files."""


def _receiver(
    number: int, position: FloatArray, directions: dict[str, FloatArray], grid: CellGrid
) -> Receiver:
    """Return the field components of a receiver; those in common have one name."""
    names: dict[tuple[str, tuple[int, int, int]], str] = {}
    receiver: Receiver = {}
    for label, direction in directions.items():
        receiver[label] = []
        for point in grid.spread(position, direction):
            name = f"r{number}n{len(names)}"
            name = names.setdefault((point.component, point.node), name)
            receiver[label].append((name, point))
    return receiver


def _air_grid(grid: CellGrid, places: FloatArray) -> tuple[CellGrid, AnyArray]:
    """Return the box around the antennas out of the grid, and the node (3,) where it begins."""
    room = _ABSORBER + _MARGIN
    low = np.floor(grid.local(places).min(axis=0) / grid.cell).astype(int) - room
    high = np.ceil(grid.local(places).max(axis=0) / grid.cell).astype(int) + room
    return _make_grid(grid.origin + low * grid.cell, grid.cell, high - low), low


def _deck(
    title: str,
    grid: CellGrid,
    source: list[GridPoint],
    receivers: list[Receiver],
    centre: float,
    window: float,
    air: AnyArray | None = None,
) -> str:
    """Return the text of one input file: with the scene, or of air alone from a node (3,) on."""
    cell = grid.cell
    first = np.zeros(3, int) if air is None else air
    lines = [
        f"#title: {title}",
        f"#domain: {numbers(*grid.size)}",
        f"#dx_dy_dz: {numbers(cell, cell, cell)}",
        f"#time_window: {numbers(window)}",
        f"#pml_cells: {grid.absorber}",
    ]
    if air is None:
        lines.append(f"#include_file: {SCENE_FILE}")
    for number, point in enumerate(source, start=1):
        pulse = f"pulse{number}"
        node = numbers(*(point.node - first) * cell)
        lines.append(f"#waveform: gaussiandotnorm {point.weight:.12g} {numbers(centre)} {pulse}")
        lines.append(f"#hertzian_dipole: {point.component} {node} {pulse}")
    for receiver in receivers:
        for name, point in dict(itertools.chain(*receiver.values())).items():
            node = numbers(*(point.node - first) * cell)
            lines.append(f"#rx: {node} {name} E{point.component}")
    return "\n".join(lines) + "\n"
