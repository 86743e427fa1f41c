"""Two detectors on the same lanes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy import stats

from flgpr.scoring.bootstrap import make_design, make_scores, tails
from flgpr.scoring.chance_level import chance
from flgpr.scoring.curve import pd_mean_by_chance
from flgpr.scoring.lane_roc import AreaRule, roc_of
from flgpr.scoring.matching import Match, Subset, select_targets

_ENUMERATED = 20  # signs; a million sums
_FLIPS = 100_000


@dataclass(frozen=True)
class Comparison:
    """Paired comparison of two detectors A and B."""

    #: pd_mean_a, pd_mean_b: their PD_mean
    pd_mean_a: float
    pd_mean_b: float
    difference: float  #: A less B
    #: low, high: bootstrap interval of the difference; targets, lanes and stretches of lane drawn alike for both
    low: float
    high: float
    #: two-sided p of the sign-flip test on what each mine adds to PD_mean; the false alarms are taken as given
    p_value: float
    enumerated: bool  #: whether all signs were tried; otherwise 100,000 random ones, with the p that stays valid then
    far: float  #: operating point of the test on detections, per m²
    #: only_a, only_b: mines found there by one alone, or in more passes than by the other
    only_a: int
    only_b: int
    p_detections: float  #: two-sided p of the exact binomial test on these (McNemar)
    n_targets: int  #: number of targets
    #: chance_a, chance_b: PD_mean that each one's false alarms give by chance, see :func:`flgpr.scoring.chance`
    chance_a: float
    chance_b: float


def compare(
    first: Match,
    second: Match,
    subset: Subset = None,
    *,
    far_max: float = 0.1,
    far: float = 0.01,
    area: AreaRule = "union",
    frame_area: float | None = None,
    level: float = 0.95,
    draws: int = 1000,
    seed: int = 0,
    block: float = 10.0,
    cluster: str | None = None,
) -> Comparison:
    """Compare two detectors' alarms on the same lanes and targets.

    Parameters
    ----------
    first, second : Match
        Alarms of detector A and B, matched to the same truth with the same lanes and halo.
    far_max : float
        End of the averaging of PD_mean, per m².
    far : float
        Operating point for the comparison of detections, per m².
    subset, area, frame_area, level, draws, seed, block, cluster
        As for :func:`flgpr.scoring.band`.
    """
    _check_pair(first, second)
    design = make_design(first, subset, block=block, cluster=cluster, area=area, frame_area=frame_area)
    a, b = make_scores(first, design, subset), make_scores(second, design, subset)
    ones = np.ones(len(design.block_lane))
    share_a, share_b = a.shares(far_max, ones, design.area), b.shares(far_max, ones, design.area)
    rng = np.random.default_rng(seed)
    gaps = np.empty(draws)
    for number in range(draws):
        target, weight = design.draw(rng)
        drawn = float((weight * design.block_area).sum())
        gap = a.shares(far_max, weight, drawn) - b.shares(far_max, weight, drawn)
        gaps[number] = (target * gap).sum() / target.sum()
    low, high = np.quantile(gaps, tails(level, design.clusters))
    by_mine = np.bincount(design.target_cluster, weights=share_a - share_b)
    p_value, enumerated = sign_flip_test(by_mine, seed)
    found_a, found_b = (~np.isneginf(s.target) & (s.above / design.area <= far) for s in (a, b))
    # Looks at one mine are no independent trials: a mine counts once, for the detector that finds it more often.
    lead = np.bincount(design.target_cluster, weights=found_a.astype(float) - found_b.astype(float))
    only_a, only_b = int((lead > 0).sum()), int((lead < 0).sum())
    return Comparison(
        float(share_a.mean()), float(share_b.mean()), float((share_a - share_b).mean()), float(low), float(high),
        p_value, enumerated, far, only_a, only_b, mcnemar_test(only_a, only_b),
        int(select_targets(first.truth, subset).sum()),
        *(_pd_mean_by_chance(one, subset, far_max, seed, area=area, frame_area=frame_area) for one in (first, second)),
    )  # fmt: skip


def _pd_mean_by_chance(matched: Match, subset: Subset, far_max: float, seed: int, **area: Any) -> float:
    return pd_mean_by_chance(chance(matched, seed=seed).beside(roc_of(matched, subset, **area), subset), far_max)


def sign_flip_test(differences: ArrayLike, seed: int = 0) -> tuple[float, bool]:
    """Test whether paired differences, one per mine, are symmetric about zero, by flipping their signs.

    It gives the two-sided p and whether all signs were tried; for more than 20 differences that are not zero, signs are
    drawn with the seed.

    Examples
    --------
    >>> from flgpr.scoring import sign_flip_test
    >>> p, exact = sign_flip_test([0.2, 0.1, 0.4, 0.3, 0.2])
    >>> round(p, 4), exact  # all five of one sign: 2 of 2^5
    (0.0625, True)
    """
    values = np.asarray(differences, dtype=np.float64)
    sizes = np.abs(values[values != 0])
    # Sums of equal size may differ in the last digits; they count as ties.
    limit = abs(float(values.sum())) - 1e-12 * float(sizes.sum())
    if len(sizes) <= _ENUMERATED:
        sums = np.zeros(1)
        for size in sizes:
            sums = np.concatenate([sums + size, sums - size])
        return float((np.abs(sums) >= limit).mean()), True
    rng = np.random.default_rng(seed)
    count = 0
    for _ in range(10):
        signs = rng.integers(0, 2, size=(_FLIPS // 10, len(sizes))) * 2 - 1
        count += int((np.abs(signs @ sizes) >= limit).sum())
    return (count + 1) / (_FLIPS + 1), False


def mcnemar_test(only_a: int, only_b: int) -> float:
    """Test whether two detectors find equally many targets, on those one alone finds (McNemar, exact; two-sided p).

    Examples
    --------
    Nine mines that one detector alone finds against two that the other alone finds:

    >>> from flgpr.scoring import mcnemar_test
    >>> round(mcnemar_test(9, 2), 3)
    0.065
    """
    total = only_a + only_b
    return float(stats.binomtest(only_a, total).pvalue) if total else 1.0


def _check_pair(first: Match, second: Match) -> None:
    same_truth = first.truth[["target_id", "x", "y"]].equals(second.truth[["target_id", "x", "y"]])
    same_truth = same_truth and np.array_equal(first.target_lane, second.target_lane)
    if not same_truth or first.lanes != second.lanes or first.halo != second.halo:
        raise ValueError("first and second must be matched to the same truth, lanes and halo, in the same order")
