import math

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from slow_scoring import best_share, random_lists, wang_area, wang_roc

from flgpr.model import ALARM_COLUMNS, Lane, empty_table
from flgpr.scoring import (
    CURVE_COLUMNS,
    accumulated_area,
    assign,
    clopper_pearson,
    label_alarms,
    match,
    pd_at,
    pd_mean,
    poisson_interval,
    roc,
    union_area,
    with_area,
)
from flgpr.scoring.curve import held_pd_mean

LANE = Lane(0.0, 4.0, 0.0, 20.0)


def alarm_table(rows):
    return pd.DataFrame(rows, columns=["x", "y", "confidence"], dtype=float)


def truth_table(rows, kinds=None):
    x, y = np.array(rows, dtype=float).reshape(-1, 2).T
    names = [f"m{k}" for k in range(len(x))]
    return pd.DataFrame(
        {
            "x": x,
            "y": y,
            "target_id": names,
            "kind": "metal" if kinds is None else kinds,
            "depth": 0.05,
        }
    )


# Halves and quarters make alarms meet the halo, the lane's border and each other exactly.
place = st.tuples(
    st.integers(-4, 20).map(lambda k: k / 4), st.integers(-4, 84).map(lambda k: k / 4)
)
free = st.tuples(st.floats(-1, 5), st.floats(-1, 21))
position = st.one_of(place, free)
confidence = st.one_of(st.integers(-2, 2).map(float), st.floats(-10, 10))
alarm_lists = st.lists(st.tuples(position, confidence), max_size=30).map(
    lambda rows: [(*p, c) for p, c in rows]
)
target_lists = st.lists(
    st.tuples(position, st.sampled_from(["metal", "plastic"])), min_size=1, max_size=6
)


@pytest.mark.slow("counts every threshold by hand")
@settings(max_examples=200, deadline=None)
@given(alarm_lists, target_lists, st.sampled_from([0.5, 1.0, 1.25]), st.booleans(), st.booleans())
def test_roc_is_the_rules_applied_threshold_by_threshold(
    rows, placed, halo, only_metal, to_the_letter
):
    targets = [{"x": p[0], "y": p[1], "kind": kind} for p, kind in placed]
    scored = (
        [k for k, target in enumerate(targets) if target["kind"] == "metal"] if only_metal else None
    )
    if scored == []:
        return
    alarms = alarm_table(rows)
    truth = truth_table([(t["x"], t["y"]) for t in targets], [t["kind"] for t in targets])
    curve = roc(
        alarms,
        truth,
        LANE,
        halo,
        {"kind": "metal"} if only_metal else None,
        area="paper",
        **({} if to_the_letter else {"shared": "count"}),
    )
    want = wang_roc(alarms.to_dict("records"), targets, LANE, halo, scored, to_the_letter)
    got = list(zip(curve["threshold"], curve["n_detected"], curve["n_false"], strict=True))
    assert got == want
    n = len(targets) if scored is None else len(scored)
    assert curve["pd"].tolist() == [detected / n for _, detected, _ in want]
    area = wang_area(targets, LANE, halo)
    assert curve["far"].to_numpy() == pytest.approx(np.array([false / area for *_, false in want]))


SHORT = Lane(0.0, 4.0, 0.0, 10.0)


@pytest.mark.slow("repeats a draw until its statistics stand")
@settings(max_examples=100, deadline=None)
@given(st.integers(0, 2**32))
def test_many_lists_score_by_the_papers_sentences(seed):
    """Ten lists per example: ties, duplicates, empty lists, shared halos, points on halos and borders."""
    for number, (rows, targets, halo) in enumerate(random_lists(seed)):
        alarms = pd.DataFrame(rows, columns=["x", "y", "confidence"], dtype=float)
        truth = truth_table([(t["x"], t["y"]) for t in targets], [t["kind"] for t in targets])
        if number % 2:
            kind = targets[0]["kind"]
            scored = [k for k, target in enumerate(targets) if target["kind"] == kind]
            curve = roc(alarms, truth, SHORT, halo, {"kind": kind}, area="paper")
            want = wang_roc(rows, targets, SHORT, halo, scored, to_the_letter=True)
        else:
            curve = roc(alarms, truth, SHORT, halo, area="paper")
            want = wang_roc(rows, targets, SHORT, halo)
            share = best_share(want, len(targets), wang_area(targets, SHORT, halo), 0.2)
            assert held_pd_mean(curve, 0.2) == pytest.approx(share)
        assert (
            list(zip(curve["threshold"], curve["n_detected"], curve["n_false"], strict=True))
            == want
        )


