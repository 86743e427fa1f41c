"""Health of a run that comes in scan by scan, and every scan without what is at fault in it."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field

import numpy as np

from flgpr.health.findings import (
    LEAST_TONES,
    LIMITS,
    MOST_PAIRS,
    MOST_TONES,
    MOVING_DB,
    Finding,
    finding,
    listed,
)
from flgpr.health.focus import AIRBORNE, like_polarized, looked_at, taken
from flgpr.health.hypotheses import HYPOTHESES, POINTS_FEW, QUICK_LAG, Way, best_way, tried
from flgpr.health.judging import (
    Radar,
    judge_course,
    judge_sums,
    of_tones,
    over_alike,
    over_living,
    pair_names,
)
from flgpr.health.sums import BURST_DB, HealthSums, ScanFigures
from flgpr.model import Lane
from flgpr.types import Arrays, BoolArray, ComplexArray, Entries, FloatArray

LASTING = 3
"""Scans in a row with the same fault from which on a pair is left out, or values are filled in."""
DOUBTFUL = 2
"""Scans in a row without good positions from which on it is told."""
_LEAST_STEP = 0.05  # m, under which a vehicle may stand
_MOST_SWAY = 0.25  # m, beyond which it drives
_KNOWN_CHANGES = 4  # of a vehicle that drives, which those of one that stands are compared with
_UNSURE_DB = 40.0  # over the number of changes, by which a tone must stand out more
_LEAST_CHANNELS = 4  # of fewer, a burst on one is not told from a disturbed tone
_FIRST_JUDGED = 24  # scans from which on sums are judged, and then at twice as many each time
_EVERY = (4, 16)  # scans between two looks at the geometry, while there are few, and later
_MANY = 32  # scans, after which it is later
_LEAST_VALUES = 10  # of the agreement of looks, to be judged
_FIRST_VALUES = 4  # from which on a way may be far off, or clearly the right one
_CLEAR_DB = 12.0  # of such a way: the stated one shows nothing in common
_FAR = 0.5  # of the agreement as stated, under which a way is
_REMEMBERED = 160  # places, and values of the agreement, that are judged
_FEW_TONES = 0.01  # share of the tones that are filled in from those beside
_LOOKED_AT = 4  # consecutive scans of a look, with the poses of those before and after
_LEAST_LOOKED_AT = 3  # of these, which are of use


_LATER = {
    *("dead polarization", "stuck pairs", "swapped pairs", "turned pairs", "noisy tones"),
    *("noise", "jitter", "time zero"),
}
"""What is judged by the sums of many scans; the rest is told of every scan."""
_STATE = {
    "absent",
    "quiet",
    "doubts",
    "pose",
    "places",
    "steps",
    "changes",
    "judged_from",
    "noisy",
}
"""Attributes of the watch that a snapshot holds as they are."""


@dataclass(frozen=True)
class CheckedScan:
    """A scan without what is at fault in it, and what was found."""

    signal: ComplexArray | None  #: None: the scan is of no use
    findings: list[Finding] = field(default_factory=list)  #: those that were not told before
    repeated: bool = False  #: whether it holds the data of the scan before


class LiveHealth:
    """Watches over the scans of a radar as they come.

    Parameters
    ----------
    radar : Radar
        Names and places of channels and tones.

    Attributes
    ----------
    lane : Lane or None
        Ground that is searched; with it the course is compared with its middle.
    """

    def __init__(self, radar: Radar) -> None:
        self._radar = radar
        self.lane: Lane | None = None
        shape = (len(radar.polarizations), len(radar.tx_position), radar.frequency.size)
        self.sums = HealthSums(shape)
        self._told: dict[str, set[int]] = {}  # by name, of which pairs or tones
        self._absent = np.zeros(shape[1], np.int64)  # scans in a row that lack a pair
        self._quiet = np.zeros(shape[1], np.int64)  # in which it was dead
        self._doubts = 0  # scans in a row without good positions
        self._pose: FloatArray | None = None  # that came last
        self._places = deque[tuple[float, float]](maxlen=_REMEMBERED)  # x and y, m
        self._steps = deque[float](maxlen=32)  # of the vehicle while it drove, m
        self._changes = deque[float](maxlen=32)  # of the data then, dB
        self._judged_from = _FIRST_JUDGED  # scans from which on sums are judged next
        self._noisy: list[int] = []  # tones that stay out
        self.looks = LiveLooks(radar)

    def take(
        self, signal: ComplexArray, pose: FloatArray | None, follows: bool = True
    ) -> CheckedScan:
        """Take in a scan.

        Parameters
        ----------
        signal : (polarization, pair, frequency) ndarray of complex
            Its data.
        pose : (6,) ndarray of float, or None
            Its pose, as it came.
        follows : bool
            Whether it was measured next after the scan before: none was lost or overtaken.

        Returns
        -------
        CheckedScan
            The scan with pairs and tones at fault set to zero, and the others scaled up for them.
        """
        figures = self.sums.add(signal)
        drives = self._drives(pose)
        found = self._positions(figures, pose, drives)
        self._absent = np.where(figures.finite.all(axis=0), 0, self._absent + 1)
        gaps, of_gaps = self._few_gaps(signal)
        pairs, of_pairs = self._pairs_at_fault(figures, (self._absent >= LASTING) & ~gaps)
        tones, of_tones = self._tones_at_fault(figures)
        found += of_gaps + of_pairs + of_tones
        if figures.repeated and drives:
            found += self._tell(
                finding("repeated scans", self.sums.repeated).acted("they are left out")
            )
            self.looks.remember(None, pose, follows)
            return CheckedScan(None, found, repeated=True)
        cleaned = self._cleaned(signal, figures, pairs, gaps, tones)
        self.looks.remember(cleaned, pose, follows)
        if cleaned is not None:
            found += self._later()
        return CheckedScan(cleaned, found)

    def _tell(self, one: Finding) -> list[Finding]:
        """Return a finding unless it was told before, of all its pairs or tones."""
        numbers = set(one.pairs or one.tones)
        known = self._told.get(one.name)
        if known is not None and numbers <= known:
            return []
        self._told[one.name] = numbers | (known or set())
        return [one]

    def _tell_all(self, findings: list[Finding]) -> list[Finding]:
        """Return those of findings that were not told before."""
        return [told for one in findings for told in self._tell(one)]

    def _drives(self, pose: FloatArray | None) -> bool:
        """Return whether a pose lies farther from the one before than that of a standing vehicle."""
        before = self._pose
        if pose is None or before is None:
            return False
        usual = float(np.median(self._steps)) if self._steps else 0.0
        step = float(np.hypot(*(pose[:2] - before[:2])))
        return bool(step > np.clip(0.2 * usual, _LEAST_STEP, _MOST_SWAY))

    def _positions(
        self, figures: ScanFigures, pose: FloatArray | None, drives: bool
    ) -> list[Finding]:
        """Judge whether positions come, and go on while the ground goes by."""
        if pose is None:
            self._doubts += 1
            if self._doubts >= DOUBTFUL:
                return self._tell(finding("no positions", self._doubts))
            return []
        before = self._pose
        self._pose = pose
        self._places.append((float(pose[0]), float(pose[1])))
        goes_by = False
        if before is not None and drives:
            self._steps.append(float(np.hypot(*(pose[:2] - before[:2]))))
            if np.isfinite(figures.change_db):
                self._changes.append(figures.change_db)
        elif len(self._changes) >= _KNOWN_CHANGES:
            goes_by = bool(figures.change_db > np.median(self._changes) - MOVING_DB)
        if not goes_by:  # the position is good, and what is wrong with a later one is told again
            self._doubts = 0
            for name in ("no positions", "frozen positions"):
                self._told.pop(name, None)
            return []
        self._doubts += 1
        if self._doubts < DOUBTFUL:
            return []
        return self._tell(finding("frozen positions", 1.0))

    def _pairs_at_fault(
        self, figures: ScanFigures, absent: BoolArray
    ) -> tuple[BoolArray, list[Finding]]:
        """Return which pairs (pair,) are left out of this scan, and what is told of it."""
        found: list[Finding] = []
        with np.errstate(invalid="ignore"):
            level = over_living(figures.level_db)
            over = level
            if (level > LIMITS["hot pairs"].most).any():
                over = over_alike(level, self._radar)
            hot = np.any(over > LIMITS["hot pairs"].most, axis=0)
            quiet = np.any(level < -LIMITS["dead pairs"].most, axis=0)
        if level.shape[1] < _LEAST_CHANNELS:
            hot = quiet = np.zeros(level.shape[1], np.bool_)
        self._quiet = np.where(quiet, self._quiet + 1, 0)
        dead = self._quiet >= LASTING
        # A scan that has none of them is counted as masked; pairs that stay dead are told.
        too_many = np.count_nonzero(hot | dead | absent) > MOST_PAIRS * hot.size
        values = (
            ("missing pairs", absent, 1.0),
            ("hot pairs", hot, _largest(over[:, hot])),
            ("dead pairs", dead, _largest(-level[:, dead])),
        )
        for name, at_fault, value in values:
            if at_fault.any() and (name == "dead pairs" or not too_many):
                pairs = np.flatnonzero(at_fault).tolist()
                one = finding(name, value, pair_names(pairs), pairs=pairs)
                acted = one if too_many else one.acted("left out, and the others are used")
                found += self._tell(acted)
        return np.zeros_like(hot) if too_many else hot | dead | absent, found

    def _tones_at_fault(self, figures: ScanFigures) -> tuple[BoolArray, list[Finding]]:
        """Return which tones (frequency,) are left out of this scan, and what is told of it."""
        sums = self.sums
        marked = np.zeros(sums.shape[2], np.bool_)
        noisy = marked.copy()
        noisy[self._noisy] = True
        if sums.shape[0] * sums.shape[1] < _LEAST_CHANNELS or sums.shape[2] < LEAST_TONES:
            return marked, []
        marked |= figures.excess_db > BURST_DB
        if sums.changes >= LASTING:
            most = LIMITS["disturbed tones"].most + _UNSURE_DB / sums.changes
            marked |= sums.changed_db > most
        if not marked.any():
            return noisy, []
        excess = figures.excess_db
        if sums.changes:
            excess = np.maximum(excess, sums.changed_db)
        tones = np.flatnonzero(marked)
        one = of_tones("disturbed tones", tones, float(excess[marked].max()), self._radar)
        if tones.size > MOST_TONES * marked.size:
            return noisy, self._tell(one)
        return marked | noisy, self._tell(
            one.acted("left out of the scans in which they stand out")
        )

    def _cleaned(
        self,
        signal: ComplexArray,
        figures: ScanFigures,
        pairs: BoolArray,
        gaps: BoolArray,
        tones: BoolArray,
    ) -> ComplexArray | None:
        """Return a scan without pairs and tones, and gaps filled in; None where more is missing."""
        if not signal.any():
            return None
        if figures.finite.all() and not pairs.any() and not tones.any():
            return signal
        cleaned = signal.copy()
        _fill_in(cleaned, gaps)
        cleaned[:, pairs] = 0
        cleaned[..., tones] = 0
        if not np.isfinite(cleaned).all():
            return None
        kept = np.count_nonzero(~pairs)
        return np.asarray(cleaned * np.float32(pairs.size / kept)) if kept < pairs.size else cleaned

    def _few_gaps(self, signal: ComplexArray) -> tuple[BoolArray, list[Finding]]:
        """Return which of the lost pairs (pair,) lack a few tones only, and what is told of it."""
        lost = self._absent >= LASTING
        missing = (~np.isfinite(signal)).sum(axis=-1).max(axis=0)
        gaps = lost & (missing <= max(_FEW_TONES * signal.shape[-1], 1))
        if not gaps.any():
            return gaps, []
        numbers = np.flatnonzero(gaps).tolist()
        one = finding(
            "missing tones", 1.0, f"a few tones of pairs {listed(numbers)}", pairs=numbers
        )
        return gaps, self._tell(one.acted("filled in from the tones beside"))

    def _later(self) -> list[Finding]:
        """Judge what takes more scans: sums, and whether data and poses fit one another."""
        found: list[Finding] = []
        count = self.sums.scans
        if count >= self._judged_from:  # the scan due for it may have been of no use
            while self._judged_from <= count:
                self._judged_from *= 2
            found_later = [one for one in judge_sums(self.sums, self._radar) if one.name in _LATER]
            found += self._tell_all([self._act(one) for one in found_later])
        if len(self._places) >= _FIRST_JUDGED:
            found += self._tell_all(judge_course(np.array(self._places), self.lane))
        return found + self._tell_all(self.looks.look(self.sums))

    def _act(self, one: Finding) -> Finding:
        """Leave tones that hold noise out of the scans to come, unless they are too many."""
        if one.name != "noisy tones" or len(one.tones) > MOST_TONES * self.sums.shape[2]:
            return one
        self._noisy = sorted({*self._noisy, *one.tones})
        return one.acted("left out from now on")

    def state(self) -> tuple[Entries, Arrays]:
        """Return the state as JSON values and arrays, for a later :meth:`restore`."""
        values = {name: np.asarray(getattr(self, f"_{name}")).tolist() for name in _STATE}
        values["told"] = {name: sorted(numbers) for name, numbers in self._told.items()}
        values["looks"], arrays = self.looks.state()
        return values, self.sums.state() | arrays

    def restore(self, values: Entries, arrays: Arrays) -> None:
        """Continue from what :meth:`state` returned; a snapshot of a version before may have less."""
        self.sums.restore(arrays)
        for name in _STATE & values.keys():
            known = getattr(self, f"_{name}")
            value = values[name]
            if isinstance(known, deque):
                value = deque(value, known.maxlen)
            elif isinstance(known, np.ndarray) or name == "pose":
                value = None if value is None else np.array(value)
            setattr(self, f"_{name}", value)
        self._told = {name: set(numbers) for name, numbers in values["told"].items()}
        self.looks.restore(values.get("looks", {}), arrays)


class LiveLooks:
    """Compares the quick ways to take a stream on the latest consecutive scans, see ``HYPOTHESES``.

    Parameters
    ----------
    radar : Radar
        Names and places of channels and tones.
    """

    def __init__(self, radar: Radar) -> None:
        self._radar = radar
        self._tones = looked_at(radar.frequency)
        self._like = like_polarized(radar.polarizations)
        # scans that are of no use keep their place among the poses
        self._latest: list[tuple[ComplexArray | None, FloatArray]] = []
        # one of an earlier look: what it agrees by is no ground in common
        self._unrelated: list[tuple[ComplexArray | None, FloatArray]] = []
        self._looked = 0  # scans that had come at the last look
        self._values: dict[str, list[list[float]]] = {}  # agreement as stated and the other way

    def remember(self, signal: ComplexArray | None, pose: FloatArray | None, follows: bool) -> None:
        """Keep a scan among the latest, as long as they are consecutive.

        Parameters
        ----------
        signal : (polarization, pair, frequency) ndarray of complex, or None
            Its data; None: of no use.
        pose : (6,) ndarray of float, or None
            Its pose.
        follows : bool
            Whether it was measured next after the scan before.
        """
        kept = None if signal is None else signal[self._like][..., self._tones]
        before = self._latest if follows else []
        self._latest = [] if pose is None else [*before, (kept, pose)]
        self._latest = self._latest[-_LOOKED_AT - 2 * QUICK_LAG :]

    def look(self, sums: HealthSums) -> list[Finding]:
        """Look at the latest scans, if it is time, and judge all that were looked at.

        Parameters
        ----------
        sums : HealthSums
            Sums of all scans, for what stands still.
        """
        middle = self._latest[QUICK_LAG:-QUICK_LAG]
        members = [n for n, (signal, _) in enumerate(middle, QUICK_LAG + 1) if signal is not None]
        is_due = sums.scans - self._looked >= _EVERY[sums.scans > _MANY]
        if not is_due or len(middle) < _LOOKED_AT or len(members) < _LEAST_LOOKED_AT:
            return []
        self._looked = sums.scans
        before = self._unrelated
        self._unrelated = [self._latest[members[-1] - 1]]
        if not before or self._tones is None:
            return []
        compared = before + self._latest
        numbers = [0, *members]
        data = np.array([compared[number][0] for number in numbers])
        scans = taken(
            np.where(data == 0, 0, data - sums.mean[self._like][..., self._tones]),
            self._radar.frequency[self._tones],
            numbers,
            [[0], list(range(1, len(numbers)))],
            self._radar.tx_position,
            self._radar.rx_position,
            np.array([pose for _, pose in compared]),
        )
        if not 0 < scans.height < AIRBORNE:
            return []
        stated = scans.agreement(points_every=POINTS_FEW)
        for one, other in tried(scans, quick=True):
            known = self._values.setdefault(one.name, [])
            if len(known) >= _FIRST_VALUES and np.mean(known, axis=0)[1] < _FAR * stated.mean():
                continue  # as long as what is stated agrees
            pairs = np.column_stack([stated, other.agreement(points_every=POINTS_FEW)])
            known += pairs.tolist()
            del known[:-_REMEMBERED]
        ways = []
        for one in HYPOTHESES:
            known = self._values.get(one.name, [])
            if len(known) < _FIRST_VALUES:
                continue
            way = Way.compared(one, *np.transpose(known))
            if len(known) >= _LEAST_VALUES or way.gain_db > _CLEAR_DB:
                ways.append(way)
        best = best_way(ways)
        return [] if best is None else [best.finding]

    def state(self) -> tuple[Entries, Arrays]:
        """Return the state as JSON values and arrays, for a later :meth:`restore`."""
        kept = self._latest + self._unrelated
        arrays = {f"look{k}": signal for k, (signal, _) in enumerate(kept) if signal is not None}
        values = {
            "poses": [pose.tolist() for _, pose in kept],
            "latest": len(self._latest),
            "looked": self._looked,
            "values": self._values,
        }
        return values, arrays

    def restore(self, values: Entries, arrays: Arrays) -> None:
        """Continue from what :meth:`state` returned."""
        if not values:  # a snapshot of a version before
            return
        poses = [np.array(pose) for pose in values["poses"]]
        kept = [(arrays.get(f"look{k}"), pose) for k, pose in enumerate(poses)]
        self._latest = kept[: values["latest"]]
        self._unrelated = kept[values["latest"] :]
        self._looked = values["looked"]
        self._values = {name: list(known) for name, known in values["values"].items()}


def _fill_in(signal: ComplexArray, pairs: BoolArray) -> None:
    """Fill in the gaps of pairs from the tones beside, in place."""
    for pair in np.flatnonzero(pairs):
        for sweep in signal[:, pair]:
            good = np.isfinite(sweep)
            tones = np.arange(sweep.size)
            sweep[~good] = np.interp(tones[~good], tones[good], sweep[good])


def _largest(values: FloatArray) -> float:
    """Return the largest value that is known; 0 without any."""
    known = values[np.isfinite(values)]
    return float(known.max()) if known.size else 0.0
