"""Sections: a lane too long for the memory, taken piece by piece along the track.

Backgrounds are estimated over the whole run, the density rule counts over the whole lane, and every
section reads rows beyond its own. So sections together hold the run-view and the alarms that the
lane in one piece would. How many there are follows from the memory (``method/memory.py``).

Which ground a detection searches, why this ground, and what of it no scan sees.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import TYPE_CHECKING, Any

import pandas as pd

from flgpr.engine import blocks_of
from flgpr.method.memory import LaneMemory, lane_memory
from flgpr.model import Lane
from flgpr.recipe.schema import LEAST_LOOKS, Recipe, seen_lane
from flgpr.screen import view_threshold
from flgpr.store.store_layout import MAX_MEMORY

if TYPE_CHECKING:
    import xarray as xr

SHORTEST = 50.0
"""Length of a lane for which there must be memory, m."""


@dataclass(frozen=True)
class Section:
    """Rows of a lane's run-view, from the first to the one before ``stop``."""

    start: int
    stop: int
    #: magnitude from which on local maxima are alarms; without it the density rule is applied to
    #: these rows alone
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
    return [Section(block.start, block.stop) for block in blocks_of(rows, longest)]


def margin(recipe: Recipe) -> int:
    """Return how many rows beyond its own a section must know to find its local maxima.

    It is twice the alarm radius, as a maximum may give way to an equal one within the radius, and
    the border. It is more if a stage's columns of an alarm depend on more.
    """
    reach = 2 * recipe.prescreen.radius
    for stage in (recipe.screen, *recipe.columns):
        if stage is not None:
            reach = max(reach, stage.stage_class.margin(stage.settings))
    return math.ceil(reach / recipe.run_view.spacing) + 2


def kept_rows(recipe: Recipe, lane: Lane, section: Section) -> slice:
    """Return a section's rows of the lane's run-view and those beyond them that it must know."""
    beyond = margin(recipe)
    rows = recipe.run_view.grid(lane).ny
    return slice(max(section.start - beyond, 0), min(section.stop + beyond, rows))


def section_lane(recipe: Recipe, lane: Lane, section: Section) -> Lane:
    """Return the part of a lane that belongs to a section.

    Neighbours meet half a pixel before the first row of the second.
    """
    grid = recipe.run_view.grid(lane)
    begin = lane.y_min
    if section.start > 0:
        begin = max(lane.y_min, grid.y_min + (section.start - 0.5) * grid.dy)
    end = lane.y_max
    if section.stop < grid.ny:
        end = min(lane.y_max, grid.y_min + (section.stop - 0.5) * grid.dy)
    return Lane(lane.x_min, lane.x_max, begin, end)


def plan_sections(
    sizes: Mapping[str, int],
    recipe: Recipe,
    lane: Lane,
    limit: int = MAX_MEMORY,
    longest: float | None = None,
) -> list[Section]:
    """Cut a lane into as few sections as the memory allows, before anything is decoded.

    Parameters
    ----------
    sizes : mapping of str to int
        Lengths of the run's dimensions.
    recipe : Recipe
        The recipe.
    lane : Lane
        The lane.
    limit : int
        Bytes that a process may take.
    longest : float, optional
        The longest section that is wanted, m; infinity asks for the lane in one piece.

    Returns
    -------
    list of Section
        One that is the whole lane if that fits.

    Raises
    ------
    ValueError
        If the lane in one piece was asked for and takes more, or the memory does not suffice for
        sections of ``SHORTEST`` metres (or of the longest that is wanted), or the run-view reaches
        beyond the lane so that a section would have none of it. It says what would suffice.
    """
    if longest is not None and not longest > 0:
        raise ValueError(f"section must be a positive length in metres, got {longest}")
    memory = lane_memory(sizes, recipe, lane)
    needed = memory.needed()
    grid = memory.view
    wanted_rows = grid.ny
    if longest is not None and longest != math.inf:
        wanted_rows = max(1, math.floor(longest / grid.dy + 1e-9))
    if wanted_rows >= grid.ny and needed <= limit:
        return [Section(0, grid.ny)]
    if longest == math.inf:
        raise ValueError(
            f"max-memory must be at least {needed / 1e9:.3g} GB for a lane of "
            f"{lane.y_max - lane.y_min:.0f} m in one piece, got {limit / 1e9:.3g} GB: "
            "give more or take it in sections"
        )

    rows = _rows_within(memory, margin(recipe), limit, wanted_rows)
    sections = divide(grid.ny, rows)
    for section in sections:
        section_lane(recipe, lane, section)  # refuses a section without any of the lane
    return sections


