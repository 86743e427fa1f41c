"""From sums to findings: which channels and tones are at fault, and which of them may be left out."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flgpr.health.channels import channel_levels
from flgpr.health.findings import (
    CLEAR,
    CLEAR_OF_FEW,
    LEAST_SCANS,
    LEAST_TONES,
    LIMITS,
    MOST_PAIRS,
    MOST_TONES,
    MOVING_DB,
    NOISY_LIKENESS,
    PLACED_LIKENESS,
    TURNED_LIKENESS,
    Finding,
    finding,
    listed,
)
from flgpr.health.focus import like_polarized
from flgpr.health.sums import LEAST_POWER, HealthSums
from flgpr.model import Lane
from flgpr.types import BoolArray, FloatArray, IndexArray

_BEFORE_LANE = 10.0  # m
_LEAST_USUAL = 0.5  # likeness of neighbouring tones under which they say nothing of one another
_LEAST_PAIRS = 4  # of fewer, the level of one says little of another's
_MOST_HOT = 0.25  # of the pairs
_SILENT_DB = 300.0  # under the median pair, stands for no power at all
_MEDIAN_OF_NORMAL = 0.6745  # of the magnitude of a normal value, over its standard deviation
_IN_PLACE = 0.6  # of the median likeness of neighbours, that of pairs in their right places
_OUT_OF_PLACE = 0.7  # that of pairs in wrong ones, at most
_MOST_AT_AN_END = 8  # delays at each end of those that are known, between which time zero drifts
_ALIKE = 5  # pairs whose antennas are as far apart, the nearest


@dataclass(frozen=True)
class Radar:
    """What sums are judged by: the names and places of channels and tones."""

    polarizations: tuple[str, ...]
    frequency: FloatArray  #: (frequency,) Hz
    tx_position: FloatArray  #: (pair, 3) m, in the vehicle frame
    rx_position: FloatArray  #: (pair, 3) m


@dataclass(frozen=True)
class LeftOut:
    """Pairs and tones that are left out of a run, by their numbers from 0."""

    pairs: tuple[int, ...] = ()
    tones: tuple[int, ...] = ()

    def __bool__(self) -> bool:
        return bool(self.pairs or self.tones)

    def as_json(self) -> dict[str, list[int]]:
        """Return it as JSON values."""
        return {"pairs": list(self.pairs), "tones": list(self.tones)}

    @classmethod
    def recorded(cls, description: Mapping[str, Any]) -> LeftOut:
        """Return what the description of a run in a manifest, checked before, says was left out."""
        entries = description.get("left_out", {})
        return cls(tuple(entries.get("pairs", ())), tuple(entries.get("tones", ())))


@dataclass(frozen=True)
class Health:
    """What is wrong with a run, and what of it is left out."""

    findings: tuple[Finding, ...] = ()
    left_out: LeftOut = LeftOut()


HEALTHY = Health()
"""Nothing is wrong, and nothing left out."""


def judge_sums(sums: HealthSums, radar: Radar) -> list[Finding]:
    """Return what sums tell of channels, tones, time zero and repeated scans."""
    found = [*_missing(sums, radar), *judge_levels(sums, radar)]
    found += [*_polarizations(sums, radar), *_stuck(sums, radar)]
    if sums.scans < LEAST_SCANS:
        return found
    figures = statistics(sums, radar)
    for name in ("repeated scans", "noise", "jitter", "time zero"):
        if figures.get(name, 0.0) > LIMITS[name].most:
            found.append(finding(name, figures[name]))
    if sums.shape[2] >= LEAST_TONES:
        found += _tones(sums, radar)
    neighbours = Neighbours(sums, radar)
    pairs = neighbours.swapped
    if pairs:
        couples = [
            f"{first} and {second}" for first, second in zip(pairs[::2], pairs[1::2], strict=True)
        ]
        found.append(
            finding("swapped pairs", neighbours.gain, f"pairs {listed(couples)}", pairs=pairs)
        )
    pairs = neighbours.turned
    if pairs:
        found.append(finding("turned pairs", len(pairs), f"pairs {listed(pairs)}", pairs=pairs))
    return found


def statistics(sums: HealthSums, radar: Radar) -> dict[str, float]:
    """Return what the findings of :func:`judge_sums` are judged by, by their names."""
    came = sums.sweeps > 0  # a pair that never comes is missing, and neither dead nor hot
    levels = np.maximum(over_living(channel_levels(sums)), -_SILENT_DB)
    levels = np.where(came, levels, np.nan)
    figures = {
        "missing pairs": float((1 - sums.sweeps / max(sums.scans, 1)).max()),
        "dead polarization": float(under_loudest(sums)[came.any(axis=1)].max(initial=0.0)),
        "stuck pairs": float((sums.stuck >= np.maximum(sums.steps, 1)[..., None]).mean(-1).max()),
        "repeated scans": float(sums.repeated),
    }
    if levels.shape[1] >= _LEAST_PAIRS and came.any():
        figures["dead pairs"] = float(-np.nanmin(levels))
        figures["hot pairs"] = float(np.nanmax(over_alike(levels, radar)))
        neighbours = Neighbours(sums, radar)
        figures["swapped pairs"] = neighbours.gain
        figures["turned pairs"] = float(len(neighbours.turned))
    if sums.shape[2] >= LEAST_TONES:
        figures["noise"] = 1 - sums.likeness
        figures["jitter"] = jitter_ps(sums, radar)
        figures["time zero"] = drift_ps(sums, radar)
    if sums.shape[2] >= LEAST_TONES and sums.changes:
        likeness = sums.tone_likeness
        noisy = likeness < NOISY_LIKENESS * np.median(likeness)
        figures["disturbed tones"] = float(sums.changed_db.max())
        if np.median(likeness) > _LEAST_USUAL:
            figures["noisy tones"] = float(noisy.mean())
    return figures


def what_to_leave_out(findings: Sequence[Finding], radar: Radar) -> Health:
    """Decide which pairs and tones are left out, and say so in the findings.

    At most half of the pairs and a tenth of the tones are: of less there is no image.
    """
    pairs: set[int] = set()
    tones: set[int] = set()
    settled = []
    for one in findings:
        chosen, count, most = pairs, len(radar.tx_position), MOST_PAIRS
        numbers = one.pairs
        if one.name in ("missing tones", "disturbed tones", "noisy tones"):
            chosen, count, most = tones, radar.frequency.size, MOST_TONES
            numbers = one.tones
        elif one.name not in ("missing pairs", "dead pairs", "hot pairs", "stuck pairs"):
            settled.append(one)
            continue
        together = chosen | set(numbers)
        if len(together) > most * count:
            settled.append(one)
            continue
        chosen |= together
        what = "pair" if chosen is pairs else "tone"
        left = f"{len(numbers)} {what}{'' if len(numbers) == 1 else 's'} left out"
        settled.append(one.acted(left))
    return Health(tuple(settled), LeftOut(tuple(sorted(pairs)), tuple(sorted(tones))))


def judge_motion(steps: FloatArray, change_db: FloatArray) -> list[Finding]:
    """Return whether positions stand still while the ground goes by.

    Parameters
    ----------
    steps : (step,) ndarray of float
        Distances between consecutive scans by their poses, m.
    change_db : (step,) ndarray of float
        Power of the change of the data, over that of the scan, dB; NaN where it is not known.
    """
    known = np.isfinite(change_db)
    if np.count_nonzero(known) < LEAST_SCANS or not (steps > 0).any():
        return []
    stands = steps < 0.2 * np.quantile(steps[known], 0.75)
    driving = known & ~stands
    if not driving.any():
        return []
    goes_by = change_db > np.median(change_db[driving]) - MOVING_DB
    share = np.count_nonzero(known & stands & goes_by) / np.count_nonzero(known)
    return [finding("frozen positions", share)] if share > LIMITS["frozen positions"].most else []


def judge_course(pose: FloatArray, lane: Lane | None) -> list[Finding]:
    """Return whether the course lies beside the middle of the lane; nothing without a lane.

    Parameters
    ----------
    pose : (scan, 2 or more) ndarray of float
        Poses, of which x and y are used, m; those just before the lane count, too.
    lane : Lane or None
        Ground that is searched.
    """
    if lane is None or not len(pose):
        return []
    within = (pose[:, 1] > lane.y_min - _BEFORE_LANE) & (pose[:, 1] < lane.y_max)
    if not within.any():
        return []
    aside = abs(float(np.median(pose[within, 0])) - (lane.x_min + lane.x_max) / 2)
    most = max(LIMITS["course"].most, (lane.x_max - lane.x_min) / 3)
    return [finding("course", aside)] if aside > most else []


def _missing(sums: HealthSums, radar: Radar) -> Iterator[Finding]:
    """Yield pairs, or tones, that are not finite in many scans.

    A few tones that explain all of it are named instead of their pairs: less is lost by them.
    """
    most = LIMITS["missing pairs"].most
    share = 1 - sums.sweeps / max(sums.scans, 1)
    # A single lost sweep is an accident of its scan, which is left out, however short the run.
    at_fault = (share > most) & (sums.scans - sums.sweeps > 1)
    if sums.scans < 3 or not at_fault.any():
        return
    by_tone = sums.not_finite / max(sums.scans, 1)
    bad = (by_tone > most) & at_fault[..., None]
    tones = np.flatnonzero(bad.any(axis=(0, 1)))
    pairs = np.flatnonzero(at_fault.any(axis=0))
    if tones.size and tones.size / bad.shape[2] <= min(pairs.size / bad.shape[1], MOST_TONES):
        kept = np.setdiff1d(np.arange(bad.shape[2]), tones)
        explained = not (by_tone[at_fault][:, kept] > 0).any()
        if explained:
            value = float(by_tone[bad].max())
            yield of_tones("missing tones", tones, value, radar)
            return
    yield _of_channels("missing pairs", at_fault, float(share.max()), radar)


def over_living(levels: FloatArray) -> FloatArray:
    """Return levels (polarization, pair) over the median pair, dB, over the median of those that live.

    Where more than a quarter of the pairs are far over the median one, it is dead, and they are not
    hot. Levels of NaN are not known.
    """
    loud = levels > LIMITS["dead pairs"].most
    if np.count_nonzero(loud) <= _MOST_HOT * np.count_nonzero(np.isfinite(levels)):
        return levels
    return np.asarray(levels - np.median(levels[loud]), np.float64)


def over_alike(levels: FloatArray, radar: Radar) -> FloatArray:
    """Return levels (polarization, pair) over those of the pairs whose antennas are as far apart.

    Receivers beside a transmitter are louder than others, all of them.

    Parameters
    ----------
    levels : (polarization, pair) ndarray of float
        Levels over the median pair, dB; NaN where they are not known.
    radar : Radar
        Places of the antennas.
    """
    apart = np.linalg.norm(radar.tx_position - radar.rx_position, axis=1)
    over = levels.copy()
    for pair in range(len(apart)):
        alike = np.argsort(np.abs(apart - apart[pair]), kind="stable")[:_ALIKE]
        for k, of_polarization in enumerate(levels[:, alike]):
            known = of_polarization[np.isfinite(of_polarization)]
            if known.size:
                over[k, pair] -= max(float(np.median(known)), 0.0)
    return over


def judge_levels(
    sums: HealthSums,
    radar: Radar,
    weak: float = LIMITS["dead pairs"].most,
    loud: float = LIMITS["hot pairs"].most,
) -> Iterator[Finding]:
    """Yield pairs that are ``weak`` dB under or ``loud`` dB over the others; of a few, silent ones."""
    levels = np.maximum(channel_levels(sums), -_SILENT_DB)
    known = sums.sweeps > 0
    if not (levels[known] > -_SILENT_DB).any():
        return
    levels = np.maximum(over_living(levels), -_SILENT_DB)
    dead = known & (levels < -weak)
    if levels.shape[1] < _LEAST_PAIRS:
        dead = known & (levels == -_SILENT_DB)
    if dead.any():
        yield _of_channels("dead pairs", dead, float(-levels[dead].min()), radar)
    if levels.shape[1] < _LEAST_PAIRS:
        return
    over = over_alike(levels, radar)
    hot = known & (over > loud)
    if hot.any():
        yield _of_channels("hot pairs", hot, float(over[hot].max()), radar)


def under_loudest(sums: HealthSums) -> FloatArray:
    """Return how far the median pair of each polarization lies under the loudest of them, dB."""
    power = np.median(sums.power / np.maximum(sums.sweeps, 1), axis=1)
    levels = 10 * np.log10(np.maximum(power, LEAST_POWER))
    return np.asarray(levels.max() - levels)


def _polarizations(sums: HealthSums, radar: Radar) -> Iterator[Finding]:
    """Yield polarizations that are far under the others as a whole."""
    under = under_loudest(sums)
    dead = (under > LIMITS["dead polarization"].most) & (sums.sweeps > 0).any(axis=1)
    if dead.any():
        labels = [radar.polarizations[k] for k in np.flatnonzero(dead)]
        value = float(under[dead].max())
        yield finding("dead polarization", value, listed(labels), polarizations=labels)


def _stuck(sums: HealthSums, radar: Radar) -> Iterator[Finding]:
    """Yield pairs that hold the same numbers in all scans, while others change."""
    if sums.changes < 2:
        return
    always = (sums.stuck >= sums.steps[..., None]) & (sums.steps[..., None] > 1)
    share = always.mean(axis=-1)
    stuck = share > LIMITS["stuck pairs"].most
    if stuck.any():
        yield _of_channels("stuck pairs", stuck, float(share.max()), radar)


def disturbed(sums: HealthSums) -> BoolArray:
    """Mark the tones (frequency,) that change or stand out more than the tones around.

    Parameters
    ----------
    sums : HealthSums
        Sums of two scans at least.
    """
    most = LIMITS["disturbed tones"].most
    marked = sums.bursts > max(2, 0.1 * sums.scans)
    if sums.changes:
        marked = marked | (sums.changed_db > most)
    return np.asarray(marked)


def _tones(sums: HealthSums, radar: Radar) -> Iterator[Finding]:
    """Yield disturbed tones, and noisy ones."""
    if not sums.changes:
        return
    marked = disturbed(sums)
    if marked.any():
        tones = np.flatnonzero(marked)
        value = float(sums.changed_db[marked].max())
        yield of_tones("disturbed tones", tones, value, radar)
    likeness = sums.tone_likeness
    usual = float(np.median(likeness))
    told = marked[1:] | marked[:-1]
    unlike = likeness < NOISY_LIKENESS * usual
    share = np.count_nonzero(unlike & ~told) / likeness.size
    if usual > _LEAST_USUAL and share > LIMITS["noisy tones"].most:
        # A good tone beside a noisy one is unlike it, too, but like the one on its other side.
        beside = np.pad(unlike, 1, constant_values=True)
        noisy = np.flatnonzero(beside[1:] & beside[:-1] & ~marked)
        yield of_tones("noisy tones", noisy, share, radar)


def jitter_ps(sums: HealthSums, radar: Radar) -> float:
    """Return how far time zero jumps from scan to scan, ps; NaN where nothing strong stands still.

    A strong echo that passes, such as a hyperbola, moves evenly from scan to scan, and no jump does:
    of first and second differences, which jumps have alike, the smaller tell.
    """
    delays = _delays_ps(sums, radar)
    once = np.median(np.abs(np.diff(delays))) / np.sqrt(2)
    twice = np.median(np.abs(np.diff(delays, 2))) / np.sqrt(6)
    return float(min(once, twice)) / _MEDIAN_OF_NORMAL


def drift_ps(sums: HealthSums, radar: Radar) -> float:
    """Return how far time zero has drifted over the latest scans, ps; NaN as of :func:`jitter_ps`."""
    delays = _delays_ps(sums, radar)
    end = min(max(len(delays) // 3, 1), _MOST_AT_AN_END)
    return float(abs(np.median(delays[-end:]) - np.median(delays[:end])))


def _delays_ps(sums: HealthSums, radar: Radar) -> FloatArray:
    """Return the delays of the latest scans, ps; NaN alone where nothing strong stands still."""
    # Of a few channels no average takes off an echo that is as strong as what stands still.
    few = sums.shape[0] * sums.shape[1] < _LEAST_PAIRS
    clear = CLEAR_OF_FEW if few else CLEAR
    if len(sums.delays) < LEAST_SCANS - 1 or np.median(sums.clearness) < clear:
        return np.full(3, np.nan)
    step = float(np.median(np.diff(radar.frequency)))
    return np.array(sums.delays) / (2 * np.pi * step) * 1e12


class Neighbours:
    """How alike the pairs of a run are, by which a pair in another's place or of the other sign shows.

    Along the receivers of a transmitter every correlation of neighbours has the sign that most of
    them have.

    Parameters
    ----------
    sums : HealthSums
        Sums of its scans.
    radar : Radar
        Names of the polarizations and places of the pairs.

    Attributes
    ----------
    swapped : list of int
        Numbers of the pairs that have changed places, two by two.
    gain : float
        Of the best exchange of two pairs: how much more alike their neighbours are after it, as a
        share of the median; 0 where it cannot be told.
    turned : list of int
        Numbers of the pairs whose sign is turned.
    """

    def __init__(self, sums: HealthSums, radar: Radar) -> None:
        self.swapped: list[int] = []
        self.gain = 0.0
        self.turned: list[int] = []
        likeness = sums.pair_likeness[like_polarized(radar.polarizations)].mean(axis=0)
        tx = radar.tx_position
        beside = np.all(np.isclose(tx[1:], tx[:-1]), axis=1)
        if not beside.any():
            beside[:] = True
        links = np.diagonal(likeness, 1)
        beside = beside & np.isfinite(links)
        if np.count_nonzero(beside) < 3:
            return
        strength = float(np.median(np.abs(links[beside])))
        if strength < TURNED_LIKENESS:
            return
        sign = np.sign(np.median(links[beside]))
        order = np.arange(len(likeness))
        if strength > PLACED_LIKENESS:
            order = self._exchanged(np.nan_to_num(np.abs(likeness)) / strength, beside)
        links = sign * np.diagonal(likeness[np.ix_(order, order)], 1)
        self.turned = _turned(links < -strength / 2, beside)

    def _exchanged(self, likeness: FloatArray, beside: BoolArray) -> IndexArray:
        """Return the pairs in the order in which neighbours are alike, and keep what was exchanged.

        Pairs of one transmitter are tried: those of others are alike by their receiver.
        """
        np.fill_diagonal(likeness, 0)
        adjacent = np.diag(beside.astype(float), 1)
        adjacent += adjacent.T
        links = adjacent.sum(axis=0)
        together = links[:, None] + links
        row = np.concatenate([[0], np.cumsum(~beside)])
        order = np.arange(len(likeness))
        for _ in range(len(order) // 4):
            now = likeness[np.ix_(order, order)]
            placed = now @ adjacent  # of a pair in the place of another
            as_stated = np.diag(placed)
            after = placed + placed.T + 2 * now * adjacent  # neighbours stay beside each other
            before = as_stated[:, None] + as_stated
            fits = (before < _OUT_OF_PLACE * together) & (after > _IN_PLACE * together)
            with np.errstate(invalid="ignore", divide="ignore"):
                gain = (after - before) / together
                gain[~(fits & (row[:, None] == row))] = 0
            best = np.unravel_index(np.argmax(gain), gain.shape)
            self.gain = max(self.gain, float(gain[best]))
            if not gain[best] > LIMITS["swapped pairs"].most:
                break
            couple = np.array(best)
            self.swapped += sorted(order[couple].tolist())
            order[couple] = order[couple[::-1]]
        return order


def _turned(flips: BoolArray, beside: BoolArray) -> list[int]:
    """Return the numbers of the pairs whose sign is turned: the fewer of each row of neighbours.

    Both arguments are (pair - 1,): whether the sign changes to the next pair, and whether that
    stands beside.
    """
    turned: list[int] = []
    row: list[tuple[int, int]] = [(0, 1)]
    for pair, (flip, is_beside) in enumerate(zip(flips, beside, strict=True), 1):
        if not is_beside:
            turned += _fewer(row)
            row = [(pair, 1)]
            continue
        before = row[-1][1]
        row.append((pair, -before if flip else before))
    return turned + _fewer(row)


def _fewer(group: Sequence[tuple[int, int]]) -> list[int]:
    """Return the pairs of the sign that fewer have."""
    total = sum(sign for _, sign in group)
    return [pair for pair, sign in group if sign * (1 if total >= 0 else -1) < 0]


def _of_channels(name: str, at_fault: BoolArray, value: float, radar: Radar) -> Finding:
    """Return a finding of channels (polarization, pair)."""
    pairs = np.flatnonzero(at_fault.any(axis=0)).tolist()
    labels = [radar.polarizations[k] for k in np.flatnonzero(at_fault.any(axis=1))]
    where = f"{pair_names(pairs)} of {', '.join(labels)}"
    return finding(name, value, where, pairs=pairs, polarizations=labels)


def pair_names(pairs: Sequence[int]) -> str:
    """Return pairs by number, the first few."""
    return f"{'pair' if len(pairs) == 1 else 'pairs'} {listed(pairs)}"


def of_tones(name: str, tones: NDArray[np.integer], value: float, radar: Radar) -> Finding:
    """Return a finding of tones, the first few by number and in MHz."""
    named = [f"{tone} ({radar.frequency[tone] / 1e6:.1f} MHz)" for tone in tones]
    where = f"{'tone' if tones.size == 1 else 'tones'} {listed(named, 4)}"
    return finding(name, value, where, tones=tones.tolist())
