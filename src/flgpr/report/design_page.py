"""The report on an array before it is built: one self-contained HTML page."""

from __future__ import annotations

import math
from collections.abc import Sequence
from operator import itemgetter
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from flgpr.chain.progress import Track, silent
from flgpr.design.array import KINDS, Design, Question, expected_in_words, study
from flgpr.model import load_sensor
from flgpr.report.kit import render
from flgpr.store.outputs import write_new

_BLUE = "#1b5e9b"
_RED = "#c1440e"
_SHADES = "viridis"


def design_report(
    sensors: Sequence[str | Path],
    output: str | Path,
    question: Question | None = None,
    track: Track = silent,
) -> list[Design]:
    """Study one to four arrays (presets or TOML) side by side, write the page and give the findings.

    Another page that is there already is a FileExistsError.
    """
    if not 1 <= len(sensors) <= 4:
        raise ValueError(f"sensors must be one to four, got {len(sensors)}")
    path = Path(output)
    asked = question or Question()
    designs = [study(load_sensor(sensor), asked, track) for sensor in sensors]
    path.parent.mkdir(parents=True, exist_ok=True)
    write_new(path, design_html(designs, asked))
    return designs


def design_html(designs: Sequence[Design], asked: Question) -> str:
    """Write the page of one to four arrays."""
    return render(
        "design.html",
        names=" and ".join(design.sensor.name for design in designs),
        designs=designs,
        asked=asked,
        worst=[max(design.lobes, key=itemgetter("level")) for design in designs],
        degree=math.degrees(1),
        geometry=geometry_figure(designs),
        spread=spread_figure(designs),
        resolution=resolution_figure(designs),
        lobes=lobe_figure(designs),
        metal=ratio_figure(designs, "metal"),
        plastic=ratio_figure(designs, "plastic"),
        distance=range_figure(designs),
        expected=[expected_in_words(design) for design in designs],
    )


def geometry_figure(designs: Sequence[Design]) -> Figure:
    """Draw where the antennas stand, seen from the ground ahead."""
    figure = Figure(figsize=(11, 2.4), layout="constrained")
    for axes, design in zip(np.atleast_1d(figure.subplots(1, len(designs))), designs, strict=True):
        tx, rx = design.sensor.pairs()
        height = design.sensor.height
        middle = (tx + rx) / 2
        axes.plot(
            middle[:, 0],
            middle[:, 2] + height - 0.25,
            "|",
            color="0.6",
            ms=6,
            label="midpoints of the pairs",
        )
        axes.plot(tx[:, 0], tx[:, 2] + height, "^", color=_RED, ms=6, label="transmitters")
        axes.plot(
            rx[:, 0], rx[:, 2] + height, "v", color=_BLUE, ms=5, mfc="none", label="receivers"
        )
        axes.set(title=design.sensor.name, xlabel="cross-track x (m)", ylabel="height (m)")
        axes.margins(0.1, 0.35)
        axes.legend(fontsize=8, loc="upper center", ncols=3, frameon=False)
    return figure


def spread_figure(designs: Sequence[Design]) -> Figure:
    """Draw the point spread close to the point, an array per row and a distance per column, 0 to -40 dB."""
    figure = Figure(figsize=(11, 3.6 * len(designs)), layout="constrained")
    rows = figure.subplots(len(designs), 3, squeeze=False)
    for row, design in zip(rows, designs, strict=True):
        for axes, (distance, (y, x, power)) in zip(row, design.close.items(), strict=True):
            image = axes.pcolormesh(
                x, y, power, vmin=-40, vmax=0, cmap=_SHADES, shading="nearest", rasterized=True
            )
            axes.contour(x, y, power, levels=[-3.01], colors="white", linewidths=1)
            axes.set(
                title=f"{design.sensor.name}, {distance:.0f} m ahead",
                xlabel="cross-range offset (m)",
            )
        row[0].set_ylabel("down-range offset (m)")
        figure.colorbar(image, ax=list(row), label="dB")
    return figure


