"""Findings: statements of a paper, what the simulated lanes show, and the rules of the verdicts.

No verdict "agrees" or "disagrees" without an interval. All intervals are of 95 %, with everything
that belongs to one mine drawn together. The rules were fixed before the lanes that they judge were
made:

- *larger*: a claim that something is larger agrees if the interval of the difference lies above
  zero, and disagrees if it lies below.
- *within*: a number with a rule agrees if its interval lies within the rule, and disagrees if it
  lies outside.
- *alike*: a figure of the paper is a sample too. The interval of ours less the paper's has the
  errors of both. If it does not hold zero, the two disagree. If it does and reaches no further than
  a margin, they agree.
- *all of*: a claim of several parts agrees if every part does, and disagrees if one does. The
  intervals of the parts are then wide enough to hold all together (Bonferroni).

What an interval does not decide cannot be said. A quick run decides nothing: its lanes are short
and hold a few mines, so that its findings have numbers and no verdicts.

The interval of a share ends at 0 and 1, that of a difference of two shares at -1 and 1: no value
beyond is possible.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import bdtrik, stdtrit

from flgpr.store import write_whole

AGREES = "agrees"
DISAGREES = "disagrees"
UNDECIDED = "cannot say"
OPEN = "open"
VERDICTS = (AGREES, DISAGREES, UNDECIDED)
"""Verdicts on a statement; ``OPEN`` stands for a question that the paper does not answer."""
NO_VERDICT = "no verdict: a quick run is too small"
"""What stands in place of a verdict in a quick run."""
Interval = tuple[float, float, float]
"""A value and the ends of its 95 % interval."""
Bounds = tuple[float, float]
"""The least and the largest value that a quantity can have."""
SHARE: Bounds = (0.0, 1.0)
"""Bounds of a probability or any other share, such as Pd, PD_mean or an area under a ROC."""
SHARE_DIFFERENCE: Bounds = (-1.0, 1.0)
"""Bounds of the difference of two shares."""
MARGIN = 0.15
"""How far a share may lie from the paper's and still be called alike."""
_MOST_DECIMALS = 4  # of a number on a page
_MOST_DIGITS = 3  # significant digits of a number on a page
_Z = 1.959964  # 97.5 % point of the normal distribution: an interval of 95 % has two sides


@dataclass(frozen=True)
class Finding:
    """One statement of a paper, what our lanes show, and the verdict.

    Raises
    ------
    ValueError
        If it agrees or disagrees and has no interval, or not by the stated rule or margin; if the
        interval leaves ``bounds``.
    """

    claim: str  #: what the paper says
    paper: str  #: the paper's figure; "not tried" where the question is ours
    ours: str  #: our figure with its interval
    verdict: str  #: by the module's rules, or by those that the paper's own module adds
    note: str = ""  #: what the number rests on, and why it may differ from the paper's
    quantity: str = ""  #: name of the number that stands for the claim, where it is one
    interval: Interval | None = None  #: that number and its 95 % interval
    rule: tuple[float, float] | None = None  #: the claim agrees where the number lies between these
    group: str = ""  #: the lanes, where the same was asked on several groups of lanes
    #: where there is no rule: "larger" or "alike", with the limit or the margin, and the standard
    #: error of the paper's figure
    asks: tuple[str, float, float] | None = None
    parts: tuple[float, ...] = ()  #: the number of every part of a claim of several parts
    unit: str = ""  #: of the number, the rule and the margin
    #: least and largest possible value of the number; None: anything is possible
    bounds: Bounds | None = None

    def __post_init__(self) -> None:
        is_decided = self.verdict in (AGREES, DISAGREES)
        if is_decided and (self.interval is None or np.isnan(self.interval).any()):
            raise ValueError(
                f"interval of {self.claim!r} must be known if it {self.verdict}, got "
                f"{self.interval}"
            )
        if self.bounds is not None and self.interval is not None:
            low, high = self.bounds
            for number in self.interval:
                if math.isfinite(number) and not low <= number <= high:
                    raise ValueError(
                        f"interval of {self.claim!r} must lie in {low:g} to {high:g}, got "
                        f"{self.interval}"
                    )
        by_rule = self._verdict_by_rule()
        if is_decided and by_rule not in (None, self.verdict):
            raise ValueError(
                f"verdict on {self.claim!r} must be {by_rule!r} by its rule ({self.criterion}), "
                f"got {self.verdict!r}"
            )

    def _verdict_by_rule(self) -> str | None:
        """Return the verdict on the number by its rule.

        None without a rule, and for several parts: the intervals of the parts are not stored.
        """
        if self.interval is None or self.parts:
            return None
        _, low, high = self.interval
        if self.rule is not None:
            return judge(low, high, self.rule)
        if self.asks is None:
            return None
        kind, limit, _ = self.asks
        if kind == "larger":
            return larger(low, high, limit)
        return alike(low, high, limit)

    @property
    def criterion(self) -> str:
        """The rule or the margin in words; empty if there is neither."""
        unit = f" {self.unit}" if self.unit else ""
        if self.rule is not None:
            return f"{self.rule[0]:g} to {self.rule[1]:g}{unit}"
        if self.asks is None:
            return ""
        kind, limit, _ = self.asks
        if kind == "larger":
            return f"above {limit:g}{unit}"
        return f"within {limit:g}{unit} of the paper's"


