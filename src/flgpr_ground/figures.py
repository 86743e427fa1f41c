"""Figures of the proving ground: who finds what on every tier, and every split by group."""

from __future__ import annotations

import math
from collections.abc import Container, Sequence
from itertools import cycle
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from flgpr.types import FloatArray
from flgpr_ground.entries import ORACLES
from flgpr_ground.ground import BODY, MINES, Ground, opening_split, scores_at

KINDS = ("metal", "plastic", "ap", "simulant")
"""Kinds of targets in the order of their panels; others come after them."""
SPREAD = 0.36  # of a row, between the marks of its first and of its last tier
ROW = 0.21  # in, height of a row
LONGEST_NAME = 24  # characters of a name beside a panel
PD_AXIS = (-0.03, 1.03)
"""Limits of the axis of Pd: marks at 0 and at 1 stand clear of the frame."""


class _Mark(NamedTuple):
    """How a Pd with its interval is drawn: told apart in black and white, too."""

    marker: str
    color: str
    mfc: str  #: colour of its filling

    def draw(self, panel: Axes, heights: Any, score: Any, size: float = 5) -> None:
        """Draw one score, or those of a table, at heights of a panel."""
        panel.hlines(heights, score["pd_low"], score["pd_high"], color=self.color, lw=1.4, zorder=2)
        panel.plot(score["pd"], heights, ls="", ms=size, mew=1.2, zorder=3, **self._asdict())

    def handle(self, label: str, size: float = 5) -> Line2D:
        """Return its entry of a legend."""
        return Line2D([], [], ms=size, label=label, **self._asdict())


TIER_MARKS = (
    _Mark("o", "C0", "C0"),
    _Mark("s", "C1", "white"),
    _Mark("^", "C2", "C2"),
    _Mark("D", "C4", "white"),
)
"""Of the tiers in turn."""
BOARD_MARKS = {
    "submission": _Mark("D", "C3", "C3"),
    "packaged, or run here": _Mark("o", "C0", "C0"),
    "not ranked": _Mark("o", "0.45", "white"),
}
"""Of the entries of a leaderboard by what they are."""
SMALL = 4  # points, size of a mark among those of several tiers


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
    shown = scores_at(scores, ground, opening_split(ground), group=None)
    tiers = [tier for tier in ground.table.tiers if (shown["tier"] == tier).any()]
    # In the order of their Pd of all mines, by the first tier first; the oracles stand on top.
    mines = shown[shown["group"] == MINES].pivot_table(index="entry", columns="tier", values="pd")
    ordered = mines.reindex(columns=tiers).fillna(-1.0).sort_values(tiers, kind="stable").index
    entries = [name for name in ordered if name not in ORACLES]
    entries += [name for name in ORACLES if name in ordered]
    groups = [name for name in dict.fromkeys(shown["group"]) if name not in (MINES, *ground.sites)]
    kinds = [kind for kind in groups if not kind.startswith(BODY)]
    kinds.sort(key=lambda kind: KINDS.index(kind) if kind in KINDS else len(KINDS))
    columns = min(2, len(kinds)) if narrow else len(kinds)
    rows = math.ceil(len(kinds) / columns)
    width = 3.9 if narrow else 1.5 + 1.55 * columns
    height = 0.5 + rows * (0.6 + ROW * len(entries))
    figure = Figure(figsize=(width, height), layout="constrained")
    grid = figure.subplots(rows, columns, sharey=True, sharex=True, squeeze=False)
    panels = grid.ravel()
    for panel, kind in zip(panels, kinds, strict=False):
        _draw_kind(panel, shown[shown["group"] == kind], kind, tiers, entries)
    for panel in panels[len(kinds) :]:
        panel.set_axis_off()
    # The lowest panel of every column is labelled: the last row may not be full.
    first_lowest = max(len(kinds) - columns, 0)
    for panel in panels[first_lowest : len(kinds)]:
        panel.set_xlabel("Pd", fontsize=8)

    handles: list[Line2D | Patch] = []
    for tier, mark in zip(tiers, cycle(TIER_MARKS), strict=False):
        handles.append(mark.handle(ground.table.tiers[tier].title, SMALL))
    handles.append(Patch(color="0.8", label="what chance finds, at most"))
    figure.legend(
        handles=handles,
        loc="outside upper center",
        ncols=1 if narrow else 3,
        fontsize=8,
        frameon=False,
    )
    return figure


