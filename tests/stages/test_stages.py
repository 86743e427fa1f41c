"""Stages are made once for a lane: clutter stages one behind the other, all others alike."""

import numpy as np
import pytest

from flgpr.stages import ClutterStage, MapStage, Stage, Table
from flgpr.stages.named import Named, make_clutter_stages, make_stages


class Halving(ClutterStage):
    def clean(self, index, data):
        return data / 2


class Shifting(ClutterStage):
    def clean(self, index, data):
        return data + 1


class Learning(Shifting):
    learns = True


class Picture(MapStage):
    learns = True


ENTRIES = {
    "clutter.halving": Halving,
    "clutter.learning": Learning,
    "clutter.shifting": Shifting,
    "map.picture": Picture,
}
LEARNT = {"clutter.learning": {"level": np.ones(1)}}


@pytest.fixture
def entries():
    named = {}
    for name, stage_class in ENTRIES.items():
        named[name] = Named(stage=name, settings=Table(), stage_class=stage_class)
    return named


def measured(index, count):
    return np.full((count, 1, 1, 1), 8 * index, np.complex64)


def test_a_clutter_stage_reads_what_the_one_before_it_leaves(entries):
    stages = make_clutter_stages(entries, None, LEARNT, measured)
    assert list(stages) == ["clutter.halving", "clutter.learning", "clutter.shifting"]
    assert stages["clutter.learning"].learnt is LEARNT["clutter.learning"]
    values = [stage.data(3, 1).item() for stage in stages.values()]
    assert values == [12, 13, 14]


def test_behind_a_clutter_stage_that_has_not_learnt_none_is_made(entries):
    stages = make_clutter_stages(entries, None, {}, measured)
    assert list(stages) == ["clutter.halving", "clutter.learning"]


def test_all_other_stages_are_made_whether_they_have_learnt_or_not(entries):
    assert list(make_stages(entries, None, {})) == ["map.picture"]
    learnt = {"map.picture": {"level": np.ones(1)}}
    made = make_stages(entries, None, learnt)["map.picture"]
    assert isinstance(made, Stage)
    assert made.learnt is learnt["map.picture"]
