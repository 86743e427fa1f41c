"""Whether a trained recipe finds as many mines as the contrast, on twins of an array's lanes.

A recipe that is fitted to an array may suit it badly, which no training shows. On simulated lanes
of the same array the truth is known, so no mine of the user's is needed.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import pandas as pd
import xarray as xr

from flgpr.jobs.twins import Twin, plan_twins, simulate_twin, twins_for
from flgpr.method.method import detect
from flgpr.method.model import Model
from flgpr.method.model_check import CHECK_FILE, Check, write_check
from flgpr.progress import Track, silent
from flgpr.recipe.make import fit_recipe
from flgpr.recipe.schema import Recipe, parse_recipe
from flgpr.scoring import Match, match, side_by_side
from flgpr.stages.body_signatures import OWN_ARRAY
from flgpr.toml_text import parse_toml, toml_lines

RECIPE, CONTRAST = "recipe", "contrast"
"""Names of what is compared."""
_MINES = 24  # of a check
_FAR = 0.1  # false alarms per m²
_HALO = 0.5  # m: mines are 2 m apart and more
_SEED = 2026


def check_on_twins(
    run: xr.Dataset,
    recipe: Recipe,
    model: Model,
    mines: int = _MINES,
    seed: int = _SEED,
    track: Track = silent,
) -> Check:
    """Count the mines that a trained recipe and the contrast find on twins of an array's lanes.

    The contrast is that of the recipe which ``flgpr recipe for`` makes without another recipe.

    Parameters
    ----------
    run : xarray.Dataset
        A run of the array.
    recipe : Recipe
        The recipe, with a map of simulated signatures.
    model : Model
        What it has learnt.
    mines : int
        Mines in the lanes together, at least.
    seed : int
        Of the lanes.
    track : Track
        Shows progress.

    Raises
    ------
    ValueError
        If the array has no twins, see :func:`flgpr.jobs.twins.plan_twins`.
    """
    plan = plan_twins(run, recipe)
    numbers = range(twins_for(plan, mines))
    found: dict[str, list[pd.DataFrame]] = {RECIPE: [], CONTRAST: []}
    lanes = []
    for number in track(numbers, "checking on simulated lanes", len(numbers)):
        twin = simulate_twin(plan, number, seed)
        lanes.append(twin)
        for name, alarms in alarms_of(twin, recipe, model).items():
            found[name].append(alarms)
    return compare({name: matched(tables, lanes) for name, tables in found.items()}, len(lanes))


def alarms_of(twin: Twin, recipe: Recipe, model: Model) -> dict[str, pd.DataFrame]:
    """Return the alarms of a recipe and those of the contrast on a twin."""
    plain = contrast_recipe(twin.run)
    return {
        RECIPE: detect(twin.run, recipe, twin.lane, model=model).alarms,
        CONTRAST: detect(twin.run, plain, twin.lane).alarms,
    }


def contrast_recipe(run: xr.Dataset) -> Recipe:
    """Return the recipe of a run that ranks alarms by their contrast alone."""
    tables = parse_toml(fit_recipe(run))
    tables.pop("features", None)
    return parse_recipe("\n".join(toml_lines(tables, {})))


def matched(tables: Sequence[pd.DataFrame], twins: Sequence[Twin], halo: float = _HALO) -> Match:
    """Match the alarms of twins to their mines."""
    alarms = []
    for table, twin in zip(tables, twins, strict=True):
        alarms.append(table[["x", "y", "confidence"]].assign(lane=twin.name))
    truth = pd.concat([twin.truth for twin in twins], ignore_index=True)
    lanes = {twin.name: twin.lane for twin in twins}
    return match(pd.concat(alarms, ignore_index=True), truth, lanes, halo)


def compare(matches: Mapping[str, Match], lanes: int, far: float = _FAR) -> Check:
    """Compare matched alarms of the recipe and of the contrast at a false alarm rate."""
    compared = side_by_side(matches, [far], means=False)
    found = dict(zip(compared.points["detector"], compared.points["n_detected"], strict=True))
    pair = compared.pairs.iloc[0]
    return Check(
        lanes=lanes,
        mines=int(compared.points["n_targets"].iloc[0]),
        far=far,
        found=int(found[RECIPE]),
        by_contrast=int(found[CONTRAST]),
        only_recipe=int(pair["only_first"]),
        only_contrast=int(pair["only_second"]),
        p=float(pair["p"]),
    )


def check_model(folder: Path, run: xr.Dataset, recipe: Recipe, model: Model, track: Track) -> None:
    """Check a trained model on twins, unless it is checked, and write the result beside it.

    A recipe whose signatures are not those of the run's own array is not checked. Where there are
    no twins of the array, the reason is written.

    Parameters
    ----------
    folder : Path
        Folder of the model.
    run : xarray.Dataset
        A run that it was trained on.
    recipe : Recipe
        Its recipe.
    model : Model
        What it has learnt.
    track : Track
        Shows progress.
    """
    if not is_fitted(recipe) or (folder / CHECK_FILE).is_file():
        return
    try:
        found: Check | str = check_on_twins(run, recipe, model, track=track)
    except ValueError as error:
        found = str(error)
    write_check(folder, found)


def is_fitted(recipe: Recipe) -> bool:
    """Return whether a recipe simulates the signatures of the run's own array."""
    settings = None if recipe.map is None else recipe.map.settings
    return getattr(settings, "sensor", "") == OWN_ARRAY
