"""Figures of curves and patches, for the report and for papers."""

from __future__ import annotations

import io
import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike

from flgpr.model.figure_text import show_dollar_signs
from flgpr.types import Entries

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#000000", "#999999")
_MOST_BANDS = 2
_PANELS_WIDE = 3
DASHES = ("-", "--", "-.", ":")
GREY_ORDERED = ("#000000", "#d55e00", "#0072b2", "#cc79a7", "#009e73", "#56b4e9")
"""Colours of curves that are compared; neighbours differ in grey, too."""
_DOTS = (0, (1, 2))  # of chance alone
_COMPARED_DASHES = ("-", "--", "-.", (0, (6, 1, 1, 1, 1, 1)))  # dots alone are chance
MARKS = "osD^vP*X"
_DODGE = 0.006  # of the axis, by which the intervals of detectors stand apart
_NO_METADATA: Entries = {
    "png": {"Software": None},
    "pdf": {"CreationDate": None, "Producer": None, "Creator": None},
    "svg": {"Date": None, "Creator": None},
}


def roc_figure(
    curves: Mapping[str, pd.DataFrame],
    bands: Mapping[str, pd.DataFrame] | None = None,
    far_max: float = 0.1,
    title: str = "",
) -> Figure:
    """Draw ROC curves as staircases, with confidence bands if there are any.

    The column ``chance`` of a curve (:func:`flgpr.scoring.chance`) is dotted in the curve's colour.

    Parameters
    ----------
    curves : mapping of str to DataFrame
        ROC tables of one convention, by name.
    bands : mapping of str to DataFrame, optional
        Bands (:func:`flgpr.scoring.band`) by the names of the curves. With three bands or more each
        curve has a panel of its own.
    far_max : float
        End of the axis, per m².
    title : str
        Title of the figure.

    Returns
    -------
    matplotlib.figure.Figure
        The figure.

    Raises
    ------
    ValueError
        If the curves are of several conventions.
    """
    conventions = {str(curve.attrs.get("convention")) for curve in curves.values()}
    if len(conventions) > 1:
        raise ValueError(
            "curves must share one convention to be drawn together, "
            f"got {', '.join(sorted(conventions))}"
        )
    bands = bands or {}
    panels = len(curves) if len(bands) > _MOST_BANDS else 1
    figure, plots = _curve_panels(panels)
    figure.suptitle(title, fontsize=10)
    for number, (name, curve) in enumerate(curves.items()):
        axes = plots[number % panels]
        colour = COLOURS[number % len(COLOURS)]
        if name in bands:
            band = bands[name]
            axes.fill_between(
                band["far"], band["pd_low"], band["pd_high"], color=colour, alpha=0.18, linewidth=0
            )
        targets = int(curve.attrs["n_targets"])
        label = f"{name} ({targets})"
        dashes = DASHES[number % len(DASHES)]
        draw_steps(axes, curve, "pd", far_max, label=label, color=colour, ls=dashes, lw=1.6)
        if "chance" in curve:
            label = "chance" if number < panels else "_"  # once in each legend
            draw_steps(axes, curve, "chance", far_max, label=label, color=colour, ls=_DOTS, lw=1.2)
    for axes in plots[:panels]:
        axes.set(xlim=(0, far_max), ylim=(-0.02, 1.02))
        axes.grid(alpha=0.3)
        if curves:
            axes.legend(title="targets (number)", fontsize=8, title_fontsize=8, loc="best")
    for axes in plots[panels:]:
        axes.remove()
    figure.supxlabel("false alarms per m²", fontsize=10)
    figure.supylabel("probability of detection", fontsize=10)
    return figure


def _curve_panels(panels: int) -> tuple[Figure, Any]:
    """Return a figure for curves, and its axes row by row: the panels, then the unused ones."""
    columns = min(panels, _PANELS_WIDE)
    rows = math.ceil(panels / columns)
    size = (5.2, 4.0)
    if panels > 1:
        size = (2.6 * columns + 0.4, 2.4 * rows + 0.5)
    figure = _new_figure(figsize=size, dpi=150)
    grid = figure.subplots(rows, columns, sharex=True, sharey=True, squeeze=False)
    return figure, grid.ravel()


