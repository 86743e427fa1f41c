"""The page of the reproduction: findings, tables and figures of the paper beside ours."""

from __future__ import annotations

from collections.abc import Mapping
from html import escape
from typing import Any

import flgpr
from flgpr_papers.flsar2004.experiment import Results
from flgpr_papers.flsar2004.figures import CAPTIONS
from flgpr_papers.flsar2004.lanes import Settings
from flgpr_papers.kit.page import bullets, figure_html, findings_table, quick_note, study_html, wide_table

_RULES = (
    "A finding agrees if the 95 % interval lies within the rule, disagrees if it lies outside, else it cannot be said. "
    "The rules were written before any ROC was computed. Intervals of areas are bootstrapped over mines (both looks "
    "together) and clutter examples, proportions have exact or Newcombe's intervals, that of the vectors is the range "
    "of the folds. The simulated world was not adjusted to agree."
)


def page_html(settings: Settings, results: Results, pictures: Mapping[str, bytes], quick: bool) -> str:
    """Write the page."""
    notes = results.notes
    parts = [
        "<h1>flsar2004 on simulated lanes</h1>",
        quick_note(quick, "Few mines, few tones, thinned surface clutter"),
        f"<p>flgpr {escape(flgpr.__version__)}; sensor {escape(settings.sensor)}; "
        f"sites {escape(' and '.join(settings.sites))}; a lane of {settings.length:g} m at each, driven in both "
        "directions.</p>",
        "<h2>Findings</h2>",
        findings_table(results.findings, _RULES),
        "<h2>Sizes and sparsity</h2>",
        _sizes(settings, notes),
        "<h2>Areas under the ROC</h2>",
        wide_table(
            ("curve", "area", "95 %"),
            [(name, f"{v:.3f}", f"{low:.3f} to {high:.3f}") for name, (v, low, high) in results.areas.items()],
        ),
        "<h2>Other templates, complex correlation</h2>",
        *_variants(notes),
        "<h2>Registration by fiducials</h2>",
        _registration(notes["registration"]),
        "<h2>Figures</h2>",
        *(figure_html(picture, CAPTIONS[name]) for name, picture in pictures.items() if name != "rocs"),
        "<h2>What was chosen where the paper is silent</h2>",
        _choices(settings),
    ]
    return study_html("flsar2004, reproduced", parts)


def _sizes(settings: Settings, notes: Mapping[str, Any]) -> str:
    loo = notes["vectors, leave-one-out"]
    metal, plastic = (sum(getattr(mines, kind) for mines in settings.mines) for kind in ("metal", "plastic"))
    rows = [
        ("mines per site, metal and plastic", "60 and 30", f"{metal} and {plastic}"),
        (
            "examples of the leave-one-out (par. 57)",
            "153, of them 27 mines",
            f"{loo['examples']}, {loo['mines']} mines",
        ),
        ("support vectors", "34 % (par. 48), typically 30 % (par. 57)", f"{100 * loo['SVM']:.1f} %"),
        ("relevance vectors", "14 % (par. 48), typically 15 % (par. 57)", f"{100 * loo['RVM']:.1f} %"),
    ]
    for site, counts in notes["examples"].items():
        told = ", ".join(f"{count} {kind}" for kind, count in counts.items())
        rows.append((f"examples without prescreener, both looks, {site}", "not given", told))
    for name, told in notes.items():
        if name.startswith(("prescreened", "fig5")):
            text = ", ".join(f"{k}: {_short(v)}" for k, v in told.items()) if isinstance(told, dict) else str(told)
            rows.append((name, "", text))
    return wide_table(("", "paper", "here"), rows)


def _short(value: Any) -> str:
    return f"{value:.2f}" if isinstance(value, float) else str(value)


def _variants(notes: Mapping[str, Any]) -> list[str]:
    told = notes["templates"]
    names = list(next(iter(told.values())))
    rows = [
        (name, *("{:.2f} ({:.2f} to {:.2f}); {:+.2f} ({:+.2f} to {:+.2f})".format(
            *case[name]["area"], *case[name]["less the main one"]) for case in told.values()))
        for name in names
    ]  # fmt: skip
    shares = ", ".join(f"{name}: {share:.2f}" for name, share in notes["energy of the first component"].items())
    return [
        "<p>Area under the ROC without prescreener, all depths, both polarizations, binary RVM; behind the semicolon "
        "its difference to the first row on the same examples. The first row is used everywhere else.</p>",
        wide_table(("templates", *told), rows),
        f"<p>Share of the signatures' energy in their first principal component: {escape(shares)}.</p>",
    ]


def _registration(told: Mapping[str, Any]) -> str:
    rows = []
    for site, found in told.items():
        for name, one in found.items():
            across, along = (f"{100 * shift:+.1f}" for shift in one["shift"])
            rows.append((site, name, f"{across}, {along} cm", f"{100 * one['residual']:.1f} cm", one["fiducials"]))
    return wide_table(("site", "image", "shift across, along", "rms residual", "fiducials"), rows)


def _choices(settings: Settings) -> str:
    features, screen, classify = settings.features, settings.prescreen, settings.classify
    start, step, count = settings.tones
    told = [
        f"Tones {start / 1e9:g} to {(start + step * (count - 1)) / 1e9:g} GHz in steps of {step / 1e6:g} MHz; the "
        "paper's sensor has 0.3-3 GHz. A stop every 5 m; a pixel of the image of a range comes from the stop that sees "
        "it within half a step of that range.",
        f"Region {features.region[0]:g} m x {features.region[1]:g} m, template {features.template[0]:g} m x "
        f"{features.template[1]:g} m, magnitudes; shifts padded with zeros, both at unit energy.",
        f"Clutter examples are the tiles of the lane of a region's size that lie {features.keep_off:g} m off "
        "every mine.",
        f"{100 * features.share:g} % of the mines give templates, ellipse and thresholds and are never used again. "
        f"Thresholds let {100 * screen.pass_share:g} % of the subset's metal mines pass each prescreener.",
        'The paper says "and" over all six images in one place and "either polarization" in another. Here a region '
        "passes if all ranges of either polarization let it pass.",
        f"Scores are held out by mine in {classify.folds} groups, the paper's leave-one-out beside them in Fig. 6. "
        "Kernel width or degree and C are chosen inside each training fold.",
        "Of Fig. 6 the paper says both arid and temperate, of Fig. 7 both VV and fusion: temperate and fusion are "
        "taken. Its mine counts are taken for each site.",
        "The prior of the RVM is ARD. The one-class machine has a fixed offset, p = 0.01 far from all mines: with a "
        "free bias nothing but the bias survives.",
    ]
    return bullets(told)