def clip(interval: Interval, bounds: Bounds) -> Interval:
    """Return an interval cut at the bounds of its value; an infinite end (one sample) stays."""
    lowest, highest = bounds
    value, low, high = interval
    if math.isfinite(low):
        low = float(np.clip(low, lowest, highest))
    if math.isfinite(high):
        high = float(np.clip(high, lowest, highest))
    return float(np.clip(value, lowest, highest)), low, high


def for_run(findings: Sequence[Finding], quick: bool) -> list[Finding]:
    """Return findings as a run writes them: a quick run has numbers, but no verdicts."""
    if not quick:
        return list(findings)
    without_verdicts = []
    for finding in findings:
        if finding.verdict == OPEN:
            without_verdicts.append(finding)
        else:
            without_verdicts.append(replace(finding, verdict=NO_VERDICT))
    return without_verdicts


def without_paper(findings: Sequence[Finding]) -> list[str]:
    """Return the claims that do not say what the paper has: its figure, or where it states them."""
    return [finding.claim for finding in findings if not finding.paper.strip()]


def judge(low: float, high: float, rule: tuple[float, float]) -> str:
    """Return the verdict on an interval that has to lie within a rule."""
    least, most = rule
    if least <= low and high <= most:
        return AGREES
    if high < least or low > most:
        return DISAGREES
    return UNDECIDED


def larger(low: float, high: float, limit: float = 0.0) -> str:
    """Return the verdict on a claim that a number lies above a limit, by its interval."""
    if low > limit:
        return AGREES
    if high < limit:
        return DISAGREES
    return UNDECIDED


def all_of(verdicts: Sequence[str]) -> str:
    """Return the verdict on a claim that holds only if all its parts do."""
    if DISAGREES in verdicts:
        return DISAGREES
    if all(verdict == AGREES for verdict in verdicts):
        return AGREES
    return UNDECIDED


def alike(low: float, high: float, margin: float = MARGIN) -> str:
    """Return the verdict on a figure of the paper, by the interval of ours less the paper's.

    The interval has the errors of both samples.
    """
    if low > 0 or high < 0:
        return DISAGREES
    if -margin <= low and high <= margin:
        return AGREES
    return UNDECIDED


def difference_of_shares(first: tuple[int, int], second: tuple[int, int]) -> Interval:
    """Return the difference of two independent shares, with Newcombe's interval.

    Newcombe 1998, method 10, from the Wilson intervals of both.

    Parameters
    ----------
    first, second : tuple of int
        Successes and trials of each.
    """
    p, p_low, p_high = _wilson(*first)
    q, q_low, q_high = _wilson(*second)
    low = p - q - math.hypot(p - p_low, q_high - q)
    high = p - q + math.hypot(p_high - p, q - q_low)
    return p - q, low, high


def _wilson(successes: int, trials: int) -> Interval:
    """Return a share with its Wilson interval (Wilson 1927)."""
    p = successes / trials
    centre = (p + _Z**2 / (2 * trials)) / (1 + _Z**2 / trials)
    half = (
        _Z * math.sqrt(p * (1 - p) / trials + _Z**2 / (4 * trials * trials)) / (1 + _Z**2 / trials)
    )
    return p, centre - half, centre + half


