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

from flgpr.clutter import Thresholds, fundamental_mask
from flgpr.clutter.masks import above, extended_mask
from flgpr.io import write_whole
from flgpr_papers.fuse2018.lanes import Frames
from flgpr_papers.fuse2018.process import (
    VARIANTS,
    Calibration,
    Cleaned,
    LaneRecords,
    box_of,
    roadside_objects,
    stage_images,
)
from flgpr_papers.fuse2018.recipe import FuseRecipe
from flgpr_papers.kit.cache import Arrays, kept, key_of, read_arrays, write_arrays

FloatArray = NDArray[np.float64]
TABLES = ("alarms", "boxes", "mines", "courses", "coherence", "own")


@dataclass(frozen=True)
class LaneResult:
    """A lane's results."""

    name: str
    #: truth, objects: what is in and beside it
    truth: pd.DataFrame
    objects: pd.DataFrame
    frames: int  #: number of apertures
    #: (frame, 2) place of the array in each aperture's latest frame by number of the frame, m; NaN for frames without
    #: one
    origins: FloatArray
    #: alarms, boxes, mines, courses, coherence, own: as :class:`LaneRecords` describes them
    alarms: pd.DataFrame
    boxes: pd.DataFrame
    mines: pd.DataFrame
    courses: pd.DataFrame
    coherence: pd.DataFrame
    own: pd.DataFrame
    maps: Arrays  #: mean magnitude over the background of all looks, by variant; NaN where there was no look


def result_key(recipe: FuseRecipe, quick: bool, calibration: Calibration | None = None) -> str:
    """Compute the key under which results are kept: another recipe or other thresholds have another one."""
    # What a quick run would change is in the recipe already if this is one.
    held = recipe.model_dump(mode="json")
    held["study"] = {name: value for name, value in held["study"].items() if not name.startswith("quick")}
    content: dict[str, Any] = {"recipe": held, "quick": quick, "variants": list(VARIANTS)}
    if calibration is not None:
        content["calibration"] = calibration_record(calibration)
    return key_of(content)


def calibration_record(calibration: Calibration) -> dict[str, Any]:
    """Turn a calibration into plain lists."""
    limits = calibration.thresholds
    return {
        "vv": limits.vv.tolist(),
        "vh": limits.vh.tolist(),
        "low_vh": limits.low_vh.tolist(),
        "second": None if limits.second is None else limits.second.tolist(),
        "background": calibration.background.tolist(),
        "looks": calibration.looks.tolist(),
    }


def stored_calibration(path: Path, make: Callable[[], Calibration]) -> Calibration:
    """Read a calibration, or make and write it."""
    held = kept(path, lambda: calibration_record(make()))
    vv, vh, low = (np.asarray(held[name]) for name in ("vv", "vh", "low_vh"))
    second = None if held["second"] is None else np.asarray(held["second"])
    return Calibration(Thresholds(vv, vh, low, second), np.asarray(held["background"]), np.asarray(held["looks"]))


def write_records(path: Path, frames: Frames, records: LaneRecords, recipe: FuseRecipe) -> None:
    """Write a lane's records: tables as JSON, maps beside it."""
    looks = np.zeros(1) if records.looks is None else records.looks
    with np.errstate(invalid="ignore"):
        maps = {name: (total / looks[:, None]).astype(np.float32) for name, total in records.maps.items()}
    write_arrays(path.with_suffix(".bundle"), maps)
    used = sorted({row["frame"] for row in records.courses})
    spacing = recipe.image.spacing
    pose = frames.pose["l"]
    origins = {
        int(k): [float(pose[k, 0]), round((pose[k, 1] + recipe.image.y[0]) / spacing) * spacing - recipe.image.y[0]]
        for k in used
    }
    tables = {name: pd.DataFrame(getattr(records, name)).to_dict("list") for name in TABLES}
    write_whole(path, json.dumps({"origins": origins, "tables": tables}))


def read_records(path: Path, frames: Frames) -> LaneResult:
    """Read what :func:`write_records` wrote."""
    held = json.loads(path.read_text("utf-8"))
    tables = {name: pd.DataFrame(held["tables"][name]) for name in TABLES}
    origins = np.full((len(frames), 2), np.nan)
    for k, place in held["origins"].items():
        origins[int(k)] = place
    maps = read_arrays(path.with_suffix(".bundle"))
    return LaneResult(frames.name, frames.truth, frames.objects, len(held["origins"]), origins, **tables, maps=maps)


def example_arrays(cleaned: Cleaned, frames: Frames, calibration: Calibration, recipe: FuseRecipe) -> Arrays:
    """Gather what the figures show of one aperture.

    Magnitudes, masks, axes, places of mines and of the two named boxes.
    """
    one, limits = cleaned.aperture, calibration.thresholds
    common = (limits, one.region)
    arrays: Arrays = {
        "x_axis": one.grid.x, "y_axis": one.grid.y, "origin": np.asarray(one.origin),
        "vv": np.abs(one.vv), "vh": np.abs(one.vh),
        "mask vv": above(one.vv, limits.vv, one.region), "mask vh": above(one.vh, limits.vh, one.region),
        "fundamental": fundamental_mask(one.vv, one.vh, *common, one.x),
        "fundamental by region": fundamental_mask(one.vv, one.vh, *common, one.x, "region"),
        "extended": extended_mask(one.vh, *common, one.across, recipe.mask.roadside),
        "mines": frames.truth[["x", "y"]].to_numpy(dtype=np.float64),
        "residual": cleaned.course.residual,
    }  # fmt: skip
    if one.x is not None and limits.second is not None:
        arrays |= {"x": one.x, "mask x": above(one.x, limits.second, one.region)}
    everywhere = np.ones(one.grid.shape, dtype=bool)
    for name, image in stage_images(cleaned, everywhere).items():
        if name.startswith("#"):
            arrays[f"stage {name}"] = np.abs(image).reshape(one.grid.shape)
    arrays |= {f"variant {name}": np.abs(image) for name, image in cleaned.images.items()}
    boxes = []
    objects = roadside_objects(frames, one, recipe)
    power = [
        float(np.mean(np.abs(one.vv[box_of(one, x, y, recipe.boxes.side)]) ** 2))
        for x, y in objects[["x", "y"]].to_numpy()
    ]
    for side in (objects["x"] < one.origin[0], objects["x"] >= one.origin[0]):
        rows = np.flatnonzero(side)
        if rows.size:
            best = rows[np.argmax(np.asarray(power)[rows])]
            boxes.append(objects[["x", "y"]].to_numpy()[best])
    arrays["boxes"] = np.asarray(boxes, dtype=np.float64).reshape(-1, 2)
    large = {name for name, value in arrays.items() if value.shape == one.grid.shape and value.dtype == np.float64}
    return {name: value.astype(np.float32) if name in large else value for name, value in arrays.items()}
