"""Simulated lanes of the study and the images of their mines."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike, NDArray

from flgpr.clutter import scan_gain, self_signature
from flgpr.design.point_spread import half_power
from flgpr.imaging import ImagingOperator, ScanImager
from flgpr.kernels.windows import ramp
from flgpr.model import (
    SPEED_OF_LIGHT,
    Grid,
    Sensor,
    Tones,
    check_tones,
    lane_to_scan,
    load_sensor,
    make_run,
)
from flgpr.scoring import refraction_shift
from flgpr.simulate import ALONE, BARE, Scene, Simulator
from flgpr.simulate.scene.scene import Target
from flgpr.simulate.simulator import system_response
from flgpr_papers.cosgrove2004.recipe import Site, StudyRecipe
from flgpr_papers.kit.worlds import changed, turned

FloatArray = NDArray[np.float64]
BAND = "band"
SURROUNDINGS = ("roadside", "open")
WIDE_MINES = ((-0.6, 15.0), (0.5, 20.0), (0.0, 25.0))
"""Places (x, y), m, of the mines of the paper's Fig. 2, at its ranges."""
_SIGNATURES = 999_000
_SIGNATURE_SHARE = 0.2


@dataclass(frozen=True)
class Look:
    """One mine seen from one stop."""

    image: xr.DataArray  #: image (polarization, y, x) in the scan frame, self-signature removed
    place: FloatArray  #: (2,) surveyed x and y of the mine in the scan frame, m
    depth: float  #: depth of its top, m
    trains: bool  #: whether the mine belongs to the training set
    shift: float  #: how far behind its place the mine appears for the refraction at its depth, m
    rocks: FloatArray  #: (rock, 2) places of rocks in the scan frame, m


def study_sensor(recipe: StudyRecipe) -> Sensor:
    """Make the radar of the study: the preset on the study's tones, over the ground that is imaged.

    Tones that let echoes from before the image appear in it are a ValueError.
    """
    preset = load_sensor(recipe.radar.sensor)
    low, high = recipe.image.band
    count = round((high - low) / recipe.radar.tone_step) + 1
    margin = recipe.radar.margin
    x0, x1 = recipe.image.x
    y0, y1 = recipe.image.y
    sensor = preset.model_copy(
        update={
            "tones": Tones(start=low, step=recipe.radar.tone_step, count=count),
            "footprint": (x0 - margin, x1 + margin, y0 - margin, y1 + margin),
            "polarization": recipe.cut.polarizations,
        }
    )
    check_tones(sensor, recipe.image.x, recipe.image.y)
    return sensor


def tone_weight(recipe: StudyRecipe, sensor: Sensor) -> FloatArray:
    """Weight of every tone.

    The ramp of filtered backprojection on data freed from the antennas' gain.
    """
    frequency = sensor.tones.axis()
    weight = ramp(frequency) if recipe.image.filter == "ramp" else np.ones(frequency.size)
    if recipe.image.calibrate:
        weight = weight / system_response(sensor, frequency)
    return np.asarray(weight / weight.max())


def lane_looks(
    recipe: StudyRecipe, name: str, seed: int, share: float = 1.0
) -> dict[str, list[Look]]:
    """Simulate a lane from both directions and image every mine at the study's range.

    From the other direction the same mines, rocks and bushes stand there, turned by half a turn;
    the rough surface is drawn anew. The paper counts both images of a mine as distinct for the
    randomness of that surface.

    Two looks per mine in each world: "roadside" with the bushes and posts that the site's catalogue
    has beside the lane, "open" the same lane without them.
    """
    scene, trains, depths = _scene(recipe, recipe.sites[name], _seed(recipe, name, seed), share)
    looks: dict[str, list[Look]] = {world: [] for world in SURROUNDINGS}
    for direction in (0, 1):
        order = slice(None, None, 1 - 2 * direction)
        number = _seed(recipe, name, seed) + direction
        for world, looks_of_world in _direction(recipe, scene, number, direction == 1).items():
            looks[world] += [
                Look(image, position, float(depth), bool(trained), shift, rocks)
                for (image, position, shift, rocks), depth, trained in zip(
                    looks_of_world, depths[order], trains[order], strict=True
                )
            ]
    return looks