def compared_roc_figure(
    curves: Mapping[str, pd.DataFrame],
    labels: Mapping[str, str],
    points: pd.DataFrame,
    far_max: float,
    differences: pd.DataFrame | None = None,
) -> Figure:
    """Draw the ROC curves of several detectors over one another, with intervals of Pd.

    Every detector has a line, a mark and a grey level of its own, so that the figure can be read
    without colour. Bars are the exact intervals at the operating points; those of different
    detectors stand a little beside one another. The last alarm of a list that ends before the axis
    does has a mark. A list of a single operating point is that mark alone. Chance is dotted.

    Parameters
    ----------
    curves : mapping of str to DataFrame
        ROC tables by detector.
    labels : mapping of str to str
        Names of the legend by detector.
    points : DataFrame
        Operating points: ``detector``, ``far_allowed`` (per m²), ``pd``, ``pd_low``, ``pd_high``.
    far_max : float
        End of the axis, per m²; it lies farther out where a list of a single operating point does.
    differences : DataFrame, optional
        Of two detectors, Pd of the first less that of the second, drawn below: from ``far_allowed``
        (per m²) on, ``difference``, and its interval ``low`` to ``high``.

    Returns
    -------
    matplotlib.figure.Figure
        The figure.
    """
    end = _end_of_axis(curves, far_max)
    heights = [1.0] if differences is None else [2.2, 1.0]
    figure = _new_figure(figsize=(8.2, 4.6 if differences is None else 6.2), dpi=150)
    grid = figure.subplots(len(heights), 1, sharex=True, squeeze=False, height_ratios=heights)
    panels = grid.ravel()
    axes = panels[0]
    step = _DODGE * end
    for number, (name, curve) in enumerate(curves.items()):
        style: Entries = {
            "color": GREY_ORDERED[number % len(GREY_ORDERED)],
            "ls": _COMPARED_DASHES[number % len(_COMPARED_DASHES)],
            "lw": 1.7,
        }
        mark = MARKS[number % len(MARKS)]
        rows = points[points["detector"] == name]
        if len(curve) <= 2:
            # Of no alarm and of all: no rate below that point says anything of this detector.
            rows = rows[:0]
        else:
            draw_steps(axes, curve, "pd", end, **style)
            if "chance" in curve:
                chance_style = style | {"ls": _DOTS, "lw": 1.0}
                draw_steps(axes, curve, "chance", end, **chance_style)
        offset = (number - (len(curves) - 1) / 2) * step
        _draw_intervals(axes, curve, rows, offset, end, style, mark)
        targets = int(curve.attrs["n_targets"])
        label = f"{labels[name]} ({targets})"
        axes.plot([], [], marker=mark, mfc="white", ms=6, label=label, **style)
    axes.plot([], [], color="0.3", ls=_DOTS, lw=1.0, label="chance")
    axes.set(xlim=(0, end), ylim=(-0.02, 1.02), ylabel="probability of detection")
    axes.grid(alpha=0.3)
    if differences is not None:
        _draw_differences(panels[1], differences, list(labels.values()))
    panels[-1].set_xlabel("false alarms per m²")
    figure.legend(
        title="detector (targets)",
        fontsize=8,
        title_fontsize=8,
        loc="outside upper left",
        ncols=2,  # a narrow screen shows the left of the figure
    )
    return figure


def _draw_differences(axes: Axes, differences: pd.DataFrame, names: Sequence[str]) -> None:
    """Draw the difference of two detectors' Pd with its interval, from one FAR to the next."""
    far = differences["far_allowed"]
    low, high = differences["low"], differences["high"]
    axes.fill_between(
        far, low, high, step="post", color="0.85", lw=0, label="interval of the difference"
    )
    axes.step(far, differences["difference"], where="post", color="k", lw=1.4)
    axes.axhline(0, color="0.4", lw=0.8)
    axes.set_ylabel(f"Pd of {names[0]}\nless {names[1]}", fontsize=8)
    axes.grid(alpha=0.3)


def _end_of_axis(curves: Mapping[str, pd.DataFrame], far_max: float) -> float:
    """Return the end of the axis of FAR, per m²: single operating points lie within it."""
    end = far_max
    for curve in curves.values():
        if len(curve) == 2:
            single_far = float(curve["far"].iloc[-1])
            end = max(end, 1.08 * single_far)
    return end


