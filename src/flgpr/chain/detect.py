"""Detection: a run and a recipe in, alarms out. Truth is not among what it takes."""

from __future__ import annotations

from collections.abc import Mapping

import xarray as xr

from flgpr.chain.fitting import area_of
from flgpr.chain.lane_chain import Detection, LaneChain
from flgpr.chain.model import Detector, Model
from flgpr.chain.progress import Track, silent
from flgpr.chain.recipe import Recipe
from flgpr.chain.sections import Section
from flgpr.model import Lane


def detect(
    run: xr.Dataset,
    recipe: Recipe,
    lane: Lane | None = None,
    track: Track = silent,
    model: Model | Detector | None = None,
    section: Section | None = None,
    others: Mapping[str, xr.Dataset] | None = None,
) -> list[Detection]:
    """Run a recipe on a run, in memory: its own result first, then its variants.

    Parameters
    ----------
    run : xarray.Dataset
        A run, which the recipe must fit, see :func:`flgpr.chain.fitting.check_fit`.
    recipe : Recipe
        The recipe.
    lane : Lane, optional
        Lane in place of the recipe's.
    track : Track
        Shows progress.
    model : Model or its detector, optional
        What the recipe's stages have learnt; its detector's score is the confidence, by default the
        local contrast.
    section : Section, optional
        Part of the lane, for recipes without variants; default all of it.
    others : mapping of str to xarray.Dataset, optional
        Runs taken together with this one, such as a second band, by the names that the recipe gives
        them.
    """
    chain = LaneChain(
        run, recipe, area_of(run, recipe, lane), model, section=section, others=others
    )
    chain.go(track)
    return chain.detections()
