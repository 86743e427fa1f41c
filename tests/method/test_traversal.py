"""Passes that go through the scans of a lane together."""

from types import SimpleNamespace

import numpy as np
import pytest

from flgpr.method.passes.traversal import Pass, plan


class Sum(Pass):
    """Adds up the indices of the scans."""

    name = "sum"
    title = "a sum"
    needs = ("gain",)
    all_scans = True

    def __init__(self, lane, block):
        super().__init__(lane, block)
        self.total = np.zeros(1)

    def add(self, scan):
        self.total += scan.index

    def state(self, exact):
        return {"total": self.total}

    def merge(self, state):
        self.total += state["total"]

    def result(self):
        return {"total": self.total}

    @staticmethod
    def cache_key(lane):
        return {"explains": lane.explains}


class Shown(Sum):
    """The same for the viewer."""

    name = "shown"
    needs = ("gain", "alarms")
    explains = True


@pytest.mark.parametrize("explains", [True, False])
def test_passes_are_planned_under_the_name_of_the_first_with_the_needs_of_all(explains):
    lane = SimpleNamespace(explains=explains)
    planned = plan(lane, Sum, Shown)
    assert (planned.name, planned.title) == ("sum", "a sum")
    assert planned.needs == (("gain", "alarms") if explains else ("gain",))
    assert (planned.all_scans, planned.needs_no_scans) == (True, False)
    assert planned.cache_key() == {"explains": explains}


@pytest.mark.parametrize("explains", [True, False])
def test_what_only_explains_is_left_out_where_nothing_is_explained(explains):
    lane = SimpleNamespace(explains=explains)
    start = plan(lane, Sum, Shown).start
    first = start(range(0, 2))
    for index in range(2):
        first.add(index)
    together = start(None)
    together.merge(first.state(False))
    together.merge(first.state(True))
    result = together.result()
    names = {"sum|total", "shown|total"} if explains else {"total"}
    assert result.keys() == names
    for name in names:
        assert result[name] == 2


def test_a_pass_that_does_nothing_has_no_state_and_is_not_shared():
    lane = SimpleNamespace(explains=True)
    traversal = plan(lane, Nothing).start(None)
    assert traversal.state(False) == {}
    assert Nothing.cache_key(lane) is None
    with pytest.raises(NotImplementedError):
        traversal.result()


class Nothing(Pass):
    """A pass that overrides nothing."""

    name = "nothing"
    title = "nothing"
