"""What is done to the frames of a lane: thresholds from the calibration lane, masks, suppression, alarms."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr
from numpy.typing import NDArray

from flgpr.chain.progress import Track
from flgpr.clutter import (
    TABLE_II,
    Iterated,
    ThresholdCalibration,
    Thresholds,
    averaged,
    averaged_frames,
    equal_cost,
    iterate_frames,
    iterate_suppression,
    measured_coherence,
    mixed_mask,
    suppress_by_model,
)
from flgpr.model import Lane
from flgpr.screen import prescreen
from flgpr_papers.fuse2018.lanes import Aperture, Frames, aperture
from flgpr_papers.fuse2018.recipe import FuseRecipe

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


@dataclass(frozen=True)
class Calibration:
    """What the calibration lane teaches."""

    thresholds: Thresholds  #: of the masks
    #: (row,) median magnitude of VV between the roadsides at every distance ahead: alarms are measured in units of it
    background: FloatArray
    looks: NDArray[np.int64]  #: (region,) looks at targets that the thresholds rest on


def calibrate(frames: Frames, recipe: FuseRecipe, track: Track) -> Calibration:
    """Learn thresholds and background from the calibration lane, whose targets are known."""
    learnt = ThresholdCalibration(len(recipe.image.edges) - 1, recipe.mask.response_db)
    rows: list[FloatArray] = []
    latest = range(recipe.image.frames - 1, len(frames))
    for k in track(latest, "calibration lane", len(latest)):
        one = aperture(frames, k, recipe.image)
        halos = [one.halo(x, y, recipe.mask.halo) for x, y in _within(frames.truth, one, recipe.mask.halo)]
        away = np.abs(one.across)
        near, far = recipe.mask.roadside
        learnt.add(one.vv, one.vh, one.region, halos, (away >= near) & (away <= far), one.x)
        rows.append(np.median(np.where(away < near, np.abs(one.vv), np.nan)[:, away[0] < near], axis=1))
    return Calibration(learnt.result(), np.mean(rows, axis=0), learnt.targets)


def _within(table: pd.DataFrame, one: Aperture, margin: float) -> FloatArray:
    """Places (n, 2) that lie within an aperture's image by a margin, m."""
    x_min, x_max, y_min, y_max = one.grid.extent()
    place = table[["x", "y"]].to_numpy(dtype=np.float64)
    x, y = place.T
    good = (x >= x_min + margin) & (x <= x_max - margin) & (y >= y_min + margin) & (y <= y_max - margin)
    return np.asarray(place[good])


@dataclass
class LaneRecords:
    """What a lane's frames yield, row by row."""

    #: variant, frame, x, y (m), magnitude over the background
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
    maps: dict[str, FloatArray] = field(default_factory=dict)  #: lane maps
    looks: FloatArray | None = None


@dataclass(frozen=True)
class Cleaned:
    """An aperture with its masks and what each variant made of it."""

    aperture: Aperture  #: the aperture
    masks: dict[str, BoolArray]  #: mixed masks: "pixel", "region" and "L"
    course: Iterated  #: the paper's iteration
    data: dict[str, ComplexArray]  #: (frame, 1, pair, frequency) by variant
    images: dict[str, ComplexArray]  #: by variant
    rows: list[dict[str, Any]]  #: one per variant, for ``LaneRecords.courses``


