"""Pages of a trial: the crew's plan, the intake of a list, and the score of a blind test."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from flgpr.geo.anchor import Anchor
from flgpr.model import Lane
from flgpr.report.comparison_page import POINT, points_figure
from flgpr.report.curve_figures import COLOURS, MARKS
from flgpr.report.kit import render, table_rows
from flgpr.report.trial_block import TrialBlock, list_block
from flgpr.types import Entries
from flgpr_trials.blind import BlindScore
from flgpr_trials.intake import ReadList

_STRIP = 30.0  # length of lane in a row of the map, m
_STRIPS = 4  # rows in a picture: half a printed page
_LOWEST_STRIP = 1.1  # inches
_HIGHEST_STRIP = 3.5
_EDGE = 0.1  # m from the edge of the drawing, where marks stand that lie farther out
_MOST_DROPPED = 200  # dropped rows that a page lists


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
    # Mines are emplaced to the centimetre; depths have a digit more.
    digits = {"x_m": 2, "y_m": 2, "depth_m": 3, "easting_m": 2, "northing_m": 2}
    cells = [f"{{{name}:.{count}f}}" for name, count in digits.items() if name in sheet]
    entries = []
    for lane_name, lane in lanes.items():
        rows = sheet
        if "lane" in sheet:
            rows = sheet[sheet["lane"].astype(str) == lane_name]
        texts = table_rows(rows, ["{target_id}", "{kind}", *cells])
        entries.append((lane_name, lane, lane_maps(lane, rows), texts))
    sigma = None
    if anchor is not None:
        sigma = float(anchor.uncertainty(sheet["x_m"], sheet["y_m"]).max())
    return render(
        "sheet.html",
        "flgpr_trials",
        lanes=entries,
        name=name,
        digest=digest,
        count=len(sheet),
        crs=None if anchor is None else anchor.utm(),
        sigma=sigma,
    )


def lane_maps(lane: Lane, marks: pd.DataFrame, margin: float = 0.5) -> list[Figure]:
    """Draw a lane from above in strips, each read from left to right in the direction of travel.

    Parameters
    ----------
    lane : Lane
        The lane.
    marks : pandas.DataFrame
        What is marked: ``kind``, ``x_m`` and ``y_m``, and ``target_id`` where marks have names.
    margin : float
        What is drawn beside the lane, m; marks farther outside stand at the edge of the drawing.

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
    height_to_scale = 10.0 * (width + 2 * margin) / (length + 2 * margin) + 0.55
    strip_height = min(_HIGHEST_STRIP, max(_LOWEST_STRIP, height_to_scale))
    kinds = sorted(map(str, marks["kind"].unique()))
    styles: dict[str, Entries] = {}
    for number, kind in enumerate(kinds):
        shape = {"marker": MARKS[number % len(MARKS)], "color": COLOURS[number % len(COLOURS)]}
        styles[kind] = {**shape, "mfc": "white", "mew": 1.6, "ls": "none"}
    figures = []
    for first in range(0, count, _STRIPS):
        strips = range(first, min(first + _STRIPS, count))
        size = (10.5, strip_height * len(strips) + 0.35)
        figure = Figure(figsize=size, layout="constrained")
        panels = np.atleast_1d(figure.subplots(len(strips), 1))
        for axes, strip in zip(panels, strips, strict=True):
            start = lane.y_min + strip * _STRIP
            _draw_strip(axes, lane, marks, styles, (start, length, margin))
        handles = [Line2D([], [], label=kind, **style) for kind, style in styles.items()]
        if handles:
            figure.legend(
                handles=handles,
                loc="outside upper left",
                ncols=len(handles),
                fontsize=8,
                frameon=False,
            )
        figure.supxlabel("y (m), direction of travel →", fontsize=9)
        figures.append(figure)
    return figures


