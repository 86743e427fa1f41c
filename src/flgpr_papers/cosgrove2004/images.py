"""Simulated lanes of the study and the images of their mines."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import xarray as xr

from flgpr.clutter import scan_gain, self_signature
from flgpr.imaging import ImagingOperator, ScanImager
from flgpr.kernels.widths import half_power
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
from flgpr.types import BoolArray, ComplexArray, Entries, FloatArray, floats
from flgpr_papers.cosgrove2004.recipe import Site, StudyRecipe
from flgpr_papers.kit.scenes import changed, turned
from flgpr_papers.kit.settings import Span

Bands = Mapping[str, Span]
"""Bands, Hz, by name."""
BAND = "band"
SURROUNDINGS = ("roadside", "open")
"""What stands beside a lane: bushes and posts, or nothing."""
WIDE_MINES = ((-0.6, 15.0), (0.5, 20.0), (0.0, 25.0))
"""Positions (x, y), m, of the mines of the paper's Fig. 2, at its ranges."""
SIGNATURES = 999_000  # seed of mines that are imaged alone
SIGNATURE_SHARE = 0.2  # of a site's mines, of every depth
NO_ROADSIDE = {"bushes": 0.0, "posts": 0.0}


@dataclass(frozen=True)
class Look:
    """One mine seen from one stop."""

    image: xr.DataArray  #: image (polarization, y, x) in the scan frame, self-signature removed
    position: FloatArray  #: (2,) surveyed x and y of the mine in the scan frame, m
    depth: float  #: depth of its top, m
    trains: bool  #: whether the mine belongs to the training set
    #: how far behind its position the mine appears for the refraction at its depth, m
    shift: float
    rocks: FloatArray  #: (rock, 2) positions of rocks in the scan frame, m


def study_sensor(recipe: StudyRecipe) -> Sensor:
    """Return the radar of the study: the preset with the study's tones and ground.

    Raises
    ------
    ValueError
        If echoes from before the image appear in it with these tones.
    """
    preset = load_sensor(recipe.radar.sensor)
    low, high = recipe.radar.tones or recipe.image.band
    count = round((high - low) / recipe.radar.tone_step) + 1
    margin = recipe.radar.margin
    x0, x1 = recipe.image.x
    y0, y1 = recipe.image.y
    changes = {
        "tones": Tones(start=low, step=recipe.radar.tone_step, count=count),
        "footprint": (x0 - margin, x1 + margin, y0 - margin, y1 + margin),
        "polarization": recipe.cut.polarizations,
    }
    sensor = preset.model_copy(update=changes)
    check_tones(sensor, recipe.image.x, recipe.image.y)
    return sensor


def tone_weight(recipe: StudyRecipe, sensor: Sensor) -> FloatArray:
    """Return the weight of every tone (frequency,), 1 at the most.

    It is the ramp of filtered backprojection, on data freed from the gain of the antennas.
    """
    frequency = sensor.tones.axis()
    weight = ramp(frequency) if recipe.image.filter == "ramp" else np.ones(frequency.size)
    if recipe.image.calibrate:
        weight = weight / system_response(sensor, frequency)
    return weight / weight.max()


