"""Process the frames of a lane: thresholds, masks, suppression by every variant, and alarms."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from flgpr.chain.engine import Arrays
from flgpr.chain.progress import Track
from flgpr.chain.stages.masks import Aperture, MaskedSuppression, OperatorOn
from flgpr.clutter import (
    TABLE_II,
    Iterated,
    averaged_frames,
    equal_cost,
    fallen_back,
    fundamental_mask,
    measured_coherence,
    suppress_by_model,
)
from flgpr.model import Grid, ground_points, lane_to_scan, scan_to_lane
from flgpr.screen import MeanViewSums, frame_alarms
from flgpr_papers.fuse2018.lanes import Frames, FuseRecipe, local, trained

BoolArray = NDArray[np.bool_]
ComplexArray = NDArray[np.complex64]
FloatArray = NDArray[np.float64]

VARIANTS = {
    "original": "original image",
    "iteration": "iteration in each frame under one mask (Sec. 2.3)",
    "as printed": "the same, averaged whatever came: without a fall-back to the best iteration",
    "shared": "iteration, one reflectivity for all frames (another reading of Sec. 2.3)",
    "whole response": "iteration, B made of the whole response (another reading of Eq. 7)",
    "calibrated roadside": "iteration, the extended mask's threshold from the calibration lane",
    "regions": "iteration, masks intersected by connected region (another reading of Sec. 2.4)",
    "least squares": "least squares at equal cost, one reflectivity for all frames",
    "least squares per frame": "least squares at equal cost, a reflectivity for every frame",
    "least squares spared": (
        "least squares, the road fitted too and not subtracted, as many iterations"
    ),
    "L band alone": "iteration, masks from VV and VH alone",
}
"""Variants of the suppression that are compared, and how they are called in full."""
_FORMS: dict[str, dict[str, str]] = {
    "iteration": {},
    "shared": {"method": "iteration"},
    "whole response": {"amplitude": "whole"},
    "calibrated roadside": {"low_threshold": "calibration"},
    "regions": {"intersect": "region"},
    "least squares": {"method": "least-squares"},
    "least squares spared": {"method": "least-squares-spared"},
}
"""Settings of the detection chain's stage that make a variant."""
MASKS = {"regions": "region", "L band alone": "L", "calibrated roadside": "calibrated"}
"""Masks of the variants, "pixel" of all others."""


@dataclass(frozen=True)
class Calibration:
    """What the calibration lane teaches."""

    #: thresholds of the masks as the stage takes them, and the looks at targets that they rest on
    learnt: Arrays
    #: (row,) median magnitude of VV between the roadsides at every distance ahead, in which units
    #: alarms are measured
    background: FloatArray


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


@dataclass(frozen=True)
class Cleaned:
    """An aperture with its masks and what each variant made of it."""

    index: int  #: the latest frame
    forms: dict[str, MaskedSuppression]  #: the stage by variant, of the variants that it knows
    aperture: Aperture
    masks: dict[str, BoolArray]  #: mixed masks: "pixel", "region", "L" and "calibrated"
    courses: list[Iterated]  #: of the iteration in each frame under one mask
    data: dict[str, ComplexArray]  #: (frame, 1, pair, frequency) by variant
    images: dict[str, ComplexArray]  #: by variant, in the scan frame of the latest frame
    rows: list[dict[str, Any]]  #: one per variant, for ``LaneRecords.courses``

    @property
    def stage(self) -> MaskedSuppression:
        """The stage as the paper has it."""
        return self.forms["iteration"]

    @property
    def pose(self) -> FloatArray:
        """Pose of the latest frame."""
        return self.stage.setup.pose(self.index)


def stage_forms(frames: Frames, calibration: Calibration) -> dict[str, MaskedSuppression]:
    """Return the trained stage of the detection chain with the settings of each variant.

    Variants that the stage does not know are left out.
    """
    forms = {}
    for name, changes in _FORMS.items():
        forms[name] = trained(frames.stage, calibration.learnt, **changes)
    return forms


def clean(forms: dict[str, MaskedSuppression], index: int, variants: Sequence[str]) -> Cleaned:
    """Form the masks of an aperture and suppress what lies under them, by every variant.

    Parameters
    ----------
    forms : dict of MaskedSuppression
        The trained stage by variant, see :func:`stage_forms`.
    index : int
        Latest frame of the aperture.
    variants : sequence of str
        Names of the variants.
    """
    stage = forms["iteration"]
    aperture = stage.aperture(index)
    stack = aperture.stack_on(stage.points)
    masks = {
        "pixel": stage.mask(aperture),
        "region": forms["regions"].mask(aperture),
        "L": stage.mask(replace(aperture, second=None)),
        "calibrated": forms["calibrated roadside"].mask(aperture),
    }
    before = time.process_time()
    main_courses = stage.courses(aperture, masks["pixel"])
    # The courses of "iteration" serve other variants, too: their time is its own.
    main_seconds = time.process_time() - before
    data = {}
    images = {}
    rows = []
    for variant in variants:
        before = time.process_time()
        cleaned, courses = _suppressed(variant, forms, aperture, masks, main_courses)
        seconds = time.process_time() - before
        if variant == "iteration":
            seconds += main_seconds
        data[variant] = cleaned
        images[variant] = stack.adjoint(cleaned)[0, 0]
        original = aperture.data[:, stage.setup.imaged]
        rows.append(
            {
                "frame": index,
                "variant": variant,
                **_course_summary(variant, forms, courses),
                "residual": float(np.linalg.norm(cleaned) / np.linalg.norm(original)),
                "masked": float(masks[MASKS.get(variant, "pixel")].mean()),
                "cpu": seconds,
            }
        )
    return Cleaned(index, forms, aperture, masks, main_courses, data, images, rows)