def _draw_strip(
    axes: Axes,
    lane: Lane,
    marks: pd.DataFrame,
    styles: Mapping[str, Entries],
    strip: tuple[float, float, float],
) -> None:
    """Draw a strip of a lane, of which are given its begin, lane y, length and margin, with its marks."""
    start, length, margin = strip
    end = min(start + _STRIP, lane.y_max)
    axes.fill_between([start, end], lane.x_min, lane.x_max, color="0.95")
    axes.hlines([lane.x_min, lane.x_max], start, end, color="0.3", lw=1.2)
    lane_ends = [y for y in (lane.y_min, lane.y_max) if start <= y <= end]
    axes.vlines(lane_ends, lane.x_min, lane.x_max, color="0.3")
    x = marks["x_m"].clip(lane.x_min - margin + _EDGE, lane.x_max + margin - _EDGE)
    y = marks["y_m"].clip(lane.y_min - margin + _EDGE, lane.y_max + margin - _EDGE)
    # A mark on the border of two strips belongs to the second, one at the lane's end to the last.
    on_strip = (y >= start) | (start == lane.y_min)
    on_strip &= (y < end) | (end == lane.y_max)
    for kind, style in styles.items():
        of_kind = on_strip & (marks["kind"].astype(str) == kind)
        axes.plot(y[of_kind], x[of_kind], ms=6, **style)
    if "target_id" in marks:
        for name, along, across in zip(
            marks["target_id"][on_strip], y[on_strip], x[on_strip], strict=True
        ):
            axes.annotate(
                name, (along, across), xytext=(5, 4), textcoords="offset points", fontsize=9
            )
    # Seen from above with travel to the right, the lane's right side is below.
    axes.set(
        xlim=(start - margin, start + length + margin),
        ylim=(lane.x_max + margin, lane.x_min - margin),
        aspect="equal",
    )
    # The crew reads distances off the map: a line at every metre, a number at every fifth.
    first_fifth = np.ceil(start / 5) * 5
    axes.set_xticks(np.arange(first_fifth, end + 0.01, 5.0))
    axes.set_xticks(np.arange(np.ceil(start), end + 0.01, 1.0), minor=True)
    axes.set_ylabel("x (m)")
    axes.grid(alpha=0.5)
    axes.grid(which="minor", axis="x", alpha=0.2)


def intake_html(
    read: ReadList,
    lanes: Mapping[str, Lane],
    halo: float,
    facts: Mapping[str, Any],
    signature: Mapping[str, Any] | None,
) -> str:
    """Return the page of a vendor's list before it is scored: a sentence, the map, the dropped rows.

    Parameters
    ----------
    read : ReadList
        The list.
    lanes : mapping of str to Lane
        Lanes of the test by name.
    halo : float
        Halo radius, m.
    facts : mapping
        What is stated of the file, by what it is.
    signature : mapping, optional
        The register's line that holds the signature; None where nobody has signed.

    Returns
    -------
    str
        The page, HTML without references to other files.
    """
    rows = read.rows.rename(columns={"x": "x_m", "y": "y_m"})
    rows["kind"] = rows["used"].map({True: "used", False: "not used"})
    strongest = rows["confidence"] >= rows.loc[rows["used"], "confidence"].quantile(0.9)
    rows.loc[rows["used"] & strongest, "kind"] = "strongest tenth"
    maps = []
    for name, lane in lanes.items():
        on_lane = rows[rows["lane"] == name] if name and "lane" in rows else rows
        maps.append((name, lane_maps(lane, on_lane, halo + _EDGE)))
    return render(
        "intake.html",
        "flgpr_trials",
        read=read,
        maps=maps,
        facts=facts,
        signature=signature,
        dropped=[[row.line, row.reason] for row in read.dropped[:_MOST_DROPPED]],
        more=max(0, len(read.dropped) - _MOST_DROPPED),
    )


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
    columns = {">allowed FAR (per m²)": "{far_allowed:g}", **POINT}
    points = {str(name): rows for name, rows in blind.points.groupby("group", sort=False)}
    targets = None
    head = {}
    if blind.targets is not None:
        head = {
            "target": "{target_id}",
            "kind": "{kind}",
            ">depth (cm)": "{cm:.1f}",
            ">found from the allowed FAR (per m²)": "{first}",
        }
        if "lane" in blind.targets:
            head = {"lane": "{lane}"} | head
        found_from = blind.targets["found_from"]
        first = found_from.map("{:g}".format).where(found_from.notna(), "not at any")
        targets = blind.targets.assign(cm=100 * blind.targets["depth"], first=first)
    return render(
        "blind.html",
        "flgpr_trials",
        blind=blind,
        groups={name: table_rows(rows, columns.values()) for name, rows in points.items()},
        head=list(columns),
        picture=points_figure(points),
        targets=None if targets is None else table_rows(targets, head.values()),
        targets_head=list(head),
        notes=notes,
        trial=_blind_block(blind, notes),
    )


def _blind_block(blind: BlindScore, notes: Mapping[str, Any]) -> TrialBlock:
    """Return the head of the page of a blind score, whose lane and places stay secret."""
    counts = blind.counts
    rules = (
        f"halo radius {counts['halo_radius']:g} m, FAR over {counts['area']:.2f} m² "
        f"(rule {counts['area_rule']}), 95 % intervals"
    )
    return list_block(
        notes,
        "alarm list",
        (counts["n_alarms"], counts["n_targets"]),
        notes.get("sealed_sha256"),
        "sealed with the truth",
        rules,
        "sealed lane",
    )
