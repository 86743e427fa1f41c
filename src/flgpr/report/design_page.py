"""The report on an array before it is built: one self-contained HTML page."""

from __future__ import annotations

import math
from collections.abc import Sequence
from operator import itemgetter
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from flgpr.design.array import KINDS, Design, Question, expected_in_words, study
from flgpr.model import load_sensor
from flgpr.progress import Track, silent
from flgpr.report.kit import render, shaded
from flgpr.store.outputs import write_new
from flgpr.types import AnyArray, FloatArray

_BLUE = "#1b5e9b"
_RED = "#c1440e"
_HALF_POWER = -3.01  # dB
_CONTOURS = 4  # between the smallest and the largest width of a map


def design_report(
    sensors: Sequence[str | Path],
    output: str | Path,
    question: Question | None = None,
    track: Track = silent,
) -> list[Design]:
    """Study one to four arrays side by side, write the page and return the designs.

    Parameters
    ----------
    sensors : sequence of str or path
        Presets or TOML files.
    output : path
        HTML file to write.
    question : Question, optional
        Band, window, site and depth of the mines.
    track : callable
        Shows the progress.

    Returns
    -------
    list of Design
        A design per array.

    Raises
    ------
    ValueError
        If there are no sensors or more than four, or one is not valid.
    FileExistsError
        If another page is there already.
    """
    if not 1 <= len(sensors) <= 4:
        raise ValueError(f"sensors must be one to four, got {len(sensors)}")
    path = Path(output)
    asked = question or Question()
    arrays = [load_sensor(sensor) for sensor in sensors]
    designs = [study(array, asked, track) for array in arrays]
    path.parent.mkdir(parents=True, exist_ok=True)
    write_new(path, design_html(designs, asked))
    return designs


def design_html(designs: Sequence[Design], asked: Question) -> str:
    """Return the page of one to four arrays.

    Parameters
    ----------
    designs : sequence of Design
        The arrays, one to four.
    asked : Question
        Band, window, site and depth of the mines.

    Returns
    -------
    str
        The page, HTML without references to other files.
    """
    worst_lobes = [max(design.lobes, key=itemgetter("level")) for design in designs]
    return render(
        "design.html",
        names=" and ".join(design.sensor.name for design in designs),
        designs=designs,
        asked=asked,
        worst=worst_lobes,
        degree=math.degrees(1),
        geometry=antenna_figure(designs),
        spread=spread_figure(designs),
        resolution=resolution_figure(designs),
        lobes=lobe_figure(designs),
        metal=ratio_figure(designs, "metal"),
        plastic=ratio_figure(designs, "plastic"),
        distance=range_figure(designs),
        expected=[expected_in_words(design) for design in designs],
    )


def _rows_of_panels(arrays: int, columns: int, height: float) -> tuple[Figure, AnyArray]:
    """Return a figure with a row of panels, of a height in inches, for each array."""
    figure = Figure(figsize=(11, height * arrays), layout="constrained")
    return figure, figure.subplots(arrays, columns, squeeze=False)


def antenna_figure(designs: Sequence[Design]) -> Figure:
    """Draw the antennas as seen from the ground ahead.

    Parameters
    ----------
    designs : sequence of Design
        The arrays, one to four.

    Returns
    -------
    matplotlib.figure.Figure
        A panel per array, side by side.
    """
    figure = Figure(figsize=(11, 2.4), layout="constrained")
    panels = np.atleast_1d(figure.subplots(1, len(designs)))
    for axes, design in zip(panels, designs, strict=True):
        tx, rx = design.sensor.pairs()
        height = design.sensor.height
        middle = (tx + rx) / 2
        # Midpoints below the antennas, so that they do not hide them; open marks: receivers that
        # also transmit do not hide the transmitters.
        for places, above, style in (
            (middle, -0.25, {"marker": "|", "color": "0.6", "label": "midpoints of the pairs"}),
            (tx, 0.0, {"marker": "^", "color": _RED, "label": "transmitters"}),
            (
                rx,
                0.0,
                {"marker": "v", "color": _BLUE, "ms": 5, "mfc": "none", "label": "receivers"},
            ),
        ):
            axes.plot(places[:, 0], places[:, 2] + height + above, ls="none", **{"ms": 6} | style)
        axes.set(title=design.sensor.name, xlabel="cross-track x (m)", ylabel="height (m)")
        axes.margins(0.1, 0.35)
        axes.legend(fontsize=8, loc="upper center", ncols=3, frameon=False)
    return figure


