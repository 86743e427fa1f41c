"""Process the frames of a lane, and what is kept on disk: thresholds, records and results."""

from __future__ import annotations

import json
from collections import defaultdict
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd

from flgpr.model import ground_points, lane_to_scan
from flgpr.progress import Track
from flgpr.recipe.schema import recipe_text
from flgpr.screen import MeanViewSums
from flgpr.store import write_whole
from flgpr.types import Arrays, Entries, FloatArray
from flgpr_papers.fuse2018.lanes import Frames, FuseRecipe, simulate_lane
from flgpr_papers.fuse2018.records import alarm_rows, aperture_rows
from flgpr_papers.fuse2018.suppression import VARIANTS, Calibration, Cleaned, clean, stage_forms
from flgpr_papers.kit.cache import key_of, read_arrays, read_or_make, write_arrays


@dataclass(frozen=True)
class LaneRecords:
    """What a lane's frames yield."""

    #: rows by table, as of :class:`LaneResult`
    tables: dict[str, list[Entries]]
    #: mean magnitude over the background of all looks, by variant
    maps: Arrays


@dataclass(frozen=True)
class LaneResult:
    """Results of a lane."""

    name: str
    truth: pd.DataFrame  #: targets in the lane
    objects: pd.DataFrame  #: objects in and beside it
    frames: int  #: number of apertures
    #: (frame, 6) pose of each aperture's latest frame, by number of the frame; NaN for frames
    #: without one
    poses: FloatArray
    #: variant, frame, x, y (m, lane frame), across, ahead (m, scan frame), magnitude over the
    #: background
    alarms: pd.DataFrame
    boxes: pd.DataFrame  #: frame, object, side, stage, power in the box
    #: frame, target, variant, peak, whether the mask covers the original peak
    mines: pd.DataFrame
    #: frame, variant, iterations that raised the residual and by how much at most, whether the last
    #: was worse than another, whether the best had to stand in, residual, share of pixels masked,
    #: CPU seconds
    courses: pd.DataFrame
    own: (
        pd.DataFrame
    )  #: frame, target, variant, change of what the mine alone gives at its peak, dB
    #: frame, what ("mine" or "clutter"), name, peak in vv, vh and x over the median of the rows it
    #: lies in, share of its VV power that the fundamental mask covers
    bands: pd.DataFrame
    #: mean magnitude over the background of all looks, by variant; NaN where there was no look
    maps: Arrays


_TABLES = ("alarms", "boxes", "mines", "courses", "own", "bands")


def calibrate(frames: Frames, recipe: FuseRecipe, track: Track) -> Calibration:
    """Learn thresholds and background from the calibration lane, whose targets are known.

    Parameters
    ----------
    frames : Frames
        The calibration lane's frames.
    recipe : FuseRecipe
        The study.
    track : Track
        Shows progress.
    """
    stage = frames.stage
    backgrounds = []
    examples = stage.calibration(stage.settings)
    targets = ground_points(frames.truth)
    is_road = np.abs(stage.grid.x) < recipe.mask.roadside[0]
    complete_frames = range(recipe.image.frames - 1, len(frames))
    for k in track(complete_frames, "calibration lane", len(complete_frames)):
        aperture = stage.aperture(k)
        stage.learn_from(aperture, lane_to_scan(targets, frames.pose(k)), examples)
        backgrounds.append(np.median(np.abs(aperture.vv[:, is_road]), axis=1))
    learnt, _ = stage.fit(stage.settings, [examples.state()])
    return Calibration(learnt, np.mean(backgrounds, axis=0))


