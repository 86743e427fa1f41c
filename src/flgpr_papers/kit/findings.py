"""Findings: statements of a paper, what the simulated lanes show, and the rules of the verdicts.

No verdict "agrees" or "disagrees" without an interval (:mod:`flgpr_papers.kit.intervals`). Every
statement has a rule, the values of its number between which it holds:

- *within*: it agrees if the interval lies within the rule, and disagrees if it lies outside.
- *larger*: the rule is open above, from a limit on. It agrees if the interval lies above the limit.
  It disagrees if not even the interval's end is ``worth`` more than the limit, the least gain that
  would count: equal numbers are not larger, which a limit alone could never say.
- *alike*: the paper's figure is a sample, known to an interval of its own. The rule reaches over
  that interval, and at least a margin to either side of the figure (:func:`near`). It agrees as
  *within* does, by a test of equivalence (Schuirmann 1987, J. Pharmacokinet. Biopharm. 15, 657):
  the paper's error counts once, in the rule, so that enough lanes of ours always decide. It
  disagrees if our number lies outside the rule and differs from the figure by more than the errors
  of both.
- *all of*: a claim of several parts agrees if every part does, and disagrees if one does. The
  intervals of the parts are then wide enough to hold all together (Bonferroni).

What an interval does not decide cannot be said. Each row has its power, how often its rule would
have answered: agrees if the statement held as the paper says, disagrees if the number were off by
the margin. Where an experiment of the paper's size was repeated, the verdict is on the mean of all
repeats together (:func:`over_experiments`), and beside it stands in how many of them the number by
itself shows what the paper says.

A quick run decides nothing: its lanes are short and hold a few mines, so that its findings have
numbers and no verdicts. The interval of a share ends at 0 and 1, that of a difference of two shares
at -1 and 1: no value beyond is possible.
"""

from __future__ import annotations

import json
import math
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.special import bdtrik, ndtr

from flgpr.store import write_whole
from flgpr.types import Entries, FloatArray
from flgpr_papers.kit.intervals import (
    SHARE,
    SHARE_DIFFERENCE,
    Bounds,
    Interval,
    Z,
    clip,
    difference_of_means,
    students,
    together,
)
from flgpr_papers.kit.settings import packaged_text

AGREES = "agrees"
DISAGREES = "disagrees"
UNDECIDED = "cannot say"
OPEN = "open"
VERDICTS = (AGREES, DISAGREES, UNDECIDED)
"""Verdicts on a statement; ``OPEN`` stands for a question that the paper does not answer."""
NO_VERDICT = "no verdict: a quick run is too small"
"""What stands in place of a verdict in a quick run."""
WORTH = 0.05
"""Least gain of a share that counts, where a statement declares no other."""
_ENOUGH = 12  # experiments in which a number is exactly 0, so that no chance makes it so
_MOST_DECIMALS = 4  # of a number on a page
_MOST_DIGITS = 3  # significant digits of a number on a page


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
    rule: Bounds | None = None  #: the claim agrees where the number lies between these
    group: str = ""  #: the lanes, where the same was asked on several groups of lanes
    worth: float = 0.0  #: least gain over the limit of a rule open above, below which it disagrees
    #: the number of every part of a claim of several parts, whose intervals are not stored
    parts: tuple[float, ...] = ()
    names: tuple[str, ...] = ()  #: of the parts
    #: whether the parts are choices of ours, which all have to come to the same verdict
    choices: bool = False
    unit: str = ""  #: of the number and the rule
    #: least and largest possible value of the number; None: anything is possible
    bounds: Bounds | None = None
    figure: Interval | None = None  #: the paper's, with what its own sample leaves open
    #: how often the rule would have said that the claim agrees if it held as the paper says, and
    #: that it disagrees if the number were off by the margin
    power: Bounds | None = None
    #: experiments of the paper's size whose number shows what the paper says, and their number
    shown: tuple[int, int] | None = None

    def __post_init__(self) -> None:
        is_decided = self.verdict in (AGREES, DISAGREES)
        if is_decided and not (self.interval and not np.isnan(self.interval).any()):
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
        by_rule = None  # the intervals of several parts are not known here
        if self.rule is not None and self.interval is not None and not self.parts:
            by_rule = judge(self.interval, self.rule, self.worth, self.figure)
        if is_decided and by_rule not in (None, self.verdict):
            raise ValueError(
                f"verdict on {self.claim!r} must be {by_rule!r} by its rule ({self.criterion}), "
                f"got {self.verdict!r}"
            )

    @property
    def criterion(self) -> str:
        """The rule in words; empty if there is none."""
        if self.rule is None:
            return ""
        unit = f" {self.unit}" if self.unit else ""
        least, most = self.rule
        if math.isfinite(most):
            return f"{least:.3g} to {most:.3g}{unit}"
        return f"above {least:g}{unit}" + (f", worth {self.worth:g}" if self.worth else "")

    @property
    def power_in_words(self) -> str:
        """The power in words; empty where there is none."""
        if self.power is None:
            return ""
        return "agrees {:.0%}, disagrees {:.0%}".format(*self.power)

    @property
    def shown_in_words(self) -> str:
        """In how many experiments of the paper's size it shows; empty without repeats."""
        return "" if self.shown is None else "{} of {}".format(*self.shown)


