"""Whether a recipe fits a run: its channels, its band, and echoes that its image would repeat."""

from __future__ import annotations

import math
import warnings
from collections.abc import Sequence

import xarray as xr

from flgpr.model import Lane, clear_end, tightest_paths
from flgpr.recipe.radar_setup import allow_features, radar_setup
from flgpr.recipe.schema import Recipe, as_imaged, lane_of, recipe_names
from flgpr.types import FloatArray

FITTED_MAP = "likelihood"
"""The map whose entries follow from an array: it simulates its own signatures."""
_OUTSIDE = 0.1  # share of a sub-band that may lie outside the run's band
_HEIGHTS = (0.5, 3.5)  # antenna heights ahead at which an image may begin without a warning


def area_of(run: xr.Dataset, recipe: Recipe, lane: Lane | None = None) -> Lane:
    """Check that a recipe fits a run, and return the lane.

    That is the lane that is given, or the recipe's, or the ground that the scans cover.

    Raises
    ------
    ValueError
        If the recipe does not fit, see :func:`check_fit`, or the lane lies beside its run-view.
    """
    check_fit(run, recipe)
    area = lane if lane is not None else lane_of(run, recipe)
    check_reached(recipe, area)
    return area


def check_reached(recipe: Recipe, lane: Lane) -> None:
    """Refuse a lane that lies beside the run-view of a recipe: no place of it would be searched."""
    left, right = recipe.run_view.x
    if lane.x_max <= left or lane.x_min >= right:
        raise ValueError(
            f"lane must reach into the run-view, x {left:g} to {right:g} m, got x {lane.x_min:g} to "
            f"{lane.x_max:g} m"
        )


def check_fit(run: xr.Dataset, recipe: Recipe) -> None:
    """Refuse a recipe that does not fit a run, and warn of what is doubtful.

    The run must have the polarizations, at most a tenth of a sub-band may lie outside its band, and
    the image must not show an echo twice for the steps of the tones.

    Raises
    ------
    ValueError
        If the recipe does not fit; it names every entry at fault and what to do.

    Warns
    -----
    UserWarning
        If the image begins less than 0.5 or more than 3.5 antenna heights ahead, or echoes from
        before it appear in it again: much of it may still be good.
    """
    faults, doubts = fit_faults(run, recipe)
    _raise(recipe, faults)
    for doubt in doubts:
        warnings.warn(f"{doubt}; {_hint(recipe)}", stacklevel=2)


def _hint(recipe: Recipe) -> str:
    """Return what writes a recipe that fits, with the same method where that can be fitted."""
    like = ""
    if recipe.needs_looks and recipe.name in recipe_names():
        like = f" --like {recipe.name}"
    return f"`flgpr recipe for RUN{like}` writes one that fits"


def fit_faults(run: xr.Dataset, recipe: Recipe) -> tuple[list[str], list[str]]:
    """Return what of a recipe does not fit a run, entry by entry, and what is doubtful.

    See :func:`check_fit`.
    """
    setup = radar_setup(as_imaged(run, recipe))
    image = recipe.image
    faults = _channel_faults(recipe, setup.polarizations, setup.tones)
    doubts = []
    behind = setup.behind(image.summed)
    fault, doubt = alias_faults(recipe, setup.tones, setup.tx, setup.rx, behind)
    if fault:
        faults.append(fault)
    if doubt:
        doubts.append(doubt)
    heights = math.inf
    if setup.height > 0:
        heights = (image.y[0] - setup.ahead) / setup.height
    if not _HEIGHTS[0] <= heights <= _HEIGHTS[1]:
        doubts.append(
            f"image.y should begin {_HEIGHTS[0]} to {_HEIGHTS[1]} antenna heights ahead of the "
            f"antennas, got {image.y[0]:g} m for antennas {setup.height:.3g} m high"
        )
    return faults, doubts