@settings(max_examples=60, deadline=None)
@given(alarm_lists, target_lists, st.randoms(use_true_random=False))
def test_the_order_of_the_rows_does_not_matter(rows, placed, random):
    truth = truth_table([p for p, _ in placed], [kind for _, kind in placed])
    shuffled = list(rows)
    random.shuffle(shuffled)
    pd.testing.assert_frame_equal(
        roc(alarm_table(rows), truth, LANE), roc(alarm_table(shuffled), truth.iloc[::-1], LANE)
    )


@settings(max_examples=60, deadline=None)
@given(alarm_lists, target_lists)
def test_subsets_add_up_to_the_whole(rows, placed):
    truth = truth_table([p for p, _ in placed], [kind for _, kind in placed])
    whole = roc(alarm_table(rows), truth, LANE)
    kinds = [{"kind": kind} for kind in truth["kind"].unique()]
    parts = [roc(alarm_table(rows), truth, LANE, subset=kind, shared="count") for kind in kinds]
    assert (sum(part["n_detected"] for part in parts) == whole["n_detected"]).all()
    for part, kind in zip(parts, kinds, strict=True):
        assert part["far"].equals(whole["far"])
        strict = roc(alarm_table(rows), truth, LANE, subset=kind)
        assert strict["far"].equals(whole["far"])
        assert (strict["n_detected"] <= part["n_detected"]).all()


def test_an_alarm_near_a_target_outside_the_subset_is_neither_detection_nor_false():
    truth = truth_table([(2, 5), (2, 6.5)], ["metal", "plastic"])
    alarms = alarm_table([(2, 5.7, 3.0), (2, 4.5, 2.0), (2, 7, 1.0)])
    metal = roc(alarms, truth, LANE, subset={"kind": "metal"})
    assert metal[["n_detected", "n_false"]].to_numpy().tolist() == [[0, 0], [0, 0], [1, 0], [1, 0]]
    assert metal.attrs["shared"] == "drop"
    kept = roc(alarms, truth, LANE, subset={"kind": "metal"}, shared="count")
    assert kept["n_detected"].tolist() == [0, 1, 1, 1]
    nearest = roc(alarms, truth, LANE, subset={"kind": "plastic"}, assignment="nearest")
    assert nearest["n_detected"].tolist() == [0, 0, 0, 1]


@settings(max_examples=60, deadline=None)
@given(alarm_lists, target_lists)
def test_assignment_agrees_with_the_curve_and_with_a_plain_search(rows, placed):
    truth = truth_table([p for p, _ in placed])
    alarms = alarm_table(rows)
    matched = match(alarms, truth, LANE)
    table = assign(matched)
    curve = roc(alarms, truth, LANE)
    for number, target in table.iterrows():
        away = np.hypot(alarms["x"] - target["x"], alarms["y"] - target["y"])
        near = alarms[away <= 1.0]
        assert target["detected"] == bool(len(near))
        if len(near):
            assert target["confidence"] == near["confidence"].max()
            tied = near[near["confidence"] == target["confidence"]].index
            assert target["distance"] == away[tied].min()
            assert target["rank"] == 1 + (alarms["confidence"] > target["confidence"]).sum()
            row = curve[curve["threshold"] == target["confidence"]].iloc[0]
            assert (target["n_false"], target["far"]) == (row["n_false"], row["far"])
        assert number in table.index
    labels = label_alarms(matched)
    assert (labels["label"] == "false").sum() == curve["n_false"].iloc[-1]
    assert set(table["alarm"][table["detected"]]) == set(
        labels.index[labels["label"] == "detection"]
    )


def test_first_row_declares_nothing_and_an_empty_table_has_only_that_row():
    truth = truth_table([(2, 5)])
    curve = roc(empty_table(ALARM_COLUMNS), truth, LANE)
    assert tuple(curve.columns) == CURVE_COLUMNS
    assert curve[["threshold", "pd", "far", "n_detected", "n_false"]].to_numpy().tolist() == [
        [math.inf, 0, 0, 0, 0]
    ]
    assert held_pd_mean(curve) == 0.0


def test_ties_are_one_step_and_the_border_of_halo_and_lane_is_within():
    truth = truth_table([(2, 5)])
    alarms = alarm_table([(3, 5, 1.0), (4, 20, 1.0), (0, 0, 1.0), (4.001, 10, 1.0)])
    curve = roc(alarms, truth, LANE)
    assert curve[["n_detected", "n_false"]].to_numpy().tolist() == [[0, 0], [1, 2]]


