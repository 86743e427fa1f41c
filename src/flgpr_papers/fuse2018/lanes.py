"""The settings of the study of Fuse et al. 2018, its lanes, and their frames.

Two runs with shared poses.
"""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, cast

import numpy as np
import pandas as pd
import xarray as xr
from numpy.typing import NDArray
from pydantic import Field

from flgpr.chain.engine import Arrays, Engine
from flgpr.chain.images import RunImages
from flgpr.chain.model import Model
from flgpr.chain.progress import Track
from flgpr.chain.recipe import Recipe, recipe_text
from flgpr.chain.stages.masks import MaskedSuppression
from flgpr.model import Grid, Lane, Sensor, check_tones, ground_points, lane_to_scan, load_sensor
from flgpr.simulate import EVEN, Scene, Simulator, draw_world, world_description
from flgpr.store import open_run
from flgpr_papers.kit.cache import key_of, read_arrays, store_lane, write_arrays
from flgpr_papers.kit.settings import Table, packaged
from flgpr_papers.kit.study_worlds import OWN, study_world

Positive = Annotated[float, Field(gt=0)]
NotNegative = Annotated[float, Field(ge=0)]
Span = tuple[float, float]
BANDS = ("l", "x")
ComplexArray = NDArray[np.complex64]
FloatArray = NDArray[np.float64]


class Radar(Table):
    """Errors of the navigation (m, rad) and simulated ground (m).

    Also the surface scatterers per m², in X alone and in both bands.
    """

    position: NotNegative
    heading: NotNegative
    footprint: tuple[float, float, float, float]
    scatterers_x: Positive
    scatterers: Positive | None = None


class Lanes(Table):
    """The three lanes: metres, mines per depth, objects per metre."""

    length: Positive
    half_width: Positive
    depths: tuple[float, ...]
    mines: Annotated[int, Field(ge=1)]
    site: str
    bushes: NotNegative
    posts: NotNegative
    roadside: Span
    step: Span
    start: float
    wander: NotNegative
    seeds: dict[str, int]


class Image(Table):
    """Images ahead of the latest frame (m), and frames summed.

    Also the borders of the sub-regions in range (m).
    """

    x: Span
    y: Span
    spacing: Positive
    frames: Annotated[int, Field(ge=2)]
    edges: tuple[float, ...]


class Mask(Table):
    """Radius about a calibration target (m), extent of its response (dB) and the roadside (m)."""

    halo: Positive
    response_db: Positive
    roadside: Span


class Suppress(Table):
    """Iterations, and the combination of Table II that is scored."""

    iterations: Annotated[int, Field(ge=7)]
    combination: Annotated[int, Field(ge=1, le=6)]


class Score(Table):
    """Detection area of a frame, halo's diameter and alarms' radius (m).

    Also the false alarm rates (per m²).
    """

    x: Span
    y: Span
    halo: Positive
    radius: Positive
    far_max: Positive
    far: Positive


class Boxes(Table):
    """Clutter boxes: side and distance to the image's border (m); draws of every bootstrap."""

    side: Positive
    margin: NotNegative
    draws: Annotated[int, Field(ge=100)]


class Study(Table):
    """Place of the example frame (m); steps from aperture to aperture.

    The looser navigation that is tried (m rms).
    """

    example: float
    every: Annotated[int, Field(ge=1)]
    loose_every: Annotated[int, Field(ge=1)]
    loose_position: Positive


class FuseRecipe(Table):
    """All that the study depends on."""

    name: str
    description: str
    radar: Radar
    lanes: Lanes
    image: Image
    mask: Mask
    suppress: Suppress
    score: Score
    boxes: Boxes
    study: Study

    @property
    def lane(self) -> Lane:
        """The rectangle that is scored as a lane: as wide as the detection area."""
        return Lane(*self.score.x, 0.0, self.lanes.length)

    @property
    def area(self) -> Lane:
        """The detection area of a frame, in its scan frame."""
        return Lane(*self.score.x, *self.score.y)

    @property
    def map_grid(self) -> Grid:
        """Pixels of a lane's map, in the lane frame.

        More than is scored, so that peaks at the border are whole.
        """
        return Grid.spanning(self.image.x, (0.0, self.lanes.length + 2.0), self.image.spacing)

    def chain(self) -> Recipe:
        """Load the recipe that detection is run with, and give it the study's images and masks."""
        tables = tomllib.loads(recipe_text("fuse2018"))
        image = self.image.model_dump()
        masks = {
            "edges": image.pop("edges"),
            "frames": image["frames"],
            **dict(self.mask),
            **dict(self.suppress),
        }
        tables["image"] |= image
        tables["clutter"] = [
            stage | masks if stage["stage"] == "masks" else stage for stage in tables["clutter"]
        ]
        return Recipe.model_validate(tables)


def fuse_recipe(quick: bool = False, world: str = OWN) -> FuseRecipe:
    """Load the packaged recipe of the study, on the lanes of a world."""
    site = study_world("fuse2018", world).sites["lane"]
    return packaged("fuse2018", FuseRecipe, quick, {"lanes": {"site": site}})


