"""Results of a lane on disk, by which an interrupted study resumes lane by lane."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from flgpr.clutter import above, extended_mask, fundamental_mask, roadside_level
from flgpr.recipe.schema import recipe_text
from flgpr.store import write_whole
from flgpr_papers.fuse2018.lanes import Frames, FuseRecipe, local
from flgpr_papers.fuse2018.records import (
    LaneRecords,
    box_of,
    roadside_objects,
    stage_images,
)
from flgpr_papers.fuse2018.suppression import VARIANTS, Calibration, Cleaned
from flgpr_papers.kit.cache import Arrays, key_of, read_arrays, read_or_make, write_arrays

FloatArray = NDArray[np.float64]
TABLES = ("alarms", "boxes", "mines", "courses", "coherence", "own", "bands")


@dataclass(frozen=True)
class LaneResult:
    """Results of a lane; the tables are those of `flgpr_papers.fuse2018.records.LaneRecords`."""

    name: str
    truth: pd.DataFrame  #: targets in the lane
    objects: pd.DataFrame  #: objects in and beside it
    frames: int  #: number of apertures
    #: (frame, 6) pose of each aperture's latest frame, by number of the frame; NaN for frames
    #: without one
    poses: FloatArray
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
    """Return the key under which results are stored.

    Parameters
    ----------
    recipe : FuseRecipe
        The study.
    quick : bool
        Whether it is a quick run.
    calibration : Calibration, optional
        Thresholds that the results depend on.
    """
    content: dict[str, Any] = {
        "recipe": recipe.model_dump(mode="json"),
        "chain": recipe_text("fuse2018"),
        "quick": quick,
        "variants": list(VARIANTS),
    }
    if calibration is not None:
        content["calibration"] = calibration_record(calibration)
    return key_of(content)


def calibration_record(calibration: Calibration) -> dict[str, Any]:
    """Return a calibration as lists of numbers, as JSON can hold it."""
    arrays = {**calibration.learnt, "background": calibration.background}
    return {name: value.tolist() for name, value in arrays.items()}


def stored_calibration(path: Path, make: Callable[[], Calibration]) -> Calibration:
    """Read a calibration from a file, or make it and write the file."""
    record = read_or_make(path, lambda: calibration_record(make()))
    arrays = {name: np.asarray(value) for name, value in record.items()}
    background = arrays.pop("background")
    return Calibration(arrays, background)


def write_records(path: Path, frames: Frames, records: LaneRecords) -> None:
    """Write a lane's records: tables as JSON, maps into a bundle of the same name.

    Parameters
    ----------
    path : Path
        The JSON file.
    frames : Frames
        The lane's frames.
    records : LaneRecords
        What they yield.
    """
    write_arrays(path.with_suffix(".bundle"), records.maps)
    poses = {row["frame"]: frames.pose(row["frame"]).tolist() for row in records.courses}
    tables = {}
    for name in TABLES:
        tables[name] = pd.DataFrame(getattr(records, name)).to_dict("list")
    write_whole(path, json.dumps({"poses": poses, "tables": tables}))


def read_records(path: Path, frames: Frames) -> LaneResult:
    """Read the records that :func:`write_records` wrote, with what is known of the lane."""
    content = json.loads(path.read_text("utf-8"))
    tables = {name: pd.DataFrame(content["tables"][name]) for name in TABLES}
    poses = np.full((len(frames), 6), np.nan)
    for frame, pose in content["poses"].items():
        poses[int(frame)] = pose
    return LaneResult(
        name=frames.name,
        truth=frames.truth,
        objects=frames.objects,
        frames=len(content["poses"]),
        poses=poses,
        **tables,
        maps=read_arrays(path.with_suffix(".bundle")),
    )


def example_arrays(cleaned: Cleaned, frames: Frames, recipe: FuseRecipe) -> Arrays:
    """Return what the figures show of one aperture: magnitudes, masks, axes and positions.

    Parameters
    ----------
    cleaned : Cleaned
        The aperture, cleaned by every variant.
    frames : Frames
        The lane's frames.
    recipe : FuseRecipe
        The study.

    Returns
    -------
    dict
        Arrays in the scan frame of the aperture's latest frame; magnitudes are in single precision.
    """
    aperture = cleaned.aperture
    grid = cleaned.stage.grid
    arrays: Arrays = {
        "x_axis": grid.x,
        "y_axis": grid.y,
        "frame": np.array(cleaned.index),
        "vv": np.abs(aperture.vv),
        "vh": np.abs(aperture.vh),
        **_example_masks(cleaned, recipe),
        "mines": local(frames.truth, cleaned.pose),
        "residual": np.stack([course.residual for course in cleaned.courses]),
    }
    limits = cleaned.stage.limits_for(aperture)
    if aperture.second is not None and limits.second is not None:
        arrays["x"] = aperture.second
        arrays["mask x"] = above(aperture.second, limits.second, cleaned.stage.region)
    everywhere = np.ones(grid.shape, dtype=bool)
    for name, image in stage_images(cleaned, everywhere).items():
        if name.startswith("#"):
            arrays[f"stage {name}"] = np.abs(image).reshape(grid.shape)
    for name, image in cleaned.images.items():
        arrays[f"variant {name}"] = np.abs(image)
    arrays["boxes"] = _strongest_objects(cleaned, frames, recipe)
    for name, array in arrays.items():
        if array.shape == grid.shape and array.dtype == np.float64:
            arrays[name] = array.astype(np.float32)
    return arrays


def _example_masks(cleaned: Cleaned, recipe: FuseRecipe) -> Arrays:
    """Return the masks of an aperture: of single polarizations, fundamental and extended."""
    aperture = cleaned.aperture
    stage = cleaned.stage
    region = stage.region
    limits = stage.limits_for(aperture)
    low_vv = roadside_level(aperture.vv, region, stage.is_roadside, len(limits.vv))
    return {
        "mask vv": above(aperture.vv, limits.vv, region),
        "mask vh": above(aperture.vh, limits.vh, region),
        "mask vv low": above(aperture.vv, low_vv, region),
        "mask vh low": above(aperture.vh, limits.low_vh, region),
        "fundamental": fundamental_mask(aperture.vv, aperture.vh, limits, region, aperture.second),
        "fundamental by region": fundamental_mask(
            aperture.vv, aperture.vh, limits, region, aperture.second, "region"
        ),
        "extended": extended_mask(aperture.vh, limits, region, stage.across, recipe.mask.roadside),
    }


def _strongest_objects(cleaned: Cleaned, frames: Frames, recipe: FuseRecipe) -> FloatArray:
    """Return the positions (object, 2) of the strongest roadside object on either side, m."""
    objects = roadside_objects(frames, cleaned.pose, recipe)
    powers = []
    for x, y in objects[["x", "y"]].to_numpy():
        box = box_of(cleaned.stage.grid, x, y, recipe.boxes.side)
        powers.append(float(np.mean(np.abs(cleaned.aperture.vv[box]) ** 2)))
    objects = objects.assign(power=powers, left=objects["x"] < 0)
    strongest = objects.sort_values("power").groupby("left").tail(1)
    return strongest[["x", "y"]].to_numpy(dtype=np.float64)
