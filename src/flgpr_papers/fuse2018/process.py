"""What is done to the frames of a lane: thresholds from the calibration lane, masks, suppression, alarms."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr
from numpy.typing import NDArray

from flgpr.chain.passes import Arrays
from flgpr.chain.progress import Track
from flgpr.chain.stages.masks import Aperture, MaskedSuppression
from flgpr.clutter import (
    TABLE_II,
    Iterated,
    averaged_frames,
    equal_cost,
    iterate_frames,
    measured_coherence,
    suppress_by_model,
)
from flgpr.model import Grid, ground_points, lane_to_scan, scan_to_lane
from flgpr.screen import MeanViewSums, prescreen
from flgpr_papers.fuse2018.lanes import Frames, FuseRecipe, local, trained

BoolArray = NDArray[np.bool_]
ComplexArray = NDArray[np.complex64]
FloatArray = NDArray[np.float64]

VARIANTS = {
    "original": "original image",
    "iteration": "iteration, one reflectivity for all frames (the paper's form)",
    "regions": "iteration, masks intersected by connected region",
    "per frame": "iteration, a reflectivity for every frame",
    "least squares": "least squares at equal cost, one reflectivity for all frames",
    "least squares per frame": "least squares at equal cost, a reflectivity for every frame",
    "least squares spared": "least squares, the road fitted too and not subtracted, as many iterations",
    "L band alone": "iteration, masks from VV and VH alone",
}
"""What is compared, and how it is called in full."""
_FORMS: dict[str, dict[str, str]] = {
    "iteration": {},
    "regions": {"intersect": "region"},
    "least squares": {"method": "least-squares"},
    "least squares spared": {"method": "least-squares-spared"},
}
"""Settings of the detection chain's stage that make a variant."""


@dataclass(frozen=True)
class Calibration:
    """What the calibration lane teaches."""

    learnt: Arrays  #: thresholds of the masks as the stage takes them, and the looks at targets that they rest on
    #: (row,) median magnitude of VV between the roadsides at every distance ahead: alarms are measured in units of it
    background: FloatArray


def calibrate(frames: Frames, recipe: FuseRecipe, track: Track) -> Calibration:
    """Learn thresholds and background from the calibration lane, whose targets are known."""
    stage, rows = frames.stage, []
    examples, targets = stage.calibration(stage.settings), ground_points(frames.truth)
    road = np.abs(stage.grid.x) < recipe.mask.roadside[0]
    whole = range(recipe.image.frames - 1, len(frames))
    for k in track(whole, "calibration lane", len(whole)):
        one = stage.aperture(k)
        stage.learn_from(one, lane_to_scan(targets, frames.pose(k)), examples)
        rows.append(np.median(np.abs(one.vv[:, road]), axis=1))
    learnt, _ = stage.fit(stage.settings, [examples.state()])
    return Calibration(learnt, np.mean(rows, axis=0))


@dataclass
class LaneRecords:
    """What a lane's frames yield, row by row."""

    #: variant, frame, x, y (m, lane frame), across, ahead (m, scan frame), magnitude over the background
    alarms: list[dict[str, Any]] = field(default_factory=list)
    boxes: list[dict[str, Any]] = field(default_factory=list)  #: frame, object, side, stage, power in the box
    #: frame, target, variant, peak, whether the mask covers the original peak
    mines: list[dict[str, Any]] = field(default_factory=list)
    #: frame, variant, iterations kept, rise at which it stopped, residual, share of pixels masked, CPU seconds
    courses: list[dict[str, Any]] = field(default_factory=list)
    #: frame, loss of the coherent sum at the strongest pixels, dB
    coherence: list[dict[str, Any]] = field(default_factory=list)
    #: frame, target, variant, change of what the mine alone gives at its peak, dB
    own: list[dict[str, Any]] = field(default_factory=list)
    maps: Arrays = field(default_factory=dict)  #: mean magnitude over the background of all looks, by variant


