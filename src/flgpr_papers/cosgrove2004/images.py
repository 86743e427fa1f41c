"""Simulated lanes of the study and the images of their mines."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike, NDArray

from flgpr.clutter import scan_gain, self_signature
from flgpr.imaging import ScanImager
from flgpr.kernels.windows import ramp
from flgpr.model import Sensor, Tones, lane_to_scan, load_sensor, make_run
from flgpr.scoring import refraction_shift
from flgpr.simulate import ALONE, BARE, Scene, Simulator
from flgpr.simulate.simulator import system_response
from flgpr_papers.cosgrove2004.recipe import Site, StudyRecipe
from flgpr_papers.kit.lanes import changed, turned

FloatArray = NDArray[np.float64]
BAND = "band"
WORLDS = ("roadside", "open")
_SIGNATURES, _SIGNATURE_SHARE = 999_000, 0.2


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
    """Make the radar of the study: the preset on the study's tones, over the ground that is imaged."""
    preset = load_sensor(recipe.radar.sensor)
    low, high = recipe.image.band
    count = round((high - low) / recipe.radar.tone_step) + 1
    margin, (x0, x1), (y0, y1) = recipe.radar.margin, recipe.image.x, recipe.image.y
    return preset.model_copy(
        update={
            "tones": Tones(start=low, step=recipe.radar.tone_step, count=count),
            "footprint": (x0 - margin, x1 + margin, y0 - margin, y1 + margin),
            "polarization": recipe.cut.polarizations,
        }
    )


def tone_weight(recipe: StudyRecipe, sensor: Sensor) -> FloatArray:
    """Weight of every tone: the ramp of filtered backprojection on data freed from the antennas' gain."""
    frequency = sensor.tones.axis()
    weight = ramp(frequency) if recipe.image.filter == "ramp" else np.ones(frequency.size)
    if recipe.image.calibrate:
        weight = weight / system_response(sensor, frequency)
    return np.asarray(weight / weight.max())


def lane_looks(recipe: StudyRecipe, name: str, seed: int, share: float = 1.0) -> dict[str, list[Look]]:
    """Simulate a lane from both directions and image every mine at the study's range.

    From the other direction the same mines, rocks and bushes stand there, turned by half a turn; the rough surface is
    drawn anew. The paper counts both images of a mine as distinct for the randomness of that surface.

    Two looks per mine in each world: "roadside" with the bushes and posts that the site's catalogue has beside the
    lane, "open" the same lane without them.
    """
    scene, trains, depths = _scene(recipe, recipe.sites[name], _seed(recipe, name, seed), share)
    looks: dict[str, list[Look]] = {world: [] for world in WORLDS}
    for direction in (0, 1):
        order = slice(None, None, 1 - 2 * direction)
        number = _seed(recipe, name, seed) + direction
        for world, found in _direction(recipe, scene, number, direction == 1).items():
            looks[world] += [
                Look(image, place, float(depth), bool(trained), shift, rocks)
                for (image, place, shift, rocks), depth, trained in zip(
                    found, depths[order], trains[order], strict=True
                )
            ]
    return looks


def signature_looks(recipe: StudyRecipe, name: str) -> list[Look]:
    """Image mines of every depth of a site without surface, other objects and errors of the radar.

    One look per mine; these mines lie in no lane of the study.
    """
    scene, trains, depths = _scene(recipe, recipe.sites[name], _SIGNATURES, _SIGNATURE_SHARE)
    bare = changed(scene, clutter=BARE, **ALONE)
    simulator = Simulator(bare, study_sensor(recipe), _SIGNATURES, errors=False)
    found = _images(recipe, simulator, simulator.scans(), "none")
    return [
        Look(image, place, float(depth), bool(trained), shift, rocks)
        for (image, place, shift, rocks), depth, trained in zip(found, depths, trains, strict=True)
    ]


def _seed(recipe: StudyRecipe, name: str, seed: int) -> int:
    return 1000 * seed + 10 * sorted(recipe.sites).index(name)


