"""Figures of the flsar2004 reproduction."""

from __future__ import annotations

import tomllib
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Ellipse, Rectangle
from numpy.typing import NDArray
from sklearn.svm import SVC

from flgpr.detect import OneClassRelevanceVectorMachine, RelevanceVectorClassifier
from flgpr.detect.one_class import FORMULATIONS
from flgpr.screen import fit_ellipse
from flgpr_papers.flsar2004.examples import POLARIZATIONS, Site, make_templates
from flgpr_papers.flsar2004.lanes import Settings, fiducials
from flgpr_papers.kit.figures import show, subplots
from flgpr_papers.kit.settings import packaged_text

Curves = dict[str, dict[str, dict[Any, Any]]]
TITLES: dict[str, str] = tomllib.loads(packaged_text("flsar2004", "figures"))
"""Title of every panel of ROCs by its name."""


def drawings(
    settings: Settings, sites: list[Site], curves: Curves, notes: dict[str, Any]
) -> dict[str, Callable[[], Figure]]:
    """Return what draws each figure: those of the paper in its order, then our own.

    Parameters
    ----------
    settings : Settings
        The study.
    sites : list of Site
        Both sites.
    curves : dict
        Columns of each ROC by figure and label.
    notes : dict
        Further numbers of the results.
    """

    def rocs(names: list[str], shape: tuple[int, int]) -> Callable[[], Figure]:
        return lambda: _rocs(curves, names, shape, notes)

    figures: dict[str, Callable[[], Figure]] = {
        "fig1": lambda: _lane(settings, sites[0]),
        "fig2": lambda: _ellipse(settings, sites[0]),
        "fig3": lambda: _templates(settings, sites),
        "fig4": margin_figure,
    }
    for number in range(5, 11):
        names = [name for name in TITLES if name.split()[0] == f"fig{number}"]
        figures[f"fig{number}"] = rocs(names, (-(-len(names) // 2), min(len(names), 2)))
    figures["machines"] = rocs(["machines"], (1, 1))
    figures["vectors"] = lambda: _vectors(notes["vectors by fold"])
    figures["one-class-width"] = kernel_width_figure
    shown_together = [name for name in TITLES if name != "machines" and "20 cm" not in name]
    figures["rocs"] = rocs(shown_together, (3, 3))
    return figures


def _lane(settings: Settings, site: Site) -> Figure:
    """Draw Fig. 1: HH and VV over part of the lane, with mines."""
    figure, rows_of_panels = subplots(10, 4.8, 2, 1, sharex=True)
    end = min(30.0, settings.length)
    rows = (site.grid.y >= 0) & (site.grid.y <= end)
    shown_mines = site.mines[site.mines["y"].between(0, end)]
    for p, axes in enumerate(rows_of_panels):
        level = 20 * np.log10(np.maximum(site.image[p, 0][rows], 1e-6))
        level -= np.median(level)
        extent = (0, end, site.grid.x[0], site.grid.x[-1])
        shown = show(axes, level.T, extent, -5, 25, cmap="viridis")
        beside = np.array([place for place in fiducials(settings) if place[1] <= end])
        axes.plot(*beside.T[::-1], "^", mfc="none", mec="#ffb347", ms=9)
        for x, y, kind, depth in shown_mines[["x", "y", "kind", "depth"]].to_numpy():
            where = "surface" if depth < -0.05 else f"{100 * depth:.0f} cm"
            axes.plot(y, x, "o", mfc="none", mec="white", ms=11)
            axes.annotate(
                f"{kind[0].upper()} {where}",
                (y, x),
                (0, 8),
                textcoords="offset points",
                color="white",
                fontsize=6,
                ha="center",
            )
        axes.grid(visible=False)
        axes.set(ylabel=f"{POLARIZATIONS[p]}\ncross-track, m")
    axes.set_xlabel("down-track, m")
    figure.colorbar(shown, ax=rows_of_panels, label="dB over the median", shrink=0.8)
    figure.suptitle(
        f"{site.name}, {settings.ranges[0]:g} m ahead; M metal, P plastic; triangles: fiducials"
    )
    return figure


def _ellipse(settings: Settings, site: Site) -> Figure:
    """Draw Fig. 2: the ellipse and the rectangle whose energies the prescreener compares.

    The origin is the cluster's brightest pixel; the rectangle is twice as
    long and wide as the ellipse.
    """
    ellipse = fit_ellipse(make_templates(settings, site)[0, 0], settings.spacing)
    figure, axes = subplots(5, 4)
    centre = ellipse.offset_y, ellipse.offset_x
    corner = centre[0] - 2 * ellipse.half_y, centre[1] - 2 * ellipse.half_x
    axes.add_patch(
        Rectangle(corner, 4 * ellipse.half_y, 4 * ellipse.half_x, fc="#d8dee6", ec="#4a5563")
    )
    axes.add_patch(Ellipse(centre, 2 * ellipse.half_y, 2 * ellipse.half_x, fc="#3b6ea5", ec="none"))
    axes.plot(0, 0, "x", color="black", ms=8, label="brightest pixel")
    axes.text(*centre, "E in", color="white", ha="center", va="bottom")
    axes.text(corner[0] * 0.95, corner[1] * 0.9, "E out", va="bottom")
    axes.autoscale_view()
    axes.set(aspect="equal", xlabel="down-track, m", ylabel="cross-track, m")
    axes.set_title(
        f"half axes {ellipse.half_y:.2f} m along, {ellipse.half_x:.2f} m across", fontsize=9
    )
    axes.legend(fontsize=7, loc="upper right")
    axes.grid(visible=False)
    return figure


def _templates(settings: Settings, sites: list[Site]) -> Figure:
    """Draw Fig. 3, with the ellipse of Fig. 2."""
    figure, panels = subplots(5.6, 8.4, 4, len(settings.ranges))
    for s, site in enumerate(sites):
        templates = make_templates(settings, site)
        for p, r in np.ndindex(*templates.shape[:2]):
            axes = panels[2 * s + p, r]
            _draw_template(axes, templates[p, r], settings)
            title = f"{site.name} {POLARIZATIONS[p]} {settings.ranges[r]:g} m"
            axes.set_title(title, fontsize=8)
    figure.supxlabel("down-track, m")
    figure.supylabel("cross-track, m")
    return figure


def _draw_template(axes: Axes, template: NDArray[Any], settings: Settings) -> None:
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


def margin_figure() -> Figure:
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
    support = points[machine.support_]
    relevance = points[sparse.relevance_]
    figure, axes = subplots(6, 4.6)
    for side, colour, name in ((0, "#b3261e", "l = -1"), (1, "#1f4e8c", "l = +1")):
        axes.plot(*points[label == side].T, "o", color=colour, ms=4, label=name)
    axes.plot(*support.T, "o", mfc="none", mec="black", ms=10, label="support vectors")
    axes.plot(*relevance.T, "s", mfc="none", mec="#2e7d32", ms=13, label="relevance vectors")
    axes.contour(
        u,
        v,
        signed,
        levels=[-below, 0, above],
        colors="black",
        linestyles=["dashed", "solid", "dashed"],
    )
    axes.contour(u, v, sparse_value, levels=[0], colors="#2e7d32")
    axes.set_title(
        f"D-1 = {below:.2f}, D+1 = {above:.2f}, margin {below + above:.2f}; green: RVM, p = 1/2",
        fontsize=9,
    )
    axes.legend(fontsize=7, loc="lower right")
    axes.set(aspect="equal", xlabel="first feature", ylabel="second feature")
    return figure


def _rocs(
    curves: Curves, names: Sequence[str], shape: tuple[int, int], notes: dict[str, Any]
) -> Figure:
    """Draw ROC curves by name, a panel each."""
    rows, columns = shape
    width, height = (3.7, 3.4) if columns > 2 else (5.2, 3.8)
    figure, panels = subplots(width * columns, height * rows, rows, columns, squeeze=False)
    for axes, name in zip(panels.ravel(), names, strict=True):
        for label, curve in curves.get(name, {}).items():
            # Not in the paper's figure.
            is_our_addition = "sum of the correlations" in label or "binary" in label
            axes.step(
                curve["far"],
                curve["pd"],
                where="post",
                label=label,
                lw=1.0 if is_our_addition else 1.6,
                ls="--" if is_our_addition else "-",
            )
        axes.set(xlabel="false alarms per m²", ylabel="Pd", ylim=(0, 1.02), xlim=(0, None))
        axes.set_title(TITLES[name])
        axes.title.set_fontsize(8)
        if curves.get(name):
            axes.legend(fontsize=7, loc="lower right")
        else:
            reason = notes.get(f"{name} both", "too few examples").replace("; ", ";\n")
            axes.text(0.5, 0.5, reason, transform=axes.transAxes, ha="center", fontsize=8)
    return figure


def _vectors(shares_by_machine: dict[str, list[float]]) -> Figure:
    """Draw histograms of the share of the training examples that are vectors, by machine."""
    figure, axes = subplots(5, 3)
    largest = max(max(shares) for shares in shares_by_machine.values())
    bins = np.linspace(0, largest * 1.05, 40)
    for label, shares in shares_by_machine.items():
        axes.hist(100 * np.asarray(shares), bins=(100 * bins).tolist(), alpha=0.7, label=label)
    axes.set(xlabel="training examples kept as vectors, %", ylabel="leave-one-out folds")
    axes.legend()
    return figure


def kernel_width_figure() -> Figure:
    """Draw the one-class machine's p(mine) over a plane, by kernel width and formulation."""
    rng = np.random.default_rng(0)
    first = rng.normal((-1, 0), 0.35, (40, 2))
    second = rng.normal((1, 0.5), 0.35, (40, 2))
    mines = np.concatenate([first, second])
    u, v = np.meshgrid(np.linspace(-4, 4, 120), np.linspace(-3, 3, 90))
    positions = np.column_stack([u.ravel(), v.ravel()])
    figure, panels = subplots(10, 6.4, 3, 4, sharex=True, sharey=True)
    for row, formulation in enumerate(FORMULATIONS):
        for column, gamma in enumerate((0.05, 0.5, 3.0, 30.0)):
            machine = OneClassRelevanceVectorMachine(
                gamma=gamma, formulation=formulation, n_reference=400, random_state=0, tol=1e-4
            ).fit(mines)
            p = machine.predict_proba(positions)[:, -1].reshape(u.shape)
            axes = panels[row, column]
            shown = axes.pcolormesh(u, v, p, vmin=0, vmax=1, cmap="viridis", rasterized=True)
            axes.plot(*mines.T, "w.", ms=1.5)
            title = f"{formulation}, γ = {gamma:g}, {len(machine.relevance_)} vectors"
            axes.set_title(title, fontsize=8)
            axes.grid(visible=False)
    figure.colorbar(shown, ax=panels, label="p(mine)")
    return figure
