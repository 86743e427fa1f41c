"""The text of a recipe that is made for a run, with the reason for every entry beside it."""

from __future__ import annotations

from typing import Any

from flgpr.recipe.choice import MEDIAN_STEP, Figures, pixels_of
from flgpr.toml_text import InlineTable, toml_lines

# Lengths that belong to a mine and what surrounds it, whatever the array: Wang et al. 2007, m.
_DENSITY = 0.75  # alarms per area of an alarm
_HALO = 1.0
_INNER = (0.5, 0.3)
_GUARD = (0.9, 0.7)
_COHERENT = (0.25, 0.15)
_MEDIAN = 1.05
EARLY = InlineTable(stage="early")
"""Clutter stage that takes out what arrives before the first pixel."""
_PAPER = "as in Wang et al. 2007"
_REASONS = {
    "background.median": _PAPER,
    "background.median_step": f"{MEDIAN_STEP} m, {_PAPER}",
    "prescreen.density": _PAPER,
    "contrast.polarization": "the prescreener's channel",
    "contrast.spacing": "the run-view's",
    "contrast.inner": f"{_INNER[0]} m x {_INNER[1]} m, {_PAPER}",
    "contrast.guard": f"{_GUARD[0]} m x {_GUARD[1]} m, {_PAPER}",
    "features": "the run has HH, VV and a cross-polarized channel",
    "features.inner": f"{_COHERENT[0]} m x {_COHERENT[1]} m of the image, {_PAPER}",
    "features.psi": "angles are averaged as directions",
    "score.halo": _PAPER,
}
"""Why entries are as they are that do not follow from the run."""


def fitted_text(figures: Figures) -> str:
    """Write the recipe of a run after Wang et al. 2007 as TOML.

    Parameters
    ----------
    figures : Figures
        What follows from the run.

    Returns
    -------
    str
        Its text.
    """
    head = f"# Made by `flgpr recipe for` {figures.described} Lengths in m, frequencies in Hz.\n"
    confidence = "Ten features" if figures.has_features else "Local contrast"
    if figures.method.again:
        confidence += " of what has changed"
    spacing = figures.coarse
    image: dict[str, Any] = {
        "x": figures.image_x,
        "y": figures.image_y,
        "spacing": figures.fine,
        "window": figures.method.window,
    }
    if figures.setup.aperture:
        image["frames"] = "all"
    image["subbands"] = figures.edges
    channel = {"polarization": figures.polarization, "subband": figures.subband}
    tables: dict[str, Any] = {
        "name": "fitted",
        "description": f"{confidence} after Wang et al. 2007, {figures.fitted_to}",
        **({"clutter": [EARLY]} if figures.method.early else {}),
        "image": image,
        "background": {
            "self_signature": "mean" if figures.setup.drives else "none",
            "median": _MEDIAN,
            "mean": figures.method.lengths["mean"],
            "median_step": figures.median_step,
        },
        "run_view": {"x": figures.view_x, "spacing": spacing, "y_max": figures.y_max},
        "prescreen": {
            **channel,
            "radius": figures.method.lengths["radius"],
            "density": _DENSITY,
            "count": "view" if figures.setup.aperture else "lane",
        },
        "contrast": {
            **channel,
            "size": pixels_of([figures.method.lengths["patch"]], spacing)[0],
            "spacing": spacing,
            "inner": pixels_of(_INNER, spacing),
            "guard": pixels_of(_GUARD, spacing),
        },
    }
    if figures.has_features:
        inner = pixels_of(_COHERENT, figures.fine)
        tables["features"] = {"inner": inner, "psi": "circular"}
    tables["score"] = {"halo": _HALO, "area": "union"}
    lines = toml_lines(tables, _REASONS | figures.reasons)
    return "\n".join([head, *lines]) + "\n"
