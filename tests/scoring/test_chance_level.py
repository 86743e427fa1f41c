"""The chance level: against its slow twin, the closed form, and lanes of which it is known."""

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from slow_scoring import moved_best

from flgpr.model import Lane
from flgpr.scoring import (
    Rules,
    chance,
    compare,
    match,
    operating_row,
    pd_table,
    random_pd,
    roc_of,
    score,
)
from flgpr.scoring.curve import held_pd_mean
from flgpr.trials import score_blind, seal_truth

LONG = Lane(-6.0, 6.0, 0.0, 2000.0)


def mines(x, y, kind="metal"):
    count = len(np.atleast_1d(y))
    return pd.DataFrame(
        {"target_id": [f"m{i}" for i in range(count)], "x": x, "y": y, "kind": kind, "depth": 0.05}
    )


def strewn(rng, count, lane=LONG):
    places = rng.uniform([lane.x_min, lane.y_min], [lane.x_max, lane.y_max], (count, 2))
    return pd.DataFrame(places, columns=["x", "y"]).assign(confidence=rng.normal(size=count))


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 2**32 - 1), st.floats(0.2, 4.0))
def test_it_is_its_slow_twin(seed, halo):
    rng = np.random.default_rng(seed)
    lanes = {"a": Lane(-2.0, 2.0, 5.0, 35.0), "b": Lane(0.0, 3.0, -9.0, 1.0)}
    truth = []
    alarms = []
    for name, lane in lanes.items():
        low, high = (
            [lane.x_min - 1, lane.y_min - 1],
            [lane.x_max + 1, lane.y_max + 1],
        )  # some stand outside
        truth.append(
            pd.DataFrame(rng.uniform(low, high, (4, 2)), columns=["x", "y"]).assign(lane=name)
        )
        alarms.append(
            pd.DataFrame(rng.uniform(low, high, (25, 2)), columns=["x", "y"]).assign(lane=name)
        )
    truth = pd.concat(truth, ignore_index=True)
    truth = mines(truth["x"], truth["y"]).assign(lane=truth["lane"])
    alarms = pd.concat(alarms, ignore_index=True).assign(confidence=rng.normal(size=50))
    found = chance(match(alarms, truth, lanes, halo), shifts=7, seed=3).best
    parts = (np.arange(7) + np.random.default_rng(3).random(7)) / 7
    for name, lane in lanes.items():
        rows = truth[truth["lane"] == name]
        near = alarms[alarms["lane"] == name].to_dict("records")
        for number, part in enumerate(parts):
            shift = part * (lane.y_max - lane.y_min)
            expected = moved_best(near, rows.to_dict("records"), lane, halo, shift)
            expected = [np.nan if one is None else one for one in expected]
            np.testing.assert_array_equal(found[rows.index, number], expected)


def test_alarms_strewn_at_random_find_what_the_closed_form_says():
    rng = np.random.default_rng(4)
    matched = match(
        strewn(rng, 12_000), mines(rng.uniform(-5, 5, 100), np.linspace(10, 1990, 100)), LONG
    )
    curve = chance(matched).add_chance_column(roc_of(matched))
    rows = curve.iloc[operating_row(curve, [0.01, 0.02, 0.05, 0.1, 0.2, 0.4])]
    expected = random_pd(rows["far"], 1.0)
    # The lane holds so many halos side by side; more shifts than that tell nothing new.
    error = np.sqrt(expected * (1 - expected) / (LONG.area / np.pi))
    assert (np.abs(rows["chance"] - expected) < 4 * error).all()


def test_alarms_that_stand_together_find_less_than_the_closed_form_says():
    rng = np.random.default_rng(5)
    sixes = strewn(rng, 1500).assign(confidence=1.0).loc[np.repeat(np.arange(1500), 6)]
    matched = match(sixes, mines(0.0, np.linspace(10, 1990, 100)), LONG)
    point = chance(matched).add_chance_column(roc_of(matched)).iloc[-1]
    as_one = random_pd(point["far"] / 6, 1.0)
    error = np.sqrt(
        as_one * (1 - as_one) / (2 * 2000 / np.pi)
    )  # halos side by side in the strip the targets stand in
    assert point["chance"] == pytest.approx(as_one, abs=4 * error)
    assert point["chance"] < 0.35 < 0.6 < random_pd(point["far"], 1.0)


