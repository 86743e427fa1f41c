"""Experiments on why statements of Cosgrove et al. 2004 do not hold: lanes with one thing changed.

The lanes are small twins of the study's open lanes of dry sand: all training mines, a third of the
test mines, the study's seeds. Lanes of one seed differ in nothing but what is changed. What each
explanation predicts was written before the lanes ran.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flgpr.clutter import ClutterWhitener
from flgpr.features import clean_pixels, clutter_cuts, range_cuts, stack_channels
from flgpr.progress import Track, silent
from flgpr.stages.forms import samples_at
from flgpr_papers.cosgrove2004.detect import (
    eigenvalue_ratios,
    learn,
    target_cut,
)
from flgpr_papers.cosgrove2004.images import (
    Look,
    signature_looks,
)
from flgpr_papers.cosgrove2004.recipe import StudyRecipe, study_recipe
from flgpr_papers.cosgrove2004.signature import (
    fourth_moment_ratio,
    polarization_correlation,
)
from flgpr_papers.kit.cache import key_of, read_or_make
from flgpr_papers.kit.study_worlds import OWN
from reasons.changed_lanes import LaneChange, open_looks, reflector_looks
from reasons.cosgrove2004_soils import soil_trials
from reasons.trials import Trial, declared_trials, measured

ComplexArray = NDArray[np.complex128]
Records = Mapping[str, Sequence[dict[str, Any]]]
"""What was measured on the lanes of every change, seed by seed."""
SITE = "sand"
SEEDS = 6
"""Lanes with each change, by seeds from 1 on."""
TEST_MINES = 4
"""Test mines at each depth."""
SHIFTS = tuple(range(-10, 11))
"""Samples of 2 cm by which VV of a cut is shifted."""
FILLED = 0.5
"""Least mean power of a whitened direction that holds clutter; white noise has 1."""
_STREWN: dict[str, dict[str, Any]] = {
    "stones": {"on": False},
    "clutter": {"rocks": 0.0, "patches": 0.0},
    "holes": {"empty": 0.0},
}
_TEXTURE: dict[str, dict[str, Any]] = {"surface": {"texture_shape": None}}
_UNDUG: dict[str, dict[str, Any]] = {"holes": {"over": 0.0}}
_NO_SCREEN: dict[str, dict[str, Any]] = {"surface": {"phase_screen": False}}
CHANGES: dict[str, LaneChange] = {
    "nothing": LaneChange(),
    "mines taken out": LaneChange(mines=False),
    "stones, wet patches and empty holes taken out": LaneChange(_STREWN),
    "patchiness of the surface taken out": LaneChange(_TEXTURE),
    "all three taken out": LaneChange(_STREWN | _TEXTURE, mines=False),
    "surface uncorrelated in HH and VV": LaneChange({"surface": {"correlation": 0.0}}),
    "surface's echo 4.5 dB up": LaneChange({"surface": {"level_db": 4.5}}),
    "surface's echo 9 dB up": LaneChange({"surface": {"level_db": 9.0}}),
    "mines level": LaneChange(mine={"tilt": 0.0}),
    "mines straight ahead": LaneChange(mine={"x": 0.0}),
    "no holes over mines": LaneChange(_UNDUG),
    "smooth way through the surface": LaneChange(_NO_SCREEN),
    "mines level, straight ahead, undug, under a smooth surface": LaneChange(
        _UNDUG | _NO_SCREEN, {"tilt": 0.0, "x": 0.0}
    ),
}
"""What is changed on the lanes, by its name."""


def trials(
    folder: Path, quick: bool = False, world: str = OWN, track: Track = silent
) -> list[Trial]:
    """Run the experiments, or read those that are on disk in ``folder/reasons``.

    Parameters
    ----------
    folder : Path
        Folder of the study.
    quick : bool
        The quick study's lanes, two seeds: shows that everything runs.
    world : str
        World of the study.
    track : callable
        Shows progress.

    Returns
    -------
    list of Trial
        In the order of the statements.
    """
    recipe = small_twin(study_recipe(quick, world))
    seeds = range(1, 1 + min(SEEDS, recipe.study.seeds))

    def of_lane(name: str, seed: int) -> tuple[str, Callable[[], Any]]:
        stem = f"{name.replace(' ', '-')}-{seed}-{_key(recipe, name)}"
        return stem, partial(lane_record, recipe, CHANGES[name], seed)

    records = measured(folder, CHANGES, seeds, of_lane, track, "changed lanes")
    key = _key(recipe, "nothing")
    alone_file = folder / "reasons" / f"alone-{key}.json"
    alone = read_or_make(alone_file, partial(alone_record, recipe))
    return [
        *declared_trials("cosgrove2004", "eigenvalue", records),
        *correlation_trials(records, alone),
        *declared_trials("cosgrove2004", "moment", records),
        *soil_trials(study_recipe(quick, world), folder, track),
    ]


def small_twin(recipe: StudyRecipe) -> StudyRecipe:
    """Return the study's lane of dry sand with all its training mines and few test mines."""
    site = recipe.sites[SITE]
    few = site.model_copy(update={"test": dict.fromkeys(site.test, TEST_MINES)})
    return recipe.model_copy(update={"sites": {**recipe.sites, SITE: few}})


