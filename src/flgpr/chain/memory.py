"""How much memory a detection takes, estimated before it begins."""

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
    """Return a size in bytes: "2GB" is 2·10⁹, "2GiB" is 2·2³⁰.

    Raises
    ------
    ValueError
        If the text is no size.
    """
    size = re.fullmatch(r"\s*(\d+(?:\.\d+)?)\s*([a-zA-Z]*)\s*", text)
    if not size or size[2].upper() not in _UNITS or float(size[1]) <= 0:
        raise ValueError(f"max-memory must be a size such as 2GB or 500MB, got {text!r}")
    return int(float(size[1]) * _UNITS[size[2].upper()])


def sizes_of(run: xr.Dataset) -> dict[str, int]:
    """Return the lengths of a run's dimensions by name."""
    return {str(name): length for name, length in run.sizes.items()}


def _per_thread(sizes: Mapping[str, int], recipe: Recipe) -> float:
    """Estimate the bytes of a scan at work and of the sums of its block."""
    image = recipe.image.grid()
    bands = len(recipe.image.subbands)
    pixels = image.nx * image.ny
    samples = sizes["pair"] * sizes["frequency"]
    return sizes["polarization"] * bands * (_PER_PIXEL * pixels + _PER_SAMPLE * samples)


def check_scan_memory(shape: tuple[int, int, int], recipe: Recipe, limit: int = MAX_MEMORY) -> None:
    """Refuse scans (polarization, pair, frequency) one of which would take too much memory.

    Parameters
    ----------
    shape : tuple of int
        Lengths of a scan's data.
    recipe : Recipe
        The recipe.
    limit : int
        Bytes that the process may take.

    Raises
    ------
    ValueError
        If one scan takes more.
    """
    sizes = dict(zip(("polarization", "pair", "frequency"), shape, strict=True))
    needed = _PROGRAM + _per_thread(sizes, recipe)
    if needed > limit:
        raise ValueError(
            f"scans of {shape} samples must take at most {limit / 1e9:.3g} GB, got "
            f"{needed / 1e9:.3g} GB"
        )


def memory_needed(
    sizes: Mapping[str, int], recipe: Recipe, lane: Lane, rows: int | None = None
) -> float:
    """Estimate from above the bytes of a process that works on a lane.

    They do not grow with the number of scans, but for a self-signature by the median, which holds
    all images. What grows with the length of the lane are its run-views and alarms. The factors
    were measured, see docs/evidence/robustness.md.

    Parameters
    ----------
    sizes : mapping of str to int
        Lengths of the run's dimensions.
    recipe : Recipe
        The recipe.
    lane : Lane
        The lane.
    rows : int, optional
        Rows of the run-view that are worked on at a time; by default all.

    Returns
    -------
    float
        Bytes.
    """
    image = recipe.image.grid()
    stages = 0.0
    for stage in recipe.named().values():
        stages += stage.stage_class.memory(stage.settings, sizes, image)
    background = _background_bytes(sizes, recipe)
    run_views = _run_view_bytes(sizes, recipe, lane, rows)
    return _PROGRAM + _per_thread(sizes, recipe) + background + run_views + stages


def _imaged_channels(sizes: Mapping[str, int], recipe: Recipe) -> int:
    """Return the number of channels of an image."""
    polarizations = len(recipe.image.polarizations) or sizes["polarization"]
    return polarizations * len(recipe.image.subbands)


def _background_bytes(sizes: Mapping[str, int], recipe: Recipe) -> float:
    """Estimate the bytes of the images that a self-signature by the median holds."""
    if recipe.background.self_signature != "median":
        return 0
    image = recipe.image.grid()
    channels = _imaged_channels(sizes, recipe)
    images = _PER_COMPLEX * sizes["scan"] * channels * image.nx * image.ny
    return _MEDIAN * images


def _run_view_bytes(
    sizes: Mapping[str, int], recipe: Recipe, lane: Lane, rows: int | None
) -> float:
    """Estimate the bytes of run-views, on some of their rows, and of the features of alarms."""
    view = recipe.run_view.grid(lane)
    bands = len(recipe.image.subbands)
    channels = _imaged_channels(sizes, recipe)
    pixels = view.nx * (view.ny if rows is None else rows)
    screen = recipe.prescreen
    alarms = screen.density * pixels * view.dx * view.dy / (3.14 * screen.radius**2)

    # Beside the recipe's look there is one of the images before their background is removed.
    view_channels = 1
    if recipe.map is None:
        names = len(recipe.run_view.channels(list(recipe.image.subbands)))
        view_channels = names * channels // bands
    views = _PER_VIEW_PIXEL * (channels + view_channels) / 2 * pixels
    return views + _PER_ALARM * bands * alarms


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
    grid = recipe.run_view.grid(lane)
    needed = memory_needed(sizes, recipe, lane)
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

    beyond = 2 * margin(recipe)
    shortest = min(math.ceil(SHORTEST / grid.dy), wanted_rows, grid.ny)
    least = memory_needed(sizes, recipe, lane, min(shortest + beyond, grid.ny))
    if least > limit:
        raise ValueError(
            f"max-memory must be at least {least / 1e9:.3g} GB for this run, "
            f"got {limit / 1e9:.3g} GB"
        )

    # What is left beside the shortest section and a second thread makes sections longer.
    per_row = memory_needed(sizes, recipe, lane, 1) - memory_needed(sizes, recipe, lane, 0)
    room = limit - least - _per_thread(sizes, recipe)
    longer = int(max(room, 0) / per_row)
    sections = divide(grid.ny, min(wanted_rows, shortest + longer))
    for section in sections:
        section_lane(recipe, lane, section)  # refuses a section without any of the lane
    return sections


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
    room = limit - memory_needed(sizes, recipe, lane, rows)
    return 1 + max(0, int(room / _per_thread(sizes, recipe)))