def test_union_area_is_the_default_and_overlap_counts_once():
    truth = truth_table([(2, 5), (2.5, 5), (0, 10)])
    alarms = alarm_table([(1, 15, 0.5)])
    exact = LANE.area - union_area(truth[["x", "y"]], 1.0, LANE)
    assert roc(alarms, truth, LANE)["far"].iloc[-1] == pytest.approx(1 / exact)
    assert roc(alarms, truth, LANE, area="paper")["far"].iloc[-1] == pytest.approx(
        1 / (80 - 3 * math.pi)
    )


def test_intervals_are_the_exact_ones():
    alarms = alarm_table([(2, 5, 3.0), (1, 15, 2.0), (1, 16, 1.0)])
    curve = roc(alarms, truth_table([(2, 5), (2, 9)]), LANE, level=0.9)
    low, high = clopper_pearson(curve["n_detected"], 2, 0.9)
    assert curve["pd_low"].tolist() == low.tolist()
    assert curve["pd_high"].tolist() == high.tolist()
    low, high = poisson_interval(curve["n_false"], curve.attrs["area"], 0.9)
    assert curve["far_high"].tolist() == high.tolist()
    assert curve["far_low"].tolist() == low.tolist()


def test_a_halo_given_as_diameter_is_half_as_wide():
    truth = truth_table([(2, 5)])
    alarms = alarm_table([(2, 5.5, 2.0), (2, 5.6, 1.0)])
    curve = roc(alarms, truth, LANE, 1.0, halo_as="diameter")
    assert curve[["n_detected", "n_false"]].to_numpy().tolist() == [[0, 0], [1, 0], [1, 1]]


def test_nearest_assignment_lets_an_alarm_find_one_target_only():
    truth = truth_table([(2, 5), (2, 6.5)])
    alarms = alarm_table([(2, 5.7, 1.0)])
    assert roc(alarms, truth, LANE)["n_detected"].iloc[-1] == 2
    assert roc(alarms, truth, LANE, assignment="nearest")["n_detected"].iloc[-1] == 1


def test_frames_count_the_same_ground_again():
    truth = truth_table([(2, 5)])
    alarms = alarm_table([(1, 15, 1.0)])
    area = accumulated_area(12)
    assert area == 12 * 14 * 5
    curve = roc(alarms, truth, LANE, area="frames", frame_area=area)
    assert curve["far"].iloc[-1] == pytest.approx(1 / 840)
    assert curve.attrs["convention"] == "frames"
    pd.testing.assert_frame_equal(with_area(roc(alarms, truth, LANE), area, "frames"), curve)


def test_several_lanes_are_scored_together_and_never_across():
    lanes = {"a": LANE, "b": Lane(0.0, 4.0, 0.0, 30.0)}
    truth = truth_table([(2, 5), (2, 25)]).assign(lane=["a", "b"])
    alarms = alarm_table([(2, 5, 3.0), (2, 25, 2.0), (2, 5, 1.0)]).assign(lane=["b", "b", "a"])
    curve = roc(alarms, truth, lanes)
    assert curve[["n_detected", "n_false"]].to_numpy().tolist() == [[0, 0], [0, 1], [1, 1], [2, 1]]
    assert curve.attrs["area"] == pytest.approx(200 - 2 * math.pi)
    table = pd.DataFrame([{"lane": name, **vars(lane)} for name, lane in lanes.items()])
    pd.testing.assert_frame_equal(roc(alarms, truth, table), curve)


def test_pd_is_unknown_without_targets():
    curve = roc(alarm_table([(1, 1, 1.0)]), truth_table([]), LANE)
    assert curve["pd"].isna().all()
    assert curve["far"].iloc[-1] == pytest.approx(1 / 80)
    assert math.isnan(pd_mean(curve))


def test_pd_mean_is_ten_times_the_integral_of_the_staircase():
    curve = pd.DataFrame({"pd": [0.0, 0.5, 0.75, 1.0], "far": [0.0, 0.0, 0.04, 0.2]})
    assert pd_mean(curve) == pytest.approx(10 * (0.5 * 0.04 + 0.75 * 0.06))
    assert pd_mean(curve, far_max=0.4) == pytest.approx((0.5 * 0.04 + 0.75 * 0.16 + 0.2) / 0.4)
    assert pd_at(curve, [0.0, 0.039, 0.04, 9]).tolist() == [0.5, 0.5, 0.75, 1.0]


@settings(max_examples=50, deadline=None)
@given(alarm_lists, target_lists)
def test_pd_mean_is_the_mean_over_targets_of_what_is_left_of_the_allowance(rows, placed):
    truth = truth_table([p for p, _ in placed])
    needed = assign(match(alarm_table(rows), truth, LANE))["far"]
    want = np.maximum(0, 1 - needed / 0.3).mean()
    assert held_pd_mean(roc(alarm_table(rows), truth, LANE), 0.3) == pytest.approx(want)


