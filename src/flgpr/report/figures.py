"""The figures of a report."""

from __future__ import annotations

import re
from collections.abc import Sequence
from functools import partial
from textwrap import fill
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Circle, Rectangle
from numpy.typing import NDArray

from flgpr.model import Lane
from flgpr.results.description import plausible_poses
from flgpr.results.result import Result, thinned
from flgpr.scoring import Score
from flgpr.screen import select

DYNAMIC_RANGE = 30.0  # dB
_ROWS = 2400  # more than that are not told apart in a figure
_LONG = 12.0  # lanes longer than so many times their width are not drawn to scale
_RANKS = 100  # so many alarms get their rank written beside them
_wrapped = partial(fill, break_long_words=False, break_on_hyphens=False)
_POSES = 200  # so many stops of the array are drawn
_MARKER = {"metal": "s", "plastic": "^", "simulant": "D"}


def _band(name: str) -> str:
    """Call a sub-band by its name; those named by their edges are in GHz."""
    return f"{name} GHz" if re.fullmatch(r"[\d.]+-[\d.]+", name) else name


def run_view_figure(
    result: Result,
    names: list[str],
    truth: pd.DataFrame | None = None,
    objects: pd.DataFrame | None = None,
) -> Figure:
    """Draw run-views of some detections with alarms, lane and what stands there; dB re the lane's strongest pixel."""
    screen = result.recipe.prescreen
    chosen = [one for one in result.detections if one.name in names]
    width = 4.6
    ratio = _ratio(chosen[0].view)
    figure = Figure(
        figsize=(width * len(chosen) + 0.6, width * ratio * 0.82 + 1.5), layout="constrained"
    )
    for axes, one in zip(np.atleast_1d(figure.subplots(1, len(chosen))), chosen, strict=True):
        view = select(one.view, screen.polarization, screen.subband)
        _show(axes, view, result.lane)
        _overlay(axes, one.alarms, result, truth, objects)
        title = "recipe as it stands" if one.name == "main" else one.title
        axes.set_title(_wrapped(title, 38), fontsize=9)
    figure.legend(
        handles=_legend(truth, objects),
        loc="outside lower center",
        ncols=7,
        fontsize=8,
        frameon=False,
    )
    scale = ", not to scale" if _is_long(chosen[0].view) else ""
    figure.suptitle(f"Run-view {screen.polarization}, {_band(screen.subband)}{scale}", fontsize=11)
    return figure


def channel_figure(result: Result) -> Figure:
    """Draw the main run-view, polarizations down, sub-bands across; each in dB re its strongest pixel in the lane."""
    view = result.detections[0].view
    rows, columns = view.sizes["polarization"], view.sizes["subband"]
    figure = Figure(
        figsize=(2.6 * columns + 0.6, 2.6 * _ratio(view) * rows * 0.92 + 0.6), layout="constrained"
    )
    grid = figure.subplots(rows, columns, squeeze=False, sharex=True, sharey=True)
    for i, polarization in enumerate(view["polarization"].values):
        for j, subband in enumerate(view["subband"].values):
            _show(grid[i, j], view[i, j], result.lane, bar=False)
            grid[i, j].set_title(f"{polarization}  {_band(subband)}", fontsize=9)
            grid[i, j].label_outer()
    return figure


