"""A statement of a paper beside what the simulated lanes show, and the rules by which it is judged.

No verdict "agrees" or "disagrees" without an interval; those are of 95 %, with all that belongs to
one mine drawn together. The rules, fixed before the lanes they judge are made:

- *larger*: a claim that something is larger agrees if the interval of the difference lies above
  zero, disagrees if it
  lies below.
- *within*: a number with a rule agrees if its interval lies within the rule, disagrees if it lies
  outside.
- *alike*: a figure of the paper is a sample too. The interval of ours less the paper's has the
  errors of both. If it
  does not hold zero, the two disagree; if it does and reaches no further than a margin, they agree.
- *all of*: a claim of several parts agrees if every part does, disagrees if one does. The parts'
  intervals are then
  wide enough to hold all together (Bonferroni).

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
"""What is said of a statement; ``OPEN`` is said of a question that the paper does not answer."""
NO_VERDICT = "no verdict: a quick run is too small"
"""What is said of a statement in a quick run."""
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
# of a number on a page
_MOST_DECIMALS = 4
_MOST_DIGITS = 3
_Z = 1.959964


@dataclass(frozen=True)
class Finding:
    """One statement of a paper beside ours.

    Raises
    ------
    ValueError
        If it agrees or disagrees and has no interval, or not by the stated rule or margin; if the
        interval leaves ``bounds``.
    """

    #: claim, paper, ours: what the paper says, its figure ("not tried" where the question is ours)
    #: and ours with its interval
    claim: str
    paper: str
    ours: str
    verdict: str  #: by the module's rules, or by those that the paper's own module adds
    note: str = ""  #: what stands behind it, and why it may differ
    quantity: str = ""  #: the number that stands for the claim, where it is one
    interval: Interval | None = None  #: that number and its 95 % interval
    rule: tuple[float, float] | None = None  #: the claim agrees where the number lies between these
    group: str = ""  #: on which lanes, where the same was asked of several
    #: "larger" or "alike", with the limit or the margin and the standard error of the paper's
    #: figure, where no rule is
    asks: tuple[str, float, float] | None = None
    parts: tuple[float, ...] = ()  #: the number of every part of a claim of several
    unit: str = ""  #: of the number, the rule and the margin
    #: between which the number must lie, whatever is measured; None: anything is possible
    bounds: Bounds | None = None

    def __post_init__(self) -> None:
        if self.verdict in (AGREES, DISAGREES) and (
            self.interval is None or np.isnan(self.interval).any()
        ):
            raise ValueError(
                f"interval of {self.claim!r} must be known if it {self.verdict}, got "
                f"{self.interval}"
            )
        if self.bounds is not None and self.interval is not None:
            low, high = self.bounds
            if any(math.isfinite(end) and not low <= end <= high for end in self.interval):
                raise ValueError(
                    f"interval of {self.claim!r} must lie in {low:g} to {high:g}, got "
                    f"{self.interval}"
                )
        by_rule = self._verdict_by_rule()
        if self.verdict in (AGREES, DISAGREES) and by_rule not in (None, self.verdict):
            raise ValueError(
                f"verdict on {self.claim!r} must be {by_rule!r} by its rule ({self.criterion}), "
                f"got {self.verdict!r}"
            )

    def _verdict_by_rule(self) -> str | None:
        """Judge the number as stated.

        None without a rule, and for several parts, whose numbers are not all held.
        """
        if self.interval is None or self.parts:
            return None
        low, high = self.interval[1:]
        if self.rule is not None:
            return judge(low, high, self.rule)
        if self.asks is None:
            return None
        kind, limit, _ = self.asks
        return larger(low, high, limit) if kind == "larger" else alike(low, high, limit)

    @property
    def criterion(self) -> str:
        """The rule or the margin in words; empty if the statement is judged in another way."""
        unit = f" {self.unit}" if self.unit else ""
        if self.rule is not None:
            return f"{self.rule[0]:g} to {self.rule[1]:g}{unit}"
        if self.asks is None:
            return ""
        kind, limit, _ = self.asks
        return (
            f"above {limit:g}{unit}"
            if kind == "larger"
            else f"within {limit:g}{unit} of the paper's"
        )


def clip(interval: Interval, bounds: Bounds) -> Interval:
    """Cut an interval at what is possible; a side without an end (one sample) keeps none."""
    low, high = bounds
    value, *ends = interval
    lower, upper = (float(np.clip(end, low, high)) if math.isfinite(end) else end for end in ends)
    return float(np.clip(value, low, high)), lower, upper


def for_run(findings: Sequence[Finding], quick: bool) -> list[Finding]:
    """Take the verdicts of a quick run away; numbers, intervals and open questions stay."""
    if not quick:
        return list(findings)
    return [
        finding if finding.verdict == OPEN else replace(finding, verdict=NO_VERDICT)
        for finding in findings
    ]


def without_paper(findings: Sequence[Finding]) -> list[str]:
    """List the claims that do not say what the paper has: its figure, or where it states them."""
    return [finding.claim for finding in findings if not finding.paper.strip()]


def judge(low: float, high: float, rule: tuple[float, float]) -> str:
    """Judge an interval by the rule that it has to lie in."""
    if rule[0] <= low and high <= rule[1]:
        return AGREES
    return DISAGREES if high < rule[0] or low > rule[1] else UNDECIDED


def larger(low: float, high: float, limit: float = 0.0) -> str:
    """Judge a claim that something lies above a limit by the interval of it."""
    return AGREES if low > limit else DISAGREES if high < limit else UNDECIDED


def all_of(verdicts: Sequence[str]) -> str:
    """Judge a claim that holds only if all its parts do."""
    if DISAGREES in verdicts:
        return DISAGREES
    return AGREES if all(verdict == AGREES for verdict in verdicts) else UNDECIDED


def alike(low: float, high: float, margin: float = MARGIN) -> str:
    """Judge a figure of the paper by the interval of ours less it.

    It holds the errors of both samples.
    """
    if low > 0 or high < 0:
        return DISAGREES
    return AGREES if -margin <= low and high <= margin else UNDECIDED


def judge_again(finding: Finding, value: float, low: float, high: float) -> str:
    """Judge another interval by what a finding's claim asks.

    That of a paper's figure gets the figure's error.
    """
    if finding.rule is not None:
        return judge(low, high, finding.rule)
    if finding.asks is None:
        return OPEN
    kind, limit, error = finding.asks
    if kind == "larger":
        return larger(low, high, limit)
    return alike(*less_figure((value, low, high), 0.0, error)[1:], limit)


def difference_of_shares(a: tuple[int, int], b: tuple[int, int]) -> Interval:
    """Return the difference of two independent proportions, (successes, trials).

    The interval is Newcombe's (1998, method 10).
    """

    def wilson(k: int, n: int) -> Interval:
        p = k / n
        centre = (p + _Z**2 / (2 * n)) / (1 + _Z**2 / n)
        half = _Z * math.sqrt(p * (1 - p) / n + _Z**2 / (4 * n * n)) / (1 + _Z**2 / n)
        return p, centre - half, centre + half

    p, pl, ph = wilson(*a)
    q, ql, qh = wilson(*b)
    return p - q, p - q - math.hypot(p - pl, qh - q), p - q + math.hypot(ph - p, q - ql)


def less_figure(
    ours: Interval, figure: float, error: float, bounds: Bounds | None = None
) -> Interval:
    """Return ours less a figure of the paper, whose standard error is known or bounded.

    The gap is cut at bounds.
    """
    value, low, high = ours
    gap = value - figure
    interval = (
        gap,
        gap - math.hypot(value - low, _Z * error),
        gap + math.hypot(high - value, _Z * error),
    )
    return interval if bounds is None else clip(interval, bounds)


def share_error(share: float, count: int) -> float:
    """Bound the standard error of a mean of ``count`` numbers from 0 to 1.

    Such is PD_mean over mines.
    """
    p = min(max(share, 0.5 / count), 1 - 0.5 / count)
    return math.sqrt(p * (1 - p) / count)


def clustered(
    values: ArrayLike, cluster: Any, draws: int, seed: int = 0, level: float = 0.95
) -> Interval:
    """Mean of values and its bootstrap interval by percentiles, whole clusters drawn together.

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


