import numpy as np
import pytest
from scipy import special, stats

from flgpr.scoring import clopper_pearson, poisson_interval


def test_clopper_pearson_bounds_leave_half_the_error_on_each_side():
    k = np.arange(1, 12)
    low, high = clopper_pearson(k, 12, 0.9)
    assert stats.binom.sf(k - 1, 12, low) == pytest.approx(0.05)
    assert stats.binom.cdf(k[:-1], 12, high[:-1]) == pytest.approx(0.05)
    assert clopper_pearson([0, 12], 12)[0][0] == 0
    assert clopper_pearson([0, 12], 12)[1][1] == 1
    assert clopper_pearson(0, 0) == (0, 1)


def test_poisson_bounds_leave_half_the_error_on_each_side():
    n = np.arange(0, 40)
    low, high = poisson_interval(n, 200.0, 0.9)
    assert stats.poisson.cdf(n, 200 * high) == pytest.approx(0.05)
    assert stats.poisson.sf(n[1:] - 1, 200 * low[1:]) == pytest.approx(0.05)
    assert low[0] == 0


def test_poisson_bounds_of_long_curves_equal_the_plain_inversion():
    n = np.arange(0, 60_000, 3)
    low, high = poisson_interval(n)
    assert low[1:] == pytest.approx(special.gammaincinv(n[1:], 0.025), rel=1e-11)
    assert high == pytest.approx(special.gammaincinv(n + 1, 0.975), rel=1e-11)


@pytest.mark.parametrize("p", [0.05, 0.5, 0.9, 0.99])
@pytest.mark.parametrize("n", [5, 12, 50])
def test_clopper_pearson_covers_at_least_nominally(n, p):
    """The coverage is a finite sum over the outcomes: no simulation is needed."""
    k = np.arange(n + 1)
    low, high = clopper_pearson(k, n)
    assert stats.binom.pmf(k, n, p)[(low <= p) & (p <= high)].sum() >= 0.95


@pytest.mark.parametrize("mean", [0.1, 1.0, 3.7, 40.0])
def test_poisson_interval_covers_at_least_nominally(mean):
    n = np.arange(400)
    low, high = poisson_interval(n)
    assert stats.poisson.pmf(n, mean)[(low <= mean) & (mean <= high)].sum() >= 0.95


def test_bad_arguments_are_named():
    with pytest.raises(ValueError, match="level must lie between"):
        clopper_pearson(1, 2, 95)
    with pytest.raises(ValueError, match="successes must lie"):
        clopper_pearson(3, 2)
    with pytest.raises(ValueError, match="count must not"):
        poisson_interval(-1)
    with pytest.raises(ValueError, match="exposure must be positive"):
        poisson_interval(1, 0)
