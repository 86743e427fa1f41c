"""A lane's results on disk, so that a study that was stopped goes on where it was, lane by lane."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from flgpr.chain.recipe import recipe_text
from flgpr.clutter import above, extended_mask, fundamental_mask, roadside_level
from flgpr.store import write_whole
from flgpr_papers.fuse2018.lanes import Frames, FuseRecipe, local
from flgpr_papers.fuse2018.process import (
    VARIANTS,
    Calibration,
    Cleaned,
    LaneRecords,
    box_of,
    roadside_objects,
    stage_images,
)
from flgpr_papers.kit.cache import Arrays, key_of, read_arrays, read_or_make, write_arrays

FloatArray = NDArray[np.float64]
TABLES = ("alarms", "boxes", "mines", "courses", "coherence", "own", "bands")


@dataclass(frozen=True)
class LaneResult:
    """A lane's results."""

    name: str
    #: truth, objects: what is in and beside it
    truth: pd.DataFrame
    objects: pd.DataFrame
    frames: int  #: number of apertures
    #: (frame, 6) of each aperture's latest frame, by number of the frame; NaN for frames without
    # one
    poses: FloatArray
    #: alarms, boxes, mines, courses, coherence, own, bands: as :class:`LaneRecords` describes them
    alarms: pd.DataFrame
    boxes: pd.DataFrame
    mines: pd.DataFrame
    courses: pd.DataFrame
    coherence: pd.DataFrame
    own: pd.DataFrame
    bands: pd.DataFrame
    #: mean magnitude over the background of all looks, by variant; NaN where there was no look
    maps: Arrays


def result_key(recipe: FuseRecipe, quick: bool, calibration: Calibration | None = None) -> str:
    """Compute the key under which results are kept.

    Another recipe or other thresholds have another one.
    """
    settings = recipe.model_dump(mode="json")
    content: dict[str, Any] = {"recipe": settings, "chain": recipe_text("fuse2018"), "quick": quick}
    content["variants"] = list(VARIANTS)
    if calibration is not None:
        content["calibration"] = calibration_record(calibration)
    return key_of(content)


def calibration_record(calibration: Calibration) -> dict[str, Any]:
    """Turn a calibration into plain lists."""
    arrays = {**calibration.learnt, "background": calibration.background}
    return {name: value.tolist() for name, value in arrays.items()}


def stored_calibration(path: Path, make: Callable[[], Calibration]) -> Calibration:
    """Read a calibration, or make and write it."""
    arrays = {
        name: np.asarray(value)
        for name, value in read_or_make(path, lambda: calibration_record(make())).items()
    }
    background = arrays.pop("background")
    return Calibration(arrays, background)


def write_records(path: Path, frames: Frames, records: LaneRecords) -> None:
    """Write a lane's records: tables as JSON, maps beside it."""
    write_arrays(path.with_suffix(".bundle"), records.maps)
    poses = {row["frame"]: frames.pose(row["frame"]).tolist() for row in records.courses}
    tables = {name: pd.DataFrame(getattr(records, name)).to_dict("list") for name in TABLES}
    write_whole(path, json.dumps({"poses": poses, "tables": tables}))


def read_records(path: Path, frames: Frames) -> LaneResult:
    """Read what :func:`write_records` wrote."""
    content = json.loads(path.read_text("utf-8"))
    tables = {name: pd.DataFrame(content["tables"][name]) for name in TABLES}
    poses = np.full((len(frames), 6), np.nan)
    for k, pose in content["poses"].items():
        poses[int(k)] = pose
    maps = read_arrays(path.with_suffix(".bundle"))
    return LaneResult(
        frames.name, frames.truth, frames.objects, len(content["poses"]), poses, **tables, maps=maps
    )


def example_arrays(cleaned: Cleaned, frames: Frames, recipe: FuseRecipe) -> Arrays:
    """Gather what the figures show of one aperture, in its scan frame.

    Magnitudes, masks, axes, places.
    """
    aperture = cleaned.aperture
    stage = cleaned.stage
    limits = stage.limits_for(aperture)
    region = stage.region
    grid = stage.grid
    arrays: Arrays = {
        "x_axis": grid.x,
        "y_axis": grid.y,
        "frame": np.array(cleaned.index),
        "vv": np.abs(aperture.vv),
        "vh": np.abs(aperture.vh),
        "mask vv": above(aperture.vv, limits.vv, region),
        "mask vh": above(aperture.vh, limits.vh, region),
        "mask vv low": above(
            aperture.vv,
            roadside_level(aperture.vv, region, stage.is_roadside, len(limits.vv)),
            region,
        ),
        "mask vh low": above(aperture.vh, limits.low_vh, region),
        "fundamental": fundamental_mask(aperture.vv, aperture.vh, limits, region, aperture.second),
        "fundamental by region": fundamental_mask(
            aperture.vv, aperture.vh, limits, region, aperture.second, "region"
        ),
        "extended": extended_mask(aperture.vh, limits, region, stage.across, recipe.mask.roadside),
        "mines": local(frames.truth, cleaned.pose),
        "residual": np.stack([course.residual for course in cleaned.courses]),
    }
    if aperture.second is not None and limits.second is not None:
        arrays |= {"x": aperture.second, "mask x": above(aperture.second, limits.second, region)}
    everywhere = np.ones(grid.shape, dtype=bool)
    for name, image in stage_images(cleaned, everywhere).items():
        if name.startswith("#"):
            arrays[f"stage {name}"] = np.abs(image).reshape(grid.shape)
    arrays |= {f"variant {name}": np.abs(image) for name, image in cleaned.images.items()}
    objects = roadside_objects(frames, cleaned.pose, recipe)
    inside = [box_of(grid, x, y, recipe.boxes.side) for x, y in objects[["x", "y"]].to_numpy()]
    objects = objects.assign(
        power=[float(np.mean(np.abs(aperture.vv[box]) ** 2)) for box in inside],
        left=objects["x"] < 0,
    )
    boxes = objects.sort_values("power").groupby("left").tail(1)[["x", "y"]]
    arrays["boxes"] = boxes.to_numpy(dtype=np.float64)
    large = {
        name
        for name, value in arrays.items()
        if value.shape == grid.shape and value.dtype == np.float64
    }
    return {
        name: value.astype(np.float32) if name in large else value for name, value in arrays.items()
    }
