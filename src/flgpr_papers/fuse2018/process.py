"""What is done to the frames of a lane.

Thresholds from the calibration lane, masks, suppression, alarms.
"""

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
"""What is compared, and how it is called in full."""
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
    #: (row,) median magnitude of VV between the roadsides at every distance ahead: alarms are
    #: measured in units of it
    background: FloatArray


def calibrate(frames: Frames, recipe: FuseRecipe, track: Track) -> Calibration:
    """Learn thresholds and background from the calibration lane, whose targets are known."""
    stage = frames.stage
    rows = []
    examples = stage.calibration(stage.settings)
    targets = ground_points(frames.truth)
    road = np.abs(stage.grid.x) < recipe.mask.roadside[0]
    complete_frames = range(recipe.image.frames - 1, len(frames))
    for k in track(complete_frames, "calibration lane", len(complete_frames)):
        aperture = stage.aperture(k)
        stage.learn_from(aperture, lane_to_scan(targets, frames.pose(k)), examples)
        rows.append(np.median(np.abs(aperture.vv[:, road]), axis=1))
    learnt, _ = stage.fit(stage.settings, [examples.state()])
    return Calibration(learnt, np.mean(rows, axis=0))


@dataclass
class LaneRecords:
    """What a lane's frames yield, row by row."""

    #: variant, frame, x, y (m, lane frame), across, ahead (m, scan frame), magnitude over the
    #: background
    alarms: list[dict[str, Any]] = field(default_factory=list)
    boxes: list[dict[str, Any]] = field(
        default_factory=list
    )  #: frame, object, side, stage, power in the box
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
    #: lies in, share of its VV power that the fundamental mask holds
    bands: list[dict[str, Any]] = field(default_factory=list)
    maps: Arrays = field(
        default_factory=dict
    )  #: mean magnitude over the background of all looks, by variant


@dataclass(frozen=True)
class Cleaned:
    """An aperture with its masks and what each variant made of it."""

    index: int  #: the latest frame
    forms: dict[str, MaskedSuppression]  #: the stage by variant, as far as it knows them
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
    """Make the stage of the detection chain, trained, as every variant that it knows wants it."""
    return {
        name: trained(frames.stage, calibration.learnt, **changes)
        for name, changes in _FORMS.items()
    }


def clean(forms: dict[str, MaskedSuppression], index: int, variants: Sequence[str]) -> Cleaned:
    """Form the masks of the aperture that ends with a frame and suppress what lies under them."""
    stage = forms["iteration"]
    aperture = stage.aperture(index)
    b = aperture.data[:, stage.setup.imaged]
    stack = aperture.stack_on(stage.points)
    masks = {
        "pixel": stage.mask(aperture),
        "region": forms["regions"].mask(aperture),
        "L": stage.mask(replace(aperture, second=None)),
        "calibrated": forms["calibrated roadside"].mask(aperture),
    }
    before = time.process_time()
    main = stage.courses(aperture, masks["pixel"])
    spent = {"iteration": time.process_time() - before}
    stage_levels = {}
    images = {}
    rows = []
    for variant in variants:
        before = time.process_time()
        data, courses = _suppressed(variant, forms, aperture, masks, main)
        cpu = time.process_time() - before + spent.get(variant, 0.0)
        stage_levels[variant] = data
        images[variant] = stack.adjoint(data)[0, 0]
        falls_back = variant != "as printed" and forms.get(variant, stage).settings.fall_back
        rows.append(
            {
                "frame": index,
                "variant": variant,
                "rises": sum(course.rises for course in courses),
                "rise": max((course.rise for course in courses), default=0.0),
                "diverged": any(course.diverged for course in courses),
                "fallen": falls_back
                and any(fallen_back(course, stage.settings.combination) for course in courses),
                "residual": float(np.linalg.norm(data) / np.linalg.norm(b)),
                "masked": float(masks[MASKS.get(variant, "pixel")].mean()),
                "cpu": cpu,
            }
        )
    return Cleaned(index, forms, aperture, masks, main, stage_levels, images, rows)


