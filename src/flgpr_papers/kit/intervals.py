"""Intervals of 95 % of the numbers that statements are judged by.

What belongs together is drawn or counted together: looks within a seed or at a mine, the numbers of
one experiment of several. No interval is narrower than so many clusters support.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import ndtri, stdtrit

from flgpr.scoring import clopper_pearson, paired_interval
from flgpr.types import floats

Interval = tuple[float, float, float]
"""A value and the ends of its 95 % interval."""
Bounds = tuple[float, float]
"""The least and the largest value that a quantity can have."""
SHARE: Bounds = (0.0, 1.0)
"""Bounds of a probability or any other share, such as Pd, PD_mean or an area under a ROC."""
SHARE_DIFFERENCE: Bounds = (-1.0, 1.0)
"""Bounds of the difference of two shares."""
Z = 1.959964
"""97.5 % point of the normal distribution: an interval of 95 % has two sides."""
LEAST_CORRELATION = 0.1
"""Correlation of looks within a cluster that is assumed at least.

With it, intervals from 12 clusters hold shares from 0.5 to 0.999 in 19 of 20 simulated samples or
more where the looks are correlated by up to 0.1, and in 9 of 10 at 0.3; without it in half of them.
"""


def students(values: ArrayLike, level: float = 0.95, bounds: Bounds | None = None) -> Interval:
    """Return the mean of independent values and Student's interval; values of NaN are left out.

    Equal values, or a single one, have no spread to tell from: the ends are infinite. A share has
    :func:`share_of_looks` in place of it.

    Parameters
    ----------
    values : (n,) array_like
        A value for each seed or experiment.
    level : float
        Probability of the interval.
    bounds : Bounds, optional
        Bounds of the values, at which the interval is cut.
    """
    sample = floats(values)
    sample = sample[~np.isnan(sample)]
    mean = float(sample.mean()) if sample.size else math.nan
    if sample.size < 2 or np.ptp(sample) == 0:
        return mean, -math.inf, math.inf
    error = float(sample.std(ddof=1)) / math.sqrt(sample.size)
    half = float(stdtrit(sample.size - 1, (1 + level) / 2)) * error
    return clip((mean, mean - half, mean + half), bounds)


def intracluster(table: ArrayLike) -> float:
    """Return the correlation of looks within a cluster, from 0 to 1, by analysis of variance.

    Parameters
    ----------
    table : (cluster, look) array_like
        A value of every look, such as 1 where it was found. Where none differs from another it
        tells nothing, and 0 is returned.
    """
    values = floats(table)
    clusters, looks = values.shape
    means = values.mean(axis=1)
    between = looks * means.var(ddof=1)
    within = ((values - means[:, None]) ** 2).sum() / (clusters * max(looks - 1, 1))
    total = between + (looks - 1) * within
    return float(np.clip((between - within) / total, 0.0, 1.0)) if total > 0 else 0.0


def effective_looks(table: ArrayLike, level: float = 0.95) -> float:
    """Return how many independent looks the looks of a table are worth.

    It is their number over the design effect ``1 + (looks - 1) correlation`` (Kish 1965, Survey
    Sampling), times ``(z / t)²`` with Student's t of the number of clusters less one, because the
    effect is known from so few clusters (Korn & Graubard 1998). An interval is then no narrower
    than that many clusters support. Near 0 and 1 the looks do not tell how they depend on each
    other: the correlation is taken for ``LEAST_CORRELATION`` at least.

    Parameters
    ----------
    table : (cluster, look) array_like
        A value of every look.
    level : float
        Probability of the interval that they are for.

    Raises
    ------
    ValueError
        If there is a single cluster.
    """
    values = floats(table)
    clusters, looks = values.shape
    if clusters < 2:
        raise ValueError(f"table must have at least two clusters, got {clusters}")
    correlation = max(LEAST_CORRELATION, intracluster(values))
    t = float(stdtrit(clusters - 1, (1 + level) / 2))
    z = float(ndtri((1 + level) / 2))
    return clusters * looks / (1 + (looks - 1) * correlation) * (z / t) ** 2


def share_of_looks(found: ArrayLike) -> Interval:
    """Return a share of pooled looks with its interval, of looks that depend within clusters.

    The interval is Clopper's and Pearson's of the effective number of looks (Korn & Graubard 1998,
    Survey Methodology 24, 193), so that none and all have an interval, too, and a single miss among
    many looks changes it little.

    Parameters
    ----------
    found : (cluster, look) array_like
        1 where a look counts, 0 where it does not: a row for each seed.
    """
    table = floats(found)
    share = float(table.mean())
    size = effective_looks(table)
    low, high = clopper_pearson(share * size, size)
    return share, float(low), float(high)


def paired_shares(first: ArrayLike, second: ArrayLike, level: float = 0.95) -> Interval:
    """Return a share less another one of the same looks, with its interval.

    It is Tango's score interval of the looks in which the two differ, which does not shrink to a
    point where they never do, for the effective number of looks.

    Parameters
    ----------
    first, second : (cluster, look) array_like
        1 where a look counts, 0 where it does not, in the same order.
    level : float
        Probability of the interval.
    """
    gap = floats(first) - floats(second)
    size = effective_looks(gap, level)
    more, less = float(np.mean(gap > 0)), float(np.mean(gap < 0))
    low, high = paired_interval(more * size, less * size, size, level)
    return more - less, low, high


def clip(interval: Interval, bounds: Bounds | None) -> Interval:
    """Return an interval cut at the bounds of its value; an infinite end (one sample) stays."""
    if bounds is None:
        return interval
    value, *ends = interval
    low, high = [float(np.clip(end, *bounds)) if math.isfinite(end) else end for end in ends]
    return float(np.clip(value, *bounds)), low, high


def proportion(successes: float, trials: float) -> Interval:
    """Return a proportion with its exact interval (Clopper & Pearson 1934)."""
    low, high = clopper_pearson(successes, trials)
    return successes / trials, float(low), float(high)


def difference_of_shares(first: tuple[int, int], second: tuple[int, int]) -> Interval:
    """Return the difference of two independent shares, with Newcombe's interval.

    Newcombe 1998, method 10, from the Wilson intervals of both.

    Parameters
    ----------
    first, second : tuple of int
        Successes and trials of each.
    """
    return difference_of_means(_wilson(*first), _wilson(*second))


def _wilson(successes: int, trials: int) -> Interval:
    """Return a share with its Wilson interval (Wilson 1927)."""
    p = successes / trials
    centre = (p + Z**2 / (2 * trials)) / (1 + Z**2 / trials)
    half = Z * math.sqrt(p * (1 - p) / trials + Z**2 / (4 * trials * trials)) / (1 + Z**2 / trials)
    return p, centre - half, centre + half


def clustered(
    values: ArrayLike, cluster: Any, draws: int, seed: int = 0, level: float = 0.95
) -> Interval:
    """Return the mean of values with its bootstrap interval, whole clusters drawn together.

    Parameters
    ----------
    values : (n,) array_like
        Values that may depend on each other within a cluster, as looks at one mine do.
    cluster : (n,) array_like
        Cluster of each value.
    draws : int
        Number of bootstrap draws.
    seed : int
        Seed of the draws.
    level : float
        Probability of the interval, by percentiles.

    Returns
    -------
    Interval
        NaN without values.
    """
    data = floats(values)
    if data.size == 0:
        return math.nan, math.nan, math.nan
    code = np.unique(np.asarray(cluster).astype(str), return_inverse=True)[1]
    count = floats(np.bincount(code))
    total = np.bincount(code, weights=data)
    drawn = np.random.default_rng(seed).integers(0, count.size, (draws, count.size))
    means = total[drawn].sum(axis=1) / count[drawn].sum(axis=1)
    return percentiles(data.mean(), means, ((1 - level) / 2, (1 + level) / 2))


def percentiles(
    value: float, draws: ArrayLike, ends: tuple[float, float] = (0.025, 0.975)
) -> Interval:
    """Return a value with the range that holds 95 % of its bootstrap draws that are known."""
    drawn = np.asarray(draws)
    low, high = np.quantile(drawn[~np.isnan(drawn)], ends)
    return float(value), float(low), float(high)


def difference_of_means(first: Interval, second: Interval) -> Interval:
    """Return the difference of two independent means by their intervals.

    The intervals need not be symmetric (Zou & Donner 2008).
    """
    a, a_low, a_high = first
    b, b_low, b_high = second
    gap = a - b
    low = gap - math.hypot(a - a_low, b_high - b)
    high = gap + math.hypot(a_high - a, b - b_low)
    return gap, low, high


def together(parts: int) -> float:
    """Return the level of ``parts`` intervals that all hold with 95 % at least (Bonferroni)."""
    return 1 - 0.05 / parts


def spread(
    value: float, draws: ArrayLike, level: float = 0.95, bounds: Bounds | None = None
) -> Interval:
    """Return Student's interval of a value by the standard deviation of its bootstrap draws.

    A few draws suffice, other than for percentiles. The interval may reach beyond what a share can
    be.

    Parameters
    ----------
    value : float
        The value of the sample itself.
    draws : (n,) array_like
        The same of bootstrap samples.
    level : float
        Probability of the interval.
    bounds : Bounds, optional
        Bounds of the value, at which the interval is cut.
    """
    half = float(stdtrit(np.size(draws) - 1, (1 + level) / 2) * np.std(floats(draws), ddof=1))
    return clip((value, value - half, value + half), bounds)
