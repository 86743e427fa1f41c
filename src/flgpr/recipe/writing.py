"""The text of a recipe that is made for a run, with the reason for every entry beside it."""

from __future__ import annotations

from flgpr.recipe.choice import ALARM_RADIUS, MEAN, MEDIAN_STEP, PATCH, Figures, pixels_of

# Lengths that belong to a mine and what surrounds it, whatever the array: Wang et al. 2007, m.
_DENSITY = 0.75  # alarms per area of an alarm
_HALO = 1.0
_INNER = (0.5, 0.3)
_GUARD = (0.9, 0.7)
_COHERENT = (0.25, 0.15)
_MEDIAN = 1.05
_PAPER = "as in Wang et al. 2007"


def fitted_text(figures: Figures) -> str:
    """Write a recipe as TOML.

    Parameters
    ----------
    figures : Figures
        What it holds.

    Returns
    -------
    str
        Its text.
    """
    tables = [
        _head(figures),
        _image_table(figures),
        _subbands_table(figures),
        _background_table(figures),
        _run_view_table(figures),
        _prescreen_table(figures),
        _contrast_table(figures),
    ]
    if figures.has_features:
        tables.append(_features_table(figures))
    tables.append(_score_table())
    return "\n".join(tables)


def _head(figures: Figures) -> str:
    """Write what the recipe was made from, its name and its description."""
    confidence = "Ten features" if figures.has_features else "Local contrast"
    return f"""\
# Made by `flgpr recipe for` {figures.described} Lengths in m, frequencies in Hz.

name = "fitted"
description = "{confidence} after Wang et al. 2007, {figures.fitted_to}"
"""


def _image_table(figures: Figures) -> str:
    """Write the table of the scan images."""
    frames = ""
    if figures.aperture:
        frames = f'frames = "all"  # {figures.reasons["image.frames"]}\n'
    left, right = figures.image_x
    nearest, far = figures.image_y
    return f"""\
[image]
x = [{left:.2f}, {right:.2f}]  # {figures.reasons["image.x"]}
y = [{nearest:.2f}, {far:.2f}]  # {figures.reasons["image.y"]}
spacing = {figures.fine}  # {figures.reasons["image.spacing"]}
window = "{figures.window}"  # {figures.reasons["image.window"]}
{frames}"""


def _subbands_table(figures: Figures) -> str:
    """Write the table of the sub-bands."""
    lines = [f"[image.subbands]  # {figures.reasons['image.subbands']}\n"]
    for name, (low, high) in figures.edges.items():
        lines.append(f"{name} = [{low}, {high}]\n")
    return "".join(lines)


def _background_table(figures: Figures) -> str:
    """Write the table of self-signature and gain background."""
    method = "mean" if figures.drives else "none"
    return f"""\
[background]
self_signature = "{method}"  # {figures.reasons["background.self_signature"]}
median = {_MEDIAN}  # {_PAPER}
mean = {MEAN}  # {_PAPER}
median_step = {figures.median_step}  # {MEDIAN_STEP} m, {_PAPER}
"""


def _run_view_table(figures: Figures) -> str:
    """Write the table of the run-view."""
    left, right = figures.view_x
    return f"""\
[run_view]
x = [{left:.2f}, {right:.2f}]  # {figures.reasons["run_view.x"]}
spacing = {figures.coarse}  # {figures.reasons["run_view.spacing"]}
y_max = {figures.y_max:.2f}  # {figures.reasons["run_view.y_max"]}
"""


def _prescreen_table(figures: Figures) -> str:
    """Write the table of the prescreener."""
    return f"""\
[prescreen]
polarization = "{figures.polarization}"  # {figures.reasons["prescreen.polarization"]}
subband = "{figures.subband}"  # {figures.reasons["prescreen.subband"]}
radius = {ALARM_RADIUS}  # {_PAPER}
density = {_DENSITY}  # {_PAPER}
count = "view"
"""


def _contrast_table(figures: Figures) -> str:
    """Write the table of the local contrast."""
    spacing = figures.coarse
    return f"""\
[contrast]
polarization = "{figures.polarization}"  # the prescreener's channel
subband = "{figures.subband}"
size = {pixels_of([PATCH], spacing)[0]}  # {PATCH} m, {_PAPER}
spacing = {spacing}  # the run-view's
inner = {pixels_of(_INNER, spacing)}  # {_INNER[0]} m x {_INNER[1]} m, {_PAPER}
guard = {pixels_of(_GUARD, spacing)}  # {_GUARD[0]} m x {_GUARD[1]} m, {_PAPER}
"""


def _features_table(figures: Figures) -> str:
    """Write the table of the features."""
    return f"""\
[features]  # the run has HH, VV and a cross-polarized channel
inner = {pixels_of(_COHERENT, figures.fine)}  # {_COHERENT[0]} m x {_COHERENT[1]} m of the image, \
{_PAPER}
psi = "circular"  # angles are averaged as directions
"""


def _score_table() -> str:
    """Write the table of the scoring."""
    return f"""\
[score]
halo = {_HALO}  # {_PAPER}
area = "union"
"""
