"""Pages of a trial: the crew's plan, the score of a blind test, and detectors side by side."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from flgpr.geo.anchor import Anchor
from flgpr.model import Lane
from flgpr.report.kit import render
from flgpr.report.score_page import in_words
from flgpr.scoring import SideBySide
from flgpr.trials import BlindScore, roc_figure
from flgpr.trials.figures import COLOURS

# length of lane in a row of the map, m, and rows in a picture: half a printed page
_STRIP = 30.0
_STRIPS = 4
_DIGITS = {
    "depth_m": ".3f"
}  # a mine is laid to the centimetre, and its depth is told in halves of it
_MARKS = "osD^vP*X"
_POINT = (
    "{n_detected:.0f} of {n_targets:.0f}", "{pd:.2f}", "{pd_low:.2f} to {pd_high:.2f}", "{chance}", "{n_false:.0f}",
    "{far:.4f}", "{far_low:.4f} to {far_high:.4f}",
)  # fmt: skip
POINT_HEAD = (
    ">found",
    ">Pd",
    ">Pd interval",
    ">chance",
    ">false alarms",
    ">FAR (per m²)",
    ">FAR interval (per m²)",
)
_PAIR = (
    "{far_allowed:g}",
    "{first} less {second}",
    "{difference:+.2f}",
    "{low:+.2f} to {high:+.2f}",
)
_MEAN = (
    "{first} less {second}", "{pd_mean_a:.3f} ({low_a:.3f} to {high_a:.3f}), chance {chance_a:.3f}",
    "{pd_mean_b:.3f} ({low_b:.3f} to {high_b:.3f}), chance {chance_b:.3f}",
    "{difference:+.3f}", "{low:+.3f} to {high:+.3f}", "{p_value:.3g}",
)  # fmt: skip


def sheet_html(
    sheet: pd.DataFrame,
    lanes: Mapping[str, Lane],
    name: str,
    digest: str,
    anchor: Anchor | None = None,
) -> str:
    """Write the crew's page of an emplacement plan: map, table and room for what was emplaced.

    ``sheet`` has ``target_id``, ``kind``, ``x_m``, ``y_m`` and ``depth_m`` (m), ``lane`` if the lanes have names, and
    with an anchor ``easting_m`` and ``northing_m``; ``name`` and ``digest`` (SHA-256) are those of the plan's file.
    """
    numbers = [one for one in ("x_m", "y_m", "depth_m", "easting_m", "northing_m") if one in sheet]
    told = sheet.assign(
        **{one: [format(value, _DIGITS.get(one, ".2f")) for value in sheet[one]] for one in numbers}
    )
    parts = []
    for lane, one in lanes.items():
        own = (
            sheet["lane"].astype(str) == lane
            if "lane" in sheet
            else pd.Series(data=True, index=sheet.index)
        )
        rows = told.loc[own, ["target_id", "kind", *numbers]].to_numpy().tolist()
        parts.append((lane, one, lane_maps(one, sheet[own]), rows))
    sigma = None if anchor is None else float(anchor.uncertainty(sheet["x_m"], sheet["y_m"]).max())
    crs = None if anchor is None else anchor.utm()
    return render(
        "sheet.html", lanes=parts, name=name, digest=digest, count=len(sheet), crs=crs, sigma=sigma
    )


def lane_maps(lane: Lane, targets: pd.DataFrame) -> list[Figure]:
    """Draw a lane from above in strips, each read from left to right in the direction of travel."""
    count = max(1, int(np.ceil((lane.y_max - lane.y_min) / _STRIP - 1e-9)))
    length = min(_STRIP, lane.y_max - lane.y_min)
    width = lane.x_max - lane.x_min
    tall = min(3.5, max(1.1, 10.0 * (width + 1) / (length + 1) + 0.55))
    kinds = {kind: number for number, kind in enumerate(sorted(map(str, targets["kind"].unique())))}
    figures = []
    for first in range(0, count, _STRIPS):
        rows = range(first, min(first + _STRIPS, count))
        figure = Figure(figsize=(10.5, tall * len(rows) + 0.35), layout="constrained")
        for axes, row in zip(np.atleast_1d(figure.subplots(len(rows), 1)), rows, strict=True):
            start = lane.y_min + row * _STRIP
            end = min(start + _STRIP, lane.y_max)
            axes.fill_between([start, end], lane.x_min, lane.x_max, color="0.95")
            axes.hlines([lane.x_min, lane.x_max], start, end, color="0.3", lw=1.2)
            axes.vlines(
                [y for y in (lane.y_min, lane.y_max) if start <= y <= end],
                lane.x_min,
                lane.x_max,
                color="0.3",
            )
            own = targets[
                (targets["y_m"] >= start) & ((targets["y_m"] < end) | (end == lane.y_max))
            ]
            for target in own.to_dict("records"):
                number = kinds[str(target["kind"])]
                style = {
                    "color": COLOURS[number % len(COLOURS)],
                    "ms": 6,
                    "mfc": "white",
                    "mew": 1.6,
                }
                axes.plot(target["y_m"], target["x_m"], _MARKS[number % len(_MARKS)], **style)
                place = (target["y_m"], target["x_m"])
                axes.annotate(
                    target["target_id"], place, (5, 4), textcoords="offset points", fontsize=9
                )
            # Seen from above with travel to the right, the lane's right side is below.
            axes.set(
                xlim=(start - 0.5, start + length + 0.5),
                ylim=(lane.x_max + 0.5, lane.x_min - 0.5),
                aspect="equal",
            )
            axes.set_xticks(np.arange(np.ceil(start / 5) * 5, end + 0.01, 5.0))
            axes.set_xticks(np.arange(np.ceil(start), end + 0.01, 1.0), minor=True)
            axes.set_ylabel("x (m)")
            axes.grid(alpha=0.5)
            axes.grid(which="minor", axis="x", alpha=0.2)
        marks = [
            axes.plot(
                [],
                [],
                _MARKS[k % len(_MARKS)],
                color=COLOURS[k % len(COLOURS)],
                mfc="white",
                mew=1.6,
                label=kind,
            )[0]
            for kind, k in kinds.items()
        ]
        if marks:
            figure.legend(
                handles=marks,
                loc="outside upper right",
                ncols=len(marks),
                fontsize=8,
                frameon=False,
            )
        figure.supxlabel("y (m), direction of travel →", fontsize=9)
        figures.append(figure)
    return figures


def blind_html(told: BlindScore, notes: Mapping[str, Any]) -> str:
    """Write the page of a blind score: what the owner of the truth allows, never a place; ``notes`` are provenance."""
    groups = {
        str(group): [
            [f"{row['far_allowed']:g}", *_cells(row, _POINT)] for row in points.to_dict("records")
        ]
        for group, points in told.points.groupby("group", sort=False)
    }
    targets = None
    if told.targets is not None:
        seen = ["not at any" if np.isnan(far) else f"{far:g}" for far in told.targets["found_from"]]
        deep = [
            "not known" if np.isnan(depth) else f"{100 * depth:.1f}"
            for depth in told.targets["depth"]
        ]
        targets = told.targets.assign(depth=deep, found_from=seen).astype(str)
    return render(
        "blind.html",
        told=told,
        groups=groups,
        head=[">allowed FAR (per m²)", *POINT_HEAD],
        picture=points_figure(
            {str(name): one for name, one in told.points.groupby("group", sort=False)}
        ),
        targets=targets,
        notes={name: _head_in_words(value) for name, value in notes.items()},
    )


def _head_in_words(note: Any) -> Any:
    """Say of a log or register how many lines it has and what the last one's hash is; leave other notes as they are."""
    if isinstance(note, dict) and set(note) == {"lines", "head"}:
        return f"{note['lines']} lines, the last is {note['head']}"
    return note


