"""Which recipes fit a run, ranked by what they found on lanes with truth, and what the run lacks."""

from __future__ import annotations

import tomllib
from dataclasses import asdict, dataclass
from functools import cache
from importlib import resources
from typing import Any

import numpy as np
import xarray as xr

from flgpr.model.run import polarizations_of
from flgpr.recipe.fit import asked_polarizations, fit_faults
from flgpr.recipe.like import likeable_names
from flgpr.recipe.make import fit_recipe
from flgpr.recipe.radar_setup import allow_features
from flgpr.recipe.schema import Recipe, load_recipe, parse_recipe, recipe_names

MADE = "made"
"""Name of the recipe that is made for the run."""
FITS, FITTED, DOUBTFUL, LACKS = "fits", "fitted fits", "doubtful", "does not fit"
_MINIATURE = ("demo", "miniature")  # recipes of the packaged lane: they are named where they fit
_BEST_FIRST = (FITS, FITTED, DOUBTFUL, LACKS)


@dataclass(frozen=True)
class Suggestion:
    """A recipe, whether it fits a run, and what it found elsewhere."""

    recipe: str
    verdict: str  #: "fits", "fitted fits" (by --like), "doubtful" or "does not fit"
    learns: tuple[str, ...]  #: stages that must be trained
    found: dict[str, int]  #: mines found, by track
    why: tuple[str, ...] = ()  #: what the run lacks, or what is doubtful
    command: str = ""  #: what detects with it; "RUN" stands for the run

    @property
    def figures(self) -> str:
        """What it found, in words."""
        tracks = evidence()["tracks"]
        p_values = evidence()["p"].get(self.recipe, {})
        told = []
        for track, count in self.found.items():
            p = f" (p = {p_values[track]:.2g})" if track in p_values else ""
            told.append(f"{count} of {tracks[track]['of']} {track}{p}")
        return ", ".join(told)


@dataclass(frozen=True)
class Suggestions:
    """All recipes, those to try first at first."""

    ranked: tuple[Suggestion, ...]

    @property
    def answer(self) -> str:
        """The answer in one sentence."""
        usable = [one for one in self.ranked if one.verdict in (FITS, FITTED)]
        first = next((one for one in usable if not one.learns), None)
        if first is None:
            return "No recipe fits this run: see what it lacks."
        answer = f"Begin with `{first.command}`, which needs no training"
        learnt = next((one for one in usable if one.learns and one.found), None)
        if learnt is None:
            return f"{answer}: {first.figures}."
        how = "trained" if learnt.verdict == FITS else "fitted by --like and trained"
        return f"{answer}: {first.figures}; {how}, {learnt.recipe} found {learnt.figures}."

    def as_json(self) -> dict[str, Any]:
        """Return it as JSON values."""
        return {"answer": self.answer, "recipes": [asdict(one) for one in self.ranked]}


@cache
def evidence() -> dict[str, Any]:
    """Return what recipes found on lanes with truth: ``tracks``, ``found`` and ``p`` by recipe."""
    text = (resources.files("flgpr.recipe") / "figures.toml").read_text(encoding="utf-8")
    return tomllib.loads(text)


def suggest(run: xr.Dataset) -> Suggestions:
    """Rank the packaged recipes, and the one that is made for a run.

    Those that fit come first, then those that can be fitted to the array; among them those that
    found more on prepared lanes, and where that is not known the others.

    Parameters
    ----------
    run : xarray.Dataset
        A run.
    """
    ranked = [_made(run)]
    likeable = likeable_names()
    for name in recipe_names():
        one = _packaged(run, name, name in likeable)
        if one.verdict == FITS or not name.startswith(_MINIATURE):
            ranked.append(one)
    ranked.sort(
        key=lambda one: (_BEST_FIRST.index(one.verdict), -one.found.get("prepared", 0), one.recipe)
    )
    return Suggestions(tuple(ranked))


def _made(run: xr.Dataset) -> Suggestion:
    """Return the recipe that is made for a run."""
    found = evidence()["found"][MADE]
    command = "flgpr detect RUN -o result"
    try:
        learns = parse_recipe(fit_recipe(run), MADE).learning()
    except ValueError as error:
        return Suggestion(MADE, LACKS, (), found, (str(error),))
    return Suggestion(MADE, FITS, tuple(learns), found, (), command)


def _packaged(run: xr.Dataset, name: str, can_be_fitted: bool) -> Suggestion:
    """Return a packaged recipe, or the same fitted to the array where only that fits."""
    recipe = load_recipe(name)
    learns = tuple(recipe.learning())
    found = evidence()["found"].get(name, {})
    faults, doubts = fit_faults(run, recipe)
    if not faults and not doubts:
        command = f"flgpr detect RUN --recipe {name} -o result"
        return Suggestion(name, FITS, learns, found, (), command)
    why = tuple(_lacking(run, recipe) or faults + doubts)
    if can_be_fitted:
        try:
            fit_recipe(run, like=name)
        except ValueError as error:
            return Suggestion(name, LACKS, learns, found, (*why, str(error)))
        return Suggestion(
            name, FITTED, learns, found, why, f"flgpr recipe for RUN --like {name} -o own.toml"
        )
    return Suggestion(name, LACKS if faults else DOUBTFUL, learns, found, why)


def _lacking(run: xr.Dataset, recipe: Recipe) -> list[str]:
    """Return which polarizations and which band a run lacks for a recipe, in a few words."""
    has = polarizations_of(run)
    needed = dict.fromkeys(name for _, name in asked_polarizations(recipe))
    lacking = []
    if recipe.features is not None and not allow_features(has):
        needed = dict.fromkeys(("HH", "HV", "VV"))
    if not set(needed) <= set(has):
        lacking.append(f"needs {', '.join(needed)}; this run has {', '.join(has)}")
    bands = np.array(list(recipe.image.subbands.values())) / 1e9
    low, high = run["frequency"].values[[0, -1]] / 1e9
    if bands.size and (bands.min() < low or bands.max() > high):
        band = f"{bands.min():.4g} to {bands.max():.4g} GHz"
        lacking.append(f"needs {band}; this run has {low:.4g} to {high:.4g} GHz")
    return lacking