@dataclass(frozen=True)
class Cleaned:
    """An aperture with its masks and what each variant made of it."""

    index: int  #: the latest frame
    forms: dict[str, MaskedSuppression]  #: the stage by variant, as far as it knows them
    aperture: Aperture
    masks: dict[str, BoolArray]  #: mixed masks: "pixel", "region" and "L"
    course: Iterated  #: the paper's iteration
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
    return {name: trained(frames.stage, calibration.learnt, **changes) for name, changes in _FORMS.items()}


def clean(forms: dict[str, MaskedSuppression], index: int, variants: Sequence[str]) -> Cleaned:
    """Form the masks of the aperture that ends with a frame and suppress what lies under them."""
    stage = forms["iteration"]
    one, settings = stage.aperture(index), stage.settings
    b, whole = one.data[:, stage.setup.imaged], one.stack_on(stage.points)
    masks = {"pixel": stage.mask(one), "region": forms["regions"].mask(one), "L": stage.mask(replace(one, second=None))}
    mask = masks["pixel"]
    before = time.process_time()
    main = stage.iterated(one, mask)
    spent = {"iteration": time.process_time() - before}

    def iterated(name: str) -> tuple[ComplexArray, list[Iterated]]:
        course = main if name == "pixel" else stage.iterated(one, masks[name])
        return stage.cleaned(one, masks[name], course), [course]

    def per_frame() -> tuple[ComplexArray, list[Iterated]]:
        courses = iterate_frames(b, one.operators, stage.points, mask, stage.region, settings.iterations)
        return averaged_frames(courses, settings.combination), courses

    def least_squares_per_frame() -> tuple[ComplexArray, list[Iterated]]:
        if not mask.any():
            return b, []
        number, pairs = equal_cost(main, mask, stage.region), zip(b, one.operators, strict=True)
        return np.stack([suppress_by_model(data, make(stage.points[mask]), number).data for data, make in pairs]), []

    how: dict[str, Callable[[], tuple[ComplexArray, list[Iterated]]]] = {
        "original": lambda: (b, []),
        "iteration": lambda: iterated("pixel"),
        "regions": lambda: iterated("region"),
        "per frame": per_frame,
        "least squares": lambda: (forms["least squares"].cleaned(one, mask, main), []),
        "least squares per frame": least_squares_per_frame,
        "least squares spared": lambda: (forms["least squares spared"].cleaned(one, mask, main), []),
        "L band alone": lambda: iterated("L"),
    }
    made, images, rows = {}, {}, []
    norm = float(np.linalg.norm(b))
    for variant in variants:
        before = time.process_time()
        data, courses = how[variant]()
        cpu = time.process_time() - before + spent.get(variant, 0.0)
        made[variant], images[variant] = data, whole.adjoint(data)[0, 0]
        under = masks[{"regions": "region", "L band alone": "L"}.get(variant, "pixel")]
        rises = [course.rise for course in courses if course.rise is not None]
        rows.append(
            {
                "frame": index,
                "variant": variant,
                "iterations": min((course.iterations for course in courses), default=0),
                "stopped": len(rises),
                "rise": max(rises, default=np.nan),
                "residual": float(np.linalg.norm(data)) / norm,
                "masked": float(under.mean()),
                "cpu": cpu,
            }
        )
    return Cleaned(index, forms, one, masks, main, made, images, rows)


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

    The truth is used to say where mines and roadside objects are when something is measured, never to form a mask, to
    suppress or to raise an alarm.
    """
    records, forms = LaneRecords(), stage_forms(frames, calibration)
    sums = MeanViewSums(recipe.map_grid, recipe.score.y[1])
    latest = range(recipe.image.frames - 1, len(frames), every)
    shown = min(latest, key=lambda k: abs(frames.pose(k)[1] - recipe.study.example))
    for k in track(latest, f"lane {frames.name}", len(latest)):
        cleaned = clean(forms, k, variants)
        records.courses += cleaned.rows
        _record_boxes(records, cleaned, frames, recipe)
        _record_mines(records, cleaned, frames, recipe)
        _record_own(records, cleaned, frames, recipe)
        levels = {name: np.abs(image) / calibration.background[:, None] for name, image in cleaned.images.items()}
        _record_alarms(records, cleaned, levels, recipe)
        sums.add(np.stack(list(levels.values())).astype(np.float32), cleaned.stage.grid, cleaned.pose)
        loss = measured_coherence(cleaned.aperture.looks).loss_db
        records.coherence += [{"frame": k, "loss_db": float(value)} for value in loss]
        if example is not None and k == shown:
            example(cleaned)
    records.maps = dict(zip(variants, sums.result()[0], strict=True))
    return records


def roadside_objects(frames: Frames, pose: FloatArray, recipe: FuseRecipe) -> pd.DataFrame:
    """List the bushes and posts whose boxes lie within a frame's image, at the roadside; ``x``, ``y`` in its frame."""
    (near, far), margin = recipe.mask.roadside, recipe.boxes.margin
    table = frames.objects[frames.objects["kind"].isin(["bush", "post"])]
    x, y = local(table, pose).T
    good = (np.abs(x) >= near) & (np.abs(x) <= far - margin)
    good &= (y >= recipe.image.y[0] + margin) & (y <= recipe.image.y[1] - margin)
    return table.assign(x=x, y=y)[good]


