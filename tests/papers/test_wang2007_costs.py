"""What a difference between the printed recipe and another costs."""

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
from flgpr_papers.wang2007.costs import DIFFERENCES, paired_cost

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
    value, low, high = paired_cost(first, second, MINES, "paper", "paper", 200)
    assert value == pytest.approx((1 - behind) / 2)
    assert 0 <= low <= value <= high <= 1
    assert paired_cost(first, first, MINES, "paper", "paper", 50) == (0, 0, 0)
    # Mines on the edge: the paper counts halos whole, the union what of them lies in the lane: its
    # area is larger.
    edge = second.truth.assign(x=1.0)
    placed = replace(second, truth=edge)
    value, *_ = paired_cost(placed, placed, MINES, "paper", "union", 50)
    assert value == pytest.approx((1 / (100 - np.pi) - 1 / left) / 0.1 / 2, abs=1e-3)
