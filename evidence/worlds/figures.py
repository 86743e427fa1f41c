"""Figures of the map of worlds, drawn from its CSV files alone."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from flgpr.report import figure_png
from flgpr.scoring import clopper_pearson
from flgpr.store import write_whole
from worlds.lanes import FAR, KINDS
from worlds.space import AXES, DECLARED
from worlds.tables import read_table

_COLOURS = ("#0b5fa5", "#2a9d5c", "#d98c00", "#b3261e")
_DOTS: dict[str, Any] = {"marker": "o", "ms": 4, "capsize": 2}
_BIN = 3.0  # dB of signal to clutter
_FEWEST = 5  # targets that a bin needs to be drawn


def draw_figures(folder: Path) -> None:
    """Draw every figure whose tables are in a folder, as PNG."""
    for name, (source, make) in FIGURES.items():
        table = read_table(folder, source)
        if not table.empty:
            write_whole(folder / f"{name}.png", figure_png(make(folder, table), 110))


def detection_figure(folder: Path, worlds: pd.DataFrame) -> Figure:
    """Draw Pd of metal and plastic over roughness, a line per permittivity, with the paper's."""
    effects = read_table(folder, "detection-effects")
    figure = Figure(figsize=(9.5, 7.2), layout="constrained")
    grid = figure.subplots(len(FAR), 2, sharex=True, sharey=True, squeeze=False)
    for row, far in enumerate(FAR):
        for column, kind in enumerate(("metal", "plastic")):
            axes = grid[row, column]
            _draw_pd(axes, worlds, effects, kind, far)
            axes.axhline(
                DECLARED["paper"][kind][row], color="k", ls="--", lw=1.2, label="Wang et al. 2007"
            )
            _draw_chance(axes, worlds, far)
            axes.set_title(f"{kind}, {far:g} false alarms per m²", fontsize=10)
    grid[0, 1].legend(fontsize=8, loc="upper right")
    figure.supxlabel("rms height of the surface, mm", fontsize=10)
    figure.supylabel("probability of detection", fontsize=10)
    return figure


def _draw_pd(
    axes: Axes, worlds: pd.DataFrame, effects: pd.DataFrame, kind: str, far: float
) -> None:
    """Draw every world as a point, and the effects for every cell as lines with intervals."""
    levels = AXES["roughness"]
    cells = pd.DataFrame()
    if not effects.empty:
        chosen = (effects["response"] == f"{kind} {far:g}") & (
            effects["axis"] == "roughness x permittivity"
        )
        cells = effects[chosen].set_index("level")
    for number, permittivity in enumerate(AXES["permittivity"]):
        shift = 1.06 ** (number - 1.5)  # apart on the logarithmic axis
        colour = _COLOURS[number]
        rows_of_soil = worlds[worlds["permittivity"] == permittivity]
        share = rows_of_soil[f"{kind}_{far:g}"] / rows_of_soil[f"{kind}_targets"]
        axes.plot(rows_of_soil["roughness"] * shift, share, ".", color=colour, ms=5, alpha=0.5)
        if cells.empty:
            continue
        rows = cells.loc[[f"{level} x {permittivity}" for level in levels]]
        error = [rows["value"] - rows["low"], rows["high"] - rows["value"]]
        positions = np.array(levels) * shift
        label = f"ε' = {permittivity:g}"
        axes.errorbar(positions, rows["value"], error, color=colour, lw=1.3, label=label, **_DOTS)
    axes.set_xscale("log")
    axes.set_xticks(levels, [f"{level:g}" for level in levels])
    axes.set_xticks([], minor=True)
    axes.set_ylim(-0.04, 1.04)
    axes.grid(alpha=0.25)


def _draw_chance(axes: Axes, table: pd.DataFrame, far: float) -> None:
    """Draw what is found by chance."""
    axes.axhline(table[f"chance_{far:g}"].mean(), color="0.5", ls=":", lw=1.2, label="by chance")


def signatures_figure(_folder: Path, targets: pd.DataFrame) -> Figure:
    """Draw the signal to clutter of every body by roughness, and the share of targets found."""
    figure = Figure(figsize=(10.5, 4.8), layout="constrained")
    left, right = figure.subplots(1, 2)
    targets = targets.assign(label=targets["body"] + " (" + targets["kind"] + ")")
    order = targets.groupby("label")["ratio_db"].mean().sort_values().index
    for number, roughness in enumerate(AXES["roughness"]):
        ratios = targets[targets["roughness"] == roughness].groupby("label")["ratio_db"]
        middle = ratios.median().reindex(order)
        low = ratios.quantile(0.25).reindex(order)
        high = ratios.quantile(0.75).reindex(order)
        positions = np.arange(len(order)) + 0.16 * (1.5 - number)
        label = f"{roughness:g} mm rms"
        error = [middle - low, high - middle]
        colour = _COLOURS[number]
        left.errorbar(
            middle, positions, xerr=error, fmt="o", color=colour, ms=4, lw=1.2, label=label
        )
    left.set_yticks(range(len(order)), order, fontsize=8)
    left.set_xlabel("signal to clutter, dB: median and quarters of the targets", fontsize=9)
    left.grid(alpha=0.25)
    left.legend(fontsize=8)
    for kind, colour in zip(KINDS, _COLOURS, strict=False):
        _draw_found(right, targets[targets["kind"] == kind], kind, colour)
    _draw_chance(right, targets, FAR[-1])
    right.set_ylim(-0.04, 1.04)
    right.set_xlabel("signal to clutter, dB", fontsize=9)
    right.set_ylabel(f"share found at {FAR[-1]:g} false alarms per m²", fontsize=9)
    right.grid(alpha=0.25)
    right.legend(fontsize=8)
    return figure


