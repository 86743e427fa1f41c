"""Why mines lose more than Fuse et al. 2018 say: mine and roadside share part of the response."""

from __future__ import annotations

from pathlib import Path

from flgpr.progress import Track, silent
from flgpr_papers.fuse2018.findings import KEPT, own_changes
from flgpr_papers.fuse2018.lanes import fuse_recipe
from flgpr_papers.fuse2018.process import stored_calibration
from flgpr_papers.fuse2018.study import LANES, lane_result
from flgpr_papers.kit.intervals import Bounds, clustered
from flgpr_papers.kit.study_worlds import OWN
from reasons.trials import Question, Trial

WITHIN: Bounds = (-1.0, 1.0)
"""Change of a mine's peak that the study's rule allows, dB."""


def trials(
    folder: Path, quick: bool = False, world: str = OWN, track: Track = silent
) -> list[Trial]:
    """Return what becomes of a mine's own peak if the road is fitted too and not subtracted.

    Parameters
    ----------
    folder : Path
        Folder of the study; lanes and results that are not there are made.
    quick, world, track
        As the study runs.
    """
    recipe = fuse_recipe(quick, world)
    calibration = stored_calibration(folder, recipe, quick, track)
    lanes = [lane_result(folder, recipe, name, quick, calibration, track) for name in LANES]
    spared = clustered(*own_changes(lanes, "least squares spared"), recipe.boxes.draws)
    quantity = "change of what a mine alone gives at its peak"
    question = Question(KEPT, quantity, "all looks of the study", "dB")
    explanation = "the array does not tell the mine from masked places far beside it"
    changed = "least squares, the road fitted too and not subtracted"
    return [question.asked(explanation, changed, spared, WITHIN)]
