"""The figures of a report."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from functools import partial
from textwrap import fill

import numpy as np
import pandas as pd
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Circle

from flgpr.method.detection import Detection
from flgpr.model import Lane
from flgpr.report.curve_figures import draw_steps
from flgpr.report.kit import decibels, lane_patch, shaded, strongest
from flgpr.results.description import plausible_poses
from flgpr.results.result import Result, thinned
from flgpr.scoring import Score
from flgpr.screen import select
from flgpr.types import Entries, FloatArray, floats

DYNAMIC_RANGE = 30.0  # dB
_ROWS = 2400  # a figure cannot show more
_LONG = 12.0  # lanes longer than so many times their width are not drawn to scale
_RANKS = 100  # alarms whose rank is written next to them
_RATIOS = (0.3, 6.0)  # least and greatest height over width of a run-view's panel
_POSES = 200  # stops of the array that are drawn
_PANEL_WIDTH = 4.6  # inches
_wrapped = partial(fill, break_long_words=False, break_on_hyphens=False)
_MARKER = {"metal": "s", "plastic": "^", "simulant": "D"}


def _band_label(name: str, result: Result) -> str:
    """Return the name of a sub-band with its edges, unless the name is its edges."""
    if re.fullmatch(r"[\d.]+-[\d.]+", name):
        return f"{name} GHz"
    edges = result.recipe.image.subbands.get(name)
    return f"{name} ({edges[0] / 1e9:.3g} to {edges[1] / 1e9:.3g} GHz)" if edges else name


def run_view_figure(
    result: Result,
    names: list[str],
    truth: pd.DataFrame | None = None,
    objects: pd.DataFrame | None = None,
) -> Figure:
    """Draw the run-views of some detections with their alarms, in dB re the lane's strongest pixel.

    Parameters
    ----------
    result : Result
        The result.
    names : list of str
        Names of the detections.
    truth : pandas.DataFrame, optional
        Targets, which are drawn with their halos.
    objects : pandas.DataFrame, optional
        Other objects on the lane.

    Returns
    -------
    matplotlib.figure.Figure
        A panel per detection, side by side.
    """
    chosen = [detection for detection in result.detections if detection.name in names]
    first_view = chosen[0].view
    width = _PANEL_WIDTH * len(chosen) + 0.6
    height = _PANEL_WIDTH * np.clip(_shape(first_view), *_RATIOS) * 0.82 + 1.5
    figure = Figure(figsize=(width, height), layout="compressed")
    panels = np.atleast_1d(figure.subplots(1, len(chosen)))
    for axes, detection in zip(panels, chosen, strict=True):
        view = select(detection.view, *channel_shown(result, detection))
        _draw_view(axes, view, result.lane)
        _draw_marks(axes, detection.alarms, result, truth, objects)
        title = _wrapped(_title_of(detection), 38)
        axes.set_title(title, fontsize=9)
    figure.legend(
        handles=_legend(truth, objects),
        loc="outside lower center",
        ncols=7,
        fontsize=8,
        frameon=False,
    )
    polarization, subband = channel_shown(result, chosen[0])
    scale = ", not to scale" if _is_long(first_view) else ""
    figure.suptitle(f"Run-view {polarization}, {_band_label(subband, result)}{scale}", fontsize=11)
    return figure


def channel_shown(result: Result, detection: Detection) -> tuple[str, str]:
    """Return the channel of a detection's run-view that alarms were raised on.

    On ground unlike the training the recipe of a detection may be another than the result's; the
    run-view lacks that recipe's channel then, and the first it has is shown.
    """
    screen = result.recipe.prescreen
    polarizations = [str(label) for label in detection.view["polarization"].values]
    subbands = [str(label) for label in detection.view["subband"].values]
    if screen.polarization in polarizations and screen.subband in subbands:
        return screen.polarization, screen.subband
    return polarizations[0], subbands[0]


def _title_of(detection: Detection | Score) -> str:
    """Return the title of a detection; the main one is the recipe itself."""
    return "recipe as it stands" if detection.name == "main" else detection.title


def channel_figure(result: Result) -> Figure:
    """Draw the main run-view, each channel in dB re its strongest pixel in the lane.

    Parameters
    ----------
    result : Result
        The result.

    Returns
    -------
    matplotlib.figure.Figure
        A row per polarization and a column per sub-band.
    """
    view = result.detections[0].view
    rows = view.sizes["polarization"]
    columns = view.sizes["subband"]
    width = 2.6 * columns + 0.6
    height = 2.6 * np.clip(_shape(view), *_RATIOS) * rows * 0.92 + 0.6
    figure = Figure(figsize=(width, height), layout="constrained")
    grid = figure.subplots(rows, columns, squeeze=False, sharex=True, sharey=True)
    for i, polarization in enumerate(view["polarization"].values):
        for j, subband in enumerate(view["subband"].values):
            axes = grid[i, j]
            _draw_view(axes, view[i, j], result.lane, bar=False)
            axes.set_title(f"{polarization}  {_band_label(subband, result)}", fontsize=9)
            axes.label_outer()
    return figure


def complete_roc_figure(scored: Sequence[Score]) -> Figure:
    """Draw every detection's Pd up to its last alarm.

    The main curve also has its exact intervals and chance.

    Parameters
    ----------
    scored : sequence of Score
        Scores of the detections, the main one first.

    Returns
    -------
    matplotlib.figure.Figure
        A curve per detection.
    """
    figure = Figure(figsize=(5.2, 4.0), layout="constrained")
    axes = figure.subplots()
    for i, detection in enumerate(scored):
        curve = detection.curve
        targets = int(curve.attrs["n_targets"])
        # A step beyond the last alarm, so that its Pd is seen.
        end = curve["far"].iloc[-1] + 1 / curve.attrs["area"]
        label = "all targets" if len(scored) == 1 else _title_of(detection)
        style: Entries = {"lw": 1.3, "ls": "--"} if i else {"lw": 2.2, "ls": "-"}
        draw_steps(axes, curve, "pd", end, label=_wrapped(label, 44), color=f"C{i}", **style)
        if i == 0:
            band = pd.concat([curve, curve.iloc[[-1]].assign(far=end)])
            axes.fill_between(
                band["far"],
                band["pd_low"],
                band["pd_high"],
                step="post",
                alpha=0.15,
                color="C0",
                lw=0,
            )
            draw_steps(axes, curve, "chance", end, color="0.45", ls=":", lw=1.6, label="chance")
    axes.set(
        xlabel="false alarms per m²",
        ylabel=f"probability of detection ({targets} targets)",
        ylim=(-0.02, 1.02),
    )
    level = 100 * scored[0].rules.level
    axes.set_title(f"Every alarm, {level:g} % intervals point by point", fontsize=10)
    axes.set_xlim(left=0)
    axes.grid(alpha=0.3)
    axes.legend(fontsize=8, loc="best")
    return figure


def geometry_figure(run: Entries, lane: Lane, looks: xr.DataArray | None, beyond: float) -> Figure:
    """Draw the antennas of a run in plan and from the side, and how often the ground was seen.

    Parameters
    ----------
    run : dict
        Description of the run in a manifest.
    lane : Lane
        Ground that was searched.
    looks : xarray.DataArray or None
        Number of scans (y, x) that see each pixel.
    beyond : float
        Ground that is drawn before the first pose and after the lane's end, m.

    Returns
    -------
    matplotlib.figure.Figure
        The plan on the left, the side view on the right.
    """
    pose = plausible_poses(run)
    figure = Figure(figsize=(8.2, 5.6), layout="constrained")
    plan, side = figure.subplots(1, 2, width_ratios=(1.25, 1))
    if looks is not None:
        most = int(looks.max())
        looks = _thinned(looks)
        mesh = shaded(plan, looks["x"], looks["y"], looks, (0, max(most, 1)), colours="Blues")
        figure.colorbar(mesh, ax=plan, label="scans that see the ground", shrink=0.7)
    is_stretched = looks is not None and _is_long(looks)
    first_y = min(pose[:, 1].min(), lane.y_min)
    _draw_plan(plan, run, pose, lane, is_stretched)
    plan.set_ylim(first_y - beyond, lane.y_max + beyond)
    plan.legend(fontsize=8, loc="upper right")
    _draw_side(side, pose, lane)
    return figure


def _draw_plan(axes: Axes, run: Entries, pose: FloatArray, lane: Lane, is_stretched: bool) -> None:
    """Draw the lane and the antennas at the poses from above."""
    tx = floats(run["tx_m"])
    rx = floats(run["rx_m"])
    axes.add_patch(lane_patch(lane, fill=False, ec="white", lw=1.4, ls="-."))
    every = math.ceil(len(pose) / _POSES)
    for number, stop in enumerate(pose[::every]):
        # Heading counts clockwise from +y, as on a compass.
        cosine = np.cos(stop[3])
        sine = np.sin(stop[3])
        rotation = np.array([[cosine, sine], [-sine, cosine]])
        is_first = number == 0  # labelled once for the legend
        for antennas, mark, colour, label in (
            (rx, ".", "0.25", "receivers"),
            (tx, "^", "C3", "transmitters"),
        ):
            places = antennas[:, :2] @ rotation.T + stop[:2]
            axes.plot(*places.T, mark, ms=5, color=colour, label=label if is_first else None)
    axes.set(
        xlabel="cross-track x (m)",
        ylabel="down-track y (m)",
        title="plan, not to scale" if is_stretched else "plan",
    )
    axes.set_aspect("auto" if is_stretched else "equal")


def _draw_side(axes: Axes, pose: FloatArray, lane: Lane) -> None:
    """Draw the poses from the side, and rays ahead from the first and last to the lane's ends."""
    axes.axhline(0, color="saddlebrown")
    axes.plot(pose[:, 1], pose[:, 2], "C3^", ms=5)
    for stop in pose[[0, -1]]:
        for y in (lane.y_min, lane.y_max):
            if (y - stop[1]) * np.cos(stop[3]) < 0:  # behind the antennas
                continue
            axes.plot([stop[1], y], [stop[2], 0], color="0.6", lw=0.8)
    highest = max(float(pose[:, 2].max()), 0.5)
    is_flat = lane.y_max - min(pose[:, 1].min(), lane.y_min) > 6 * highest
    title = "side, with rays ahead\nto the ends of the lane"
    if is_flat:
        title += ", not to scale"
    axes.set(
        xlabel="down-track y (m)",
        ylabel="height z (m)",
        title=title,
        aspect="auto" if is_flat else "equal",
    )
    axes.set_ylim(min(-0.3 * highest, 1.2 * float(pose[:, 2].min())), 1.4 * highest)