@dataclass(frozen=True)
class LaneChange:
    """What is otherwise on a lane than in the study, to see what it does."""

    #: entries of the scene's parts that are replaced, ``{"surface": {"correlation": 0.0}}``
    parts: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    mine: Mapping[str, Any] = field(
        default_factory=dict
    )  #: entries of every mine that are replaced
    #: False takes the mines out, with the holes over them; looks are taken where they lay
    mines: bool = True


def open_looks(
    recipe: StudyRecipe, name: str, seed: int, share: float, change: LaneChange
) -> list[Look]:
    """Image the mines of an open lane with something changed on the lane.

    Otherwise it is as :func:`lane_looks` does.
    """
    number = _seed(recipe, name, seed)
    scene, trains, depths = _scene(recipe, recipe.sites[name], number, share)
    mines = [target.model_dump(exclude_unset=True) | dict(change.mine) for target in scene.targets]
    no_roadside = {"bushes": 0.0, "posts": 0.0}
    tables = {table: dict(entries) for table, entries in change.parts.items()}
    tables["clutter"] = no_roadside | tables.get("clutter", {})
    ground = changed(scene, targets=mines, **tables)
    looks = []
    for direction in (0, 1):
        order = slice(None, None, 1 - 2 * direction)
        placed = _from_other_end(ground, number) if direction else ground
        simulated = placed
        if not change.mines:
            bare = changed(ground, targets=[])
            simulated = _from_other_end(bare, number) if direction else bare
        simulator = Simulator(simulated, study_sensor(recipe), number + direction)
        images = _images(
            recipe, simulator, simulator.scans(), recipe.image.self_signature, placed.targets
        )
        looks += [
            Look(image, position, float(depth), bool(trained), shift, rocks)
            for (image, position, shift, rocks), depth, trained in zip(
                images, depths[order], trains[order], strict=True
            )
        ]
    return looks


def reflector_looks(recipe: StudyRecipe, name: str) -> list[Look]:
    """Image corner reflectors in place of a site's mines.

    There are no surface, other objects and errors of the radar.

    A corner reflector returns the same in HH and in VV.
    """
    scene, trains, depths = _scene(recipe, recipe.sites[name], _SIGNATURES, _SIGNATURE_SHARE)
    reflectors = [
        {"kind": "fiducial", "x": target.x, "y": target.y, "rcs_db": 0.0}
        for target in scene.targets
    ]
    bare = changed(scene, targets=[], clutter=BARE, **ALONE).model_dump(exclude_unset=True)
    placed = Scene.model_validate(bare | {"objects": reflectors})
    simulator = Simulator(placed, study_sensor(recipe), _SIGNATURES, errors=False)
    images = _images(recipe, simulator, simulator.scans(), "none", scene.targets)
    return [
        Look(image, position, float(depth), bool(trained), shift, rocks)
        for (image, position, shift, rocks), depth, trained in zip(
            images, depths, trains, strict=True
        )
    ]


def signature_looks(recipe: StudyRecipe, name: str) -> list[Look]:
    """Image mines of every depth of a site, in no lane.

    There are no surface, other objects and errors of the radar.
    """
    scene, trains, depths = _scene(recipe, recipe.sites[name], _SIGNATURES, _SIGNATURE_SHARE)
    bare = changed(scene, clutter=BARE, **ALONE)
    simulator = Simulator(bare, study_sensor(recipe), _SIGNATURES, errors=False)
    images = _images(recipe, simulator, simulator.scans(), "none")
    return [
        Look(image, position, float(depth), bool(trained), shift, rocks)
        for (image, position, shift, rocks), depth, trained in zip(
            images, depths, trains, strict=True
        )
    ]


def _seed(recipe: StudyRecipe, name: str, seed: int) -> int:
    """Return the seed of a site's lane, which is another for every site."""
    return 1000 * seed + 10 * sorted(recipe.sites).index(name)


def _scene(
    recipe: StudyRecipe, site: Site, seed: int, share: float
) -> tuple[Scene, NDArray[np.bool_], FloatArray]:
    """Lay mines of all depths in random order, one before each stop."""
    depths, trains = site.depths(share)
    rng = np.random.default_rng([seed, 2004])
    order = rng.permutation(depths.size)
    depths = depths[order]
    trains = trains[order]
    spacing = recipe.radar.stop_spacing
    slots = spacing * (np.arange(depths.size) + 0.5)
    targets = []
    for slot, depth in zip(slots, depths, strict=True):
        lean, roll = rng.normal(0, np.radians(4), 2)
        targets.append(
            site.mine(
                x=float(rng.uniform(-1, 1)),
                y=float(slot + np.clip(rng.normal(0, 0.3), -0.6, 0.6)),
                depth=float(max(depth + rng.normal(0, 0.005), 0.0)),
                tilt=float(np.hypot(lean, roll)),
                azimuth=float(np.arctan2(roll, lean)),
            )
        )
    scene = Scene.model_validate(
        {
            "name": site.title,
            "site": site.scene,
            "x_min": -2.0,
            "x_max": 2.0,
            "length": spacing * depths.size,
            "targets": targets,
            "surface": {"density": recipe.radar.scatterers},
            "track": {"positions": [float(slot - recipe.radar.range) for slot in slots]},
        }
    )
    return scene, trains, depths


