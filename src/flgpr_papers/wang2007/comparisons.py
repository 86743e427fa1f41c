"""Comparisons with Wang et al. 2007 that its findings share, as intervals and as findings.

Differences of PD_mean come from resampling targets, lanes and stretches of lane. Where a
discriminant is trained, it is trained anew in every draw.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from flgpr.scoring import Match, compare
from flgpr_papers.kit.findings import (
    MARGIN,
    SHARE_DIFFERENCE,
    Finding,
    Interval,
    alike,
    all_of,
    difference_of_shares,
    judge,
    share_error,
    spread,
    together,
)
from flgpr_papers.kit.page import detections_at, pd_in_words
from flgpr_papers.wang2007.analysis import AREA, MINES, Pool

PAPER_MINES = 47
"""Mines on the paper's calibration lanes, of which its Pd are counts."""
PAPER_PLASTIC = 20
"""Buried plastic mines among them."""
PAPER_SIMULANTS = 16
"""Simulants on the paper's calibration lanes."""


def retrainings(draws: int) -> int:
    """Return in how many of the draws a discriminant is trained anew.

    They are enough for a standard deviation.
    """
    return max(draws // 5, 20)


def pd_mean_gap(
    first: Match, second: Match, draws: int, parts: int = 1, subset: Any = MINES
) -> Interval:
    """Return PD_mean of a detector less that of another, with frozen detectors.

    Parameters
    ----------
    first, second : Match
        Matched alarms of each.
    draws : int
        Number of bootstrap draws.
    parts : int
        Number of intervals that are to hold all together.
    subset : object
        Targets that count.
    """
    comparison = compare(first, second, subset, area=AREA, draws=draws, level=together(parts))
    return comparison.difference, comparison.low, comparison.high


def retrained_gap(
    pool: Pool,
    first: Sequence[str],
    second: Sequence[str],
    draws: int,
    parts: int = 1,
    method: str = "A",
    subset: Any = MINES,
) -> Interval:
    """Return PD_mean of a set of features less that of another, both trained anew in every draw.

    Parameters
    ----------
    pool : Pool
        Alarms of the calibration lanes.
    first, second : sequence of str
        Columns of each set.
    draws : int
        Number of bootstrap draws, of which :func:`retrainings` are used.
    parts : int
        Number of intervals that are to hold all together.
    method : str
        Method of training and testing, "A" to "D".
    subset : object
        Targets that count.
    """
    score = pool.scorer_of(subset)
    first_score = score(pool.confidence(list(first), method))
    second_score = score(pool.confidence(list(second), method))
    first_drawn = pool.retrained(list(first), method, retrainings(draws), subset)
    second_drawn = pool.retrained(list(second), method, retrainings(draws), subset)
    return spread(
        first_score - second_score, first_drawn - second_drawn, together(parts), SHARE_DIFFERENCE
    )


def limit_less(interval: Interval, limit: float) -> Interval:
    """Return a limit less a number, with its interval: a small number gives a large one."""
    value, low, high = interval
    return limit - value, limit - high, limit - low


def share_finding(
    claim: str,
    matched: Match,
    subset: Any,
    far: float,
    figure: float,
    count: int | None,
    note: str = "",
) -> Finding:
    """Return the finding that a Pd is like that of the paper.

    Parameters
    ----------
    claim, note : str
        As the fields of `flgpr_papers.kit.findings.Finding`.
    matched : Match
        Alarms matched to targets.
    subset : object
        Targets that count.
    far : float
        Allowed false alarms per m².
    figure : float
        Pd of the paper.
    count : int or None
        Number of the paper's targets; None where it does not say: as many as here are assumed.
    """
    n_found, targets, chance = detections_at(matched, subset, far, area=AREA)
    paper_targets = targets if count is None else count
    paper_found = round(figure * paper_targets)
    gap, low, high = difference_of_shares((n_found, targets), (paper_found, paper_targets))
    ours = (
        f"{pd_in_words(n_found, targets, chance)}; less {paper_found} of {paper_targets}: "
        f"{gap:+.2f} ({low:+.2f} to {high:+.2f})"
    )
    return Finding(
        claim=claim,
        paper=f"{figure:.0%}",
        ours=ours,
        verdict=alike(low, high),
        note=note,
        interval=(gap, low, high),
        asks=("alike", MARGIN, share_error(figure, paper_targets)),
    )


def within_finding(
    claim: str, paper: str, intervals: Mapping[str, Interval], limit: float, note: str = ""
) -> Finding:
    """Return the finding that several differences are small; its number is the widest of them.

    Parameters
    ----------
    claim, paper, note : str
        As the fields of `flgpr_papers.kit.findings.Finding`.
    intervals : mapping of str to Interval
        The differences by name.
    limit : float
        Largest difference that the claim allows.
    """
    rule = (-limit, limit)
    widest = max(intervals, key=lambda name: _reach(intervals[name]))
    value, low, high = intervals[widest]
    return Finding(
        claim=claim,
        paper=paper,
        ours=f"widest {widest} {value:+.3f} ({low:+.3f} to {high:+.3f})",
        verdict=all_of([judge(low, high, rule) for _, low, high in intervals.values()]),
        note=note,
        interval=intervals[widest],
        rule=rule,
        parts=tuple(value for value, _, _ in intervals.values()),
    )


def _reach(interval: Interval) -> float:
    """Return how far an interval reaches from zero."""
    _, low, high = interval
    return max(abs(low), abs(high))
