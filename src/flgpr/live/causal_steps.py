"""The recipe's steps as live detection takes them: known before a scan came, and causal."""

from __future__ import annotations

import math
from itertools import product

import numpy as np
import xarray as xr

from flgpr.features import FEATURES, POLARIMETRIC
from flgpr.method.imaged_run import ImagedRun
from flgpr.method.model import Model
from flgpr.method.steps import Steps
from flgpr.recipe.schema import RANKS, Recipe
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


def run_to_come(description: RunDescription) -> xr.Dataset:
    """Return what stands for a run before any scan came: one without an echo, at the lane's origin."""
    silence = np.zeros(description.shape, np.complex64)
    return as_run(description, Scan(0, math.nan, np.zeros(6), silence))


def causal_steps(chain: ImagedRun) -> Steps:
    """Return the steps of a recipe with those features alone that decide on alarms.

    They are what the model's detector reads; without one, the contrast.

    Parameters
    ----------
    chain : ImagedRun
        The recipe on :func:`run_to_come`.

    Returns
    -------
    Steps
        The steps of a scan.

    Raises
    ------
    ValueError
        If the model's detector reads a feature that is not known when a scan comes.
    """
    recipe = chain.recipe
    names = _deciding_columns(recipe, chain.model)
    features = None
    if recipe.features and names:
        features = recipe.features.model_copy(update={"variants": False})
    feature_stages = {}
    for name, stage in chain.steps.stages.items():
        if set(stage.columns) & set(names):
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
    polarimetric = []
    for band in subbands:
        if any(f"{feature}_{band}" in names for feature in POLARIMETRIC):
            polarimetric.append(band)
    reduced = recipe.model_copy(update={"features": features})
    return Steps(
        reduced,
        chain.polarizations,
        subbands,
        chain.near,
        feature_stages,
        tuple(polarimetric),
        chain.model.detector,
    )


def _deciding_columns(recipe: Recipe, model: Model) -> tuple[str, ...]:
    """Return the columns that decide on alarms; none where the magnitude alone ranks them."""
    if model.detector is not None:
        return tuple(model.detector.features)
    if recipe.confidence in RANKS:
        return ()
    return (recipe.confidence,)