def clean(one: Aperture, thresholds: Thresholds, recipe: FuseRecipe, variants: Sequence[str]) -> Cleaned:
    """Form the masks of an aperture and suppress what lies under them."""
    first = next((name for name in variants if name == "iteration" or name.startswith("least squares")), None)
    if first != "iteration":
        raise ValueError(f"variants must name iteration before any least-squares form, got {', '.join(variants)}")
    side = recipe.mask.roadside
    common = (thresholds, one.region, one.across)
    masks = {
        "pixel": mixed_mask(one.vv, one.vh, *common, one.x, "pixel", side),
        "region": mixed_mask(one.vv, one.vh, *common, one.x, "region", side),
        "L": mixed_mask(one.vv, one.vh, *common, None, "pixel", side),
    }
    pixels, count = one.grid.points(), recipe.suppress.iterations
    whole = one.stack_on(pixels)
    main: list[Iterated] = []

    def iterated(name: str) -> tuple[ComplexArray, list[Iterated]]:
        course = iterate_suppression(one.data, one.stack_on, pixels, masks[name], one.region, count)
        if name == "pixel":
            main.append(course)
        return averaged(course, recipe.suppress.combination), [course]

    def per_frame() -> tuple[ComplexArray, list[Iterated]]:
        courses = iterate_frames(one.data, one.operators, pixels, masks["pixel"], one.region, count)
        return averaged_frames(courses, recipe.suppress.combination), courses

    def least_squares(split: bool) -> tuple[ComplexArray, list[Iterated]]:
        mask = masks["pixel"]
        if not mask.any():
            return one.data, []
        number, points = equal_cost(main[0], mask, one.region), pixels[mask]
        if not split:
            return road_spared(one, one.data, mask, number, 0.0), []
        pairs = zip(one.data, one.operators, strict=True)
        return np.stack([suppress_by_model(b, make(points), number).data for b, make in pairs]), []

    def spared() -> tuple[ComplexArray, list[Iterated]]:
        mask = masks["pixel"]
        number = equal_cost(main[0], mask, one.region)
        return road_spared(one, one.data, mask, number, side[0]), []

    how: dict[str, Callable[[], tuple[ComplexArray, list[Iterated]]]] = {
        "original": lambda: (one.data, []),
        "iteration": lambda: iterated("pixel"),
        "regions": lambda: iterated("region"),
        "per frame": per_frame,
        "least squares": lambda: least_squares(False),
        "least squares per frame": lambda: least_squares(True),
        "least squares spared": spared,
        "L band alone": lambda: iterated("L"),
    }
    made, images, rows = {}, {}, []
    norm = float(np.linalg.norm(one.data))
    for variant in variants:
        before = time.process_time()
        data, courses = how[variant]()
        spent = time.process_time() - before
        made[variant], images[variant] = data, whole.adjoint(data)[0, 0]
        mask = masks[{"regions": "region", "L band alone": "L"}.get(variant, "pixel")]
        rises = [course.rise for course in courses if course.rise is not None]
        rows.append(
            {
                "frame": one.frames[-1],
                "variant": variant,
                "iterations": min((course.iterations for course in courses), default=0),
                "stopped": len(rises),
                "rise": max(rises, default=np.nan),
                "residual": float(np.linalg.norm(data)) / norm,
                "masked": float(mask.mean()),
                "cpu": spent,
            }
        )
    return Cleaned(one, masks, main[0], made, images, rows)


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
    records = LaneRecords()
    latest = range(recipe.image.frames - 1, len(frames), every)
    shown = min(latest, key=lambda k: abs(frames.pose["l"][k, 1] - recipe.study.example))
    for k in track(latest, f"lane {frames.name}", len(latest)):
        cleaned = clean(aperture(frames, k, recipe.image), calibration.thresholds, recipe, variants)
        records.courses += cleaned.rows
        _record_boxes(records, cleaned, frames, recipe)
        _record_mines(records, cleaned, frames, recipe)
        _record_alarms(records, cleaned, calibration, recipe)
        _record_own(records, cleaned, frames, recipe)
        loss = measured_coherence(cleaned.aperture.looks).loss_db
        records.coherence += [{"frame": k, "loss_db": float(value)} for value in loss]
        if example is not None and k == shown:
            example(cleaned)
    return records


def roadside_objects(frames: Frames, one: Aperture, recipe: FuseRecipe) -> pd.DataFrame:
    """List the bushes and posts whose boxes lie within an aperture's image, at the roadside."""
    near, far = recipe.mask.roadside
    table = frames.objects[frames.objects["kind"].isin(["bush", "post"])]
    away = np.abs(table["x"] - one.origin[0])
    ahead = table["y"] - one.origin[1]
    margin = recipe.boxes.margin
    good = (away >= near) & (away <= far - margin)
    good &= (ahead >= recipe.image.y[0] + margin) & (ahead <= recipe.image.y[1] - margin)
    return table[good]


