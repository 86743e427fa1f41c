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

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#000000", "#999999")
_MOST_BANDS = 2
_PANELS_WIDE = 3
DASHES = ("-", "--", "-.", ":")


def roc_figure(
    curves: Mapping[str, pd.DataFrame],
    bands: Mapping[str, pd.DataFrame] | None = None,
    far_max: float = 0.1,
    title: str = "",
) -> Figure:
    """Draw ROC curves as staircases, with confidence bands where given; three bands or more each in a panel.

    Curves and bands (see :func:`flgpr.scoring.band`) go by the same names; the curves must share one convention. The
    axis ends at ``far_max``, per m². Where a curve has the column ``chance``, see :func:`flgpr.scoring.chance`, it is
    dotted in the curve's colour.
    """
    conventions = {str(curve.attrs.get("convention")) for curve in curves.values()}
    if len(conventions) > 1:
        raise ValueError(
            f"curves must share one convention to be drawn together, got {', '.join(sorted(conventions))}"
        )
    shown = bands or {}
    panels = len(curves) if len(shown) > _MOST_BANDS else 1
    columns = min(panels, _PANELS_WIDE)
    rows = math.ceil(panels / columns)
    size = (5.2, 4.0) if panels == 1 else (2.6 * columns + 0.4, 2.4 * rows + 0.5)
    figure = _new_figure(figsize=size, dpi=150)
    figure.suptitle(title, fontsize=10)
    plots = figure.subplots(rows, columns, sharex=True, sharey=True, squeeze=False).ravel()
    for number, (name, curve) in enumerate(curves.items()):
        axes = plots[number % panels]
        colour = COLOURS[number % len(COLOURS)]
        if name in shown:
            area = shown[name]
            axes.fill_between(
                area["far"], area["pd_low"], area["pd_high"], color=colour, alpha=0.18, linewidth=0
            )
        label = f"{name} ({int(curve.attrs['n_targets'])})"
        _draw_steps(
            axes,
            curve,
            "pd",
            far_max,
            label=label,
            color=colour,
            ls=DASHES[number % len(DASHES)],
            lw=1.6,
        )
        if "chance" in curve:
            label = "chance" if number < panels else "_"  # once in each legend
            _draw_steps(
                axes, curve, "chance", far_max, label=label, color=colour, ls=(0, (1, 2)), lw=1.2
            )
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


def _draw_steps(axes: Axes, curve: pd.DataFrame, column: str, far_max: float, **style: Any) -> None:
    """Draw the Pd that thresholds do reach: level between them, on to the end of the axis."""
    shown = curve[curve["far"] <= far_max]
    far = np.append(shown["far"], far_max)
    found = np.append(shown[column], shown[column].iloc[-1])
    axes.step(far, found, where="post", **style)


def _new_figure(figsize: tuple[float, float], dpi: int) -> Figure:
    # Drawing is the one part of scoring that needs it, and it takes longer to import than all the
    # rest.
    from matplotlib.figure import Figure

    return Figure(figsize=figsize, dpi=dpi, layout="constrained")


def patch_figure(patches: Sequence[ArrayLike], labels: Sequence[str], columns: int = 6) -> Figure:
    """Draw image patches (y, x), forward upwards, side by side, each on its own grey scale; complex ones by modulus."""
    arrays = [np.asarray(patch) for patch in patches]
    if len(arrays) == 0 or len(arrays) != len(labels):
        raise ValueError(
            f"patches and labels must be equally many and some, got {len(arrays)} and {len(labels)}"
        )
    if any(array.ndim != 2 for array in arrays):
        raise ValueError(
            f"patches must have two dimensions, got {[array.ndim for array in arrays]}"
        )
    rows = math.ceil(len(arrays) / columns)
    figure = _new_figure(figsize=(1.45 * columns, 1.75 * rows), dpi=120)
    for number, (array, label) in enumerate(zip(arrays, labels, strict=True)):
        axes = figure.add_subplot(rows, columns, number + 1)
        axes.imshow(
            np.abs(array) if np.iscomplexobj(array) else array,
            origin="lower",
            cmap="gray",
            aspect="equal",
        )
        axes.set_title(label, fontsize=7)
        axes.set_xticks([])
        axes.set_yticks([])
    return figure


def figure_bytes(figure: Figure, kind: str = "png") -> bytes:
    """Render a figure as "png", "pdf" or "svg", free of dates, so that equal figures give equal files.

    Text is shown as it is: dollar signs in names do not make formulas.
    """
    show_dollar_signs(figure)
    stream = io.BytesIO()
    clean: dict[str, Any] = {
        "png": {"Software": None},
        "pdf": {"CreationDate": None, "Producer": None, "Creator": None},
        "svg": {"Date": None, "Creator": None},
    }
    figure.savefig(stream, format=kind, metadata=clean[kind])
    return stream.getvalue()
