import math

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats
from slow_scoring import replicate_pd, sign_flip_p

from flgpr.model import Lane
from flgpr.scoring import (
    band,
    clopper_pearson,
    compare,
    match,
    mcnemar_test,
    pd_at,
    pd_mean_interval,
    poisson_interval,
    roc,
    sign_flip_test,
)
from flgpr.scoring.bootstrap import make_design, make_scores, tails
from flgpr.scoring.curve import held_pd_mean

LANE = Lane(0.0, 4.0, 0.0, 60.0)


def drawn(seed, targets=8, alarms=40, levels=6, gain=2.0):
    """A lane with alarms near some targets and elsewhere; confidences in few levels, so that they tie."""
    rng = np.random.default_rng(seed)
    y = np.linspace(3, 57, targets)
    truth = pd.DataFrame({"x": rng.uniform(0.5, 3.5, targets), "y": y, "depth": 0.05})
    truth = truth.assign(
        target_id=[f"m{k}" for k in range(targets)], kind=rng.choice(["metal", "plastic"], targets)
    )
    seen = rng.random(targets) < 0.8
    near = truth.loc[seen, ["x", "y"]] + rng.uniform(-0.6, 0.6, (int(seen.sum()), 2))
    far = pd.DataFrame(rng.uniform([0, 0], [4, 60], (alarms, 2)), columns=["x", "y"])
    table = pd.concat([near, far], ignore_index=True)
    strength = np.concatenate([rng.normal(gain, 1, len(near)), rng.normal(0, 1, alarms)])
    return table.assign(confidence=np.round(strength * levels) / levels), truth


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 2**32))
def test_a_weighted_curve_is_that_of_the_replicate_written_out(seed):
    alarms, truth = drawn(seed, targets=5, alarms=15, levels=2)
    matched = match(alarms, truth, LANE)
    design = make_design(matched)
    scores = make_scores(matched, design)
    target, block = design.draw(np.random.default_rng(seed))
    area = float((block * design.block_area).sum())
    far = np.array([0.0, 1 / area, 2 / area, 0.02, 0.1, 1.0])
    got = scores.pd_at(far, target, block, area)
    times = block[scores.block]
    assert got == pytest.approx(
        [replicate_pd(scores.target, target, scores.false, times, area, one) for one in far]
    )
    grid = np.linspace(0, 0.1, 20_001)
    middle = scores.pd_at((grid[1:] + grid[:-1]) / 2, target, block, area).mean()
    shares = scores.shares(0.1, block, area)
    assert (target * shares).sum() / target.sum() == pytest.approx(middle, abs=1e-3)


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 2**32), st.sampled_from(["union", "paper"]), st.booleans())
def test_the_middle_of_a_band_is_the_curve(seed, area, part):
    alarms, truth = drawn(seed)
    subset = np.arange(len(truth)) < 4 if part else None
    curve = roc(alarms, truth, LANE, subset=subset, area=area)
    made = band(match(alarms, truth, LANE), subset, area=area, draws=20)
    assert made["pd"].tolist() == pd_at(curve, made["far"]).tolist()
    assert (made["pd_low"] <= made["pd"]).all()
    assert (made["pd"] <= made["pd_high"]).all()
    assert (np.diff(made["pd_low"]) >= 0).all()
    assert (np.diff(made["pd_high"]) >= 0).all()


def test_a_band_over_frames_only_stretches_the_axis():
    matched = match(*drawn(3), LANE)
    area = roc(*drawn(3), LANE).attrs["area"]
    grid = np.linspace(0, 0.1, 11)
    wide = band(matched, None, grid / 10, area="frames", frame_area=10 * area, draws=50)
    assert wide["pd_low"].to_numpy() == pytest.approx(
        band(matched, None, grid, draws=50)["pd_low"].to_numpy()
    )