def lane_looks(
    recipe: StudyRecipe,
    name: str,
    seed: int,
    share: float = 1.0,
    bands: Bands | None = None,
    parts: Mapping[str, Entries] | None = None,
) -> dict[str, list[Look]]:
    """Simulate a lane from both directions and image every mine at the study's range.

    From the other direction the same mines, rocks and bushes stand there, turned by half a turn;
    the rough surface is drawn anew. The paper counts both images of a mine as distinct for the
    randomness of that surface (footnote 5).

    Parameters
    ----------
    recipe : StudyRecipe
        The study.
    name : str
        Name of the site.
    seed : int
        Seed of the lane.
    share : float
        Share of the mines that are laid.
    bands : mapping of str to tuple of float, optional
        Bands, Hz, in which the open lane is imaged from tones that span them all.
    parts : mapping of str to dict, optional
        Entries of the scene's tables that are replaced, ``{"soil": {"loss_tangent": 0.1}}``.

    Returns
    -------
    dict
        Two looks per mine, by band, or by surroundings without bands: "roadside" with the bushes
        and posts that the site's catalogue has beside the lane, "open" the same lane without them.
    """
    if bands is not None:
        spanned = min(low for low, _ in bands.values()), max(high for _, high in bands.values())
        radar = recipe.radar.model_copy(update={"tones": spanned})
        recipe = recipe.model_copy(update={"radar": radar})
    number = lane_seed(recipe, name, seed)
    scene, trains, depths = lane_scene(recipe, recipe.sites[name], number, share)
    scene = changed(scene, targets=None, **(parts or {}))
    out = _direction(recipe, scene, number, False, list(zip(depths, trains, strict=True)), bands)
    # Driven back, the mines come in the opposite order.
    mines = list(zip(depths[::-1], trains[::-1], strict=True))
    back = _direction(recipe, scene, number + 1, True, mines, bands)
    return {view: looks + back[view] for view, looks in out.items()}


def signature_looks(recipe: StudyRecipe, name: str, share: float = SIGNATURE_SHARE) -> list[Look]:
    """Image mines of every depth of a site, without a lane around them.

    There are no surface, other objects and errors of the radar.

    Parameters
    ----------
    recipe : StudyRecipe
        The study.
    name : str
        Name of the site.
    share : float
        Share of the mines that are imaged.
    """
    scene, trains, depths = lane_scene(recipe, recipe.sites[name], SIGNATURES, share)
    bare = changed(scene, clutter=BARE, **ALONE)
    simulator = Simulator(bare, study_sensor(recipe), SIGNATURES, errors=False)
    mines = zip(depths, trains, strict=True)
    return stop_looks(recipe, simulator, simulator.scans(), "none", mines)


def lane_seed(recipe: StudyRecipe, name: str, seed: int) -> int:
    """Return the seed of a site's lane, which is another for every site."""
    return 1000 * seed + 10 * sorted(recipe.sites).index(name)


def lane_scene(
    recipe: StudyRecipe, site: Site, seed: int, share: float
) -> tuple[Scene, BoolArray, FloatArray]:
    """Lay mines of all depths in random order, one before each stop.

    Returns the scene, whether each mine trains, and its depth (m), in the order of the stops.
    """
    depths, trains = site.depths(share)
    rng = np.random.default_rng([seed, 2004])
    order = rng.permutation(depths.size)
    depths = depths[order]
    spacing = recipe.radar.stop_spacing
    slots = spacing * (np.arange(depths.size) + 0.5)
    targets = [
        _mine(site, float(slot), float(depth), rng)
        for slot, depth in zip(slots, depths, strict=True)
    ]
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
    return scene, trains[order], depths


def _mine(site: Site, slot: float, depth: float, rng: np.random.Generator) -> Entries:
    """Lay a mine near its slot, leaning a little, at about its depth."""
    lean, roll = rng.normal(0, np.radians(4), 2)
    return site.mine(
        x=float(rng.uniform(-1, 1)),
        y=float(slot + np.clip(rng.normal(0, 0.3), -0.6, 0.6)),
        depth=float(max(depth + rng.normal(0, 0.005), 0.0)),
        tilt=float(np.hypot(lean, roll)),
        azimuth=float(np.arctan2(roll, lean)),
    )


