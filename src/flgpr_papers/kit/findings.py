"""A statement of a paper beside what the simulated lanes show, and the rules by which it is judged.

A claim that something is larger agrees if the 95 % interval of the difference lies above zero, disagrees if it lies
below. A figure of the paper agrees if it lies in the 95 % interval of ours. A number with a rule agrees if its interval
lies within the rule, disagrees if it lies outside. What an interval does not decide cannot be said.
"""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from flgpr.io import write_whole

AGREES, DISAGREES, UNDECIDED, OPEN = "agrees", "disagrees", "cannot say", "open"
VERDICTS = (AGREES, DISAGREES, UNDECIDED)
"""What is said of a statement; ``OPEN`` is said of a question that the paper does not answer."""
Interval = tuple[float, float, float]
"""A value and the ends of its 95 % interval."""


@dataclass(frozen=True)
class Finding:
    """One statement of a paper beside ours.

    Attributes
    ----------
    claim, paper, ours : str
        What the paper says, its figure ("not tried" where the question is ours) and ours with its interval.
    verdict : {"agrees", "disagrees", "cannot say", "open"}
        By the module's rules, or by those that the paper's own module adds.
    note : str
        What stands behind it, and why it may differ.
    quantity : str
        The number that stands for the claim, where it is one.
    interval : (float, float, float), optional
        That number and its 95 % interval.
    rule : (float, float), optional
        The claim agrees where the number lies between these.
    group : str
        On which lanes, where the same was asked of several.
    """

    claim: str
    paper: str
    ours: str
    verdict: str
    note: str = ""
    quantity: str = ""
    interval: Interval | None = None
    rule: tuple[float, float] | None = None
    group: str = ""


def judge(low: float, high: float, rule: tuple[float, float]) -> str:
    """Judge an interval by the rule that it has to lie in."""
    if rule[0] <= low and high <= rule[1]:
        return AGREES
    return DISAGREES if high < rule[0] or low > rule[1] else UNDECIDED


def larger(low: float, high: float, limit: float = 0.0) -> str:
    """Judge a claim that something lies above a limit by the interval of it."""
    return AGREES if low > limit else DISAGREES if high < limit else UNDECIDED


def within(figure: float, low: float, high: float) -> str:
    """Judge a figure of the paper by our interval."""
    return AGREES if low <= figure <= high else DISAGREES


def measured(
    claim: str,
    paper: str,
    quantity: str,
    interval: Interval,
    rule: tuple[float, float] | None = None,
    verdict: str = OPEN,
) -> Finding:
    """Make the finding of a number, judged by its rule if there is one."""
    value, low, high = interval
    said = verdict if rule is None else judge(low, high, rule)
    return Finding(claim, paper, f"{value:.3f} ({low:.3f} to {high:.3f})", said, "", quantity, interval, rule)


def write_findings(folder: Path, found: Sequence[Finding], quick: bool, **more: Any) -> None:
    """Write ``findings.json``, in which a number that is not finite is null, and whatever else is told of the run."""

    def plain(value: Any) -> Any:
        if isinstance(value, tuple):
            return [plain(one) for one in value]
        return None if isinstance(value, float) and not math.isfinite(value) else value

    rows = [{name: plain(value) for name, value in asdict(one).items()} for one in found]
    told = {"quick": quick, **more, "findings": rows}
    write_whole(folder / "findings.json", json.dumps(told, indent=2, ensure_ascii=False) + "\n")


def read_findings(folder: Path) -> list[Finding]:
    """Read what :func:`write_findings` wrote; NaN stands for a number that was not finite."""
    rows = json.loads((folder / "findings.json").read_text("utf-8"))["findings"]
    return [finding_of(row) for row in rows]


def finding_of(row: dict[str, Any]) -> Finding:
    """Make a finding of what JSON holds of it."""
    pairs = {
        name: None if row[name] is None else tuple(math.nan if one is None else one for one in row[name])
        for name in ("interval", "rule")
    }
    return Finding(**{**row, **pairs})
