"""`fused` and C_HH for the array of the packaged full-wave lane, put together by hand."""

from __future__ import annotations

from flgpr.recipe.schema import Recipe, parse_recipe, recipe_text

CLEAR = 0.6  # m about targets in which no clutter is learnt: the lane is 2 m wide
EARLY = '[[clutter]]\nstage = "early"\n'
HEAD = """
name = "{name}"
description = "{name}"
[image]
x = [-1.4, 1.4]
y = [1.2, 5.84]
spacing = 0.025
window = "hann"
tolerance = 1e-3
[image.subbands]
{subbands}
[background]
self_signature = "none"
median = 1.0
mean = 1.25
{early}
"""
LOW = "B0 = [0.45e9, 0.60e9]\nB1 = [0.60e9, 0.80e9]\nB2 = [0.80e9, 1.05e9]"
WIDE = "F0 = [0.45e9, 1.5e9]\nF1 = [0.45e9, 1.05e9]\nF2 = [0.9e9, 1.5e9]"
TAIL = """
[map]
stage = "likelihood"
sensor = "full-wave"
clear = {clear}
level = {level}
[run_view]
x = [-1.4, 1.4]
spacing = 0.05
y_max = 5.84
look = "mean"
falloff = 2
[prescreen]
polarization = "likelihood"
subband = "all"
radius = 0.375
density = 0.75
count = "view"
[contrast]
polarization = "HH"
subband = "{subband}"
size = 13
spacing = 0.1
inner = [5, 3]
guard = [9, 7]
[score]
halo = 0.5
area = "union"
"""


def fused_recipe(
    subbands: str = LOW, level: float = 2.0, early: bool = False, clear: float = CLEAR
) -> Recipe:
    """Return `fused` for this array: with other sub-bands, another weight of the contrast, or without early echoes."""
    subband = "B1" if subbands == LOW else "F0"
    head = HEAD.format(name="fused", subbands=subbands, early=EARLY if early else "")
    return parse_recipe(head + TAIL.format(clear=clear, level=level, subband=subband))


def contrast_recipe(early: bool = False) -> Recipe:
    """Return C_HH of Wang et al. 2007 for this array: `miniature` without its other features."""
    text = recipe_text("miniature").replace("[features]\ninner = [5, 3]\n", "")
    return parse_recipe(text + (EARLY if early else ""))