def box_of(one: Aperture, x: float, y: float, side: float) -> BoolArray:
    """Mark the pixels of a square box about a place, m."""
    columns, rows = np.abs(one.grid.x - x) <= side / 2, np.abs(one.grid.y - y) <= side / 2
    return rows[:, None] & columns[None, :]


def stage_images(cleaned: Cleaned, chosen: BoolArray) -> dict[str, ComplexArray]:
    """Image the paper's iterations 0 to 7 and the combinations of Table II on some pixels.

    "iteration 0" and so on, "#0" and so on.
    """
    course, points = cleaned.course, cleaned.aperture.grid.points()[chosen]
    stack = cleaned.aperture.stack_on(points)
    kept = [stack.adjoint(data)[0, 0] for data in course.data]
    single = {i: kept[min(i, course.iterations)] for i in range(course.asked + 1)}
    images = {f"iteration {i}": image for i, image in single.items()}
    return images | {f"#{c}": np.mean([single[i] for i in parts], axis=0) for c, parts in TABLE_II.items()}


def _record_boxes(records: LaneRecords, cleaned: Cleaned, frames: Frames, recipe: FuseRecipe) -> None:
    one = cleaned.aperture
    objects = roadside_objects(frames, one, recipe)
    if objects.empty:
        return
    boxes = [box_of(one, x, y, recipe.boxes.side) for x, y in objects[["x", "y"]].to_numpy()]
    together = np.any(boxes, axis=0)
    stages = stage_images(cleaned, together) | {name: image[together] for name, image in cleaned.images.items()}
    sides = np.where(objects["x"] < one.origin[0], "left", "right")
    for name, side, box in zip(objects["object_id"], sides, boxes, strict=True):
        inside = box[together]
        records.boxes += [
            {"frame": one.frames[-1], "object": name, "side": side, "stage": stage}
            | {"power": float(np.mean(np.abs(image[inside]) ** 2))}
            for stage, image in stages.items()
        ]


def _record_mines(records: LaneRecords, cleaned: Cleaned, frames: Frames, recipe: FuseRecipe) -> None:
    one, radius = cleaned.aperture, recipe.score.halo / 2
    area = frame_area(one, recipe)
    for row in frames.truth.itertuples():
        x, y = float(row.x), float(row.y)  # type: ignore[arg-type]
        if not area.contains(x, y):
            continue
        halo = one.halo(x, y, radius)
        at = np.unravel_index(int(np.where(halo, np.abs(one.vv), -1).argmax()), one.grid.shape)
        records.mines += [
            {"frame": one.frames[-1], "target": row.target_id, "variant": name, "depth": row.depth}
            | {"peak": float(np.abs(image[halo]).max()), "masked": bool(cleaned.masks["pixel"][at])}
            for name, image in cleaned.images.items()
        ]


def _record_own(records: LaneRecords, cleaned: Cleaned, frames: Frames, recipe: FuseRecipe) -> None:
    """Follow what the mines alone add to the data through what was done to the data as they are."""
    one, mask, area = cleaned.aperture, cleaned.masks["pixel"], frame_area(cleaned.aperture, recipe)
    targets = [row for row in frames.truth.itertuples() if area.contains(float(row.x), float(row.y))]  # type: ignore[arg-type]
    if frames.mines is None or not targets or not mask.any():
        return
    alone = frames.mines[list(one.frames)]
    made = {"original": alone, "iteration": suppressed_alone(cleaned, alone, recipe)}
    number, road = equal_cost(cleaned.course, mask, one.region), recipe.mask.roadside[0]
    for name, half in (("least squares", 0.0), ("least squares spared", road)):
        if name in cleaned.images:
            # Its steps depend on the data: what the mines add is what they change.
            made[name] = cleaned.data[name] - road_spared(one, one.data - alone, mask, number, half)
    whole = one.stack_on(one.grid.points())
    level = {name: np.abs(whole.adjoint(data)[0, 0]) for name, data in made.items()}
    for row in targets:
        halo = one.halo(float(row.x), float(row.y), recipe.score.halo / 2)  # type: ignore[arg-type]
        at = np.unravel_index(int(np.where(halo, level["original"], -1).argmax()), one.grid.shape)
        records.own += [
            {"frame": one.frames[-1], "target": row.target_id, "variant": name, "masked": bool(mask[at])}
            | {"change_db": float(20 * np.log10(image[at] / level["original"][at]))}
            for name, image in level.items()
            if name != "original"
        ]


