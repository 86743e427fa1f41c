"""Figures of the proving ground: who finds what on every tier, and every split by group."""

from __future__ import annotations

import math
from collections.abc import Container, Sequence
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from numpy.typing import NDArray

from flgpr_ground.entries import ORACLES
from flgpr_ground.ground import BODY, MINES, Ground

KINDS = ("metal", "plastic", "ap", "simulant")
"""Kinds of targets in the order of their panels; others come after them."""
MARKS = (("o", "C0", "C0"), ("s", "C1", "white"), ("^", "C2", "C2"), ("D", "C4", "white"))
"""Marker, colour and filling of the tiers in turn: told apart in black and white, too."""
SPREAD = 0.36  # of a row, between the marks of its first and of its last tier
ROW = 0.21  # in, height of a row
LONGEST_NAME = 24  # characters of a name beside a panel
PD_AXIS = (-0.03, 1.03)
"""Limits of the axis of Pd: marks at 0 and at 1 stand clear of the frame."""


class _EntryStyle(NamedTuple):
    """How entries of a sort are drawn on the leaderboard."""

    marker: str
    colour: str
    filling: str
    label: str


_SUBMISSION = _EntryStyle("D", "C3", "C3", "submission")
_PACKAGED = _EntryStyle("o", "C0", "C0", "packaged, or run here")
_NOT_RANKED = _EntryStyle("o", "0.45", "white", "not ranked")


def opening_split(ground: Ground) -> str:
    """Name the split that the opening figure shows, the first."""
    return next(iter(ground.table.splits))


def tiers_figure(ground: Ground, scores: pd.DataFrame, narrow: bool = False) -> Figure:
    """Draw Pd of every entry with its 95 % interval by kind of target, a mark for every tier.

    Parameters
    ----------
    ground : Ground
        A ground that has tiers.
    scores : DataFrame
        What :func:`flgpr.proving_ground.score_entries` gives; the opening split at the FAR of
        comparison is drawn.
    narrow : bool
        Whether to draw two panels side by side, which can be read on a phone, in place of all.

    Returns
    -------
    Figure
        A panel per kind of target. Entries stand in the order of their Pd of all mines on the first
        tier, the oracles above them. What chance finds at most is shaded.
    """
    is_shown = scores["split"] == opening_split(ground)
    is_shown &= scores["far_allowed"] == ground.table.far
    shown = scores[is_shown]
    tiers = [tier for tier in ground.table.tiers if (shown["tier"] == tier).any()]
    entries = _entries_from_below(shown, tiers)
    kinds = _kinds(ground, shown)
    columns = min(2, len(kinds)) if narrow else len(kinds)
    rows = math.ceil(len(kinds) / columns)
    width = 3.9 if narrow else 1.5 + 1.55 * columns
    height = 0.5 + rows * (0.6 + ROW * len(entries))
    figure = Figure(figsize=(width, height), layout="constrained")
    grid = figure.subplots(rows, columns, sharey=True, sharex=True, squeeze=False)
    panels = grid.ravel()
    for panel, kind in zip(panels, kinds, strict=False):
        scores_of_kind = shown[shown["group"] == kind]
        _draw_kind(panel, scores_of_kind, kind, tiers, entries)

    for panel in panels[len(kinds) :]:
        panel.set_axis_off()
    # The lowest panel of every column is labelled: the last row may not be full.
    first_lowest = max(len(kinds) - columns, 0)
    for panel in panels[first_lowest : len(kinds)]:
        panel.set_xlabel("Pd", fontsize=8)

    figure.legend(
        handles=_legend(ground, tiers),
        loc="outside upper center",
        ncols=1 if narrow else 3,
        fontsize=8,
        frameon=False,
    )
    return figure


def _entries_from_below(shown: pd.DataFrame, tiers: Sequence[str]) -> list[str]:
    """Return the entries in the order of their Pd of all mines, by the first tier first.

    The oracles are the last, which stand on top.
    """
    mines = shown[shown["group"] == MINES].pivot_table(index="entry", columns="tier", values="pd")
    by_tier = mines.reindex(columns=list(tiers)).fillna(-1.0)
    ordered = by_tier.sort_values(list(tiers), kind="stable")
    entries = [str(name) for name in ordered.index if name not in ORACLES]
    oracles = [name for name in ORACLES if name in ordered.index]
    return entries + oracles


def _kinds(ground: Ground, shown: pd.DataFrame) -> list[str]:
    """Return the kinds of targets that were scored, in the order of their panels."""
    kinds = []
    for group in dict.fromkeys(str(name) for name in shown["group"]):
        is_site = group in ground.sites
        if group != MINES and not is_site and not group.startswith(BODY):
            kinds.append(group)
    usual = [kind for kind in KINDS if kind in kinds]
    unusual = [kind for kind in kinds if kind not in KINDS]
    return usual + unusual