def _shape(view: xr.DataArray) -> float:
    """Return length over width of a view."""
    x = view["x"].values
    y = view["y"].values
    return float((y[-1] - y[0]) / (x[-1] - x[0]))


def _is_long(view: xr.DataArray) -> bool:
    """Return whether a view is too long to be drawn to scale."""
    return _shape(view) > _LONG


def _thinned(view: xr.DataArray) -> xr.DataArray:
    """Return a view with no more rows than a figure shows: the largest of neighbouring rows."""
    return thinned(view, math.ceil(view.sizes["y"] / _ROWS))


def _draw_view(axes: Axes, view: xr.DataArray, lane: Lane, bar: bool = True) -> None:
    """Draw a channel of a run-view in dB and the lane."""
    is_stretched = _is_long(view)
    view = _thinned(view)
    level = decibels(view) - strongest(view, lane)
    # Ground that no scan has seen is NaN: the grey behind the image shows there.
    axes.set_facecolor("0.8")
    mesh = shaded(axes, view["x"], view["y"], level, (-DYNAMIC_RANGE, 0))
    axes.add_patch(lane_patch(lane, fill=False, ec="white", lw=1.4, ls="-."))
    axes.set(
        xlabel="cross-track x (m)",
        ylabel="down-track y (m)",
        aspect="auto" if is_stretched else "equal",
    )
    if bar and axes.figure is not None:
        axes.figure.colorbar(
            mesh, ax=axes, shrink=0.7, fraction=0.06, label="dB re strongest pixel in the lane"
        )


