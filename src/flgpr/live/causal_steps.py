"""The recipe's steps as live detection takes them: known before a scan came, and causal."""

from __future__ import annotations

import math
from collections.abc import Mapping
from itertools import product

import numpy as np
import xarray as xr

from flgpr.features import FEATURES, POLARIMETRIC
from flgpr.method.imaged_run import setup_of
from flgpr.method.model import Model
from flgpr.method.steps import Steps, check_confidence
from flgpr.model import Lane
from flgpr.recipe.schema import RANKS, Recipe, course_lane
from flgpr.stages import FeatureStage, Stage
from flgpr.stages.earlier import EarlierRuns
from flgpr.stages.named import make_stages
from flgpr.store import RunDescription, Scan, as_run

WITHOUT_END = 1e9  # m, length of a lane whose end nobody has given


def check_causal(recipe: Recipe) -> None:
    """Refuse a recipe that needs more than the scans so far.

    Raises
    ------
    ValueError
        With every reason why the recipe cannot run live.
    """
    reasons = recipe.not_live_because()
    if reasons:
        raise ValueError(
            f"recipe {recipe.name!r} cannot run live: {'; '.join(reasons)}; give another recipe, or "
            "detect the run once the drive is stored"
        )


def causal_steps(
    description: RunDescription, recipe: Recipe, model: Model, stages: Mapping[str, Stage]
) -> Steps:
    """Return the recipe's steps with those features alone that decide on alarms.

    They are what the model's detector reads; without one, the contrast.

    Parameters
    ----------
    description : RunDescription
        The run to come.
    recipe : Recipe
        The recipe.
    model : Model
        What the recipe has learnt.
    stages : mapping of str to Stage
        The recipe's stages (:func:`build_stages`).

    Returns
    -------
    Steps
        The steps of a scan.

    Raises
    ------
    ValueError
        If the model's detector reads a feature that is not known when a scan comes.
    """
    names = _deciding_columns(recipe, model)
    features = None
    if recipe.features and names:
        features = recipe.features.model_copy(update={"variants": False})
    feature_stages = {}
    for name, stage in stages.items():
        if isinstance(stage, FeatureStage) and set(stage.columns) & set(names):
            feature_stages[name] = stage

    needed = {recipe.prescreen.subband}
    known = {"magnitude"}
    for stage in feature_stages.values():
        known |= set(stage.columns)
    if features is None:
        needed.add(recipe.contrast.subband)
        known.add("contrast")
    band_of_column = {}
    if features is not None:
        for feature, band in product(FEATURES, recipe.image.subbands):
            band_of_column[f"{feature}_{band}"] = band
    for name in names:
        if name not in known and name not in band_of_column:
            raise ValueError(
                f"model must read features of the recipe's sub-bands when live, got {name}"
            )
        if name in band_of_column:
            needed.add(band_of_column[name])

    # Stages are handed images of all sub-bands.
    needs_all = bool(feature_stages) or recipe.map is not None
    subbands = [band for band in recipe.image.subbands if needs_all or band in needed]
    labels = list(recipe.image.polarizations) or description.polarization
    polarimetric = []
    for band in subbands:
        if any(f"{feature}_{band}" in names for feature in POLARIMETRIC):
            polarimetric.append(band)
    reduced = recipe.model_copy(update={"features": features})
    return Steps(
        reduced,
        labels,
        subbands,
        recipe.near_grid(),
        feature_stages,
        tuple(polarimetric),
        model.detector,
    )


def _deciding_columns(recipe: Recipe, model: Model) -> tuple[str, ...]:
    """Return the columns that decide on alarms; none where the magnitude alone ranks them."""
    if model.detector is not None:
        return tuple(model.detector.features)
    if recipe.confidence in RANKS:
        return ()
    return (recipe.confidence,)


def build_stages(
    description: RunDescription,
    recipe: Recipe,
    lane: Lane | None,
    model: Model,
    others: Mapping[str, xr.Dataset] | None = None,
) -> dict[str, Stage]:
    """Build the recipe's stages before any scan came.

    The run in their setup has one scan without an echo, at the lane's origin.

    Parameters
    ----------
    description : RunDescription
        The run to come.
    recipe : Recipe
        The recipe.
    lane : Lane or None
        The lane; None for one along the first course, without an end.
    model : Model
        What the recipe has learnt.
    others : mapping of str to xarray.Dataset, optional
        Runs taken together with it, by the names that the recipe gives them.

    Returns
    -------
    dict of str to Stage
        The stages by name, the clutter stage "earlier" among them.

    Raises
    ------
    ValueError
        If the recipe ranks alarms by a column that no stage computes.
    """
    silence = np.zeros(description.shape, np.complex64)
    run = as_run(description, Scan(0, math.nan, np.zeros(6), silence))
    ground = lane or course_lane(recipe, np.zeros((1, 6)), WITHOUT_END)
    setup, _ = setup_of(run, recipe, ground, {}, others)
    stages = make_stages(recipe.named(), setup, model.stages)
    for entry in recipe.clutter:  # check_causal lets no other pass
        stages["clutter.earlier"] = EarlierRuns(entry.settings, setup)
    columns: list[str] = []
    for stage in stages.values():
        if isinstance(stage, FeatureStage):
            columns.extend(stage.columns)
    check_confidence(recipe, columns)
    return stages