def _draw_kind(
    panel: Axes, scores: pd.DataFrame, kind: str, tiers: Sequence[str], entries: list[str]
) -> None:
    """Draw the panel of one kind of target, whose scores are given."""
    row_heights = np.arange(len(entries), dtype=float)
    _shade_every_second_row(panel, row_heights, "0.95")
    highest_chance = float(scores["chance"].max())
    panel.axvspan(PD_AXIS[0], highest_chance, color="0.8", zorder=1, lw=0)

    shifts = np.zeros(1)
    if len(tiers) > 1:
        shifts = np.linspace(SPREAD / 2, -SPREAD / 2, len(tiers))
    target_counts = []
    for number, (tier, shift) in enumerate(zip(tiers, shifts, strict=True)):
        marker, colour, filling = MARKS[number % len(MARKS)]
        scores_of_tier = scores[scores["tier"] == tier]
        rows = scores_of_tier.set_index("entry").reindex(entries)
        heights = row_heights + shift
        low = rows["pd_low"]
        high = rows["pd_high"]
        panel.hlines(heights, low, high, color=colour, lw=1.2, zorder=2)
        panel.plot(
            rows["pd"],
            heights,
            marker,
            color=colour,
            mfc=filling,
            ms=4,
            mew=1.1,
            zorder=3,
        )
        target_counts.append(f"{rows['n_targets'].max():.0f}")

    kind_label = "AP" if kind == "ap" else kind
    counts_of_tiers = " | ".join(target_counts)
    panel.set_title(f"{kind_label} ({counts_of_tiers})", fontsize=9)
    panel.set(xlim=PD_AXIS, ylim=(-0.5, len(entries) - 0.5), xticks=(0, 0.5, 1))
    panel.set_yticks(row_heights, entries, fontsize=8)
    panel.tick_params(axis="x", labelsize=8, labelbottom=True)
    panel.tick_params(axis="y", length=0)
    panel.grid(axis="x", alpha=0.4)


def _shade_every_second_row(panel: Axes, row_heights: NDArray[np.float64], shade: str) -> None:
    """Shade every second row of a panel, so that the eye can follow it."""
    left, right = PD_AXIS
    width = right - left
    panel.barh(row_heights[::2], width, left=left, height=1.0, color=shade, zorder=0)


def _legend(ground: Ground, tiers: Sequence[str]) -> list[Line2D | Patch]:
    """Return the entries of the legend."""
    handles: list[Line2D | Patch] = []
    for number, tier in enumerate(tiers):
        marker, colour, filling = MARKS[number % len(MARKS)]
        handle = Line2D(
            [],
            [],
            marker=marker,
            color=colour,
            mfc=filling,
            ms=4,
            lw=1.2,
            label=ground.table.tiers[tier].title,
        )
        handles.append(handle)
    chance = Patch(color="0.8", label="what chance finds, at most")
    return [*handles, chance]


def split_figure(ground: Ground, scores: pd.DataFrame, split: str) -> Figure:
    """Draw Pd of every entry with its interval and chance, by group of targets.

    Parameters
    ----------
    ground : Ground
        The ground, or one tier of it.
    scores : DataFrame
        Scores of that tier.
    split : str
        Name of the split.

    Returns
    -------
    Figure
        A panel for all mines, every site and every kind.
    """
    is_shown = scores["split"] == split
    is_shown &= scores["far_allowed"] == ground.table.far
    shown = scores[is_shown]
    mines = shown[shown["group"] == MINES]
    entries = list(mines.sort_values("pd", kind="stable")["entry"])
    groups = []
    for group in dict.fromkeys(shown["group"]):
        if not group.startswith(BODY):
            groups.append(group)

    size = (2.2 + 1.7 * len(groups), 1.1 + 0.3 * len(entries))
    figure = Figure(figsize=size, layout="constrained")
    panels = np.atleast_1d(figure.subplots(1, len(groups), sharey=True))
    row_heights = np.arange(len(entries))
    for panel, group in zip(panels, groups, strict=True):
        scores_of_group = shown[shown["group"] == group]
        rows = scores_of_group.set_index("entry").reindex(entries)
        panel.hlines(row_heights, rows["pd_low"], rows["pd_high"], color="C0", lw=2)
        panel.plot(rows["pd"].to_numpy(), row_heights, "o", color="C0", ms=5)
        panel.plot(rows["chance"], row_heights, "|", color="C3", ms=11, mew=2)
        targets = rows["n_targets"].max()
        panel.set(xlim=PD_AXIS, title=f"{group} ({targets:.0f})", xlabel="Pd")
        panel.set_yticks(row_heights, entries)
        panel.grid(axis="x", alpha=0.3)
    return figure