def _draw_intervals(
    axes: Axes,
    curve: pd.DataFrame,
    points: pd.DataFrame,
    offset: float,
    end: float,
    style: Mapping[str, Any],
    mark: str,
) -> None:
    """Draw the intervals of a detector at its operating points, and at its last alarm."""
    columns = ["far", "pd", "pd_low", "pd_high"]
    rows = points[["far_allowed", "pd", "pd_low", "pd_high"]].set_axis(columns, axis=1)
    last = curve.iloc[[-1]][columns]
    is_at_last = np.isclose(rows["far"], last["far"].iloc[0], rtol=1e-6)
    if not is_at_last.any():
        rows = pd.concat([rows, last])
    rows = rows[rows["far"] <= end]
    far = np.clip(rows["far"] + offset, 0, end)
    colour = style["color"]
    axes.vlines(far, rows["pd_low"], rows["pd_high"], color=colour, lw=1.0, alpha=0.75)
    axes.plot(far, rows["pd"], mark, color=colour, mfc="white", ms=6, mew=1.4)


def draw_steps(axes: Axes, curve: pd.DataFrame, column: str, far_max: float, **style: Any) -> None:
    """Draw the Pd that thresholds do reach: level between them, on to the end of the axis."""
    rows = curve[curve["far"] <= far_max]
    far = np.append(rows["far"], far_max)
    detected = np.append(rows[column], rows[column].iloc[-1])
    axes.step(far, detected, where="post", **style)


def _new_figure(figsize: tuple[float, float], dpi: int) -> Figure:
    """Return an empty figure."""
    # Imported here, because it takes longer than all else that scoring imports.
    from matplotlib.figure import Figure

    return Figure(figsize=figsize, dpi=dpi, layout="constrained")


def patch_figure(patches: Sequence[ArrayLike], labels: Sequence[str], columns: int = 6) -> Figure:
    """Draw image patches side by side, each on its own grey scale.

    Parameters
    ----------
    patches : sequence of (y, x) array_like
        Patches, drawn with y upwards; of complex ones the modulus.
    labels : sequence of str
        A title for each.
    columns : int
        Patches in a row.

    Returns
    -------
    matplotlib.figure.Figure
        The figure.

    Raises
    ------
    ValueError
        If there are none, labels are missing, or a patch has not two dimensions.
    """
    arrays = [np.asarray(patch) for patch in patches]
    if len(arrays) == 0 or len(arrays) != len(labels):
        raise ValueError(
            f"patches and labels must be equally many and some, got {len(arrays)} and {len(labels)}"
        )
    if any(array.ndim != 2 for array in arrays):
        dimensions = [array.ndim for array in arrays]
        raise ValueError(f"patches must have two dimensions, got {dimensions}")
    rows = math.ceil(len(arrays) / columns)
    figure = _new_figure(figsize=(1.45 * columns, 1.75 * rows), dpi=120)
    for number, (array, label) in enumerate(zip(arrays, labels, strict=True)):
        axes = figure.add_subplot(rows, columns, number + 1)
        magnitude = np.abs(array) if np.iscomplexobj(array) else array
        axes.imshow(magnitude, origin="lower", cmap="gray", aspect="equal")
        axes.set_title(label, fontsize=7)
        axes.set_xticks([])
        axes.set_yticks([])
    return figure


def figure_bytes(figure: Figure, kind: str = "png") -> bytes:
    """Render a figure without dates and names of software, so that equal figures give equal files.

    Parameters
    ----------
    figure : matplotlib.figure.Figure
        The figure.
    kind : {"png", "pdf", "svg"}
        Format of the file.

    Returns
    -------
    bytes
        Content of the file. Text is shown as it is: dollar signs in names do not make formulas.
    """
    show_dollar_signs(figure)
    from matplotlib import rc_context

    stream = io.BytesIO()
    # Without a salt the names of an SVG's clip paths and markers are drawn at random.
    with rc_context({"svg.hashsalt": "flgpr"}):
        figure.savefig(stream, format=kind, metadata=_NO_METADATA[kind])
    return stream.getvalue()