def process_lane(
    frames: Frames,
    calibration: Calibration,
    recipe: FuseRecipe,
    track: Track,
    variants: Sequence[str] = tuple(VARIANTS),
    every: int = 1,
    example: Callable[[Cleaned], None] | None = None,
) -> LaneRecords:
    """Clean every aperture of a lane and record alarms, clutter boxes and mines.

    The truth says where mines and roadside objects are when something is measured. It is never used
    to form a mask, to suppress or to raise an alarm.

    Parameters
    ----------
    frames : Frames
        The lane's frames.
    calibration : Calibration
        What the calibration lane teaches.
    recipe : FuseRecipe
        The study.
    track : Track
        Shows progress.
    variants : sequence of str
        Names of the variants.
    every : int
        Frames from aperture to aperture.
    example : callable, optional
        Gets the aperture that the figures show.
    """
    tables: dict[str, list[Entries]] = defaultdict(list)
    forms = stage_forms(frames, calibration)
    sums = MeanViewSums(recipe.map_grid, recipe.score.y[1])
    latest_frames = range(recipe.image.frames - 1, len(frames), every)
    example_frame = min(latest_frames, key=lambda k: abs(frames.pose(k)[1] - recipe.study.example))
    for k in track(latest_frames, f"lane {frames.name}", len(latest_frames)):
        cleaned = clean(forms, k, variants)
        tables["courses"] += cleaned.rows
        for name, rows in aperture_rows(cleaned, frames, recipe).items():
            tables[name] += rows
        levels = {}
        for name, image in cleaned.images.items():
            levels[name] = np.abs(image) / calibration.background[:, None]
            tables["alarms"] += alarm_rows(cleaned, name, levels[name], recipe)
        all_levels = np.stack(list(levels.values())).astype(np.float32)
        sums.add(all_levels, cleaned.stage.grid, cleaned.pose)
        if example is not None and k == example_frame:
            example(cleaned)
    return LaneRecords(tables, dict(zip(variants, sums.result()[0], strict=True)))


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
    content: Entries = {
        "recipe": recipe.model_dump(mode="json", exclude={"vehicle"}),
        "chain": recipe_text("fuse2018-printed"),
        "quick": quick,
        "variants": list(VARIANTS),
    }
    if calibration is not None:
        content["calibration"] = _calibration_record(calibration)
    return key_of(content)


def _calibration_record(calibration: Calibration) -> Entries:
    """Return a calibration as lists of numbers, as JSON can hold it."""
    arrays = {**calibration.learnt, "background": calibration.background}
    return {name: value.tolist() for name, value in arrays.items()}


def stored_calibration(folder: Path, recipe: FuseRecipe, quick: bool, track: Track) -> Calibration:
    """Simulate the calibration lane and learn from it, or read what is on disk.

    Parameters
    ----------
    folder : Path
        Folder of the study.
    recipe : FuseRecipe
        The study.
    quick : bool
        Whether it is a quick run.
    track : Track
        Shows progress.
    """

    def make() -> Entries:
        frames = simulate_lane(folder / "lanes", recipe, "calibration", track)
        return _calibration_record(calibrate(frames, recipe, track))

    path = folder / "results" / f"calibration-{result_key(recipe, quick)}.json"
    arrays = {name: np.asarray(value) for name, value in read_or_make(path, make).items()}
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
    courses = records.tables["courses"]
    poses = {row["frame"]: frames.pose(row["frame"]).tolist() for row in courses}
    tables = {name: pd.DataFrame(records.tables[name]).to_dict("list") for name in _TABLES}
    write_whole(path, json.dumps({"poses": poses, "tables": tables}))


def read_records(path: Path, frames: Frames) -> LaneResult:
    """Read the records that :func:`write_records` wrote, with what is known of the lane."""
    content = json.loads(path.read_text("utf-8"))
    poses = np.full((len(frames), 6), np.nan)
    for frame, pose in content["poses"].items():
        poses[int(frame)] = pose
    return LaneResult(
        name=frames.name,
        truth=frames.truth,
        objects=frames.objects,
        frames=len(content["poses"]),
        poses=poses,
        **{name: pd.DataFrame(content["tables"][name]) for name in _TABLES},
        maps=read_arrays(path.with_suffix(".bundle")),
    )
