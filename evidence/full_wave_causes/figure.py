"""The figure of the four experiments: mines found, level of the ground, coherence of the mines' chips."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from full_wave_causes.detection import ALLOWED
from full_wave_causes.lanes import OWN, WITH_OWN_ECHOES
from full_wave_causes.signatures import BANDS

FULL_WAVE = "full wave"
DETECTORS = {
    "C_HH": "C_HH",
    "C_HH, early echoes out": "C_HH, early out",
    "fused": "fused",
    "fused, early echoes out": "fused, early out",
    "fused in the sub-bands of miniature, early echoes out": "fused, early out,\nwide sub-bands",
}
WORLDS = {  # marker, colour, shift up, name
    OWN: ("o", "C0", 0.22, "twins"),
    WITH_OWN_ECHOES: ("s", "C1", 0.0, "twins with the early echoes"),
    FULL_WAVE: ("*", "k", -0.22, FULL_WAVE),
}
TARGETS = ("metal,\n1.5 cm", "metal,\n6 cm", "plastic,\n3 cm")


def draw(found: pd.DataFrame, lane: pd.DataFrame, ground: pd.DataFrame, path: Path) -> None:
    """Write the figure into a file."""
    make_figure(found, lane, ground).savefig(path, dpi=85, metadata={"Software": None})


def make_figure(found: pd.DataFrame, lane: pd.DataFrame, ground: pd.DataFrame) -> Figure:
    """Return a figure of what is found, the level of the ground, and how chips at the mines correlate."""
    figure = Figure(figsize=(13, 5.0), layout="constrained")
    left, middle, right = figure.subplots(1, 3, width_ratios=(1.5, 1, 1))
    handles = _draw_found(left, found)
    _draw_level(middle, ground)
    _draw_coherence(right, lane)
    # Below the axes no legend covers what is drawn.
    below = {"loc": "upper center", "bbox_to_anchor": (0.5, -0.15), "fontsize": 8}
    left.legend(handles=handles, ncols=3, **below)
    middle.legend(ncols=2, **below)
    right.legend(ncols=2, **below)
    return figure


def _draw_found(axes: Axes, found: pd.DataFrame) -> list[Line2D]:
    """Draw how many mines are found; the area of a mark is the share of twins."""
    for world, (marker, colour, shift, _) in WORLDS.items():
        for place, detector in enumerate(DETECTORS):
            chosen = (found["world"] == world) & (found["detector"] == detector)
            some = found[chosen]
            counts = (some["false_alarms"] <= ALLOWED).groupby(some["seed"]).sum()
            for number, lanes in counts.value_counts().items():
                size = 110 if world == FULL_WAVE else 10 + 120 * lanes / len(counts)
                axes.scatter(number, shift - place, s=size, marker=marker, color=colour)
    axes.set_yticks([-place for place in range(len(DETECTORS))], list(DETECTORS.values()))
    axes.set(xlim=(-0.4, 3.4), xticks=range(4), xlabel="mines found of 3, at one false alarm")
    axes.grid(axis="x", alpha=0.3)
    handles = []
    for marker, colour, _, name in WORLDS.values():
        handles.append(Line2D([], [], marker=marker, color=colour, ls="", ms=8, label=name))
    return handles


def _draw_level(axes: Axes, ground: pd.DataFrame) -> None:
    """Draw the level of the ground in HH by sub-band, with and without early echoes."""
    names = list(BANDS)
    number = range(len(names))
    hh = ground[ground["polarization"] == "HH"]
    for out, style in ((False, "k*-"), (True, "k*--")):
        real = hh[(hh["world"] == FULL_WAVE) & (hh["early_out"] == out)].set_index("band")
        label = f"{FULL_WAVE}, early out" if out else FULL_WAVE
        axes.plot(number, real.loc[names, "level_db"], style, ms=9, label=label)
    twins = hh[(hh["world"] == OWN) & ~hh["early_out"]].groupby("band")["level_db"]
    axes.fill_between(
        number, twins.min()[names], twins.max()[names], color="C0", alpha=0.5, label="twins"
    )
    axes.set_xticks(number, [f"{low / 1e9:g}-{high / 1e9:g}" for low, high in BANDS.values()])
    axes.set(xlabel="sub-band (GHz)", ylabel="HH of the ground (dB, absolute)")
    axes.grid(alpha=0.3)


def _draw_coherence(axes: Axes, lane: pd.DataFrame) -> None:
    """Draw the coherence of the chips at the mines with the mines' simulated echoes."""
    for place, target in enumerate(sorted(lane["target"].unique())):
        some = lane[lane["target"] == target]
        of_twins = some["world"] == OWN
        twins = some.loc[of_twins & ~some["early_out"], "coherence"]
        low, middle, high = np.percentile(twins, [2.5, 50, 97.5])
        axes.errorbar(
            place, middle, [[middle - low], [high - middle]], fmt="o", color="C0", capsize=4,
            label=None if place else "twins, 95 %",
        )  # fmt: skip
        for out, shift, fill in ((False, 0.15, "none"), (True, 0.3, "k")):
            real = some.loc[(some["world"] == FULL_WAVE) & (some["early_out"] == out), "coherence"]
            label = f"{FULL_WAVE}, early out" if out else f"{FULL_WAVE}, scans"
            axes.plot(
                [place + shift] * len(real), real, "k*", mfc=fill, ms=9, ls="",
                label=None if place else label,
            )  # fmt: skip
        chance = some.loc[of_twins, "by_chance_95"].median()
        label = None if place else "by chance (95 %)"
        axes.plot([place - 0.2, place + 0.4], [chance] * 2, "C7:", label=label)
    axes.set_xticks(range(len(TARGETS)), TARGETS)
    axes.set(ylim=(0, 1.02), ylabel="coherence with the mine's simulated echo")
    axes.grid(alpha=0.3)