def test_draws_are_reproducible_and_clusters_and_lanes_widen_a_band():
    alarms, truth = drawn(1, targets=16, alarms=4)
    matched = match(alarms, truth, LANE)
    pd.testing.assert_frame_equal(band(matched, draws=50, seed=4), band(matched, draws=50, seed=4))
    paired = match(alarms, truth.assign(mine=np.arange(16) // 2), LANE)
    assert band(paired, draws=50, cluster="mine").attrs["clusters"] == 8
    # All looks at a mine alike: half as many clusters must not give the narrower interval.
    double = truth.assign(mine=truth["target_id"])
    copy = double.assign(target_id=double["target_id"] + "b")
    twice = match(alarms, pd.concat([double, copy], ignore_index=True), LANE)
    grouped = pd_mean_interval(twice, cluster="mine")
    loose = pd_mean_interval(twice)
    assert np.diff(grouped)[0] > 1.2 * np.diff(loose)[0]
    low, high = pd_mean_interval(matched, draws=300)
    assert low <= held_pd_mean(roc(alarms, truth, LANE)) <= high


def test_several_lanes_are_drawn_as_wholes():
    first = drawn(1)
    second = drawn(2)
    alarms = pd.concat([first[0].assign(lane="a"), second[0].assign(lane="b")], ignore_index=True)
    truth = pd.concat([first[1].assign(lane="a"), second[1].assign(lane="b")], ignore_index=True)
    matched = match(alarms, truth, {"a": LANE, "b": LANE})
    made = band(matched, draws=50)
    assert made.attrs["lanes"] == 2
    assert (
        made["pd"].tolist()
        == pd_at(roc(alarms, truth, {"a": LANE, "b": LANE}), made["far"]).tolist()
    )


@pytest.mark.slow("repeats a draw until its statistics stand")
def test_coverage_of_a_band_by_simulation():
    """The true curve is known: targets N(2, 1), false alarms N(0, 1) at a known rate; 120 lanes of 20 targets."""
    rng = np.random.default_rng(11)
    rate = 0.3
    runs = 120
    inside = 0
    grid = np.linspace(0.005, 0.1, 20)
    truth = pd.DataFrame({"x": 2.0, "y": np.arange(20) * 10.0 + 5, "depth": 0.0, "kind": "metal"})
    truth["target_id"] = [f"m{k}" for k in range(20)]
    lane = Lane(0, 4, 0, 200)
    want = stats.norm.sf(stats.norm.isf(np.minimum(grid / rate, 1)) - 2)
    for _ in range(runs):
        noise = rng.uniform([0, 0], [4, 200], (rng.poisson(rate * lane.area), 2))
        near = np.hypot(noise[:, 0] - 2, (noise[:, 1] % 10) - 5) <= 1
        places = np.concatenate([truth[["x", "y"]].to_numpy(), noise[~near]])
        confidence = np.concatenate([rng.normal(2, 1, 20), rng.normal(size=int((~near).sum()))])
        alarms = pd.DataFrame(places, columns=["x", "y"]).assign(confidence=confidence)
        made = band(
            match(alarms, truth, lane), None, grid, draws=100, seed=int(rng.integers(2**31))
        )
        inside += bool(((made["pd_low"] <= want) & (want <= made["pd_high"])).all())
    # 95 % less four standard errors of the simulation; a band for single points holds far less
    # often.
    assert inside / runs >= 0.95 - 4 * math.sqrt(0.95 * 0.05 / runs)


def test_exact_intervals_cover_by_simulation():
    rng = np.random.default_rng(3)
    runs = 20_000
    slack = 4 * math.sqrt(0.95 * 0.05 / runs)
    for n in (12, 20, 50, 200):
        low, high = clopper_pearson(rng.binomial(n, 0.85, runs), n)
        assert ((low <= 0.85) & (high >= 0.85)).mean() >= 0.95 - slack
        low, high = poisson_interval(rng.poisson(0.02 * 15 * n, runs), 15.0 * n)
        assert ((low <= 0.02) & (high >= 0.02)).mean() >= 0.95 - slack


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"far": [-0.1]}, "far must be rates"),
        ({"level": 95}, "level must lie between"),
        ({"draws": 1}, "draws must be at least 2"),
        ({"block": 0}, "block must be a positive length"),
        ({"cluster": "mine"}, "cluster must name a column"),
        ({"cluster": "gap"}, "cluster must name a mine in every row"),
        ({"area": "frames"}, "frame_area must be given"),
    ],
)
def test_bootstrap_options_that_do_not_fit_are_named(change, message):
    alarms, truth = drawn(0)
    matched = match(alarms, truth.assign(gap=[None, *range(7)]), LANE)
    with pytest.raises(ValueError, match=message):
        band(matched, **change)


