"""Two detectors or more on the same lanes, and two analysts who judged the same alarms."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
import scipy  # whose parts load when they are used
from numpy.typing import ArrayLike

from flgpr.scoring.bootstrap import make_design, make_scores, pd_mean_interval, tails
from flgpr.scoring.chance_level import chance
from flgpr.scoring.curve import clopper_pearson, operating_row, pd_mean_by_chance
from flgpr.scoring.lane_roc import AreaRule, assign, roc_of
from flgpr.scoring.lane_score import Rules
from flgpr.scoring.matching import Match, Subset, select_targets

_ENUMERATED = 20  # signs; a million sums
_FLIPS = 100_000
_POINT = (
    "far",
    "far_low",
    "far_high",
    "pd",
    "pd_low",
    "pd_high",
    "n_detected",
    "n_targets",
    "n_false",
    "chance",
)


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
    # : whether all signs were tried; otherwise 100,000 random ones, with the p that stays valid
    # then
    enumerated: bool
    far: float  #: operating point of the test on detections, per m²
    #: only_a, only_b: mines found there by one alone, or in more passes than by the other
    only_a: int
    only_b: int
    p_detections: float  #: two-sided p of the exact binomial test on these (McNemar)
    n_targets: int  #: number of targets
    #: chance_a, chance_b: PD_mean that each one's false alarms give by chance, see :func:`flgpr.scoring.chance`
    chance_a: float
    chance_b: float


@dataclass(frozen=True)
class SideBySide:
    """Two detectors or more on the same targets."""

    #: one row per ``detector`` and ``far_allowed``, per m²: ``far``, ``pd`` with their exact intervals, counts, and the
    #: Pd that ``chance`` gives
    points: pd.DataFrame
    #: one row per pair, ``first`` and ``second``, and ``far_allowed``: ``difference`` of their Pd (first less second)
    #: with ``low`` and ``high`` by :func:`paired_interval`, the targets that one alone finds, ``only_first`` and
    #: ``only_second``, and ``p`` of McNemar's exact test
    pairs: pd.DataFrame
    #: one row per pair: ``pd_mean_a`` of the first with ``low_a`` and ``high_a``, ``pd_mean_b``, their chance,
    #: ``difference`` with interval and ``p_value``, see :class:`Comparison`; None where only points are told
    means: pd.DataFrame | None


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
    design = make_design(
        first, subset, block=block, cluster=cluster, area=area, frame_area=frame_area
    )
    a = make_scores(first, design, subset)
    b = make_scores(second, design, subset)
    ones = np.ones(len(design.block_lane))
    share_a = a.shares(far_max, ones, design.area)
    share_b = b.shares(far_max, ones, design.area)
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
    # Looks at one mine are no independent trials: a mine counts once, for the detector that finds
    # it more often.
    lead = np.bincount(design.target_cluster, weights=found_a.astype(float) - found_b.astype(float))
    only_a = int((lead > 0).sum())
    only_b = int((lead < 0).sum())
    return Comparison(
        float(share_a.mean()), float(share_b.mean()), float((share_a - share_b).mean()), float(low), float(high),
        p_value, enumerated, far, only_a, only_b, mcnemar_test(only_a, only_b),
        int(select_targets(first.truth, subset).sum()),
        *(_pd_mean_by_chance(one, subset, far_max, seed, area=area, frame_area=frame_area) for one in (first, second)),
    )  # fmt: skip


def _pd_mean_by_chance(
    matched: Match, subset: Subset, far_max: float, seed: int, **area: Any
) -> float:
    return pd_mean_by_chance(
        chance(matched, seed=seed).add_chance_column(roc_of(matched, subset, **area), subset),
        far_max,
    )


def sign_flip_test(differences: ArrayLike, seed: int = 0) -> tuple[float, bool]:
    """Test whether paired differences, one per mine, are symmetric about zero, by flipping their signs.

    It gives the two-sided p and whether all signs were tried; for more than 20 differences that are
    not zero, signs are drawn with the seed.

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
    return float(scipy.stats.binomtest(only_a, total).pvalue) if total else 1.0


