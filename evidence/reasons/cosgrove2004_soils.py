"""Why two polarizations and the band of Cosgrove et al. 2004 are not the best: lanes of wet clay and of gravel.

The lanes are the study's, with all their mines. Those of one seed differ in nothing but what is
changed. What each explanation predicts was written before the lanes ran.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from flgpr.progress import Track
from flgpr.types import Entries, FloatArray
from flgpr_papers.cosgrove2004.detect import (
    Peaks,
    deflection_peaks,
    one_polarization,
    other_bands,
)
from flgpr_papers.cosgrove2004.findings import found_looks
from flgpr_papers.cosgrove2004.images import lane_looks
from flgpr_papers.cosgrove2004.recipe import StudyRecipe
from flgpr_papers.kit.cache import key_of
from reasons.trials import Trial, declared_trials, measured

SEEDS = 24
"""Lanes with each change, by seeds from 1 on.

Six were declared first and left five of six explanations open; 24, the study's, were declared then.
"""
DEPTHS = {"shallow": 0.05, "deep": 0.15}
"""Depths of mines that are told apart, m."""
Record = dict[str, float]
Parts = Mapping[str, Entries]
"""Entries of the scene's tables that are replaced."""


def band_record(recipe: StudyRecipe, parts: Parts, seed: int) -> Record:
    """Return Pd on a seed's lane of open wet clay in two bands, of all mines and of two depths."""
    of_bands = other_bands(recipe, "clay", seed, recipe.study.share, parts)
    record = {}
    for name, band in {"paper": "0.3 to 1.9 GHz", "low": "0.3 to 1.1 GHz"}.items():
        found = _found(recipe, of_bands[band])
        record[name] = float(found.mean())
        for depth_name, depth in DEPTHS.items():
            at_depth = np.isclose(of_bands[band].depth, depth)
            record[f"{name} {depth_name}"] = float(found[at_depth].mean())
    return record


def polarization_record(
    site: str, surroundings: str, recipe: StudyRecipe, parts: Parts, seed: int
) -> Record:
    """Return Pd on a seed's lane by both polarizations ("both") and by each alone."""
    share = recipe.study.share
    looks = lane_looks(recipe, site, seed, share, parts=parts)[surroundings]
    peaks = one_polarization(recipe, looks) | deflection_peaks(recipe, looks, "both")
    return {name: float(_found(recipe, of_name).mean()) for name, of_name in peaks.items()}


def _found(recipe: StudyRecipe, peaks: Peaks) -> FloatArray:
    """Return which looks of a lane are found at the study's P_FA, as 1 or 0."""
    return found_looks(recipe, [{"peaks": {"one": asdict(peaks)}}], "one")[0]


Measure = Callable[[StudyRecipe, Parts, int], Record]
BESIDE_GRAVEL: Measure = partial(polarization_record, "gravel", "roadside")
CHANGES: dict[str, tuple[Measure, Parts]] = {
    "clay": (band_record, {}),
    "half the loss of clay": (band_record, {"soil": {"loss_tangent": 0.12}}),
    "open clay": (partial(polarization_record, "clay", "open"), {}),
    "gravel beside a roadside": (BESIDE_GRAVEL, {}),
    "bushes taken out": (BESIDE_GRAVEL, {"clutter": {"bushes": 0.0}}),
    "posts taken out": (BESIDE_GRAVEL, {"clutter": {"posts": 0.0}}),
}
"""What is measured, and what is changed on the lanes for it."""


def soil_trials(recipe: StudyRecipe, folder: Path, track: Track) -> list[Trial]:
    """Run the experiments, or read those that are on disk in ``folder/reasons``.

    Parameters
    ----------
    recipe : StudyRecipe
        The study.
    folder : Path
        Folder of the study.
    track : callable
        Shows progress.
    """
    seeds = range(1, 1 + min(SEEDS, recipe.study.seeds))

    def of_lane(name: str, seed: int) -> tuple[str, Callable[[], Any]]:
        measure, parts = CHANGES[name]
        key = key_of(recipe.model_dump(mode="json"), name, parts)
        return f"{name.replace(' ', '-')}-{seed}-{key}", partial(measure, recipe, parts, seed)

    records = measured(folder, CHANGES, seeds, of_lane, track, "lanes of other soils")
    return declared_trials("cosgrove2004", "soil", records)