def spread_figure(designs: Sequence[Design]) -> Figure:
    """Draw the point spread close to the point, 0 to -40 dB.

    Parameters
    ----------
    designs : sequence of Design
        The arrays, one to four.

    Returns
    -------
    matplotlib.figure.Figure
        A row per array and a column per distance.
    """
    figure, rows = _rows_of_panels(len(designs), 3, 3.6)
    for row, design in zip(rows, designs, strict=True):
        for axes, (distance, spread) in zip(row, design.close.items(), strict=True):
            y, x, power = spread
            image = shaded(axes, x, y, power, (-40, 0))
            axes.contour(x, y, power, levels=[_HALF_POWER], colors="white", linewidths=1)
            axes.set(
                title=f"{design.sensor.name}, {distance:.0f} m ahead",
                xlabel="cross-range offset (m)",
            )
        row[0].set_ylabel("down-range offset (m)")
        figure.colorbar(image, ax=list(row), label="dB")
    return figure


def resolution_figure(designs: Sequence[Design]) -> Figure:
    """Draw the half-power widths over the ground.

    Parameters
    ----------
    designs : sequence of Design
        The arrays, one to four.

    Returns
    -------
    matplotlib.figure.Figure
        Widths down-range and cross-range, cm, a row per array.
    """
    figure, rows = _rows_of_panels(len(designs), 2, 3.6)
    for column, (name, title) in enumerate((("down", "down-range"), ("cross", "cross-range"))):
        widths = [100 * getattr(design, name) for design in designs]  # cm
        low = min(np.nanmin(width) for width in widths)
        high = max(np.nanmax(width) for width in widths)
        for axes, design, width in zip(rows[:, column], designs, widths, strict=True):
            image = shaded(axes, design.y, design.x, width.T, (low, high), "gouraud")
            _draw_contours(axes, design, width)
            _label_ground(axes, f"{design.sensor.name}, {title}")
            figure.colorbar(image, ax=axes, label="half-power width (cm)")
    return figure


def _draw_contours(axes: Axes, design: Design, width: FloatArray) -> None:
    """Draw contours of a map (y, x) of widths at whole centimetres between its extremes."""
    steps = np.linspace(np.nanmin(width), np.nanmax(width), _CONTOURS + 2)
    levels = np.unique(np.round(steps[1:-1], 0))
    lines = axes.contour(
        design.y,
        design.x,
        width.T,
        levels=levels,
        colors="white",
        linewidths=0.8,
    )
    axes.clabel(lines, fmt="%.0f cm", fontsize=8)


def _label_ground(axes: Axes, title: str) -> None:
    """Label the axes of a map of the ground."""
    axes.set(title=title, xlabel="ahead y (m)", ylabel="across x (m)")


def lobe_figure(designs: Sequence[Design]) -> Figure:
    """Draw the response over the ground to a point at the middle distance, 0 to -60 dB.

    Parameters
    ----------
    designs : sequence of Design
        The arrays, one to four.

    Returns
    -------
    matplotlib.figure.Figure
        A panel per array; a ring marks the highest lobe.
    """
    figure, rows = _rows_of_panels(len(designs), 1, 3.8)
    for axes, design in zip(rows[:, 0], designs, strict=True):
        distance = list(design.responses)[1]
        y, x, power = design.responses[distance]
        image = shaded(axes, y, x, power.T, (-60, 0))
        # A lobe's place is counted from the point, which lies on the middle line.
        lobe = design.lobes[1]
        lobe_y = distance + lobe["y"]
        middle_x = (design.x[0] + design.x[-1]) / 2
        lobe_x = middle_x + lobe["x"]
        axes.plot(lobe_y, lobe_x, "o", ms=13, mfc="none", mec=_RED, mew=2)
        name = design.sensor.name
        level = lobe["level"]
        title = f"{name}: a point {distance:.0f} m ahead, highest lobe {level:.0f} dB"
        _label_ground(axes, title)
        figure.colorbar(image, ax=axes, label="dB")
    return figure