def less_figure(
    ours: Interval, figure: float, error: float, bounds: Bounds | None = None
) -> Interval:
    """Return our number less a figure of the paper, with the errors of both.

    Parameters
    ----------
    ours : Interval
        Our number and its interval.
    figure : float
        The paper's.
    error : float
        Standard error of the paper's figure, known or bounded.
    bounds : Bounds, optional
        Bounds of the difference, at which the interval is cut.
    """
    value, low, high = ours
    gap = value - figure
    lower = gap - math.hypot(value - low, _Z * error)
    upper = gap + math.hypot(high - value, _Z * error)
    interval = gap, lower, upper
    return interval if bounds is None else clip(interval, bounds)


def share_error(share: float, count: int) -> float:
    """Return a bound of the standard error of a mean of ``count`` numbers from 0 to 1.

    PD_mean over mines is such a mean.
    """
    p = min(max(share, 0.5 / count), 1 - 0.5 / count)
    return math.sqrt(p * (1 - p) / count)


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
    data = np.asarray(values, dtype=np.float64)
    if data.size == 0:
        return math.nan, math.nan, math.nan
    code = np.unique(np.asarray(cluster).astype(str), return_inverse=True)[1]
    count = np.bincount(code).astype(float)
    total = np.bincount(code, weights=data)
    drawn = np.random.default_rng(seed).integers(0, count.size, (draws, count.size))
    means = total[drawn].sum(axis=1) / count[drawn].sum(axis=1)
    low, high = np.quantile(means, ((1 - level) / 2, (1 + level) / 2))
    return float(data.mean()), float(low), float(high)


def percentiles(value: float, draws: ArrayLike) -> Interval:
    """Return a value with the range that holds 95 % of its bootstrap draws that are known."""
    drawn = np.asarray(draws)
    low, high = np.quantile(drawn[~np.isnan(drawn)], (0.025, 0.975))
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


def by_chance(findings: Sequence[Finding]) -> tuple[int, float, int]:
    """Return how many statements are judged, and how many would disagree by chance.

    If all statements held, each would disagree with a probability of 5 % at the most (2.5 % where a
    claim is one-sided).

    Returns
    -------
    judged : int
        Number of statements judged.
    mean : float
        Mean number that disagree by chance, at the most.
    most : int
        Number that is exceeded with a probability of 5 % at the most, if the statements are
        independent.
    """
    judged = sum(finding.verdict != OPEN for finding in findings)
    if judged == 0:
        return 0, 0.0, 0
    return judged, 0.05 * judged, math.ceil(bdtrik(0.95, judged, 0.05))


def measured(
    claim: str,
    paper: str,
    quantity: str,
    interval: Interval,
    rule: tuple[float, float] | None = None,
    verdict: str = OPEN,
    asks: tuple[str, float, float] | None = None,
    unit: str = "",
    bounds: Bounds | None = None,
) -> Finding:
    """Return the finding of a number, judged by its rule if it has one.

    Parameters
    ----------
    claim, paper, quantity, rule, asks, unit
        As the fields of :class:`Finding`.
    interval : Interval
        The number and its interval.
    verdict : str
        Verdict of a number without a rule.
    bounds : Bounds, optional
        Bounds of the number, at which the interval is cut.
    """
    if bounds is not None:
        interval = clip(interval, bounds)
    value, low, high = interval
    return Finding(
        claim=claim,
        paper=paper,
        ours=in_words(value, low, high, unit),
        verdict=verdict if rule is None else judge(low, high, rule),
        quantity=quantity,
        interval=interval,
        rule=rule,
        asks=asks,
        unit=unit,
        bounds=bounds,
    )


def in_words(value: float, low: float, high: float, unit: str = "") -> str:
    """Format a value with its interval, with as many digits as the width of the interval supports.

    There are at most three significant digits of the largest of the three numbers, and at most four
    decimals.
    """
    if math.isnan(value):
        return "nothing to measure"
    unit_after = f" {unit}" if unit else ""
    if not math.isfinite(high - low):
        return f"{value:.3g}{unit_after} (one sample, no interval)"
    digits = decimals((value, low, high), high - low)
    return f"{value:z.{digits}f}{unit_after} ({low:z.{digits}f} to {high:z.{digits}f})"


