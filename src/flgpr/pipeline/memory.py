"""How much memory a detection takes, told before it begins."""

from __future__ import annotations

import re
from collections.abc import Mapping

from flgpr.io.declared import MAX_MEMORY
from flgpr.model import Lane
from flgpr.pipeline.recipe import Recipe

_UNITS = {"": 1, "B": 1, "KB": 10**3, "MB": 10**6, "GB": 10**9, "TB": 10**12}
_UNITS |= {"KIB": 2**10, "MIB": 2**20, "GIB": 2**30, "TIB": 2**40}
_PROGRAM = 350e6  # interpreter, libraries, compiled kernels
_PER_PIXEL = 170.0  # image, its copies, totals and backgrounds, bytes per pixel and channel
_PER_SAMPLE = 60.0  # a scan's data, range-compressed profiles and copies, bytes per sample and sub-band
_PER_VIEW_PIXEL = 30.0  # run-views, their sums and copies, bytes per pixel and channel
_PER_ALARM = 4000.0  # features and their sums, bytes per alarm and sub-band


def parse_size(text: str) -> int:
    """Read a size in bytes.

    Parameters
    ----------
    text : str
        A number with a unit: "2GB" is 2·10⁹ bytes, "2GiB" is 2·2³⁰.

    Returns
    -------
    int
        Bytes.

    Raises
    ------
    ValueError
        If it is no size.
    """
    found = re.fullmatch(r"\s*(\d+(?:\.\d+)?)\s*([a-zA-Z]*)\s*", text)
    if not found or found[2].upper() not in _UNITS or float(found[1]) <= 0:
        raise ValueError(f"max-memory must be a size such as 2GB or 500MB, got {text!r}")
    return int(float(found[1]) * _UNITS[found[2].upper()])


def memory_needed(sizes: Mapping[str, int], recipe: Recipe, lane: Lane) -> float:
    """Estimate from above the memory of a process that works on a lane with a recipe with features.

    It does not grow with the number of scans; what grows with the length of the lane are its run-views and alarms.

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
    float
        Bytes. The factors were measured, see docs/robustness.md.
    """
    bands, image, view = len(recipe.image.subbands), recipe.image.grid(), recipe.run_view.grid(lane)
    channels = sizes["polarization"] * bands
    samples = sizes["polarization"] * sizes["pair"] * sizes["frequency"] * bands
    alarms = recipe.prescreen.density * (view.nx * view.dx * view.ny * view.dy) / (3.14 * recipe.prescreen.radius**2)
    return (
        _PROGRAM
        + _PER_PIXEL * channels * image.nx * image.ny
        + _PER_SAMPLE * samples
        + _PER_VIEW_PIXEL * channels * view.nx * view.ny
        + _PER_ALARM * bands * alarms
    )


def check_memory(sizes: Mapping[str, int], recipe: Recipe, lane: Lane, limit: int = MAX_MEMORY) -> None:
    """Refuse a detection that would take more memory than there is, before anything is decoded.

    Parameters
    ----------
    sizes, recipe, lane
        As for :func:`memory_needed`.
    limit : int
        Memory of a process, bytes.

    Raises
    ------
    ValueError
        If it takes more; the message tells how long the lane may be.
    """
    needed = memory_needed(sizes, recipe, lane)
    if needed <= limit:
        return
    length = lane.y_max - lane.y_min
    short = Lane(lane.x_min, lane.x_max, lane.y_min, lane.y_min + min(1.0, length))
    least = memory_needed(sizes, recipe, short)
    if least > limit:
        raise ValueError(f"max-memory must be at least {least / 1e9:.3g} GB for this run, got {limit / 1e9:.3g} GB")
    longest = length * (limit - least) / max(needed - least, 1.0)
    raise ValueError(
        f"max-memory must be at least {needed / 1e9:.3g} GB for a lane of {length:.0f} m, got {limit / 1e9:.3g} GB, "
        f"which is enough for {longest:.0f} m: give more memory or take the lane in parts (--lane)"
    )
