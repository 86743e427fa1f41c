"""Process the frames of a lane: what becomes of every aperture, and what is kept on disk."""

from __future__ import annotations

import json
from collections import defaultdict
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import chain
from pathlib import Path
from typing import Any, cast

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from flgpr.clutter import TABLE_II, above, extended_mask, fundamental_mask, roadside_level
from flgpr.model import ground_points, lane_to_scan, scan_to_lane
from flgpr.progress import Track
from flgpr.recipe.schema import recipe_text
from flgpr.screen import MeanViewSums, frame_alarms
from flgpr.store import write_whole
from flgpr.types import AnyArray, Arrays, BoolArray, ComplexArray, Entries, FloatArray, floats
from flgpr_papers.fuse2018.lanes import Frames, FuseRecipe, local, simulate_lane
from flgpr_papers.fuse2018.suppression import (
    VARIANTS,
    Calibration,
    Cleaned,
    clean,
    stage_forms,
    suppressed_alone,
)
from flgpr_papers.kit.cache import key_of, read_arrays, read_or_make, write_arrays

Rows = list[Entries]
Halos = dict[str, tuple[Any, BoolArray, BoolArray]]
"""Row of the truth, halo and box (y, x) of every mine in the detection area, by its name."""


def roadside_objects(frames: Frames, pose: FloatArray, recipe: FuseRecipe) -> pd.DataFrame:
    """Return the bushes and posts at the roadside whose boxes lie within a frame's image.

    Parameters
    ----------
    frames : Frames
        The lane's frames.
    pose : (6,) ndarray
        Pose of the frame.
    recipe : FuseRecipe
        The study.

    Returns
    -------
    DataFrame
        Rows of the lane's objects; ``x`` and ``y`` in the scan frame, m.
    """
    near, far = recipe.mask.roadside
    margin = recipe.boxes.margin
    y_min, y_max = recipe.image.y
    objects = frames.objects[frames.objects["kind"].isin(["bush", "post"])]
    x, y = local(objects, pose).T
    is_inside = (np.abs(x) >= near) & (np.abs(x) <= far - margin)
    is_inside &= (y >= y_min + margin) & (y <= y_max - margin)
    return objects.assign(x=x, y=y)[is_inside]


def stage_images(cleaned: Cleaned, chosen: BoolArray) -> dict[str, ComplexArray]:
    """Image the iterations, and the combinations of Table II as printed, on some pixels.

    Parameters
    ----------
    cleaned : Cleaned
        An aperture.
    chosen : (y, x) ndarray of bool
        The pixels.

    Returns
    -------
    dict
        Images (pixel,) by name: "iteration 0" and so on, "#0" and so on.
    """
    stack = cleaned.aperture.stack_on(cleaned.stage.points[chosen])
    iterations = [
        stack.adjoint(np.stack(frames))[0, 0]
        for frames in zip(*(course.data for course in cleaned.courses), strict=True)
    ]
    images = {f"iteration {number}": image for number, image in enumerate(iterations)}
    for number, members in TABLE_II.items():
        images[f"#{number}"] = np.mean([iterations[member] for member in members], axis=0)
    return images


def aperture_rows(cleaned: Cleaned, frames: Frames, recipe: FuseRecipe) -> dict[str, Rows]:
    """Return what becomes of roadside objects and mines in an aperture, as rows by table.

    The tables are those of `flgpr_papers.fuse2018.process.LaneResult`: ``boxes``, the power in the
    boxes of roadside objects at every stage and of every variant; ``mines``, the mines' peaks and
    the power in boxes about them under each variant; ``own``, how the suppression changes what the
    mines alone give at their peaks; ``bands``, how strong mines and objects are in VV, VH and X.

    Parameters
    ----------
    cleaned : Cleaned
        The aperture, cleaned.
    frames : Frames
        The lane's frames.
    recipe : FuseRecipe
        The study.
    """
    objects = roadside_objects(frames, cleaned.pose, recipe)
    boxes = _boxes_of(objects, cleaned, recipe)
    halos: Halos = {}
    grid = cleaned.stage.grid
    placed = zip(frames.truth.itertuples(), local(frames.truth, cleaned.pose), strict=True)
    for target, position in placed:
        if recipe.area.contains(*position):
            distance = np.hypot(grid.x - position[0], grid.y[:, None] - position[1])
            halo = distance <= recipe.score.halo / 2
            halos[str(target.target_id)] = target, halo, _box(cleaned, position, recipe)
    tables = {
        "boxes": _box_rows(cleaned, objects, boxes) if boxes else [],
        "mines": _mine_rows(cleaned, halos),
        "own": _own_rows(cleaned, frames.mines, halos),
        "bands": _band_rows(cleaned, objects, boxes, halos),
    }
    for row in chain.from_iterable(tables.values()):
        row["frame"] = cleaned.index
    return tables


