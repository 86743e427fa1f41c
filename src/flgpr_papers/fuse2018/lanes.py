"""The lanes of Fuse et al. 2018, simulated, and their frames: two runs with shared poses in the detection chain."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

import numpy as np
import pandas as pd
import xarray as xr
from numpy.typing import NDArray

from flgpr.chain.images import RunImages
from flgpr.chain.model import Model
from flgpr.chain.passes import Arrays, Chain
from flgpr.chain.progress import Track
from flgpr.chain.stages.masks import MaskedSuppression
from flgpr.io import open_run
from flgpr.model import Sensor, ground_points, lane_to_scan, load_sensor
from flgpr.simulate import EVEN, Scene, Simulator, draw_world, told
from flgpr_papers.fuse2018.recipe import FuseRecipe
from flgpr_papers.kit.cache import key_of, read_arrays, store_lane, write_arrays

BANDS = ("l", "x")
ComplexArray = NDArray[np.complex64]
FloatArray = NDArray[np.float64]


def band_sensor(recipe: FuseRecipe, band: str) -> Sensor:
    """Load a band's preset with the study's navigation and footprint."""
    preset = load_sensor(f"dual-band-{band}")
    errors = preset.errors.model_copy(update={"position": recipe.radar.position, "heading": recipe.radar.heading})
    return preset.model_copy(update={"errors": errors, "footprint": recipe.radar.footprint})


def lane_scene(recipe: FuseRecipe, name: str, band: str) -> Scene:
    """Describe a lane as a band sees it; the bands differ in the density of surface scatterers alone."""
    lanes, radar = recipe.lanes, recipe.radar
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
            "draws": [{"kind": "metal", "depth": depth, "count": lanes.mines} for depth in lanes.depths],
            "track": {"start": lanes.start, "step": lanes.step, "wander": lanes.wander},
        }
    )


@dataclass(frozen=True)
class Frames:
    """A lane's frames, as the stage of the detection chain that forms masks and suppresses has them."""

    name: str
    #: of the L band, with the X band as the second, not trained; what it needs to know of the runs is known
    stage: MaskedSuppression
    #: truth, objects: what is in and beside the lane; for calibration and scoring
    truth: pd.DataFrame
    objects: pd.DataFrame
    #: (frame, 1, pair, frequency) what the mines alone add to VV of the L band, without errors of the radar; to tell
    #: what becomes of it
    mines: ComplexArray | None = None

    def __len__(self) -> int:
        return len(self.stage.setup.imager)

    def pose(self, frame: int) -> FloatArray:
        """Give the reported pose (6,) of a frame."""
        return self.stage.setup.pose(frame)


def masks_stage(runs: Mapping[str, xr.Dataset], recipe: FuseRecipe) -> MaskedSuppression:
    """Take the stage out of the detection chain of a lane's runs, and do the passes that it needs beforehand."""
    known: dict[str, Any] = {}
    others = {band: run for band, run in runs.items() if band != "l"}
    images = RunImages(runs["l"], recipe.chain(), recipe.lane, Model(), known, others)
    Chain(images.passes(), len(images.imager), known).go()
    return cast("MaskedSuppression", images.stages["clutter.masks"])


def trained(stage: MaskedSuppression, learnt: Arrays, **changes: Any) -> MaskedSuppression:
    """Give a stage what was learnt, and other settings."""
    made = MaskedSuppression(stage.settings.model_copy(update=changes), stage.setup, learnt)
    made.before = stage.before
    return made


def local(table: pd.DataFrame, pose: FloatArray) -> FloatArray:
    """Places (n, 2) of a table in the scan frame of a pose, m."""
    return lane_to_scan(ground_points(table), pose)[:, :2]


def simulate_lane(folder: Path, recipe: FuseRecipe, name: str, track: Track) -> Frames:
    """Simulate both bands of a lane into run stores, unless they are there, and read them."""
    seed = recipe.lanes.seeds[name]
    runs = {}
    for band in BANDS:
        store, _, _ = store_lane(folder, lane_scene(recipe, name, band), seed, band_sensor(recipe, band), track)
        runs[band] = open_run(store)
    world = draw_world(lane_scene(recipe, name, "l"), seed)
    mines = mines_alone(folder, recipe, name, track) if name != "calibration" else None
    return Frames(name, masks_stage(runs, recipe), world.truth(), world.objects_table(), mines)


def mines_alone(folder: Path, recipe: FuseRecipe, name: str, track: Track) -> ComplexArray:
    """Simulate what the mines add to VV of every scan: the lane less its twin that has everything but the mines.

    The echoes of the surface and of what is strewn through the soil, the same in both, are left out.
    """
    sensor, seed = band_sensor(recipe, "l").model_copy(update={"polarization": ("VV",)}), recipe.lanes.seeds[name]
    scene = lane_scene(recipe, name, "l")
    lane = told(scene, seed)
    lane |= {"surface": {**lane["surface"], "echo": False}, **EVEN}
    twins = [Scene.model_validate(one) for one in (lane, lane | {"targets": []})]
    key = key_of([twin.model_dump(mode="json") for twin in twins], sensor.model_dump(mode="json"), seed)
    path = folder / f"{name}-mines-{key}.bundle"
    if not path.is_file():
        full, empty = (Simulator(twin, sensor, seed, errors=False) for twin in twins)
        scans = track(range(len(full)), f"mines of lane {name}", len(full))
        write_arrays(path, {"signal": np.stack([full.scan(k) - empty.scan(k) for k in scans])})
    return read_arrays(path)["signal"]
