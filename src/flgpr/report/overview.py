"""What a report begins with: the road from above, its alarms, and the places that stand out."""

from __future__ import annotations

import math
from collections.abc import Hashable, Mapping
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from flgpr.model import Lane
from flgpr.report.figures import DYNAMIC_RANGE
from flgpr.report.kit import decibels, lane_patch, shaded, strongest
from flgpr.results.result import Result, thinned
from flgpr.results.view_files import EARLIER, read_layer
from flgpr.scoring import Score
from flgpr.screen import select

_ROAD = "#d9cdb8"
_GROUND = "#eeeae0"
_FOUND = "#00734d"
_MISSED = "#b3261e"
_FALSE = "#8a5300"
_WEAK = "#8b8577"
_WIDTH = 9.6  # inches, of a picture of a long lane
_NARROW = 5.4  # inches, of a picture that has another beside it
_LOWEST = 1.3  # inches, of a strip of road
_HIGHEST = 3.6
_SHORT = 3.0  # lanes up to so many times their width fit beside another picture
_MOST_LANES = 6
_COLUMNS = 2400  # a figure cannot show more
_VERGE = 0.35  # of the lane's width, shown on either side
_MOST_VERGE = 1.0  # m
_LARGEST_MARK = 140  # points², of the surest alarm
_SMALLEST_MARK = 12
_MOST_ALARMS = 500  # that are drawn
MOST_PLACES = 40
"""Places that are numbered and explained."""
_EDGE = 0.25  # m
_MOSTLY = 0.5  # of an alarm's amplitude


def is_short(lane: Lane) -> bool:
    """Return whether the picture of a lane leaves room for another one beside it."""
    return lane.y_max - lane.y_min <= _SHORT * (lane.x_max - lane.x_min)


def score_overview(scored: Score, objects: pd.DataFrame | None = None) -> Figure | None:
    """Draw the road, what became of its targets, and the alarms at the operating point.

    Parameters
    ----------
    scored : Score
        A score; one that counts the area of frames has no road, and gives None.
    objects : pandas.DataFrame, optional
        Other objects, with ``x``, ``y`` (m) and ``kind``.

    Returns
    -------
    Figure or None
        A strip for each lane, at most six.
    """
    lanes = scored.matched.lanes
    if scored.rules.area == "frames" or not lanes:
        return None
    threshold = scored.point["threshold"]
    figure, strips = _strips(lanes)
    for number, axes in enumerate(strips):
        alarms = scored.labels[scored.matched.alarm_lane == number]
        targets = scored.outcomes[scored.matched.target_lane == number]
        if objects is not None:
            for kind, group in objects.groupby("kind", sort=False):
                marker = "s" if kind == "post" else "D"
                label = f"{kind}, no target"
                _draw_points(axes, group, marker, "#4a5560", 6, label, filled=True)
        # The mark of a target that is found stands for the alarm that hits it.
        is_raised = alarms["confidence"] >= threshold
        _draw_points(axes, alarms[~is_raised], ".", _WEAK, 3, "alarm too weak to count")
        raised = alarms[is_raised]
        _draw_points(axes, raised[raised["label"] == "false"], "x", _FALSE, 9, "false alarm")
        outside = raised[raised["label"] == "outside"]
        _draw_points(axes, outside, "+", _WEAK, 9, "alarm beside the lane")
        detected = targets[targets["found"]]
        missed = targets[~targets["found"]]
        _draw_points(axes, detected, "o", _FOUND, 11, f"{scored.noun} found", filled=True)
        _draw_points(axes, detected, "$✓$", "white", 6, None)
        _draw_points(axes, missed, "o", _MISSED, 11, f"{scored.noun} missed")
    _finish(figure, strips)
    return figure