def _draw_found(axes: Axes, targets: pd.DataFrame, label: str, colour: str) -> None:
    """Draw the share of targets found by signal to clutter, with exact intervals."""
    number = np.floor(targets["ratio_db"] / _BIN)
    middles = []
    shares = []
    below = []
    above = []
    for bin_number, inside in targets.groupby(number):
        if len(inside) < _FEWEST:
            continue
        n_found = int((inside["far"] <= FAR[-1]).sum())
        low, high = clopper_pearson(n_found, len(inside))
        share = n_found / len(inside)
        middles.append((bin_number + 0.5) * _BIN)
        shares.append(share)
        below.append(share - float(low))
        above.append(float(high) - share)
    if middles:
        axes.errorbar(middles, shares, [below, above], color=colour, lw=1.2, label=label, **_DOTS)


def ablation_figure(_folder: Path, costs: pd.DataFrame) -> Figure:
    """Draw what every part costs, added to the smooth road and taken from the natural one."""
    titles = {"smooth": "added to the smooth road", "natural": "taken from the natural road"}
    responses = {
        f"plastic {FAR[-1]:g}": "Pd of plastic",
        f"metal {FAR[-1]:g}": "Pd of metal",
        "plastic ratio_db": "signal to clutter of plastic, dB",
    }
    figure = Figure(figsize=(11, 6.6), layout="constrained")
    grid = figure.subplots(2, 3, sharex="col", squeeze=False)
    for row, (road, title) in enumerate(titles.items()):
        for column, (response, response_title) in enumerate(responses.items()):
            axes = grid[row, column]
            chosen = costs[(costs["road"] == road) & (costs["response"] == response)]
            _draw_costs(axes, chosen, names=column == 0)
            unchanged = (
                f", {chosen['unchanged'].iloc[0]:.2f} without a change" if len(chosen) else ""
            )
            axes.set_title(f"{title}{unchanged}", fontsize=8.5)
            if row == 1:
                far = "" if "ratio" in response else f", {FAR[-1]:g} false alarms per m²"
                axes.set_xlabel(f"change of {response_title}{far}", fontsize=8.5)
    return figure


def _draw_costs(axes: Axes, costs: pd.DataFrame, names: bool) -> None:
    """Draw differences with intervals.

    Filled marks are those of differences that are clear of zero for all parts together.
    """
    positions = np.arange(len(costs))[::-1]
    for position, (_, cost) in zip(positions, costs.iterrows(), strict=True):
        ends = [cost["low"], cost["high"]]
        if np.isfinite(ends).all():
            axes.plot(ends, [position, position], "-", color="0.35", lw=1.4)
        face = _COLOURS[0] if cost["clear"] else "white"
        axes.plot(cost["difference"], position, "o", color=_COLOURS[0], mfc=face, ms=6)
    axes.axvline(0, color="k", lw=0.8)
    labels = costs["change"] if names else [""] * len(costs)
    axes.set_yticks(positions, labels, fontsize=9)
    axes.set_ylim(-0.7, len(costs) - 0.3)
    axes.grid(alpha=0.25, axis="x")


def geometry_figure(folder: Path, means: pd.DataFrame) -> Figure:
    """Draw Pd of metal and plastic by the array's height and the ground that is used."""
    figure = Figure(figsize=(9.5, 4.2), layout="constrained")
    grid = figure.subplots(1, 2, sharey=True)
    grounds = list(dict.fromkeys(zip(means["nearest"], means["farthest"], strict=True)))
    for axes, kind in zip(grid, ("metal", "plastic"), strict=True):
        for number, height in enumerate(sorted(means["height"].unique())):
            is_chosen = means["height"] == height
            is_chosen &= means["response"] == f"{kind} {FAR[-1]:g}"
            cells = means[is_chosen].set_index(["nearest", "farthest"]).reindex(grounds)
            positions = np.arange(len(grounds)) + 0.1 * (number - 1)
            error = np.nan_to_num([cells["value"] - cells["low"], cells["high"] - cells["value"]])
            label = f"{height:g} m high"
            colour = _COLOURS[number]
            axes.errorbar(
                positions, cells["value"], error, fmt="o", color=colour, capsize=2, label=label
            )
        chance = read_table(folder, "geometry")[f"chance_{FAR[-1]:g}"].mean()
        axes.axhline(chance, color="0.4", lw=1, ls=":", label="by chance")
        labels = [f"{nearest:g} to {farthest:g} m" for nearest, farthest in grounds]
        axes.set_xticks(range(len(grounds)), labels, fontsize=9)
        axes.set_title(f"{kind}, {FAR[-1]:g} false alarms per m²", fontsize=10)
        axes.set_ylim(-0.04, 1.04)
        axes.grid(alpha=0.25)
    grid[0].set_ylabel("probability of detection", fontsize=9)
    grid[1].legend(fontsize=8)
    figure.supxlabel("ground used, ahead of the array", fontsize=9)
    return figure


FIGURES: dict[str, tuple[str, Callable[[Path, pd.DataFrame], Figure]]] = {
    "detection": ("detection", detection_figure),
    "signatures": ("detection-mines", signatures_figure),
    "ablation": ("ablation-costs", ablation_figure),
    "geometry": ("geometry-means", geometry_figure),
}
"""The table without which there is no figure, and what draws it, by the figure's name."""
