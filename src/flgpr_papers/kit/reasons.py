"""Experiments on why a statement of a paper does not hold on simulated lanes.

An experiment adds or takes away one cause, in the simulated world or in the processing, beside the
study: its lanes, settings and rules stay as they are. The explanation says beforehand between which
values a number has to lie. It *holds* if the number's interval of 95 % lies within them, is
*refuted* if it lies outside, and else *cannot say*. A number without a prediction stands for
comparison.
"""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from flgpr.store import write_whole
from flgpr_papers.kit.findings import (
    AGREES,
    DISAGREES,
    UNDECIDED,
    Bounds,
    Finding,
    Interval,
    decimals,
    judge,
)

HOLDS = "holds"
REFUTED = "refuted"
OUTCOMES = {AGREES: HOLDS, DISAGREES: REFUTED, UNDECIDED: UNDECIDED}
"""What is said of an explanation, by the verdict on its prediction."""
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
    explanation: str  #: what is said to be why; empty for a number that stands for comparison
    changed: str  #: what was added, taken away or done otherwise; "nothing" for the study as it is
    quantity: str  #: what was measured
    interval: Interval  #: the number and its 95 % interval
    sample: str  #: what the interval is over: so many seeds, mines or stretches of lane
    predicted: Bounds | None = None  #: between which values the explanation wants the number
    unit: str = ""  #: of the number
    #: verdict of the study's own rule on the number, where that and not ``predicted`` decides
    verdict: str = ""

    def __post_init__(self) -> None:
        asked = self.predicted is not None or bool(self.verdict)
        if asked != bool(self.explanation):
            raise ValueError(
                f"predicted must be given with an explanation and only with one, got "
                f"{self.predicted} and"
                f" {self.explanation!r} for {self.changed!r}"
            )

    @property
    def outcome(self) -> str:
        """What the number says of the explanation; empty where none was asked."""
        if self.verdict:
            return OUTCOMES[self.verdict]
        if self.predicted is None:
            return ""
        low, high = self.interval[1:]
        if math.isnan(low) or math.isnan(high):
            return UNDECIDED
        return OUTCOMES[judge(low, high, self.predicted)]

    @property
    def ours(self) -> str:
        """The number with its interval in words."""
        value, low, high = self.interval
        unit = f" {self.unit}" if self.unit else ""
        if math.isnan(value):
            return "nothing to measure"
        if not math.isfinite(high - low):
            return f"{value:.3g}{unit} (no interval)"
        digits = decimals((value, low, high), high - low)
        return f"{value:z.{digits}f}{unit} ({low:z.{digits}f} to {high:z.{digits}f})"

    @property
    def prediction(self) -> str:
        """What was predicted, in words."""
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


def road_trials(found: Sequence[Finding], prepared: Sequence[Finding]) -> list[Trial]:
    """Ask whether the road is why statements disagree on roads as found: the same study on prepared lanes.

    Parameters
    ----------
    found, prepared : sequence of Finding
        What the study found on roads as found and on prepared lanes.

    Returns
    -------
    list of Trial
        One for every statement that disagrees on roads as found: the road is the cause if it agrees on prepared lanes,
        and is not if it disagrees there, too.
    """
    by_statement = {(one.claim, one.group): one for one in prepared}
    made = []
    for one in found:
        if one.verdict != DISAGREES:
            continue
        other = by_statement.get((one.claim, one.group))
        if other is None or other.verdict not in OUTCOMES or other.interval is None:
            continue
        made.append(
            Trial(
                statement=one.claim,
                explanation="the road as found",
                changed="prepared lanes in place of roads as found",
                quantity=other.quantity or "number of the statement",
                interval=other.interval,
                sample="the study's own",
                unit=other.unit,
                verdict=other.verdict,
            )
        )
    return made


def trials_csv(trials: Sequence[Trial]) -> str:
    """Tabulate experiments: ``COLUMNS``, a row each."""
    stream = io.StringIO()
    csv.writer(stream, lineterminator="\n").writerows([COLUMNS, *(trial.row for trial in trials)])
    return stream.getvalue()


def write_trials(folder: Path, trials: Sequence[Trial]) -> Path:
    """Write ``reasons.csv`` into the folder of a study and return its path."""
    path = folder / "reasons.csv"
    write_whole(path, trials_csv(trials))
    return path
