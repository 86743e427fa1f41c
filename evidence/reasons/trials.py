"""Experiments on why a statement of a paper does not hold on simulated lanes.

An experiment adds or takes away one cause, in the simulated world or in the processing. The lanes,
settings and rules of the study itself stay as they are. The explanation predicts between which
values a number has to lie. The explanation *holds* if the 95 % interval of the number lies within
them, is *refuted* if it lies outside, and otherwise the experiment *cannot say*. A number without a
prediction is shown for comparison.
"""

from __future__ import annotations

import csv
import io
import math
import tomllib
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import reduce
from pathlib import Path
from typing import Any

import numpy as np

from flgpr.progress import Track
from flgpr_papers.kit.cache import read_or_make
from flgpr_papers.kit.findings import AGREES, DISAGREES, UNDECIDED, Finding, in_words, judge
from flgpr_papers.kit.intervals import Bounds, Interval, students

HOLDS = "holds"
REFUTED = "refuted"
OUTCOMES = {AGREES: HOLDS, DISAGREES: REFUTED, UNDECIDED: UNDECIDED}
"""Outcome of an explanation by the verdict on its prediction."""
ABOVE_ZERO: Bounds = (0.0, math.inf)
"""Prediction of a difference that is larger than zero."""
BELOW_ZERO: Bounds = (-math.inf, 0.0)
"""Prediction of a difference that is smaller than zero."""
COLUMNS = (
    "statement",
    "explanation",
    "changed",
    "quantity",
    "ours",
    "predicted",
    "outcome",
    "sample",
)
"""Columns of the tables of experiments."""


@dataclass(frozen=True)
class Trial:
    """A number of an experiment, and what an explanation predicts of it."""

    statement: str  #: claim of the study that does not hold here
    explanation: str  #: the cause that is tried; empty for a number shown for comparison
    changed: str  #: what was added, removed or done in another way; "nothing" for the study itself
    quantity: str  #: what was measured
    interval: Interval  #: the number and its 95 % interval
    sample: str  #: sample of the interval: number of seeds, mines or stretches of lane
    predicted: Bounds | None = None  #: least and largest value that the explanation predicts
    unit: str = ""  #: of the number
    #: verdict of the study's own rule on the number, where that rule decides and not ``predicted``
    verdict: str = ""

    def __post_init__(self) -> None:
        has_prediction = self.predicted is not None or bool(self.verdict)
        if has_prediction != bool(self.explanation):
            raise ValueError(
                f"predicted must be given with an explanation and only with one, got "
                f"{self.predicted} and {self.explanation!r} for {self.changed!r}"
            )

    @property
    def outcome(self) -> str:
        """Outcome of the explanation; empty for a number shown for comparison."""
        if self.verdict:
            return OUTCOMES[self.verdict]
        if self.predicted is None:
            return ""
        if any(map(math.isnan, self.interval[1:])):
            return UNDECIDED
        return OUTCOMES[judge(self.interval, self.predicted)]

    @property
    def ours(self) -> str:
        """The number with its interval in words."""
        return in_words(*self.interval, self.unit, "no interval")

    @property
    def prediction(self) -> str:
        """The prediction in words; empty for a number shown for comparison."""
        if self.verdict:
            return "agrees by the study's rule"
        if self.predicted is None:
            return ""
        low, high = self.predicted
        unit = f" {self.unit}" if self.unit else ""
        if math.isinf(high):
            return f"above {low:g}{unit}"
        if math.isinf(low):
            return f"below {high:g}{unit}"
        return f"{low:g} to {high:g}{unit}"

    @property
    def row(self) -> tuple[str, ...]:
        """Cells of a table, by ``COLUMNS``."""
        texts = (self.statement, self.explanation, self.changed, self.quantity)
        return (*texts, self.ours, self.prediction, self.outcome, self.sample)


@dataclass(frozen=True)
class Question:
    """What several trials of a statement have in common."""

    statement: str  #: claim of the study that does not hold here
    quantity: str  #: what is measured
    sample: str  #: sample of the intervals
    unit: str = ""  #: of the quantity

    def shown(self, changed: str, interval: Interval) -> Trial:
        """Return a number that is shown for comparison."""
        return self.asked("", changed, interval, None)

    def asked(self, why: str, changed: str, interval: Interval, predicted: Bounds | None) -> Trial:
        """Return a number of which an explanation, if there is one, predicts where it lies."""
        rule = predicted if why else None
        return Trial(
            self.statement, why, changed, self.quantity, interval, self.sample, rule, self.unit
        )


