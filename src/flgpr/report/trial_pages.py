"""Pages of a trial: the crew's plan, the score of a blind test, and detectors side by side."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from operator import itemgetter
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from flgpr.geo.anchor import Anchor
from flgpr.model import Lane
from flgpr.report.kit import render
from flgpr.report.score_page import in_words
from flgpr.report.trial_block import NOT_STATED, blind_block, comparison_block
from flgpr.scoring import SideBySide
from flgpr.trials import BlindScore
from flgpr.trials.figures import COLOURS, MARKS, compared_roc_figure
from flgpr.trials.standards import checklist_rows, source_rows

_STRIP = 30.0  # length of lane in a row of the map, m
_STRIPS = 4  # rows in a picture: half a printed page
_LOWEST_STRIP = 1.1  # inches
_HIGHEST_STRIP = 3.5
# Mines are emplaced to the centimetre; depths have a digit more.
_DIGITS = {"depth_m": ".3f"}
_POINT = (
    "{n_detected:.0f} of {n_targets:.0f}",
    "{pd:.2f}",
    "{pd_low:.2f} to {pd_high:.2f}",
    "{chance}",
    "{n_false:.0f}",
    "{far:.4f}",
    "{far_low:.4f} to {far_high:.4f}",
)
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
    "{first} less {second}",
    "{pd_mean_a:.3f} ({low_a:.3f} to {high_a:.3f}), chance {chance_a:.3f}",
    "{pd_mean_b:.3f} ({low_b:.3f} to {high_b:.3f}), chance {chance_b:.3f}",
    "{difference:+.3f}",
    "{low:+.3f} to {high:+.3f}",
    "{p_value:.3g}",
)


def sheet_html(
    sheet: pd.DataFrame,
    lanes: Mapping[str, Lane],
    name: str,
    digest: str,
    anchor: Anchor | None = None,
) -> str:
    """Return the crew's page of an emplacement plan: map, table and room for what was emplaced.

    Parameters
    ----------
    sheet : pandas.DataFrame
        ``target_id``, ``kind``, ``x_m``, ``y_m`` and ``depth_m`` (m), ``lane`` if the lanes have
        names, and with an anchor ``easting_m`` and ``northing_m``.
    lanes : mapping of str to Lane
        Lanes by name.
    name : str
        Name of the plan's file.
    digest : str
        SHA-256 of the plan's file.
    anchor : Anchor, optional
        Ties the lanes to the Earth.

    Returns
    -------
    str
        The page, HTML without references to other files.
    """
    columns = ("x_m", "y_m", "depth_m", "easting_m", "northing_m")
    numbers = [column for column in columns if column in sheet]
    texts = sheet.copy()
    for column in numbers:
        digits = _DIGITS.get(column, ".2f")
        texts[column] = [format(value, digits) for value in sheet[column]]

    entries = []
    for lane_name, lane in lanes.items():
        on_lane = pd.Series(data=True, index=sheet.index)
        if "lane" in sheet:
            on_lane = sheet["lane"].astype(str) == lane_name
        maps = lane_maps(lane, sheet[on_lane])
        rows = texts.loc[on_lane, ["target_id", "kind", *numbers]]
        entries.append((lane_name, lane, maps, rows.to_numpy().tolist()))

    sigma = None
    crs = None
    if anchor is not None:
        sigma = float(anchor.uncertainty(sheet["x_m"], sheet["y_m"]).max())
        crs = anchor.utm()
    return render(
        "sheet.html",
        lanes=entries,
        name=name,
        digest=digest,
        count=len(sheet),
        crs=crs,
        sigma=sigma,
    )


def lane_maps(lane: Lane, targets: pd.DataFrame) -> list[Figure]:
    """Draw a lane from above in strips, each read from left to right in the direction of travel.

    Parameters
    ----------
    lane : Lane
        The lane.
    targets : pandas.DataFrame
        ``target_id``, ``kind``, ``x_m`` and ``y_m``.

    Returns
    -------
    list of Figure
        Each with up to four strips of 30 m.
    """
    lane_length = lane.y_max - lane.y_min
    # A lane that is longer by a rounding error has no strip for it.
    count = max(1, int(np.ceil(lane_length / _STRIP - 1e-9)))
    length = min(_STRIP, lane_length)
    width = lane.x_max - lane.x_min
    height_to_scale = 10.0 * (width + 1) / (length + 1) + 0.55
    strip_height = min(_HIGHEST_STRIP, max(_LOWEST_STRIP, height_to_scale))
    kinds = sorted(map(str, targets["kind"].unique()))
    styles = {kind: _marker_style(number) for number, kind in enumerate(kinds)}
    figures = []
    for first in range(0, count, _STRIPS):
        strips = range(first, min(first + _STRIPS, count))
        size = (10.5, strip_height * len(strips) + 0.35)
        figure = Figure(figsize=size, layout="constrained")
        panels = np.atleast_1d(figure.subplots(len(strips), 1))
        for axes, strip in zip(panels, strips, strict=True):
            start = lane.y_min + strip * _STRIP
            _draw_strip(axes, lane, targets, styles, start, length)
        handles = [Line2D([], [], label=kind, **style) for kind, style in styles.items()]
        if handles:
            figure.legend(
                handles=handles,
                loc="outside upper right",
                ncols=len(handles),
                fontsize=8,
                frameon=False,
            )
        figure.supxlabel("y (m), direction of travel →", fontsize=9)
        figures.append(figure)
    return figures


def _marker_style(number: int) -> dict[str, Any]:
    """Return the marker of a kind of target by its number."""
    return {
        "marker": MARKS[number % len(MARKS)],
        "color": COLOURS[number % len(COLOURS)],
        "mfc": "white",
        "mew": 1.6,
        "ls": "none",
    }


def _draw_strip(
    axes: Axes,
    lane: Lane,
    targets: pd.DataFrame,
    styles: Mapping[str, dict[str, Any]],
    start: float,
    length: float,
) -> None:
    """Draw the strip of a lane that begins at lane y ``start``, with its targets."""
    end = min(start + _STRIP, lane.y_max)
    axes.fill_between([start, end], lane.x_min, lane.x_max, color="0.95")
    axes.hlines([lane.x_min, lane.x_max], start, end, color="0.3", lw=1.2)
    lane_ends = [y for y in (lane.y_min, lane.y_max) if start <= y <= end]
    axes.vlines(lane_ends, lane.x_min, lane.x_max, color="0.3")
    # A target on the border of two strips belongs to the second, one at the lane's end to the last.
    is_on_strip = targets["y_m"] >= start
    is_on_strip &= (targets["y_m"] < end) | (end == lane.y_max)
    for target in targets[is_on_strip].to_dict("records"):
        position = (target["y_m"], target["x_m"])
        style = styles[str(target["kind"])]
        axes.plot(*position, ms=6, **style)
        axes.annotate(
            target["target_id"],
            position,
            xytext=(5, 4),
            textcoords="offset points",
            fontsize=9,
        )
    # Seen from above with travel to the right, the lane's right side is below.
    axes.set(
        xlim=(start - 0.5, start + length + 0.5),
        ylim=(lane.x_max + 0.5, lane.x_min - 0.5),
        aspect="equal",
    )
    # The crew reads distances off the map: a line at every metre, a number at every fifth.
    first_fifth = np.ceil(start / 5) * 5
    axes.set_xticks(np.arange(first_fifth, end + 0.01, 5.0))
    axes.set_xticks(np.arange(np.ceil(start), end + 0.01, 1.0), minor=True)
    axes.set_ylabel("x (m)")
    axes.grid(alpha=0.5)
    axes.grid(which="minor", axis="x", alpha=0.2)


def blind_html(blind: BlindScore, notes: Mapping[str, Any]) -> str:
    """Return the page of a blind score: what the owner of the truth allows, and no positions.

    Parameters
    ----------
    blind : BlindScore
        The score.
    notes : mapping
        Provenance to print.

    Returns
    -------
    str
        The page, HTML without references to other files.
    """
    groups = {}
    points_by_group = {}
    for group, points in blind.points.groupby("group", sort=False):
        points_by_group[str(group)] = points
        rows = []
        for row in points.to_dict("records"):
            rows.append([f"{row['far_allowed']:g}", *_cells(row, _POINT)])
        groups[str(group)] = rows
    return render(
        "blind.html",
        blind=blind,
        groups=groups,
        head=[">allowed FAR (per m²)", *POINT_HEAD],
        picture=points_figure(points_by_group),
        targets=_target_texts(blind.targets),
        notes={name: _head_in_words(value) for name, value in notes.items()},
        trial=blind_block(blind, notes),
        standards={"rows": checklist_rows(), "sources": source_rows()},
    )


def _target_texts(targets: pd.DataFrame | None) -> pd.DataFrame | None:
    """Return the table of targets of a blind score as text; None where it is not allowed."""
    if targets is None:
        return None
    found_from = []
    depths = []
    for far, depth in zip(targets["found_from"], targets["depth"], strict=True):
        found_from.append("not at any" if np.isnan(far) else f"{far:g}")
        depths.append("not known" if np.isnan(depth) else f"{100 * depth:.1f}")
    return targets.assign(depth=depths, found_from=found_from).astype(str)


def _head_in_words(note: Any) -> Any:
    """Return the length of a log or register and its last hash as text; other notes unchanged."""
    if isinstance(note, dict) and set(note) == {"lines", "head"}:
        return f"{note['lines']} lines, the last is {note['head']}"
    return note


def comparison_html(
    comparison: SideBySide,
    curves: Mapping[str, pd.DataFrame],
    rules: Mapping[str, Any],
    notes: Mapping[str, Any],
    lanes: Mapping[str, Lane] | None = None,
) -> str:
    """Return the page of detectors side by side.

    Parameters
    ----------
    comparison : SideBySide
        Points, pairs and means.
    curves : mapping of str to pandas.DataFrame
        ROC curves by detector; empty shows the points only.
    rules : mapping
        Rules of the scores.
    notes : mapping
        Provenance to print, by detector.
    lanes : mapping of str to Lane, optional
        Lanes by name; none where they are sealed.

    Returns
    -------
    str
        The page, HTML without references to other files.
    """
    points_by_detector = {}
    for name, table in comparison.points.groupby("detector", sort=False):
        points_by_detector[str(name)] = table
    names = list(dict.fromkeys(comparison.points["detector"]))
    unranked = [name for name in names if "ranking" in notes.get(name, {})]
    roc = None
    if curves:
        labels = {name: _curve_label(name, notes.get(name, {})) for name in curves}
        roc = compared_roc_figure(curves, labels, comparison.points, rules["far_max"])
    return render(
        "comparison.html",
        names=names,
        unranked=unranked,
        head=[">allowed FAR (per m²)", "detector", *POINT_HEAD],
        points=_point_rows(comparison.points),
        pairs=_pair_rows(comparison.pairs),
        means=_mean_rows(comparison.means),
        tests=len(comparison.pairs),
        picture=points_figure(points_by_detector),
        roc=roc,
        rules={name: in_words(value) for name, value in rules.items()},
        level=f"{100 * rules['level']:g}",
        far_max=f"{rules['far_max']:g}",
        notes=notes,
        trial=comparison_block(names, lanes or {}, rules, notes),
        standards={"rows": checklist_rows(), "sources": source_rows()},
    )


def _point_rows(points: pd.DataFrame) -> list[list[str]]:
    """Return the rows of the table of operating points, the smallest allowed FAR first."""
    records = sorted(points.to_dict("records"), key=itemgetter("far_allowed"))
    rows = []
    for record in records:
        far_allowed = f"{record['far_allowed']:g}"
        rows.append([far_allowed, record["detector"], *_cells(record, _POINT)])
    return rows


def _pair_rows(pairs: pd.DataFrame) -> list[list[str]]:
    """Return the rows of the table of paired tests, the smallest allowed FAR first."""
    rows = []
    for record in pairs.to_dict("records"):
        only_one = f"{record['only_first']} and {record['only_second']}"
        p_value = f"{record['p']:.3g}"
        rows.append([*_cells(record, _PAIR), only_one, p_value])
    return sorted(rows, key=_far_of)


def _mean_rows(means: pd.DataFrame | None) -> list[list[str]] | None:
    """Return the rows of the table of mean Pd; None where there are no curves to average."""
    if means is None:
        return None
    return [_cells(record, _MEAN) for record in means.to_dict("records")]


def _curve_label(name: str, notes: Mapping[str, Any]) -> str:
    """Return the name of a curve in a legend: the vendor, where one is stated, and the list."""
    vendor = notes.get("vendor", NOT_STATED)
    return name if vendor == NOT_STATED else f"{vendor}: {name}"


def _far_of(pair: list[str]) -> float:
    """Return the allowed FAR of a row of pairs."""
    return float(pair[0])


def points_figure(groups: Mapping[str, pd.DataFrame]) -> Figure:
    """Draw operating points with their intervals of Pd, side by side at each allowed FAR.

    A dash marks chance.

    Parameters
    ----------
    groups : mapping of str to pandas.DataFrame
        Operating points by name of the group: ``far_allowed`` (per m²), ``pd``, ``pd_low``,
        ``pd_high``, ``chance`` and ``n_targets``.

    Returns
    -------
    matplotlib.figure.Figure
        The figure.
    """
    figure = Figure(figsize=(8.2, 3.6), layout="constrained")
    axes = figure.add_subplot()
    step = 0.7 / max(1, len(groups))
    allowed_fars: set[float] = set()
    for points in groups.values():
        allowed_fars.update(points["far_allowed"])
    allowed = sorted(allowed_fars)

    for number, (name, points) in enumerate(groups.items()):
        # The groups stand side by side about the tick of their FAR.
        offset = (number - (len(groups) - 1) / 2) * step
        position = np.searchsorted(allowed, points["far_allowed"]) + offset
        colour = COLOURS[number % len(COLOURS)]
        marker = MARKS[number % len(MARKS)]
        axes.vlines(position, points["pd_low"], points["pd_high"], color=colour, lw=1.6)
        targets = points["n_targets"].iloc[0]
        label = f"{name} ({targets:.0f} targets)"
        axes.plot(position, points["pd"], marker, color=colour, ms=5, label=label)
        axes.plot(position, points["chance"], "_", color=colour, ms=9, mew=1.6, alpha=0.7)
    axes.plot([], [], "_", color="0.3", ms=9, label="chance")
    axes.set_xticks(range(len(allowed)), [f"{far:g}" for far in allowed])
    axes.set(
        ylim=(-0.03, 1.03),
        xlabel="allowed false alarms per m²",
        ylabel="probability of detection",
    )
    axes.grid(axis="y", alpha=0.3)
    figure.legend(fontsize=8, loc="outside right upper", frameon=False)
    return figure


def _cells(row: Mapping[Any, Any], cells: Sequence[str]) -> list[str]:
    """Return the texts of a row by the formats of its cells."""
    level = row.get("chance", 0.0)
    chance = "not known" if np.isnan(level) else f"{level:.2f}"
    values = {**row, "chance": chance}
    return [cell.format_map(values) for cell in cells]
