"""The report on an array before it is built: one self-contained HTML page."""

from __future__ import annotations

import math
from collections.abc import Sequence
from html import escape
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from flgpr import __version__
from flgpr.io import write_whole
from flgpr.model import load_sensor
from flgpr.pipeline.design import KINDS, Design, Question, study
from flgpr.pipeline.figures import data_url
from flgpr.pipeline.html import html_image, html_page, html_table
from flgpr.pipeline.progress import Track, silent

_BLUE, _RED = "#1b5e9b", "#c1440e"
_SHADES = "viridis"


def design_report(
    sensors: Sequence[str | Path], output: str | Path, question: Question | None = None, track: Track = silent
) -> list[Design]:
    """Study arrays and write the report on them.

    Parameters
    ----------
    sensors : sequence of str or path
        Presets or TOML files; several are compared side by side.
    output : str or Path
        HTML file to write.
    question : Question, optional
        Band, window, site and depth.
    track : Track
        Shows progress.

    Returns
    -------
    list of Design
        The findings.

    Raises
    ------
    FileExistsError
        If the output exists.
    ValueError
        If a sensor or the question is not valid.
    """
    path = Path(output)
    if path.exists():
        raise FileExistsError(f"output must not exist yet, got {path}")
    asked = question or Question()
    designs = [study(load_sensor(sensor), asked, track) for sensor in sensors]
    path.parent.mkdir(parents=True, exist_ok=True)
    write_whole(path, design_html(designs, asked))
    return designs


def design_html(designs: Sequence[Design], asked: Question) -> str:
    """Write the page.

    Parameters
    ----------
    designs : sequence of Design
        The arrays, at most four.
    asked : Question
        What was asked.

    Returns
    -------
    str
        HTML that needs nothing beside it.

    Raises
    ------
    ValueError
        If there is no array, or more than four.
    """
    if not 1 <= len(designs) <= 4:
        raise ValueError(f"designs must be one to four, got {len(designs)}")
    names = " and ".join(design.sensor.name for design in designs)
    parts = [
        f"<h1>{escape(names)}: what the array will see</h1>",
        f"<p class=lead>{escape(_lead(designs, asked))}</p>",
        _facts_table(designs),
        html_image(data_url(geometry_figure(designs)), "positions of the antennas"),
        "<h2>Point spread</h2>",
        "<p>The image of a point on the ground at three distances straight ahead, dB below its peak. The white line is "
        "half power.</p>",
        html_image(data_url(spread_figure(designs)), "point spread at three distances"),
        "<h2>Resolution over the ground</h2>",
        "<p>Half-power width of the point spread along each axis. Down-range it follows from the band and the angle at "
        "which the ground is seen, cross-range from the wavelength over the width of the array.</p>",
        html_image(data_url(resolution_figure(designs)), "resolution down-range and cross-range over the ground"),
        "<h2>Lobes beyond the peak</h2>",
        f"<p>{escape(_lobe_words(designs))}</p>",
        html_image(data_url(lobe_figure(designs)), "response over the whole ground to one point"),
        _lobe_table(designs),
        "<h2>Expected signal to clutter</h2>",
        f"<p>{escape(_ratio_words(asked))}</p>",
        html_image(data_url(ratio_figure(designs, "metal")), "signal to clutter of a metal mine over the ground"),
        html_image(data_url(ratio_figure(designs, "plastic")), "signal to clutter of a plastic mine over the ground"),
        html_image(data_url(range_figure(designs)), "signal to clutter against distance"),
        "<h2>What this leaves out</h2>",
        f"<p>{escape(_LIMITS)}</p>",
        f"<p class=note>flgpr {escape(__version__)}. Sources: "
        + "; ".join(f"{escape(d.sensor.name)}: {escape(d.sensor.source)}" for d in designs)
        + "</p>",
    ]
    return html_page(f"{names} - design", parts)


