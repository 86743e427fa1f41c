"""Statements of a paper, declared in its ``statements.toml``, and how their numbers judge them."""

from __future__ import annotations

import math
import tomllib
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from flgpr.types import Entries
from flgpr_papers.kit.findings import (
    UNDECIDED,
    WORTH,
    Finding,
    in_words,
    judge,
    measured,
    near,
    of_parts,
)
from flgpr_papers.kit.intervals import SHARE, SHARE_DIFFERENCE, Bounds, Interval, clip
from flgpr_papers.kit.settings import packaged_text

_BOUNDS = {"share": SHARE, "difference": SHARE_DIFFERENCE}
_TEXTS = ("claim", "paper", "note", "quantity")


class Statements:
    """What a paper says: a claim by its name, and the rule that its number is judged by.

    An entry has ``claim`` and ``paper``, and may have ``quantity``, ``note``, ``unit`` and
    ``ours``, the words for ``value``, ``low`` and ``high``. Fields in braces are filled in. ``is``
    says what values are possible: a "share", or the "difference" of two. One of these is the rule:
    ``rule``, the least and the largest number that agrees; ``above``, a limit, with the ``worth`` of
    a gain over it that counts, 0.05 by default; ``alike``, how far a number may lie from the
    paper's figure in any case. Without one it is our own question.

    Parameters
    ----------
    paper : str
        Name of the paper.

    Attributes
    ----------
    declared : dict
        The entries by name.
    """

    def __init__(self, paper: str) -> None:
        self.declared: dict[str, Entries] = tomllib.loads(packaged_text(paper, "statements"))

    def number(
        self,
        name: str,
        interval: Interval,
        rule: Bounds | None = None,
        above: float | None = None,
        figure: Interval | None = None,
        **fields: Any,
    ) -> Finding:
        """Judge a statement by a number.

        Parameters
        ----------
        name : str
            Name of the statement in the file.
        interval : Interval
            The number and its interval.
        rule : tuple of float, optional
            Rule in place of the declared one; the texts have it as ``rule``.
        above : float, optional
            Limit in place of the declared one; the texts have it as ``above``.
        figure : Interval, optional
            The paper's figure with the interval to which its own sample knows it, of a statement
            that is "alike".
        **fields
            What stands for the fields of the texts.
        """
        declared = self.declared[name]
        bounds = _BOUNDS.get(declared.get("is", ""))
        rule = rule or _rule_of(declared)
        if above is not None:
            rule = (above, math.inf)
        if figure is not None:
            rule = near(figure, declared["alike"], bounds)
        finding = measured(
            interval=interval,
            unit=declared.get("unit", ""),
            bounds=bounds,
            figure=figure,
            **_judged_by(rule, declared, {"rule": rule, "above": above, **fields}),
        )
        if "ours" not in declared or finding.interval is None:
            return finding
        numbers = dict(zip(("value", "low", "high"), finding.interval, strict=True))
        return replace(finding, ours=declared["ours"].format(**numbers, **fields))

    def larger(self, name: str, intervals: Mapping[str, Interval], **fields: Any) -> Finding:
        """Judge that several numbers lie ``above`` a limit, 0 by default.

        The parameters are those of :meth:`within`.
        """
        declared = self.declared[name]
        rule = declared.get("above", 0.0), math.inf
        given = _judged_by(rule, declared, fields) | {"quantity": ""}
        return of_parts(intervals=intervals, **given)

    def within(self, name: str, intervals: Mapping[str, Interval], **fields: Any) -> Finding:
        """Judge that several numbers lie within the ``rule``; that of the finding is the widest.

        Parameters
        ----------
        name : str
            Name of the statement in the file.
        intervals : mapping of str to Interval
            The numbers by name; their intervals are to hold all together.
        **fields
            What stands for the fields of the texts.
        """
        declared = self.declared[name]
        widest = max(intervals, key=lambda part: max(map(abs, intervals[part][1:])))
        value, low, high = intervals[widest]
        return of_parts(
            intervals=intervals,
            ours=f"widest {widest} {value:+.3f} ({low:+.3f} to {high:+.3f})",
            interval=intervals[widest],
            **_judged_by(tuple(declared["rule"]), declared, fields),
        )

    def by_every(self, name: str, intervals: Mapping[str, Interval], **fields: Any) -> Finding:
        """Judge a statement that must not depend on a choice of ours, by every choice.

        Where the choices are not of one verdict, it cannot be said, and each has its verdict beside
        it. The parameters are those of :meth:`within`.
        """
        declared = self.declared[name]
        rule = _rule_of(declared)
        if rule is None:
            raise ValueError(f"{name} must have a rule, got {sorted(declared)}")
        given = _judged_by(rule, declared, fields)
        bounds = _BOUNDS[declared["is"]]
        cut = {choice: clip(interval, bounds) for choice, interval in intervals.items()}
        each = {choice: judge(one, rule, given["worth"]) for choice, one in cut.items()}
        verdicts = set(each.values())
        words = {choice: f"{choice}: {in_words(*one)}" for choice, one in cut.items()}
        if len(verdicts) > 1:
            words = {choice: f"{text} {each[choice]}" for choice, text in words.items()}
        return of_parts(
            intervals=cut,
            bounds=bounds,
            ours="; ".join(words.values()),
            verdict=verdicts.pop() if len(verdicts) == 1 else UNDECIDED,
            interval=next(iter(cut.values())),
            **given,
        )


def _rule_of(declared: Mapping[str, Any]) -> Bounds | None:
    """Return the rule that a statement declares, if it does."""
    if "above" in declared:
        return declared["above"], math.inf
    return tuple(declared["rule"]) if "rule" in declared else None


def _judged_by(rule: Bounds | None, declared: Entries, fields: Entries) -> Entries:
    """Return a rule, the gain over it that counts, and the texts with their fields filled in."""
    is_open_above = rule is not None and math.isinf(rule[1])
    worth = float(declared.get("worth", WORTH)) if is_open_above else 0.0
    texts = {name: declared.get(name, "").format(**fields) for name in _TEXTS}
    return {"rule": rule, "worth": worth, **texts}
