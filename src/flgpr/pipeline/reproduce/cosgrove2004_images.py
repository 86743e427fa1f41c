"""Simulated lanes of the study and the images of their mines."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from flgpr.clutter import scan_gain, self_signature
from flgpr.imaging import ScanImager
from flgpr.kernels.windows import ramp
from flgpr.model import Sensor, Tones, lane_to_scan, load_sensor, make_run
from flgpr.pipeline.reproduce.cosgrove2004_recipe import Site, StudyRecipe
from flgpr.scoring import refraction_shift
from flgpr.simulate import Scene, Simulator, draw_world
from flgpr.simulate.simulator import system_response

FloatArray = NDArray[np.float64]
BAND = "band"


@dataclass(frozen=True)
class Look:
    """One mine seen from one stop.

    Attributes
    ----------
    image : xarray.DataArray
        Image (polarization, y, x) in the scan frame, self-signature removed.
    place : (2,) ndarray
        Surveyed x and y of the mine in the scan frame, m.
    depth : float
        Depth of its top, m.
    trains : bool
        Whether the mine belongs to the training set.
    shift : float
        How far behind its place the mine appears for the refraction at its depth, m.
    rocks : (rock, 2) ndarray
        Places of rocks in the scan frame, m.
    """

    image: xr.DataArray
    place: FloatArray
    depth: float
    trains: bool
    shift: float
    rocks: FloatArray


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


def lane_looks(recipe: StudyRecipe, name: str, seed: int, share: float = 1.0, clean: bool = False) -> list[Look]:
    """Simulate a lane from both directions and image every mine at the study's range.

    From the other direction the same mines, rocks and bushes stand there, turned by half a turn; the rough surface is
    drawn anew. The paper counts both images of a mine as distinct for the randomness of that surface.

    Parameters
    ----------
    recipe : StudyRecipe
        The study.
    name : str
        Site.
    seed : int
        Seed of the lane.
    share : float
        Share of the mines that are laid.
    clean : bool
        Leave out surface, other objects and all errors of the radar: signatures alone.

    Returns
    -------
    list of Look
        Two looks per mine.
    """
    site = recipe.sites[name]
    # Every site and kind has lanes of its own; 2 directions per seed.
    base = 1000 * seed + 10 * sorted(recipe.sites).index(name)
    there, trains, depths = _scene(recipe, site, base, share, clean)
    back = _turned(there, base)
    looks = []
    for direction, scene in enumerate((there, back)):
        order = slice(None) if direction == 0 else slice(None, None, -1)
        looks += _looks(recipe, scene, base + direction, depths[order], trains[order], clean)
    return looks


def _scene(
    recipe: StudyRecipe, site: Site, seed: int, share: float, clean: bool
) -> tuple[Scene, NDArray[np.bool_], FloatArray]:
    depths, trains = site.depths(share)
    rng = np.random.default_rng([seed, 2004])
    order = rng.permutation(depths.size)
    depths, trains = depths[order], trains[order]
    spacing, ahead = recipe.radar.stop_spacing, recipe.radar.range
    slots = spacing * (np.arange(depths.size) + 0.5)
    lean = rng.normal(0, np.radians(4), (depths.size, 2))
    targets = [
        {
            "kind": site.kind,
            "x": float(rng.uniform(-1, 1)),
            "y": float(slot + np.clip(rng.normal(0, 0.3), -0.6, 0.6)),
            "depth": float(max(depth + rng.normal(0, 0.005), 0.0)),
            "tilt": float(np.hypot(*tilt)),
            "azimuth": float(np.arctan2(tilt[1], tilt[0])),
        }
        for slot, depth, tilt in zip(slots, depths, lean, strict=True)
    ]
    surface = {"density": recipe.radar.scatterers, "echo": not clean}
    scene = Scene.model_validate(
        {
            "name": site.title,
            "site": site.scene,
            "x_min": -2.0,
            "x_max": 2.0,
            "length": spacing * depths.size,
            "targets": targets,
            "surface": surface,
            "track": {"positions": [float(slot - ahead) for slot in slots]},
            **({"clutter": {"rocks": 0.0, "bushes": 0.0, "posts": 0.0, "patches": 0.0}} if clean else {}),
        }
    )
    return scene, trains, depths


def _turned(scene: Scene, seed: int) -> Scene:
    """Turn the lane by half a turn with all that the seed put there."""
    world = draw_world(scene, seed)
    length = scene.length

    def turn(thing: object) -> dict[str, object]:
        fields = dict(thing.model_dump())  # type: ignore[attr-defined]
        fields["x"], fields["y"] = -fields["x"], length - fields["y"]
        if "azimuth" in fields:
            fields["azimuth"] += np.pi
        return fields

    none = {"rocks": 0.0, "bushes": 0.0, "posts": 0.0, "patches": 0.0}
    data = scene.model_dump(exclude_unset=True)
    data |= {
        "targets": [turn(t) for t in reversed(world.targets)],
        "objects": [turn(o) for o in world.objects],
        "patches": [turn(p) for p in world.patches],
        "clutter": none,
    }
    return Scene.model_validate(data)


def _looks(
    recipe: StudyRecipe, scene: Scene, seed: int, depths: FloatArray, trains: NDArray[np.bool_], clean: bool
) -> list[Look]:
    sensor = study_sensor(recipe)
    simulator = Simulator(scene, sensor, seed, errors=not clean)
    signal = np.stack([simulator.scan(index) for index in range(len(simulator))])
    tx, rx = sensor.pairs()
    run = make_run(
        signal, simulator.frequency, list(sensor.polarization), tx, rx, simulator.reported_pose(), simulator.time
    )
    images = run_images(recipe, run, sensor, "none" if clean else recipe.image.self_signature)
    rocks = np.array([(o.x, o.y, 0.0) for o in simulator.world.objects if o.kind == "rock"]).reshape(-1, 3)
    middle = float(np.mean(recipe.image.band))
    permittivity = float(scene.soil.media(np.array([middle]))[-1][0].real)
    looks = []
    for image, target, depth, trained in zip(images, scene.targets, depths, trains, strict=True):
        pose = np.asarray(image.attrs["pose"])
        place = lane_to_scan(np.array([target.x, target.y, 0.0]), pose)[:2]
        shift = float(refraction_shift(depth, permittivity, pose[2], recipe.radar.range))
        looks.append(Look(image, place, float(depth), bool(trained), shift, lane_to_scan(rocks, pose)[:, :2]))
    return looks


def run_images(recipe: StudyRecipe, run: xr.Dataset, sensor: Sensor, signature: str) -> list[xr.DataArray]:
    """Image every scan of a run and remove the self-signature.

    Parameters
    ----------
    recipe : StudyRecipe
        The study.
    run : xarray.Dataset
        The run.
    sensor : Sensor
        Its sensor.
    signature : {"none", "mean", "median"}
        How the self-signature is estimated; "none" leaves the images as they are.

    Returns
    -------
    list of xarray.DataArray
        Images (polarization, y, x).
    """
    imager = ScanImager(run, recipe.image.grid(), {BAND: recipe.image.band}, window=tone_weight(recipe, sensor))
    images = [image.isel(subband=0, drop=True) for image in imager]
    if signature == "none":
        return images
    pattern = self_signature([image.values for image in images], "median" if signature == "median" else "mean")
    return [
        image.copy(data=(image.values / scan_gain(image.values) - pattern).astype(np.complex64)) for image in images
    ]