def alarm_overview(lane: Lane, alarms: pd.DataFrame, border: float | None = None) -> Figure:
    """Draw the road and the alarms: those that stand out by their number, else the surer the larger.

    Parameters
    ----------
    lane : Lane
        The lane.
    alarms : pandas.DataFrame
        Alarms with ``x``, ``y`` (m) and ``confidence``, the most confident first.
    border : float, optional
        Confidence from which on alarms stand out; None where nobody can say.

    Returns
    -------
    matplotlib.figure.Figure
        A strip of road.
    """
    figure, strips = _strips({"": lane})
    axes = strips[0]
    shown = alarms[:_MOST_ALARMS]
    if border is None:
        sizes = np.linspace(_LARGEST_MARK, _SMALLEST_MARK, len(shown))
        _draw_rings(axes, shown, sizes, _FALSE, "alarm, the surer the larger")
    else:
        outstanding = outstanding_alarms(shown, lane, border)
        others = shown.drop(outstanding.index)
        is_strong = others["confidence"] >= border
        _draw_points(axes, others[~is_strong], ".", _WEAK, 3, "weak")
        _draw_points(axes, others[is_strong], "+", _FALSE, 9, "stands out beside the lane")
        _draw_rings(axes, outstanding, _LARGEST_MARK, _MISSED, "stands out, by its rank")
        for rank, alarm in enumerate(outstanding[:MOST_PLACES].itertuples(), 1):
            axes.annotate(
                str(rank),
                (alarm.y, alarm.x),
                (9, 5),
                textcoords="offset points",
                color=_MISSED,
                weight="bold",
                zorder=6,
            )
    _finish(figure, strips)
    return figure


def _draw_rings(
    axes: Axes, alarms: pd.DataFrame, sizes: NDArray[np.float64] | float, color: str, label: str
) -> None:
    """Draw alarms as rings of sizes, points²."""
    if len(alarms):
        axes.scatter(
            alarms["y"], alarms["x"], s=sizes, fc="none", ec=color, lw=1.6, label=label, zorder=5
        )


ROADSIDE = (
    "left of the line as it was measured, right of it with what outshines the lane from the roadside "
    "taken out. Rings are alarms"
)
DAYS = (
    "left of the line at the earlier drive, right of it today. Rings are alarms, weak ones too, on "
    "what the earlier drive does not predict"
)
"""What pictures before and after show."""


def before_and_after(result: Result) -> tuple[Figure, Figure, str] | None:
    """Draw the road at an earlier drive and today, or with the roadside taken out, alike to the pixel.

    Levels of the roadside are in dB over the strongest pixel in the lane of the first, so that both
    have one scale. Drives have gains of their own: their medians have one colour.

    Parameters
    ----------
    result : Result
        The result.

    Returns
    -------
    tuple, or None
        Before and after, and what they show; None where the result has no earlier drive and none of
        its detections took anything out.
    """
    main, *variants = result.detections
    then, now = (_layer_of(result, name) for name in (EARLIER, "before"))
    if then is not None and now is not None:
        top = strongest(now, result.lane)
        gain = float(np.nanmedian(decibels(then)) - np.nanmedian(decibels(now)))
        return (
            _radar_figure(then, main.alarms, result.lane, top + gain),
            _radar_figure(now, main.alarms, result.lane, top),
            DAYS,
        )
    cleaned = [variant for variant in variants if variant.notes.get("mask_pixels")]
    if not cleaned:
        return None
    screen = result.recipe.prescreen
    before = select(main.view, screen.polarization, screen.subband)
    after = select(cleaned[0].view, screen.polarization, screen.subband)
    top = strongest(before, result.lane)
    return (
        _radar_figure(before, main.alarms, result.lane, top),
        _radar_figure(after, cleaned[0].alarms, result.lane, top),
        ROADSIDE,
    )


