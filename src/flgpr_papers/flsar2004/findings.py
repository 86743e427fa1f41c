"""What flsar2004 found, as numbers with intervals and rules that were set before the numbers."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from flgpr.features import max_correlation, mean_template, principal_templates
from flgpr.scoring import clopper_pearson, example_roc
from flgpr_papers.flsar2004.machines import HeldOut
from flgpr_papers.kit.findings import Interval

FloatArray = NDArray[np.float64]
FAR_LIMIT = 0.07
"""False alarms per m² up to which areas are taken.

The paper compares its ROCs at 0.04 to 0.07 (par. 50).
"""
_CHUNK = 50  # bootstrap draws at a time


def roc(scores: HeldOut, area: float, n_targets: int | None = None) -> pd.DataFrame:
    """ROC of held-out scores; the false alarms of a novelty detector are divided by its folds."""
    values = np.concatenate([scores.mine, scores.clutter.ravel()])
    is_mine = np.repeat([True, False], [scores.mine.size, scores.clutter.size])
    return example_roc(values, is_mine, area, n_targets=n_targets, repeats=scores.clutter.shape[1])


def _wins(scores: HeldOut) -> FloatArray:
    """How often each mine scores higher than each clutter example; ties are worth one half."""
    above = scores.mine[:, None, None] > scores.clutter[None]
    equal = scores.mine[:, None, None] == scores.clutter[None]
    return np.asarray((above + 0.5 * equal).mean(axis=2))


def auc(scores: HeldOut) -> float:
    """Area under the ROC: how often a mine scores higher than clutter."""
    return float(_wins(scores).mean())


def _draws(scores: HeldOut, count: int, seed: int) -> tuple[FloatArray, FloatArray]:
    """Return bootstrap weights of mines and clutter, shape (count, n).

    Both drives over a mine are drawn together.
    """
    rng = np.random.default_rng(seed)
    names, code = np.unique(scores.target, return_inverse=True)
    mines = rng.multinomial(len(names), np.full(len(names), 1 / len(names)), count)[:, code]
    m = len(scores.tile)
    return mines.astype(float), rng.multinomial(m, np.full(m, 1 / m), count).astype(float)


def auc_interval(scores: HeldOut, count: int) -> Interval:
    """Area under the whole ROC with its bootstrap interval over mines and clutter examples."""
    mines, clutter = _draws(scores, count, 1)
    total = np.einsum("bi,ij,bj->b", mines, _wins(scores), clutter, optimize=True)
    low, high = np.quantile(total / (mines.sum(axis=1) * clutter.sum(axis=1)), (0.025, 0.975))
    return auc(scores), float(low), float(high)


@dataclass(frozen=True)
class Measure:
    """A number of the ROC at few false alarms: mean Pd up to ``far`` per m², or Pd at it."""

    area: float  #: searched, m²
    far: float = FAR_LIMIT
    #: whether Pd at ``far``, else the mean over 0 to ``far``: the partial area over its width
    at: bool = False

    def chance(self, scores: HeldOut) -> float:
        """Return the value of scores that know nothing of the mines."""
        most = len(scores.tile) / self.area
        if self.at:
            return min(self.far / most, 1.0)
        return self.far / most / 2 if self.far <= most else 1 - most / self.far / 2

    def of(self, scores: HeldOut, mines: FloatArray, tiles: FloatArray) -> FloatArray:
        """Return the number (draw,) for weights of mines (draw, n) and of clutter (draw, m).

        The clutter's outputs are gone through from the strongest; each is a false alarm for its
        weight, and Pd is the weight of the mines above it. The outputs of a novelty detector's
        folds share the allowed false alarms.
        """
        repeats = scores.clutter.shape[1]
        allowed = self.far * self.area * repeats
        order = np.argsort(-scores.clutter.ravel(), kind="stable")
        order = order[: int(4 * allowed) + 20 * repeats]  # a draw leaves out a third of them
        output = scores.clutter.ravel()[order]
        tile = order // repeats
        above = (scores.mine[:, None] > output).astype(float)
        above += 0.0 if self.at else 0.5 * (scores.mine[:, None] == output)
        share = mines / mines.sum(axis=1, keepdims=True)
        found_without_limit = share @ np.isfinite(scores.mine)
        values = np.empty(len(mines))
        for begin in range(0, len(mines), _CHUNK):
            rows = slice(begin, begin + _CHUNK)
            reached = np.cumsum(tiles[rows][:, tile], axis=1)
            pd_above = share[rows] @ above
            if self.at:
                first = np.argmax(reached > allowed, axis=1)
                never = reached[:, -1] <= allowed
                interpolated = pd_above[np.arange(len(first)), first]
                values[rows] = np.where(never, found_without_limit[rows], interpolated)
            else:
                taken = np.diff(np.minimum(reached, allowed), prepend=0.0, axis=1)
                rest = np.maximum(allowed - reached[:, -1], 0.0)
                values[rows] = (
                    (taken * pd_above).sum(axis=1) + rest * found_without_limit[rows]
                ) / allowed
        return values

    def value(self, scores: HeldOut) -> float:
        """Return the number of the scores as they are."""
        return float(
            self.of(scores, np.ones((1, scores.mine.size)), np.ones((1, len(scores.tile))))[0]
        )

    def interval(self, scores: HeldOut, count: int) -> Interval:
        """Return the number with its bootstrap interval over mines and clutter examples.

        Both looks at a mine are drawn together.
        """
        low, high = np.quantile(self.of(scores, *_draws(scores, count, 1)), (0.025, 0.975))
        return self.value(scores), float(low), float(high)


def difference(a: HeldOut, b: HeldOut, measure: Measure, count: int) -> Interval:
    """Return a's number less b's.

    Mines and clutter are drawn together where both scored the same, else apart.
    """
    same_mines = np.array_equal(a.target, b.target)
    same_clutter = a.tile.size == b.tile.size
    first = _draws(a, count, 1)
    mines, tiles = _draws(b, count, 2)
    second = first if same_mines and same_clutter else (first[0] if same_mines else mines, tiles)
    draws = measure.of(a, *first) - measure.of(b, *second)
    low, high = np.quantile(draws, (0.025, 0.975))
    return measure.value(a) - measure.value(b), float(low), float(high)


def proportion(successes: int, trials: int) -> Interval:
    """Proportion with its exact interval."""
    low, high = clopper_pearson(successes, trials)
    return successes / trials, float(low), float(high)


def pd_count(
    scores: HeldOut, area: float, far: float, chosen: NDArray[np.bool_]
) -> tuple[int, int]:
    """Count the chosen mines that are found at an allowed FAR."""
    curve = roc(scores, area)
    threshold = curve["threshold"].to_numpy()[
        np.searchsorted(curve["far"].to_numpy(), far, side="right") - 1
    ]
    return int((scores.mine[chosen] >= threshold).sum()), int(chosen.sum())


def ratio_interval(a: FloatArray, b: FloatArray) -> Interval:
    """Return the ratio of two mean shares of kept vectors, with its range.

    The range holds 95 % of the folds' own ratios.
    """
    low, high = np.quantile(a / b, (0.025, 0.975))
    return float(a.mean() / b.mean()), float(low), float(high)


def spread_of_folds(shares: FloatArray) -> Interval:
    """Mean share of kept vectors, with the range of the folds that holds 95 % of them."""
    low, high = np.quantile(shares, (0.025, 0.975))
    return float(shares.mean()), float(low), float(high)


def stronger_interval(a: pd.DataFrame, b: pd.DataFrame, count: int) -> Interval:
    """Share of pairs of one mine of each table, at the same depth, in which the first is stronger.

    Tables of ``peak``, ``depth`` and ``target``; bootstrapped over targets.
    """
    rng = np.random.default_rng(5)

    def draw(table: pd.DataFrame) -> pd.DataFrame:
        names = table["target"].unique()
        return pd.concat([table[table["target"] == name] for name in rng.choice(names, len(names))])

    def share(table: pd.DataFrame, other: pd.DataFrame) -> float:
        wins = pairs = 0.0
        for depth in np.intersect1d(table["depth"], other["depth"]):
            u = table.loc[table["depth"] == depth, "peak"].to_numpy()
            v = other.loc[other["depth"] == depth, "peak"].to_numpy()
            wins += (u[:, None] > v).sum() + 0.5 * (u[:, None] == v).sum()
            pairs += u.size * v.size
        return wins / pairs if pairs else float("nan")

    draws = [share(draw(a), draw(b)) for _ in range(min(count, 200))]
    low, high = np.nanquantile(draws, (0.025, 0.975))
    return share(a, b), float(low), float(high)


def component_interval(chips: NDArray[Any], count: int) -> tuple[Interval, Interval]:
    """Return the first principal component's energy and its cosine with the mean template.

    Mines are drawn anew in every bootstrap draw.

    ``chips`` (n, polarization, range, y, x); both are means over polarizations and ranges.
    """
    rng = np.random.default_rng(3)

    def both(images: NDArray[Any]) -> tuple[float, float]:
        shares = []
        cosines = []
        for p, r in np.ndindex(*images.shape[1:3]):
            component, share = principal_templates(images[:, p, r], 1)
            shares.append(share[0])
            cosines.append(abs(float((component[0] * mean_template(images[:, p, r])).sum())))
        return float(np.mean(shares)), float(np.mean(cosines))

    draws = np.array(
        [both(chips[rng.integers(0, len(chips), len(chips))]) for _ in range(min(count, 100))]
    )
    low, high = np.quantile(draws, (0.025, 0.975), axis=0)
    value = both(chips)
    return (value[0], float(low[0]), float(high[0])), (value[1], float(low[1]), float(high[1]))


def likeness_interval(a: NDArray[Any], b: NDArray[Any], count: int) -> Interval:
    """Return the largest correlation of two sites' mean templates.

    It is the mean over polarizations and ranges, bootstrapped over mines.
    """
    rng = np.random.default_rng(4)

    def likeness(u: NDArray[Any], v: NDArray[Any]) -> float:
        s = mean_template(u)
        t = mean_template(v)
        return float(
            np.mean([max_correlation(s[p, r], t[p, r]) for p, r in np.ndindex(*s.shape[:2])])
        )

    draws = [
        likeness(a[rng.integers(0, len(a), len(a))], b[rng.integers(0, len(b), len(b))])
        for _ in range(min(count, 100))
    ]
    low, high = np.quantile(draws, (0.025, 0.975))
    return likeness(a, b), float(low), float(high)