def measured(
    folder: Path,
    changes: Iterable[str],
    numbers: Sequence[int],
    experiment: Callable[[str, int], tuple[str, Callable[[], Any]]],
    track: Track,
    label: str,
) -> dict[str, list[Any]]:
    """Return what was measured with every change on every lane; what is on disk is read.

    Parameters
    ----------
    folder : Path
        Folder of the study; records lie in its ``reasons``.
    changes : iterable of str
        What is changed.
    numbers : sequence of int
        Seeds or repeats of the lanes.
    experiment : callable
        Returns the name of a record's file, which tells all that it depends on, and what makes it.
    track, label
        Shows progress.
    """
    jobs = [(name, number) for name in changes for number in numbers]
    records: dict[str, list[Any]] = {}
    for name, number in track(jobs, label, len(jobs)):
        stem, make = experiment(name, number)
        record = read_or_make(folder / "reasons" / f"{stem}.json", make)
        records.setdefault(name, []).append(record)
    return records


def declared_trials(
    paper: str, part: str, records: Mapping[str, Sequence[Any]], **fields: Any
) -> list[Trial]:
    """Return the trials that the file of a paper beside this module declares for a part.

    A question has ``statement``, ``quantity``, ``unit`` and the ``number`` of every record that is
    averaged: its name, keys from table to table with points between them, or the difference of two.
    ``bounds`` are its least and largest value, and ``sample`` names what is counted. Of its
    ``trials`` each says what is ``changed``, ``of`` which records it is where they have another
    name, and what an ``explanation`` has ``predicted``.

    Parameters
    ----------
    paper, part : str
        Name of the file, and of the table in it.
    records : mapping of str to sequence
        What was measured, by what was changed.
    **fields
        What stands for the fields in braces.
    """
    declared = tomllib.loads(Path(__file__).with_name(f"{paper}.toml").read_text("utf-8"))
    trials = []
    for question in declared[part]:
        bounds = question.get("bounds")
        for trial in question["trials"]:
            of = records[trial.get("of", trial["changed"])]
            values = [_number(record, question["number"]) for record in of]
            count = int(np.isfinite(values).sum())
            sample = question.get("sample", "{count} seeds").format(count=count, **fields)
            texts = question["statement"], question["quantity"], sample, question.get("unit", "")
            changed = trial["changed"].format(**fields)
            rule = tuple(trial["predicted"]) if "predicted" in trial else None
            interval = students(values, bounds=bounds)
            why = trial.get("explanation", "")
            trials.append(Question(*texts).asked(why, changed, interval, rule))
    return trials


def _number(record: Any, name: str) -> float:
    """Return a number of a record by its name, or the difference of two."""
    first, *rest = [
        reduce(lambda table, key: table[int(key) if key.isdigit() else key], one.split("."), record)
        for one in name.split(" - ")
    ]
    return float(first - sum(rest))


def road_trials(as_found: Sequence[Finding], prepared: Sequence[Finding]) -> list[Trial]:
    """Return trials of the road as the reason why statements disagree on roads as found.

    The trial is the same study on prepared lanes. The road is the reason if the statement agrees
    there, and is not if it disagrees there, too.

    Parameters
    ----------
    as_found, prepared : sequence of Finding
        Findings of the study on roads as found and on prepared lanes.

    Returns
    -------
    list of Trial
        One for every statement that disagrees on roads as found and that is judged by an interval
        on prepared lanes.
    """
    by_statement = {(finding.claim, finding.group): finding for finding in prepared}
    trials = []
    for finding in as_found:
        if finding.verdict != DISAGREES:
            continue
        other = by_statement.get((finding.claim, finding.group))
        if other is None or other.verdict not in OUTCOMES or other.interval is None:
            continue
        trial = Trial(
            statement=finding.claim,
            explanation="the road as found",
            changed="prepared lanes in place of roads as found",
            quantity=other.quantity or "number of the statement",
            interval=other.interval,
            sample="the study's own",
            unit=other.unit,
            verdict=other.verdict,
        )
        trials.append(trial)
    return trials


def trials_csv(trials: Sequence[Trial]) -> str:
    """Format experiments as CSV: the columns ``COLUMNS``, a row for each."""
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(COLUMNS)
    for trial in trials:
        writer.writerow(trial.row)
    return stream.getvalue()