def _suppressed(
    variant: str,
    forms: dict[str, MaskedSuppression],
    aperture: Aperture,
    masks: dict[str, BoolArray],
    main: list[Iterated],
) -> tuple[ComplexArray, list[Iterated]]:
    """Clean an aperture by a variant, whose courses of iterations it tells.

    ``main`` are those of "iteration".
    """
    stage = forms.get(variant, forms["iteration"])
    b = aperture.data[:, stage.setup.imaged]
    mask = masks[MASKS.get(variant, "pixel")]
    if variant == "original":
        return b, []
    if variant == "as printed":
        return averaged_frames(main, stage.settings.combination, fall_back=False), main
    if variant in ("least squares", "least squares spared"):
        return stage.least_squares(aperture, mask), []
    if variant == "least squares per frame":
        if not mask.any():
            return b, []
        count = equal_cost(stage.settings.iterations, mask, stage.region)
        pairs = zip(b, aperture.operators, strict=True)
        return np.stack(
            [suppress_by_model(data, make(stage.points[mask]), count).data for data, make in pairs]
        ), []
    courses = main if variant == "iteration" else stage.courses(aperture, mask)
    return stage.averaged(courses), courses


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

    The truth is used to say where mines and roadside objects are when something is measured, never
    to form a mask, to suppress or to raise an alarm.
    """
    records = LaneRecords()
    forms = stage_forms(frames, calibration)
    sums = MeanViewSums(recipe.map_grid, recipe.score.y[1])
    latest = range(recipe.image.frames - 1, len(frames), every)
    shown = min(latest, key=lambda k: abs(frames.pose(k)[1] - recipe.study.example))
    for k in track(latest, f"lane {frames.name}", len(latest)):
        cleaned = clean(forms, k, variants)
        records.courses += cleaned.rows
        _record_boxes(records, cleaned, frames, recipe)
        _record_mines(records, cleaned, frames, recipe)
        _record_own(records, cleaned, frames, recipe)
        _record_bands(records, cleaned, frames, recipe)
        levels = {
            name: np.abs(image) / calibration.background[:, None]
            for name, image in cleaned.images.items()
        }
        _record_alarms(records, cleaned, levels, recipe)
        sums.add(
            np.stack(list(levels.values())).astype(np.float32), cleaned.stage.grid, cleaned.pose
        )
        loss = measured_coherence(cleaned.aperture.looks).loss_db
        records.coherence += [{"frame": k, "loss_db": float(value)} for value in loss]
        if example is not None and k == shown:
            example(cleaned)
    records.maps = dict(zip(variants, sums.result()[0], strict=True))
    return records


def roadside_objects(frames: Frames, pose: FloatArray, recipe: FuseRecipe) -> pd.DataFrame:
    """List the bushes and posts whose boxes lie within a frame's image, at the roadside.

    ``x``, ``y`` in its frame.
    """
    near, far = recipe.mask.roadside
    margin = recipe.boxes.margin
    table = frames.objects[frames.objects["kind"].isin(["bush", "post"])]
    x, y = local(table, pose).T
    good = (np.abs(x) >= near) & (np.abs(x) <= far - margin)
    good &= (y >= recipe.image.y[0] + margin) & (y <= recipe.image.y[1] - margin)
    return table.assign(x=x, y=y)[good]


def box_of(grid: Grid, x: float, y: float, side: float) -> BoolArray:
    """Mark the pixels of a square box about a place, m."""
    columns = np.abs(grid.x - x) <= side / 2
    rows = np.abs(grid.y - y) <= side / 2
    return rows[:, None] & columns[None, :]


def halo_of(grid: Grid, position: FloatArray, radius: float) -> BoolArray:
    """Mark the pixels within a radius of a place, m."""
    return np.asarray(np.hypot(grid.x - position[0], grid.y[:, None] - position[1]) <= radius)


def targets_in_area(
    frames: Frames, pose: FloatArray, recipe: FuseRecipe
) -> list[tuple[Any, FloatArray]]:
    """Return the rows of the mines in the detection area of a frame, and their positions.

    Positions are in the frame's scan frame.
    """
    places = zip(frames.truth.itertuples(), local(frames.truth, pose), strict=True)
    return [(row, position) for row, position in places if recipe.area.contains(*position)]


def stage_images(cleaned: Cleaned, chosen: BoolArray) -> dict[str, ComplexArray]:
    """Image iterations and the combinations of Table II on some pixels.

    They are named "iteration 0" ... and, as printed, "#0" ....
    """
    stack = cleaned.aperture.stack_on(cleaned.stage.points[chosen])
    single = []
    for frames in zip(*(course.data for course in cleaned.courses), strict=True):
        single.append(stack.adjoint(np.stack(frames))[0, 0])
    images = {f"iteration {number}": image for number, image in enumerate(single)}
    for number, iterations in TABLE_II.items():
        combined = [single[i] for i in iterations]
        images[f"#{number}"] = np.mean(combined, axis=0)
    return images


def _record_boxes(
    records: LaneRecords, cleaned: Cleaned, frames: Frames, recipe: FuseRecipe
) -> None:
    """Record the power in the boxes of roadside objects."""
    objects = roadside_objects(frames, cleaned.pose, recipe)
    if objects.empty:
        return
    boxes = [
        box_of(cleaned.stage.grid, x, y, recipe.boxes.side)
        for x, y in objects[["x", "y"]].to_numpy()
    ]
    together = np.any(boxes, axis=0)
    stages = stage_images(cleaned, together) | {
        name: image[together] for name, image in cleaned.images.items()
    }
    sides = np.where(objects["x"] < 0, "left", "right")
    for name, side, box in zip(objects["object_id"], sides, boxes, strict=True):
        inside = box[together]
        records.boxes += [
            {"frame": cleaned.index, "object": name, "side": side, "stage": stage}
            | {"power": float(np.mean(np.abs(image[inside]) ** 2))}
            for stage, image in stages.items()
        ]


def _record_mines(
    records: LaneRecords, cleaned: Cleaned, frames: Frames, recipe: FuseRecipe
) -> None:
    """Record the mines' peaks under each variant."""
    strength = np.abs(cleaned.aperture.vv)
    for row, position in targets_in_area(frames, cleaned.pose, recipe):
        halo = halo_of(cleaned.stage.grid, position, recipe.score.halo / 2)
        at = np.unravel_index(int(np.where(halo, strength, -1).argmax()), halo.shape)
        records.mines += [
            {"frame": cleaned.index, "target": row.target_id, "variant": name, "depth": row.depth}
            | {"peak": float(np.abs(image[halo]).max()), "masked": bool(cleaned.masks["pixel"][at])}
            for name, image in cleaned.images.items()
        ]


