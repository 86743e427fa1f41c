"""The settings of the study of Fuse et al. 2018, its lanes, and their frames.

A lane is two runs, of the L and of the X band, that share their poses.
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
from pydantic import Field

from flgpr.engine import Engine
from flgpr.method.imaged_run import ImagedRun
from flgpr.model import Grid, Lane, Sensor, check_tones, ground_points, lane_to_scan, load_sensor
from flgpr.model.bounds import AtLeastOne, NotNegative, Positive
from flgpr.progress import Track
from flgpr.recipe.schema import Recipe, recipe_text
from flgpr.simulate import EVEN, Scene, Simulator, draw_world, world_description
from flgpr.stages.masks import MaskedSuppression
from flgpr.store import open_run
from flgpr.types import Arrays, ComplexArray, FloatArray
from flgpr_papers.kit.cache import key_of, read_arrays, store_lane, write_arrays
from flgpr_papers.kit.settings import Span, Table, packaged
from flgpr_papers.kit.study_worlds import OWN, study_world

BANDS = ("l", "x")


class Radar(Table):
    """Errors of the navigation, simulated ground and density of its scatterers."""

    position: NotNegative  #: deviation of the reported position, m
    heading: NotNegative  #: deviation of the reported heading, rad
    footprint: tuple[float, float, float, float]  #: simulated ground in the scan frame, m
    scatterers_x: Positive  #: surface scatterers of the X band per m²
    scatterers: Positive | None = None  #: the same of both bands, where it is given


class Lanes(Table):
    """The three lanes: metres, mines per depth, objects per metre."""

    length: Positive
    half_width: Positive
    depths: tuple[float, ...]
    mines: AtLeastOne
    site: str
    bushes: NotNegative
    posts: NotNegative
    roadside: Span
    step: Span
    start: float
    wander: NotNegative
    seeds: dict[str, int]


class Image(Table):
    """Images ahead of the latest frame."""

    x: Span  #: cross-track, m
    y: Span  #: ahead, m
    spacing: Positive  #: of the pixels, m
    frames: Annotated[int, Field(ge=2)]  #: number of frames summed (Eq. 4)
    edges: tuple[float, ...]  #: borders of the sub-regions in range, m


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
    """Detection area of a frame, and how its alarms are scored."""

    x: Span  #: cross-track, m
    y: Span  #: ahead, m
    halo: Positive  #: diameter of a mine's halo, m
    radius: Positive  #: within which an alarm is the largest, m
    far_max: Positive  #: false alarms per m² up to which Pd is averaged
    far: Positive  #: false alarms per m² at which variants are compared


class Boxes(Table):
    """Clutter boxes: side and distance to the image's border (m); draws of every bootstrap."""

    side: Positive
    margin: NotNegative
    draws: Annotated[int, Field(ge=100)]


class Study(Table):
    """Which apertures are cleaned, and the looser navigation that is tried."""

    example: float  #: position along the lane of the frame that the figures show, m
    every: AtLeastOne  #: frames from aperture to aperture
    loose_every: AtLeastOne  #: the same with the looser navigation
    loose_position: Positive  #: deviation of its position, m


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

        The map is larger than what is scored, so that peaks at its border are complete.
        """
        return Grid.spanning(self.image.x, (0.0, self.lanes.length + 2.0), self.image.spacing)

    def chain(self) -> Recipe:
        """Return the recipe of the detection chain with the study's images and masks."""
        tables = tomllib.loads(recipe_text("fuse2018-printed"))
        image = self.image.model_dump()
        masks = {
            "edges": image.pop("edges"),
            "frames": image["frames"],
            **dict(self.mask),
            **dict(self.suppress),
        }
        tables["image"] |= image
        stages = [
            stage | masks if stage["stage"] == "masks" else stage for stage in tables["clutter"]
        ]
        tables["clutter"] = stages
        return Recipe.model_validate(tables)


def fuse_recipe(quick: bool = False, world: str = OWN) -> FuseRecipe:
    """Load the packaged recipe of the study, on the lanes of a world.

    Parameters
    ----------
    quick : bool
        Whether it is a quick run.
    world : str
        World of the lanes, see `flgpr_papers.kit.study_worlds`.
    """
    site = study_world("fuse2018", world).sites["lane"]
    return packaged("fuse2018", FuseRecipe, quick, {"lanes": {"site": site}})


def band_sensor(recipe: FuseRecipe, band: str) -> Sensor:
    """Load a band's preset with the study's navigation and footprint.

    Parameters
    ----------
    recipe : FuseRecipe
        The study.
    band : str
        "l" or "x".

    Raises
    ------
    ValueError
        If echoes from before the images appear in them with these tones.
    """
    preset = load_sensor(f"dual-band-{band}")
    navigation = {"position": recipe.radar.position, "heading": recipe.radar.heading}
    errors = preset.errors.model_copy(update=navigation)
    sensor = preset.model_copy(update={"errors": errors, "footprint": recipe.radar.footprint})
    y_min, y_max = recipe.image.y
    # The earliest frame of a coherent sum sees the ground from farther back.
    behind = (recipe.image.frames - 1) * recipe.lanes.step[1]
    check_tones(sensor, recipe.image.x, (y_min, y_max + behind))
    return sensor