def _course_summary(
    variant: str, forms: dict[str, MaskedSuppression], courses: Sequence[Iterated]
) -> dict[str, Any]:
    """Return how the iterations of a variant went, for ``LaneRecords.courses``."""
    stage = forms.get(variant, forms["iteration"])
    combination = forms["iteration"].settings.combination
    falls_back = variant != "as printed" and stage.settings.fall_back
    has_fallen = any(fallen_back(course, combination) for course in courses)
    return {
        "rises": sum(course.rises for course in courses),
        "rise": max((course.rise for course in courses), default=0.0),
        "diverged": any(course.diverged for course in courses),
        "fallen": falls_back and has_fallen,
    }


def _suppressed(
    variant: str,
    forms: dict[str, MaskedSuppression],
    aperture: Aperture,
    masks: dict[str, BoolArray],
    main_courses: list[Iterated],
) -> tuple[ComplexArray, list[Iterated]]:
    """Clean an aperture by a variant; returns the data and the courses of its iterations.

    ``main_courses`` are those of "iteration".
    """
    stage = forms.get(variant, forms["iteration"])
    data = aperture.data[:, stage.setup.imaged]
    mask = masks[MASKS.get(variant, "pixel")]
    if variant == "original":
        return data, []
    if variant == "as printed":
        combination = stage.settings.combination
        return averaged_frames(main_courses, combination, fall_back=False), main_courses
    if variant in ("least squares", "least squares spared"):
        return stage.least_squares(aperture, mask), []
    if variant == "least squares per frame":
        return _least_squares_per_frame(stage, aperture, mask), []
    courses = main_courses
    if variant != "iteration":
        courses = stage.courses(aperture, mask)
    return stage.averaged(courses), courses


def _least_squares_per_frame(
    stage: MaskedSuppression, aperture: Aperture, mask: BoolArray
) -> ComplexArray:
    """Clean an aperture by least squares at equal cost, with a reflectivity for every frame."""
    frames = aperture.data[:, stage.setup.imaged]
    if not mask.any():
        return frames
    iterations = equal_cost(stage.settings.iterations, mask, stage.region)
    cleaned = []
    for frame, operator_on in zip(frames, aperture.operators, strict=True):
        operator = operator_on(stage.points[mask])
        cleaned.append(suppress_by_model(frame, operator, iterations).data)
    return np.stack(cleaned)


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
        _record_boxes(records, cleaned, frames, recipe)
        _record_mines(records, cleaned, frames, recipe)
        _record_own(records, cleaned, frames, recipe)
        _record_bands(records, cleaned, frames, recipe)
        levels = {}
        for name, image in cleaned.images.items():
            levels[name] = np.abs(image) / calibration.background[:, None]
        _record_alarms(records, cleaned, levels, recipe)
        all_levels = np.stack(list(levels.values())).astype(np.float32)
        sums.add(all_levels, cleaned.stage.grid, cleaned.pose)
        for loss in measured_coherence(cleaned.aperture.looks).loss_db:
            records.coherence.append({"frame": k, "loss_db": float(loss)})
        if example is not None and k == example_frame:
            example(cleaned)
    records.maps = dict(zip(variants, sums.result()[0], strict=True))
    return records


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


def _record_boxes(
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


def _record_mines(
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


def _record_own(records: LaneRecords, cleaned: Cleaned, frames: Frames, recipe: FuseRecipe) -> None:
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


def _record_bands(
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


def suppressed_alone(cleaned: Cleaned, data: ComplexArray) -> ComplexArray:
    """Suppress data by the mask and the amplitudes B of an aperture's iteration, held fixed.

    This is a linear operation.

    Parameters
    ----------
    cleaned : Cleaned
        The aperture.
    data : (frame, 1, pair, frequency) ndarray
        Other data of the same frames.
    """
    suppressed = []
    for frame, operator_on, course in zip(
        data, cleaned.aperture.operators, cleaned.courses, strict=True
    ):
        suppressed.append(_frame_alone(cleaned, frame, operator_on, course))
    return np.stack(suppressed)


def _frame_alone(
    cleaned: Cleaned, data: ComplexArray, operator_on: OperatorOn, course: Iterated
) -> ComplexArray:
    """Suppress the data (polarization, pair, frequency) of a frame by its course's amplitudes."""
    stage = cleaned.stage
    mask = cleaned.masks["pixel"]
    operators = {}
    for region in np.unique(stage.region[mask]):
        operators[int(region)] = operator_on(stage.points[mask & (stage.region == region)])
    iterates = [data]
    for B in course.amplitude:
        rest = iterates[-1]
        for region, operator in operators.items():
            x_hat = operator.adjoint(iterates[-1])
            rest = rest - np.float32(B[region, 0]) * operator.forward(x_hat)  # Eq. 5 and 6
        iterates.append(rest)
    combination = stage.settings.combination
    best = fallen_back(course, combination).get(0)
    iterations = TABLE_II[combination] if best is None else (best,)
    averaged = np.mean([iterates[number] for number in iterations], axis=0)
    return np.asarray(averaged, dtype=np.complex64)


def _record_alarms(
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
