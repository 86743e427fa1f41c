"""A statement of a paper beside what the simulated lanes show, and the rules by which it is judged.

No verdict "agrees" or "disagrees" without an interval; those are of 95 %, with all that belongs to one mine drawn
together. The rules, fixed before the lanes they judge are made:

- *larger*: a claim that something is larger agrees if the interval of the difference lies above zero, disagrees if it
  lies below.
- *within*: a number with a rule agrees if its interval lies within the rule, disagrees if it lies outside.
- *alike*: a figure of the paper is a sample too. The interval of ours less the paper's has the errors of both. If it
  does not hold zero, the two disagree; if it does and reaches no further than a margin, they agree.
- *all of*: a claim of several parts agrees if every part does, disagrees if one does. The parts' intervals are then
  wide enough to hold all together (Bonferroni).

What an interval does not decide cannot be said.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import bdtrik, stdtrit

from flgpr.io import write_whole

AGREES, DISAGREES, UNDECIDED, OPEN = "agrees", "disagrees", "cannot say", "open"
VERDICTS = (AGREES, DISAGREES, UNDECIDED)
"""What is said of a statement; ``OPEN`` is said of a question that the paper does not answer."""
Interval = tuple[float, float, float]
"""A value and the ends of its 95 % interval."""
MARGIN = 0.15
"""How far a share may lie from the paper's and still be called alike."""
_Z = 1.959964


@dataclass(frozen=True)
class Finding:
    """One statement of a paper beside ours; a ValueError if it agrees or disagrees and has no interval."""

    #: claim, paper, ours: what the paper says, its figure ("not tried" where the question is ours) and ours with its
    #: interval
    claim: str
    paper: str
    ours: str
    verdict: str  #: by the module's rules, or by those that the paper's own module adds
    note: str = ""  #: what stands behind it, and why it may differ
    quantity: str = ""  #: the number that stands for the claim, where it is one
    interval: Interval | None = None  #: that number and its 95 % interval
    rule: tuple[float, float] | None = None  #: the claim agrees where the number lies between these
    group: str = ""  #: on which lanes, where the same was asked of several
    #: "larger" or "alike", with the limit or the margin and the standard error of the paper's figure, where no rule is
    asks: tuple[str, float, float] | None = None
    parts: tuple[float, ...] = ()  #: the number of every part of a claim of several

    def __post_init__(self) -> None:
        if self.verdict in (AGREES, DISAGREES) and (self.interval is None or np.isnan(self.interval).any()):
            raise ValueError(f"interval of {self.claim!r} must be known if it {self.verdict}, got {self.interval}")


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
    return AGREES if all(one == AGREES for one in verdicts) else UNDECIDED


def alike(low: float, high: float, margin: float = MARGIN) -> str:
    """Judge a figure of the paper by the interval of ours less it, which holds the errors of both samples."""
    if low > 0 or high < 0:
        return DISAGREES
    return AGREES if -margin <= low and high <= margin else UNDECIDED


def judge_again(one: Finding, value: float, low: float, high: float) -> str:
    """Judge another interval by what a finding's claim asks; that of a paper's figure gets the figure's error."""
    if one.rule is not None:
        return judge(low, high, one.rule)
    if one.asks is None:
        return OPEN
    kind, limit, error = one.asks
    if kind == "larger":
        return larger(low, high, limit)
    return alike(*less_figure((value, low, high), 0.0, error)[1:], limit)


def difference_of_shares(a: tuple[int, int], b: tuple[int, int]) -> Interval:
    """Difference of two independent proportions, (successes, trials), with Newcombe's interval (1998, method 10)."""

    def wilson(k: int, n: int) -> Interval:
        p = k / n
        centre = (p + _Z**2 / (2 * n)) / (1 + _Z**2 / n)
        half = _Z * math.sqrt(p * (1 - p) / n + _Z**2 / (4 * n * n)) / (1 + _Z**2 / n)
        return p, centre - half, centre + half

    (p, pl, ph), (q, ql, qh) = wilson(*a), wilson(*b)
    return p - q, p - q - math.hypot(p - pl, qh - q), p - q + math.hypot(ph - p, q - ql)


def less_figure(ours: Interval, figure: float, error: float) -> Interval:
    """Give ours less a figure of the paper, whose standard error is known or bounded."""
    value, low, high = ours
    gap = value - figure
    return gap, gap - math.hypot(value - low, _Z * error), gap + math.hypot(high - value, _Z * error)


def share_error(share: float, count: int) -> float:
    """Bound the standard error of a mean of ``count`` numbers from 0 to 1, such as PD_mean over mines."""
    p = min(max(share, 0.5 / count), 1 - 0.5 / count)
    return math.sqrt(p * (1 - p) / count)


