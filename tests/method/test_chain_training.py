"""The passes up to the examples that a stage learns from."""

from types import SimpleNamespace

import pytest

from flgpr.engine import PlannedPass
from flgpr.method.method import until_examples

PASSES = [
    PlannedPass(name, name, lambda _: None)
    for name in ("roadside", "signature", "gain", "view", "alarms", "features")
]
TRUTH = object()


class Learner:
    """A stage that notes what it is asked to gather examples of."""

    def examples(self, *asked):
        self.asked = asked
        return "gatherer"


def names(passes):
    return [planned.name for planned in passes]


def test_a_clutter_stage_learns_from_data_before_there_are_images():
    stage = Learner()
    lane = SimpleNamespace(
        untrained=["clutter.filter"],
        clutter_stages={"clutter.filter": stage},
        truth=TRUTH,
    )
    passes = until_examples(lane, PASSES)
    assert names(passes) == ["roadside", "learn.clutter.filter"]
    assert passes[-1].title == "examples for clutter.filter"
    assert passes[-1].start(None) == "gatherer"
    assert stage.asked == (TRUTH,)


def test_a_map_learns_from_cleaned_images():
    stage = Learner()
    lane = SimpleNamespace(untrained=["map.forms"], mapper=stage, truth=TRUTH)
    passes = until_examples(lane, PASSES)
    assert names(passes) == ["roadside", "signature", "gain", "learn.map.forms"]
    # The cleaned images exist once the passes before have run.
    lane.coherent = "images"
    assert passes[-1].start(range(2)) == "gatherer"
    assert stage.asked == (TRUTH, "images")


@pytest.mark.parametrize("learner", ["screen.clusters", "features.cuts"])
def test_screens_and_features_learn_from_the_run_view(learner):
    lane = SimpleNamespace(untrained=[learner, "map.forms"])
    assert names(until_examples(lane, PASSES)) == ["roadside", "signature", "gain", "view"]