def _record_own(records: LaneRecords, cleaned: Cleaned, frames: Frames, recipe: FuseRecipe) -> None:
    """Follow what the mines alone add to the data through what was done to the data as they are."""
    stage = cleaned.stage
    aperture = cleaned.aperture
    mask = cleaned.masks["pixel"]
    targets = targets_in_area(frames, cleaned.pose, recipe)
    if frames.mines is None or not targets or not mask.any():
        return
    alone = frames.mines[stage.setup.imager.scans[: cleaned.index + 1][-len(aperture.data) :]]
    images = {"original": alone, "iteration": suppressed_alone(cleaned, alone)}
    without = aperture.data.copy()
    without[:, stage.setup.imaged] -= alone
    for name in ("least squares", "least squares spared"):
        if name in cleaned.images:
            # Its steps depend on the data: what the mines add is what they change.
            rest = cleaned.forms[name].least_squares(replace(aperture, data=without), mask)
            images[name] = cleaned.data[name] - rest
    stack = aperture.stack_on(stage.points)
    level = {name: np.abs(stack.adjoint(data)[0, 0]) for name, data in images.items()}
    for row, position in targets:
        halo = halo_of(stage.grid, position, recipe.score.halo / 2)
        at = np.unravel_index(int(np.where(halo, level["original"], -1).argmax()), halo.shape)
        records.own += [
            {
                "frame": cleaned.index,
                "target": row.target_id,
                "variant": name,
                "masked": bool(mask[at]),
            }
            | {"change_db": float(20 * np.log10(image[at] / level["original"][at]))}
            for name, image in level.items()
            if name != "original"
        ]


