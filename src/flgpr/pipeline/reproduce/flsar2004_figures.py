"""Figures and report of the flsar2004 reproduction."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from numpy.typing import NDArray

from flgpr.detect import OneClassRelevanceVectorMachine
from flgpr.detect.one_class import FORMULATIONS
from flgpr.features import mean_template
from flgpr.pipeline.reproduce.flsar2004_examples import POLARIZATIONS, Site, signatures
from flgpr.pipeline.reproduce.flsar2004_findings import Finding
from flgpr.pipeline.reproduce.flsar2004_lanes import Settings
from flgpr.screen import fit_ellipse

Curves = dict[str, dict[str, pd.DataFrame]]
TITLES = {
    "fig5 arid-sand": "Fig. 5a: metal, flush and 5 cm, prescreened, arid",
    "fig5 temperate": "Fig. 5b: the same, temperate",
    "fig6": "Fig. 6: RVM and SVM, metal to 5 cm, VV, temperate",
    "fig6 leave-one-out": "Fig. 6, leave-one-out as in the paper",
    "fig7": "Fig. 7: binary RVM, both polarizations, temperate",
    "fig8": "Fig. 8: plastic by depth, temperate",
    "fig9": "Fig. 9: one-class RVM, both polarizations, temperate",
    "fig10 arid-sand to temperate": "Fig. 10: trained arid, tested temperate",
    "fig10 temperate to arid-sand": "the other way: trained temperate, tested arid",
}


def draw(
    folder: Path,
    settings: Settings,
    sites: list[Site],
    curves: dict[str, dict[str, pd.DataFrame]],
    notes: dict[str, Any],
) -> None:
    """Draw all figures into a folder."""
    with mpl.rc_context({"font.size": 9, "axes.grid": True, "grid.alpha": 0.3}):
        _lane(settings, sites[0]).savefig(folder / "fig1.png", dpi=110)
        _templates(settings, sites).savefig(folder / "fig3.png", dpi=110)
        _rocs(curves).savefig(folder / "rocs.png", dpi=110)
        _vectors(notes["vectors by fold"]).savefig(folder / "vectors.png", dpi=110)
        kernel_width_figure().savefig(folder / "one-class-width.png", dpi=110)


def _lane(settings: Settings, site: Site) -> Figure:
    """Fig. 1: HH and VV over part of the lane, with mines."""
    figure = Figure(figsize=(10, 4.6), layout="constrained")
    end = min(30.0, settings.length)
    rows = (site.grid.y >= 0) & (site.grid.y <= end)
    for axes, p in zip(figure.subplots(2, 1, sharex=True), range(2), strict=True):
        image = 20 * np.log10(np.maximum(site.image[p, 0][rows], 1e-6))
        image -= np.median(image)
        axes.imshow(
            image.T, origin="lower", extent=(0, end, site.grid.x[0], site.grid.x[-1]), vmin=-5, vmax=25, cmap="viridis",
            aspect="equal",
        )  # fmt: skip
        near = site.mines[site.mines["y"].between(0, end)]
        for x, y, kind, depth in near[["x", "y", "kind", "depth"]].to_numpy():
            axes.plot(y, x, "o", mfc="none", mec="white", ms=11)
            name = f"{kind[0].upper()} {'surface' if depth < -0.05 else f'{100 * depth:.0f} cm'}"
            axes.annotate(name, (y, x), (0, 8), textcoords="offset points", color="white", fontsize=6, ha="center")
        axes.grid(visible=False)
        axes.set(ylabel=f"{POLARIZATIONS[p]}\ncross-track, m")
    axes.set_xlabel("down-track, m")
    figure.suptitle(f"{site.name}, {settings.ranges[0]:g} m ahead: dB over the median; M metal, P plastic")
    return figure


def _templates(settings: Settings, sites: list[Site]) -> Figure:
    """Fig. 3, with the ellipse of Fig. 2."""
    figure = Figure(figsize=(9, 6), layout="constrained")
    axes = figure.subplots(4, len(settings.ranges))
    for s, site in enumerate(sites):
        template = mean_template(signatures(settings, site, True)[0])
        for p, r in np.ndindex(*template.shape[:2]):
            one: NDArray[Any] = template[p, r]
            place = axes[2 * s + p, r]
            half = one.shape[0] * settings.spacing[1] / 2, one.shape[1] * settings.spacing[0] / 2
            place.imshow(one.T, origin="lower", extent=(-half[0], half[0], -half[1], half[1]), cmap="magma")
            ellipse = fit_ellipse(one, settings.spacing)
            angle = np.linspace(0, 2 * np.pi, 100)
            # Where the prescreener would put it: about the strongest pixel.
            row, column = np.unravel_index(int(one.argmax()), one.shape)
            v = (row - one.shape[0] // 2) * settings.spacing[1]
            u = (column - one.shape[1] // 2) * settings.spacing[0]
            place.plot(v + ellipse.half_y * np.cos(angle), u + ellipse.half_x * np.sin(angle), "w:", lw=1)
            place.set(xlim=(-half[0], half[0]), ylim=(-half[1], half[1]), xticks=(-0.3, 0, 0.3))
            place.grid(visible=False)
            place.set_title(f"{site.name} {POLARIZATIONS[p]} {settings.ranges[r]:g} m", fontsize=8)
    figure.suptitle("Mean signatures of the subset (down-track to the right, m); dotted: ellipse of the energy ratio")
    return figure


def _rocs(curves: Curves) -> Figure:
    figure = Figure(figsize=(11, 10), layout="constrained")
    for axes, name in zip(figure.subplots(3, 3).ravel(), TITLES, strict=True):
        for label, curve in curves.get(name, {}).items():
            axes.step(curve["far"], curve["pd"], where="post", label=label)
        axes.set(title=TITLES[name], xlabel="false alarms per m²", ylabel="Pd", ylim=(0, 1.02), xlim=(0, None))
        axes.title.set_fontsize(8)
        if curves.get(name):
            axes.legend(fontsize=7, loc="lower right")
    return figure


def _vectors(kept: dict[str, list[float]]) -> Figure:
    figure = Figure(figsize=(5, 3), layout="constrained")
    axes = figure.subplots()
    bins = np.linspace(0, max(max(values) for values in kept.values()) * 1.05, 40)
    for label, values in kept.items():
        axes.hist(100 * np.asarray(values), bins=(100 * bins).tolist(), alpha=0.7, label=label)
    axes.set(xlabel="training examples kept as vectors, %", ylabel="leave-one-out folds")
    axes.legend()
    return figure


def kernel_width_figure() -> Figure:
    """Draw the one-class machine's p(mine) over a plane for several kernel widths and each formulation."""
    rng = np.random.default_rng(0)
    mines = np.concatenate([rng.normal((-1, 0), 0.35, (40, 2)), rng.normal((1, 0.5), 0.35, (40, 2))])
    u, v = np.meshgrid(np.linspace(-4, 4, 120), np.linspace(-3, 3, 90))
    figure = Figure(figsize=(10, 6.4), layout="constrained")
    axes = figure.subplots(3, 4, sharex=True, sharey=True)
    for row, formulation in enumerate(FORMULATIONS):
        for column, gamma in enumerate((0.05, 0.5, 3.0, 30.0)):
            machine = OneClassRelevanceVectorMachine(
                gamma=gamma, formulation=formulation, n_reference=400, random_state=0, tol=1e-4
            ).fit(mines)
            p = machine.predict_proba(np.column_stack([u.ravel(), v.ravel()]))[:, -1].reshape(u.shape)
            place = axes[row, column]
            shown = place.pcolormesh(u, v, p, vmin=0, vmax=1, cmap="viridis", rasterized=True)
            place.plot(*mines.T, "w.", ms=1.5)
            place.set_title(f"{formulation}, γ = {gamma:g}, {len(machine.relevance_)} vectors", fontsize=8)
            place.grid(visible=False)
    figure.colorbar(shown, ax=axes, label="p(mine)")
    return figure