def _key(recipe: StudyRecipe, name: str) -> str:
    """Return the key of a change's records on disk."""
    return key_of(recipe.model_dump(mode="json"), asdict(CHANGES[name]), SHIFTS, FILLED)


def lane_record(recipe: StudyRecipe, change: LaneChange, seed: int) -> dict[str, Any]:
    """Simulate a seed's lane of dry sand with a change, and measure what the statements are about.

    Returns
    -------
    dict
        ``ratios`` and ``surveyed_ratios``, eigenvalues of Â over the first, of cuts at the
        brightest place and of cuts where survey and refraction place the mines; the measures of
        :func:`correlation_record` and :func:`moment_record`.
    """
    looks = open_looks(recipe, SITE, seed, recipe.study.share, change)
    trains = [look for look in looks if look.trains]
    test = [look for look in looks if not look.trains]
    training = learn(recipe, trains)
    surveyed = eigenvalue_ratios(recipe, training, training.surveyed)
    return {
        "ratios": eigenvalue_ratios(recipe, training).tolist(),
        "surveyed_ratios": surveyed.tolist(),
        **correlation_record(recipe, test),
        **moment_record(recipe, test, training.whitener),
    }


def correlation_record(recipe: StudyRecipe, looks: Sequence[Look]) -> dict[str, Any]:
    """Correlate HH and VV of mines and of clutter.

    Parameters
    ----------
    recipe : StudyRecipe
        The study.
    looks : sequence of Look
        Looks at mines of a lane.

    Returns
    -------
    dict
        ``mine`` and ``clutter``, the mean correlation along a cut; ``mine_by_shift``, the same with
        VV shifted by ``SHIFTS``; ``mine_over_looks`` and ``clutter_over_looks``,
        :func:`correlation_over_looks`, of mines cut where survey and refraction place them.
    """
    shape = recipe.cut.length, 1
    names = recipe.cut.polarizations
    mine_cuts = []
    surveyed_cuts = []
    clutter_cuts_of_looks = []
    for look in looks:
        surveyed_position = (look.position + [0.0, look.shift])[None]
        mine_cuts.append(target_cut(recipe, look))
        surveyed_cuts.append(range_cuts(look.image, surveyed_position, shape, names))
        samples = samples_at(look.image, look.position[None], recipe.cuts)
        clutter_cuts_of_looks.append(samples.clutter)
    mines = np.concatenate(mine_cuts)
    clutter = np.concatenate(clutter_cuts_of_looks)[:: recipe.premises.clutter_thinning]
    return {
        "mine": _mean_correlation(mines),
        "clutter": _mean_correlation(clutter),
        "mine_by_shift": [_mean_correlation(mines, shift) for shift in SHIFTS],
        "mine_over_looks": correlation_over_looks(np.concatenate(surveyed_cuts)),
        "clutter_over_looks": correlation_over_looks(clutter),
    }


def correlation_over_looks(cuts: NDArray[Any]) -> float:
    """Correlate HH and VV of cuts (n, 2 m) over looks, pixel by pixel.

    The mean over pixels is weighted by their energy:

    ``Σ_i |Σ_n h_ni v_ni*| / Σ_i sqrt(Σ_n |h_ni|² Σ_n |v_ni|²)`` is 1 where VV follows from HH by a
    factor that is the same in all looks and may differ from pixel to pixel.
    """
    hh, vv = np.split(cuts, 2, axis=1)
    together = np.abs(np.sum(hh * vv.conj(), axis=0))
    energy = np.sqrt(np.sum(np.abs(hh) ** 2, axis=0) * np.sum(np.abs(vv) ** 2, axis=0))
    return float(together.sum() / energy.sum())


def _mean_correlation(cuts: NDArray[Any], shift: int = 0) -> float:
    """Return the mean correlation of HH with VV shifted by some samples.

    Only the samples that both have are correlated.
    """
    hh, vv = np.split(cuts, 2, axis=1)
    first = hh[:, max(shift, 0) : hh.shape[1] + min(shift, 0)]
    second = vv[:, max(-shift, 0) : vv.shape[1] + min(-shift, 0)]
    stacked = np.concatenate([first, second], axis=1)
    return float(np.mean([polarization_correlation(cut) for cut in stacked]))