def leaderboard_figure(
    tiers: Sequence[tuple[Ground, Sequence[Any]]], submitted: Container[str], narrow: bool = False
) -> Figure:
    """Draw Pd of all mines with its 95 % interval of every entry, a panel per tier.

    Parameters
    ----------
    tiers : sequence of tuple
        Every tier with its rows (:func:`flgpr_ground.board.ranked_rows`).
    submitted : container of str
        Names of submissions, which stand out.
    narrow : bool
        Whether panels stand below each other, which can be read on a phone, in place of side by
        side.

    Returns
    -------
    Figure
        Entries in the order of their rows. The interval of the first is shaded: entries whose
        intervals reach into it are not told apart from the first. A mark shows chance.
    """
    row_counts = [len(rows) for _, rows in tiers]
    panel_heights = [1.0 + ROW * count for count in row_counts]
    if narrow:
        shape = (len(tiers), 1)
        size = (4.2, sum(panel_heights) + 0.5)
        ratios = {"height_ratios": [3 + count for count in row_counts]}
    else:
        shape = (1, len(tiers))
        size = (0.8 + 4.8 * len(tiers), max(panel_heights, default=1.0 + ROW))
        ratios = {}
    figure = Figure(figsize=size, layout="constrained")
    panels = figure.subplots(*shape, squeeze=False, gridspec_kw=ratios).ravel()
    for panel, (tier, rows) in zip(panels, tiers, strict=True):
        _draw_board(panel, tier, rows, submitted)
    figure.legend(
        handles=_board_legend(),
        loc="outside upper center",
        ncols=2 if narrow else 5,
        fontsize=8,
        frameon=False,
    )
    return figure


def _draw_board(panel: Axes, tier: Ground, rows: Sequence[Any], submitted: Container[str]) -> None:
    """Draw the panel of a tier, the first row on top."""
    row_heights = np.arange(len(rows), dtype=float)[::-1]
    _shade_every_second_row(panel, row_heights, "0.96")
    first = next((row for row in rows if row.first), None)
    if first is not None:
        low = first.score["pd_low"]
        high = first.score["pd_high"]
        panel.axvspan(low, high, color="C0", alpha=0.13, lw=0, zorder=1)

    for height, row in zip(row_heights, rows, strict=True):
        _draw_board_row(panel, height, row, row.entry in submitted)

    names = [_short_name(row.entry) for row in rows]
    panel.set_yticks(row_heights, names, fontsize=8)
    for label, row in zip(panel.get_yticklabels(), rows, strict=True):
        label.set_fontweight("bold" if row.entry in submitted else "normal")
    targets = rows[0].score["n_targets"] if rows else 0
    title = tier.tier_title or tier.title
    panel.set_title(f"{title} ({targets:.0f} mines)", fontsize=9)
    panel.set(xlim=PD_AXIS, ylim=(-0.6, len(rows) - 0.4), xticks=(0, 0.25, 0.5, 0.75, 1))
    panel.set_xlabel("Pd", fontsize=8)
    panel.tick_params(axis="x", labelsize=8)
    panel.tick_params(axis="y", length=0)
    panel.grid(axis="x", alpha=0.4)


def _draw_board_row(panel: Axes, height: float, row: Any, is_submitted: bool) -> None:
    """Draw Pd of an entry with its interval, and chance, at a height of the panel."""
    style = _PACKAGED
    if not row.first:
        style = _NOT_RANKED
    elif is_submitted:
        style = _SUBMISSION
    score = row.score
    panel.hlines(
        height,
        score["pd_low"],
        score["pd_high"],
        color=style.colour,
        lw=1.5,
        zorder=2,
    )
    panel.plot(
        score["pd"],
        height,
        style.marker,
        color=style.colour,
        mfc=style.filling,
        ms=5,
        mew=1.2,
        zorder=3,
    )
    panel.plot(score["chance"], height, "|", color="0.25", ms=8, mew=1.5, zorder=2)


def _short_name(name: str) -> str:
    """Return a name that leaves room for the panel."""
    return name if len(name) <= LONGEST_NAME else f"{name[: LONGEST_NAME - 3]}..."


def _board_legend() -> list[Line2D | Patch]:
    """Return the entries of the legend of the leaderboard."""
    lines = []
    for style in (_SUBMISSION, _PACKAGED, _NOT_RANKED):
        line = Line2D(
            [],
            [],
            marker=style.marker,
            color=style.colour,
            mfc=style.filling,
            ms=5,
            label=style.label,
        )
        lines.append(line)
    chance = Line2D([], [], marker="|", color="0.25", ls="", ms=8, mew=1.5, label="chance")
    shaded = Patch(color="C0", alpha=0.13, label="interval of the first")
    return [*lines, chance, shaded]