def comparison_html(
    told: SideBySide,
    curves: Mapping[str, pd.DataFrame],
    rules: Mapping[str, Any],
    notes: Mapping[str, Any],
) -> str:
    """Write the page of detectors side by side; without ``curves``, those of the detectors by name, points alone."""
    records = told.points.to_dict("records")
    pairs = [
        [*_cells(row, _PAIR), f"{row['only_first']} and {row['only_second']}", f"{row['p']:.3g}"]
        for row in told.pairs.to_dict("records")
    ]
    means = (
        None
        if told.means is None
        else [_cells(row, _MEAN) for row in told.means.to_dict("records")]
    )
    return render(
        "comparison.html",
        names=list(dict.fromkeys(told.points["detector"])),
        head=[">allowed FAR (per m²)", "detector", *POINT_HEAD],
        points=[
            [f"{row['far_allowed']:g}", row["detector"], *_cells(row, _POINT)]
            for row in sorted(records, key=lambda row: row["far_allowed"])
        ],
        pairs=sorted(pairs, key=lambda row: float(row[0])),
        means=means,
        tests=len(told.pairs),
        picture=points_figure(
            {str(name): one for name, one in told.points.groupby("detector", sort=False)}
        ),
        roc=roc_figure(dict(curves)) if curves else None,
        rules={name: in_words(value) for name, value in rules.items()},
        level=f"{100 * rules['level']:g}",
        far_max=f"{rules['far_max']:g}",
        notes=notes,
    )


def points_figure(groups: Mapping[str, pd.DataFrame]) -> Figure:
    """Draw operating points with their intervals of Pd, and chance as a dash, side by side at each allowed FAR."""
    figure = Figure(figsize=(8.2, 3.6), layout="constrained")
    axes = figure.add_subplot()
    step = 0.7 / max(1, len(groups))
    allowed = sorted({far for one in groups.values() for far in one["far_allowed"]})
    for number, (name, points) in enumerate(groups.items()):
        place = (
            np.searchsorted(allowed, points["far_allowed"])
            + (number - (len(groups) - 1) / 2) * step
        )
        colour = COLOURS[number % len(COLOURS)]
        mark = _MARKS[number % len(_MARKS)]
        axes.vlines(place, points["pd_low"], points["pd_high"], color=colour, lw=1.6)
        label = f"{name} ({points['n_targets'].iloc[0]:.0f} targets)"
        axes.plot(place, points["pd"], mark, color=colour, ms=5, label=label)
        axes.plot(place, points["chance"], "_", color=colour, ms=9, mew=1.6, alpha=0.7)
    axes.plot([], [], "_", color="0.3", ms=9, label="chance")
    axes.set_xticks(range(len(allowed)), [f"{far:g}" for far in allowed])
    axes.set(
        ylim=(-0.03, 1.03), xlabel="allowed false alarms per m²", ylabel="probability of detection"
    )
    axes.grid(axis="y", alpha=0.3)
    figure.legend(fontsize=8, loc="outside right upper", frameon=False)
    return figure


def _cells(row: Mapping[Any, Any], cells: Sequence[str]) -> list[str]:
    by_chance = "not known" if np.isnan(row.get("chance", 0.0)) else f"{row.get('chance', 0.0):.2f}"
    return [cell.format_map({**row, "chance": by_chance}) for cell in cells]