def whole_roc_figure(scored: Sequence[Score]) -> Figure:
    """Draw every detection's Pd up to its last alarm; of the main curve also the exact intervals and chance."""
    figure = Figure(figsize=(5.2, 4.0), layout="constrained")
    axes = figure.subplots()
    for i, one in enumerate(scored):
        curve = one.curve
        targets = int(one.curve.attrs["n_targets"])
        far = np.append(curve["far"], curve["far"].iloc[-1] + 1 / one.curve.attrs["area"])
        label = (
            "all targets"
            if len(scored) == 1
            else "recipe as it stands"
            if one.name == "main"
            else one.title
        )
        style: dict[str, Any] = {
            "lw": 2.2 if i == 0 else 1.3,
            "ls": "-" if i == 0 else "--",
            "color": f"C{i}",
        }
        axes.step(
            far,
            np.append(curve["pd"], curve["pd"].iloc[-1]),
            where="post",
            label=_wrapped(label, 44),
            **style,
        )
        if i == 0:
            low, high = (
                np.append(curve[name], curve[name].iloc[-1]) for name in ("pd_low", "pd_high")
            )
            axes.fill_between(far, low, high, step="post", alpha=0.15, color="C0", lw=0)
            by_chance = np.append(curve["chance"], curve["chance"].iloc[-1])
            axes.step(far, by_chance, where="post", color="0.45", ls=":", lw=1.6, label="chance")
    axes.set(
        xlabel="false alarms per m²",
        ylabel=f"probability of detection ({targets} targets)",
        ylim=(-0.02, 1.02),
    )
    axes.set_title(
        f"Every alarm, {100 * scored[0].rules.level:g} % intervals point by point", fontsize=10
    )
    axes.set_xlim(left=0)
    axes.grid(alpha=0.3)
    axes.legend(fontsize=8, loc="best")
    return figure


