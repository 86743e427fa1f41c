"""Why mines lose more than Fuse et al. 2018 say.

The study's own lanes, their mask or array changed. What an iteration does to a mine's own data is
linear once mask and amplitudes are fixed. So the loss can come from the mask, the amplitudes and
how well the array tells places apart, and from nothing else. What each explanation predicts was
written before a changed mask was tried.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, cast

import numpy as np
import pandas as pd
import xarray as xr
from numpy.typing import NDArray

import flgpr
from flgpr.imaging import ImagingOperator
from flgpr.progress import Track, silent
from flgpr.stages.masks import Aperture, OperatorOn
from flgpr_papers.fuse2018.findings import KEPT, own_changes
from flgpr_papers.fuse2018.lanes import Frames, FuseRecipe, fuse_recipe, simulate_lane
from flgpr_papers.fuse2018.process import result_key, stored_calibration
from flgpr_papers.fuse2018.records import halo_of, targets_in_area
from flgpr_papers.fuse2018.study import LANES, lane_result
from flgpr_papers.fuse2018.suppression import (
    Calibration,
    Cleaned,
    stage_forms,
    suppressed_alone,
)
from flgpr_papers.kit.cache import key_of, read_or_make
from flgpr_papers.kit.intervals import Bounds, Interval, clustered
from flgpr_papers.kit.study_worlds import OWN
from reasons.trials import ABOVE_ZERO, BELOW_ZERO, Question, Trial

BoolArray = NDArray[np.bool_]
EVERY = 4
"""Of so many frames one ends an aperture."""
FARTHER = 6.0
"""Distance from the middle beyond which a narrower mask lies, m."""
WITHIN: Bounds = (-1.0, 1.0)
"""Change of a mine's peak that the study's rule allows, dB."""
_FLIPPED = "the mask mirrored, left for right"
_NARROW = f"the mask from {FARTHER:g} m of the middle on alone"
_HALF_MASK = "every other pixel of the mask, at random"
_HALF_ARRAY = "the middle half of the array alone"


def trials(
    folder: Path, quick: bool = False, world: str = OWN, track: Track = silent
) -> list[Trial]:
    """Run the experiments, or read those that are on disk in ``folder/reasons``.

    Lanes and results are the study's.

    Parameters
    ----------
    folder : Path
        Folder of the study; lanes and results that are not there are made.
    quick : bool
        The quick study's lanes.
    world : str
        World of the study.
    track : callable
        Shows progress.

    Returns
    -------
    list of Trial
        All of the statement that targets remain.
    """
    recipe = fuse_recipe(quick, world)
    stores = folder / "lanes"
    key = result_key(recipe, quick)

    calibration = stored_calibration(folder, recipe, quick, track)

    def make_losses(name: str) -> list[dict[str, Any]]:
        frames = simulate_lane(stores, recipe, name, track)
        return lane_losses(frames, calibration, recipe, track)

    losses_key = key_of(key, EVERY, FARTHER, flgpr.__version__)
    rows: list[dict[str, Any]] = []
    for name in LANES:
        path = folder / "reasons" / f"{name}-{losses_key}.json"
        for row in read_or_make(path, partial(make_losses, name)):
            rows.append({**row, "lane": name})
    lanes = [lane_result(folder, recipe, name, quick, calibration, track) for name in LANES]
    spared = clustered(*own_changes(lanes, "least squares spared"), recipe.boxes.draws)
    return loss_trials(pd.DataFrame(rows), spared, recipe)


@dataclass(frozen=True)
class SomePairs:
    """An imaging operator that some pairs of antennas do not take part in."""

    operator: ImagingOperator  #: of all pairs
    taken: NDArray[np.float32]  #: (pair, 1) 1 for a pair that takes part, else 0

    def adjoint(self, data: Any) -> NDArray[np.complex64]:
        """Image the data of the pairs that take part."""
        return self.operator.adjoint(np.asarray(data) * self.taken)

    def forward(self, image: Any) -> NDArray[np.complex64]:
        """Model the data of the pairs that take part; those of the others are zero."""
        return np.asarray(self.operator.forward(image) * self.taken, dtype=np.complex64)


def changed_masks(mask: BoolArray, across: NDArray[np.float64]) -> dict[str, BoolArray]:
    """Return the mask by what is changed of it or of the array.

    Mirrored, it has nothing to do with what stands at the roadside.
    """
    half = np.random.default_rng(2018).random(mask.shape) < 0.5
    return {
        "nothing": mask,
        _FLIPPED: np.ascontiguousarray(mask[:, ::-1]),
        _NARROW: mask & (np.abs(across) >= FARTHER),
        _HALF_MASK: mask & half,
        _HALF_ARRAY: mask,
    }


def half_the_array(aperture: Aperture, run: xr.Dataset) -> Aperture:
    """Take the pairs of antennas of which the middle lies in the middle half of the array."""
    middle = (run["tx_position"].values[:, 0] + run["rx_position"].values[:, 0]) / 2
    centre = (middle.min() + middle.max()) / 2
    taken = np.abs(middle - centre) <= np.ptp(middle) / 4
    factor = taken[:, None].astype(np.float32)
    operators = [_of_some_pairs(make, factor) for make in aperture.operators]
    return replace(aperture, data=aperture.data * factor, operators=operators)


def _of_some_pairs(make: OperatorOn, factor: NDArray[np.float32]) -> OperatorOn:
    """Return operators in which pairs have a factor."""

    def operator_on(points: NDArray[np.float64]) -> ImagingOperator:
        return cast("ImagingOperator", SomePairs(make(points), factor))

    return operator_on


def lane_losses(
    frames: Frames, calibration: Calibration, recipe: FuseRecipe, track: Track = silent
) -> list[dict[str, Any]]:
    """Follow what the mines alone add to the data through the iteration, with every change.

    Returns
    -------
    list of dict
        A row per aperture, mine and change: ``frame``, ``target``, ``changed``, ``change_db`` of
        what the mine alone gives at its peak, and whether the mask holds that peak (``masked``).
    """
    forms = stage_forms(frames, calibration)
    stage = forms["iteration"]
    latest = range(recipe.image.frames - 1, len(frames), EVERY)
    rows = []
    for index in track(latest, f"mines of lane {frames.name}", len(latest)):
        targets = targets_in_area(frames, stage.setup.pose(index), recipe)
        if not targets:
            continue
        whole = stage.aperture(index)
        half = half_the_array(whole, stage.setup.run)
        for name, chosen in changed_masks(stage.mask(whole), stage.across).items():
            aperture = half if name == _HALF_ARRAY else whole
            if chosen.any():
                courses = stage.courses(aperture, chosen)
                cleaned = Cleaned(index, forms, aperture, {"pixel": chosen}, courses, {}, {}, [])
                for row in _losses(cleaned, frames, targets, recipe):
                    rows.append({"frame": index, "changed": name, **row})
    return rows


def _losses(
    cleaned: Cleaned, frames: Frames, targets: Sequence[Any], recipe: FuseRecipe
) -> list[dict[str, Any]]:
    """Return what becomes of every mine's own peak."""
    stage = cleaned.stage
    aperture = cleaned.aperture
    mines = cast("NDArray[np.complex64]", frames.mines)
    alone = mines[stage.setup.imager.scans[: cleaned.index + 1][-len(aperture.data) :]]
    stack = aperture.stack_on(stage.points)
    before = np.abs(stack.adjoint(alone)[0, 0])
    after = np.abs(stack.adjoint(suppressed_alone(cleaned, alone))[0, 0])
    rows = []
    for target, position in targets:
        halo = halo_of(stage.grid, position, recipe.score.halo / 2)
        pixel = np.unravel_index(int(np.where(halo, before, -1).argmax()), halo.shape)
        change = 20 * np.log10(after[pixel] / before[pixel])
        is_masked = bool(cleaned.masks["pixel"][pixel])
        rows.append({"target": target.target_id, "change_db": float(change), "masked": is_masked})
    return rows


