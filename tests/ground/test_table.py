"""Scores as text, and lanes that are compared by their fingerprints."""

import numpy as np
import pandas as pd

from flgpr.proving_ground import load_ground
from flgpr.scoring import match, random_pd
from flgpr_ground.fingerprints import _compared
from flgpr_ground.table import _rows, paired_in_words, pd_in_words

SCORE = {
    "pd": 0.5, "pd_low": 0.25, "pd_high": 0.75, "n_detected": 6, "n_targets": 12, "n_false": 3,
    "chance": 0.125,
}  # fmt: skip


def test_a_pd_is_written_with_its_interval_counts_and_chance():
    words = "0.50 (0.25 to 0.75), 6 of 12, 3 false, chance 0.12"
    assert pd_in_words(SCORE) == words


def test_the_reference_is_not_compared_with_itself():
    assert paired_in_words(SCORE) == ""
    assert paired_in_words(SCORE | {"p": np.nan}) == ""
    paired = SCORE | {"p": 0.0313, "only": 5, "reference_only": 0}
    assert paired_in_words(paired, "; against wang2007 ") == "; against wang2007 +5 -0, p = 0.031"


def test_lanes_are_the_same_bits_alike_or_others():
    known = pd.Series({"sha256": "a", "HH": 1.0, "VV": 2.0})
    assert _compared(known, known) == "same bits"
    assert _compared(pd.Series({"sha256": "b", "HH": 1.00005, "VV": 2.0}), known) == "alike"
    assert _compared(pd.Series({"sha256": "b", "HH": 1.0005, "VV": 2.0}), known) == "other"


def test_targets_that_cannot_be_moved_have_the_chance_of_alarms_strewn_at_random():
    ground = load_ground(source="full-wave-2")
    lanes = {lane.name: lane for lane in ground.tested("full-wave")}
    truths = [lane.truth_with_bodies().assign(lane=name) for name, lane in lanes.items()]
    borders = {name: lane.lane for name, lane in lanes.items()}
    # Two false alarms a lane, between the two columns of mines.
    names = np.repeat(list(lanes), 2)
    alarms = pd.DataFrame({"x": 0.0, "y": np.tile([0.1, 4.1], 6), "lane": names})
    alarms["confidence"] = np.arange(12.0)
    matched = match(alarms, pd.concat(truths, ignore_index=True), borders, ground.table.halo)
    scores = pd.DataFrame(_rows(ground, "full-wave", matched, None))
    for group, count in (("mines", 48), ("body metal-at", 12), ("arid", 48)):
        rows = scores[scores["group"] == group].set_index("far_allowed")
        assert list(rows["n_targets"]) == [count] * 3
        assert list(rows["n_false"]) == [2, 5, 10]
        np.testing.assert_allclose(rows["chance"], random_pd(rows["far"], 0.4))