def _direction(
    recipe: StudyRecipe,
    scene: Scene,
    seed: int,
    back: bool,
    mines: Sequence[tuple[float, bool]],
    bands: Bands | None = None,
) -> dict[str, list[Look]]:
    """Return the looks of a drive by surroundings, or those of the open lane by band.

    Echoes add, so the roadside is simulated by itself and added to the open lane. ``mines`` are
    depth and use of those of the stops.
    """
    sensor = study_sensor(recipe)
    ground = changed(scene, clutter=NO_ROADSIDE)
    roadside = changed(scene, clutter={"rocks": 0.0, "patches": 0.0}, targets=[], **ALONE)
    if back:
        # The lane of the first drive, with all that its seed put there, from the other end.
        ground = from_other_end(ground, seed - 1)
        roadside = turned(roadside, seed - 1)
    simulator = Simulator(ground, sensor, seed)
    signal = np.stack(list(simulator.scans()))
    views = {}
    if bands is None:
        beside = np.stack(list(Simulator(roadside, sensor, seed, errors=False).scans()))
        views = {"roadside": (recipe, signal + beside), "open": (recipe, signal)}
    else:
        for name, band in bands.items():
            image = recipe.image.model_copy(update={"band": band})
            views[name] = recipe.model_copy(update={"image": image}), signal
    return {
        name: stop_looks(of_view, simulator, data, recipe.image.self_signature, mines)
        for name, (of_view, data) in views.items()
    }


def from_other_end(scene: Scene, seed: int) -> Scene:
    """Turn a lane with all that the seed put there by half a turn, its mines in stop order."""
    other = turned(scene, seed)
    return other.model_copy(update={"targets": other.targets[::-1]})


def stop_looks(
    recipe: StudyRecipe,
    simulator: Simulator,
    signal: Iterable[ComplexArray],
    signature: str,
    mines: Iterable[tuple[float, bool]],
    targets: Sequence[Target] | None = None,
) -> list[Look]:
    """Return the look of every stop at its mine.

    ``mines`` are depth and use of each; ``targets`` are the mines, one a stop, where the simulated
    lane has none.
    """
    data = np.stack(list(signal))
    run = _run_of(simulator, data, simulator.time)
    images = run_images(recipe, run, simulator.sensor, signature)
    rocks = [(one.x, one.y, 0.0) for one in simulator.world.objects if one.kind == "rock"]
    rock_places = np.array(rocks).reshape(-1, 3)
    middle = np.array([np.mean(recipe.image.band)])
    permittivity = float(simulator.scene.soil.media(middle)[-1][0].real)
    placed = simulator.scene.targets if targets is None else targets
    looks = []
    for image, mine, (depth, trains) in zip(images, placed, mines, strict=True):
        pose = np.asarray(image.attrs["pose"])
        position = lane_to_scan(np.array([mine.x, mine.y, 0.0]), pose)[:2]
        shift = float(refraction_shift(mine.depth, permittivity, pose[2], recipe.radar.range))
        rock_positions = lane_to_scan(rock_places, pose)[:, :2]
        look = Look(image, position, float(depth), bool(trains), shift, rock_positions)
        looks.append(look)
    return looks


def _run_of(simulator: Simulator, data: ComplexArray, *time: Any) -> xr.Dataset:
    """Return the run of a simulated lane with other data."""
    tx, rx = simulator.sensor.pairs()
    names = list(simulator.sensor.polarization)
    return make_run(data, simulator.frequency, names, tx, rx, simulator.reported_pose(), *time)


def _imager(recipe: StudyRecipe, run: xr.Dataset, sensor: Sensor, grid: Grid) -> ScanImager:
    """Return what images the scans of a run in the study's band."""
    band = {BAND: recipe.image.band}
    return ScanImager(run, grid, band, window=tone_weight(recipe, sensor))


def run_images(
    recipe: StudyRecipe, run: xr.Dataset, sensor: Sensor, signature: str
) -> list[xr.DataArray]:
    """Image every scan of a run and remove the self-signature.

    Parameters
    ----------
    recipe : StudyRecipe
        The study.
    run : Dataset
        The run.
    sensor : Sensor
        Its radar, whose gain is taken out.
    signature : str
        How the self-signature is estimated: "mean", "median", or "none" to leave the images as they
        are.

    Returns
    -------
    list of DataArray
        Images (polarization, y, x) in the scan frame, in units of the scan's gain where the
        self-signature was removed.
    """
    imager = _imager(recipe, run, sensor, recipe.image.grid())
    images = [image.isel(subband=0, drop=True) for image in imager]
    if signature == "none":
        return images
    pattern = self_signature(
        [image.values for image in images], "median" if signature == "median" else "mean"
    )
    cleaned = []
    for image in images:
        values = image.values / scan_gain(image.values) - pattern
        cleaned.append(image.copy(data=values.astype(np.complex64)))
    return cleaned