def lane_scene(recipe: FuseRecipe, name: str, band: str) -> Scene:
    """Return the scene of a lane as a band sees it.

    The bands differ in the density of surface scatterers alone.

    Parameters
    ----------
    recipe : FuseRecipe
        The study.
    name : str
        Name of the lane.
    band : str
        "l" or "x".
    """
    lanes = recipe.lanes
    density = recipe.radar.scatterers
    if density is None and band == "x":
        density = recipe.radar.scatterers_x
    draws = [{"kind": "metal", "depth": depth, "count": lanes.mines} for depth in lanes.depths]
    return Scene.model_validate(
        {
            "name": f"{name}-{band}",
            "site": lanes.site,
            "x_min": -lanes.half_width,
            "x_max": lanes.half_width,
            "length": lanes.length,
            "surface": {"density": density},
            "clutter": {"bushes": lanes.bushes, "posts": lanes.posts, "roadside": lanes.roadside},
            "draws": draws,
            "track": {"start": lanes.start, "step": lanes.step, "wander": lanes.wander},
        }
    )


@dataclass(frozen=True)
class Frames:
    """A lane's frames, as the stage that forms masks and suppresses has them."""

    name: str
    #: stage of the L band, with the X band as the second, not trained; its passes were run
    stage: MaskedSuppression
    truth: pd.DataFrame  #: targets in the lane, for calibration and scoring
    objects: pd.DataFrame  #: objects in and beside the lane, for calibration and scoring
    #: (frame, 1, pair, frequency) what the mines alone add to VV of the L band, without errors of
    #: the radar, to follow what becomes of it
    mines: ComplexArray | None = None

    def __len__(self) -> int:
        return len(self.stage.setup.imager)

    def pose(self, frame: int) -> FloatArray:
        """Return the reported pose (6,) of a frame."""
        return self.stage.setup.pose(frame)


def masks_stage(runs: Mapping[str, xr.Dataset], recipe: FuseRecipe) -> MaskedSuppression:
    """Return the suppressing stage of the detection chain for a lane's runs.

    The passes whose results it needs are run here.

    Parameters
    ----------
    runs : mapping of str to Dataset
        Run of each band, "l" and "x".
    recipe : FuseRecipe
        The study.
    """
    other_runs = {band: run for band, run in runs.items() if band != "l"}
    # The stage learns its thresholds later, from truths of its own.
    none = pd.DataFrame({"x": [], "y": []})
    imaged = ImagedRun(runs["l"], recipe.chain(), recipe.lane, others=other_runs, truth=none)
    Engine(
        [planned for stage in imaged.all_stages for planned in stage.passes()],
        len(imaged),
        imaged.results,
    ).run()
    return cast("MaskedSuppression", imaged.clutter_stages["clutter.masks"])


def trained(stage: MaskedSuppression, learnt: Arrays, **changes: Any) -> MaskedSuppression:
    """Return a copy of a stage with what was learnt, and with other settings.

    Parameters
    ----------
    stage : MaskedSuppression
        The stage of a lane.
    learnt : dict
        Thresholds, as the stage's ``fit`` returns them.
    **changes
        Entries of its settings that are replaced.
    """
    stage_copy = MaskedSuppression(stage.settings.model_copy(update=changes), stage.setup, learnt)
    stage_copy.before = stage.before
    return stage_copy


def local(table: pd.DataFrame, pose: FloatArray) -> FloatArray:
    """Return the positions (n, 2) of a table in the scan frame of a pose, m."""
    return lane_to_scan(ground_points(table), pose)[:, :2]


def simulate_lane(folder: Path, recipe: FuseRecipe, name: str, track: Track) -> Frames:
    """Simulate both bands of a lane into run stores, unless they are on disk, and read them.

    Parameters
    ----------
    folder : Path
        Folder of the run stores.
    recipe : FuseRecipe
        The study.
    name : str
        Name of the lane: "calibration", "A" or "B".
    track : Track
        Shows progress.
    """
    seed = recipe.lanes.seeds[name]
    runs = {}
    for band in BANDS:
        scene = lane_scene(recipe, name, band)
        store, _, _ = store_lane(folder, scene, seed, band_sensor(recipe, band), track)
        runs[band] = open_run(store)
    drawn = draw_world(lane_scene(recipe, name, "l"), seed)
    mines = None
    if name != "calibration":
        mines = mines_alone(folder, recipe, name, track)
    return Frames(name, masks_stage(runs, recipe), drawn.truth(), drawn.objects_table(), mines)


def mines_alone(folder: Path, recipe: FuseRecipe, name: str, track: Track) -> ComplexArray:
    """Simulate what the mines add to VV of every scan, or read it if it is on disk.

    It is the signal of the lane less that of its twin without mines. The echoes of the surface and
    of what is strewn through the soil, the same in both, are left out.

    Parameters
    ----------
    folder, recipe, name, track
        As of :func:`simulate_lane`.

    Returns
    -------
    (scan, 1, pair, frequency) ndarray
        The signal, without errors of the radar.
    """
    sensor = band_sensor(recipe, "l").model_copy(update={"polarization": ("VV",)})
    seed = recipe.lanes.seeds[name]
    lane = world_description(lane_scene(recipe, name, "l"), seed)
    lane |= {"surface": {**lane["surface"], "echo": False}, **EVEN}
    with_mines = Scene.model_validate(lane)
    without_mines = Scene.model_validate(lane | {"targets": []})
    twins = [with_mines.model_dump(mode="json"), without_mines.model_dump(mode="json")]
    key = key_of(twins, sensor.model_dump(mode="json"), seed)
    path = folder / f"{name}-mines-{key}.bundle"
    if not path.is_file():
        full = Simulator(with_mines, sensor, seed, errors=False)
        empty = Simulator(without_mines, sensor, seed, errors=False)
        scans = track(range(len(full)), f"mines of lane {name}", len(full))
        differences = [full.scan(scan) - empty.scan(scan) for scan in scans]
        write_arrays(path, {"signal": np.stack(differences)})
    return read_arrays(path)["signal"]
