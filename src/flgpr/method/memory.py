"""How much memory a detection takes, estimated before it begins."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass

import xarray as xr

from flgpr.model import Grid, Lane
from flgpr.recipe.schema import Recipe
from flgpr.stages import FeatureStage
from flgpr.store.store_layout import MAX_MEMORY

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
# What a stage with many columns says of an alarm: the values, their table, its copies and its text,
# bytes per column and alarm. Measured: 68 with 450 to 2,700 columns of 2,000 alarms.
_PER_VALUE = 72.0


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


def thread_memory(sizes: Mapping[str, int], recipe: Recipe) -> float:
    """Estimate the bytes of a scan at work and of the sums of its block.

    Parameters
    ----------
    sizes : mapping of str to int
        Lengths of the run's dimensions; those of scans do not count.
    recipe : Recipe
        The recipe.
    """
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
    needed = _PROGRAM + thread_memory(sizes, recipe)
    if needed > limit:
        raise ValueError(
            f"scans of {shape} samples must take at most {limit / 1e9:.3g} GB, got "
            f"{needed / 1e9:.3g} GB"
        )


@dataclass(frozen=True)
class LaneMemory:
    """Estimate from above of the bytes of a process that works on a lane.

    They do not grow with the number of scans, but for a self-signature by the median, which holds
    all images. What grows with the length of the lane are its run-views and alarms. The factors
    were measured, see docs/evidence/guarantees.md.
    """

    thread: float  #: a scan at work and the sums of its block, once for every thread
    view: Grid  #: pixels of the run-view of the lane
    fixed: float  #: what does not depend on rows: program, a thread, images of a median, stages
    per_pixel: float  #: run-views and their alarms, for each of their pixels

    def needed(self, rows: int | None = None) -> float:
        """Return the bytes for so many rows of the run-view at a time; by default for all."""
        pixels = self.view.nx * (self.view.ny if rows is None else rows)
        return self.fixed + self.per_pixel * pixels


def lane_memory(sizes: Mapping[str, int], recipe: Recipe, lane: Lane) -> LaneMemory:
    """Estimate what a process that works on a lane takes.

    Parameters
    ----------
    sizes : mapping of str to int
        Lengths of the run's dimensions.
    recipe : Recipe
        The recipe.
    lane : Lane
        The lane.

    Returns
    -------
    LaneMemory
        The estimate, by which bytes follow for any number of rows.
    """
    thread = thread_memory(sizes, recipe)
    image = recipe.image.grid()
    view = recipe.run_view.grid(lane)
    bands = len(recipe.image.subbands)
    polarizations = len(recipe.image.polarizations) or sizes["polarization"]
    channels = polarizations * bands

    background = 0.0
    if recipe.background.self_signature == "median":
        images = _PER_COMPLEX * sizes["scan"] * channels * image.nx * image.ny
        background = _MEDIAN * images

    # Beside the recipe's look there is one of the images before their background is removed, and one
    # of an earlier drive.
    beside = channels * (2 if "clutter.earlier" in recipe.named() else 1)
    view_channels = 1
    if recipe.map is None:
        view_channels = len(recipe.run_view.channels(list(recipe.image.subbands))) * polarizations
    columns = column_count(polarizations, recipe, view)
    stages = 0.0
    for stage in recipe.named().values():
        stages += stage.stage_class.memory(stage.settings, sizes, image)
    screen = recipe.prescreen
    alarms_per_pixel = screen.density * view.dx * view.dy / (3.14 * screen.radius**2)
    per_alarm = _PER_ALARM * bands + _PER_VALUE * columns
    per_pixel = _PER_VIEW_PIXEL * (beside + view_channels) / 2
    fixed = _PROGRAM + thread + background + stages
    return LaneMemory(thread, view, fixed, per_pixel + per_alarm * alarms_per_pixel)


def column_count(polarizations: int, recipe: Recipe, view: Grid) -> int:
    """Return how many columns the stages of a recipe have that have many.

    Parameters
    ----------
    polarizations : int
        Polarizations of the images.
    recipe : Recipe
        The recipe.
    view : Grid
        Pixels of the run-view.
    """
    count = 0
    for stage in recipe.named().values():
        if issubclass(stage.stage_class, FeatureStage):
            count += stage.stage_class.column_count(stage.settings, polarizations, view)
    return count