def moment_record(
    recipe: StudyRecipe, looks: Sequence[Look], whitener: ClutterWhitener
) -> dict[str, float]:
    """Measure how far whitened clutter is from Gaussian.

    Parameters
    ----------
    recipe : StudyRecipe
        The study.
    looks : sequence of Look
        Looks that the whitener has not seen.
    whitener : ClutterWhitener
        Learnt from the clutter of the training looks.

    Returns
    -------
    dict
        ``fourth_moment`` as the study measures it, the mean over all directions; ``share_filled``,
        the share of the directions whose mean power is at least ``FILLED`` of white noise's;
        ``filled``, the fourth moment in these; ``levelled``, the same of cuts that were brought to
        one level of every look and every distance.
    """
    cuts = []
    look_numbers = []
    rows = []
    for number, look in enumerate(looks):
        clutter = samples_at(look.image, look.position[None], recipe.cuts).clutter
        cuts.append(whitener.transform(clutter))
        look_numbers.append(np.full(len(clutter), number))
        rows.append(_cut_rows(recipe, look))
    white = np.concatenate(cuts)
    filled = white[:, np.mean(np.abs(white) ** 2, axis=0) >= FILLED]
    levelled = _at_equal_level(filled, np.concatenate(look_numbers))
    levelled = _at_equal_level(levelled, np.concatenate(rows))
    return {
        "fourth_moment": fourth_moment_ratio(white),
        "share_filled": filled.shape[1] / white.shape[1],
        "filled": fourth_moment_ratio(filled),
        "levelled": fourth_moment_ratio(levelled),
    }


def _cut_rows(recipe: StudyRecipe, look: Look) -> NDArray[np.int64]:
    """Return the first row of the image that each clutter cut of a look holds."""
    stack, _ = stack_channels(look.image, recipe.cut.polarizations)
    x = look.image["x"].values
    y = look.image["y"].values
    clean = clean_pixels(x, y, look.position[None], recipe.training.clear)
    # An image of row numbers is cut in the same way as the image itself.
    row_numbers = np.broadcast_to(np.arange(y.size)[:, None], clean.shape).astype(np.complex64)
    row_numbers = np.where(np.isfinite(stack).all(axis=0), row_numbers, np.nan)[None]
    shape = recipe.cut.length, 1
    cuts = clutter_cuts(row_numbers, clean, shape, recipe.training.clutter_step)
    return cuts[:, 0].real.astype(np.int64)


def _at_equal_level(white: ComplexArray, group: NDArray[np.int64]) -> ComplexArray:
    """Scale cuts so that the mean energy of every group is the same."""
    energy = np.sum(np.abs(white) ** 2, axis=1)
    number = np.unique(group, return_inverse=True)[1]
    mean = np.bincount(number, weights=energy) / np.bincount(number)
    return np.asarray(white / np.sqrt(mean[number])[:, None])


def alone_record(recipe: StudyRecipe) -> dict[str, list[float]]:
    """Correlate HH and VV of the study's mines alone, and of corner reflectors in their place.

    Parameters
    ----------
    recipe : StudyRecipe
        The study.

    Returns
    -------
    dict
        ``mine`` and ``reflector``, the correlation of each; ``mine_by_shift``, the mines' mean with
        VV shifted by ``SHIFTS``.
    """
    mines = [target_cut(recipe, look)[0] for look in signature_looks(recipe, SITE)]
    reflectors = [target_cut(recipe, look)[0] for look in reflector_looks(recipe, SITE)]
    return {
        "mine": [polarization_correlation(cut) for cut in mines],
        "reflector": [polarization_correlation(cut) for cut in reflectors],
        "mine_by_shift": [_mean_correlation(np.array(mines), shift) for shift in SHIFTS],
    }


def correlation_trials(records: Records, alone: Mapping[str, Sequence[float]]) -> list[Trial]:
    """Return trials of why mines are less correlated in HH and VV than clutter (III-C).

    Clutter, radar, mine and measure are changed, one at a time.
    """
    lanes = records["nothing"]
    level = float(np.mean([lane["clutter"] for lane in lanes]))
    best = int(np.argmax(alone["mine_by_shift"]))
    more = {
        "reflectors": [{"mine": value} for value in alone["reflector"]],
        "mines alone": [{"mine": value, "clutter": level} for value in alone["mine"]],
        "shifted": [lane | {"mine": lane["mine_by_shift"][best]} for lane in lanes],
    }
    shift = {"centimetres": 2 * SHIFTS[best]}
    return declared_trials("cosgrove2004", "correlation", {**records, **more}, **shift)