def _draw_kind(
    panel: Axes, scores: pd.DataFrame, kind: str, tiers: Sequence[str], entries: list[str]
) -> None:
    """Draw the panel of one kind of target, whose scores are given."""
    row_heights = np.arange(len(entries), dtype=float)
    _set_rows(panel, row_heights, entries)
    panel.axvspan(PD_AXIS[0], float(scores["chance"].max()), color="0.8", zorder=1, lw=0)

    spread = SPREAD / 2 if len(tiers) > 1 else 0.0
    shifts = np.linspace(spread, -spread, len(tiers))
    target_counts = []
    for tier, shift, mark in zip(tiers, shifts, cycle(TIER_MARKS), strict=False):
        rows = scores[scores["tier"] == tier].set_index("entry").reindex(entries)
        mark.draw(panel, row_heights + shift, rows, SMALL)
        target_counts.append(f"{rows['n_targets'].max():.0f}")

    panel.set_title(f"{kind_label(kind)} ({' | '.join(target_counts)})", fontsize=9)
    panel.set_xticks((0, 0.5, 1))
    panel.tick_params(axis="x", labelbottom=True)


def _set_rows(panel: Axes, row_heights: FloatArray, names: Sequence[str]) -> None:
    """Set the axes of a panel with a row per entry; every second is shaded for the eye to follow."""
    left, right = PD_AXIS
    panel.barh(row_heights[::2], right - left, left=left, height=1.0, color="0.95", zorder=0)
    panel.set(xlim=PD_AXIS, ylim=(-0.5, len(names) - 0.5))
    panel.set_yticks(row_heights, names, fontsize=8)
    panel.tick_params(axis="x", labelsize=8)
    panel.tick_params(axis="y", length=0)
    panel.grid(axis="x", alpha=0.4)


def kind_label(kind: str) -> str:
    """Return the name of a kind of targets as a page shows it."""
    return "AP" if kind == "ap" else kind


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
    shown = scores_at(scores, ground, split, group=None)
    mines = shown[shown["group"] == MINES]
    entries = list(mines.sort_values("pd", kind="stable")["entry"])
    groups = [group for group in dict.fromkeys(shown["group"]) if not group.startswith(BODY)]
    size = (2.2 + 1.7 * len(groups), 1.1 + 0.3 * len(entries))
    figure = Figure(figsize=size, layout="constrained")
    panels = np.atleast_1d(figure.subplots(1, len(groups), sharey=True))
    row_heights = np.arange(len(entries))
    for panel, group in zip(panels, groups, strict=True):
        rows = shown[shown["group"] == group].set_index("entry").reindex(entries)
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
    ratios = {}
    shape = (1, len(tiers))
    size = (0.8 + 4.8 * len(tiers), max(panel_heights, default=1.0 + ROW))
    if narrow:
        shape = shape[::-1]
        size = (4.2, sum(panel_heights) + 0.5)
        ratios = {"height_ratios": [3 + count for count in row_counts]}
    figure = Figure(figsize=size, layout="constrained")
    panels = figure.subplots(*shape, squeeze=False, gridspec_kw=ratios).ravel()
    for panel, (tier, rows) in zip(panels, tiers, strict=True):
        _draw_board(panel, tier, rows, submitted)
    lines = [mark.handle(label) for label, mark in BOARD_MARKS.items()]
    lines.append(Line2D([], [], marker="|", color="0.25", ls="", ms=8, mew=1.5, label="chance"))
    figure.legend(
        handles=[*lines, Patch(color="C0", alpha=0.13, label="interval of the first")],
        loc="outside upper center",
        ncols=2 if narrow else 5 if len(tiers) > 1 else 3,
        fontsize=8,
        frameon=False,
    )
    return figure


def _draw_board(panel: Axes, tier: Ground, rows: Sequence[Any], submitted: Container[str]) -> None:
    """Draw the panel of a tier, the first row on top."""
    row_heights = np.arange(len(rows), dtype=float)[::-1]
    names = []
    for row in rows:  # a long name would leave no room for the panel
        fits = len(row.entry) <= LONGEST_NAME
        names.append(row.entry if fits else f"{row.entry[: LONGEST_NAME - 3]}...")
    _set_rows(panel, row_heights, names)
    first = next((row for row in rows if row.first), None)
    if first is not None:
        low, high = first.score["pd_low"], first.score["pd_high"]
        panel.axvspan(low, high, color="C0", alpha=0.13, lw=0, zorder=1)

    for height, row, label in zip(row_heights, rows, panel.get_yticklabels(), strict=True):
        kind = "submission" if row.entry in submitted else "packaged, or run here"
        BOARD_MARKS[kind if row.first else "not ranked"].draw(panel, height, row.score)
        panel.plot(row.score["chance"], height, "|", color="0.25", ms=8, mew=1.5, zorder=2)
        label.set_fontweight("bold" if row.entry in submitted else "normal")
    targets = rows[0].score["n_targets"] if rows else 0
    title = tier.tier_title or tier.title
    panel.set_title(f"{title} ({targets:.0f} mines)", fontsize=9)
    panel.set_xticks((0, 0.25, 0.5, 0.75, 1))
    panel.set_xlabel("Pd", fontsize=8)