def test_clutter_at_one_side_is_chance_for_the_targets_there():
    rng = np.random.default_rng(6)
    alarms = strewn(rng, 400, Lane(-6.0, -2.0, 0.0, 2000.0))
    truth = mines(
        np.tile([-4.0, 4.0], 20), np.linspace(10, 1990, 40), np.tile(["metal", "plastic"], 20)
    )
    level = chance(match(alarms, truth, LONG))
    lowest = alarms["confidence"].min()
    assert level.at(lowest, {"kind": "plastic"}) == 0
    assert level.at(lowest, {"kind": "metal"}) == pytest.approx(
        random_pd(400 / 8000, 1.0), abs=0.05
    )
    half = (level.at(lowest, {"kind": "metal"}) + level.at(lowest, {"kind": "plastic"})) / 2
    assert level.at(lowest) == pytest.approx(half, abs=0.01)


def test_targets_stay_in_their_lane():
    rng = np.random.default_rng(7)
    lanes = {"busy": Lane(-2, 2, 0, 100), "quiet": Lane(-2, 2, 0, 50)}
    truth = mines(0.0, [20.0, 60.0, 25.0]).assign(lane=["busy", "busy", "quiet"])
    alarms = strewn(rng, 300, lanes["busy"]).assign(lane="busy")
    level = chance(match(alarms, truth, lanes))
    assert level.at(-9.0, ["m2"]) == 0
    assert level.at(-9.0, ["m0"]) > 0.7


def test_what_is_found_is_no_chance():
    truth = mines(0.0, np.linspace(10, 190, 10))
    perfect = match(truth[["x", "y"]].assign(confidence=5.0), truth, Lane(-3, 3, 0, 200))
    curve = chance(perfect).add_chance_column(roc_of(perfect))
    assert curve["pd"].iloc[-1] == 1
    assert (curve["chance"] == 0).all()


@pytest.mark.parametrize(
    "lane", [Lane(-2, 2, 0, 3.9), Lane(-2, 2, 0, 12)], ids=["short lane", "dense targets"]
)
def test_where_no_target_can_be_moved_chance_is_not_known(lane):
    truth = mines(0.0, np.arange(0.5, lane.y_max, 3.0))
    scored = score(
        strewn(np.random.default_rng(8), 5, lane), truth, lane, Rules(halo=1.0, draws=20)
    )
    assert np.isnan(scored.curve["chance"]).all()
    assert "chance not known" in scored.in_words()
    assert np.isnan(scored.pd_mean["chance"])


def test_unusable_requests_are_refused():
    matched = match(strewn(np.random.default_rng(0), 5), mines(0.0, [5.0]), LONG)
    with pytest.raises(ValueError, match="shifts must be at least 1, got 0"):
        chance(matched, 0)
    with pytest.raises(ValueError, match="far must not be negative"):
        random_pd([-0.1], 1.0)
    with pytest.raises(ValueError, match="halo must be positive, got 0 m"):
        random_pd(0.1, 0)
    with pytest.raises(
        ValueError, match="far must be a positive number of false alarms per m², got 0"
    ):
        score(matched.alarms, matched.truth, LONG, Rules(far=0))


@pytest.fixture(scope="module")
def scored():
    rng = np.random.default_rng(9)
    lane = Lane(-3.0, 3.0, 0.0, 200.0)
    truth = mines(
        rng.uniform(-2, 2, 20), np.linspace(8, 192, 20), np.resize(["metal", "plastic"], 20)
    )
    near = truth.loc[::2, ["x", "y"]].assign(confidence=rng.normal(3, 1, 10))
    alarms = pd.concat([strewn(rng, 540, lane), near], ignore_index=True)
    return score(alarms, truth, lane, Rules(draws=50))