def road_spared(one: Aperture, data: ComplexArray, mask: BoolArray, number: int, half: float) -> ComplexArray:
    """Suppress by least squares what lies under a mask; the road, ``half`` m to either side, is fitted and stays."""
    fitted = mask | (np.abs(one.across) < half)
    return suppress_by_model(data, one.stack_on(one.grid.points()[fitted]), number, spared=~mask[fitted]).data


def suppressed_alone(cleaned: Cleaned, data: ComplexArray, recipe: FuseRecipe) -> ComplexArray:
    """Suppress data by the mask and the amplitudes B of the aperture's iteration, held fixed: a linear operation."""
    one, course, pixels = cleaned.aperture, cleaned.course, cleaned.aperture.grid.points()
    mask, kept = cleaned.masks["pixel"], [data]
    parts = {int(r): one.stack_on(pixels[mask & (one.region == r)]) for r in np.unique(one.region[mask])}
    for amplitude in course.amplitude[: course.iterations]:
        rest = kept[-1]
        for r, stack in parts.items():
            rest = rest - np.float32(amplitude[r, 0]) * stack.forward(stack.adjoint(kept[-1]))
        kept.append(rest)
    wanted = TABLE_II[recipe.suppress.combination]
    return np.asarray(np.mean([kept[min(i, course.iterations)] for i in wanted], axis=0), dtype=np.complex64)


def frame_area(one: Aperture, recipe: FuseRecipe) -> Lane:
    """Give the detection area of an aperture's latest frame in the lane frame."""
    (x0, y0), (xa, xb), (ya, yb) = one.origin, recipe.score.x, recipe.score.y
    return Lane(x0 + xa, x0 + xb, y0 + ya, y0 + yb)


def _record_alarms(records: LaneRecords, cleaned: Cleaned, calibration: Calibration, recipe: FuseRecipe) -> None:
    one, area = cleaned.aperture, frame_area(cleaned.aperture, recipe)
    grid, radius = one.grid, recipe.score.radius
    # Pixels beyond the area's border take part, so that the flank of a peak outside is no alarm inside.
    rows = np.flatnonzero((grid.y >= area.y_min - radius) & (grid.y <= area.y_max + radius))
    columns = np.flatnonzero((grid.x >= area.x_min - radius) & (grid.x <= area.x_max + radius))
    place = np.round(grid.y / grid.dy).astype(int)
    inside = (grid.y >= area.y_min) & (grid.y <= area.y_max)
    size = int(np.ceil((recipe.lanes.length + 2) / grid.dy))
    count = inside & (place >= 0) & (place < size)
    if records.looks is None:
        records.looks = np.zeros(size)
    records.looks[place[count]] += 1
    for name, image in cleaned.images.items():
        level = np.abs(image) / calibration.background[:, None]
        records.maps.setdefault(name, np.zeros((size, grid.nx)))[place[count]] += level[count]
        view = xr.DataArray(
            level[np.ix_(rows, columns)], dims=("y", "x"), coords={"y": grid.y[rows], "x": grid.x[columns]}
        )
        found = prescreen(view, area, radius, density=10.0)
        found = found[area.contains(found["x"], found["y"])]
        records.alarms += [
            {"variant": name, "frame": one.frames[-1], "x": x, "y": y, "magnitude": m}
            for x, y, m in found[["x", "y", "magnitude"]].to_numpy().tolist()
        ]
