"""Which ground a detection searches, why this ground, and what of it no scan sees."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

from flgpr.model import Lane
from flgpr.recipe.schema import LEAST_LOOKS, Recipe, seen_lane

if TYPE_CHECKING:
    import xarray as xr

SEEN = f"the ground that {LEAST_LOOKS} scans or more see"
"""Source of a lane that follows from the run."""
_WORTH_SAYING = 0.05
"""Ground along the track that is worth a word, m."""


@dataclass(frozen=True)
class SearchedGround:
    """Ground that a detection searches, beside the ground that the run sees."""

    lane: Lane  #: searched
    source: str  #: where its borders come from
    seen_ground: Lane  #: ground that any scan sees, as wide as a lane without borders
    view_x: tuple[float, float]  #: the run-view's borders across, m

    def notes(self) -> list[str]:
        """Return in words what is searched, what is seen besides, and what cannot be searched."""
        lane = self.lane
        borders = (
            f"x {lane.x_min:.2f} to {lane.x_max:.2f} m, y {lane.y_min:.1f} to {lane.y_max:.1f} m"
        )
        notes = [f"searched: {borders} ({self.source})"]

        seen_y = (self.seen_ground.y_min, self.seen_ground.y_max)
        not_searched = _stretches(*seen_y, lane.y_min, lane.y_max)
        if not_searched:
            notes.append(f"seen and not searched: y {' and '.join(not_searched)}")

        unseen = _stretches(lane.y_min, lane.y_max, *seen_y)
        if unseen:
            notes.append(f"in the lane and seen by no scan: y {' and '.join(unseen)}")

        outside_view = _stretches(lane.x_min, lane.x_max, *self.view_x)
        if outside_view:
            notes.append(f"in the lane and outside the run-view: x {' and '.join(outside_view)}")
        return notes

    def as_json(self) -> dict[str, Any]:
        """Return the source of the lane, the ground that is seen, and the notes."""
        seen_y = [self.seen_ground.y_min, self.seen_ground.y_max]
        return {"source": self.source, "seen_y_m": seen_y, "notes": self.notes()}


def _stretches(first: float, last: float, inner_first: float, inner_last: float) -> list[str]:
    """Return in words what of an interval lies outside another, m."""
    stretches = []
    if inner_first - first > _WORTH_SAYING:
        stretches.append(f"{first:.1f} to {min(inner_first, last):.1f} m")
    if last - inner_last > _WORTH_SAYING:
        stretches.append(f"{max(inner_last, first):.1f} to {last:.1f} m")
    return stretches


def seen_part(lane: Lane, seen: Lane) -> Lane | None:
    """Return the part of a lane within what is seen along the track; None where there is none."""
    y_min = max(lane.y_min, seen.y_min)
    y_max = min(lane.y_max, seen.y_max)
    return replace(lane, y_min=y_min, y_max=y_max) if y_max > y_min else None


def searched_ground(run: xr.Dataset, recipe: Recipe, lane: Lane, source: str) -> SearchedGround:
    """Compare the lane that is searched with the ground that a run sees.

    Parameters
    ----------
    run : xarray.Dataset
        The run.
    recipe : Recipe
        The recipe; its image and run-view say how far a scan sees.
    lane : Lane
        Ground that is searched.
    source : str
        Where its borders come from; "" is the recipe, or the ground that the run sees.
    """
    if not source:
        source = "the recipe's lane" if recipe.lane is not None else SEEN
    return SearchedGround(lane, source, seen_lane(run, recipe), recipe.run_view.x)
