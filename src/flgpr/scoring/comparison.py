"""Comparison of two or more detectors on the same lanes, and of two analysts on the same alarms."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd
import scipy  # its subpackages are imported when they are used

from flgpr.scoring.bootstrap import (
    Scores,
    draws_of,
    make_design,
    make_scores,
    pd_mean_interval,
    tails,
)
from flgpr.scoring.chance_level import chance
from flgpr.scoring.curve import clopper_pearson, count_at, operating_row, pd_mean_by_chance
from flgpr.scoring.lane_roc import AreaRule, far_area, roc_of
from flgpr.scoring.lane_score import Rules, curve_by
from flgpr.scoring.matching import Match, Subset, select_targets
from flgpr.types import ArrayLike, Entries, FloatArray, floats

_ENUMERATED = 20  # signs; a million sums
_FLIPS = 100_000
_SURE = 0.05  # p below which two detectors are told apart
_POINT_COLUMNS = (
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


_MEAN_ENTRIES = (
    "pd_mean_a",
    "chance_a",
    "pd_mean_b",
    "chance_b",
    "difference",
    "low",
    "high",
    "p_value",
)


@dataclass(frozen=True)
class Comparison:
    """Paired comparison of two detectors A and B."""

    #: pd_mean_a, pd_mean_b: their PD_mean
    pd_mean_a: float
    pd_mean_b: float
    difference: float  #: A less B
    #: low, high: bootstrap interval of the difference; targets, lanes and stretches of lane are
    #: drawn alike for both
    low: float
    high: float
    #: two-sided p of the sign-flip test on what each mine adds to PD_mean, for these false alarms
    p_value: float
    #: whether all signs were tried; otherwise 100,000 random ones, with the p that stays valid then
    enumerated: bool
    far: float  #: operating point of the test on detections, per m²
    #: only_a, only_b: mines found there by one alone, or in more passes than by the other
    only_a: int
    only_b: int
    p_detections: float  #: two-sided p of the exact binomial test on these (McNemar)
    n_targets: int  #: number of targets
    #: chance_a, chance_b: PD_mean that the false alarms of each give by chance, see
    #: :func:`flgpr.scoring.chance`
    chance_a: float
    chance_b: float


@dataclass(frozen=True)
class SideBySide:
    """Two or more detectors on the same targets."""

    #: one row per ``detector`` and ``far_allowed``, per m²: ``far``, ``pd`` with their exact
    #: intervals, counts, and the Pd that ``chance`` gives
    points: pd.DataFrame
    #: one row per pair, ``first`` and ``second``, and ``far_allowed``: ``difference`` of their Pd
    #: (first less second) with ``low`` and ``high`` by :func:`paired_interval`, the targets that
    #: one alone finds, ``only_first`` and ``only_second``, and ``p`` of McNemar's exact test
    pairs: pd.DataFrame
    #: one row per pair: ``pd_mean_a`` of the first with ``low_a`` and ``high_a``, ``pd_mean_b``,
    #: their chance, ``difference`` with interval and ``p_value``, see :class:`Comparison`; None
    #: where only operating points were asked for
    means: pd.DataFrame | None


def side_by_side_in_words(comparison: SideBySide) -> str:
    """Return what each detector finds at the operating point, and whether a pair is told apart."""
    points, pairs = comparison.points, comparison.pairs
    far = points.attrs.get("far", points["far_allowed"].max())
    found = [
        f"{row['detector']} {row['n_detected']:.0f} of {row['n_targets']:.0f}"
        for row in points[points["far_allowed"] == far].to_dict("records")
    ]
    sentence = f"At {far:.3g} false alarms per m²: {', '.join(found)}"
    tested = pairs["p"][pairs["far_allowed"] == far].tolist()
    if len(tested) == 1:
        sentence += f"; {'' if tested[0] < _SURE else 'not '}told apart (p = {tested[0]:.3g})"
    return sentence


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

    Returns
    -------
    Comparison
        PD_mean of both, their difference with its interval, and two tests.

    Raises
    ------
    ValueError
        If the two are not matched to the same truth, lanes and halo, or an option is not valid.
    """
    _check_pair(first, second)
    design = make_design(
        first, subset, block=block, cluster=cluster, area=area, frame_area=frame_area
    )
    scores_a = make_scores(first, design, subset)
    scores_b = make_scores(second, design, subset)
    every_block = np.ones(len(design.block_lane))
    share_a = scores_a.shares(far_max, every_block, design.area)
    share_b = scores_b.shares(far_max, every_block, design.area)

    differences = []
    for target, weight, drawn_area in draws_of(design, draws, seed):
        gain = scores_a.shares(far_max, weight, drawn_area)
        gain -= scores_b.shares(far_max, weight, drawn_area)
        differences.append((target * gain).sum() / target.sum())
    low, high = np.quantile(differences, tails(level, design.clusters))
    by_mine = np.bincount(design.target_cluster, weights=share_a - share_b)
    p_value, enumerated = sign_flip_test(by_mine, seed)

    # Looks at one mine are no independent trials: a mine counts once, for the detector that finds
    # it more often.
    lead = _is_found(scores_a, far, design.area) - _is_found(scores_b, far, design.area)
    lead_of_mine = np.bincount(design.target_cluster, weights=lead)
    only_a = int((lead_of_mine > 0).sum())
    only_b = int((lead_of_mine < 0).sum())

    by_chance = []
    for matched in (first, second):
        curve = roc_of(matched, subset, area=area, frame_area=frame_area)
        with_chance = chance(matched, seed=seed).add_chance_column(curve, subset)
        by_chance.append(pd_mean_by_chance(with_chance, far_max))

    return Comparison(
        pd_mean_a=float(share_a.mean()),
        pd_mean_b=float(share_b.mean()),
        difference=float((share_a - share_b).mean()),
        low=float(low),
        high=float(high),
        p_value=p_value,
        enumerated=enumerated,
        far=far,
        only_a=only_a,
        only_b=only_b,
        p_detections=mcnemar_test(only_a, only_b),
        n_targets=int(select_targets(first.truth, subset).sum()),
        chance_a=by_chance[0],
        chance_b=by_chance[1],
    )