def difference_of_means(first: Interval, second: Interval) -> Interval:
    """Return the difference of two independent means by their intervals.

    These need not be symmetric (Zou & Donner 2008).
    """
    a, a_low, a_high = first
    b, b_low, b_high = second
    gap = a - b
    return gap, gap - math.hypot(a - a_low, b_high - b), gap + math.hypot(a_high - a, b - b_low)


def by_chance(findings: Sequence[Finding]) -> tuple[int, float, int]:
    """Return how many statements are judged, and how many of them would disagree by chance.

    If all statements held, each would be said to disagree with a probability of 5 % at the most
    (2.5 % where a claim is one-sided). Gives the number judged, the mean number of false ones, and
    what they exceed with 5 % at the most if statements were independent.
    """
    judged = sum(finding.verdict != OPEN for finding in findings)
    return judged, 0.05 * judged, math.ceil(bdtrik(0.95, judged, 0.05)) if judged else 0


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
    """Make the finding of a number, cut at its bounds and judged by its rule if there is one."""
    if bounds is not None:
        interval = clip(interval, bounds)
    judged = verdict if rule is None else judge(*interval[1:], rule)
    ours = in_words(*interval, unit)
    return Finding(
        claim,
        paper,
        ours,
        judged,
        "",
        quantity,
        interval,
        rule,
        asks=asks,
        unit=unit,
        bounds=bounds,
    )


