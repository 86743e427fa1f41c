"""The method on one page: what a recipe does with the scans of a lane, pass by pass.

The steps are those of Wang et al. 2007; where other recipes differ, their stages say how. A run in
memory, worker processes, sections of a long lane and training all run this list of passes. Live
detection takes the same steps (:mod:`flgpr.method.steps`) with the background and the run-view of
the scans so far.

``flgpr detect`` makes a job, ``jobs/driver.py`` hands out its passes, and ``do_block`` of
``jobs/pieces.py`` does a block of 16 scans: for each of them the engine calls ``add`` of the pass,
and ``result`` when the blocks are merged.

The image of a scan is made when a pass asks for it (``method/imaged_run.py``): A^H of its data
(``imaging/operator.py``). The sum itself is compiled; ``_make_backend`` there chooses it. On a CPU
it is by default ``adjoint`` of ``kernels/profiles.py``, over range profiles that ``compress`` of
``kernels/transform.py`` makes (``ProfileBackend`` in ``imaging/cpu.py``). Below 2000 terms a pair it
is that of ``kernels/direct.py``, beyond single precision that of ``kernels/precise.py``.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import xarray as xr

from flgpr.engine import Accumulator, Engine, PlannedPass, blocks_of
from flgpr.method.detection import Detection, assemble, rank_alarms
from flgpr.method.imaged_run import ImagedRun
from flgpr.method.instead import (
    contrast_lane,
    mark_threshold,
    put_instead,
    rank_by_column,
)
from flgpr.method.model import Detector, Model
from flgpr.method.passes.background import GAIN_BACKGROUND, LaneClutter, SelfSignaturePass
from flgpr.method.passes.features import Explain, Features
from flgpr.method.passes.run_view import (
    EarlierRunView,
    FrameAlarms,
    Maxima,
    PlainRunView,
    RunView,
)
from flgpr.method.passes.traversal import plan
from flgpr.method.sections import Section
from flgpr.method.unlike import Trust
from flgpr.model import Lane
from flgpr.progress import Track, silent
from flgpr.recipe.fit import area_of
from flgpr.recipe.schema import Recipe


def passes_of(lane: ImagedRun) -> list[PlannedPass]:
    """Return the passes of a recipe over a lane, in their order.

    For training they end where the first stage that has not learnt yet has its examples.
    """
    # What stages need of the raw data first, such as a field that stands still.
    passes = [planned for stage in lane.all_stages for planned in stage.passes()]

    # The background (clutter/estimator.py): the self-signature with the gain of every scan (Eq. 2;
    # with the recipe's self_signature = "none" the gain alone), and the gain background (Eq. 3 and
    # 4), in units of which images are cleaned.
    passes.append(plan(lane, SelfSignaturePass))
    passes.append(plan(lane, GAIN_BACKGROUND[lane.recipe.background.gain]))

    # What tells whether the ground is unlike that of the training lanes (method/unlike.py).
    if lane.measures_clutter:
        passes.append(plan(lane, LaneClutter))
    if lane.trust.only_measures:
        return passes

    # What a map needs to know of the whole lane, such as its clutter.
    mapper = lane.mapper
    if mapper is not None and mapper.surveys:
        passes.append(
            PlannedPass(
                "survey",
                "survey of the lane",
                lambda _: mapper.survey(lane.coherent),
                ("gain",),
                all_scans=True,
            )
        )

    # Cleaned images, or the recipe's map of them, laid over one another on the lane: the second
    # largest value of all looks at a place (Sec. II-B, RunViewSums), or what else of screen/views.py
    # the recipe names.
    of_days = [PlainRunView] if lane.earlier is None else [PlainRunView, EarlierRunView]
    passes.append(plan(lane, RunView, *of_days))
    if lane.recipe.score.area == "frames":
        passes.append(plan(lane, FrameAlarms))

    # Local maxima of the run-view are alarms, as many as the density rule leaves (Sec. II-B).
    passes.append(plan(lane, Maxima))

    # The features of every alarm, mean over the scans that see it (Eq. 5 to 17).
    passes.append(plan(lane, Features, Explain))

    return until_examples(lane, passes) if lane.untrained else passes


def until_examples(lane: ImagedRun, passes: Sequence[PlannedPass]) -> list[PlannedPass]:
    """Return the passes up to the examples of the first stage that has not learnt yet.

    A clutter stage learns from the data that the stages before it leave, a map from cleaned images,
    and a screen and feature stages from the run-view, which needs no pass of theirs.
    """
    learner = lane.untrained[0]
    kind = learner.partition(".")[0]
    names = [planned.name for planned in passes]
    if kind not in ("clutter", "map"):
        return list(passes[: names.index("view") + 1])

    def examples(_: range | None) -> Accumulator:
        # The cleaned images exist only once the passes before have run.
        if kind == "map":
            return lane.mapper.examples(lane.truth, lane.coherent)
        return lane.clutter_stages[learner].examples(lane.truth)

    needed = passes[: names.index("gain") + 1 if kind == "map" else names.index("signature")]
    return [*needed, PlannedPass(f"learn.{learner}", f"examples for {learner}", examples)]


def engine_of(lane: ImagedRun) -> Engine:
    """Return the engine that runs the passes of a lane."""
    passes = passes_of(lane)
    scans = len(lane.imager)
    numbers = lane.block_numbers(blocks_of(scans))
    return Engine(passes, scans, lane.results, lane.concurrent, numbers)


def detection_of(lane: ImagedRun) -> Detection:
    """Score the alarms of a lane whose passes are done, and return them with what explains them."""
    # The detector turns the features of every alarm into its confidence (Sec. II-D).
    ranked = rank_alarms(lane)
    return assemble(lane, ranked)


def detections_of(lane: ImagedRun) -> list[Detection]:
    """Return the detection of a lane whose passes are done, and those beside it.

    On ground that is unlike the training another detection may stand in for what was learnt.
    """
    detections = [detection_of(lane)]
    if lane.substitute == "contrast":
        fitted = contrast_lane(lane)
        if fitted is not None:
            contrast, text = fitted
            engine_of(contrast).run()
            detections = put_instead(lane, detections[0], detection_of(contrast), text)
        else:
            detections = rank_by_column(lane, detections[0])
    return [mark_threshold(lane, detections[0]), *detections[1:]]


def detect(
    run: xr.Dataset,
    recipe: Recipe,
    lane: Lane | None = None,
    track: Track = silent,
    model: Model | Detector | None = None,
    section: Section | None = None,
    others: Mapping[str, xr.Dataset] | None = None,
    unlike: str = "fallback",
    far: float | None = None,
) -> Detection:
    """Run a recipe on a run, in memory. Truth is not among its inputs.

    Parameters
    ----------
    run : xarray.Dataset
        A run that the recipe fits, see :func:`flgpr.recipe.fit.check_fit`.
    recipe : Recipe
        The recipe.
    lane : Lane, optional
        Lane in place of the recipe's.
    track : Track
        Shows progress.
    model : Model or its detector, optional
        What the recipe's stages have learnt. The score of its detector is the confidence; by
        default the local contrast is.
    section : Section, optional
        Rows of the lane to work on; by default all.
    others : mapping of str to xarray.Dataset, optional
        Runs taken together with this one, such as a second band, by the names that the recipe gives
        them.
    unlike : {"fallback", "keep", "refuse"}
        What is done on ground that is unlike that of the model's training lanes.
    far : float, optional
        False alarms per m² that a threshold is wanted for: the alarms have a column
        ``above_threshold``.

    Returns
    -------
    Detection
        The ranked alarms, and what explains them.

    Raises
    ------
    ValueError
        If the recipe does not fit the run, or needs a model that is not given. With "refuse" if the
        ground is unlike the training.
    """
    area = area_of(run, recipe, lane)
    setup = ImagedRun(
        run, recipe, area, model, section=section, others=others, trust=Trust(unlike, far)
    )
    engine_of(setup).run(track)
    return detections_of(setup)[0]