_LIMITS = (
    "Point spread, resolution and lobes are of image formation alone: level array, flat ground, every pair alike, no antenna pattern. "
    "Signal to clutter has pattern and spreading, and clutter from the surface alone: no rocks, bushes, thermal noise, self-signature, "
    "interference, errors of position, nor the rough surface's disturbance of what lies below it (which is strong above some gigahertz); each of these "
    "lowers it. One look from one place is counted; a detector has several. Soil and "
    "roughness are those of the site named above, and other ground may differ by more than the arrays do. The mines' echoes are ray "
    "physics, whose errors of some decibels are documented."
)


def _lead(designs: Sequence[Design], asked: Question) -> str:
    best = []
    for design in designs:
        low, high = (design.facts[name] / 1e9 for name in ("lowest", "highest"))
        middle = len(design.y) // 2
        column = len(design.x) // 2
        best.append(
            f"{design.sensor.name}, {low:.4g} to {high:.4g} GHz: {100 * design.down[middle, column]:.0f} cm down-range by "
            f"{100 * design.cross[middle, column]:.0f} cm cross-range at {design.y[middle]:.0f} m."
        )
    return " ".join(best) + f" Window {asked.window}, site {asked.site}, mines {100 * asked.depth:.0f} cm deep."


def _facts_table(designs: Sequence[Design]) -> str:
    rows: list[tuple[str, Any]] = [
        ("transmitters", lambda f: f"{f['transmitters']:.0f}"),
        ("receivers", lambda f: f"{f['receivers']:.0f}"),
        ("pairs", lambda f: f"{f['pairs']:.0f}"),
        ("width of the pairs' midpoints (m)", lambda f: f"{f['aperture']:.2f}"),
        ("height (m)", lambda f: f"{f['height']:.2f}"),
        ("band (GHz)", lambda f: f"{f['lowest'] / 1e9:.4g} to {f['highest'] / 1e9:.4g}"),
        ("tones", lambda f: f"{f['tones']:.0f}"),
        ("unambiguous range (m)", lambda f: f"{f['unambiguous_range']:.1f}"),
        ("widest gap between midpoints (cm)", lambda f: f"{100 * f['widest_gap']:.1f}"),
        ("grating lobes at the highest tone beyond (degrees)", lambda f: _degrees(f["grating_angle"])),
    ]
    head = ["*", *(design.sensor.name for design in designs)]
    return html_table(head, [[title, *(form(design.facts) for design in designs)] for title, form in rows])


def _degrees(angle: float) -> str:
    return "none" if math.isnan(angle) else f"{math.degrees(angle):.0f}"


def geometry_figure(designs: Sequence[Design]) -> Figure:
    """Draw where the antennas stand, seen from the ground ahead.

    Parameters
    ----------
    designs : sequence of Design
        The arrays.

    Returns
    -------
    Figure
        A panel per array.
    """
    figure = Figure(figsize=(11, 2.4), layout="constrained")
    for axes, design in zip(np.atleast_1d(figure.subplots(1, len(designs))), designs, strict=True):
        tx, rx = design.sensor.pairs()
        height = design.sensor.height
        middle = (tx + rx) / 2
        axes.plot(middle[:, 0], middle[:, 2] + height - 0.25, "|", color="0.6", ms=6, label="midpoints of the pairs")
        axes.plot(tx[:, 0], tx[:, 2] + height, "^", color=_RED, ms=6, label="transmitters")
        axes.plot(rx[:, 0], rx[:, 2] + height, "v", color=_BLUE, ms=5, mfc="none", label="receivers")
        axes.set(title=design.sensor.name, xlabel="cross-track x (m)", ylabel="height (m)")
        axes.margins(0.1, 0.35)
        axes.legend(fontsize=8, loc="upper center", ncols=3, frameon=False)
    return figure


