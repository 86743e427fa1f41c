"""What flsar2004 found, as numbers with intervals and rules that were set before the numbers."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from flgpr.features import max_correlation, mean_template, principal_templates
from flgpr.scoring import clopper_pearson, example_roc
from flgpr_papers.flsar2004.examples import HeldOut
from flgpr_papers.kit.findings import Interval

FloatArray = NDArray[np.float64]


def roc(scores: HeldOut, area: float, n_targets: int | None = None) -> pd.DataFrame:
    """ROC of held-out scores; the false alarms of a novelty detector are divided by its folds."""
    values = np.concatenate([scores.mine, scores.clutter.ravel()])
    mine = np.repeat([True, False], [scores.mine.size, scores.clutter.size])
    return example_roc(values, mine, area, n_targets=n_targets, repeats=scores.clutter.shape[1])


def _wins(scores: HeldOut) -> FloatArray:
    """How often each mine scores higher than each clutter example; ties are worth one half."""
    above = scores.mine[:, None, None] > scores.clutter[None]
    equal = scores.mine[:, None, None] == scores.clutter[None]
    return np.asarray((above + 0.5 * equal).mean(axis=2))


def auc(scores: HeldOut) -> float:
    """Area under the ROC: how often a mine scores higher than clutter."""
    return float(_wins(scores).mean())


def _draws(scores: HeldOut, count: int, seed: int) -> tuple[FloatArray, FloatArray]:
    """Bootstrap weights of mines (both drives over a mine together) and clutter, shape (count, n)."""
    rng = np.random.default_rng(seed)
    names, code = np.unique(scores.target, return_inverse=True)
    mines = rng.multinomial(len(names), np.full(len(names), 1 / len(names)), count)[:, code]
    m = len(scores.tile)
    return mines.astype(float), rng.multinomial(m, np.full(m, 1 / m), count).astype(float)


def _resampled(scores: HeldOut, count: int, seed: int) -> FloatArray:
    mines, clutter = _draws(scores, count, seed)
    total = np.einsum("bi,ij,bj->b", mines, _wins(scores), clutter, optimize=True)
    return np.asarray(total / (mines.sum(axis=1) * clutter.sum(axis=1)))


def auc_interval(scores: HeldOut, count: int) -> Interval:
    """Area with its bootstrap interval over mines and clutter examples."""
    low, high = np.quantile(_resampled(scores, count, 1), (0.025, 0.975))
    return auc(scores), float(low), float(high)


def auc_difference(a: HeldOut, b: HeldOut, count: int) -> Interval:
    """Difference of two areas; drawn together where both scored the same examples, else independently."""
    paired = np.array_equal(a.target, b.target) and a.tile.size == b.tile.size
    draws = _resampled(a, count, 1) - _resampled(b, count, 1 if paired else 2)
    low, high = np.quantile(draws, (0.025, 0.975))
    return auc(a) - auc(b), float(low), float(high)


def proportion(successes: int, trials: int) -> Interval:
    """Proportion with its exact interval."""
    low, high = clopper_pearson(successes, trials)
    return successes / trials, float(low), float(high)


def pd_count(scores: HeldOut, area: float, far: float, chosen: NDArray[np.bool_]) -> tuple[int, int]:
    """Count the chosen mines that are found at an allowed FAR."""
    curve = roc(scores, area)
    threshold = curve["threshold"].to_numpy()[np.searchsorted(curve["far"].to_numpy(), far, side="right") - 1]
    return int((scores.mine[chosen] >= threshold).sum()), int(chosen.sum())


def ratio_interval(a: FloatArray, b: FloatArray) -> Interval:
    """Ratio of two mean shares of kept vectors, with the range of the folds' own ratios that holds 95 % of them."""
    low, high = np.quantile(a / b, (0.025, 0.975))
    return float(a.mean() / b.mean()), float(low), float(high)


def component_interval(chips: NDArray[Any], count: int) -> tuple[Interval, Interval]:
    """Energy of the first principal component and its cosine with the mean template, over bootstrap draws of mines.

    ``chips`` (n, polarization, range, y, x); both are means over polarizations and ranges.
    """
    rng = np.random.default_rng(3)

    def both(images: NDArray[Any]) -> tuple[float, float]:
        shares, cosines = [], []
        for p, r in np.ndindex(*images.shape[1:3]):
            component, share = principal_templates(images[:, p, r], 1)
            shares.append(share[0])
            cosines.append(abs(float((component[0] * mean_template(images[:, p, r])).sum())))
        return float(np.mean(shares)), float(np.mean(cosines))

    draws = np.array([both(chips[rng.integers(0, len(chips), len(chips))]) for _ in range(min(count, 100))])
    low, high = np.quantile(draws, (0.025, 0.975), axis=0)
    value = both(chips)
    return (value[0], float(low[0]), float(high[0])), (value[1], float(low[1]), float(high[1]))


def likeness_interval(a: NDArray[Any], b: NDArray[Any], count: int) -> Interval:
    """Largest correlation of two sites' mean templates, mean over polarizations and ranges, bootstrapped over mines."""
    rng = np.random.default_rng(4)

    def likeness(u: NDArray[Any], v: NDArray[Any]) -> float:
        s, t = mean_template(u), mean_template(v)
        return float(np.mean([max_correlation(s[p, r], t[p, r]) for p, r in np.ndindex(*s.shape[:2])]))

    draws = [
        likeness(a[rng.integers(0, len(a), len(a))], b[rng.integers(0, len(b), len(b))]) for _ in range(min(count, 100))
    ]
    low, high = np.quantile(draws, (0.025, 0.975))
    return likeness(a, b), float(low), float(high)
