"""The page of detectors side by side."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from operator import itemgetter
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from flgpr.model import Lane
from flgpr.report.curve_figures import COLOURS, MARKS, compared_roc_figure
from flgpr.report.kit import render
from flgpr.report.score_page import in_words
from flgpr.report.trial_block import NOT_STATED, comparison_block
from flgpr.scoring import SideBySide

POINT_CELLS = (
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
        notes={
            name: {what: in_words(value) for what, value in of_list.items()}
            for name, of_list in notes.items()
        },
        trial=comparison_block(names, lanes or {}, rules, notes),
    )


def _point_rows(points: pd.DataFrame) -> list[list[str]]:
    """Return the rows of the table of operating points, the smallest allowed FAR first."""
    records = sorted(points.to_dict("records"), key=itemgetter("far_allowed"))
    rows = []
    for record in records:
        far_allowed = f"{record['far_allowed']:g}"
        rows.append([far_allowed, record["detector"], *point_cells(record, POINT_CELLS)])
    return rows


def _pair_rows(pairs: pd.DataFrame) -> list[list[str]]:
    """Return the rows of the table of paired tests, the smallest allowed FAR first."""
    rows = []
    for record in pairs.to_dict("records"):
        only_one = f"{record['only_first']} and {record['only_second']}"
        p_value = f"{record['p']:.3g}"
        rows.append([*point_cells(record, _PAIR), only_one, p_value])
    return sorted(rows, key=_far_of)


def _mean_rows(means: pd.DataFrame | None) -> list[list[str]] | None:
    """Return the rows of the table of mean Pd; None where there are no curves to average."""
    if means is None:
        return None
    return [point_cells(record, _MEAN) for record in means.to_dict("records")]


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


def point_cells(row: Mapping[Any, Any], cells: Sequence[str] = POINT_CELLS) -> list[str]:
    """Return the texts of a row by the formats of its cells."""
    level = row.get("chance", 0.0)
    chance = "not known" if np.isnan(level) else f"{level:.2f}"
    values = {**row, "chance": chance}
    return [cell.format_map(values) for cell in cells]