def _boxes_of(objects: pd.DataFrame, cleaned: Cleaned, recipe: FuseRecipe) -> list[BoolArray]:
    """Return the pixels (y, x) of every object's square box."""
    return [_box(cleaned, position, recipe) for position in objects[["x", "y"]].to_numpy()]


def _box(cleaned: Cleaned, position: FloatArray, recipe: FuseRecipe) -> BoolArray:
    """Return the pixels (y, x) of the square box about a position."""
    grid = cleaned.stage.grid
    half = recipe.boxes.side / 2
    rows = np.abs(grid.y - position[1]) <= half
    return rows[:, None] & (np.abs(grid.x - position[0]) <= half)


def _power(image: AnyArray, pixels: BoolArray) -> float:
    """Return the mean power of an image in some pixels."""
    return float(np.mean(np.abs(image[pixels]) ** 2))


def _box_rows(cleaned: Cleaned, objects: pd.DataFrame, boxes: list[BoolArray]) -> Rows:
    """Return the power in the boxes of objects at every stage and of every variant."""
    # Only pixels in some box are imaged: the stages are many.
    in_any_box = np.any(boxes, axis=0)
    images = stage_images(cleaned, in_any_box)
    images |= {name: image[in_any_box] for name, image in cleaned.images.items()}
    sides = np.where(objects["x"] < 0, "left", "right")
    return [
        {"object": name, "side": side, "stage": stage, "power": _power(image, box[in_any_box])}
        for name, side, box in zip(objects["object_id"], sides, boxes, strict=True)
        for stage, image in images.items()
    ]


def _mine_rows(cleaned: Cleaned, halos: Halos) -> Rows:
    """Return the mines' peaks, and the power in boxes about them, under each variant."""
    original = np.abs(cleaned.aperture.vv)
    rows: Rows = []
    for name, (target, halo, box) in halos.items():
        is_masked = bool(cleaned.masks["pixel"][_peak_pixel(original, halo)])
        for variant, image in cleaned.images.items():
            row = {"target": name, "variant": variant, "depth": target.depth, "masked": is_masked}
            peak = float(np.abs(image[halo]).max())
            rows.append(row | {"peak": peak, "power": _power(image, box)})
    return rows


def _peak_pixel(magnitude: NDArray[np.floating[Any]], halo: BoolArray) -> tuple[Any, ...]:
    """Return the row and column of the largest magnitude in a halo."""
    return np.unravel_index(int(np.where(halo, magnitude, -1).argmax()), halo.shape)


def _own_rows(cleaned: Cleaned, mines: ComplexArray | None, halos: Halos) -> Rows:
    """Return how the suppression changes what the mines alone give at their peaks.

    The suppression is that of the data as they are, with the clutter.
    """
    stage = cleaned.stage
    aperture = cleaned.aperture
    mask = cleaned.masks["pixel"]
    if mines is None or not halos or not mask.any():
        return []
    alone = mines[stage.setup.imager.scans[: cleaned.index + 1][-len(aperture.data) :]]
    data = {"original": alone, "iteration": suppressed_alone(cleaned, alone)}
    without = aperture.data.copy()
    without[:, stage.setup.imaged] -= alone
    for variant in {"least squares", "least squares spared"} & cleaned.images.keys():
        # Its steps depend on the data: what the mines add is what they change.
        rest = cleaned.forms[variant].least_squares(replace(aperture, data=without), mask)
        data[variant] = cleaned.data[variant] - rest
    stack = aperture.stack_on(stage.points)
    levels = {variant: np.abs(stack.adjoint(data[variant])[0, 0]) for variant in sorted(data)}
    original = levels.pop("original")
    rows: Rows = []
    for name, (_, halo, _) in halos.items():
        pixel = _peak_pixel(original, halo)
        for variant, level in levels.items():
            change = float(20 * np.log10(level[pixel] / original[pixel]))
            row = {"target": name, "variant": variant, "masked": bool(mask[pixel])}
            rows.append(row | {"change_db": change})
    return rows