def clustered(values: ArrayLike, cluster: Any, draws: int, seed: int = 0) -> Interval:
    """Mean of values and its bootstrap interval by percentiles, whole clusters drawn together; NaN without values."""
    data = np.asarray(values, dtype=np.float64)
    if data.size == 0:
        return math.nan, math.nan, math.nan
    code = np.unique(np.asarray(cluster).astype(str), return_inverse=True)[1]
    count, total = np.bincount(code).astype(float), np.bincount(code, weights=data)
    drawn = np.random.default_rng(seed).integers(0, count.size, (draws, count.size))
    means = total[drawn].sum(axis=1) / count[drawn].sum(axis=1)
    low, high = np.quantile(means, (0.025, 0.975))
    return float(data.mean()), float(low), float(high)


def by_chance(found: Sequence[Finding]) -> tuple[int, float, int]:
    """Tell how many statements are judged, and how many of them would disagree by chance.

    If all statements held, each would be said to disagree with a probability of 5 % at the most (2.5 % where a claim is
    one-sided). Gives the number judged, the mean number of false ones, and what they exceed with 5 % at the most if
    statements were independent.
    """
    judged = sum(one.verdict != OPEN for one in found)
    return judged, 0.05 * judged, math.ceil(bdtrik(0.95, judged, 0.05)) if judged else 0


def measured(
    claim: str,
    paper: str,
    quantity: str,
    interval: Interval,
    rule: tuple[float, float] | None = None,
    verdict: str = OPEN,
    asks: tuple[str, float, float] | None = None,
) -> Finding:
    """Make the finding of a number, judged by its rule if there is one."""
    said = verdict if rule is None else judge(*interval[1:], rule)
    return Finding(claim, paper, in_words(*interval), said, "", quantity, interval, rule, asks=asks)


def in_words(value: float, low: float, high: float) -> str:
    """Write a value with its interval, in as many digits as the interval's width has meaning for."""
    if math.isnan(value):
        return "nothing to measure"
    if not math.isfinite(high - low):
        return f"{value:.3g} (one sample, no interval)"
    digits = 3 if not high > low else max(0, 1 - math.floor(math.log10(high - low)))
    return f"{value:.{digits}f} ({low:.{digits}f} to {high:.{digits}f})"


def parts_larger(
    claim: str, paper: str, parts: Mapping[str, Interval], limit: float = 0.0, note: str = "", group: str = ""
) -> Finding:
    """Make the finding of a claim that several numbers lie above a limit; its number is the least of them.

    The parts' intervals are to hold all together, see :func:`together`.
    """
    least = min(parts.values(), key=lambda one: one[1])
    ours = "; ".join(f"{name} {value:+.2f} ({low:+.2f} to {high:+.2f})" for name, (value, low, high) in parts.items())
    verdict = all_of([larger(low, high, limit) for _, low, high in parts.values()])
    values = tuple(value for value, _, _ in parts.values())
    return Finding(
        claim, paper, ours, verdict, note, interval=least, group=group, asks=("larger", limit, 0.0), parts=values
    )


def together(parts: int) -> float:
    """Level of intervals of which so many hold all together in 95 %, at the least (Bonferroni)."""
    return 1 - 0.05 / parts


def spread(value: float, draws: ArrayLike, level: float = 0.95) -> Interval:
    """Student's interval of a value by the standard deviation of its bootstrap draws, few of which suffice."""
    half = float(stdtrit(np.size(draws) - 1, (1 + level) / 2) * np.std(np.asarray(draws), ddof=1))
    return value, value - half, value + half


def write_findings(folder: Path, found: Sequence[Finding], quick: bool, **more: Any) -> None:
    """Write ``findings.json``, in which a number that is not finite is null, and whatever else is told of the run."""
    told = {"quick": quick, **more, "findings": [row_of(one) for one in found]}
    write_whole(folder / "findings.json", json.dumps(told, indent=2, ensure_ascii=False) + "\n")


def row_of(one: Finding) -> dict[str, Any]:
    """Tell a finding as JSON can hold it."""

    def plain(value: Any) -> Any:
        if isinstance(value, tuple):
            return [plain(one) for one in value]
        return None if isinstance(value, float) and not math.isfinite(value) else value

    return {name: plain(value) for name, value in asdict(one).items()}


def read_findings(folder: Path) -> list[Finding]:
    """Read what :func:`write_findings` wrote; NaN stands for a number that was not finite."""
    rows = json.loads((folder / "findings.json").read_text("utf-8"))["findings"]
    return [finding_of(row) for row in rows]


def finding_of(row: dict[str, Any]) -> Finding:
    """Make a finding of what JSON holds of it."""
    pairs = {
        name: None if row[name] is None else tuple(math.nan if one is None else one for one in row[name])
        for name in ("interval", "rule", "asks", "parts")
    }
    return Finding(**{**row, **pairs})