def box_of(grid: Grid, x: float, y: float, side: float) -> BoolArray:
    """Mark the pixels of a square box about a place, m."""
    columns, rows = np.abs(grid.x - x) <= side / 2, np.abs(grid.y - y) <= side / 2
    return rows[:, None] & columns[None, :]


def _halo(grid: Grid, place: FloatArray, radius: float) -> BoolArray:
    """Mark the pixels within a radius of a place, m."""
    return np.asarray(np.hypot(grid.x - place[0], grid.y[:, None] - place[1]) <= radius)


def _targets(frames: Frames, cleaned: Cleaned, recipe: FuseRecipe) -> list[tuple[Any, FloatArray]]:
    """Rows of the mines in the detection area, and their places in the scan frame."""
    places = zip(frames.truth.itertuples(), local(frames.truth, cleaned.pose), strict=True)
    return [(row, place) for row, place in places if recipe.area.contains(*place)]


def stage_images(cleaned: Cleaned, chosen: BoolArray) -> dict[str, ComplexArray]:
    """Image iterations ("iteration 0" ...) and the combinations of Table II ("#0" ...) on some pixels."""
    course, points = cleaned.course, cleaned.stage.points[chosen]
    stack = cleaned.aperture.stack_on(points)
    kept = [stack.adjoint(data)[0, 0] for data in course.data]
    single = {i: kept[min(i, course.iterations)] for i in range(course.asked + 1)}
    images = {f"iteration {i}": image for i, image in single.items()}
    return images | {f"#{c}": np.mean([single[i] for i in parts], axis=0) for c, parts in TABLE_II.items()}


def _record_boxes(records: LaneRecords, cleaned: Cleaned, frames: Frames, recipe: FuseRecipe) -> None:
    objects = roadside_objects(frames, cleaned.pose, recipe)
    if objects.empty:
        return
    boxes = [box_of(cleaned.stage.grid, x, y, recipe.boxes.side) for x, y in objects[["x", "y"]].to_numpy()]
    together = np.any(boxes, axis=0)
    stages = stage_images(cleaned, together) | {name: image[together] for name, image in cleaned.images.items()}
    sides = np.where(objects["x"] < 0, "left", "right")
    for name, side, box in zip(objects["object_id"], sides, boxes, strict=True):
        inside = box[together]
        records.boxes += [
            {"frame": cleaned.index, "object": name, "side": side, "stage": stage}
            | {"power": float(np.mean(np.abs(image[inside]) ** 2))}
            for stage, image in stages.items()
        ]


