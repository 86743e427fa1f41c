"""Sections: a lane too long for the memory, taken piece by piece along the track.

Backgrounds are estimated over the whole run, the density rule counts over the whole lane, and every
section looks a little beyond its own rows, so that sections together hold the run-view and the
alarms that the whole lane would.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from itertools import pairwise
from typing import Any

import pandas as pd

from flgpr.chain.recipe import Recipe
from flgpr.model import Lane
from flgpr.screen import view_threshold


@dataclass(frozen=True)
class Section:
    """Rows of a lane's run-view, from the first to the one before ``stop``.

    ``threshold`` is the magnitude from which on local maxima are alarms; without it the density
    rule is applied to these rows alone.
    """

    start: int
    stop: int
    threshold: float | None = None

    @property
    def rows(self) -> slice:
        """The rows."""
        return slice(self.start, self.stop)


def divide(rows: int, longest: int) -> list[Section]:
    """Cut rows into the fewest sections of at most so many rows, as even as can be.

    Examples
    --------
    >>> [(section.start, section.stop) for section in divide(10, 4)]
    [(0, 3), (3, 6), (6, 10)]
    """
    count = -(-rows // longest)
    return [
        Section(start, stop)
        for start, stop in pairwise(rows * k // count for k in range(count + 1))
    ]


def margin(recipe: Recipe) -> int:
    """Return how many rows beyond its own a section must know to find its local maxima.

    Twice the alarm radius, as a maximum may give way to an equal one within the radius, and the
    border; more if what its stages tell of an alarm depends on more.
    """
    stages = [one for one in (recipe.screen, *recipe.columns) if one is not None]
    reach = max(
        [2 * recipe.prescreen.radius, *(one.stage_class.margin(one.settings) for one in stages)]
    )
    return math.ceil(reach / recipe.run_view.spacing) + 2


def kept_rows(recipe: Recipe, lane: Lane, section: Section) -> slice:
    """Return a section's rows of the lane's run-view and those beyond them that it must know."""
    more = margin(recipe)
    return slice(
        max(section.start - more, 0), min(section.stop + more, recipe.run_view.grid(lane).ny)
    )


def section_lane(recipe: Recipe, lane: Lane, section: Section) -> Lane:
    """Return the part of a lane that belongs to a section; neighbours meet half a pixel before its first row."""
    grid = recipe.run_view.grid(lane)
    begin = (
        lane.y_min
        if section.start == 0
        else max(lane.y_min, grid.y_min + (section.start - 0.5) * grid.dy)
    )
    end = (
        lane.y_max
        if section.stop == grid.ny
        else min(lane.y_max, grid.y_min + (section.stop - 0.5) * grid.dy)
    )
    return Lane(lane.x_min, lane.x_max, begin, end)


def section_note(lane: Lane, section: Section) -> dict[str, Any]:
    """Write down a section for a manifest; its threshold as text, which holds an infinite one too."""
    return {
        "lane": asdict(lane),
        "rows": [section.start, section.stop],
        "threshold": repr(section.threshold),
    }


def noted_section(note: Mapping[str, Any]) -> tuple[Lane, Section]:
    """Read the whole lane and the section that :func:`section_note` wrote."""
    start, stop = note["rows"]
    return Lane(**note["lane"]), Section(int(start), int(stop), float(note["threshold"]))


def lane_threshold(recipe: Recipe, lane: Lane, maxima: pd.DataFrame, seen: int) -> float:
    """Apply the density rule to a lane: the magnitude from which on its local maxima (x, y in m) are alarms.

    ``seen`` is the number of pixels of its run-view that were seen; see
    :func:`flgpr.screen.density_threshold`.
    """
    if recipe.screen is not None:
        return -math.inf  # a stage of its own has judged already
    screen = recipe.prescreen
    grid = recipe.run_view.grid(lane)
    return view_threshold(
        maxima, lane, seen * grid.dx * grid.dy, screen.radius, screen.density, screen.count
    )
