"""Effects with intervals from worlds: against closed forms, other code, and their own promise to cover."""

import numpy as np
import pandas as pd
import pytest
from scipy.special import expit, logit
from scipy.stats import linregress, ttest_rel

from worlds.effects import block_differences, fit_means, fit_shares

pytestmark = pytest.mark.slow("studies of papers")


def test_a_single_share_is_that_of_the_jeffreys_penalty():
    """Firth 1993: for one binomial sample half a target is added to either side."""
    found = np.array([3, 4, 3])
    count = np.array([14, 14, 14])
    fit = fit_shares(np.ones((3, 1)), found, count)
    assert fit.value([1.0])[0] == pytest.approx((10 + 0.5) / (42 + 1))
    assert fit.dispersion == 1.0  # the worlds differ less than by chance


def test_shares_of_none_and_all_stay_finite():
    matrix = np.repeat([[1.0, -1.0], [1.0, 1.0]], 4, axis=0)
    fit = fit_shares(matrix, [0] * 4 + [14] * 4, [14] * 8)
    low = fit.value([1, -1])
    high = fit.value([1, 1])
    assert 0 < low[1] < low[0] < low[2] < 0.25
    assert high[0] == pytest.approx(1 - low[0])
    assert fit.difference([1, 1], [1, -1])[1] > 0.8
    assert fit.p_value(slice(1, 2)) < 0.01


def test_intervals_cover_though_mines_of_a_world_share_their_ground():
    rng = np.random.default_rng(5)
    matrix = np.repeat([[1.0, -1.0], [1.0, 1.0]], 12, axis=0)
    truth = np.array([logit(0.4), 0.5])
    covered = 0
    binomial = 0
    for _ in range(300):
        share = expit(matrix @ truth + rng.normal(0, 1.0, 24))
        fit = fit_shares(matrix, rng.binomial(14, share), 14)
        _, low, high = fit.linear([0, 1.0])
        middle = (low + high) / 2
        narrow = (high - low) / 2 / np.sqrt(fit.dispersion)
        expected = (
            0.5 * 0.87
        )  # what is left of a slope when it is averaged over worlds of 1 logit spread
        covered += low <= expected <= high
        binomial += abs(middle - expected) <= narrow
    assert covered >= 273  # 95 % of 300 less three standard errors
    assert binomial < 250


def test_means_are_least_squares_and_worlds_without_a_number_are_left_out():
    x = np.arange(8.0)
    y = 2 + 0.5 * x + np.random.default_rng(3).normal(0, 0.1, 8)
    matrix = np.column_stack([np.ones(9), np.append(x, 4.0)])
    fit = fit_means(matrix, np.append(y, np.nan))
    other = linregress(x, y)
    slope, low, high = fit.linear([0.0, 1.0])
    assert slope == pytest.approx(other.slope)
    assert (high - low) / 2 == pytest.approx(
        2.4469 * other.stderr, rel=1e-3
    )  # Student's t, six degrees of freedom
    assert fit.difference([1, 3], [1, 1]) == pytest.approx(fit.linear([0, 2]))


def test_effects_that_cannot_be_told_apart_are_refused():
    with pytest.raises(ValueError, match="full rank, got 4 x 2, rank 1"):
        fit_means(np.ones((4, 2)), np.arange(4.0))
    with pytest.raises(ValueError, match="more rows than columns"):
        fit_shares(np.eye(2), [1, 2], [3, 3])


def test_two_roads_are_compared_as_by_a_paired_t_test():
    values = pd.DataFrame({"nothing": [0.5, 0.6, 0.9, 0.7], "holes": [0.4, 0.3, 0.8, 0.7]})
    row = block_differences(values, "nothing").iloc[0]
    other = ttest_rel(values["holes"], values["nothing"])
    interval = other.confidence_interval(0.95)
    assert (row["difference"], row["low"], row["high"]) == pytest.approx((-0.125, *interval))
    assert not row["clear"]


def test_intervals_of_many_roads_share_their_error_and_clear_ones_hold_together():
    rng = np.random.default_rng(8)
    base = rng.normal(0, 5, (4, 1))  # what replicates have in common costs nothing
    values = pd.DataFrame(base + rng.normal(0, 0.1, (4, 9)), columns=list("abcdefghi"))
    values["d"] -= 2
    found = block_differences(values, "a").set_index("change")
    assert found.index[found["clear"]].tolist() == ["d"]
    assert found.loc["d", "high"] < -1.7
    assert np.ptp(found["high"] - found["low"]) == pytest.approx(0, abs=1e-12)
    wrong = 0
    for _ in range(300):
        wrong += block_differences(
            pd.DataFrame(rng.normal(0, 1, (4, 9))).rename(columns={0: "a"}), "a"
        )["clear"].any()
    assert wrong <= 27  # 5 % of 300 and three standard errors


def test_one_replicate_has_no_interval():
    row = block_differences(pd.DataFrame({"a": [1.0], "b": [2.0]}), "a").iloc[0]
    assert (row["difference"], row["low"], row["high"], row["clear"]) == (
        1.0,
        -np.inf,
        np.inf,
        False,
    )
    with pytest.raises(ValueError, match="values must hold 'c' and another column, got a, b"):
        block_differences(pd.DataFrame({"a": [1.0], "b": [2.0]}), "c")