def test_targets_are_found_at_the_operating_point(scored):
    point = scored.point
    outcomes = scored.outcomes
    assert (scored.far, scored.too_small) == (0.05, False)
    assert point["far"] <= 0.05 < scored.curve["far"].iloc[-1]
    assert outcomes["found"].sum() == point["n_detected"] < outcomes["detected"].sum()
    assert outcomes["found"].tolist() == (outcomes["confidence"] >= point["threshold"]).tolist()
    assert scored.in_words().startswith(
        f"{point['n_detected']} of 20 targets found at 0.05 false alarms per m²"
    )
    assert sorted(scored.missed()["target_id"]) == sorted(
        outcomes.loc[~outcomes["found"], "target_id"]
    )


def test_every_pd_that_is_told_has_its_chance(scored):
    told = scored.summary()
    assert {"pd", "pd_low", "pd_high", "chance"} <= set(told["operating_point"])
    assert all("chance" in row for row in told["points"])
    assert (
        told["pd_mean"]["chance"]
        == held_pd_mean(scored.curve.assign(pd=scored.curve["chance"]))
        > 0.1
    )
    assert set(told["kinds"]) == {"metal", "plastic"}
    for name, kind in told["kinds"].items():
        row = next(row for row in kind["points"] if row["far_allowed"] == 0.05)
        assert row["chance"] == scored.chance.at(scored.point["threshold"], {"kind": name})
    table = scored.breakdown()
    assert table["chance"].between(0.02, 0.4).all()
    whole = pd_table(scored.matched, 0.05, ["depth"], chance=scored.chance)
    assert whole["chance"].tolist() == [scored.point["chance"]]


def test_a_lane_too_small_for_the_operating_point_takes_one_false_alarm():
    lane = Lane(-1.0, 1.0, 0.0, 6.0)
    alarms = pd.DataFrame(
        {"x": [0, 0.8, 0.8, 0], "y": [1.0, 3, 4, 5], "confidence": [4.0, 3, 2, 1]}
    )
    small = score(alarms, mines(0.0, [1.0, 5.0]), lane, Rules(halo=0.3, draws=20))
    assert small.too_small
    assert small.far == 1 / small.curve.attrs["area"]
    assert (small.point["n_false"], small.point["n_detected"]) == (1, 1)
    assert "at one false alarm (0.087 per m²; 11.43 m² are too small for 0.05)" in small.in_words()
    assert small.summary()["operating_point"]["far_asked"] == 0.05


def test_where_few_halos_have_room_the_formula_stands_beside():
    lane = Lane(-1.0, 1.0, 0.0, 12.0)
    truth = mines(0.0, [2.0, 9.0])
    alarms = strewn(np.random.default_rng(10), 12, lane)
    small, large = (score(alarms, truth, lane, Rules(halo=halo, draws=20)) for halo in (0.7, 0.3))
    assert small.few_halos == pytest.approx(small.curve.attrs["area"] / (np.pi * 0.49))
    assert large.few_halos is None
    assert f"(strewn at random {random_pd(small.point['far'], 0.7):.2f})" in small.in_words()
    assert "strewn" not in large.in_words()


def test_a_comparison_and_a_blind_score_tell_chance(scored, tmp_path):
    weaker = match(scored.matched.alarms.iloc[300:], scored.matched.truth, scored.matched.lanes[""])
    both = compare(scored.matched, weaker, draws=20)
    assert both.chance_a == scored.pd_mean["chance"]
    assert both.chance_b == pytest.approx(random_pd(np.linspace(0, 0.1, 101), 1.0).mean(), abs=0.04)
    pytest.importorskip("cryptography")
    lane = scored.matched.lanes[""]
    phrase = "correct horse battery"
    sealed = seal_truth(scored.matched.truth, lane, tmp_path / "sealed", phrase)
    points = score_blind(scored.matched.alarms, sealed, phrase).points
    row = points[(points["group"] == "all") & (points["far_allowed"] == 0.05)].iloc[0]
    assert row["chance"] == round(float(scored.point["chance"]), 2)