def paired_interval(
    only_a: int, only_b: int, n_targets: int, level: float = 0.95
) -> tuple[float, float]:
    """Compute an interval of the difference of two detectors' Pd on the same targets, by Tango's score test.

    It is that of Tango (1998, Statistics in Medicine 17, 891), which holds for few targets, too,
    and does not shrink to a point where both find the same.

    Examples
    --------
    >>> import numpy as np
    >>> from flgpr.scoring import paired_interval
    >>> np.round(paired_interval(9, 2, 40), 3).tolist()
    [0.014, 0.339]
    """
    if not 0 < n_targets >= only_a + only_b or min(only_a, only_b) < 0:
        raise ValueError(
            f"only_a and only_b must be counts among n_targets, got {only_a}, {only_b} of {n_targets}"
        )
    z = float(scipy.stats.norm.ppf((1 + level) / 2))
    return _lower_end(only_a, only_b, n_targets, z), -_lower_end(only_b, only_a, n_targets, z)


def side_by_side(
    matches: Mapping[str, Match],
    fars: Sequence[float],
    rules: Rules | None = None,
    means: bool = True,
) -> SideBySide:
    """Set detectors side by side, two or more, at allowed FARs, per m².

    The matches go by the detectors' names and must share truth, lanes and halo. Without ``means`` nothing is told but
    operating points. Intervals and chance are as ``rules`` say.
    """
    rules = rules or Rules()
    if len(matches) < 2:
        raise ValueError(f"matches must be two or more to be compared, got {len(matches)}")
    if not all(len(one.truth) for one in matches.values()):
        raise ValueError(
            "truth must have at least one target for detectors to be compared, got none"
        )
    how: dict[str, Any] = {"area": rules.area, "level": rules.level}
    options: dict[str, Any] = {"far_max": rules.far_max, "draws": rules.draws, "seed": rules.seed}
    points = []
    pairs = []
    mean = []
    spread = {}
    for name, one in matches.items():
        curve = chance(one, rules.shifts, rules.seed).add_chance_column(roc_of(one, **how))
        rows = curve.iloc[operating_row(curve, np.array(fars))].reset_index(drop=True)[list(_POINT)]
        rows.insert(0, "far_allowed", list(fars))
        rows.insert(0, "detector", name)
        points.append(rows)
        if means:
            spread[name] = pd_mean_interval(one, **how, **options)
    for (name, first), (other, second) in itertools.combinations(matches.items(), 2):
        _check_pair(first, second)
        who = {"first": name, "second": other}
        pairs += [who | row for row in _paired_points(first, second, fars, rules)]
        if means:
            found = compare(first, second, **how, **options)
            told = (
                "pd_mean_a",
                "chance_a",
                "pd_mean_b",
                "chance_b",
                "difference",
                "low",
                "high",
                "p_value",
            )
            ends = {
                f"{end}_{which}": float(value)
                for which, one in (("a", name), ("b", other))
                for end, value in zip(("low", "high"), spread[one], strict=True)
            }
            mean.append(who | {key: getattr(found, key) for key in told} | ends)
    table = pd.concat(points, ignore_index=True)
    table.attrs = {}
    return SideBySide(table, pd.DataFrame(pairs), pd.DataFrame(mean) if means else None)


def _paired_points(
    first: Match, second: Match, fars: Sequence[float], rules: Rules
) -> list[dict[str, Any]]:
    """Tell at each FAR how many targets one detector alone finds, and what that says."""
    a, b = (assign(one, rules.area)["far"].to_numpy() for one in (first, second))
    rows = []
    for far in fars:
        only = int(((a <= far) & (b > far)).sum()), int(((b <= far) & (a > far)).sum())
        low, high = paired_interval(*only, len(a), rules.level)
        row = {
            "far_allowed": far,
            "difference": (only[0] - only[1]) / len(a),
            "low": low,
            "high": high,
        }
        rows.append(row | {"only_first": only[0], "only_second": only[1], "p": mcnemar_test(*only)})
    return rows


