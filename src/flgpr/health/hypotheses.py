"""Which way of taking a recording focuses best: as stated, or with something changed.

The figure is how well consecutive looks agree, phase included. The image of a scan is compared with
that of a later one at the same ground, where the poses place it; what scans of other ground agree
by, too, such as what stands still, is taken off. Data of the other sign of phase, pairs in another
order, a turned heading, poses of another scan, another height or another unit make the looks
agree less, and undoing it makes them agree more.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import combinations
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from flgpr.health.geometry import AIRBORNE, GeometryCheck, Patch, deviations
from flgpr.health.sums import LEAST_POWER
from flgpr.model.frames import lane_to_scan, scan_to_lane
from flgpr.types import FloatArray

ComplexArray = NDArray[np.complexfloating]

BETTER_DB = 0.5
"""Gain from which on another way counts as better, dB."""
SURE = 4.0
"""Standard errors that the gain must have, too."""
TIED_DB = 0.1
"""Loss up to which a way is not told from what is stated, dB."""
BLOCKS = 16
"""Stretches of a run that are looked at."""
BLOCK_SCANS = 4
"""Consecutive scans of a stretch: each is compared with all later ones of it."""
MOST_LAG = 3
"""Scans by which poses may be late or early."""
MOST_CHANGES = 3
"""Things that may be wrong at once."""
_POINTS_FEW = 4  # points of the patch of ground, every so many, for a first look
_POINTS = 2  # and then
_FEW = 3  # stretches that decide which ways are looked at further
_FAR_DB = 3.0  # under the best way there, dB, from where on one is not
_SCENE_DB = (
    3.0  # of power at the paths of a scene over that at their mirror, beyond which these are clear
)
_SEEN = 3.0  # standard errors that the agreement itself must have
_LEAST = 0.06  # correlation that counts as none
_STEPS = (0.05, 60.0)  # m between scans of a vehicle that drives, least and most
_ARRAY = (0.02, 20.0)  # m, extent of an array
_OTHER_PATCH = 1.3  # ratio of heights, from where on another patch of ground is looked at

POSITIONS_UNIT = "state their unit in the mapping, and import again"


@dataclass(frozen=True)
class Taken:
    """Some scans of a run, and how their data, antennas and poses are taken."""

    echoes: ComplexArray  #: (scan, polarization, pair, frequency) without what stands still
    numbers: NDArray[np.integer]  #: (scan,) of the scans in the run
    stretch: NDArray[np.integer]  #: (scan,) number of the stretch that a scan is of
    frequency: FloatArray  #: (frequency,) Hz
    tx: FloatArray  #: (pair, 3) transmitters in the vehicle frame, m
    rx: FloatArray  #: (pair, 3) receivers
    pose: FloatArray  #: (scan of the run, 6)

    @property
    def height(self) -> float:
        """Height of the antennas above the ground, m."""
        return float(np.median(self.pose[:, 2]) + np.mean([self.tx[:, 2], self.rx[:, 2]]))

    def is_like(self, other: Taken) -> bool:
        """Whether it is the same but for what no look can show."""
        turned = np.deg2rad(0.1)
        return (
            self.echoes is other.echoes
            and np.array_equal(self.tx, other.tx)
            and np.array_equal(self.rx, other.rx)
            and np.allclose(self.pose[:, :3], other.pose[:, :3], atol=1e-3)
            and np.allclose(self.pose[:, 3:], other.pose[:, 3:], atol=turned)
        )

    @property
    def has_even_tones(self) -> bool:
        """Whether range profiles can be made of the tones."""
        return GeometryCheck(self.frequency, self.tx, self.rx).tones is not None

    @property
    def step(self) -> float:
        """Usual distance between scans, m."""
        return float(np.median(np.hypot(*np.diff(self.pose[:, :2], axis=0).T)))

    @property
    def is_possible(self) -> bool:
        """Whether a vehicle may have such an array and course."""
        extent = float(np.ptp(np.concatenate([self.tx, self.rx]), axis=0).max())
        return (
            0.1 < self.height < AIRBORNE
            and _STEPS[0] < self.step < _STEPS[1]
            and (len(self.tx) == 1 or _ARRAY[0] < extent < _ARRAY[1])
        )


class Hypothesis(NamedTuple):
    """A way to take a run that is not the stated one."""

    question: str  #: which it answers
    words: str  #: what is wrong with the run, if it is the better way
    advice: str  #: how to mend it
    change: Callable[[Taken], Taken]
    amount: float = np.nan  #: of one of a row of steps, in ``unit``
    unit: str = ""
    mirrors: bool = False  #: whether it turns the paths of echoes round


def _poses(change: Callable[[FloatArray], FloatArray]) -> Callable[[Taken], Taken]:
    """Return a change of poses."""
    return lambda taken: replace(taken, pose=change(taken.pose.copy()))


def _scaled(*factors: float) -> Callable[[Taken], Taken]:
    """Return a change by factors of x, y, z, heading, pitch and roll."""
    return _poses(lambda pose: pose * np.array(factors))


def _echoes(change: Callable[[ComplexArray], ComplexArray]) -> Callable[[Taken], Taken]:
    """Return a change of data."""
    return lambda taken: replace(taken, echoes=change(taken.echoes))


def _antennas(
    tx: Callable[[FloatArray], FloatArray], rx: Callable[[FloatArray], FloatArray]
) -> Callable[[Taken], Taken]:
    """Return a change of the places of transmitters and receivers."""
    return lambda taken: replace(taken, tx=tx(taken.tx), rx=rx(taken.rx))


def _same(places: FloatArray) -> FloatArray:
    return places


def _mirrored(places: FloatArray) -> FloatArray:
    return np.asarray(places * [-1, 1, 1])


def _other_axis_first(places: FloatArray, groups: int) -> FloatArray:
    """Return places of pairs in groups as if they were listed across the groups."""
    return np.asarray(places.reshape(groups, -1, 3).swapaxes(0, 1).reshape(-1, 3))


def _by_receivers(taken: Taken) -> Taken:
    """Return pairs in the order receiver by receiver, where they are listed by transmitters."""
    count = len(taken.tx)
    groups = 1 + int(np.count_nonzero(np.any(np.diff(taken.tx, axis=0) != 0, axis=1)))
    if groups == count or count % groups:  # every pair has another transmitter than the one before
        groups = len(np.unique(taken.rx, axis=0))
        if count % groups:
            return taken
        groups = count // groups
    return replace(
        taken, tx=_other_axis_first(taken.tx, groups), rx=_other_axis_first(taken.rx, groups)
    )


def _later(pose: FloatArray, scans: int) -> FloatArray:
    """Return poses so many scans later."""
    return pose[np.clip(np.arange(len(pose)) + scans, 0, len(pose) - 1)]


def _axis(axis: int, offset: float) -> Callable[[Taken], Taken]:
    """Return a change that adds to a component of all poses."""
    return _poses(lambda pose: pose + offset * (np.arange(6) == axis))


_SENSE = "sign of phase, order of tones"
_PAIRS = "order of pairs"
_COURSE = "heading and axes"
_LAG = "lag of poses"
_HEIGHT = "height"
_UNITS = "units"
QUESTIONS = (_SENSE, _PAIRS, _COURSE, _LAG, _HEIGHT, _UNITS)
"""What is asked of a recording, in the order of the table."""


def hypotheses(taken: Taken) -> Iterator[Hypothesis]:
    """Yield the ways to take a run that are tried beside the stated one."""
    conjugate = "set signal.conjugate = true in the mapping"
    tones = "turn the frequency axis round"
    yield Hypothesis(_SENSE, "the data are conjugated", conjugate, _echoes(np.conj), mirrors=True)
    yield Hypothesis(
        _SENSE,
        "the tones are in reverse order",
        tones,
        _echoes(lambda data: data[..., ::-1]),
        mirrors=True,
    )
    yield Hypothesis(
        _SENSE,
        "the data are conjugated and their tones in reverse order",
        f"{conjugate} and {tones}",
        _echoes(lambda data: data[..., ::-1].conj()),
    )
    order = "turn round the order of {}, or the sign of their x"
    if len(taken.tx) > 1:
        for name, tx, rx in (
            ("receivers", _same, _mirrored),
            ("transmitters", _mirrored, _same),
            ("transmitters and receivers", _mirrored, _mirrored),
        ):
            words = f"the {name} are in reverse order"
            yield Hypothesis(_PAIRS, words, order.format(name), _antennas(tx, rx))
        words = "the pairs are listed across transmitters, not one transmitter after the other"
        yield Hypothesis(_PAIRS, words, "change the order of the pairs", _by_receivers)
    yield from _of_heading()
    yield from _of_units()
    for scans in (*range(-MOST_LAG, 0), *range(1, MOST_LAG + 1)):
        by = f"{abs(scans)} scan{'' if abs(scans) == 1 else 's'}"
        yield Hypothesis(
            _LAG,
            f"the poses are {by} {'late' if scans > 0 else 'early'}",
            f"shift them by {by}",
            _poses(partial(_later, scans=scans)),
        )
    for share in (-0.2, -0.1, -0.06, -0.04, -0.02, 0.02, 0.04, 0.06, 0.1, 0.2):
        offset = share * taken.height
        yield Hypothesis(
            _HEIGHT,
            f"the height is {{:.2g}} m too {'small' if offset > 0 else 'large'}",
            "measure the height of the antennas again",
            _axis(2, offset),
            offset,
            "m",
        )


def _of_heading() -> Iterator[Hypothesis]:
    """Yield other headings and axes."""
    for degrees in (-45, -30, -20, -10, -5, 5, 10, 20, 30, 45):
        yield Hypothesis(
            _COURSE,
            f"the heading is {{:.2g}} degrees too {'small' if degrees > 0 else 'large'}",
            "correct it, or how the array or the positioning antennas are mounted",
            _axis(3, np.deg2rad(degrees)),
            degrees,
            "degrees",
        )
    advice = "correct the heading"
    for degrees, words in (
        (180, "the heading is turned by 180 degrees, or the positions run backwards"),
        (90, "the heading is 90 degrees too small"),
        (-90, "the heading is 90 degrees too large"),
    ):
        yield Hypothesis(_COURSE, words, advice, _axis(3, np.deg2rad(degrees)))
    advice = "correct it in the mapping"
    yield Hypothesis(
        _COURSE, "the heading counts counterclockwise", advice, _scaled(1, 1, 1, -1, 1, 1)
    )
    yield Hypothesis(
        _COURSE,
        "the heading counts from the x axis, counterclockwise",
        advice,
        _poses(lambda pose: pose * [1, 1, 1, -1, 1, 1] + [0, 0, 0, np.pi / 2, 0, 0]),
    )
    yield Hypothesis(
        _COURSE, "x and y are exchanged", advice, _poses(lambda pose: pose[:, [1, 0, 2, 3, 4, 5]])
    )
    yield Hypothesis(_COURSE, "x counts to the left", advice, _scaled(-1, 1, 1, 1, 1, 1))


def _of_units() -> Iterator[Hypothesis]:
    """Yield other units of positions, heights, antennas and angles.

    Frequencies that are not in Hz make no run.
    """
    lengths = {"feet": 0.3048, "inches": 0.0254, "centimetres": 1e-2, "millimetres": 1e-3}
    lengths |= {"kilometres": 1e3}
    for name, factor in lengths.items():
        yield Hypothesis(
            _UNITS,
            f"the positions are in {name}, not metres",
            POSITIONS_UNIT,
            _scaled(factor, factor, 1, 1, 1, 1),
        )
        yield Hypothesis(
            _UNITS,
            f"the heights are in {name}, not metres",
            POSITIONS_UNIT,
            _scaled(1, 1, factor, 1, 1, 1),
        )
        yield Hypothesis(
            _UNITS,
            f"positions and heights are in {name}, not metres",
            POSITIONS_UNIT,
            _scaled(factor, factor, factor, 1, 1, 1),
        )
        yield Hypothesis(
            _UNITS,
            f"the antennas are in {name}, not metres",
            POSITIONS_UNIT,
            _antennas(partial(np.multiply, factor), partial(np.multiply, factor)),
        )
    yield Hypothesis(
        _UNITS,
        "the positions were taken for feet, and are metres",
        POSITIONS_UNIT,
        _scaled(1 / 0.3048, 1 / 0.3048, 1, 1, 1, 1),
    )
    degree = np.deg2rad(1)
    yield Hypothesis(
        _UNITS,
        "the angles are in degrees, not radians",
        POSITIONS_UNIT,
        _scaled(1, 1, 1, degree, degree, degree),
    )


class Looks:
    """Tells how well the looks of a run agree, however it is taken.

    Parameters
    ----------
    height : float
        Height as it is stated, m: heights alike look at the same patch of ground.
    """

    def __init__(self, height: float) -> None:
        self._height = height
        self._of: ComplexArray | None = None
        self._profiles: ComplexArray | None = None

    def agreement(self, taken: Taken, every: int = 1, points_every: int = _POINTS) -> FloatArray:
        """Return how well the scans of a stretch agree, over what unrelated ones do.

        Parameters
        ----------
        taken : Taken
            Scans of a run, and how they are taken.
        every : int
            Looks at every so many stretches.
        points_every : int
            Looks at every so many points of the ground.

        Returns
        -------
        (value,) ndarray of float
            For every stretch and polarization the correlation of its looks (root of the mean square),
            from 0 to 1; chance is about 0.
        """
        check = GeometryCheck(taken.frequency, taken.tx, taken.rx)
        profiles, path = self._profiled(check, taken.echoes)
        height = taken.height
        if abs(np.log(height / self._height)) < np.log(_OTHER_PATCH):
            height = self._height
        points = Patch(height).points[::points_every]

        def look(scan: int, places: FloatArray) -> ComplexArray:
            antennas = check.antennas(taken.pose[taken.numbers[scan]])
            image = check.image(profiles[scan], path, *antennas, places).sum(axis=-2)
            power = np.linalg.norm(image, axis=-1, keepdims=True)
            return np.asarray(image / np.maximum(power, LEAST_POWER))

        scans = np.flatnonzero(taken.stretch % every == 0)
        stretch = taken.stretch[scans]
        looks = np.array([look(scan, points) for scan in scans.tolist()])
        values = []
        for number in np.unique(stretch):
            members = np.flatnonzero(stretch == number)
            by_lag: dict[int, list[FloatArray]] = {}
            for first, second in combinations(members, 2):
                poses = taken.pose[taken.numbers[scans[[first, second]]]]
                again = look(
                    int(scans[second]), lane_to_scan(scan_to_lane(points, poses[0]), poses[1])
                )
                alike = np.abs(np.einsum("spn,pn->sp", looks.conj(), again)) ** 2
                unrelated = alike[stretch != number]
                chance = unrelated.mean(axis=0) if len(unrelated) else 1 / len(points)
                lag = int(np.diff(taken.numbers[scans[[first, second]]])[0])
                by_lag.setdefault(lag, []).append(alike[first] - chance)
            if by_lag:
                lags = [np.mean(of_lag, axis=0) for of_lag in by_lag.values()]
                power = np.mean(lags, axis=0)
                # Of roots no single stretch with bright targets decides.
                values.append(np.sign(power) * np.sqrt(np.abs(power)))
        return np.concatenate(values) if values else np.zeros(0)

    def scene_db(self, taken: Taken) -> float:
        """Return the power at the paths of a scene over that at their mirror, dB; NaN: not known."""
        profiles, path = self._profiled(
            GeometryCheck(taken.frequency, taken.tx, taken.rx), taken.echoes
        )
        values = [
            GeometryCheck.scene_db(one, path, taken.height) for one in np.concatenate(profiles)
        ]
        known = np.array(values)[np.isfinite(values)]
        return float(np.median(known)) if known.size else np.nan

    def _profiled(self, check: GeometryCheck, echoes: ComplexArray) -> tuple[ComplexArray, float]:
        """Return range profiles of echoes, made once for all ways that leave these as they are."""
        if self._profiles is None or self._of is not echoes:
            self._of = echoes
            self._profiles = check.profiles(echoes[..., check.tones])[0]
        return self._profiles, check.path_of(self._profiles.shape[-1])


@dataclass(frozen=True)
class Way:
    """A way to take a run, and how much better than before it is."""

    hypothesis: Hypothesis
    gain_db: float  #: of the agreement
    errors: float  #: the gain over its standard error; 0 where it was not looked at closely
    taken: Taken
    peak: float = 0.0  #: of a row of steps, where between them it would be best; 0: not known

    @property
    def is_step(self) -> bool:
        """Whether it is one of a row of steps."""
        return bool(np.isfinite(self.hypothesis.amount))

    @property
    def is_sure(self) -> bool:
        """Whether it is better beyond chance."""
        return self.gain_db > BETTER_DB and self.errors > SURE

    @property
    def words(self) -> str:
        """What is wrong with the run, if it is the better way."""
        return self.hypothesis.words.format(abs(self.peak or self.hypothesis.amount))


@dataclass(frozen=True)
class Ways:
    """What was found: ways that are better, one after the other, and all others."""

    adopted: tuple[Way, ...] = ()
    others: tuple[Way, ...] = ()  #: with all that was adopted
    agreement: float = np.nan  #: of the looks with all that was adopted
    is_seen: bool = False  #: whether that is beyond chance: else nothing is told


def best_ways(stated: Taken) -> Ways:
    """Find what makes the looks of a run agree better, one thing after the other."""
    looks = Looks(stated.height)
    taken = stated
    adopted: list[Way] = []
    while True:
        values = looks.agreement(taken)
        others = _tried(looks, taken, values)
        rows = {way.hypothesis.unit for way in adopted if way.is_step}  # one step of each is enough
        better = [way for way in others if way.is_sure and way.hypothesis.unit not in rows]
        if not better or len(adopted) == MOST_CHANGES:
            break
        # Of ways that are as good the first question's: an angle is off more often than its unit.
        most = max(way.gain_db for way in better)
        as_good = [way for way in better if way.gain_db > most - BETTER_DB]
        first = min(QUESTIONS.index(way.hypothesis.question) for way in as_good)
        as_good = [way for way in as_good if way.hypothesis.question == QUESTIONS[first]]
        best = max(as_good, key=lambda way: way.gain_db)
        adopted.append(replace(best, peak=_peak(best, others)))
        taken = best.taken
    is_seen = deviations(values) > _SEEN
    return Ways(tuple(adopted), tuple(others), float(values.mean()), is_seen)


def _tried(looks: Looks, taken: Taken, values: FloatArray) -> list[Way]:
    """Return all other ways to take a run that agrees by ``values`` as it is taken.

    Those that are far from the best on a part of the stretches are not looked at further. Echoes
    whose paths are turned round look like those of a vehicle that drives backwards: by the paths of
    a scene, where these are clear, the two are told apart.
    """
    ways = []
    scene_db = looks.scene_db(taken)
    every = max(1, int(taken.stretch[-1] + 1) // _FEW)
    few = looks.agreement(taken, every, _POINTS_FEW)
    for one in hypotheses(taken):
        if (one.mirrors and scene_db > _SCENE_DB) or (not one.mirrors and scene_db < -_SCENE_DB):
            continue
        changed = one.change(taken)
        if changed.is_possible and not changed.is_like(taken):
            gain = _gain_db(looks.agreement(changed, every, _POINTS_FEW), few)
            ways.append(Way(one, gain, 0.0, changed))
    best = max((way.gain_db for way in ways), default=0.0)
    for place, way in enumerate(ways):
        if way.gain_db > max(best, 0.0) - _FAR_DB:
            others = looks.agreement(way.taken)
            gain = _gain_db(others, values)
            ways[place] = replace(way, gain_db=gain, errors=deviations(others - values))
    return ways


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


def _gain_db(values: FloatArray, before: FloatArray) -> float:
    """Return by how much looks agree better, dB."""
    return float(20 * np.log10(max(values.mean(), _LEAST) / max(before.mean(), _LEAST)))
