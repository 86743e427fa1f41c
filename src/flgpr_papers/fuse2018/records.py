"""Records of what becomes of alarms, clutter boxes and mines in the apertures of a lane.

The truth says where mines and roadside objects are when something is measured.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from flgpr.clutter import TABLE_II, fundamental_mask
from flgpr.engine import Arrays
from flgpr.model import Grid, ground_points, scan_to_lane
from flgpr.screen import frame_alarms
from flgpr_papers.fuse2018.lanes import Frames, FuseRecipe, local
from flgpr_papers.fuse2018.suppression import Cleaned, suppressed_alone

BoolArray = NDArray[np.bool_]
ComplexArray = NDArray[np.complex64]
FloatArray = NDArray[np.float64]


@dataclass
class LaneRecords:
    """What a lane's frames yield, row by row."""

    #: variant, frame, x, y (m, lane frame), across, ahead (m, scan frame), magnitude over the
    #: background
    alarms: list[dict[str, Any]] = field(default_factory=list)
    #: frame, object, side, stage, power in the box
    boxes: list[dict[str, Any]] = field(default_factory=list)
    #: frame, target, variant, peak, whether the mask covers the original peak
    mines: list[dict[str, Any]] = field(default_factory=list)
    #: frame, variant, iterations that raised the residual and by how much at most, whether the last
    #: was worse than another, whether the best had to stand in, residual, share of pixels masked,
    #: CPU seconds
    courses: list[dict[str, Any]] = field(default_factory=list)
    #: frame, loss of the coherent sum at the strongest pixels, dB
    coherence: list[dict[str, Any]] = field(default_factory=list)
    #: frame, target, variant, change of what the mine alone gives at its peak, dB
    own: list[dict[str, Any]] = field(default_factory=list)
    #: frame, what ("mine" or "clutter"), name, peak in vv, vh and x over the median of the rows it
    #: lies in, share of its VV power that the fundamental mask covers
    bands: list[dict[str, Any]] = field(default_factory=list)
    #: mean magnitude over the background of all looks, by variant
    maps: Arrays = field(default_factory=dict)


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


def box_of(grid: Grid, x: float, y: float, side: float) -> BoolArray:
    """Return which pixels (y, x) lie in a square box about a position, m."""
    columns = np.abs(grid.x - x) <= side / 2
    rows = np.abs(grid.y - y) <= side / 2
    return rows[:, None] & columns[None, :]


def halo_of(grid: Grid, position: FloatArray, radius: float) -> BoolArray:
    """Return which pixels (y, x) lie within a radius of a position, m."""
    return np.asarray(np.hypot(grid.x - position[0], grid.y[:, None] - position[1]) <= radius)


def targets_in_area(
    frames: Frames, pose: FloatArray, recipe: FuseRecipe
) -> list[tuple[Any, FloatArray]]:
    """Return the mines in the detection area of a frame: row of the truth, and position.

    Positions (2,) are in the frame's scan frame, m.
    """
    targets = []
    for row, position in zip(frames.truth.itertuples(), local(frames.truth, pose), strict=True):
        if recipe.area.contains(*position):
            targets.append((row, position))
    return targets


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
    iterations = []
    for frames in zip(*(course.data for course in cleaned.courses), strict=True):
        iterations.append(stack.adjoint(np.stack(frames))[0, 0])
    images = {f"iteration {number}": image for number, image in enumerate(iterations)}
    for number, members in TABLE_II.items():
        images[f"#{number}"] = np.mean([iterations[member] for member in members], axis=0)
    return images


def record_boxes(
    records: LaneRecords, cleaned: Cleaned, frames: Frames, recipe: FuseRecipe
) -> None:
    """Record the power in the boxes of roadside objects, at every stage and of every variant."""
    objects = roadside_objects(frames, cleaned.pose, recipe)
    if objects.empty:
        return
    boxes = _boxes_of(objects, cleaned, recipe)
    # Only pixels in some box are imaged: the stages are many.
    in_any_box = np.any(boxes, axis=0)
    images = stage_images(cleaned, in_any_box)
    for name, image in cleaned.images.items():
        images[name] = image[in_any_box]
    sides = np.where(objects["x"] < 0, "left", "right")
    for name, side, box in zip(objects["object_id"], sides, boxes, strict=True):
        inside = box[in_any_box]
        for stage, image in images.items():
            power = float(np.mean(np.abs(image[inside]) ** 2))
            row = {"frame": cleaned.index, "object": name, "side": side, "stage": stage}
            records.boxes.append(row | {"power": power})


def _boxes_of(objects: pd.DataFrame, cleaned: Cleaned, recipe: FuseRecipe) -> list[BoolArray]:
    """Return the pixels of every object's box."""
    boxes = []
    for x, y in objects[["x", "y"]].to_numpy():
        boxes.append(box_of(cleaned.stage.grid, x, y, recipe.boxes.side))
    return boxes