def _layer_of(result: Result, name: str) -> xr.DataArray | None:
    """Return a layer (y, x) of the result's view, of the channel that alarms are raised on."""
    recipe = result.recipe
    if "clutter.earlier" not in recipe.named():
        return None
    screen = recipe.prescreen if recipe.map is None else recipe.contrast
    view = result.detections[0].view
    channel = view.isel(polarization=0, subband=0).assign_coords(
        polarization=screen.polarization, subband=screen.subband
    )
    return read_layer(result.files(), name, channel)


def _radar_figure(view: xr.DataArray, alarms: pd.DataFrame, lane: Lane, top: float) -> Figure:
    """Draw a run-view (y, x) along the road with its alarms; ``top`` is the strongest level, dB."""
    width, height = _size(lane)
    figure = Figure(figsize=(width, height))
    # A fixed place, so that two such figures lie on one another.
    left = 0.65 / width
    bottom = 0.5 / height
    axes = figure.add_axes((left, bottom, 1 - 0.8 / width, 1 - 0.6 / height))
    view = thinned(view, math.ceil(view.sizes["y"] / _COLUMNS))
    level = decibels(view).T - top
    shaded(axes, view["y"], view["x"], level, (-DYNAMIC_RANGE, 0))
    axes.add_patch(lane_patch(lane, along=True, fill=False, ec="white", ls="-.", lw=1.4))
    axes.plot(alarms["y"], alarms["x"], "o", mfc="none", mec="white", ms=7, mew=1.3)
    _frame(axes, lane)
    return figure


def _size(lane: Lane) -> tuple[float, float]:
    """Return width and height of a picture of a lane, inches."""
    width = _NARROW if is_short(lane) else _WIDTH
    return width, min(max(_height_to_scale(lane, width), _LOWEST), _HIGHEST) + 0.6


def _height_to_scale(lane: Lane, width: float) -> float:
    """Return the height at which a picture of a width shows a lane to scale, inches."""
    verge = 2 * _verge(lane)
    across = lane.x_max - lane.x_min + verge
    along = lane.y_max - lane.y_min + verge
    return (width - 0.8) * across / along


def _verge(lane: Lane) -> float:
    """Return how much is shown beside a lane and beyond its ends, m."""
    return min(_VERGE * (lane.x_max - lane.x_min), _MOST_VERGE)


def _strips(lanes: Mapping[str, Lane]) -> tuple[Figure, list[Axes]]:
    """Return a figure with axes for each lane, one above the other."""
    shown = list(lanes.items())[:_MOST_LANES]
    widths, heights = zip(*(_size(lane) for _, lane in shown), strict=True)
    figure = Figure(figsize=(max(widths), sum(heights) + 0.35), layout="constrained")
    strips = list(figure.subplots(len(shown), 1, squeeze=False)[:, 0])
    for axes, (name, lane) in zip(strips, shown, strict=True):
        _frame(axes, lane)
        axes.add_patch(lane_patch(lane, along=True, fc=_ROAD, ec="#6f6552", lw=1.2, zorder=0.5))
        if name:
            axes.set_title(f"lane {name}", fontsize=9, loc="left")
    left_out = len(lanes) - len(shown)
    if left_out:
        figure.suptitle(f"the first {len(shown)} of {len(lanes)} lanes", fontsize=9)
    return figure, strips


def _frame(axes: Axes, lane: Lane) -> None:
    """Set limits and labels: along the road to the right, across it downwards."""
    verge = _verge(lane)
    axes.set_xlim(lane.y_min - verge, lane.y_max + verge)
    axes.set_ylim(lane.x_max + verge, lane.x_min - verge)
    width, height = _size(lane)
    is_to_scale = math.isclose(height - 0.6, _height_to_scale(lane, width), rel_tol=1e-6)
    axes.set_aspect("equal" if is_to_scale else "auto")
    scale = "" if is_to_scale else "; not to scale"
    axes.set_xlabel(f"along the road (m), driving to the right{scale}", fontsize=8)
    axes.set_ylabel("across (m)", fontsize=8)
    axes.tick_params(labelsize=8)
    axes.set_facecolor(_GROUND)


