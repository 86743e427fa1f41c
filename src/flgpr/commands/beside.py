"""Recipes that a result sets beside its own: what another choice would have done."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import xarray as xr

    from flgpr.chain.detection import Detection
    from flgpr.chain.progress import Track
    from flgpr.model import Lane

BESIDE_DEMO = ("mean-self-signature", "median-self-signature", "roadside-suppressed")
"""Names, after ``demo-``, of the recipes that the demonstration sets beside the recipe demo."""


def detect_beside(run: xr.Dataset, name: str, text: str, lane: Lane, track: Track) -> Detection:
    """Detect by a recipe that stands beside a result's own, under a name of its own."""
    from flgpr.chain.method import detect
    from flgpr.chain.recipe import parse_recipe

    def named(items: Any, label: str, total: int) -> Any:
        return track(items, f"{name}: {label}", total)

    detection = detect(run, parse_recipe(text), lane, named)
    return replace(detection, name=name, recipe_text=text)
