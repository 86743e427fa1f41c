"""Targets that lie where nothing was searched are counted apart, and a truth of another lane is refused."""

import numpy as np
import pandas as pd
import pytest

from flgpr.commands.reach import targets_in_reach
from flgpr.model import Lane

LANE = Lane(-1.5, 1.5, 0.0, 20.0)


def targets(y, x=0.0):
    y = np.asarray(y, dtype=float)
    names = [f"T{number}" for number in range(y.size)]
    return pd.DataFrame({"target_id": names, "x": x, "y": y, "kind": "metal", "depth": 0.05})


def test_all_in_reach_is_left_as_it_is(caplog):
    table = targets([0.5, 10.0, 20.9])
    kept, notes = targets_in_reach(table, LANE, 1.0, "truth.csv")
    assert kept is table
    assert notes == {}
    assert not caplog.records


def test_targets_out_of_reach_are_told_apart(caplog):
    caplog.set_level("INFO")
    kept, notes = targets_in_reach(targets([5.0, 12.0, 21.0, 21.1]), LANE, 1.0, "truth.csv")
    assert kept["target_id"].tolist() == ["T0", "T1", "T2"]
    assert notes == {"targets_outside": ["T3"]}
    said = caplog.text
    assert "1 of 4 targets lie more than the halo of 1 m outside" in said
    assert "counted apart, not as misses: T3" in said


@pytest.mark.parametrize(
    ("table", "hint"),
    [
        (targets([0.0] * 4).assign(x=[2.7, 8.0, 12.0, 15.0]), "x and y swapped?"),
        (targets([-4.0, -9.0, -17.0]), "the other sign of y?"),
        (targets([400.0, 410.0, 5.0]), "another lane?"),
    ],
)
def test_a_truth_that_lies_elsewhere_is_refused_with_what_would_fit(table, hint):
    with pytest.raises(
        ValueError, match=r"truth must lie in the ground that was searched"
    ) as error:
        targets_in_reach(table, LANE, 1.0, "truth.csv")
    assert str(error.value).endswith(hint)
    assert "x -1.5 to 1.5 m, y 0 to 20 m" in str(error.value)


def test_a_target_counts_in_its_own_lane():
    lanes = {"a": LANE, "b": Lane(-1.5, 1.5, 100.0, 120.0)}
    table = targets([5.0, 105.0, 5.0]).assign(lane=["a", "b", "b"])
    kept, notes = targets_in_reach(table, lanes, 1.0, "truth.csv")
    assert kept["target_id"].tolist() == ["T0", "T1"]
    assert notes == {"targets_outside": ["T2"]}