def geometry_figure(
    run: dict[str, Any], lane: Lane, looks: xr.DataArray | None, beyond: float
) -> Figure:
    """Draw in plan and from the side where a manifest's run had its antennas, and how often each spot was seen."""
    tx, rx = (np.asarray(run[name], dtype=float) for name in ("tx_m", "rx_m"))
    pose = plausible_poses(run)
    figure = Figure(figsize=(8.2, 5.6), layout="constrained")
    plan, side = figure.subplots(1, 2, width_ratios=(1.25, 1))
    if looks is not None:
        most = int(looks.max())
        looks = _thinned(looks)
        shades: dict[str, Any] = {
            "cmap": "Blues",
            "vmin": 0,
            "vmax": max(most, 1),
            "shading": "nearest",
        }
        mesh = plan.pcolormesh(looks["x"], looks["y"], looks, **shades)
        figure.colorbar(mesh, ax=plan, label="scans that see the ground", shrink=0.7)
    plan.add_patch(_lane_patch(lane))
    for k, one in enumerate(pose[:: -(-len(pose) // _POSES)]):
        turn = np.array([[np.cos(one[3]), np.sin(one[3])], [-np.sin(one[3]), np.cos(one[3])]])
        for positions, marker, name in ((rx, ".", "receivers"), (tx, "^", "transmitters")):
            place = positions[:, :2] @ turn.T + one[:2]
            plan.plot(
                *place.T,
                marker,
                ms=5,
                color="C3" if marker == "^" else "0.25",
                label=name if k == 0 else None,
            )
    scale = looks is not None and _is_long(looks)
    plan.set(
        xlabel="cross-track x (m)",
        ylabel="down-track y (m)",
        title="plan, not to scale" if scale else "plan",
    )
    plan.set_aspect("auto" if scale else "equal")
    plan.set_ylim(min(pose[:, 1].min(), lane.y_min) - beyond, lane.y_max + beyond)
    plan.legend(fontsize=8, loc="upper right")
    side.axhline(0, color="saddlebrown")
    side.plot(pose[:, 1], pose[:, 2], "C3^", ms=5)
    for one in pose[[0, -1]]:
        for y in (lane.y_min, lane.y_max):
            side.plot([one[1], y], [one[2], 0], color="0.6", lw=0.8)
    highest = max(float(pose[:, 2].max()), 0.5)
    flat = lane.y_max - min(pose[:, 1].min(), lane.y_min) > 6 * highest
    title = "side, with rays to\nboth ends of the lane" + (", not to scale" if flat else "")
    side.set(
        xlabel="down-track y (m)",
        ylabel="height z (m)",
        title=title,
        aspect="auto" if flat else "equal",
    )
    side.set_ylim(min(-0.3 * highest, 1.2 * float(pose[:, 2].min())), 1.4 * highest)
    return figure


def _shape(view: xr.DataArray) -> float:
    x, y = view["x"].values, view["y"].values
    return float((y[-1] - y[0]) / (x[-1] - x[0]))


def _ratio(view: xr.DataArray) -> float:
    return float(np.clip(_shape(view), 0.3, 6.0))


def _is_long(view: xr.DataArray) -> bool:
    return _shape(view) > _LONG


def _thinned(view: xr.DataArray) -> xr.DataArray:
    """Take the largest of neighbouring rows where there are more than a figure shows."""
    return thinned(view, -(-view.sizes["y"] // _ROWS))


def _show(axes: Axes, view: xr.DataArray, lane: Lane, bar: bool = True) -> None:
    stretched = _is_long(view)
    view = _thinned(view)
    x, y = view["x"].values, view["y"].values
    level = 20 * np.log10(np.maximum(view.values, 1e-12))
    inside = level[lane.contains(*np.meshgrid(x, y)) & np.isfinite(level)]
    level = level - (inside.max() if inside.size else 0.0)
    axes.set_facecolor("0.8")
    mesh = axes.pcolormesh(
        x, y, level, cmap="viridis", vmin=-DYNAMIC_RANGE, vmax=0, shading="nearest", rasterized=True
    )
    axes.add_patch(_lane_patch(lane))
    axes.set(
        xlabel="cross-track x (m)",
        ylabel="down-track y (m)",
        aspect="auto" if stretched else "equal",
    )
    if bar and axes.figure is not None:
        axes.figure.colorbar(mesh, ax=axes, shrink=0.7, label="dB re strongest pixel in the lane")


def _lane_patch(lane: Lane) -> Rectangle:
    corner = (lane.x_min, lane.y_min)
    return Rectangle(
        corner,
        lane.x_max - lane.x_min,
        lane.y_max - lane.y_min,
        fill=False,
        ec="white",
        lw=1.4,
        ls="-.",
    )


def _overlay(
    axes: Axes,
    alarms: pd.DataFrame,
    result: Result,
    truth: pd.DataFrame | None,
    objects: pd.DataFrame | None,
) -> None:
    if objects is not None:
        axes.plot(objects["x"], objects["y"], "x", color="white", ms=7, mew=1.6)
    if truth is not None:
        for row in truth.to_dict("records"):
            axes.plot(
                row["x"],
                row["y"],
                _MARKER.get(row["kind"], "o"),
                mfc="none",
                mec="red",
                ms=9,
                mew=1.8,
            )
            halo = Circle(
                (row["x"], row["y"]), result.recipe.score.halo, fill=False, ec="red", lw=1.2, ls=":"
            )
            axes.add_patch(halo)
    axes.plot(alarms["x"], alarms["y"], "o", mfc="none", mec="white", ms=6, mew=1.2)
    for rank, (x, y) in enumerate(zip(alarms["x"][:_RANKS], alarms["y"][:_RANKS], strict=True), 1):
        offset = (-11, 3) if x > 0.8 * result.lane.x_max else (5, 3)
        axes.annotate(
            str(rank), (x, y), xytext=offset, textcoords="offset points", color="white", fontsize=8
        )


def _legend(truth: pd.DataFrame | None, objects: pd.DataFrame | None) -> list[Line2D]:
    def mark(marker: str, colour: str, label: str) -> Line2D:
        return Line2D(
            [], [], marker=marker, ls="none", mfc="none", mec=colour, ms=7, mew=1.6, label=label
        )

    handles = [
        mark("o", "0.3", "alarm, with rank"),
        Line2D([], [], color="0.3", ls="-.", label="lane"),
    ]
    if truth is not None:
        handles += [
            mark(_MARKER.get(kind, "o"), "red", f"{kind} mine")
            for kind in dict.fromkeys(truth["kind"])
        ]
        handles.append(Line2D([], [], color="red", ls=":", label="halo"))
    if objects is not None and len(objects):
        handles.append(mark("x", "0.3", ", ".join(dict.fromkeys(objects["kind"]))))
    return handles


# inches of a panel at most
_WIDE = 7.5
_HIGH = 6.0
_MARGIN = 0.08  # of a panel, beside whose edge a number would be cut off


def image_figure(
    image: xr.DataArray, peaks: pd.DataFrame, pose: NDArray[np.float64], span: float = 40.0
) -> Figure:
    """Draw an image (polarization, z, y, x), complex, ``span`` dB down from each polarization's strongest pixel.

    An axis of one value is left out; a volume is drawn as its strongest pixels along each axis. ``peaks`` (x, y, z, m)
    are numbered in the first polarization's panels, poses (scan, 6) drawn where they lie in a panel.
    """
    labels = [str(label) for label in image["polarization"].values]
    wide = [axis for axis in ("x", "y", "z") if image.sizes[axis] > 1]
    planes = [("x", "y"), ("x", "z"), ("y", "z")]
    shown = [plane for plane in planes if all(axis in wide for axis in plane)]
    sizes = {axis: max(float(np.ptp(image[axis].values)), 1e-9) for axis in "xyz"}
    across, up = shown[0]
    ratio = np.clip(sizes[up] / sizes[across], 0.12, 2.5)
    width = min(_WIDE, _HIGH / ratio)
    figure = Figure(
        figsize=(width * len(shown) + 1.6, (width * ratio + 1.1) * len(labels)), layout="compressed"
    )  # fmt: skip
    panels = figure.subplots(len(labels), len(shown), squeeze=False)
    for row, (label, line) in enumerate(zip(labels, panels, strict=True)):
        level = np.abs(image.values[row])
        top = max(float(level.max()), np.finfo(float).tiny)
        for axes, (a, b) in zip(line, shown, strict=True):
            others = tuple(k for k, axis in enumerate(("z", "y", "x")) if axis not in (a, b))
            flat = 20 * np.log10(np.maximum(level.max(axis=others) / top, 1e-9))
            u = image[a].values
            v = image[b].values
            du, dv = (np.diff(one).mean() / 2 for one in (u, v))
            drawn = axes.imshow(
                flat, origin="lower", extent=(u[0] - du, u[-1] + du, v[0] - dv, v[-1] + dv), cmap="magma", vmin=-span,
                vmax=0, aspect="equal" if 0.12 < np.ptp(v) / np.ptp(u) < 2.5 else "auto", interpolation="nearest",
            )  # fmt: skip
            window = axes.axis()
            axes.plot(
                pose[:, "xyz".index(a)], pose[:, "xyz".index(b)], ".", color="#4fc3f7", markersize=2
            )
            axes.axis(window)
            axes.set(xlabel=f"{a} (m)", ylabel=f"{b} (m)")
            if row == 0:
                _number_points(axes, peaks[[a, b]].to_numpy())
        bar = figure.colorbar(drawn, ax=line[-1], shrink=0.8, pad=0.02)
        # On two lines, so that the bar of a low panel holds its label as a whole.
        bar.set_label(f"{label}, dB re its\nstrongest pixel", fontsize=9)
    fixed = ", ".join(f"{axis} = {image[axis].values[0]:g} m" for axis in "xyz" if axis not in wide)
    figure.suptitle(
        ", ".join(part for part in (str(image.attrs.get("title", "")), fixed) if part), fontsize=10
    )
    return figure


def _number_points(axes: Axes, points: NDArray[np.float64]) -> None:
    """Circle points (point, 2) and number them from 1 on, each number on the side where the panel goes on."""
    left, right, bottom, top = axes.axis()
    for number, (across, up) in enumerate(points.tolist(), 1):
        near_right = across > right - _MARGIN * (right - left)
        near_top = up > top - _MARGIN * (top - bottom)
        text = axes.annotate(
            str(number),
            (across, up),
            xytext=(-6 if near_right else 6, -6 if near_top else 6),
            textcoords="offset points",
            ha="right" if near_right else "left",
            va="top" if near_top else "bottom",
            color="white",
            fontsize=8,
        )
        text.set_in_layout(False)  # what lies in the panel moves no label out of the figure
        axes.plot(across, up, "o", mfc="none", mec="white", markersize=9)
    axes.axis((left, right, bottom, top))
