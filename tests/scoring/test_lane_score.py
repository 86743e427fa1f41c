"""The score of a list: its sentence, its outcomes and what it shows of each kind."""

import numpy as np
import pandas as pd
import pytest

from flgpr.model import Lane
from flgpr.scoring import Rules, roc, score

LANE = Lane(-2.0, 2.0, 0.0, 60.0)
ALARMS = pd.DataFrame(
    {
        "x": [0.2, 1.0, -1.1, 0.0],
        "y": [10.3, 44.0, 30.1, 20.0],
        "confidence": [4.0, 3.0, 2.0, 1.0],
    }
)
TRUTH = pd.DataFrame(
    {
        "target_id": ["a", "b", "c"],
        "x": [0.0, -1.0, 1.0],
        "y": [10.0, 30.0, 50.0],
        "kind": ["metal", "plastic", "plastic"],
        "depth": [0.0, 0.05, 0.15],
    }
)


@pytest.fixture(scope="module")
def scored():
    return score(ALARMS, TRUTH, LANE, Rules(halo=0.5, far=0.005, far_max=0.01, draws=50))


def test_outcomes_hold_the_offset_of_the_best_alarm(scored):
    outcomes = scored.outcomes.set_index("target_id")
    assert outcomes["dx"].tolist()[:2] == pytest.approx([0.2, -0.1])
    assert np.isnan(outcomes.loc["c", "dx"])
    assert outcomes["found"].tolist() == [True, True, False]
    assert scored.missed()["target_id"].tolist() == ["c"]


def test_the_point_is_the_row_of_the_curve(scored):
    curve = roc(ALARMS, TRUTH, LANE, 0.5)
    row = curve[curve["far"] <= 0.005].iloc[-1]
    assert scored.point["pd"] == row["pd"] == pytest.approx(2 / 3)
    assert scored.in_words().startswith(
        "2 of 3 targets found at 0.005 false alarms per m²: Pd 0.67"
    )


def test_a_plain_sentence_counts_and_names_what_was_missed(scored):
    assert scored.in_plain_words(" in time") == (
        "2 of 3 mines were found in time, with 1 false alarm on 238 m² of other ground; "
        "missed: plastic 15 cm deep"
    )
    simulants = TRUTH[:1].assign(kind="simulant")
    one = score(ALARMS, simulants, LANE, Rules(halo=0.5, far=0.1, draws=50))
    assert one.in_plain_words() == (
        "1 of 1 target was found, with 3 false alarms on 239 m² of other ground (as many with none)"
    )
    none = score(ALARMS[1:2], TRUTH, LANE, Rules(halo=0.5, far=0.1, draws=50))
    assert none.in_plain_words().endswith(
        "missed: metal on the ground, plastic 5 cm deep, plastic 15 cm deep"
    )
    empty = score(ALARMS[:1], TRUTH[:0], LANE, Rules(halo=0.5, draws=50))
    assert empty.in_plain_words() == "There was nothing to find: 1 false alarm on 240 m²"


def test_a_lane_too_small_for_the_rate_allows_one_false_alarm():
    small = score(ALARMS, TRUTH, LANE, Rules(halo=0.5, far=1e-4, far_max=0.01, draws=50))
    assert small.too_small
    assert small.far == pytest.approx(1 / small.curve.attrs["area"])
    assert "are too small for 0.0001" in small.in_words()


def test_kinds_share_the_thresholds_of_the_whole(scored):
    kinds = scored.kinds()
    assert list(kinds) == ["metal", "plastic"]
    for curve in kinds.values():
        assert curve["threshold"].equals(scored.curve["threshold"])
    assert sum(curve["n_detected"].iloc[-1] for curve in kinds.values()) == 2


def test_false_alarms_are_listed_with_what_is_found_above_them(scored):
    worst = scored.worst_false_alarms(5)
    assert worst["confidence"].tolist() == [3.0, 1.0]
    assert worst["found_above"].tolist() == [1, 2]


def test_the_summary_holds_the_rules_and_every_target(scored):
    rules = scored.rules_summary()
    assert rules["halo_radius"] == 0.5
    assert rules["bootstrap"] == {"draws": 50, "seed": 0}
    assert "n_alarms" not in rules
    summary = scored.summary()
    assert [target["target_id"] for target in summary["targets"]] == ["a", "b", "c"]
    assert summary["operating_point"]["far_asked"] == 0.005
    assert summary["kinds"]["plastic"]["n_targets"] == 2


def test_without_targets_there_is_no_pd():
    empty = score(ALARMS, TRUTH.iloc[:0], LANE, Rules(halo=0.5, draws=50))
    assert empty.pd_mean is None
    assert empty.bands() == {}
    assert empty.in_words() == "no targets, 4 false alarms on 240.00 m²"


def test_a_rate_must_be_positive():
    with pytest.raises(ValueError, match="far must be a positive number of false alarms"):
        score(ALARMS, TRUTH, LANE, Rules(far=0.0))