def _lower_end(more: int, less: int, n: int, z: float) -> float:
    """Find the least difference of two shares that counts of ``more`` and ``less`` among n leave possible."""

    def excess(gap: float) -> float:
        b = (2 * n - more + less) * gap - more - less
        share = (math.sqrt(max(0.0, b * b + 8 * n * less * gap * (1 - gap))) - b) / (
            4 * n
        )  # of those counted as less
        return more - less - n * gap - z * math.sqrt(max(0.0, n * (2 * share + gap * (1 - gap))))

    found = (more - less) / n
    start = (
        found - 1e-10
    )  # at the difference itself the test statistic is zero over zero if nothing differs
    return (
        float(scipy.optimize.brentq(excess, -1.0, start))
        if start > -1 and excess(start) < 0
        else found
    )


def _check_pair(first: Match, second: Match) -> None:
    same_truth = first.truth[["target_id", "x", "y"]].equals(second.truth[["target_id", "x", "y"]])
    same_truth = same_truth and np.array_equal(first.target_lane, second.target_lane)
    if not same_truth or first.lanes != second.lanes or first.halo != second.halo:
        raise ValueError(
            "first and second must be matched to the same truth, lanes and halo, in the same order"
        )


@dataclass(frozen=True)
class Agreement:
    """Agreement of two analysts, and Cohen's kappa: what of it chance does not explain."""

    table: pd.DataFrame  #: counts: verdicts of the first (rows) by those of the second (columns)
    n: int  #: alarms that both judged
    agreed: int  #: alarms that they judged alike
    #: share, share_low, share_high: share of these with its exact interval
    share: float
    share_low: float
    share_high: float
    #: share that analysts with these shares of verdicts would judge alike by chance
    expected: float
    #: kappa, kappa_low, kappa_high: NaN where both gave one and the same verdict throughout: chance explains all of it
    kappa: float
    kappa_low: float
    kappa_high: float


def agreement(
    first: Sequence[str], second: Sequence[str], categories: Sequence[str], level: float = 0.95
) -> Agreement:
    """Compare verdicts of two analysts on the same alarms, in the same order.

    Kappa is that of Cohen 1960, Eq. 1 ("A coefficient of agreement for nominal scales", Educ.
    Psychol. Meas. 20); its interval is the exact one of the agreement with the chance agreement
    taken as given, as there: it covers at least as often as the level says, also where all verdicts
    agree. Verdicts that are no category are a ValueError.

    Examples
    --------
    Of ten alarms, half mines to both, they judge eight alike.

    >>> from flgpr.scoring import agreement
    >>> told = agreement([*"mmmmmccccc"], [*"mmmmcmcccc"], ["m", "c"])
    >>> told.agreed, round(told.kappa, 2), round(told.kappa_low, 2), round(told.kappa_high, 2)
    (8, 0.6, -0.11, 0.95)
    """
    if len(first) != len(second) or not len(first):
        raise ValueError(
            f"verdicts must be of the same alarms, at least one, got {len(first)} and {len(second)}"
        )
    strange = sorted({str(one) for one in [*first, *second] if one not in categories})
    if strange:
        raise ValueError(f"verdicts must be {', '.join(categories)}, got {', '.join(strange)}")
    names = pd.Index(categories)
    counts = np.zeros((len(names), len(names)), dtype=np.int64)
    np.add.at(counts, (names.get_indexer(pd.Index(first)), names.get_indexer(pd.Index(second))), 1)
    n = int(counts.sum())
    agreed = int(np.trace(counts))
    expected = float((counts.sum(axis=0) * counts.sum(axis=1)).sum() / n**2)
    low, high = (float(one) for one in clopper_pearson(agreed, n, level))
    shares = agreed / n, low, high
    kappas = [(one - expected) / (1 - expected) if expected < 1 else np.nan for one in shares]
    return Agreement(pd.DataFrame(counts, names, names), n, agreed, *shares, expected, *kappas)