def record_mines(
    records: LaneRecords, cleaned: Cleaned, frames: Frames, recipe: FuseRecipe
) -> None:
    """Record the mines' peaks under each variant."""
    original = np.abs(cleaned.aperture.vv)
    for target, position in targets_in_area(frames, cleaned.pose, recipe):
        halo = halo_of(cleaned.stage.grid, position, recipe.score.halo / 2)
        is_masked = bool(cleaned.masks["pixel"][_peak_pixel(original, halo)])
        for variant, image in cleaned.images.items():
            records.mines.append(
                {
                    "frame": cleaned.index,
                    "target": target.target_id,
                    "variant": variant,
                    "depth": target.depth,
                    "peak": float(np.abs(image[halo]).max()),
                    "masked": is_masked,
                }
            )


def _peak_pixel(magnitude: NDArray[np.floating[Any]], halo: BoolArray) -> tuple[Any, ...]:
    """Return the row and column of the largest magnitude in a halo."""
    return np.unravel_index(int(np.where(halo, magnitude, -1).argmax()), halo.shape)


def record_mines_alone(
    records: LaneRecords, cleaned: Cleaned, frames: Frames, recipe: FuseRecipe
) -> None:
    """Record how the suppression changes what the mines alone give at their peaks."""
    stage = cleaned.stage
    mask = cleaned.masks["pixel"]
    targets = targets_in_area(frames, cleaned.pose, recipe)
    if frames.mines is None or not targets or not mask.any():
        return
    stack = cleaned.aperture.stack_on(stage.points)
    levels = {}
    for variant, data in _mines_through_variants(cleaned, frames.mines).items():
        levels[variant] = np.abs(stack.adjoint(data)[0, 0])
    original = levels.pop("original")
    for target, position in targets:
        halo = halo_of(stage.grid, position, recipe.score.halo / 2)
        pixel = _peak_pixel(original, halo)
        for variant, level in levels.items():
            records.own.append(
                {
                    "frame": cleaned.index,
                    "target": target.target_id,
                    "variant": variant,
                    "masked": bool(mask[pixel]),
                    "change_db": float(20 * np.log10(level[pixel] / original[pixel])),
                }
            )


def _mines_through_variants(cleaned: Cleaned, mines: ComplexArray) -> dict[str, ComplexArray]:
    """Return what the mines alone add to an aperture's data, before and after each variant.

    The suppression is that of the data as they are, with the clutter.
    """
    stage = cleaned.stage
    aperture = cleaned.aperture
    scans = stage.setup.imager.scans[: cleaned.index + 1][-len(aperture.data) :]
    alone = mines[scans]
    data = {"original": alone, "iteration": suppressed_alone(cleaned, alone)}
    without = aperture.data.copy()
    without[:, stage.setup.imaged] -= alone
    for variant in ("least squares", "least squares spared"):
        if variant in cleaned.images:
            # Its steps depend on the data: what the mines add is what they change.
            form = cleaned.forms[variant]
            rest = form.least_squares(replace(aperture, data=without), cleaned.masks["pixel"])
            data[variant] = cleaned.data[variant] - rest
    return data


def record_bands(
    records: LaneRecords, cleaned: Cleaned, frames: Frames, recipe: FuseRecipe
) -> None:
    """Record how strong mines and roadside objects are in VV, VH and the X band."""
    aperture = cleaned.aperture
    stage = cleaned.stage
    images = {"vv": np.abs(aperture.vv), "vh": np.abs(aperture.vh)}
    if aperture.second is not None:
        images["x"] = aperture.second
    mask = fundamental_mask(
        aperture.vv,
        aperture.vh,
        stage.limits_for(aperture),
        stage.region,
        aperture.second,
        stage.settings.intersect,
    )
    objects = roadside_objects(frames, cleaned.pose, recipe)
    regions = []
    boxes = _boxes_of(objects, cleaned, recipe)
    for name, box in zip(objects["object_id"], boxes, strict=True):
        regions.append(("clutter", name, box))
    for target, position in targets_in_area(frames, cleaned.pose, recipe):
        halo = halo_of(stage.grid, position, recipe.score.halo / 2)
        regions.append(("mine", target.target_id, halo))
    for what, name, pixels in regions:
        power = images["vv"][pixels] ** 2
        row = {
            "frame": cleaned.index,
            "what": what,
            "name": name,
            "held": float(power[mask[pixels]].sum() / power.sum()),
        }
        for band, image in images.items():
            row[band] = _over_rows(image, pixels)
        records.bands.append(row)


def _over_rows(image: NDArray[np.floating[Any]], pixels: BoolArray) -> float:
    """Return the peak of a magnitude on some pixels over the median of the rows they lie in."""
    return float(image[pixels].max() / np.median(image[pixels.any(axis=1)]))


def record_alarms(
    records: LaneRecords, cleaned: Cleaned, levels: dict[str, FloatArray], recipe: FuseRecipe
) -> None:
    """Record the alarms of a frame by variant, in the lane frame."""
    for variant, level in levels.items():
        alarms = frame_alarms(level, cleaned.stage.grid, recipe.area, recipe.score.radius)
        x, y, _ = scan_to_lane(ground_points(alarms), cleaned.pose).T
        alarms = alarms.rename(columns={"x": "across", "y": "ahead"})
        alarms = alarms.assign(variant=variant, frame=cleaned.index, x=x, y=y)
        rows: list[dict[Any, Any]] = alarms.to_dict("records")
        records.alarms += rows