GOOD_ALARMS = alarm_table([(1, 2, 1.0), (2, 5, 3.0)])
GOOD_TRUTH = truth_table([(2, 5), (1, 9)], ["metal", "plastic"])


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            {"alarms": GOOD_ALARMS.drop(columns="confidence")},
            "alarms must have the columns confidence",
        ),
        ({"truth": GOOD_TRUTH.drop(columns="kind")}, "truth must have the columns kind"),
        ({"alarms": GOOD_ALARMS.assign(y=[1, math.nan])}, "alarms.y must be finite"),
        ({"truth": GOOD_TRUTH.assign(x=[math.nan, 1])}, "truth.x must be finite"),
        ({"truth": GOOD_TRUTH.assign(target_id="m0")}, "truth.target_id must be unique"),
        (
            {"lane": Lane(0, 4, 500, 600)},
            "alarms must lie in or near the lane.*is it the right lane",
        ),
        ({"truth": GOOD_TRUTH.assign(y=[90.0, 95.0])}, "truth must lie in or near the lane"),
        ({"alarms": GOOD_ALARMS.assign(x=601234.5, y=5340000.0)}, "map coordinates"),
        ({"alarms": GOOD_ALARMS.assign(x=16.3701, y=48.2002)}, "degrees"),
        (
            {"alarms": alarm_table([(k, 1 + k % 3, 1.0) for k in range(0, 20, 2)]).iloc[3:]},
            "alarms must have x across.*axes swapped",
        ),
        ({"truth": truth_table([(9, 2)])}, "truth must have x across.*axes swapped"),
        ({"halo": 0.0}, "halo must be a positive"),
        ({"halo": "1 m"}, "halo must be a positive"),
        ({"halo": 40.0}, "area must be positive"),
        ({"area": "paper", "halo": 4.0}, "area must be positive.*rule 'paper'"),
        ({"area": "exact"}, "area must be one of"),
        ({"area": "frames"}, "frame_area must be given"),
        ({"frame_area": 3.0}, "frame_area must be given"),
        ({"subset": {"kind": "glass"}}, "subset must select at least one target.*metal, plastic"),
        ({"subset": {"soil": "sand"}}, "subset must name columns"),
        ({"subset": ["m0", "m7"]}, "subset must name target_id.*'m7'"),
        ({"subset": lambda truth: [True]}, "subset must give one truth value per target"),
        ({"halo_as": "width"}, "halo_as must be one of"),
        ({"assignment": "best"}, "assignment must be one of"),
        ({"shared": "both"}, "shared must be one of"),
        ({"lane": {"a": LANE, "b": LANE}}, "alarms must have the column lane"),
        ({"alarms": GOOD_ALARMS.assign(lane=["a", "b"])}, "lane must be given by name"),
        (
            {
                "lane": {"a": LANE},
                "alarms": GOOD_ALARMS.assign(lane="a"),
                "truth": GOOD_TRUTH.assign(lane="z"),
            },
            "truth.lane must be one of a",
        ),
        ({"lane": {}}, "at least one lane"),
        ({"lane": {"x_min": 0, "x_max": 1}}, "missing: y_min, y_max"),
    ],
)
def test_tables_and_options_that_do_not_fit_are_named(change, message):
    arguments = {"alarms": GOOD_ALARMS, "truth": GOOD_TRUTH, "lane": LANE, **change}
    with pytest.raises(ValueError, match=message):
        roc(**arguments)


@pytest.mark.parametrize(
    "subset",
    [
        "m0",
        ["m0"],
        {"kind": "metal"},
        {"kind": ["metal", "simulant"], "depth": lambda depth: depth < 0.1},
        lambda truth: truth["kind"] == "metal",
        np.array([True, False]),
    ],
)
def test_subsets_can_be_named_in_many_ways(subset):
    curve = roc(GOOD_ALARMS, GOOD_TRUTH, LANE, subset=subset)
    assert curve.attrs["n_targets"] == 1
    assert curve["n_detected"].tolist() == [0, 1, 1]


def test_alarms_off_the_lane_alone_are_no_error():
    curve = roc(alarm_table([(5, 1, 1.0), (-1, 3, 2.0)]), GOOD_TRUTH, LANE)
    assert curve["n_false"].tolist() == [0, 0, 0]


def test_conversion_is_refused_where_it_has_no_meaning():
    curve = roc(GOOD_ALARMS, GOOD_TRUTH, LANE)
    with pytest.raises(ValueError, match="convention must count"):
        with_area(curve, 100.0, "box")
    with pytest.raises(ValueError, match="far must not be negative"):
        pd_at(curve, -1)
    with pytest.raises(ValueError, match="far_max must be positive"):
        pd_mean(curve, 0)