def report(findings: list[Finding], areas: dict[str, tuple[float, float, float]], notes: dict[str, Any]) -> str:
    """Write the report in Markdown."""
    lines = [
        "# flsar2004, reproduced on simulated lanes", "",
        "A finding holds if the 95 % interval lies within the rule, fails if outside; the rules were set first.", "",
        "| finding | the paper | number | ours | rule | verdict |", "|---|---|---|---|---|---|",
    ]  # fmt: skip
    lines += [
        f"| {f.name} | {f.paper} | {f.quantity} | {f.value:.3f} ({f.low:.3f} to {f.high:.3f}) "
        f"| {f.rule[0]:g} to {f.rule[1]:g} | **{f.verdict}** |"
        for f in findings
    ]
    lines += ["", "| area under the ROC | value | 95 % interval |", "|---|---|---|"]
    lines += [f"| {name} | {v:.3f} | {low:.3f} to {high:.3f} |" for name, (v, low, high) in areas.items()]
    lines += ["", "## Notes", ""]
    lines += [f"- {name}: {value}" for name, value in notes.items() if name != "vectors by fold"]
    lines += ["", "![lane](fig1.png)", "![templates](fig3.png)", "![ROC curves](rocs.png)"]
    lines += ["![vectors](vectors.png)", "![kernel width](one-class-width.png)", ""]
    return "\n".join(lines)