def resolution_figure(designs: Sequence[Design]) -> Figure:
    """Draw the half-power widths over the ground, an array per row."""
    figure = Figure(figsize=(11, 3.6 * len(designs)), layout="constrained")
    rows = figure.subplots(len(designs), 2, squeeze=False)
    for column, (name, title) in enumerate((("down", "down-range"), ("cross", "cross-range"))):
        values = [100 * getattr(design, name) for design in designs]
        low = min(map(np.nanmin, values))
        high = max(map(np.nanmax, values))
        for row, design, value in zip(rows, designs, values, strict=True):
            image = row[column].pcolormesh(
                design.y,
                design.x,
                value.T,
                vmin=low,
                vmax=high,
                cmap=_SHADES,
                shading="gouraud",
                rasterized=True,
            )
            levels = np.unique(
                np.round(np.linspace(np.nanmin(value), np.nanmax(value), 6)[1:-1], 0)
            )
            lines = row[column].contour(
                design.y, design.x, value.T, levels=levels, colors="white", linewidths=0.8
            )
            row[column].clabel(lines, fmt="%.0f cm", fontsize=8)
            row[column].set(
                title=f"{design.sensor.name}, {title}", xlabel="ahead y (m)", ylabel="across x (m)"
            )
            figure.colorbar(image, ax=row[column], label="half-power width (cm)")
    return figure


def lobe_figure(designs: Sequence[Design]) -> Figure:
    """Draw the response over the ground to a point at the middle distance, 0 to -60 dB, its highest lobe ringed."""
    figure = Figure(figsize=(11, 3.8 * len(designs)), layout="constrained")
    for axes, design in zip(
        figure.subplots(len(designs), 1, squeeze=False)[:, 0], designs, strict=True
    ):
        distance = list(design.responses)[1]
        y, x, power = design.responses[distance]
        image = axes.pcolormesh(
            y, x, power.T, vmin=-60, vmax=0, cmap=_SHADES, shading="nearest", rasterized=True
        )
        lobe = design.lobes[1]
        middle = (design.x[0] + design.x[-1]) / 2
        axes.plot(distance + lobe["y"], middle + lobe["x"], "o", ms=13, mfc="none", mec=_RED, mew=2)
        axes.set(
            title=f"{design.sensor.name}: a point {distance:.0f} m ahead, highest lobe {lobe['level']:.0f} dB",
            xlabel="ahead y (m)",
            ylabel="across x (m)",
        )
        figure.colorbar(image, ax=axes, label="dB")
    return figure


def ratio_figure(designs: Sequence[Design], kind: str) -> Figure:
    """Draw the signal-to-clutter map of a kind of mine, an array per row and a polarization per column."""
    labels = [sorted({p for k, p in design.ratio if k == kind}) for design in designs]
    columns = max(1, *map(len, labels))
    figure = Figure(figsize=(11, 3.2 * len(designs)), layout="constrained")
    rows = figure.subplots(len(designs), columns, squeeze=False)
    values = [
        design.ratio[kind, p] for design, some in zip(designs, labels, strict=True) for p in some
    ]
    low, high = (min(map(np.min, values)), max(map(np.max, values))) if values else (0.0, 1.0)
    image = None
    for row, design, some in zip(rows, designs, labels, strict=True):
        for axes in row[len(some) :]:
            axes.set_axis_off()
        for axes, label in zip(row, some, strict=False):
            value = design.ratio[kind, label]
            y = design.ratio_y
            x = design.ratio_x
            image = axes.pcolormesh(
                y, x, value.T, vmin=low, vmax=high, cmap=_SHADES, shading="nearest"
            )
            for i, j in np.ndindex(*value.shape):
                colour = "black" if value[i, j] > (low + high) / 2 else "white"
                axes.text(
                    y[i],
                    x[j],
                    f"{value[i, j]:.0f}",
                    color=colour,
                    fontsize=8,
                    ha="center",
                    va="center",
                )
            axes.set(
                title=f"{design.sensor.name}, {kind}, {label}",
                xlabel="ahead y (m)",
                ylabel="across x (m)",
            )
    if image is not None:
        figure.colorbar(image, ax=rows, label="signal to clutter (dB)")
    return figure


def range_figure(designs: Sequence[Design]) -> Figure:
    """Draw signal to clutter straight ahead against distance, a panel per kind of mine."""
    figure = Figure(figsize=(11, 3.4), layout="constrained")
    colours = [_BLUE, _RED, "#3a7d44", "#6b4c9a"]
    for axes, kind in zip(figure.subplots(1, 2, sharey=True), KINDS, strict=True):
        for design, colour in zip(designs, colours, strict=False):
            for (one, label), value in design.ratio.items():
                if one == kind:
                    style = "-" if label == "HH" else "--"
                    middle = value[:, value.shape[1] // 2]
                    axes.plot(
                        design.ratio_y,
                        middle,
                        style,
                        color=colour,
                        label=f"{design.sensor.name} {label}",
                    )
        axes.axhline(0, color="0.5", lw=0.8)
        axes.set(title=f"{kind} mine, straight ahead", xlabel="ahead y (m)")
    figure.axes[0].set_ylabel("signal to clutter (dB)")
    if figure.axes[0].lines[:-1]:
        figure.axes[0].legend(fontsize=8)
    return figure