def _is_found(scores: Scores, far: float, area: float) -> FloatArray:
    """Return 1 for each target that is found at an allowed false alarm rate, per m², else 0."""
    return floats(~np.isneginf(scores.target) & (scores.above / area <= far))


def sign_flip_test(differences: ArrayLike, seed: int = 0) -> tuple[float, bool]:
    """Test whether paired differences are symmetric about zero, by flipping their signs.

    Parameters
    ----------
    differences : (mine,) array_like
        One difference per mine.
    seed : int
        Seed that draws signs where there are more than 20 differences other than zero.

    Returns
    -------
    p_value : float
        Two-sided p.
    enumerated : bool
        Whether all signs were tried.

    Examples
    --------
    >>> from flgpr.scoring import sign_flip_test
    >>> p, exact = sign_flip_test([0.2, 0.1, 0.4, 0.3, 0.2])
    >>> round(p, 4), exact  # all five of one sign: 2 of 2^5
    (0.0625, True)
    """
    values = floats(differences)
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
    """Test whether two detectors find equally many targets (McNemar's exact test).

    Parameters
    ----------
    only_a, only_b : int
        Targets that one detector alone finds.

    Returns
    -------
    float
        Two-sided p.

    Examples
    --------
    Nine mines that one detector alone finds against two that the other alone finds:

    >>> from flgpr.scoring import mcnemar_test
    >>> round(mcnemar_test(9, 2), 3)
    0.065
    """
    total = only_a + only_b
    if not total:
        return 1.0
    return float(scipy.stats.binomtest(only_a, total).pvalue)


def paired_interval(
    only_a: float, only_b: float, n_targets: float, level: float = 0.95
) -> tuple[float, float]:
    """Compute an interval of the difference of two detectors' Pd on the same targets.

    It inverts the score test of Tango (1998, Statistics in Medicine 17, 891). It holds for few
    targets, too, and does not shrink to a point where both find the same.

    Parameters
    ----------
    only_a, only_b : float
        Targets that one detector alone finds.
    n_targets : float
        Number of targets; effective numbers of looks need not be whole.
    level : float
        Level of the interval.

    Returns
    -------
    low, high : float
        Bounds of Pd of A less Pd of B.

    Raises
    ------
    ValueError
        If the counts are negative or exceed the number of targets.

    Examples
    --------
    >>> import numpy as np
    >>> from flgpr.scoring import paired_interval
    >>> np.round(paired_interval(9, 2, 40), 3).tolist()
    [0.014, 0.339]
    """
    if not 0 < n_targets >= only_a + only_b or min(only_a, only_b) < 0:
        raise ValueError(
            "only_a and only_b must be counts among n_targets, "
            f"got {only_a}, {only_b} of {n_targets}"
        )
    z = float(scipy.stats.norm.ppf((1 + level) / 2))
    low = _lower_end(only_a, only_b, n_targets, z)
    high = -_lower_end(only_b, only_a, n_targets, z)
    return low, high