def _scene(recipe: StudyRecipe, site: Site, seed: int, share: float) -> tuple[Scene, NDArray[np.bool_], FloatArray]:
    """Lay mines of all depths in random order, one before each stop."""
    depths, trains = site.depths(share)
    rng = np.random.default_rng([seed, 2004])
    order = rng.permutation(depths.size)
    depths, trains = depths[order], trains[order]
    spacing = recipe.radar.stop_spacing
    slots = spacing * (np.arange(depths.size) + 0.5)
    targets = []
    for slot, depth in zip(slots, depths, strict=True):
        lean, roll = rng.normal(0, np.radians(4), 2)
        targets.append(
            {
                "kind": site.kind,
                "x": float(rng.uniform(-1, 1)),
                "y": float(slot + np.clip(rng.normal(0, 0.3), -0.6, 0.6)),
                "depth": float(max(depth + rng.normal(0, 0.005), 0.0)),
                "tilt": float(np.hypot(lean, roll)),
                "azimuth": float(np.arctan2(roll, lean)),
            }
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
    """Images of every stop in both worlds. Echoes add, so the roadside is simulated by itself and added."""
    sensor = study_sensor(recipe)
    ground = changed(scene, clutter={"bushes": 0.0, "posts": 0.0})
    roadside = changed(scene, clutter={"rocks": 0.0, "patches": 0.0}, targets=[], **ALONE)
    if back:  # what the seed before put there, from the other end
        ground, roadside = turned(ground, seed - 1), turned(roadside, seed - 1)
        ground = ground.model_copy(update={"targets": ground.targets[::-1]})  # in the order of the stops
    simulator = Simulator(ground, sensor, seed)
    beside = Simulator(roadside, sensor, seed, errors=False)
    signal = np.stack(list(simulator.scans()))
    with_roadside = signal + np.stack(list(beside.scans()))
    signature = recipe.image.self_signature
    return {
        "roadside": _images(recipe, simulator, with_roadside, signature),
        "open": _images(recipe, simulator, signal, signature),
    }


def _images(
    recipe: StudyRecipe, simulator: Simulator, signal: ArrayLike | Iterable[NDArray[np.complex64]], signature: str
) -> list[tuple[xr.DataArray, FloatArray, float, FloatArray]]:
    """Image of every stop with its mine's place, the shift by refraction and the rocks' places, in the scan frame."""
    data = signal if isinstance(signal, np.ndarray) else np.stack(list(signal))  # type: ignore[arg-type]
    tx, rx = simulator.sensor.pairs()
    pose, polarizations = simulator.reported_pose(), list(simulator.sensor.polarization)
    run = make_run(data, simulator.frequency, polarizations, tx, rx, pose, simulator.time)
    images = run_images(recipe, run, simulator.sensor, signature)
    rocks = np.array([(o.x, o.y, 0.0) for o in simulator.world.objects if o.kind == "rock"]).reshape(-1, 3)
    middle = np.array([np.mean(recipe.image.band)])
    permittivity = float(simulator.scene.soil.media(middle)[-1][0].real)
    found = []
    for image, target in zip(images, simulator.scene.targets, strict=True):
        taken = np.asarray(image.attrs["pose"])
        place = lane_to_scan(np.array([target.x, target.y, 0.0]), taken)[:2]
        shift = float(refraction_shift(target.depth, permittivity, taken[2], recipe.radar.range))
        found.append((image, place, shift, lane_to_scan(rocks, taken)[:, :2]))
    return found


def run_images(recipe: StudyRecipe, run: xr.Dataset, sensor: Sensor, signature: str) -> list[xr.DataArray]:
    """Image every scan of a run and remove the self-signature."""
    imager = ScanImager(run, recipe.image.grid(), {BAND: recipe.image.band}, window=tone_weight(recipe, sensor))
    images = [image.isel(subband=0, drop=True) for image in imager]
    if signature == "none":
        return images
    pattern = self_signature([image.values for image in images], "median" if signature == "median" else "mean")
    return [
        image.copy(data=(image.values / scan_gain(image.values) - pattern).astype(np.complex64)) for image in images
    ]