def test_a_bootstrap_needs_targets_and_ground():
    alarms, truth = drawn(0)
    with pytest.raises(ValueError, match="at least one target"):
        band(match(alarms, truth.iloc[:0], LANE))
    with pytest.raises(ValueError, match="area must be positive"):
        band(match(alarms, truth, LANE, 50.0))


def test_a_detector_compared_with_itself_does_not_differ():
    matched = match(*drawn(5), LANE)
    same = compare(matched, matched, draws=50)
    assert (same.difference, same.low, same.high, same.p_value, same.p_detections) == (
        0,
        0,
        0,
        1,
        1,
    )
    assert same.pd_mean_a == pytest.approx(held_pd_mean(roc(*drawn(5), LANE)))


def test_a_comparison_is_antisymmetric_and_sees_a_better_detector():
    good, truth = drawn(7, targets=14, gain=6.0)
    poor = good.assign(confidence=np.random.default_rng(0).permutation(good["confidence"]))
    a = match(good, truth, LANE)
    b = match(poor, truth, LANE)
    there = compare(a, b, draws=200)
    back = compare(b, a, draws=200)
    assert there.difference == pytest.approx(roc_mean(good, truth) - roc_mean(poor, truth))
    assert there.low > 0
    assert there.p_value < 0.05
    assert there.enumerated
    assert (there.difference, there.low, there.high) == pytest.approx(
        (-back.difference, -back.high, -back.low)
    )
    assert (there.only_a, there.only_b, there.p_value) == (back.only_b, back.only_a, back.p_value)
    with pytest.raises(ValueError, match="same truth"):
        compare(a, match(poor, truth.iloc[1:], LANE))


def roc_mean(alarms, truth):
    return held_pd_mean(roc(alarms, truth, LANE))


def test_two_passes_over_a_mine_count_once_in_the_tests():
    alarms, truth = drawn(9, targets=10, gain=9.0)
    truth = truth.assign(mine=np.arange(10) // 2)
    none = match(alarms.iloc[:0], truth, LANE)
    found = match(alarms, truth, LANE)
    assert (
        compare(found, none, draws=20, cluster="mine").only_a
        <= 5
        < compare(found, none, draws=20).only_a
    )


@settings(max_examples=200, deadline=None)
@given(st.lists(st.integers(-4, 4), max_size=8))
def test_sign_flip_p_is_the_count_over_all_signs(values):
    tenths = [value / 10 for value in values]
    p, enumerated = sign_flip_test(tenths)
    assert enumerated
    assert p == sign_flip_p(values)  # in whole numbers, where sums that are equal are equal


def test_sign_flips_of_many_mines_are_drawn_and_stay_valid():
    values = np.random.default_rng(2).normal(size=40)
    p, enumerated = sign_flip_test(values)
    assert not enumerated
    normal = 2 * stats.norm.sf(abs(values.sum()) / np.sqrt((values**2).sum()))
    assert p == pytest.approx(normal, abs=0.01)


@pytest.mark.parametrize(
    ("a", "b", "p"), [(0, 0, 1.0), (5, 0, 2 / 32), (3, 3, 1.0), (6, 1, 16 / 128)]
)
def test_mcnemar_is_the_two_sided_binomial(a, b, p):
    assert mcnemar_test(a, b) == pytest.approx(p)


def test_percentiles_reach_further_out_for_few_mines():
    assert tails(0.95, 10**6) == pytest.approx((0.025, 0.975), abs=1e-6)
    # For n normal values the widened percentiles of the mean are Student's interval: s here is the
    # resampling spread.
    for n in (5, 12):
        spread = math.sqrt((n - 1) / n)
        assert stats.norm.ppf(tails(0.95, n)[1]) * spread == pytest.approx(
            stats.t.ppf(0.975, n - 1)
        )
    assert tails(0.95, 1) == (0.0, 1.0)
    with pytest.raises(ValueError, match="level must lie"):
        tails(95, 3)