def ratio_figure(designs: Sequence[Design], kind: str) -> Figure:
    """Draw the signal-to-clutter map of a kind of mine.

    Parameters
    ----------
    designs : sequence of Design
        The arrays, one to four.
    kind : str
        Kind of mine: "metal" or "plastic".

    Returns
    -------
    matplotlib.figure.Figure
        Signal to clutter, dB, a row per array and a column per polarization.
    """
    ratios = [_ratios_of(design, kind) for design in designs]
    columns = max(1, *(len(by_polarization) for by_polarization in ratios))
    figure, rows = _rows_of_panels(len(designs), columns, 3.2)
    # One scale for all maps, so that arrays and polarizations compare.
    maps = [ratio for by_polarization in ratios for ratio in by_polarization.values()]
    low = min((float(ratio.min()) for ratio in maps), default=0.0)
    high = max((float(ratio.max()) for ratio in maps), default=1.0)
    image = None
    for row, design, by_polarization in zip(rows, designs, ratios, strict=True):
        for axes in row[len(by_polarization) :]:
            axes.set_axis_off()
        for axes, (polarization, ratio) in zip(row, by_polarization.items(), strict=False):
            image = shaded(axes, design.ratio_y, design.ratio_x, ratio.T, (low, high))
            _write_values(axes, design, ratio, (low + high) / 2)
            _label_ground(axes, f"{design.sensor.name}, {kind}, {polarization}")
    if image is not None:
        figure.colorbar(image, ax=rows, label="signal to clutter (dB)")
    return figure


def _write_values(axes: Axes, design: Design, ratio: FloatArray, middle: float) -> None:
    """Write the values of a map (y, x) into its cells, dark on cells brighter than the middle."""
    for i, j in np.ndindex(*ratio.shape):
        value = ratio[i, j]
        axes.text(
            float(design.ratio_y[i]),
            float(design.ratio_x[j]),
            f"{value:.0f}",
            color="black" if value > middle else "white",
            fontsize=8,
            ha="center",
            va="center",
        )


def _ratios_of(design: Design, kind: str) -> dict[str, FloatArray]:
    """Return the signal-to-clutter maps of a kind of mine by polarization, sorted."""
    ratios = {}
    for of_kind, polarization in sorted(design.ratio):
        if of_kind == kind:
            ratios[polarization] = design.ratio[of_kind, polarization]
    return ratios


def range_figure(designs: Sequence[Design]) -> Figure:
    """Draw signal to clutter straight ahead against distance.

    Parameters
    ----------
    designs : sequence of Design
        The arrays, one to four.

    Returns
    -------
    matplotlib.figure.Figure
        A panel per kind of mine.
    """
    figure = Figure(figsize=(11, 3.4), layout="constrained")
    colours = [_BLUE, _RED, "#3a7d44", "#6b4c9a"]
    panels = figure.subplots(1, 2, sharey=True)
    for axes, kind in zip(panels, KINDS, strict=True):
        for design, colour in zip(designs, colours, strict=False):
            for (of_kind, polarization), ratio in design.ratio.items():
                if of_kind != kind:
                    continue
                style = "-" if polarization == "HH" else "--"
                middle = ratio.shape[1] // 2
                label = f"{design.sensor.name} {polarization}"
                axes.plot(design.ratio_y, ratio[:, middle], style, color=colour, label=label)
        axes.axhline(0, color="0.5", lw=0.8)
        axes.set(title=f"{kind} mine, straight ahead", xlabel="ahead y (m)")

    first_panel = panels[0]
    first_panel.set_ylabel("signal to clutter (dB)")
    # The last line is that of 0 dB: without others there is nothing to name.
    if first_panel.lines[:-1]:
        first_panel.legend(fontsize=8)
    return figure