def loss_trials(rows: pd.DataFrame, spared: Interval, recipe: FuseRecipe) -> list[Trial]:
    """Return trials of what takes 2 dB of a mine's own peak.

    It is the mask on the mine, or the mask away from it, through the sidelobes of the array.

    Parameters
    ----------
    rows : DataFrame
        As :func:`lane_losses` gives them, with the ``lane``.
    spared : Interval
        Change with the road fitted too and not subtracted, of the study's results, dB.
    recipe : FuseRecipe
        Settings of the study.
    """
    quantity = "change of what a mine alone gives at its peak"
    target_key = rows["lane"] + rows["target"].astype(str)
    rows = rows.assign(mine=target_key, look=target_key + "-" + rows["frame"].astype(str))
    unchanged = rows[rows["changed"] == "nothing"]
    draws = recipe.boxes.draws
    trial_list = [_trial(quantity, "nothing", _mean(unchanged, draws), unchanged)]
    on_it = "the mask lies on the mine's peak"
    free = unchanged[~unchanged["masked"].astype(bool)]
    text = "looks whose peak the mask does not hold"
    trial_list.append(_trial(quantity, text, _mean(free, draws), free, on_it, WITHIN))
    explanation_beside = "the array does not tell the mine from masked places far beside it"
    expected: dict[str, Bounds | None] = {
        _FLIPPED: (-0.75, 0.75),
        _NARROW: ABOVE_ZERO,
        _HALF_MASK: None,
        _HALF_ARRAY: BELOW_ZERO,
    }
    for name, rule in expected.items():
        other = rows[rows["changed"] == name]
        trial_list.append(_trial(quantity, name, _mean(other, draws), other))
        paired = unchanged.merge(other, on="look", suffixes=("", "_other"))
        gap = clustered(paired["change_db_other"] - paired["change_db"], paired["mine"], draws)
        text = f"{quantity}, less that with nothing changed"
        trial_list.append(_trial(text, name, gap, paired, explanation_beside if rule else "", rule))
    text = "least squares, the road fitted too and not subtracted"
    trial_list.append(_trial(quantity, text, spared, None, explanation_beside, WITHIN))
    return trial_list


def _mean(rows: pd.DataFrame, draws: int) -> Interval:
    """Return the mean change with its interval over mines."""
    return clustered(rows["change_db"], rows["mine"], draws)


def _trial(
    quantity: str,
    changed: str,
    value: Interval,
    rows: pd.DataFrame | None,
    explanation: str = "",
    predicted: Bounds | None = None,
) -> Trial:
    """Return a trial of the looks at the mines."""
    sample = "all looks of the study"
    if rows is not None:
        sample = f"{len(rows)} looks at {rows['mine'].nunique()} mines"
    return Question(KEPT, quantity, sample, "dB").asked(explanation, changed, value, predicted)