def spread_figure(designs: Sequence[Design]) -> Figure:
    """Draw the point spread close to the point, an array per row and a distance per column.

    Parameters
    ----------
    designs : sequence of Design
        The arrays.

    Returns
    -------
    Figure
        Panels share their colours, 0 to -40 dB.
    """
    figure = Figure(figsize=(11, 3.6 * len(designs)), layout="constrained")
    rows = figure.subplots(len(designs), 3, squeeze=False)
    for row, design in zip(rows, designs, strict=True):
        for axes, (distance, (y, x, power)) in zip(row, design.close.items(), strict=True):
            image = axes.pcolormesh(x, y, power, vmin=-40, vmax=0, cmap=_SHADES, shading="nearest", rasterized=True)
            axes.contour(x, y, power, levels=[-3.01], colors="white", linewidths=1)
            axes.set(title=f"{design.sensor.name}, {distance:.0f} m ahead", xlabel="cross-range offset (m)")
        row[0].set_ylabel("down-range offset (m)")
        figure.colorbar(image, ax=list(row), label="dB")
    return figure


def resolution_figure(designs: Sequence[Design]) -> Figure:
    """Draw the half-power widths over the ground, an array per row.

    Parameters
    ----------
    designs : sequence of Design
        The arrays.

    Returns
    -------
    Figure
        Down-range on the left, cross-range on the right; each column shares its colours.
    """
    figure = Figure(figsize=(11, 3.6 * len(designs)), layout="constrained")
    rows = figure.subplots(len(designs), 2, squeeze=False)
    for column, (name, title) in enumerate((("down", "down-range"), ("cross", "cross-range"))):
        values = [100 * getattr(design, name) for design in designs]
        low, high = min(map(np.nanmin, values)), max(map(np.nanmax, values))
        for row, design, value in zip(rows, designs, values, strict=True):
            image = row[column].pcolormesh(
                design.y, design.x, value.T, vmin=low, vmax=high, cmap=_SHADES, shading="gouraud", rasterized=True
            )
            levels = np.unique(np.round(np.linspace(np.nanmin(value), np.nanmax(value), 6)[1:-1], 0))
            lines = row[column].contour(design.y, design.x, value.T, levels=levels, colors="white", linewidths=0.8)
            row[column].clabel(lines, fmt="%.0f cm", fontsize=8)
            row[column].set(title=f"{design.sensor.name}, {title}", xlabel="ahead y (m)", ylabel="across x (m)")
            figure.colorbar(image, ax=row[column], label="half-power width (cm)")
    return figure


def lobe_figure(designs: Sequence[Design]) -> Figure:
    """Draw the response over the whole ground to a point at the middle distance, its highest lobe ringed.

    Parameters
    ----------
    designs : sequence of Design
        The arrays.

    Returns
    -------
    Figure
        A panel per array, 0 to -60 dB.
    """
    figure = Figure(figsize=(11, 3.8 * len(designs)), layout="constrained")
    for axes, design in zip(figure.subplots(len(designs), 1, squeeze=False)[:, 0], designs, strict=True):
        distance = list(design.responses)[1]
        y, x, power = design.responses[distance]
        image = axes.pcolormesh(y, x, power.T, vmin=-60, vmax=0, cmap=_SHADES, shading="nearest", rasterized=True)
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


def _lobe_words(designs: Sequence[Design]) -> str:
    text = (
        "A strong echo shows weak copies of itself elsewhere: side lobes close by, grating lobes where the array is "
        "sparser than half a wavelength between midpoints. The band smears grating lobes, since each tone has its own."
    )
    for design in designs:
        worst = max(design.lobes, key=lambda one: one["level"])
        text += (
            f" {design.sensor.name}: at most {worst['level']:.0f} dB, {worst['x']:+.1f} m across and {worst['y']:+.1f} m "
            f"along from a point {worst['distance']:.0f} m ahead."
        )
    return text


