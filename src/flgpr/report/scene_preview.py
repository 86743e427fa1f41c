"""The figure of a scene: plan and section of what is to be simulated."""

from __future__ import annotations

import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle

from flgpr.model import Lane
from flgpr.report.kit import lane_patch
from flgpr.types import FloatArray

_COLOURS = {
    "metal": "C3",
    "plastic": "C0",
    "simulant": "C2",
    "rock": "0.5",
    "post": "black",
    "bush": "C2",
}
_OTHER_COLOUR = "C4"
_MARKERS = {
    "metal": "s",
    "plastic": "^",
    "simulant": "D",
    "rock": ".",
    "post": "|",
    "bush": "*",
    "fiducial": "P",
}
_OTHER_MARKER = "o"
_SECTION_MARGIN = 2.0  # m before and behind the lane


def scene_figure(
    title: str,
    lane: Lane,
    targets: pd.DataFrame,
    objects: pd.DataFrame,
    patches: FloatArray,
    half_width: float,
) -> Figure:
    """Draw a scene from above, targets and objects by kind, and the targets in section.

    Parameters
    ----------
    title : str
        Title of the plan.
    lane : Lane
        Its borders are drawn, m.
    targets : pandas.DataFrame
        ``kind``, ``x``, ``y``, ``top`` and ``bottom`` (depths below ground), m.
    objects : pandas.DataFrame
        ``kind``, ``x``, ``y``, m.
    patches : (patch, 3) ndarray of float
        x, y and radius of wet patches, m.
    half_width : float
        Ground to either side of the lane's axis that is drawn, m.

    Returns
    -------
    matplotlib.figure.Figure
        The plan above, the section below.
    """
    figure = Figure(figsize=(11, 5.6), layout="constrained")
    plan, section = figure.subplots(2, 1, height_ratios=(2.2, 1), sharex=True)
    plan.add_patch(lane_patch(lane, along=True, fc="0.93", ec="0.2", ls="-.", label="lane"))
    for x, y, radius in patches:
        plan.add_patch(Circle((y, x), radius, fc="C9", alpha=0.25, lw=0))
    limits = (lane.y_min - _SECTION_MARGIN, lane.y_max + _SECTION_MARGIN)
    placed = pd.concat([targets[["kind", "x", "y"]], objects])
    is_shown = placed["y"].between(*limits) & placed["x"].abs().le(half_width)
    _add_markers(plan, placed.assign(shown=is_shown))
    plan.set(ylabel="cross-track x (m)", ylim=(-half_width, half_width), title=title)
    plan.legend(fontsize=8, ncols=7, loc="upper center", bbox_to_anchor=(0.5, -0.02), frameon=False)
    for kind, rows in targets.groupby("kind", sort=False):
        colour = _COLOURS.get(str(kind), _OTHER_COLOUR)
        section.vlines(rows["y"], 100 * rows["top"], 100 * rows["bottom"], color=colour, lw=4)
    section.axhline(0, color="saddlebrown")
    section.set(xlabel="down-track y (m)", ylabel="depth (cm)", xlim=limits)
    section.invert_yaxis()
    return figure


def _add_markers(axes: Axes, table: pd.DataFrame) -> None:
    """Add markers at the positions of a table, with a label and a count of those shown by kind."""
    for kind, rows in table.groupby("kind", sort=False):
        shown = int(rows["shown"].sum())
        count = f"{len(rows)}" if shown == len(rows) else f"{shown} of {len(rows)}"
        axes.plot(
            rows["y"],
            rows["x"],
            _MARKERS.get(str(kind), _OTHER_MARKER),
            color=_COLOURS.get(str(kind), _OTHER_COLOUR),
            ms=6,
            ls="none",
            label=f"{kind} ({count})",
        )