def _direction(
    recipe: StudyRecipe, scene: Scene, seed: int, back: bool
) -> dict[str, list[tuple[xr.DataArray, FloatArray, float, FloatArray]]]:
    """Return the images of every stop in both worlds.

    Echoes add, so the roadside is simulated by itself and added.
    """
    sensor = study_sensor(recipe)
    ground = changed(scene, clutter={"bushes": 0.0, "posts": 0.0})
    roadside = changed(scene, clutter={"rocks": 0.0, "patches": 0.0}, targets=[], **ALONE)
    if back:  # what the seed before put there, from the other end
        ground = _from_other_end(ground, seed - 1)
        roadside = turned(roadside, seed - 1)
    simulator = Simulator(ground, sensor, seed)
    roadside_simulator = Simulator(roadside, sensor, seed, errors=False)
    signal = np.stack(list(simulator.scans()))
    with_roadside = signal + np.stack(list(roadside_simulator.scans()))
    signature = recipe.image.self_signature
    return {
        "roadside": _images(recipe, simulator, with_roadside, signature),
        "open": _images(recipe, simulator, signal, signature),
    }


def _from_other_end(scene: Scene, seed: int) -> Scene:
    """Turn a lane with all that the seed put there by half a turn.

    Its mines are in the order of the stops.
    """
    other = turned(scene, seed)
    return other.model_copy(update={"targets": other.targets[::-1]})


def _images(
    recipe: StudyRecipe,
    simulator: Simulator,
    signal: ArrayLike | Iterable[NDArray[np.complex64]],
    signature: str,
    targets: Sequence[Target] | None = None,
) -> list[tuple[xr.DataArray, FloatArray, float, FloatArray]]:
    """Yield the image of every stop with its mine, in the scan frame.

    Mine, shift by refraction and rocks are positions.

    ``targets`` are the mines, one a stop, where the simulated lane has none.
    """
    data = signal if isinstance(signal, np.ndarray) else np.stack(list(signal))  # type: ignore[arg-type]
    tx, rx = simulator.sensor.pairs()
    pose = simulator.reported_pose()
    polarizations = list(simulator.sensor.polarization)
    run = make_run(data, simulator.frequency, polarizations, tx, rx, pose, simulator.time)
    images = run_images(recipe, run, simulator.sensor, signature)
    rocks = np.array(
        [(o.x, o.y, 0.0) for o in simulator.world.objects if o.kind == "rock"]
    ).reshape(-1, 3)
    middle = np.array([np.mean(recipe.image.band)])
    permittivity = float(simulator.scene.soil.media(middle)[-1][0].real)
    target_images = []
    places = simulator.scene.targets if targets is None else targets
    for image, target in zip(images, places, strict=True):
        taken = np.asarray(image.attrs["pose"])
        position = lane_to_scan(np.array([target.x, target.y, 0.0]), taken)[:2]
        shift = float(refraction_shift(target.depth, permittivity, taken[2], recipe.radar.range))
        target_images.append((image, position, shift, lane_to_scan(rocks, taken)[:, :2]))
    return target_images


def run_images(
    recipe: StudyRecipe, run: xr.Dataset, sensor: Sensor, signature: str
) -> list[xr.DataArray]:
    """Image every scan of a run and remove the self-signature."""
    imager = ScanImager(
        run, recipe.image.grid(), {BAND: recipe.image.band}, window=tone_weight(recipe, sensor)
    )
    images = [image.isel(subband=0, drop=True) for image in imager]
    if signature == "none":
        return images
    pattern = self_signature(
        [image.values for image in images], "median" if signature == "median" else "mean"
    )
    return [
        image.copy(data=(image.values / scan_gain(image.values) - pattern).astype(np.complex64))
        for image in images
    ]


