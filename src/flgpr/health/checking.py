"""Whether a recording is right: everything that is asked of it, with figure, limit and what to try."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
import xarray as xr

from flgpr.health.channels import channel_table, median_around, steady_channels
from flgpr.health.findings import BETTER_DB, DEVIATIONS, LIMITS, QUESTIONS, SPOILING, Finding
from flgpr.health.hypotheses import TIED_DB, Way
from flgpr.health.judging import judge_levels, statistics
from flgpr.health.of_run import Examined, examined
from flgpr.model import Lane

RIGHT = "looks right"
DOUBTFUL = "doubtful"
WRONG = "wrong"
UNSEEN = "not observable"
_WORST_FIRST = (WRONG, DOUBTFUL, RIGHT, UNSEEN)
_WEAK = 12.0  # dB under the others, from where on a channel is doubtful
_LOUD = 9.0  # dB over them
_DOUBT_DB = 1.0  # gain of a way that is not sure, from where on it is a doubt, and
_DOUBT_ERRORS = 2.5  # standard errors, from where on a lesser gain is one, too
_DRIFT = (1.0, 0.2)  # dB and rad
_DRIFT_ERRORS = 3.0  # standard errors that it must have, too
_GAP = 2.5  # times the usual step
_TURNING = 0.2  # share of the scans at which the course turns round; a survey to and fro has few
_AROUND = 9  # steps whose median is the usual one
NEVER_SEEN = (
    "a datum that is wrong along the lane, or beside it where no lane is given; HH and VV exchanged; "
    "a sign, phase or gain that all channels share; stretches of scans in each other's place"
)
"""What no recording without known targets shows."""


@dataclass(frozen=True)
class Check:
    """One thing that was asked of a recording."""

    what: str
    verdict: str  #: "looks right", "doubtful", "wrong" or "not observable"
    words: str  #: with the figure and its limit
    advice: str = ""  #: what to try

    @property
    def sentence(self) -> str:
        """All of it in one line."""
        trying = f"; try: {self.advice}" if self.advice else ""
        return f"{self.words}{trying}"


@dataclass(frozen=True)
class Checked:
    """All that was asked of a recording, what is wrong first."""

    checks: tuple[Check, ...]

    @property
    def verdict(self) -> str:
        """The worst of the verdicts; what cannot be seen leaves a doubt where all is asked."""
        return next((one for one in (WRONG, DOUBTFUL) if self._of(one)), RIGHT)

    @property
    def answer(self) -> str:
        """The answer in one sentence."""
        found = self._of(WRONG) or self._of(DOUBTFUL)
        if found:
            more = f", and {len(found) - 3} more" if len(found) > 3 else ""
            words = "; ".join(one.words for one in found[:3])
            trying = f": {found[0].advice}" if len(found) == 1 and found[0].advice else ""
            return f"{self.verdict.capitalize()}: {words}{more}{trying}."
        return (
            "Looks right: no other sign, order, heading, lag, height or unit focuses clearly better "
            f"(limit {BETTER_DB:g} dB), and channels, tones, scans and positions show no fault."
        )

    def _of(self, verdict: str) -> list[Check]:
        return [one for one in self.checks if one.verdict == verdict]

    def as_json(self) -> dict[str, Any]:
        """Return it as JSON values."""
        checks = [asdict(one) for one in self.checks]
        return {"answer": self.answer, "verdict": self.verdict, "checks": checks}


def check_run(run: xr.Dataset, lane: Lane | None = None, doubts: Sequence[str] = ()) -> Checked:
    """Check whether a recording is right, before anybody detects on it.

    Parameters
    ----------
    run : xarray.Dataset
        A run.
    lane : Lane, optional
        Ground that is to be searched; with it the course is compared with its middle.
    doubts : sequence of str
        What else is doubtful, in words.

    Returns
    -------
    Checked
        Every question with its verdict.
    """
    of_run = examined(run, lane, thorough=True)
    checks = [_as_check(one) for one in of_run.health.findings]
    checks += [*_of_geometry(of_run), *_of_channels(of_run)]
    checks += [*_drift(of_run), *_gaps(run)]
    checks += [Check("positions and antennas", DOUBTFUL, words) for words in doubts]
    never = (
        NEVER_SEEN
        if lane is None
        else NEVER_SEEN.replace(", or beside it where no lane is given", "")
    )
    checks.append(Check("on any drive", UNSEEN, never))
    return Checked(tuple(sorted(checks, key=lambda one: _WORST_FIRST.index(one.verdict))))


def _as_check(one: Finding) -> Check:
    """Return a finding as the answer to a question."""
    done = f" ({one.done} by flgpr detect)" if one.done else ""
    return Check(QUESTIONS.get(one.name, one.name), WRONG, one.words + done, one.advice)


def _of_channels(of_run: Examined) -> Iterator[Check]:
    """Yield what sums tell of channels, tones, time zero and scans that are not at fault."""
    told = {one.name for one in of_run.health.findings}
    for one in judge_levels(of_run.sums, of_run.radar, _WEAK, _LOUD):
        if one.name not in told:
            told.add(one.name)
            yield Check(one.name, DOUBTFUL, one.words, one.advice)
    for name, value in statistics(of_run.sums, of_run.radar).items():
        if name not in told and np.isfinite(value):
            limit = LIMITS[name]
            unit = "" if limit.unit == "1" else f" {limit.unit}"
            yield Check(name, RIGHT, f"{value:.2g}{unit}, at most {limit.most:g}")


def _drift(of_run: Examined) -> Iterator[Check]:
    """Yield by how much channels drift whose standing part is strong enough to tell."""
    sums = of_run.sums
    table = channel_table(sums, of_run.radar.polarizations, sums.scans - sums.sweeps)
    steady = steady_channels(table)
    if not len(steady):
        words = "no channel has a standing part strong enough to tell"
        yield Check("drift", UNSEEN, words)
        return
    gain, phase = steady["gain_drift_db"].abs(), steady["phase_drift_rad"].abs()
    # What does not stand still adds to the means of the quarters: an error of each, in nepers.
    quarter = max(sums.scans // 4, 1)
    coherence = steady["coherence"].to_numpy()
    error = np.sqrt((1 - coherence) / (coherence * quarter))
    by_gain = gain > np.maximum(_DRIFT[0], _DRIFT_ERRORS * error * 20 / np.log(10))
    drifting = int((by_gain | (phase > np.maximum(_DRIFT[1], _DRIFT_ERRORS * error))).sum())
    # Many channels together tell a drift that they share better than each of them alone.
    shared_error = (
        _DRIFT_ERRORS * np.median(error) * 20 / np.log(10) / np.sqrt(min(len(steady), 16))
    )
    if abs(steady["gain_drift_db"].median()) > max(_DRIFT[0], shared_error):
        drifting = len(steady)
    words = (
        f"{drifting} of {len(steady)} channels drift, by up to {gain.max():.1f} dB and "
        f"{phase.max():.2f} rad from the first to the last quarter, at most {_DRIFT[0]:g} dB and "
        f"{_DRIFT[1]:g} rad"
    )
    advice = "let the radar warm up, or look at its clock and cables"
    yield _doubted(drifting > 0, "drift", words, advice)


def _doubted(is_doubt: bool, what: str, words: str, advice: str) -> Check:
    """Return a check that is in doubt, with advice, or looks right."""
    return Check(what, DOUBTFUL, words, advice) if is_doubt else Check(what, RIGHT, words)


def _gaps(run: xr.Dataset) -> Iterator[Check]:
    """Yield whether the course goes one way, and scans lie much farther apart than those around."""
    ways = np.diff(run["pose"].values[:, :2], axis=0)
    steps = np.hypot(*ways.T)
    if steps.size < _AROUND or not np.isfinite(steps).all():
        return
    backwards = np.mean(np.sum(ways[1:] * ways[:-1], axis=1) < 0)
    words = f"the course turns round at {backwards:.0%} of the scans, at most {_TURNING:.0%}"
    advice = "are scans and poses in the order in which they were taken?"
    yield _doubted(backwards > _TURNING, "course", words, advice)
    usual = median_around(steps, _AROUND)
    ratio = steps / np.maximum(np.maximum(usual, np.median(steps)), 1e-9)
    count = int(np.count_nonzero(ratio > _GAP))
    at = f", the first behind scan {int(np.argmax(ratio > _GAP))}" if count else ""
    words = (
        f"{count} gaps between scans{at}: the widest is {ratio.max():.1f} times the usual way, "
        f"at most {_GAP:g}"
    )
    advice = "scans were lost, or the positions leap"
    yield _doubted(count > 0, "gaps", words, advice)


def _of_geometry(of_run: Examined) -> Iterator[Check]:
    """Yield of sign, order, heading, lag, height and units what is doubtful, right or not seen."""
    ways = of_run.ways
    told = {one.name for one in of_run.health.findings}
    if not ways.is_seen:
        questions = ", ".join(words for name, words in QUESTIONS.items() if name not in told)
        words = f"whether {questions} are right cannot be told: {of_run.unseen}"
        yield Check("focus", DOUBTFUL if told.isdisjoint(SPOILING) else UNSEEN, words)
        return
    for question in QUESTIONS:
        others = [way for way in ways.others if way.hypothesis.question == question]
        if others and question not in told:
            yield _best_of(QUESTIONS[question], others)
    tied = [way.words for way in ways.others if abs(way.gain_db) < TIED_DB and not way.is_step]
    if tied:
        yield Check("on this drive", UNSEEN, f"whether {', or '.join(tied)}")


def _best_of(question: str, others: Sequence[Way]) -> Check:
    """Return the answer to a question that has others than the stated way."""
    best = max(others, key=lambda way: way.gain_db)
    is_doubt = best.gain_db > BETTER_DB and best.errors > _DOUBT_ERRORS
    is_doubt = is_doubt or (best.gain_db > _DOUBT_DB and best.errors > 1)
    if not is_doubt:
        words = f"next best {best.gain_db:+.1f} dB, at most {BETTER_DB:+g} if sure: {best.words}"
        return Check(question, RIGHT, words)
    words = (
        f"{best.words}? ({best.gain_db:+.1f} dB so taken, at most {BETTER_DB:+g}; "
        f"{best.errors:.1f} standard errors, {DEVIATIONS:g} would be sure)"
    )
    return Check(question, DOUBTFUL, words, best.hypothesis.advice)