def judge(
    interval: Interval, rule: Bounds, worth: float = 0.0, figure: Interval | None = None
) -> str:
    """Return the verdict on a number by a rule.

    Parameters
    ----------
    interval : Interval
        The number and its interval.
    rule : Bounds
        The claim holds between these; infinite above where a number is to be larger.
    worth : float
        Least gain over the limit of such a rule that would count.
    figure : Interval, optional
        The paper's figure with its own interval, where the number is to be alike.
    """
    value, low, high = interval
    least, most = rule
    is_open_above = math.isinf(most)
    if (low > least) if is_open_above else (least <= low and high <= most):
        return AGREES
    if figure is not None:
        _, below, above = difference_of_means(interval, figure)
        return DISAGREES if not shows(value, rule) and (below > 0 or above < 0) else UNDECIDED
    if high < least + (worth if is_open_above else 0.0) or low > most:
        return DISAGREES
    return UNDECIDED


def near(figure: Interval, margin: float, bounds: Bounds | None = None) -> Bounds:
    """Return the rule of a number that is to be alike a figure of the paper.

    Parameters
    ----------
    figure : Interval
        The paper's, and the interval to which its own sample knows it.
    margin : float
        Distance from the figure that is alike in any case.
    bounds : Bounds, optional
        Bounds of the number, at which the rule is cut.
    """
    value, low, high = figure
    least, most = bounds or (-math.inf, math.inf)
    return max(min(low, value - margin), least), min(max(high, value + margin), most)


def shows(value: float, rule: Bounds) -> bool:
    """Return whether a number by itself, without an interval, is what a rule asks for."""
    least, most = rule
    return bool(value > least if math.isinf(most) else least <= value <= most)


def power(
    interval: Interval,
    rule: Bounds,
    worth: float = 0.0,
    figure: Interval | None = None,
    bounds: Bounds | None = None,
) -> Bounds:
    """Return how often the rule would answer: agrees if it held, disagrees if it were off.

    The number is taken for normal with the interval that was measured, half as wide to either side
    as its wider half. It holds at the paper's figure, in the middle of the rule, or by twice the
    worth over a limit. It is off by the margin, half the width of the rule beyond its nearer
    possible end, or at a limit itself.

    Parameters
    ----------
    interval : Interval
        The number with its interval.
    rule, worth, figure
        As :func:`judge` takes them.
    bounds : Bounds, optional
        Bounds of the number.
    """
    value, low, high = interval
    half = max(value - low, high - value)
    if not 0 < half < math.inf:
        return (1.0, 1.0) if half == 0 else (0.0, 0.0)
    error = half / Z
    least, most = rule
    lowest, highest = bounds or (-math.inf, math.inf)
    below, above = least - half, most + half  # beyond these the rule says that it disagrees
    if math.isinf(most):
        holds = least + (2 * worth or WORTH)
        off = [least if worth else least - WORTH]
        below += worth
    else:
        reach = (most - least) / 2
        holds = least + reach
        off = [max(least - reach, lowest)] if least > lowest else []
        off += [min(most + reach, highest)] if most < highest else []
    if figure is not None:
        holds, low, high = figure
        below = min(least, holds - math.hypot(half, holds - low))
        above = max(most, holds + math.hypot(half, high - holds))
    # The number lies where its interval would lie within the rule.
    agrees = ndtr((most - half - holds) / error) - ndtr((least + half - holds) / error)
    disagrees = [ndtr((below - x) / error) + ndtr((x - above) / error) for x in off]
    return max(float(agrees), 0.0), float(min(disagrees, default=0.0))