def _draw_points(
    axes: Axes,
    table: pd.DataFrame,
    marker: str,
    colour: str,
    size: float,
    label: str | None,
    filled: bool = False,
) -> None:
    """Draw the places of a table, m, unless it is empty."""
    if table.empty:
        return
    is_sign = marker.startswith("$")  # a sign of Matplotlib's math text, such as a tick
    axes.plot(
        table["y"],
        table["x"],
        ls="none",
        marker=marker,
        ms=size,
        mew=0 if is_sign else 2,
        mec=colour,
        mfc=colour if filled or is_sign else "none",
        label=label,
        zorder=4,
    )


def _finish(figure: Figure, strips: list[Axes]) -> None:
    """Add a legend of what is drawn, each entry once."""
    entries: dict[Any, Any] = {}
    for axes in strips:
        for handle, label in zip(*axes.get_legend_handles_labels(), strict=True):
            entries.setdefault(label, handle)
    if entries:
        figure.legend(
            entries.values(),
            entries.keys(),
            loc="outside lower center",
            ncols=3 if figure.get_figwidth() < _WIDTH else 6,
            fontsize=8,
            frameon=False,
        )


def places_that_stand_out(result: Result) -> list[list[str]]:
    """Return rank, name, place and a sentence of every alarm that stands out, at most 40."""
    stands_out = result.manifest["run"].get("stands_out", {})
    border = stands_out.get("border")
    if border is None:
        return []
    outstanding = outstanding_alarms(result.alarms, result.lane, border)
    rows = []
    for rank, alarm in enumerate(outstanding[:MOST_PLACES].to_dict("records"), 1):
        side = "left" if alarm["x"] < 0 else "right"
        place = f"{alarm['y']:.2f} m along, {abs(alarm['x']):.2f} m {side}"
        rows.append(
            [
                str(rank),
                str(alarm["alarm_id"]),
                place,
                alarm_sentence(alarm, result.lane, border),
            ]
        )
    return rows


def outstanding_alarms(alarms: pd.DataFrame, lane: Lane, border: float) -> pd.DataFrame:
    """Return the alarms in the lane of at least a confidence."""
    return alarms[lane.contains(alarms["x"], alarms["y"]) & (alarms["confidence"] >= border)]


def alarm_sentence(alarm: Mapping[Hashable, Any], lane: Lane, border: float) -> str:
    """Return why an alarm stands out, and what speaks against it.

    Parameters
    ----------
    alarm : mapping
        Its row of the table of alarms.
    lane : Lane
        The lane.
    border : float
        Confidence from which on alarms stand out.

    Returns
    -------
    str
        Its strength, the scans that saw it, the roadside, its height and the lane's edge.
    """
    confidence = float(alarm["confidence"])
    parts = [f"confidence {confidence:.3g} ({border:.3g} suffices)"]
    if not pd.isna(alarm.get("p")):
        parts = [f"probability {alarm['p']:.2f} where mines are as frequent as in training"]
    scans = alarm.get("scans")
    if scans is not None and not pd.isna(scans):
        seen = f"seen by {scans:.0f} scans"
        parts.append("seen by one scan only: take another look" if scans == 1 else seen)
    roadside = alarm.get("roadside")
    if roadside is not None and not pd.isna(roadside):
        share = f"{min(100 * roadside, 100):.0f} %"
        is_mostly = roadside >= _MOSTLY
        parts.append(f"{share} of it is the roadside's" if is_mostly else "not the roadside's")
    if not pd.isna(alarm.get("height")):
        height, low, high = (alarm[f"height{end}"] for end in ("", "_low", "_high"))
        parts.append(f"at a height of {height:.2f} m ({low:.2f} to {high:.2f})")
    margin = min(alarm["x"] - lane.x_min, lane.x_max - alarm["x"])
    if margin < _EDGE:
        parts.append("at the edge of the lane")
    return ", ".join(parts)
