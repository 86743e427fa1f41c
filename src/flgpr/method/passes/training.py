"""What a stage learns from: examples gathered from the scans of a training lane."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from flgpr.engine import Accumulator, PlannedPass
from flgpr.method.imaged_run import ImagedRun


def until_examples(lane: ImagedRun, passes: Sequence[PlannedPass]) -> list[PlannedPass]:
    """Return the passes up to the examples of the first stage that has not learnt yet.

    A clutter stage learns from the data that the stages before it leave, a map from cleaned images,
    and a screen and feature stages from the run-view, which needs no pass of theirs.
    """
    learner = lane.untrained[0]
    kind = learner.partition(".")[0]
    names = [planned.name for planned in passes]

    if kind == "clutter":
        clutter = lane.clutter_stages[learner]
        before_images = list(passes[: names.index("signature")])
        return [*before_images, _examples(learner, lambda _: clutter.examples(lane.truth))]

    if kind == "map":
        until_cleaned = list(passes[: names.index("gain") + 1])
        # The cleaned images exist only once the passes before have run.
        examples = _examples(learner, lambda _: lane.mapper.examples(lane.truth, lane.coherent))
        return [*until_cleaned, examples]

    return list(passes[: names.index("view") + 1])


def _examples(learner: str, start: Callable[[range | None], Accumulator]) -> PlannedPass:
    """Return the pass that gathers the examples of a stage."""
    return PlannedPass(f"learn.{learner}", f"examples for {learner}", start)