def _draw_marks(
    axes: Axes,
    alarms: pd.DataFrame,
    result: Result,
    truth: pd.DataFrame | None,
    objects: pd.DataFrame | None,
) -> None:
    """Draw objects, targets with their halos, and alarms with their ranks."""
    if objects is not None:
        axes.plot(objects["x"], objects["y"], "x", color="white", ms=7, mew=1.6)
    if truth is not None:
        radius = result.recipe.score.halo
        for target in truth.to_dict("records"):
            x = target["x"]
            y = target["y"]
            marker = _MARKER.get(target["kind"], "o")
            axes.plot(x, y, marker, mfc="none", mec="red", ms=9, mew=1.8)
            axes.add_patch(Circle((x, y), radius, fill=False, ec="red", lw=1.2, ls=":"))
    axes.plot(alarms["x"], alarms["y"], "o", mfc="none", mec="white", ms=6, mew=1.2)
    ranked = alarms[:_RANKS]
    places = zip(ranked["x"], ranked["y"], strict=True)
    for rank, (x, y) in enumerate(places, 1):
        # Next to the right edge the number stands on the left.
        is_near_edge = x > 0.8 * result.lane.x_max
        axes.annotate(
            str(rank),
            (x, y),
            xytext=(-11, 3) if is_near_edge else (5, 3),
            textcoords="offset points",
            color="white",
            fontsize=8,
        )


def _legend(truth: pd.DataFrame | None, objects: pd.DataFrame | None) -> list[Line2D]:
    """Return the entries of the legend for what is drawn."""
    handles = [
        _legend_mark("o", "0.3", "alarm, with rank"),
        Line2D([], [], color="0.3", ls="-.", label="lane"),
    ]
    if truth is not None:
        for kind in dict.fromkeys(truth["kind"]):
            marker = _MARKER.get(kind, "o")
            handles.append(_legend_mark(marker, "red", f"{kind} mine"))
        handles.append(Line2D([], [], color="red", ls=":", label="halo"))
    if objects is not None and len(objects):
        kinds = ", ".join(dict.fromkeys(objects["kind"]))
        handles.append(_legend_mark("x", "0.3", kinds))
    return handles


def _legend_mark(marker: str, colour: str, label: str) -> Line2D:
    """Return the entry of a mark in a legend."""
    return Line2D(
        [],
        [],
        marker=marker,
        ls="none",
        mfc="none",
        mec=colour,
        ms=7,
        mew=1.6,
        label=label,
    )