def alias_faults(
    recipe: Recipe, frequency: FloatArray, tx: FloatArray, rx: FloatArray, behind: float = 0.0
) -> tuple[str, str]:
    """Return why a recipe's image shows echoes where they are not, as a fault and as a doubt.

    Parameters
    ----------
    recipe : Recipe
        The recipe.
    frequency : (frequency,) ndarray
        Tones, Hz. Every sub-band counts by the tones that it takes.
    tx, rx : (pair, 3) ndarray
        Antennas in the scan frame, m.
    behind : float
        How far the earliest scan that an image sums lies behind the latest, m.

    Returns
    -------
    fault : str
        Why the image shows an echo twice; "" if it does not.
    doubt : str
        Why echoes from before the image appear in it; "" if they do not.
    """
    image = recipe.image
    ground = image.x, (image.y[0], image.y[1] + behind)
    paths = tightest_paths(frequency, image.subbands, tx, rx, *ground)
    if not (paths.repeats or paths.aliased):
        return "", ""

    received = (
        f"got {image.y[1]:g} m with one of {paths.farthest:.4g} m: for the steps of the tones "
        f"echoes repeat after {paths.unambiguous:.4g} m of path"
    )
    remedy = f"record with steps of at most {paths.widest_step / 1e6:.3g} MHz"
    end = clear_end(paths, tx, rx, *ground) - behind
    if end > image.y[0]:
        remedy = f"end it at {math.floor(100 * end) / 100:g} m, or {remedy}"
    if paths.repeats:
        return (
            "image.y must end where paths are shorter than "
            f"{paths.nearest + paths.unambiguous:.4g} m, {received}, "
            f"so the image shows what is near in it again where it is far; {remedy}"
        ), ""
    return "", (
        f"image.y should end where paths are shorter than {paths.longest_clear:.4g} m, {received}, "
        "so the direct coupling and what lies under the vehicle appear in the image again; "
        f"{remedy}"
    )


def check_channels(recipe: Recipe, polarizations: Sequence[str], tones: FloatArray) -> None:
    """Refuse a recipe that asks for polarizations or tones (Hz) that are not measured.

    Raises
    ------
    ValueError
        As of :func:`check_fit`.
    """
    _raise(recipe, _channel_faults(recipe, polarizations, tones))


def _raise(recipe: Recipe, faults: list[str]) -> None:
    """Raise the ValueError of a recipe's faults, if there are any."""
    if faults:
        listed = "; ".join([*faults, _hint(recipe)])
        raise ValueError(f"recipe {recipe.name} does not fit the run: {listed}")


def asked_polarizations(recipe: Recipe) -> list[tuple[str, str]]:
    """Return the polarizations that a recipe asks for, each behind the entry that does."""
    asked = [("contrast.polarization", recipe.contrast.polarization)]
    if recipe.map is None:
        asked.insert(0, ("prescreen.polarization", recipe.prescreen.polarization))
    for name in recipe.image.polarizations:
        asked.append(("image.polarizations", name))
    for name in getattr(recipe.map_settings, "polarizations", ()):
        asked.append(("map.polarizations", name))
    return asked


def _channel_faults(recipe: Recipe, polarizations: Sequence[str], tones: FloatArray) -> list[str]:
    """Return the entries that ask for polarizations or tones that are not measured."""
    known = ", ".join(polarizations)
    faults = []
    for entry, name in asked_polarizations(recipe):
        if name not in polarizations:
            faults.append(f"{entry} must be one the run has ({known}), got {name!r}")
    if recipe.features is not None and not allow_features(polarizations):
        faults.append(f"its features are of runs with HH, VV, and HV or VH, got a run with {known}")
    for name, (low, high) in recipe.image.subbands.items():
        outside = max(tones[0] - low, 0.0) + max(high - tones[-1], 0.0)
        has_tones = ((tones >= low) & (tones <= high)).any()
        if outside > _OUTSIDE * (high - low) or not has_tones:
            faults.append(
                f"image.subbands.{name} must lie in the run's band, "
                f"{tones[0] / 1e9:.4g} to {tones[-1] / 1e9:.4g} GHz, "
                f"got {low / 1e9:.4g} to {high / 1e9:.4g} GHz"
            )
    return faults
