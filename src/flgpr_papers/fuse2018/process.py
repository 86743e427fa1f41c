"""Process the frames of a lane: thresholds from the calibration lane, suppression, records."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from flgpr.clutter import measured_coherence
from flgpr.model import ground_points, lane_to_scan
from flgpr.progress import Track
from flgpr.screen import MeanViewSums
from flgpr_papers.fuse2018.lanes import Frames, FuseRecipe
from flgpr_papers.fuse2018.records import (
    LaneRecords,
    record_alarms,
    record_bands,
    record_boxes,
    record_mines,
    record_mines_alone,
)
from flgpr_papers.fuse2018.suppression import (
    VARIANTS,
    Calibration,
    Cleaned,
    clean,
    stage_forms,
)


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
    records = LaneRecords()
    forms = stage_forms(frames, calibration)
    sums = MeanViewSums(recipe.map_grid, recipe.score.y[1])
    latest_frames = range(recipe.image.frames - 1, len(frames), every)
    example_frame = min(latest_frames, key=lambda k: abs(frames.pose(k)[1] - recipe.study.example))
    for k in track(latest_frames, f"lane {frames.name}", len(latest_frames)):
        cleaned = clean(forms, k, variants)
        records.courses += cleaned.rows
        record_boxes(records, cleaned, frames, recipe)
        record_mines(records, cleaned, frames, recipe)
        record_mines_alone(records, cleaned, frames, recipe)
        record_bands(records, cleaned, frames, recipe)
        levels = {}
        for name, image in cleaned.images.items():
            levels[name] = np.abs(image) / calibration.background[:, None]
        record_alarms(records, cleaned, levels, recipe)
        all_levels = np.stack(list(levels.values())).astype(np.float32)
        sums.add(all_levels, cleaned.stage.grid, cleaned.pose)
        for loss in measured_coherence(cleaned.aperture.looks).loss_db:
            records.coherence.append({"frame": k, "loss_db": float(loss)})
        if example is not None and k == example_frame:
            example(cleaned)
    records.maps = dict(zip(variants, sums.result()[0], strict=True))
    return records