def over_experiments(experiments: Sequence[Finding]) -> Finding:
    """Return the finding of an experiment that was repeated, each time with other lanes.

    The number is the mean over the experiments with Student's interval, which needs nothing of how
    a single one came to its own; of several parts each has one, and they hold together.

    Parameters
    ----------
    experiments : sequence of Finding
        The same statement, judged by every experiment.
    """
    first = experiments[0]
    if first.rule is None:
        return first
    table = np.array([one.parts or one.interval[:1] for one in experiments if one.interval])
    bounds = first.bounds
    level = together(len(table.T))
    parts = [
        (0.0, 0.0, 0.0) if _is_nothing(row) else students(row, level, bounds) for row in table.T
    ]
    texts = [in_words(*part, first.unit) for part in parts]
    answers = _answers(first, first.rule, parts)
    if first.choices:
        given = dict(zip(first.names, parts, strict=True))
        texts, answers["verdict"] = _by_choice(given, first.rule, first.worth)
    elif first.names:
        texts = [f"{name} {_signed(part)}" for name, part in zip(first.names, parts, strict=True)]
    shown = sum(all(shows(value, first.rule) for value in row) for row in table)
    return replace(
        first,
        ours="; ".join(texts),
        parts=tuple(part[0] for part in parts) if first.parts else (),
        shown=(shown, len(table)),
        **answers,
    )


def _is_nothing(values: FloatArray) -> bool:
    """Return whether a number is none: exactly 0 in so many experiments that it cannot but be 0.

    Such is the difference of two classifiers of a single feature, which rank alike. A share, whose
    difference is 0 where both find all, has :func:`paired_shares`.
    """
    return len(values) >= _ENOUGH and not values.any()


def _by_choice(
    intervals: Mapping[str, Interval], rule: Bounds, worth: float
) -> tuple[list[str], str]:
    """Return a claim's number by every choice in words, and the verdict if all come to the same.

    Where they do not, each has its verdict beside it.
    """
    each = {choice: judge(interval, rule, worth) for choice, interval in intervals.items()}
    verdicts = set(each.values())
    words = {choice: f"{choice}: {in_words(*interval)}" for choice, interval in intervals.items()}
    if len(verdicts) == 1:
        return list(words.values()), verdicts.pop()
    return [f"{text} {each[choice]}" for choice, text in words.items()], UNDECIDED


def _answers(asked: Finding, rule: Bounds, parts: Sequence[Interval]) -> Entries:
    """Return verdict and power of a claim by its parts, and the part with the lowest interval."""
    by = rule, asked.worth, asked.figure
    return {
        "verdict": all_of([judge(part, *by) for part in parts]),
        "power": joint_power([power(part, *by, asked.bounds) for part in parts]),
        "interval": min(parts, key=lambda part: part[1]),
    }


def joint_power(powers: Sequence[Bounds]) -> Bounds:
    """Return the power of a claim of several parts: all have to agree, or one to disagree.

    The parts are taken for independent, and a single one for off.
    """
    agrees, disagrees = zip(*powers, strict=True)
    return math.prod(agrees), min(disagrees)


def all_of(verdicts: Sequence[str]) -> str:
    """Return the verdict on a claim that holds only if all its parts do."""
    if DISAGREES in verdicts:
        return DISAGREES
    if all(verdict == AGREES for verdict in verdicts):
        return AGREES
    return UNDECIDED


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
    rule: Bounds | None = None,
    worth: float = 0.0,
    **fields: Any,
) -> Finding:
    """Return the finding of a number, judged by its rule; it is open without one.

    Parameters
    ----------
    claim, paper, quantity, rule, worth, **fields
        As the fields of :class:`Finding`; at its ``bounds`` the interval is cut.
    interval : Interval
        The number and its interval.
    """
    asked = Finding(claim, paper, "", OPEN, quantity=quantity, rule=rule, worth=worth, **fields)
    interval = clip(interval, asked.bounds)
    answers: Entries = {"interval": interval}
    if rule is not None:
        answers = _answers(asked, rule, [interval])
    return replace(asked, ours=in_words(*interval, asked.unit), **answers)