def _record_bands(
    records: LaneRecords, cleaned: Cleaned, frames: Frames, recipe: FuseRecipe
) -> None:
    """Record how strong mines and roadside objects are in VV, VH and the X band."""
    aperture = cleaned.aperture
    stage = cleaned.stage
    images = {"vv": np.abs(aperture.vv), "vh": np.abs(aperture.vh)} | (
        {} if aperture.second is None else {"x": aperture.second}
    )
    settings = stage.settings
    mask = fundamental_mask(
        aperture.vv,
        aperture.vh,
        stage.limits_for(aperture),
        stage.region,
        aperture.second,
        settings.intersect,
    )
    objects = roadside_objects(frames, cleaned.pose, recipe)
    boxes = [box_of(stage.grid, x, y, recipe.boxes.side) for x, y in objects[["x", "y"]].to_numpy()]
    places = [("clutter", name, box) for name, box in zip(objects["object_id"], boxes, strict=True)]
    for row, position in targets_in_area(frames, cleaned.pose, recipe):
        places.append(("mine", row.target_id, halo_of(stage.grid, position, recipe.score.halo / 2)))
    for what, name, pixels in places:
        power = images["vv"][pixels] ** 2
        records.bands.append(
            {
                "frame": cleaned.index,
                "what": what,
                "name": name,
                "held": float(power[mask[pixels]].sum() / power.sum()),
            }
            | {band: _over_rows(image, pixels) for band, image in images.items()}
        )


def _over_rows(image: NDArray[np.floating[Any]], pixels: BoolArray) -> float:
    """Peak of a magnitude on some pixels over the median of the rows they lie in."""
    return float(image[pixels].max() / np.median(image[pixels.any(axis=1)]))


def suppressed_alone(cleaned: Cleaned, data: ComplexArray) -> ComplexArray:
    """Suppress data by the mask and the amplitudes B of the aperture's iteration, held fixed.

    A linear operation.
    """
    frames = zip(data, cleaned.aperture.operators, cleaned.courses, strict=True)
    return np.stack([_frame_alone(cleaned, *frame) for frame in frames])


def _frame_alone(
    cleaned: Cleaned, data: ComplexArray, operator_on: OperatorOn, course: Iterated
) -> ComplexArray:
    """Suppress the data (polarization, pair, frequency) of a frame by its courses' amplitudes."""
    stage = cleaned.stage
    mask = cleaned.masks["pixel"]
    under = {
        int(r): operator_on(stage.points[mask & (stage.region == r)])
        for r in np.unique(stage.region[mask])
    }
    iterates = [data]
    for B in course.amplitude:
        rest = iterates[-1]
        for r, operator in under.items():
            x_hat = operator.adjoint(iterates[-1])
            rest = rest - np.float32(B[r, 0]) * operator.forward(x_hat)  # Eq. 5 and 6
        iterates.append(rest)
    combination = stage.settings.combination
    best = fallen_back(course, combination).get(0)
    iterations = TABLE_II[combination] if best is None else (best,)
    return np.asarray(
        np.mean([iterates[number] for number in iterations], axis=0), dtype=np.complex64
    )


def _record_alarms(
    records: LaneRecords, cleaned: Cleaned, levels: dict[str, FloatArray], recipe: FuseRecipe
) -> None:
    """Record the alarms of a frame by variant, in the lane frame."""
    for name, level in levels.items():
        alarms = frame_alarms(level, cleaned.stage.grid, recipe.area, recipe.score.radius)
        x, y, _ = scan_to_lane(ground_points(alarms), cleaned.pose).T
        alarms = alarms.rename(columns={"x": "across", "y": "ahead"}).assign(
            variant=name, frame=cleaned.index, x=x, y=y
        )
        rows: list[dict[Any, Any]] = alarms.to_dict("records")
        records.alarms += rows