def _record_mines(records: LaneRecords, cleaned: Cleaned, frames: Frames, recipe: FuseRecipe) -> None:
    strength = np.abs(cleaned.aperture.vv)
    for row, place in _targets(frames, cleaned, recipe):
        halo = _halo(cleaned.stage.grid, place, recipe.score.halo / 2)
        at = np.unravel_index(int(np.where(halo, strength, -1).argmax()), halo.shape)
        records.mines += [
            {"frame": cleaned.index, "target": row.target_id, "variant": name, "depth": row.depth}
            | {"peak": float(np.abs(image[halo]).max()), "masked": bool(cleaned.masks["pixel"][at])}
            for name, image in cleaned.images.items()
        ]


def _record_own(records: LaneRecords, cleaned: Cleaned, frames: Frames, recipe: FuseRecipe) -> None:
    """Follow what the mines alone add to the data through what was done to the data as they are."""
    stage, one, mask = cleaned.stage, cleaned.aperture, cleaned.masks["pixel"]
    targets = _targets(frames, cleaned, recipe)
    if frames.mines is None or not targets or not mask.any():
        return
    alone = frames.mines[stage.setup.imager.scans[: cleaned.index + 1][-len(one.data) :]]
    made = {"original": alone, "iteration": suppressed_alone(cleaned, alone)}
    without = one.data.copy()
    without[:, stage.setup.imaged] -= alone
    for name in ("least squares", "least squares spared"):
        if name in cleaned.images:
            # Its steps depend on the data: what the mines add is what they change.
            rest = cleaned.forms[name].cleaned(replace(one, data=without), mask, cleaned.course)
            made[name] = cleaned.data[name] - rest
    whole = one.stack_on(stage.points)
    level = {name: np.abs(whole.adjoint(data)[0, 0]) for name, data in made.items()}
    for row, place in targets:
        halo = _halo(stage.grid, place, recipe.score.halo / 2)
        at = np.unravel_index(int(np.where(halo, level["original"], -1).argmax()), halo.shape)
        records.own += [
            {"frame": cleaned.index, "target": row.target_id, "variant": name, "masked": bool(mask[at])}
            | {"change_db": float(20 * np.log10(image[at] / level["original"][at]))}
            for name, image in level.items()
            if name != "original"
        ]


def suppressed_alone(cleaned: Cleaned, data: ComplexArray) -> ComplexArray:
    """Suppress data by the mask and the amplitudes B of the aperture's iteration, held fixed: a linear operation."""
    stage, course, mask, kept = cleaned.stage, cleaned.course, cleaned.masks["pixel"], [data]
    used = np.unique(stage.region[mask])
    parts = {int(r): cleaned.aperture.stack_on(stage.points[mask & (stage.region == r)]) for r in used}
    for amplitude in course.amplitude[: course.iterations]:
        rest = kept[-1]
        for r, stack in parts.items():
            rest = rest - np.float32(amplitude[r, 0]) * stack.forward(stack.adjoint(kept[-1]))
        kept.append(rest)
    wanted = TABLE_II[stage.settings.combination]
    return np.asarray(np.mean([kept[min(i, course.iterations)] for i in wanted], axis=0), dtype=np.complex64)


def _record_alarms(records: LaneRecords, cleaned: Cleaned, levels: dict[str, FloatArray], recipe: FuseRecipe) -> None:
    grid, area, radius = cleaned.stage.grid, recipe.area, recipe.score.radius
    # Pixels beyond the area's border take part, so that the flank of a peak outside is no alarm inside.
    rows = np.flatnonzero((grid.y >= area.y_min - radius) & (grid.y <= area.y_max + radius))
    columns = np.flatnonzero((grid.x >= area.x_min - radius) & (grid.x <= area.x_max + radius))
    axes = {"y": grid.y[rows], "x": grid.x[columns]}
    for name, level in levels.items():
        view = xr.DataArray(level[np.ix_(rows, columns)], dims=("y", "x"), coords=axes)
        found = prescreen(view, area, radius, density=10.0)
        found = found[area.contains(found["x"], found["y"])]
        x, y, _ = scan_to_lane(ground_points(found), cleaned.pose).T
        found = found.rename(columns={"x": "across", "y": "ahead"}).assign(variant=name, frame=cleaned.index, x=x, y=y)
        records.alarms += found.to_dict("records")