def in_words(
    value: float, low: float, high: float, unit: str = "", alone: str = "one sample, no interval"
) -> str:
    """Format a value with its interval, with as many digits as the width of the interval supports.

    There are at most three significant digits of the largest of the three numbers, and at most four
    decimals. ``alone`` stands in place of an interval that is not finite.
    """
    if math.isnan(value):
        return "nothing to measure"
    unit_after = f" {unit}" if unit else ""
    if not math.isfinite(high - low):
        return f"{value:.3g}{unit_after} ({alone})"
    digits = decimals((value, low, high), high - low)
    return f"{value:z.{digits}f}{unit_after} ({low:z.{digits}f} to {high:z.{digits}f})"


def decimals(values: Sequence[float], width: float) -> int:
    """Return the number of decimals for numbers that are known to a width.

    The width's two leading digits are shown, and never more decimals than the module's limits.
    """
    largest = max(map(abs, values))
    by_width = _MOST_DIGITS
    if width > 0:
        by_width = 1 - math.floor(math.log10(width))
    by_size = _MOST_DIGITS
    if largest > 0:
        by_size = _MOST_DIGITS - 1 - math.floor(math.log10(largest))
    return max(0, min(by_width, by_size, _MOST_DECIMALS))


def of_parts(
    claim: str,
    paper: str,
    intervals: Mapping[str, Interval],
    rule: Bounds,
    worth: float = 0.0,
    bounds: Bounds | None = None,
    **fields: Any,
) -> Finding:
    """Return the finding of a claim that several numbers are what a rule asks for.

    The number of the finding is that of the part with the lowest interval.

    Parameters
    ----------
    claim, paper, rule, worth
        As the fields of :class:`Finding`.
    intervals : mapping of str to Interval
        Number and interval of every part by its name. The intervals are to hold all together, see
        :func:`flgpr_papers.kit.intervals.together`.
    bounds : Bounds, optional
        Bounds of the numbers, at which the intervals are cut.
    **fields
        Further fields, or others in place of what the parts give.
    """
    cut = {name: clip(interval, bounds) for name, interval in intervals.items()}
    ours = "; ".join(f"{name} {_signed(interval)}" for name, interval in cut.items())
    parts = tuple(value for value, _, _ in cut.values())
    asked = Finding(claim, paper, ours, OPEN, rule=rule, worth=worth, bounds=bounds)
    given = {**_answers(asked, rule, [*cut.values()]), **fields}
    return replace(asked, parts=parts, names=tuple(cut), **given)


def _signed(interval: Interval) -> str:
    """Format a difference with its interval, all with their signs."""
    if not np.isfinite(interval).all():
        return f"{interval[0]:+z.2f} (no interval)"
    if not any(interval):
        return "0 in every one"
    digits = decimals(interval, interval[2] - interval[1])
    value, low, high = (f"{number:+z.{digits}f}" for number in interval)
    return f"{value} ({low} to {high})"


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
    rows = []
    for finding in findings:
        verdict = NO_VERDICT if quick and finding.verdict != OPEN else finding.verdict
        rows.append(row_of(finding) | {"verdict": verdict})
    content = {"quick": quick, **more, "findings": rows}
    write_whole(folder / "findings.json", json.dumps(content, indent=2, ensure_ascii=False) + "\n")


def row_of(finding: Finding) -> Entries:
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


def finding_of(row: Entries) -> Finding:
    """Return the finding of a row that :func:`row_of` made."""
    # Findings of the earlier rules had entries that are no more.
    entries = {name: row[name] for name in Finding.__dataclass_fields__ if name in row}
    for name in ("interval", "rule", "parts", "bounds", "figure", "power", "shown"):
        if row.get(name) is not None:
            entries[name] = tuple(math.nan if number is None else number for number in row[name])
    entries["names"] = tuple(row.get("names", ()))
    if entries.get("rule") and math.isnan(entries["rule"][1]):
        entries["rule"] = (entries["rule"][0], math.inf)
    return Finding(**entries)


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
        words, verdict = _by_choice(cut, rule, given["worth"])
        return of_parts(
            intervals=cut,
            bounds=bounds,
            ours="; ".join(words),
            verdict=verdict,
            choices=True,
            interval=next(iter(cut.values())),
            **given,
        )


def _rule_of(declared: Entries) -> Bounds | None:
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
