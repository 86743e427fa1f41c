"""Figures of the flsar2004 reproduction."""

from __future__ import annotations

from itertools import product
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Ellipse, Rectangle
from sklearn.svm import SVC

from flgpr.detect import OneClassRelevanceVectorMachine, RelevanceVectorClassifier
from flgpr.detect.one_class import FORMULATIONS
from flgpr.screen import fit_ellipse
from flgpr.types import AnyArray, Entries
from flgpr_papers.flsar2004.examples import POLARIZATIONS, Site, make_templates
from flgpr_papers.flsar2004.findings import Results
from flgpr_papers.flsar2004.lanes import Settings, fiducials
from flgpr_papers.kit.figures import Figures, Panels, colour_bar, show, steps

_figure = Figures("flsar2004")
TITLES: dict[str, str] = _figure.declared["titles"]
"""Title of every panel of ROCs by its name."""


class Measured(NamedTuple):
    """What the figures show of the study."""

    settings: Settings  #: the study
    sites: list[Site]  #: both sites
    results: Results  #: of all parts


def _shape(_: Measured, *names: str) -> Entries:
    """Return the size of a figure of several ROCs, a panel each."""
    columns = 3 if len(names) > 4 else min(len(names), 2)
    rows = -(-len(names) // columns)
    size = np.array((3.7, 3.4) if columns > 2 else (5.2, 3.8)) * (columns, rows)
    return {"rows": rows, "columns": columns, "size": size}


@_figure
def lane_figure(panels: Panels, measured: Measured) -> None:
    """Draw Fig. 1: HH and VV over part of the lane, with mines."""
    settings, (site, _), _ = measured
    end = min(30.0, settings.length)
    rows = (site.grid.y >= 0) & (site.grid.y <= end)
    shown_mines = site.mines[site.mines["y"].between(0, end)]
    beside = np.array([place for place in fiducials(settings) if place[1] <= end])
    text = {"textcoords": "offset points", "color": "white", "fontsize": 6, "ha": "center"}
    for axes, image, name in zip(panels, site.image, POLARIZATIONS, strict=True):
        level = 20 * np.log10(np.maximum(image[0][rows], 1e-6))
        level -= np.median(level)
        shown = show(axes, level.T, (0, end), site.grid.x, -5, 25, cmap="viridis")
        axes.plot(*beside.T[::-1], "^", mfc="none", mec="#ffb347", ms=9)
        for x, y, kind, depth in shown_mines[["x", "y", "kind", "depth"]].to_numpy():
            where = "surface" if depth < -0.05 else f"{100 * depth:.0f} cm"
            axes.plot(y, x, "o", mfc="none", mec="white", ms=11)
            axes.annotate(f"{kind[0].upper()} {where}", (y, x), (0, 8), **text)
        axes.grid(visible=False)
        axes.set_ylabel(f"{name}\ncross-track, m")
    colour_bar(panels, shown, "dB over the median", shrink=0.8)
    axes.figure.suptitle(
        f"{site.name}, {settings.ranges[0]:g} m ahead; M metal, P plastic; triangles: fiducials"
    )


@_figure
def ellipse_figure(axes: Axes, measured: Measured) -> None:
    """Draw Fig. 2: the ellipse and the rectangle whose energies the prescreener compares.

    The origin is the cluster's brightest pixel; the rectangle is twice as
    long and wide as the ellipse.
    """
    settings, (site, _), _ = measured
    ellipse = fit_ellipse(make_templates(settings, site)[0, 0], settings.spacing)
    along, across = ellipse.half_y, ellipse.half_x
    centre = ellipse.offset_y, ellipse.offset_x
    corner = centre[0] - 2 * along, centre[1] - 2 * across
    axes.add_patch(Rectangle(corner, 4 * along, 4 * across, fc="#d8dee6", ec="#4a5563"))
    axes.add_patch(Ellipse(centre, 2 * along, 2 * across, fc="#3b6ea5", ec="none"))
    axes.plot(0, 0, "x", color="black", ms=8, label="brightest pixel")
    axes.text(*centre, "E in", color="white", ha="center", va="bottom")
    axes.text(corner[0] * 0.95, corner[1] * 0.9, "E out", va="bottom")
    axes.autoscale_view()
    axes.set_title(f"half axes {along:.2f} m along, {across:.2f} m across", fontsize=9)


@_figure
def templates_figure(panels: Panels, measured: Measured) -> None:
    """Draw Fig. 3, with the ellipse of Fig. 2."""
    settings, sites, _ = measured
    for s, site in enumerate(sites):
        templates = make_templates(settings, site)
        for p, r in np.ndindex(*templates.shape[:2]):
            axes = panels[2 * s + p, r]
            _draw_template(axes, templates[p, r], settings)
            title = f"{site.name} {POLARIZATIONS[p]} {settings.ranges[r]:g} m"
            axes.set_title(title, fontsize=8)
    axes.figure.supxlabel("down-track, m")
    axes.figure.supylabel("cross-track, m")


def _draw_template(axes: Axes, template: AnyArray, settings: Settings) -> None:
    """Draw a template with its ellipse."""
    dx, dy = settings.spacing
    half_y = template.shape[0] * dy / 2
    half_x = template.shape[1] * dx / 2
    extent = (-half_y, half_y, -half_x, half_x)
    axes.imshow(template.T, origin="lower", extent=extent, cmap="magma")
    ellipse = fit_ellipse(template, settings.spacing)
    # Where the prescreener puts it: at its offset from the brightest pixel.
    row, column = np.unravel_index(int(template.argmax()), template.shape)
    y = (row - template.shape[0] // 2) * dy + ellipse.offset_y
    x = (column - template.shape[1] // 2) * dx + ellipse.offset_x
    angle = np.linspace(0, 2 * np.pi, 100)
    along = y + ellipse.half_y * np.cos(angle)
    across = x + ellipse.half_x * np.sin(angle)
    axes.plot(along, across, "w:", lw=1)
    # The centroid of two flashes lies off the brightest pixel: the ellipse may leave the template.
    reach_y = 1.02 * max(half_y, np.abs(along).max())
    reach_x = 1.02 * max(half_x, np.abs(across).max())
    axes.set(xlim=(-reach_y, reach_y), ylim=(-reach_x, reach_x), xticks=(-0.3, 0, 0.3))
    axes.set_facecolor("#555")
    axes.grid(visible=False)


@_figure
def margin_figure(axes: Axes, *_: Any) -> None:
    """Draw Fig. 4: the margin of a hyperplane, for points drawn for the purpose."""
    rng = np.random.default_rng(4)
    first = rng.normal((-1.2, -0.6), 0.4, (20, 2))
    second = rng.normal((1.2, 0.8), 0.4, (20, 2))
    points = np.concatenate([first, second])
    label = np.repeat([0, 1], 20)
    machine = SVC(kernel="linear", C=1e6).fit(points, label)
    weight = machine.coef_[0]
    bias = float(machine.intercept_[0])
    distance = machine.decision_function(points) / np.linalg.norm(weight)
    below = -distance[label == 0].max()
    above = distance[label == 1].min()
    sparse = RelevanceVectorClassifier(kernel="linear").fit(points, label)
    u, v = np.meshgrid(np.linspace(-2.6, 2.6, 200), np.linspace(-2.2, 2.4, 200))
    positions = np.column_stack([u.ravel(), v.ravel()])
    signed = ((positions @ weight + bias) / np.linalg.norm(weight)).reshape(u.shape)
    sparse_value = sparse.decision_function(positions).reshape(u.shape)
    for side, colour, name in ((0, "#b3261e", "l = -1"), (1, "#1f4e8c", "l = +1")):
        axes.plot(*points[label == side].T, "o", color=colour, ms=4, label=name)
    for vectors, mark, edge, size, name in (
        (machine.support_, "o", "black", 10, "support vectors"),
        (sparse.relevance_, "s", "#2e7d32", 13, "relevance vectors"),
    ):
        axes.plot(*points[vectors].T, mark, mfc="none", mec=edge, ms=size, label=name)
    dashes = ["dashed", "solid", "dashed"]
    axes.contour(u, v, signed, levels=[-below, 0, above], colors="black", linestyles=dashes)
    axes.contour(u, v, sparse_value, levels=[0], colors="#2e7d32")
    axes.set_title(
        f"D-1 = {below:.2f}, D+1 = {above:.2f}, margin {below + above:.2f}; green: RVM, p = 1/2",
        fontsize=9,
    )


@_figure.sized(_shape)
def roc_figure(panels: Panels, measured: Measured, *names: str) -> None:
    """Draw ROC curves by name, a panel each."""
    curves, notes = measured.results.curves, measured.results.notes
    for axes, name in zip(panels.ravel(), names, strict=True):
        of_figure = curves.get(name, {})
        for label, curve in of_figure.items():
            # Not in the paper's figure.
            is_our_addition = "sum of the correlations" in label or "binary" in label
            line = {"lw": 1.0, "ls": "--"} if is_our_addition else {"lw": 1.6, "ls": "-"}
            steps(axes, curve, label, **line)
        axes.set_title(TITLES[name])
        axes.title.set_fontsize(8)
        if of_figure:
            axes.legend(fontsize=7, loc="lower right")
        else:
            reason = notes.get(f"{name} both", "too few examples").replace("; ", ";\n")
            axes.text(0.5, 0.5, reason, transform=axes.transAxes, ha="center", fontsize=8)


@_figure
def vectors_figure(axes: Axes, measured: Measured) -> None:
    """Draw histograms of the share of the training examples that are vectors, by machine."""
    shares_by_machine = measured.results.notes["vectors by fold"]
    largest = max(map(max, shares_by_machine.values()))
    bins = 100 * np.linspace(0, largest * 1.05, 40)
    for label, shares in shares_by_machine.items():
        axes.hist(100 * np.asarray(shares), bins=bins.tolist(), alpha=0.7, label=label)


@_figure
def kernel_width_figure(panels: Panels, *_: Any) -> None:
    """Draw the one-class machine's p(mine) over a plane, by kernel width and formulation."""
    rng = np.random.default_rng(0)
    first = rng.normal((-1, 0), 0.35, (40, 2))
    second = rng.normal((1, 0.5), 0.35, (40, 2))
    mines = np.concatenate([first, second])
    u, v = np.meshgrid(np.linspace(-4, 4, 120), np.linspace(-3, 3, 90))
    positions = np.column_stack([u.ravel(), v.ravel()])
    cases = product(FORMULATIONS, (0.05, 0.5, 3.0, 30.0))
    for axes, (formulation, gamma) in zip(panels.flat, cases, strict=True):
        machine = OneClassRelevanceVectorMachine(
            gamma=gamma, formulation=formulation, n_reference=400, random_state=0, tol=1e-4
        ).fit(mines)
        p = machine.predict_proba(positions)[:, -1].reshape(u.shape)
        shown = axes.pcolormesh(u, v, p, vmin=0, vmax=1, cmap="viridis", rasterized=True)
        axes.plot(*mines.T, "w.", ms=1.5)
        title = f"{formulation}, γ = {gamma:g}, {len(machine.relevance_)} vectors"
        axes.set_title(title, fontsize=8)
        axes.grid(visible=False)
    colour_bar(panels, shown, "p(mine)")