@dataclass(frozen=True)
class PointResponse:
    """Image of a point on the ground at the study's range."""

    offset: FloatArray  #: (n,) distance from the point, m
    down: FloatArray  #: (n,) magnitude down-track over the peak
    cross: FloatArray  #: (n,) magnitude cross-track over the peak

    @property
    def resolution(self) -> Span:
        """Width between the half-power points down-track and cross-track, m."""
        return half_power(self.offset, self.down), half_power(self.offset, self.cross)


def point_response(recipe: StudyRecipe, filtered: bool) -> PointResponse:
    """Image an ideal point: flat spectrum, no antenna pattern, no spreading loss.

    Parameters
    ----------
    recipe : StudyRecipe
        The study.
    filtered : bool
        Whether the tones are weighted by the ramp.
    """
    sensor = study_sensor(recipe)
    frequency = sensor.tones.axis()
    tx, rx = (positions + [0.0, 0.0, sensor.height] for positions in sensor.pairs())
    point = np.array([0.0, recipe.radar.range, 0.0])
    path = np.linalg.norm(tx - point, axis=1) + np.linalg.norm(rx - point, axis=1)
    data = np.exp(-2j * np.pi * np.outer(path, frequency) / SPEED_OF_LIGHT)[None]
    offset = np.linspace(-1, 1, 801)
    lines = np.zeros((2, offset.size, 3)) + point
    lines[0, :, 1] += offset
    lines[1, :, 0] += offset
    window = ramp(frequency) if filtered else None
    operator = ImagingOperator(frequency, tx, rx, lines, window=window)
    down, cross = floats(np.abs(operator.adjoint(data)[0, 0]))
    return PointResponse(offset, down / down.max(), cross / cross.max())


def signature_cuts(recipe: StudyRecipe) -> tuple[FloatArray, ComplexArray]:
    """Return the range cut through a mine in dry sand without clutter and errors (Fig. 3).

    Parameters
    ----------
    recipe : StudyRecipe
        The study.

    Returns
    -------
    distance : (n,) ndarray
        Distance behind the mine, m.
    cut : (polarization, n) ndarray
        The image along it.
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
    """Return the image (polarization, y, x) of mines 15, 20 and 25 m ahead in dry sand (Fig. 2).

    Parameters
    ----------
    recipe : StudyRecipe
        The study.
    seed : int
        Seed of the lane.
    """
    sand = recipe.sites["sand"]
    scene = Scene.model_validate(
        {
            "site": sand.scene,
            "x_min": -2.0,
            "x_max": 2.0,
            "length": 40.0,
            "targets": [sand.mine(x=x, y=y, depth=0.05) for x, y in WIDE_MINES],
            "surface": {"density": recipe.radar.scatterers},
            "clutter": NO_ROADSIDE,
            "track": {"positions": [0.0]},
        }
    )
    sensor = study_sensor(recipe).model_copy(update={"footprint": (-4.5, 4.5, 10.0, 29.0)})
    grid = Grid(-4.0, 11.0, 161, 851, 0.05, 0.02)
    return _image(recipe, sensor, scene, seed, grid, errors=True)


def _image(
    recipe: StudyRecipe, sensor: Sensor, scene: Scene, seed: int, grid: Grid, errors: bool
) -> xr.DataArray:
    """Image a scene without the radar's self-signature."""
    quiet = sensor.errors.model_copy(update={"self_signature_db": None})
    simulator = Simulator(scene, sensor.model_copy(update={"errors": quiet}), seed, errors)
    check_tones(sensor, (grid.x[0], grid.x[-1]), (grid.y[0], grid.y[-1]))
    run = _run_of(simulator, simulator.scan(0)[None])
    return _imager(recipe, run, sensor, grid).image(0).isel(subband=0, drop=True)