def side_by_side(
    matches: Mapping[str, Match],
    fars: Sequence[float],
    rules: Rules | None = None,
    means: bool = True,
) -> SideBySide:
    """Compare two or more detectors at allowed false alarm rates.

    Parameters
    ----------
    matches : mapping of str to Match
        Alarms by the detectors' names, matched to the same truth, lanes and halo.
    fars : sequence of float
        Allowed false alarm rates, per m².
    rules : Rules, optional
        Area, intervals and chance.
    means : bool
        Compare PD_mean, too, which takes a bootstrap; otherwise operating points only.

    Returns
    -------
    SideBySide
        Operating points, and the pairs of detectors.

    Raises
    ------
    ValueError
        If there are fewer than two detectors, no targets, or the matches do not fit together.
    """
    rules = rules or Rules()
    if len(matches) < 2:
        raise ValueError(f"matches must be two or more to be compared, got {len(matches)}")
    if not all(len(matched.truth) for matched in matches.values()):
        raise ValueError(
            "truth must have at least one target for detectors to be compared, got none"
        )
    points = []
    intervals = {}
    for name, matched in matches.items():
        curve = curve_by(rules, matched, chance(matched, rules.shifts, rules.seed))
        points.append(points_at(curve, fars, "detector", name))
        if means:
            intervals[name] = pd_mean_interval(matched, **_mean_options(rules))
    pairs = []
    pairs_of_means = []
    for (name, first), (other, second) in itertools.combinations(matches.items(), 2):
        _check_pair(first, second)
        names = {"first": name, "second": other}
        for row in paired_points(first, second, fars, rules=rules):
            pairs.append(names | row)
        if means:
            compared = compare(first, second, **_mean_options(rules))
            row = {entry: getattr(compared, entry) for entry in _MEAN_ENTRIES}
            row["low_a"], row["high_a"] = intervals[name]
            row["low_b"], row["high_b"] = intervals[other]
            pairs_of_means.append(names | row)
    table = pd.concat(points, ignore_index=True)
    far = max(rules.far, 1 / curve.attrs["area"])
    table.attrs["far"] = far if far in fars else max(fars, default=far)
    return SideBySide(table, pd.DataFrame(pairs), pd.DataFrame(pairs_of_means) if means else None)


def _mean_options(rules: Rules) -> Entries:
    """Return the rules that intervals of PD_mean need."""
    names = ("area", "frame_area", "level", "far_max", "draws", "seed", "block", "cluster")
    return {name: getattr(rules, name) for name in names}


def points_at(curve: pd.DataFrame, fars: Sequence[float], column: str, name: str) -> pd.DataFrame:
    """Return the rows of a curve at allowed false alarm rates, with its name in a column."""
    rows = curve.iloc[operating_row(curve, np.array(fars))][list(_POINT_COLUMNS)]
    rows = rows.reset_index(drop=True)
    rows.attrs = {}
    rows.insert(0, "far_allowed", list(fars))
    rows.insert(0, column, name)
    return rows


def found_from(matched: Match, subset: Subset = None, area: AreaRule = "union") -> FloatArray:
    """Return the false alarms per m² from which on each target of a subset is found; inf: never.

    An alarm in the halo of a target of the subset and of another target counts for neither, as in
    :func:`flgpr.scoring.roc`.
    """
    chosen = select_targets(matched.truth, subset)
    confidence = matched.best(chosen)[1][chosen]
    far = count_at(confidence, matched.confidence[matched.false]) / far_area(matched, area)
    return np.where(np.isneginf(confidence), np.inf, far)


def paired_points(
    first: Match,
    second: Match,
    fars: Sequence[float],
    subset: Subset = None,
    rules: Rules | None = None,
) -> list[Entries]:
    """Compare the targets of a subset that two detectors find at each allowed false alarm rate.

    The entries of a row are those of ``pairs`` of :class:`SideBySide`.
    """
    rules = rules or Rules()
    far_first = found_from(first, subset, rules.area)
    far_second = found_from(second, subset, rules.area)
    n_targets = len(far_first)
    rows = []
    for far in fars:
        only_first = int(((far_first <= far) & (far_second > far)).sum())
        only_second = int(((far_second <= far) & (far_first > far)).sum())
        low, high = paired_interval(only_first, only_second, n_targets, rules.level)
        row = {
            "far_allowed": far,
            "difference": (only_first - only_second) / n_targets,
            "low": low,
            "high": high,
            "only_first": only_first,
            "only_second": only_second,
            "p": mcnemar_test(only_first, only_second),
        }
        rows.append(row)
    return rows


