"""Targets that lie where nothing was searched are counted apart, and a truth of another lane is refused."""

import numpy as np
import pandas as pd
import pytest

from flgpr.commands.reach import targets_in_reach, tell_ranking_doubts
from flgpr.model import Lane
from flgpr.scoring.matching import match

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
        (targets([0.0] * 4).assign(x=[2.7, 8.0, 12.0, 15.0]), "if it is with x and y swapped"),
        (targets([-4.0, -9.0, -17.0]), "if it is with the other sign of y"),
        (targets([400.0, 410.0, 5.0]), "another lane?"),
    ],
)
def test_a_truth_that_lies_elsewhere_is_refused_with_what_would_fit(table, hint):
    with pytest.raises(
        ValueError, match=r"truth must lie in the ground that was searched"
    ) as error:
        targets_in_reach(table, LANE, 1.0, "truth.csv")
    assert hint in str(error.value)
    assert "x -1.5 to 1.5 m, y 0 to 20 m" in str(error.value)


def test_a_target_counts_in_its_own_lane():
    lanes = {"a": LANE, "b": Lane(-1.5, 1.5, 100.0, 120.0)}
    table = targets([5.0, 105.0, 5.0]).assign(lane=["a", "b", "b"])
    kept, notes = targets_in_reach(table, lanes, 1.0, "truth.csv")
    assert kept["target_id"].tolist() == ["T0", "T1"]
    assert notes == {"targets_outside": ["T2"]}


def ranked(confidence_of_hits):
    """Match three alarms at targets and twenty elsewhere, whose confidences are 0 to 19."""
    truth = targets([2.0, 8.0, 14.0])
    away = pd.DataFrame({"x": 1.4, "y": 18 + 0.05 * np.arange(20.0), "confidence": np.arange(20.0)})
    hits = truth[["x", "y"]].assign(confidence=confidence_of_hits)
    return match(pd.concat([hits, away], ignore_index=True), truth, LANE, 0.5)


@pytest.mark.parametrize(("confidence", "is_told"), [(-1.0, True), (7.5, False), (30.0, False)])
def test_confidences_that_fall_at_targets_are_told(confidence, is_told, caplog):
    with caplog.at_level("INFO", "flgpr.notes"):
        tell_ranking_doubts(ranked(confidence), None, 1.0, "a.csv")
    assert ("is the order reversed?" in caplog.text) == is_told


@pytest.mark.parametrize(("far", "is_told"), [(None, False), (0.5, False), (2.0, True)])
def test_a_rate_beyond_the_list_is_told(far, is_told, caplog):
    with caplog.at_level("INFO", "flgpr.notes"):
        tell_ranking_doubts(ranked(30.0), far, 1.0, "a.csv")
    assert ("beyond the 1 per m²" in caplog.text) == is_told