def in_words(value: float, low: float, high: float, unit: str = "") -> str:
    """Write a value with its interval, in as many digits as the interval's width has meaning for.

    There are at most three significant digits of the largest of the three, and at most four
    decimals.
    """
    if math.isnan(value):
        return "nothing to measure"
    after = f" {unit}" if unit else ""
    if not math.isfinite(high - low):
        return f"{value:.3g}{after} (one sample, no interval)"
    digits = decimals((value, low, high), high - low)
    return f"{value:z.{digits}f}{after} ({low:z.{digits}f} to {high:z.{digits}f})"


def decimals(values: Sequence[float], width: float) -> int:
    """Count the decimals that numbers deserve which are known to a width.

    Its two leading digits, and not too many.
    """
    largest = max(abs(value) for value in values)
    by_width = 1 - math.floor(math.log10(width)) if width > 0 else _MOST_DIGITS
    by_size = _MOST_DIGITS - 1 - math.floor(math.log10(largest)) if largest > 0 else _MOST_DIGITS
    return max(0, min(by_width, by_size, _MOST_DECIMALS))


def parts_larger(
    claim: str,
    paper: str,
    parts: Mapping[str, Interval],
    limit: float = 0.0,
    note: str = "",
    group: str = "",
    bounds: Bounds | None = None,
) -> Finding:
    """Make the finding of a claim that several numbers lie above a limit.

    Its number is the least of them. The parts' intervals, cut at the bounds, are to hold all
    together, see :func:`together`.
    """
    cut = {
        name: interval if bounds is None else clip(interval, bounds)
        for name, interval in parts.items()
    }
    least = min(cut.values(), key=lambda interval: interval[1])
    ours = "; ".join(f"{name} {_signed(interval)}" for name, interval in cut.items())
    verdict = all_of([larger(low, high, limit) for _, low, high in cut.values()])
    values = tuple(value for value, _, _ in cut.values())
    asks = ("larger", limit, 0.0)
    return Finding(
        claim,
        paper,
        ours,
        verdict,
        note,
        interval=least,
        group=group,
        asks=asks,
        parts=values,
        bounds=bounds,
    )


def _signed(interval: Interval) -> str:
    """Write a difference with its interval, signs shown."""
    digits = decimals(interval, interval[2] - interval[1]) if np.isfinite(interval).all() else 2
    value, low, high = (f"{number:+z.{digits}f}" for number in interval)
    return f"{value} ({low} to {high})"


def together(parts: int) -> float:
    """Level of intervals of which so many hold all together in 95 %, at the least (Bonferroni)."""
    return 1 - 0.05 / parts


def spread(
    value: float, draws: ArrayLike, level: float = 0.95, bounds: Bounds | None = None
) -> Interval:
    """Return Student's interval of a value by the deviation of its bootstrap draws.

    A few draws suffice.

    It reaches beyond what a share can be; ``bounds`` cut it there.
    """
    half = float(stdtrit(np.size(draws) - 1, (1 + level) / 2) * np.std(np.asarray(draws), ddof=1))
    interval = value, value - half, value + half
    return interval if bounds is None else clip(interval, bounds)


def write_findings(folder: Path, findings: Sequence[Finding], quick: bool, **more: Any) -> None:
    """Write ``findings.json`` and what else belongs to the run.

    A number that is not finite is null.

    The findings of a quick run have no verdicts. What else is told holds the ``world`` of the
    lanes, which :func:`flgpr_papers.overview.run_study` asks for.
    """
    content = {
        "quick": quick,
        **more,
        "findings": [row_of(finding) for finding in for_run(findings, quick)],
    }
    write_whole(folder / "findings.json", json.dumps(content, indent=2, ensure_ascii=False) + "\n")


def row_of(finding: Finding) -> dict[str, Any]:
    """Return a finding as JSON can hold it."""

    def plain(value: Any) -> Any:
        if isinstance(value, tuple):
            return [plain(entry) for entry in value]
        return None if isinstance(value, float) and not math.isfinite(value) else value

    return {name: plain(value) for name, value in asdict(finding).items()}


def read_findings(folder: Path) -> list[Finding]:
    """Read what :func:`write_findings` wrote; NaN stands for a number that was not finite."""
    rows = json.loads((folder / "findings.json").read_text("utf-8"))["findings"]
    return [finding_of(row) for row in rows]


def finding_of(row: dict[str, Any]) -> Finding:
    """Make a finding of what JSON holds of it."""
    entries = dict(row)
    for name in ("interval", "rule", "asks", "parts", "bounds"):
        numbers = row.get(name)
        if numbers is not None:
            numbers = tuple(math.nan if number is None else number for number in numbers)
        entries[name] = numbers
    return Finding(**entries)