def _band_rows(
    cleaned: Cleaned, objects: pd.DataFrame, boxes: list[BoolArray], halos: Halos
) -> Rows:
    """Return how strong mines and roadside objects are in VV, VH and the X band."""
    aperture = cleaned.aperture
    images = {"vv": np.abs(aperture.vv), "vh": np.abs(aperture.vh)}
    if aperture.second is not None:
        images["x"] = aperture.second
    mask = _fundamental(cleaned, cleaned.stage.settings.intersect)
    regions = [("clutter", *one) for one in zip(objects["object_id"], boxes, strict=True)]
    regions += [("mine", name, halo) for name, (_, halo, _) in halos.items()]
    rows: Rows = []
    for what, name, pixels in regions:
        power = images["vv"][pixels] ** 2
        held = float(power[mask[pixels]].sum() / power.sum())
        row = {"what": what, "name": name, "held": held}
        for band, image in images.items():
            # over the median of the rows that the pixels lie in
            row[band] = float(image[pixels].max() / np.median(image[pixels.any(axis=1)]))
        rows.append(row)
    return rows


def _fundamental(cleaned: Cleaned, intersect: Any = "pixel") -> BoolArray:
    """Return the fundamental mask of an aperture by a way to intersect."""
    aperture = cleaned.aperture
    limits = cleaned.stage.limits_for(aperture)
    region = cleaned.stage.region
    return fundamental_mask(aperture.vv, aperture.vh, limits, region, aperture.second, intersect)


def alarm_rows(cleaned: Cleaned, variant: str, level: FloatArray, recipe: FuseRecipe) -> Rows:
    """Return the alarms of a frame by a variant's level over the background, in the lane frame."""
    alarms = frame_alarms(level, cleaned.stage.grid, recipe.area, recipe.score.radius)
    x, y, _ = scan_to_lane(ground_points(alarms), cleaned.pose).T
    alarms = alarms.rename(columns={"x": "across", "y": "ahead"})
    rows = alarms.assign(variant=variant, frame=cleaned.index, x=x, y=y).to_dict("records")
    return cast("Rows", rows)


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
    stage = cleaned.stage
    grid = stage.grid
    region = stage.region
    limits = stage.limits_for(aperture)
    low_vv = roadside_level(aperture.vv, region, stage.is_roadside, len(limits.vv))
    arrays: Arrays = {
        "x_axis": grid.x,
        "y_axis": grid.y,
        "frame": np.array(cleaned.index),
        "vv": np.abs(aperture.vv),
        "vh": np.abs(aperture.vh),
        "mask vv": above(aperture.vv, limits.vv, region),
        "mask vh": above(aperture.vh, limits.vh, region),
        "mask vv low": above(aperture.vv, low_vv, region),
        "mask vh low": above(aperture.vh, limits.low_vh, region),
        "fundamental": _fundamental(cleaned),
        "fundamental by region": _fundamental(cleaned, "region"),
        "extended": extended_mask(aperture.vh, limits, region, stage.across, recipe.mask.roadside),
        "mines": local(frames.truth, cleaned.pose),
        "residual": np.stack([course.residual for course in cleaned.courses]),
    }
    if aperture.second is not None and limits.second is not None:
        arrays["x"] = aperture.second
        arrays["mask x"] = above(aperture.second, limits.second, region)
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


def _strongest_objects(cleaned: Cleaned, frames: Frames, recipe: FuseRecipe) -> FloatArray:
    """Return the positions (object, 2) of the strongest roadside object on either side, m."""
    objects = roadside_objects(frames, cleaned.pose, recipe)
    vv = cleaned.aperture.vv
    powers = [_power(vv, box) for box in _boxes_of(objects, cleaned, recipe)]
    objects = objects.assign(power=powers, left=objects["x"] < 0)
    strongest = objects.sort_values("power").groupby("left").tail(1)
    return floats(strongest[["x", "y"]])


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
