"""Scores as text, and lanes that are compared by their fingerprints."""

import numpy as np
import pandas as pd

from flgpr.proving_ground import load_ground
from flgpr.scoring import match, random_pd
from flgpr_ground.citing import bibtex, latex_table
from flgpr_ground.ground import opening_split
from flgpr_ground.lanes import _compared
from flgpr_ground.table import (
    _rows,
    best_sentence,
    costs_in_words,
    paired_in_words,
    paired_sentence,
    pd_in_words,
)

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


def test_the_answer_names_what_each_alone_finds():
    assert paired_sentence(SCORE, "mine", "wang2007") == ""
    paired = SCORE | {"p": 0.36, "only": 12, "reference_only": 1}
    assert paired_sentence(paired, "mine", "wang2007") == (
        "mine misses 1 mine that wang2007 finds, and finds 12 that wang2007 misses (McNemar p = 0.36)."
    )


def test_the_page_begins_with_the_best_entry_and_whether_it_is_told_apart_from_the_reference():
    ground = load_ground(quick=True)
    (tier, *_) = ground.chosen_tiers()
    common = SCORE | {
        "tier": tier.tier, "split": opening_split(ground), "group": "mines",
        "far_allowed": ground.table.far,
    }  # fmt: skip
    reference = common | {"entry": ground.table.reference}
    mine = common | {"entry": "mine", "pd": 0.75, "n_detected": 9, "only": 3, "reference_only": 0}
    oracle = common | {"entry": "oracle", "pd": 1.0}

    def sentence(*rows):
        return best_sentence(tier, pd.DataFrame(rows))

    best = sentence(reference, mine | {"p": 0.25}, oracle)
    assert best == (
        f"mine finds most: 9 of 12 mines at {ground.table.far:g} false alarms per m², Pd 0.75 "
        f"(0.25 to 0.75); not told apart from the reference {ground.table.reference} "
        "(McNemar p = 0.25)."
    )
    assert "; told apart from the reference" in sentence(reference, mine | {"p": 0.01})
    assert sentence(reference).endswith("; it is the reference.")
    assert " finds most, as does one other: 6 of 12" in sentence(reference, mine | SCORE)
    assert sentence(oracle) == ""


def test_a_cost_that_is_not_known_is_a_dash():
    cost = {"seconds_per_km": 12.4, "training_seconds": np.nan, "peak_bytes": 2.0**21}
    assert costs_in_words(cost) == ["12", "-", "2"]


def test_a_table_for_a_paper_has_a_row_per_entry_and_the_interval_of_each_difference():
    ground = load_ground(quick=True)
    row = SCORE | {
        "tier": "prepared", "split": "standard", "group": "mines", "far_allowed": 0.02,
    }  # fmt: skip
    mine = {"entry": "my_own%", "p": 0.065, "only": 5, "reference_only": 1}
    text = latex_table(ground, pd.DataFrame([row | {"entry": "wang2007"}, row | mine]), "standard")
    lines = [line for line in text.splitlines() if line.endswith(r"\\") and " & " in line]
    assert len(lines) == 3
    assert lines[1].startswith("wang2007 & 0.50 (0.25 to 0.75) & 6 of 12 & 3 & 0.12 & -- & --")
    assert lines[2].startswith(r"my\_own\% & ")
    assert "$+0.33$ ($-0.08$ to $+0.64$) & 0.065" in lines[2]
    assert text.count("rule") == 3  # of booktabs
    cited = bibtex(ground)
    assert cited.count("@") == 3
    assert cited.count("{") == cited.count("}")


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