def _rows_within(memory: LaneMemory, beyond: int, limit: int, most: int) -> int:
    """Return the rows of a section, at most ``most``, that ``limit`` bytes suffice for.

    It must know ``beyond`` rows more at either end.
    """
    grid = memory.view
    shortest = min(math.ceil(SHORTEST / grid.dy), most, grid.ny)
    least = memory.needed(min(shortest + 2 * beyond, grid.ny))
    if least > limit:
        raise ValueError(
            f"max-memory must be at least {least / 1e9:.3g} GB for this run, "
            f"got {limit / 1e9:.3g} GB"
        )

    # What is left beside the shortest section and a second thread makes sections longer.
    per_row = memory.needed(1) - memory.needed(0)
    room = limit - least - memory.thread
    longer = int(max(room, 0) / per_row)
    return min(most, shortest + longer)


def threads_within(
    sizes: Mapping[str, int],
    recipe: Recipe,
    lane: Lane,
    sections: Sequence[Section],
    limit: int = MAX_MEMORY,
) -> int:
    """Return how many threads may work on scans of a lane at once, at least one.

    Parameters
    ----------
    sizes : mapping of str to int
        Lengths of the run's dimensions.
    recipe : Recipe
        The recipe.
    lane : Lane
        The lane.
    sections : sequence of Section
        What :func:`plan_sections` returned.
    limit : int
        Bytes that the process may take.
    """
    rows = None
    if len(sections) > 1:
        longest = max(section.stop - section.start for section in sections)
        rows = longest + 2 * margin(recipe)
    memory = lane_memory(sizes, recipe, lane)
    room = limit - memory.needed(rows)
    return 1 + max(0, int(room / memory.thread))


def section_note(lane: Lane, section: Section) -> dict[str, Any]:
    """Return the entry of a section in a manifest; :func:`noted_section` reads it."""
    return {
        "lane": asdict(lane),
        "rows": [section.start, section.stop],
        "threshold": repr(section.threshold),  # as text, since JSON has no infinity
    }


def noted_section(entry: Mapping[str, Any]) -> tuple[Lane, Section]:
    """Return the whole lane and the section of an entry that :func:`section_note` made.

    Raises
    ------
    ValueError
        If the entry is none of these, as in a forged manifest.
    """
    try:
        start, stop = entry["rows"]
        return Lane(**entry["lane"]), Section(int(start), int(stop), float(entry["threshold"]))
    except (KeyError, TypeError, ValueError, OverflowError):
        raise ValueError(
            "section of the manifest must tell lane, rows and threshold as numbers, got "
            f"{str(entry)[:80]!r}"
        ) from None


def lane_threshold(recipe: Recipe, lane: Lane, maxima: pd.DataFrame, pixels_seen: int) -> float:
    """Apply the density rule to a lane (Wang et al. 2007, Sec. II-B).

    Parameters
    ----------
    recipe : Recipe
        The recipe.
    lane : Lane
        The lane.
    maxima : DataFrame
        Local maxima of its run-view: ``x``, ``y`` (m) and ``magnitude``.
    pixels_seen : int
        Number of pixels of the run-view that any scan sees.

    Returns
    -------
    float
        The magnitude from which on maxima are alarms, see
        :func:`flgpr.screen.density_threshold`.
    """
    if recipe.screen is not None:
        return -math.inf  # the recipe's screen stage has decided already
    screen = recipe.prescreen
    grid = recipe.run_view.grid(lane)
    area = pixels_seen * grid.dx * grid.dy
    return view_threshold(maxima, lane, area, screen.radius, screen.density, screen.count)


SEEN = f"the ground that {LEAST_LOOKS} scans or more see"
"""Source of a lane that follows from the run."""
_WORTH_SAYING = 0.05
"""Ground along the track that is worth a word, m."""


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


def describe_searched(run: xr.Dataset, recipe: Recipe, lane: Lane, source: str) -> dict[str, Any]:
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

    Returns
    -------
    dict
        The source of the lane, the ground that is seen, and in words what is searched, what is seen
        besides, and what cannot be searched.
    """
    if not source:
        source = "the recipe's lane" if recipe.lane is not None else SEEN
    borders = f"x {lane.x_min:.2f} to {lane.x_max:.2f} m, y {lane.y_min:.1f} to {lane.y_max:.1f} m"
    notes = [f"searched: {borders} ({source})"]
    seen = seen_lane(run, recipe)
    seen_y = (seen.y_min, seen.y_max)
    stretches = {
        "seen and not searched: y": _stretches(*seen_y, lane.y_min, lane.y_max),
        "in the lane and seen by no scan: y": _stretches(lane.y_min, lane.y_max, *seen_y),
        "in the lane and outside the run-view: x": _stretches(
            lane.x_min, lane.x_max, *recipe.run_view.x
        ),
    }
    for what, found in stretches.items():
        if found:
            notes.append(f"{what} {' and '.join(found)}")
    return {"source": source, "seen_y_m": list(seen_y), "notes": notes}