@dataclass(frozen=True)
class PointResponse:
    """Image of a point on the ground at the study's range."""

    #: down, cross: (n,) distance from the point down-track and cross-track, m
    down: FloatArray
    cross: FloatArray
    #: down_level, cross_level: (n,) magnitude along them over the peak
    down_level: FloatArray
    cross_level: FloatArray

    @property
    def resolution(self) -> tuple[float, float]:
        """Width between the half-power points down-track and cross-track, m."""
        return half_power(self.down, self.down_level), half_power(self.cross, self.cross_level)


def point_response(recipe: StudyRecipe, filtered: bool) -> PointResponse:
    """Image an ideal point: flat spectrum, no pattern, no spreading."""
    sensor = study_sensor(recipe)
    frequency = sensor.tones.axis()
    tx, rx = (p + [0.0, 0.0, sensor.height] for p in sensor.pairs())
    point = np.array([0.0, recipe.radar.range, 0.0])
    path = np.linalg.norm(tx - point, axis=1) + np.linalg.norm(rx - point, axis=1)
    data = np.exp(-2j * np.pi * np.outer(path, frequency) / SPEED_OF_LIGHT)[None]
    offset = np.linspace(-1, 1, 801)
    lines = np.zeros((2, offset.size, 3)) + point
    lines[0, :, 1] += offset
    lines[1, :, 0] += offset
    window = ramp(frequency) if filtered else None
    image = np.abs(
        ImagingOperator(frequency, tx, rx, lines, window=window).adjoint(data)[0, 0]
    ).astype(np.float64)
    return PointResponse(offset, offset, image[0] / image[0].max(), image[1] / image[1].max())


def signature_cuts(recipe: StudyRecipe) -> tuple[FloatArray, NDArray[np.complex64]]:
    """Range cut through a mine in dry sand without clutter and errors, as the paper's Fig. 3.

    Metres, and images.
    """
    ahead = recipe.radar.range
    scene = Scene.model_validate(
        {
            "site": recipe.sites["sand"].scene,
            "length": 2 * ahead,
            "targets": [recipe.sites["sand"].mine(x=0.0, y=ahead, depth=0.1)],
            "clutter": BARE,
            "track": {"positions": [0.0]},
            **ALONE,
            "surface": {"echo": False, "phase_screen": False},
        }
    )
    sensor = study_sensor(recipe)
    grid = Grid(0.0, ahead - 1.0, 1, 101, 0.05, 0.02)
    image = _image(recipe, sensor, scene, 1, grid, errors=False)
    return image["y"].values - ahead, image.values[:, :, 0]


def wide_image(recipe: StudyRecipe, seed: int) -> xr.DataArray:
    """Return the image (polarization, y, x) of mines 15, 20 and 25 m ahead in dry sand.

    It is the paper's Fig. 2.
    """
    scene = Scene.model_validate(
        {
            "site": recipe.sites["sand"].scene,
            "x_min": -2.0,
            "x_max": 2.0,
            "length": 40.0,
            "targets": [recipe.sites["sand"].mine(x=x, y=y, depth=0.05) for x, y in WIDE_MINES],
            "surface": {"density": recipe.radar.scatterers},
            "clutter": {"bushes": 0.0, "posts": 0.0},
            "track": {"positions": [0.0]},
        }
    )
    sensor = study_sensor(recipe).model_copy(update={"footprint": (-4.5, 4.5, 10.0, 29.0)})
    return _image(recipe, sensor, scene, seed, Grid(-4.0, 11.0, 161, 851, 0.05, 0.02), errors=True)


def _image(
    recipe: StudyRecipe, sensor: Sensor, scene: Scene, seed: int, grid: Grid, errors: bool
) -> xr.DataArray:
    """Image a scene without the radar's self-signature."""
    quiet = sensor.errors.model_copy(update={"self_signature_db": None})
    simulator = Simulator(scene, sensor.model_copy(update={"errors": quiet}), seed, errors)
    check_tones(sensor, (grid.x[0], grid.x[-1]), (grid.y[0], grid.y[-1]))
    tx, rx = sensor.pairs()
    signal = simulator.scan(0)[None]
    run = make_run(
        signal, simulator.frequency, list(sensor.polarization), tx, rx, simulator.reported_pose()
    )
    imager = ScanImager(run, grid, {BAND: recipe.image.band}, window=tone_weight(recipe, sensor))
    return imager.image(0).isel(subband=0, drop=True)