def _lower_end(more: float, less: float, n: float, z: float) -> float:
    """Find the lower bound of the difference of two shares (Tango 1998).

    ``more`` and ``less`` are the counts in which alone the two differ, among n.
    """

    def excess(difference: float) -> float:
        """Return how far the score statistic of a difference exceeds its quantile z."""
        b = (2 * n - more + less) * difference - more - less
        discriminant = b * b + 8 * n * less * difference * (1 - difference)
        # Share of those counted in ``less``, most likely under this difference.
        share = (math.sqrt(max(0.0, discriminant)) - b) / (4 * n)
        variance = n * (2 * share + difference * (1 - difference))
        return more - less - n * difference - z * math.sqrt(max(0.0, variance))

    estimate = (more - less) / n
    # At the estimate itself the statistic is zero over zero if nothing differs.
    start = estimate - 1e-10
    if start > -1 and excess(start) < 0:
        return float(scipy.optimize.brentq(excess, -1.0, start))
    return estimate


def _check_pair(first: Match, second: Match) -> None:
    """Refuse two matches of other truths, lanes or halos."""
    columns = ["target_id", "x", "y"]
    same_truth = first.truth[columns].equals(second.truth[columns])
    same_truth = same_truth and np.array_equal(first.target_lane, second.target_lane)
    if not same_truth or first.lanes != second.lanes or first.halo != second.halo:
        raise ValueError(
            "first and second must be matched to the same truth, lanes and halo, in the same order"
        )


@dataclass(frozen=True)
class Agreement:
    """Agreement of two analysts, and Cohen's kappa, the agreement that chance does not explain."""

    table: pd.DataFrame  #: counts: verdicts of the first (rows) by those of the second (columns)
    n: int  #: alarms that both judged
    agreed: int  #: alarms that they judged alike
    #: share, share_low, share_high: share of these with its exact interval
    share: float
    share_low: float
    share_high: float
    #: share that analysts with these shares of verdicts would judge alike by chance
    expected: float
    #: kappa, kappa_low, kappa_high: NaN where both gave one and the same verdict throughout,
    #: because chance explains all of it
    kappa: float
    kappa_low: float
    kappa_high: float


def agreement(
    first: Sequence[str], second: Sequence[str], categories: Sequence[str], level: float = 0.95
) -> Agreement:
    """Compare verdicts of two analysts on the same alarms, in the same order.

    Kappa is that of Cohen 1960, Eq. 1 ("A coefficient of agreement for nominal scales", Educ.
    Psychol. Meas. 20). Its interval is the exact one of the agreement with the chance agreement
    taken as given, as there: it covers at least as often as the level says, also where all verdicts
    agree.

    Parameters
    ----------
    first, second : (alarm,) sequence of str
        Verdicts of the two analysts.
    categories : sequence of str
        All verdicts that there are.
    level : float
        Level of the intervals.

    Returns
    -------
    Agreement
        Counts, share and kappa.

    Raises
    ------
    ValueError
        If there are no verdicts, their numbers differ, or one is no category.

    Examples
    --------
    Of ten alarms, half mines to both, they judge eight alike.

    >>> from flgpr.scoring import agreement
    >>> judged = agreement([*"mmmmmccccc"], [*"mmmmcmcccc"], ["m", "c"])
    >>> judged.agreed, round(judged.kappa, 2)
    (8, 0.6)
    >>> round(judged.kappa_low, 2), round(judged.kappa_high, 2)
    (-0.11, 0.95)
    """
    if len(first) != len(second) or not len(first):
        raise ValueError(
            f"verdicts must be of the same alarms, at least one, got {len(first)} and {len(second)}"
        )
    verdicts = {*first, *second}
    unknown = sorted(str(verdict) for verdict in verdicts if verdict not in categories)
    if unknown:
        raise ValueError(f"verdicts must be {', '.join(categories)}, got {', '.join(unknown)}")

    names = pd.Index(categories)
    counts = np.zeros((len(names), len(names)), dtype=np.int64)
    row = names.get_indexer(pd.Index(first))
    column = names.get_indexer(pd.Index(second))
    np.add.at(counts, (row, column), 1)
    n = int(counts.sum())
    agreed = int(np.trace(counts))
    # Two analysts who judge independently agree by the product of their shares of each verdict.
    expected = float((counts.sum(axis=0) * counts.sum(axis=1)).sum() / n**2)
    low, high = clopper_pearson(agreed, n, level)
    shares = (agreed / n, float(low), float(high))
    kappas = [_kappa(share, expected) for share in shares]
    return Agreement(pd.DataFrame(counts, names, names), n, agreed, *shares, expected, *kappas)


def _kappa(share: float, expected: float) -> float:
    """Return Cohen's kappa of a share of agreement, given that expected by chance."""
    return (share - expected) / (1 - expected) if expected < 1 else math.nan
