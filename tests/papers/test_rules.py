"""The rules of the verdicts: what samples of known truth are said to be, and how often that is wrong."""

import math

import numpy as np
import pytest

from flgpr_papers.kit.findings import (
    AGREES,
    DISAGREES,
    OPEN,
    UNDECIDED,
    Finding,
    alike,
    by_chance,
    clustered,
    difference_of_shares,
    larger,
    less_figure,
    parts_larger,
    share_error,
    spread,
    together,
)


def test_no_verdict_without_an_interval():
    for verdict in (AGREES, DISAGREES):
        with pytest.raises(ValueError, match="interval of 'more' must be known"):
            Finding("more", "yes", "no", verdict)
        with pytest.raises(ValueError, match="must be known"):
            Finding("more", "yes", "no", verdict, interval=(0.1, math.nan, math.nan))
    Finding("more", "yes", "no", UNDECIDED)


def test_a_single_miss_is_no_disagreement_with_all_found():
    gap = difference_of_shares((47, 48), (48, 48))
    assert alike(*gap[1:]) == AGREES
    assert alike(*difference_of_shares((33, 48), (48, 48))[1:]) == DISAGREES
    assert alike(*difference_of_shares((8, 10), (10, 10))[1:]) == UNDECIDED


def test_two_samples_of_one_share_rarely_disagree():
    rng = np.random.default_rng(0)
    for share, n, m in ((0.7, 47, 47), (0.95, 48, 20), (0.45, 16, 16)):
        pairs = zip(rng.binomial(n, share, 2000), rng.binomial(m, share, 2000), strict=True)
        wrong = np.mean([alike(*difference_of_shares((a, n), (b, m))[1:]) == DISAGREES for a, b in pairs])
        assert wrong < 0.065


def test_the_error_of_a_figure_widens_the_interval_of_the_difference():
    exact, rough = less_figure((0.8, 0.7, 0.9), 0.93, 0.0), less_figure((0.8, 0.7, 0.9), 0.93, 0.045)
    assert exact == pytest.approx((-0.13, -0.23, -0.03))
    assert rough[1] < exact[1]
    assert rough[2] > 0 > exact[2]  # the paper's own error takes the disagreement away
    assert share_error(1.0, 48) == pytest.approx(share_error(1 - 0.5 / 48, 48))


def test_parts_that_hold_together_disagree_no_more_often_than_one():
    rng = np.random.default_rng(1)
    wrong = 0
    for _ in range(1000):
        parts = {}
        for name in "abc":
            sample = rng.normal(0.0, 1.0, 40)
            parts[name] = spread(
                sample.mean(), [sample[rng.integers(0, 40, 40)].mean() for _ in range(50)], together(3)
            )
        wrong += parts_larger("all above", "", parts).verdict == DISAGREES
    assert wrong / 1000 < 0.05


def test_looks_at_one_mine_are_one():
    rng = np.random.default_rng(2)
    level = rng.normal(0, 1, 30)
    looks = np.repeat(level, 10) + rng.normal(0, 0.1, 300)
    _, low, high = clustered(looks, np.repeat(np.arange(30), 10), 2000)
    _, narrow_low, narrow_high = clustered(looks, np.arange(300), 2000)
    assert high - low > 2.5 * (narrow_high - narrow_low)
    assert larger(low, high) != larger(5.0, 6.0)


def test_what_chance_gives_is_said_of_the_statements_that_are_judged():
    made = [Finding(f"s{i}", "", "", AGREES, interval=(1.0, 0.5, 1.5)) for i in range(29)]
    assert by_chance([*made, Finding("q", "", "", OPEN)]) == (29, pytest.approx(1.45), 4)
    assert by_chance([]) == (0, 0.0, 0)
