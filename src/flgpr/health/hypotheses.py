"""Whether a run is taken as it was recorded: the other ways to take it, and which of them is better.

One question, one table (``HYPOTHESES``), one figure (:meth:`~flgpr.health.focus.Taken.agreement`) and
one judgement (:attr:`Way.is_sure`). Data of the other sign of phase, pairs in another order, a turned
heading, poses of another scan, another height or another unit make consecutive looks agree less, and
undoing it makes them agree more. ``flgpr check`` tries all; ``flgpr detect`` and live try the quick
ones, and the former looks at more than a few scans only where one is better there.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from flgpr.health.findings import BETTER_DB, DEVIATIONS, QUESTIONS, Finding, finding
from flgpr.health.focus import Taken
from flgpr.types import FloatArray

TIED_DB = 0.1
"""Loss up to which a way is not told from what is stated, dB."""
MOST_LAG = 3
"""Scans by which poses may be late or early."""
QUICK_LAG = 2
"""Scans by which they may in the ways that are quick."""
POINTS_FEW = 4
"""Points of the patch of ground, every so many, for a first look."""
_MOST_CHANGES = 3  # things that may be wrong at once
_FEW = 3  # stretches that decide which ways are looked at further
_FAR_DB = 3.0  # under the best way there, dB, from where on one is not
_SCENE_DB = 3.0  # of power at the paths of a scene over their mirror, beyond which these are clear
_LEAST = 0.06  # correlation that counts as none


class Hypothesis(NamedTuple):
    """A way to take a run that is not the stated one."""

    question: str  #: which it answers, of ``QUESTIONS``
    words: str  #: what is wrong with the run, if it is the better way
    advice: str  #: how to mend it
    change: Callable[[Taken], Taken]
    quick: bool = False  #: whether it is tried in a detection, too
    mirrors: bool = False  #: whether it turns the paths of echoes round
    amount: float = np.nan  #: of one of a row of steps, in ``unit``
    unit: str = ""  #: of the amount; "heights": shares of the height, which are told in m

    @property
    def name(self) -> str:
        """Its words with the amount: no other has the same."""
        return self.words.format(abs(self.amount))


def _pose(change: Callable[[FloatArray], Any]) -> Callable[[Taken], Taken]:
    """Return a change of poses (scan, 6)."""
    return lambda taken: replace(taken, pose=np.asarray(change(taken.pose), np.float64))


def _scaled(*factors: float) -> Callable[[Taken], Taken]:
    """Return a change by factors of x, y, z, heading, pitch and roll."""
    return _pose(lambda pose: pose * np.array(factors))


def _turned(degrees: float) -> Callable[[Taken], Taken]:
    """Return a change of the heading."""
    return _pose(lambda pose: pose + np.deg2rad(degrees) * (np.arange(6) == 3))


def _raised(share: float) -> Callable[[Taken], Taken]:
    """Return a change of the height."""
    return lambda taken: replace(
        taken, pose=taken.pose + share * taken.stated_height * (np.arange(6) == 2)
    )


def _later(scans: int) -> Callable[[Taken], Taken]:
    """Return a change to poses so many scans later."""
    return _pose(lambda pose: pose[np.clip(np.arange(len(pose)) + scans, 0, len(pose) - 1)])


def _antennas(tx: Any, rx: Any) -> Callable[[Taken], Taken]:
    """Return a change of the places of transmitters and receivers by factors of x, y and z."""
    return lambda taken: replace(taken, tx=taken.tx * tx, rx=taken.rx * rx)


def _profiles(conjugated: bool, mirrored: bool) -> Callable[[Taken], Taken]:
    """Return a change of range profiles, those of conjugated or turned tones."""

    def change(taken: Taken) -> Taken:
        profiles = np.conj(taken.profiles) if conjugated else taken.profiles
        bins = profiles.shape[-1]
        return replace(
            taken, profiles=profiles[..., -np.arange(bins)] if mirrored else profiles.copy()
        )

    return change


def _by_receivers(taken: Taken) -> Taken:
    """Return pairs in the order receiver by receiver, where they are listed by transmitters."""
    count = len(taken.tx)
    groups = 1 + int(np.count_nonzero(np.any(np.diff(taken.tx, axis=0) != 0, axis=1)))
    if groups == count or count % groups:  # every pair has another transmitter than the one before
        receivers = len(np.unique(taken.rx, axis=0))
        if count % receivers:
            return taken
        groups = count // receivers
    order = np.arange(count).reshape(groups, -1).T.ravel()
    return replace(taken, tx=taken.tx[order], rx=taken.rx[order])


_CONJUGATE = "set signal.conjugate = true in the mapping"
_TONES = "turn the frequency axis round"
_UNIT = "state their unit in the mapping, and import again"
_SAME = np.ones(3)
_MIRROR = np.array([-1, 1, 1])
_LENGTHS = {
    "feet": 0.3048,
    "inches": 0.0254,
    "centimetres": 1e-2,
    "millimetres": 1e-3,
    "kilometres": 1e3,
}  # m; frequencies that are not in Hz make no run


HYPOTHESES = (
    Hypothesis(
        "paths",
        "the data are conjugated",
        _CONJUGATE,
        _profiles(conjugated=True, mirrored=True),
        quick=True,
        mirrors=True,
    ),
    Hypothesis(
        "paths",
        "the tones are in reverse order",
        _TONES,
        _profiles(conjugated=False, mirrored=True),
        quick=True,
        mirrors=True,
    ),
    Hypothesis(
        "paths",
        "the data are conjugated and their tones in reverse order",
        f"{_CONJUGATE} and {_TONES}",
        _profiles(conjugated=True, mirrored=False),
    ),
    *(
        Hypothesis(
            "receivers",
            f"the {name} are in reverse order",
            f"turn round the order of {name}, or the sign of their x",
            _antennas(tx, rx),
            quick=True,
        )
        for name, tx, rx in (
            ("receivers", _SAME, _MIRROR),
            ("transmitters", _MIRROR, _SAME),
            ("transmitters and receivers", _MIRROR, _MIRROR),
        )
    ),
    Hypothesis(
        "receivers",
        "the pairs are listed across transmitters, not one transmitter after the other",
        "change the order of the pairs",
        _by_receivers,
    ),
    *(
        Hypothesis(
            "heading",
            f"the heading is {{:.2g}} degrees too {'small' if degrees > 0 else 'large'}",
            "correct it, or how the array or the positioning antennas are mounted",
            _turned(degrees),
            quick=abs(degrees) == 20,
            amount=degrees,
            unit="degrees",
        )
        for degrees in (-45, -30, -20, -10, -5, 5, 10, 20, 30, 45)
    ),
    *(
        Hypothesis("heading", words, "correct the heading", _turned(degrees), quick=True)
        for degrees, words in (
            (180, "the heading is turned by 180 degrees, or the positions run backwards"),
            (90, "the heading is 90 degrees too small"),
            (-90, "the heading is 90 degrees too large"),
        )
    ),
    *(
        Hypothesis("heading", words, "correct it in the mapping", change, quick)
        for words, change, quick in (
            ("the heading counts counterclockwise", _scaled(1, 1, 1, -1, 1, 1), False),
            (
                "the heading counts from the x axis, counterclockwise",
                _pose(lambda pose: pose * [1, 1, 1, -1, 1, 1] + np.pi / 2 * (np.arange(6) == 3)),
                False,
            ),
            ("x and y are exchanged", _pose(lambda pose: pose[:, [1, 0, 2, 3, 4, 5]]), True),
            ("x counts to the left", _scaled(-1, 1, 1, 1, 1, 1), False),
        )
    ),
    *(
        Hypothesis("units", f"the {what} are in {name}, not metres", _UNIT, change, quick)
        for name, metres in _LENGTHS.items()
        for what, change, quick in (
            ("positions", _scaled(metres, metres, 1, 1, 1, 1), name == "feet"),
            ("heights", _scaled(1, 1, metres, 1, 1, 1), False),
            ("positions and heights", _scaled(metres, metres, metres, 1, 1, 1), False),
            ("antennas", _antennas(metres, metres), False),
        )
    ),
    Hypothesis(
        "units",
        "the positions were taken for feet, and are metres",
        _UNIT,
        _scaled(1 / 0.3048, 1 / 0.3048, 1, 1, 1, 1),
        quick=True,
    ),
    Hypothesis(
        "units",
        "the angles are in degrees, not radians",
        _UNIT,
        _scaled(1, 1, 1, *np.deg2rad([1, 1, 1])),
    ),
    *(
        Hypothesis(
            "lag",
            f"the poses are {abs(scans)} scan{'s' if abs(scans) > 1 else ''} "
            f"{'late' if scans > 0 else 'early'}",
            f"shift them by {abs(scans)} scan{'s' if abs(scans) > 1 else ''}",
            _later(scans),
            quick=abs(scans) <= QUICK_LAG,
        )
        for scans in range(-MOST_LAG, MOST_LAG + 1)
        if scans
    ),
    *(
        Hypothesis(
            "height",
            f"the height is {{:.2g}} m too {'small' if share > 0 else 'large'}",
            "measure the height of the antennas again",
            _raised(share),
            amount=share,
            unit="heights",
        )
        for share in (-0.2, -0.1, -0.06, -0.04, -0.02, 0.02, 0.04, 0.06, 0.1, 0.2)
    ),
)
"""The ways to take a run that are tried beside the stated one."""


@dataclass(frozen=True)
class Way:
    """A way to take a run, and how much better than before it is."""

    hypothesis: Hypothesis
    gain_db: float  #: of the agreement
    errors: float = 0.0  #: the gain over its standard error; 0 where it was not looked at closely
    height: float = np.nan  #: stated, of the antennas, m
    peak: float = 0.0  #: of a row of steps, where between them it would be best; 0: not known

    @classmethod
    def compared(
        cls, one: Hypothesis, values: FloatArray, others: FloatArray, *height: float
    ) -> Way:
        """Compare the agreement of looks as stated and the other way, both (value,)."""
        difference = others - values
        error = np.std(difference, ddof=1) / np.sqrt(difference.size) if difference.size > 3 else 0
        errors = float(difference.mean() / error) if error > 0 else 0.0
        return cls(one, gain_db(values, others), errors, *height)

    @property
    def is_step(self) -> bool:
        """Whether it is one of a row of steps."""
        return bool(np.isfinite(self.hypothesis.amount))

    @property
    def is_sure(self) -> bool:
        """Whether it is better beyond chance."""
        return self.gain_db > BETTER_DB and self.errors > DEVIATIONS

    @property
    def words(self) -> str:
        """What is wrong with the run, if it is the better way."""
        size = self.height if self.hypothesis.unit == "heights" else 1
        return self.hypothesis.words.format(abs(self.peak or self.hypothesis.amount) * size)

    @property
    def finding(self) -> Finding:
        """It as what is wrong with the run."""
        one = self.hypothesis
        return finding(one.question, self.gain_db, self.words, advice=one.advice)


@dataclass(frozen=True)
class Ways:
    """What was found: ways that are better, one after the other, and all others."""

    adopted: tuple[Way, ...] = ()
    others: tuple[Way, ...] = ()  #: with all that was adopted
    is_seen: bool = False  #: whether the looks agree beyond chance: else nothing is told


def gain_db(values: FloatArray, others: FloatArray) -> float:
    """Return by how much looks agree better the other way than as stated, dB."""
    if not values.size:
        return 0.0
    return float(20 * np.log10(max(others.mean(), _LEAST) / max(values.mean(), _LEAST)))


def tried(taken: Taken, quick: bool) -> Iterator[tuple[Hypothesis, Taken]]:
    """Yield the other ways to take a run, all or the quick ones, and the run so taken.

    Echoes whose paths are turned round look like those of a vehicle that drives backwards: by the
    paths of a scene, where these are clear, the two are told apart.
    """
    scene_db = taken.scene_db()
    for one in HYPOTHESES:
        if one.quick < quick or (one.question == "receivers" and len(taken.tx) == 1):
            continue
        if (scene_db > _SCENE_DB) if one.mirrors else (scene_db < -_SCENE_DB):
            continue
        changed = one.change(taken)
        if changed.is_possible and not changed.is_like(taken):
            yield one, changed


def judge_paths(taken: Taken | None) -> list[Finding]:
    """Return whether a scene lies at the mirror of its paths, which is told without poses.

    By which of the ways it came there they alone tell.
    """
    mirrored_db = np.nan if taken is None else -taken.scene_db()
    if not mirrored_db > _SCENE_DB:
        return []
    ways = [one for one in HYPOTHESES if one.mirrors]
    words = " or ".join(one.words for one in ways)
    return [finding("paths", mirrored_db, words, advice=" or ".join(one.advice for one in ways))]


def first_gains(taken: Taken) -> Iterator[tuple[Hypothesis, float]]:
    """Yield the quick ways, and how much better than what is stated they are at a first look, dB."""
    values = taken.agreement(points_every=POINTS_FEW)
    for one, other in tried(taken, quick=True):
        yield one, gain_db(values, other.agreement(points_every=POINTS_FEW))


def best_way(ways: Sequence[Way]) -> Way | None:
    """Return the best of the ways that are better beyond chance.

    Of ways that are as good it is the first question's: an angle is off more often than its unit.
    """
    better = [way for way in ways if way.is_sure]
    most = max((way.gain_db for way in better), default=0.0)
    as_good = [way for way in better if way.gain_db > most - BETTER_DB]
    order = list(QUESTIONS)
    return min(
        as_good,
        key=lambda way: (order.index(way.hypothesis.question), -way.gain_db),
        default=None,
    )


def best_ways(taken: Taken, quick: bool) -> Ways:
    """Find what makes the looks of a run agree better, one thing after the other.

    Parameters
    ----------
    taken : Taken
        Scans of a run.
    quick : bool
        Whether the quick ways alone are tried.
    """
    adopted: list[Way] = []
    while True:
        values = taken.agreement()
        others = _others(taken, values, quick)
        rows = {way.hypothesis.unit for way in adopted if way.is_step}  # one step of each is enough
        best = best_way([way for way in others if way.hypothesis.unit not in rows])
        if best is None or len(adopted) == _MOST_CHANGES:
            chance = np.zeros_like(values)
            is_seen = Way.compared(HYPOTHESES[0], chance, values).errors > 3
            return Ways(tuple(adopted), tuple(others), is_seen)
        adopted.append(replace(best, peak=_peak(best, others)))
        taken = best.hypothesis.change(taken)


def _others(taken: Taken, values: FloatArray, quick: bool) -> list[Way]:
    """Return all other ways to take a run that agrees by ``values`` as it is taken.

    Those that are far from the best on a part of the stretches are not looked at further.
    """
    every = max(1, len(taken.stretches) // _FEW)
    few = taken.agreement(every, POINTS_FEW)
    height = taken.stated_height
    ways = []
    for one, other in tried(taken, quick):
        gain = gain_db(few, other.agreement(every, POINTS_FEW))
        ways.append((Way(one, gain, height=height), other))
    best = max((way.gain_db for way, _ in ways), default=0.0)
    return [
        Way.compared(way.hypothesis, values, other.agreement(), height)
        if way.gain_db > max(best, 0.0) - _FAR_DB
        else way
        for way, other in ways
    ]


def _peak(best: Way, others: Sequence[Way]) -> float:
    """Return the step at which a parabola through the gains of a row is highest; 0 if there is none."""
    amount = best.hypothesis.amount
    row = [(0.0, 0.0)]
    for way in others:
        one = way.hypothesis
        if one.unit == best.hypothesis.unit and way.errors and abs(one.amount) <= 2.5 * abs(amount):
            row.append((one.amount, way.gain_db))
    if not best.is_step or len(row) < 4:
        return 0.0
    amounts, gains = np.transpose(row)
    curve, slope, _ = np.polyfit(amounts, gains, 2)
    peak = -slope / (2 * curve) if curve < 0 else 0.0
    return float(peak) if 0 < peak / amount < 2 else 0.0