def _lobe_table(designs: Sequence[Design]) -> str:
    rows = [
        [
            design.sensor.name,
            f"{one['distance']:.0f}",
            f"{100 * one['down']:.0f}",
            f"{100 * one['cross']:.0f}",
            f"{one['level']:.1f}",
            f"{one['x']:+.2f}",
            f"{one['y']:+.2f}",
        ]
        for design in designs
        for one in design.lobes
    ]
    head = ["*array", "point ahead (m)", "down-range width (cm)", "cross-range width (cm)", "highest lobe (dB)"]
    return html_table([*head, "across (m)", "along (m)"], rows)


def _ratio_words(asked: Question) -> str:
    return (
        f"Peak of a level mine (radius 16 cm, height 15 cm, top {100 * asked.depth:.0f} cm deep) on its own, over the mean "
        f"power of bare ground of the site {asked.site} around it, both simulated without the radar's errors and imaged "
        "with the same band and window. Detection needs more than 0 dB; how much more depends on the detector."
    )


def ratio_figure(designs: Sequence[Design], kind: str) -> Figure:
    """Draw the signal-to-clutter map of a kind of mine, an array per row and a polarization per column.

    Parameters
    ----------
    designs : sequence of Design
        The arrays.
    kind : str
        "metal" or "plastic".

    Returns
    -------
    Figure
        All panels share their colours.
    """
    labels = [sorted({p for k, p in design.ratio if k == kind}) for design in designs]
    columns = max(1, *map(len, labels))
    figure = Figure(figsize=(11, 3.2 * len(designs)), layout="constrained")
    rows = figure.subplots(len(designs), columns, squeeze=False)
    values = [design.ratio[kind, p] for design, some in zip(designs, labels, strict=True) for p in some]
    low, high = (min(map(np.min, values)), max(map(np.max, values))) if values else (0.0, 1.0)
    image = None
    for row, design, some in zip(rows, designs, labels, strict=True):
        for axes in row[len(some) :]:
            axes.set_axis_off()
        for axes, label in zip(row, some, strict=False):
            value = design.ratio[kind, label]
            image = axes.pcolormesh(
                design.ratio_y, design.ratio_x, value.T, vmin=low, vmax=high, cmap=_SHADES, shading="nearest"
            )
            for i, j in np.ndindex(*value.shape):
                dark = value[i, j] > (low + high) / 2
                colour = "black" if dark else "white"
                where = (design.ratio_y[i], design.ratio_x[j])
                axes.text(*where, f"{value[i, j]:.0f}", color=colour, fontsize=8, ha="center", va="center")
            axes.set(title=f"{design.sensor.name}, {kind}, {label}", xlabel="ahead y (m)", ylabel="across x (m)")
    if image is not None:
        figure.colorbar(image, ax=rows, label="signal to clutter (dB)")
    return figure


def range_figure(designs: Sequence[Design]) -> Figure:
    """Draw signal to clutter straight ahead against distance, a panel per kind of mine.

    Parameters
    ----------
    designs : sequence of Design
        The arrays.

    Returns
    -------
    Figure
        A line per array and polarization.
    """
    figure = Figure(figsize=(11, 3.4), layout="constrained")
    colours = [_BLUE, _RED, "#3a7d44", "#6b4c9a"]
    for axes, kind in zip(figure.subplots(1, 2, sharey=True), KINDS, strict=True):
        for design, colour in zip(designs, colours, strict=False):
            for (one, label), value in design.ratio.items():
                if one == kind:
                    style = "-" if label == "HH" else "--"
                    middle = value[:, value.shape[1] // 2]
                    axes.plot(design.ratio_y, middle, style, color=colour, label=f"{design.sensor.name} {label}")
        axes.axhline(0, color="0.5", lw=0.8)
        axes.set(title=f"{kind} mine, straight ahead", xlabel="ahead y (m)")
    figure.axes[0].set_ylabel("signal to clutter (dB)")
    if figure.axes[0].lines[:-1]:
        figure.axes[0].legend(fontsize=8)
    return figure
