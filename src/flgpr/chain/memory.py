"""How much memory a detection takes, told before it begins."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence

import xarray as xr

from flgpr.chain.recipe import Recipe
from flgpr.chain.sections import Section, divide, margin, section_lane
from flgpr.model import Lane
from flgpr.store.store_layout import MAX_MEMORY

SHORTEST = 50.0
"""Length of a lane for which there must be memory, m."""
CACHE = 512 * 2**20
"""Images of a short run that are kept in memory, bytes."""
_UNITS = {"": 1, "B": 1, "KB": 10**3, "MB": 10**6, "GB": 10**9, "TB": 10**12}
_UNITS |= {"KIB": 2**10, "MIB": 2**20, "GIB": 2**30, "TIB": 2**40}
_PROGRAM = 350e6  # interpreter, libraries, compiled kernels
_PER_PIXEL = 170.0  # image, its copies, totals and backgrounds, bytes per pixel and channel
# a scan's data, range-compressed profiles and copies, bytes per sample and sub-band
_PER_SAMPLE = 60.0
_PER_COMPLEX = 8.0  # an image's pixel, bytes
_PER_VIEW_PIXEL = 30.0  # run-views, their sums and copies, bytes per pixel and channel
_MEDIAN = 5.0  # copies of all images while their median is taken
_PER_ALARM = 4000.0  # features and their sums, bytes per alarm and sub-band


def parse_size(text: str) -> int:
    """Read a size in bytes: "2GB" is 2·10⁹, "2GiB" is 2·2³⁰."""
    size = re.fullmatch(r"\s*(\d+(?:\.\d+)?)\s*([a-zA-Z]*)\s*", text)
    if not size or size[2].upper() not in _UNITS or float(size[1]) <= 0:
        raise ValueError(f"max-memory must be a size such as 2GB or 500MB, got {text!r}")
    return int(float(size[1]) * _UNITS[size[2].upper()])


def sizes_of(run: xr.Dataset) -> dict[str, int]:
    """Return the lengths of a run's dimensions by name."""
    return {str(name): length for name, length in run.sizes.items()}


def _per_thread(sizes: Mapping[str, int], recipe: Recipe) -> float:
    """Estimate what a scan at work and the sums of its block take."""
    image = recipe.image.grid()
    bands = len(recipe.image.subbands)
    pixels = image.nx * image.ny
    samples = sizes["pair"] * sizes["frequency"]
    return sizes["polarization"] * bands * (_PER_PIXEL * pixels + _PER_SAMPLE * samples)


def check_scan_memory(shape: tuple[int, int, int], recipe: Recipe, limit: int = MAX_MEMORY) -> None:
    """Refuse scans (polarization, pair, frequency) one of which would take more than a limit (bytes)."""
    needed = _PROGRAM + _per_thread(
        dict(zip(("polarization", "pair", "frequency"), shape, strict=True)), recipe
    )
    if needed > limit:
        raise ValueError(
            f"scans of {shape} samples must take at most {limit / 1e9:.3g} GB, got "
            f"{needed / 1e9:.3g} GB"
        )


def memory_needed(
    sizes: Mapping[str, int], recipe: Recipe, lane: Lane, rows: int | None = None
) -> float:
    """Estimate from above the bytes of a process that works on a lane, or on some rows of its run-view at a time.

    It does not grow with the number of scans, but for a self-signature by the median, which keeps
    all images; what grows with the length of the lane are its run-views and alarms. The factors
    were measured, see docs/robustness.md.
    """
    bands = len(recipe.image.subbands)
    view = recipe.run_view.grid(lane)
    channels = (len(recipe.image.polarizations) or sizes["polarization"]) * bands
    pixels = view.nx * (view.ny if rows is None else rows)
    alarms = (
        recipe.prescreen.density * pixels * view.dx * view.dy / (3.14 * recipe.prescreen.radius**2)
    )
    image = recipe.image.grid()
    images = _PER_COMPLEX * sizes["scan"] * channels * image.nx * image.ny
    median = recipe.background.self_signature == "median"
    kept = _MEDIAN * images if median else 0
    names = (
        1 if recipe.map is not None else len(recipe.run_view.channels(list(recipe.image.subbands)))
    )
    shown = names if recipe.map is not None else names * channels // bands
    run_views = _PER_VIEW_PIXEL * (channels + shown) / 2 * pixels + _PER_ALARM * bands * alarms
    stages = sum(
        one.stage_class.memory(one.settings, sizes, image) for one in recipe.named().values()
    )
    return _PROGRAM + _per_thread(sizes, recipe) + kept + run_views + stages


def plan_sections(
    sizes: Mapping[str, int],
    recipe: Recipe,
    lane: Lane,
    limit: int = MAX_MEMORY,
    longest: float | None = None,
) -> list[Section]:
    """Cut a lane into as few sections as the memory (bytes) allows, before anything is decoded.

    ``longest`` is the longest section that is wanted, m; infinity for the lane in one piece or not
    at all. A ValueError tells what would do: if the lane in one piece takes more, or the memory
    does not suffice for sections of ``SHORTEST`` metres (or of the longest that is wanted), or the
    recipe's run-view reaches beyond the lane so that a section would have none of it.
    """
    if longest is not None and not longest > 0:
        raise ValueError(f"section must be a positive length in metres, got {longest}")
    grid = recipe.run_view.grid(lane)
    needed = memory_needed(sizes, recipe, lane)
    wanted = (
        grid.ny
        if longest is None or longest == math.inf
        else max(1, math.floor(longest / grid.dy + 1e-9))
    )
    if wanted >= grid.ny and needed <= limit:
        return [Section(0, grid.ny)]
    if longest == math.inf:
        raise ValueError(
            f"max-memory must be at least {needed / 1e9:.3g} GB for a lane of "
            f"{lane.y_max - lane.y_min:.0f} m in one "
            f"piece, got {limit / 1e9:.3g} GB: give more or take it in sections"
        )
    beyond = 2 * margin(recipe)
    shortest = min(math.ceil(SHORTEST / grid.dy), wanted, grid.ny)
    least = memory_needed(sizes, recipe, lane, min(shortest + beyond, grid.ny))
    if least > limit:
        raise ValueError(
            f"max-memory must be at least {least / 1e9:.3g} GB for this run, got {limit / 1e9:.3g} "
            "GB"
        )
    each = memory_needed(sizes, recipe, lane, 1) - memory_needed(sizes, recipe, lane, 0)
    room = limit - least - _per_thread(sizes, recipe)  # for a second thread, if it may be
    sections = divide(grid.ny, min(wanted, shortest + int(max(room, 0) / each)))
    for section in sections:
        section_lane(recipe, lane, section)
    return sections


def threads_within(
    sizes: Mapping[str, int],
    recipe: Recipe,
    lane: Lane,
    sections: Sequence[Section],
    limit: int = MAX_MEMORY,
) -> int:
    """Return how many threads may work on scans of a lane at once, at least one.

    The lane is taken in sections of :func:`plan_sections`.
    """
    rows = (
        max(section.stop - section.start for section in sections) + 2 * margin(recipe)
        if sections[1:]
        else None
    )
    room = limit - memory_needed(sizes, recipe, lane, rows)
    return 1 + max(0, int(room / _per_thread(sizes, recipe)))
