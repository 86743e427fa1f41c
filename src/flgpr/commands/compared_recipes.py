"""Recipes that a result compares with its own: what another choice would have found."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from typing import TYPE_CHECKING, TypeVar

if TYPE_CHECKING:
    import xarray as xr

    from flgpr.method.detection import Detection
    from flgpr.model import Lane
    from flgpr.progress import Track

T = TypeVar("T")
DEMO_COMPARISONS = ("mean-self-signature", "median-self-signature", "roadside-suppressed")
"""Names, after ``demo-``, of the recipes that the demonstration compares with the recipe demo."""


def detect_compared(run: xr.Dataset, name: str, text: str, lane: Lane, track: Track) -> Detection:
    """Detect on a run by a recipe that is compared with a result's own.

    Parameters
    ----------
    run : xarray.Dataset
        The run.
    name : str
        Name of the detection.
    text : str
        The recipe, TOML.
    lane : Lane
        The lane.
    track : Track
        Shows progress.

    Returns
    -------
    Detection
        The detection, under its name.
    """
    from flgpr.method.method import detect
    from flgpr.recipe.schema import parse_recipe

    def track_with_name(items: Iterable[T], label: str, total: int) -> Iterable[T]:
        return track(items, f"{name}: {label}", total)

    detection = detect(run, parse_recipe(text), lane, track_with_name)
    return replace(detection, name=name, recipe_text=text)
