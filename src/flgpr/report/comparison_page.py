"""The page of detectors side by side."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from flgpr.model import Lane
from flgpr.report.curve_figures import COLOURS, MARKS, compared_roc_figure
from flgpr.report.kit import render, table_rows
from flgpr.report.trial_block import NOT_STATED, comparison_block
from flgpr.scoring import SideBySide
from flgpr.scoring.comparison import side_by_side_in_words

POINT = {
    ">found": "{n_detected:.0f} of {n_targets:.0f}",
    ">Pd": "{pd:.2f}",
    ">Pd interval": "{pd_low:.2f} to {pd_high:.2f}",
    ">chance": "{chance:.2f}",
    ">false alarms": "{n_false:.0f}",
    ">FAR (per m²)": "{far:.4f}",
    ">FAR interval (per m²)": "{far_low:.4f} to {far_high:.4f}",
}
"""Formats of the cells of an operating point, by the titles of their columns."""
_ALLOWED = {">allowed FAR (per m²)": "{far_allowed:g}"}
_PAIR = (
    "{far_allowed:g}",
    "{first} less {second}",
    "{difference:+.2f}",
    "{low:+.2f} to {high:+.2f}",
    "{only_first} and {only_second}",
    "{p:.3g}",
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
    points = comparison.points
    groups = {str(name): rows for name, rows in points.groupby("detector", sort=False)}
    names = list(groups)
    unranked = [name for name in names if "ranking" in notes.get(name, {})]
    roc = None
    if curves:
        labels = {}
        for name in curves:
            vendor = notes.get(name, {}).get("vendor", NOT_STATED)
            labels[name] = name if vendor == NOT_STATED else f"{vendor}: {name}"
        roc = compared_roc_figure(curves, labels, points, rules["far_max"])
    columns = {**_ALLOWED, "detector": "{detector}", **POINT}
    pairs = comparison.pairs
    if len(pairs):
        pairs = pairs.sort_values("far_allowed", kind="stable")
    return render(
        "comparison.html",
        names=names,
        told=side_by_side_in_words(comparison),
        unranked=unranked,
        head=list(columns),
        points=table_rows(points.sort_values("far_allowed", kind="stable"), columns.values()),
        pairs=table_rows(pairs, _PAIR),
        means=None if comparison.means is None else table_rows(comparison.means, _MEAN),
        tests=len(pairs),
        picture=points_figure(groups),
        roc=roc,
        rules=rules,
        notes=notes,
        trial=comparison_block(names, lanes or {}, rules, notes),
    )


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