def band_sensor(recipe: FuseRecipe, band: str) -> Sensor:
    """Load a band's preset with the study's navigation and footprint.

    Tones that let echoes from before the images appear in them are a ValueError; the earliest frame
    of a coherent sum sees the ground from farther back.
    """
    preset = load_sensor(f"dual-band-{band}")
    errors = preset.errors.model_copy(
        update={"position": recipe.radar.position, "heading": recipe.radar.heading}
    )
    sensor = preset.model_copy(update={"errors": errors, "footprint": recipe.radar.footprint})
    near, far = recipe.image.y
    behind = (recipe.image.frames - 1) * recipe.lanes.step[1]
    check_tones(sensor, recipe.image.x, (near, far + behind))
    return sensor


def lane_scene(recipe: FuseRecipe, name: str, band: str) -> Scene:
    """Describe a lane as a band sees it.

    The bands differ in the density of surface scatterers alone.
    """
    lanes = recipe.lanes
    radar = recipe.radar
    density = radar.scatterers or (radar.scatterers_x if band == "x" else None)
    return Scene.model_validate(
        {
            "name": f"{name}-{band}",
            "site": lanes.site,
            "x_min": -lanes.half_width,
            "x_max": lanes.half_width,
            "length": lanes.length,
            "surface": {"density": density},
            "clutter": {"bushes": lanes.bushes, "posts": lanes.posts, "roadside": lanes.roadside},
            "draws": [
                {"kind": "metal", "depth": depth, "count": lanes.mines} for depth in lanes.depths
            ],
            "track": {"start": lanes.start, "step": lanes.step, "wander": lanes.wander},
        }
    )


@dataclass(frozen=True)
class Frames:
    """A lane's frames, as the stage that forms masks and suppresses has them."""

    name: str
    #: of the L band, with the X band as the second, not trained; what it needs to know of the runs
    #: is known
    stage: MaskedSuppression
    #: truth, objects: what is in and beside the lane; for calibration and scoring
    truth: pd.DataFrame
    objects: pd.DataFrame
    #: (frame, 1, pair, frequency) what the mines alone add to VV of the L band, without errors of
    #: the radar; to tell what becomes of it
    mines: ComplexArray | None = None

    def __len__(self) -> int:
        return len(self.stage.setup.imager)

    def pose(self, frame: int) -> FloatArray:
        """Return the reported pose (6,) of a frame."""
        return self.stage.setup.pose(frame)


def masks_stage(runs: Mapping[str, xr.Dataset], recipe: FuseRecipe) -> MaskedSuppression:
    """Return the suppressing stage of the detection chain of a lane's runs.

    The passes that it needs are done beforehand.
    """
    known: dict[str, Any] = {}
    other_runs = {band: run for band, run in runs.items() if band != "l"}
    images = RunImages(runs["l"], recipe.chain(), recipe.lane, Model(), known, other_runs)
    Engine(images.passes(), len(images.imager), known).run()
    return cast("MaskedSuppression", images.stages["clutter.masks"])


def trained(stage: MaskedSuppression, learnt: Arrays, **changes: Any) -> MaskedSuppression:
    """Return a stage with what was learnt, and other settings."""
    stage_copy = MaskedSuppression(stage.settings.model_copy(update=changes), stage.setup, learnt)
    stage_copy.before = stage.before
    return stage_copy


def local(table: pd.DataFrame, pose: FloatArray) -> FloatArray:
    """Places (n, 2) of a table in the scan frame of a pose, m."""
    return lane_to_scan(ground_points(table), pose)[:, :2]


def simulate_lane(folder: Path, recipe: FuseRecipe, name: str, track: Track) -> Frames:
    """Simulate both bands of a lane into run stores, unless they are there, and read them."""
    seed = recipe.lanes.seeds[name]
    runs = {}
    for band in BANDS:
        store, _, _ = store_lane(
            folder, lane_scene(recipe, name, band), seed, band_sensor(recipe, band), track
        )
        runs[band] = open_run(store)
    world = draw_world(lane_scene(recipe, name, "l"), seed)
    mines = mines_alone(folder, recipe, name, track) if name != "calibration" else None
    return Frames(name, masks_stage(runs, recipe), world.truth(), world.objects_table(), mines)


def mines_alone(folder: Path, recipe: FuseRecipe, name: str, track: Track) -> ComplexArray:
    """Simulate what the mines add to VV of every scan.

    The lane less its twin that has everything but the mines. The echoes of the surface and of what
    is strewn through the soil, the same in both, are left out.
    """
    sensor = band_sensor(recipe, "l").model_copy(update={"polarization": ("VV",)})
    seed = recipe.lanes.seeds[name]
    scene = lane_scene(recipe, name, "l")
    lane = world_description(scene, seed)
    lane |= {"surface": {**lane["surface"], "echo": False}, **EVEN}
    twins = [Scene.model_validate(tables) for tables in (lane, lane | {"targets": []})]
    key = key_of(
        [twin.model_dump(mode="json") for twin in twins], sensor.model_dump(mode="json"), seed
    )
    path = folder / f"{name}-mines-{key}.bundle"
    if not path.is_file():
        full, empty = (Simulator(twin, sensor, seed, errors=False) for twin in twins)
        scans = track(range(len(full)), f"mines of lane {name}", len(full))
        write_arrays(path, {"signal": np.stack([full.scan(k) - empty.scan(k) for k in scans])})
    return read_arrays(path)["signal"]
