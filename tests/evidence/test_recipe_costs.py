"""What a difference between the printed recipe and another costs, evidence/reasons/recipe_costs.py."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from flgpr.model import Lane
from flgpr.recipe.schema import load_recipe
from flgpr.scoring import roc_of
from flgpr.scoring.curve import held_pd_mean
from flgpr_papers.wang2007.analysis import (
    FAR_MAX,
    MINES,
    LaneResult,
    matched,
)
from reasons.recipe_costs import DIFFERENCES, Lanes, paired_cost, table_trials
from wang2007_lane import fake_lane

pytestmark = pytest.mark.slow("studies of papers")


def test_a_difference_reads_the_columns_that_it_changes():
    _, gain, psi, area, everything = DIFFERENCES
    names = ["C_HH_F1", "P_alpha_F1", "P_psi_F1"]
    assert [gain.column(name) for name in names] == [
        "C_HH_F1",
        "shared.P_alpha_F1",
        "shared.linear.P_psi_F1",
    ]
    assert [psi.column(name) for name in names] == ["C_HH_F1", "P_alpha_F1", "circular.P_psi_F1"]
    assert [area.column(name) for name in names] == names
    assert [everything.column(name) for name in names] == [
        "C_HH_F1",
        "shared.P_alpha_F1",
        "shared.P_psi_F1",
    ]


def test_the_differences_are_those_of_the_two_recipes():
    printed = load_recipe("wang2007-printed")
    changed = load_recipe("wang2007")
    told = {one.entry: (one.printed, one.changed) for one in DIFFERENCES}
    for entry in ("background.median_step", "features.gain", "features.psi", "score.area"):
        table, name = entry.split(".")
        assert told[entry] == tuple(
            str(getattr(getattr(one, table), name)) for one in (printed, changed)
        )


def one_lane(places, confidence):
    """Two mines 20 m apart on a lane of 100 m², and alarms."""
    lane = Lane(-1.0, 1.0, 0.0, 50.0)
    truth = pd.DataFrame(
        {"target_id": ["T0", "T1"], "x": 0.0, "y": [10.0, 30.0], "kind": "metal", "depth": 0.1}
    )
    alarms = pd.DataFrame({"x": 0.0, "y": places, "magnitude": 1.0, "confidence": confidence})
    one = LaneResult("c1", lane, truth, alarms, pd.DataFrame(), None, {})
    return matched([one], [alarms])


def test_the_cost_is_the_difference_of_pd_mean_with_either_area():
    # Both mines before the false alarm: PD_mean is 1. One behind it: the false alarm takes its
    # share of the 0.1 per m².
    first = one_lane([10.0, 30.0, 45.0], [3.0, 2.0, 1.0])
    second = one_lane([10.0, 30.0, 45.0], [3.0, 1.0, 2.0])
    assert held_pd_mean(roc_of(first, MINES, area="paper"), FAR_MAX) == 1
    left = 100 - 2 * np.pi  # m², halos of 1 m lie within the lane: both rules agree
    behind = 1 - 1 / left / 0.1
    told = held_pd_mean(roc_of(second, MINES, area="paper"), FAR_MAX)
    assert told == pytest.approx((1 + behind) / 2)
    value, low, high = paired_cost(first, second, "paper", 200)
    assert value == pytest.approx((1 - behind) / 2)
    assert 0 <= low <= value <= high <= 1
    assert paired_cost(first, first, "paper", 50) == (0, 0, 0)
    # Mines on the edge: the paper counts halos whole, the union what of them lies in the lane: its
    # area is larger.
    edge = second.truth.assign(x=1.0)
    placed = replace(second, truth=edge)
    value, *_ = paired_cost(placed, placed, "union", 50)
    assert value == pytest.approx((1 / (100 - np.pi) - 1 / left) / 0.1 / 2, abs=1e-3)


def test_the_costs_of_what_nobody_reads_are_zero():
    lanes = Lanes([fake_lane(f"c{seed}", seed) for seed in range(3)], [fake_lane("b1", 5)])
    # The very same lanes stand for the coarse ones.
    trials = table_trials(lanes, lanes, 20)
    assert len(trials) == 5 * 4 * 2
    cost = {}
    for one in trials:
        _, detector, where = one.quantity.split(", ")
        cost[one.changed.split(":")[0], detector, where.split()[0]] = one.interval
        assert one.sample == ("21 mines" if "calibration" in where else "7 mines")
    untouched = {
        "background.median_step": ("C_HH", "A", "B", "all ten"),
        "features.gain": ("C_HH", "A"),
        "features.psi": ("C_HH", "A", "B"),
    }
    for entry, names in untouched.items():
        for detector in names:
            assert cost[entry, detector, "calibration"] == (0, 0, 0)
            assert cost[entry, detector, "blind"] == (0, 0, 0)
    assert cost["features.gain", "B", "calibration"][0] != 0
    assert cost["features.psi", "all ten", "calibration"][0] != 0