def decimals(values: Sequence[float], width: float) -> int:
    """Return the number of decimals for numbers that are known to a width.

    The width's two leading digits are shown, and never more decimals than the module's limits.
    """
    largest = max(abs(value) for value in values)
    by_width = _MOST_DIGITS
    if width > 0:
        by_width = 1 - math.floor(math.log10(width))
    by_size = _MOST_DIGITS
    if largest > 0:
        by_size = _MOST_DIGITS - 1 - math.floor(math.log10(largest))
    return max(0, min(by_width, by_size, _MOST_DECIMALS))


def parts_larger(
    claim: str,
    paper: str,
    intervals: Mapping[str, Interval],
    limit: float = 0.0,
    note: str = "",
    group: str = "",
    bounds: Bounds | None = None,
) -> Finding:
    """Return the finding of a claim that several numbers lie above a limit.

    The number of the finding is that of the part with the lowest interval.

    Parameters
    ----------
    claim, paper, note, group
        As the fields of :class:`Finding`.
    intervals : mapping of str to Interval
        Number and interval of every part by its name. The intervals are to hold all together, see
        :func:`together`.
    limit : float
        Every number is to lie above it.
    bounds : Bounds, optional
        Bounds of the numbers, at which the intervals are cut.
    """
    cut = dict(intervals)
    if bounds is not None:
        cut = {name: clip(interval, bounds) for name, interval in intervals.items()}
    texts = []
    verdicts = []
    for name, interval in cut.items():
        _, low, high = interval
        texts.append(f"{name} {_signed(interval)}")
        verdicts.append(larger(low, high, limit))
    return Finding(
        claim=claim,
        paper=paper,
        ours="; ".join(texts),
        verdict=all_of(verdicts),
        note=note,
        interval=min(cut.values(), key=_lower_end),
        group=group,
        asks=("larger", limit, 0.0),
        parts=tuple(value for value, _, _ in cut.values()),
        bounds=bounds,
    )


def _lower_end(interval: Interval) -> float:
    """Return the lower end of an interval."""
    return interval[1]


def _signed(interval: Interval) -> str:
    """Format a difference with its interval, all with their signs."""
    digits = 2
    if np.isfinite(interval).all():
        digits = decimals(interval, interval[2] - interval[1])
    value, low, high = (f"{number:+z.{digits}f}" for number in interval)
    return f"{value} ({low} to {high})"


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
    half = float(stdtrit(np.size(draws) - 1, (1 + level) / 2) * np.std(np.asarray(draws), ddof=1))
    interval = value, value - half, value + half
    return interval if bounds is None else clip(interval, bounds)


def write_findings(folder: Path, findings: Sequence[Finding], quick: bool, **more: Any) -> None:
    """Write ``findings.json`` into the folder of a study.

    The findings of a quick run have no verdicts. A number that is not finite is null.

    Parameters
    ----------
    folder : Path
        Folder of the study.
    findings : sequence of Finding
        The findings, in the order of the page.
    quick : bool
        Whether the study is a quick run.
    **more
        What else belongs to the run; among it ``world``, which
        :func:`flgpr_papers.overview.run_study` reads.
    """
    rows = [row_of(finding) for finding in for_run(findings, quick)]
    content = {"quick": quick, **more, "findings": rows}
    write_whole(folder / "findings.json", json.dumps(content, indent=2, ensure_ascii=False) + "\n")


def row_of(finding: Finding) -> dict[str, Any]:
    """Return a finding as JSON can hold it; a number that is not finite becomes None."""
    return {name: _json_value(value) for name, value in asdict(finding).items()}


def _json_value(value: Any) -> Any:
    """Return a field of a finding as JSON can hold it."""
    if isinstance(value, tuple):
        return [_json_value(entry) for entry in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value


def read_findings(folder: Path) -> list[Finding]:
    """Read the findings of a study; a number that was not finite is NaN."""
    rows = json.loads((folder / "findings.json").read_text("utf-8"))["findings"]
    return [finding_of(row) for row in rows]


def finding_of(row: dict[str, Any]) -> Finding:
    """Return the finding of a row that :func:`row_of` made."""
    entries = dict(row)
    for name in ("interval", "rule", "asks", "parts", "bounds"):
        numbers = row.get(name)
        if numbers is not None:
            numbers = tuple(math.nan if number is None else number for number in numbers)
        entries[name] = numbers
    return Finding(**entries)
