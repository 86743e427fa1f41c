"""Sweeps beside the study: numbers of examples and ranks, one polarization, and other bands.

What is tried is a detector by name, as those of the study are, and is scored on the same mines.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product

import numpy as np

from flgpr.detect import ChipDetector, DeflectionDetector, NeymanPearsonDetector
from flgpr_papers.cosgrove2004.detect import (
    Peaks,
    Training,
    chip_detector,
    learn,
    score_looks,
    target_cut,
)
from flgpr_papers.cosgrove2004.images import Look, lane_looks, lane_seed
from flgpr_papers.cosgrove2004.recipe import StudyRecipe

FORMS = ("deflection", "Neyman-Pearson")
"""Detectors that are trained on the same examples."""
_OTHER_LANE = 500  # seeds from here on are of the lanes from which examples come


def example_name(form: str, rank: int, number: int) -> str:
    """Return the name of a detector that is trained on a number of examples."""
    return f"{form} of rank {rank}, {number} examples"


def alone(polarization: str) -> str:
    """Return the name of the deflection detector of one polarization."""
    return f"{polarization} cuts alone"


def example_looks(
    recipe: StudyRecipe, site: str, seed: int, share: float = 1.0
) -> dict[str, list[Look]]:
    """Image further training mines of a site, on a lane of their own; as :func:`lane_looks`."""
    of_site = recipe.sites[site]
    # Two stops at least: the self-signature is a mean over them.
    training = dict.fromkeys(of_site.training, max(2, round(recipe.sweeps.mines * share)))
    more_mines = of_site.model_copy(update={"training": training, "test": {}})
    other = recipe.model_copy(update={"sites": {**recipe.sites, site: more_mines}})
    return lane_looks(other, site, seed + _OTHER_LANE)


def example_detectors(
    recipe: StudyRecipe, site: str, seed: int, training: Training, looks: Sequence[Look]
) -> dict[str, ChipDetector]:
    """Return the detectors trained on more and fewer examples, at every rank.

    Parameters
    ----------
    recipe : StudyRecipe
        The study.
    site, seed
        Of the lane under test; they fix the order in which examples are taken.
    training : Training
        Of the lane under test, whose clutter whitens the examples.
    looks : sequence of Look
        The examples.
    """
    cuts = training.whitener.transform(np.concatenate([target_cut(recipe, x) for x in looks]))
    order = np.random.default_rng([lane_seed(recipe, site, seed), 36]).permutation(len(cuts))
    trained = {}
    for number, rank in product(recipe.sweeps.numbers, recipe.sweeps.ranks):
        if number > len(cuts):
            continue
        detectors = (DeflectionDetector(rank, recipe.detector.ddof), NeymanPearsonDetector(rank))
        for form, detector in zip(FORMS, detectors, strict=True):
            forms = detector.fit(cuts[order[:number]]).forms_
            trained[example_name(form, rank, number)] = chip_detector(
                recipe, forms, training.whitener, recipe.cut.length
            )
    return trained


def one_polarization(recipe: StudyRecipe, looks: Sequence[Look]) -> dict[str, Peaks]:
    """Train and score the deflection detector on the cuts of each polarization by itself."""
    peaks: dict[str, Peaks] = {}
    for name in recipe.cut.polarizations:
        cut = recipe.cut.model_copy(update={"polarizations": (name,)})
        peaks |= _deflection(recipe.model_copy(update={"cut": cut}), looks, alone(name))
    return peaks


def other_bands(recipe: StudyRecipe, site: str, seed: int, share: float) -> dict[str, Peaks]:
    """Train and score the deflection detector on images of the open lane in several bands."""
    peaks: dict[str, Peaks] = {}
    for name, looks in lane_looks(recipe, site, seed, share, recipe.sweeps.bands).items():
        peaks |= _deflection(recipe, looks, name)
    return peaks


def _deflection(recipe: StudyRecipe, looks: Sequence[Look], name: str) -> dict[str, Peaks]:
    """Train the deflection detector on the training looks and score it, by name, on the others."""
    training = learn(recipe, [look for look in looks if look.trains])
    detector = DeflectionDetector(recipe.detector.rank, recipe.detector.ddof).fit(training.white)
    made = chip_detector(recipe, detector.forms_, training.whitener, recipe.cut.length)
    return score_looks(recipe, [look for look in looks if not look.trains], {name: made})
