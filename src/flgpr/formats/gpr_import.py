"""A line of traces of a commercial ground-penetrating radar as a run, and told in words."""

from __future__ import annotations

import math
import shlex
from pathlib import Path
from typing import NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from flgpr.formats.gpr_files import NOT_READ, READERS, GprSection, read_gpr
from flgpr.formats.gpr_parts import MissingHeaderError
from flgpr.formats.mapped import impulse_to_frequency
from flgpr.geo.anchor import Anchor
from flgpr.model import make_run
from flgpr.model.bounds import LARGEST
from flgpr.model.motion import Motion, judge_poses, some_steps
from flgpr.model.plausible import MotionLimits
from flgpr.model.track import course, make_track, poses_at
from flgpr.store.store_layout import MAX_MEMORY

_BLOCK = 512  # traces that are transformed at a time
_MOST_HEADINGS = 4000  # fixes whose course is looked for, which takes the square of their number
_LOWEST = 1e6  # Hz, below which no run has tones
OCTAVE = 2.0
"""Ratio of the ends of a band, at least, for the antenna's frequency to be believed beside the sampling."""
_LISTED = 3  # fixes that are named
_EARTH = 6_371_000.0  # m, its mean radius
_LEVEL = 0.01  # m of height, that are none
_CLOSE = 20.0  # m that the way of a receiver without corrections may be off


class ReasonedBand(NamedTuple):
    """A band to keep, Hz, and what the notes say of why."""

    lowest: float
    highest: float
    reason: str


def gpr_run(
    section: GprSection,
    channel: int = 0,
    *,
    step: float | None = None,
    time_zero: float | None = None,
    window: float | None = None,
    band: tuple[float, float] | ReasonedBand | None = None,
    separation: float | None = None,
    across: bool = False,
    height: float = 0.0,
    polarization: str = "HH",
    anchor: Anchor | None = None,
    topography: bool = False,
) -> xr.Dataset:
    """Make a run of a line: one scan per trace, one pair, along +y of the lane from the line's start, at x = 0.

    In place of what the headers tell stand ``step`` between traces, m, ``time_zero`` after the first sample and the
    time ``window``, s, and the antennas' ``separation``, m. The antennas lie one behind the other, receiver ahead, or
    side by side with ``across``, ``height`` m above the ground.

    ``band``, Hz, is by default a quarter to twice the antenna's nominal frequency; up to half of
    what the sampling holds where that is unknown, and all of it where that is less than an octave
    of the antenna's; the notes give the reason of a ``ReasonedBand``. With an ``anchor`` the satellite receiver's
    positions put the traces in the lane; traces before its first and after its last are left out;
    with ``topography`` they are put on the receiver's heights, which else are not used.
    ``import_notes`` say what was assumed. What the headers do not tell and is not given, or does
    not fit, is a ValueError.
    """
    channels, samples = section.traces.shape[1:]
    if not 0 <= channel < channels:
        raise ValueError(f"channel must be from 0 to {channels - 1}, got {channel}")
    notes = list(section.history)
    if channels > 1:
        notes.append(
            f"channel {channel} of {channels}: the file does not tell where their antennas are"
        )
    if section.gather:
        raise ValueError(
            f"{section.path}: its antennas move apart ({section.gather}): it is no line of one offset and makes no run"
        )
    delay = _delay(section.delay_of(channel), time_zero, window)
    apart = section.separation if separation is None else separation
    if apart is None:
        apart = 0.0
        notes.append("no antenna separation is told: transmitter and receiver are put at one place")
    if not (0 <= apart <= 100 and math.isfinite(height) and height >= 0):
        raise ValueError(
            f"separation and height must not be negative, the first at most 100 m, got {apart}, {height}"
        )
    notes += _given_instead(section, channel, step, time_zero, window, separation)
    nominal = section.frequencies[channel]
    chosen = _band(band, nominal, delay, notes)
    keep, pose = _poses(section, step, height, anchor, topography, notes)
    if section.marks:
        notes.append(f"{len(section.marks)} marks of the operator are not kept in the run")
    tones = _spectra(section.traces[:1, channel], delay, chosen)[1]
    size = len(keep) * tones.size * 8
    if size > section.max_memory:
        limit = f"{section.max_memory / 1e9:.3g} GB"
        raise ValueError(
            f"the run must fit into {limit}, it takes {size / 1e9:.3g} GB: narrow the band"
        )
    signal = _spectra(section.traces[keep, channel], delay, chosen)[0]
    half = np.array([[apart / 2, 0.0, 0.0] if across else [0.0, apart / 2, 0.0]])
    attrs = {
        "title": section.title,
        "source": f"{section.format}, {section.path.name}",
        "import_notes": notes,
        "sounding": "air-launched" if height > 0 else "ground-coupled",
        # What takes the tones back to traces: a record of this length that begins at this delay.
        "time_window_s": float((delay[1] - delay[0]) * samples),
        "first_sample_s": float(delay[0]),
        "samples": samples,
    } | ({"antenna_frequency_hz": nominal} if nominal else {})
    time = None if section.time is None else section.time[keep]
    return make_run(signal[:, None, None], tones, [polarization], -half, half, pose, time, attrs)


def explain_gpr(path: Path, max_memory: int = MAX_MEMORY) -> tuple[str, list[str]]:
    """Tell a recording's format, and in lines what it holds, or why it cannot be read, and the command to import it."""
    suffix = path.suffix.lower()
    if suffix in NOT_READ:
        words, advice = NOT_READ[suffix]
        return f"{words} file", [f"known by its ending {suffix}; it cannot be read: {advice}"]
    try:
        section = read_gpr(path, max_memory)
    except MissingHeaderError as error:
        return READERS[suffix][0], [str(error).partition(": ")[2]]
    count, channels, samples = section.traces.shape
    interval = float(section.delay[1] - section.delay[0])
    zero = -section.delay[0] * 1e9
    side = "after" if zero >= 0 else "before"
    lines = [
        f"{section.title}: {count} traces x {samples} samples"
        + (f", {channels} channels" if channels > 1 else ""),
        f"time window {samples * interval * 1e9:.6g} ns, time zero {abs(zero):.6g} ns {side} its start",
    ]
    if section.distance is not None and count > 1:
        length = float(
            np.abs(np.diff(section.distance)).sum()
        )  # there and back, where a line turns round
        lines.append(f"length {length:.6g} m, trace spacing {length / (count - 1):.4g} m")
    else:
        lines.append(f"trace spacing unknown: give {_ways_to_place(section, '--')}")
    antennas = ", ".join(
        "unknown" if one is None else f"{one / 1e6:g} MHz" for one in section.frequencies
    )
    apart = "unknown" if section.separation is None else f"{section.separation:g} m"
    lines.append(f"antenna {antennas}, separation {apart}")
    lines.append(
        f"{len(section.fixes)} positions of a satellite receiver, {len(section.marks)} marks"
    )
    lines += [*section.history, *_fix_doubts(section)]
    if section.gather:
        lines.append("flgpr import gpr refuses it, for a run is a line of one offset")
        return section.format, lines
    lines.append(
        f"to import it: flgpr import gpr {shlex.quote(str(path))} -o {shlex.quote(path.stem)}.zarr"
    )
    return section.format, lines


def _delay(
    told: NDArray[np.float64], zero: float | None, window: float | None
) -> NDArray[np.float64]:
    """Lay a given time window and time zero over the delays that the headers tell."""
    interval = (told[1] - told[0]) if window is None else window / told.size
    if not 1e-13 <= interval <= 1e-6:
        raise ValueError(
            f"window must make the samples 1e-4 to 1e3 ns apart, got {interval * 1e9:g} ns"
        )
    first = -told[0] * interval / (told[1] - told[0]) if zero is None else zero
    if not abs(first) <= 100 * interval * told.size:
        raise ValueError(
            f"time zero must lie near the record of {interval * told.size:g} s, got {first:g} s"
        )
    return np.arange(told.size) * interval - first


def _band(
    given: tuple[float, float] | ReasonedBand | None,
    nominal: float | None,
    delay: NDArray[np.float64],
    notes: list[str],
) -> tuple[float, float]:
    """Return the band, Hz, to keep: as given, about the antenna's nominal frequency, or by the sampling."""
    interval = float(delay[1] - delay[0])
    nyquist = 0.5 / interval
    lowest = max(_LOWEST, 1 / (interval * delay.size))
    low = lowest
    high = 0.5 * nyquist
    reason = "by the sampling"
    if nominal and nominal > nyquist:
        notes.append(
            f"an antenna of {nominal / 1e6:g} MHz does not fit samples {interval * 1e9:.4g} ns apart, which hold "
            f"frequencies up to {nyquist / 1e6:g} MHz: are antenna and time window right?"
        )
    if given is not None:
        low, high = given[:2]
        reason = given.reason if isinstance(given, ReasonedBand) else "given"
    elif nominal:
        least = max(nominal / 4, lowest)
        most = min(2 * nominal, 0.9 * nyquist)
        if most >= OCTAVE * least:
            low = least
            high = most
            reason = "a quarter to twice the antenna's"
            if low > nominal / 4 or high < 2 * nominal:
                reason += ", within what the record and its sampling hold"
        else:
            high = 0.9 * nyquist
            reason = "all that the sampling holds, which is hardly any of the antenna's"
    if not lowest * (1 - 1e-9) <= low < high <= nyquist:
        raise ValueError(
            f"band must lie between {lowest / 1e6:g} MHz and half the sampling rate, {nyquist / 1e6:g} MHz, got "
            f"{low / 1e6:g} to {high / 1e6:g} MHz: give the band, or is the time window right?"
        )
    notes.append(f"impulse data taken to frequency, {low / 1e6:g} to {high / 1e6:g} MHz ({reason})")
    return low, high


def _poses(
    section: GprSection,
    step: float | None,
    height: float,
    anchor: Anchor | None,
    topography: bool,
    notes: list[str],
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Give the traces that have a pose, and their poses."""
    count = len(section.traces)
    if anchor is not None:
        if len(section.fixes) < 2:
            got = len(section.fixes)
            raise ValueError(
                f"{section.path}: an anchor needs positions of two traces or more, got {got}"
            )
        place = anchor.from_geodetic(section.fixes[:, 1:])
        ground = place[:, 2].copy()
        place[:, 2] = height
        at, place = _plausible_fixes(section, place, notes)
        ground = ground[np.isin(section.fixes[:, 0], at)]
        place[:, 2] += _topography(section, ground, anchor, topography, notes)
        some = slice(None, None, 1 + len(at) // _MOST_HEADINGS)
        heading = np.interp(at, at[some], np.unwrap(course(place[some])))
        track = make_track(at, place, heading)
        keep = np.arange(math.ceil(at[0]), math.floor(at[-1]) + 1)
        notes.append(
            f"{len(keep)} of {count} traces lie between positions of the satellite receiver and are kept"
        )
        return keep, poses_at(track, keep)
    if topography:
        raise ValueError(
            "topography needs an anchor and a receiver's heights: give --anchor or --anchor-from-track"
        )
    if step is not None and not 1e-5 <= step <= 1e3:
        raise ValueError(f"step must be from 1e-5 to 1e3 m, got {step:g}")
    along = section.distance if step is None else step * np.arange(count)
    if along is None:
        raise ValueError(
            f"{section.path}: its headers tell no trace spacing: give the {_ways_to_place(section)}"
        )
    notes.append("the line is put along +y of the lane, at x = 0")
    if len(section.fixes):
        notes.append(
            f"{len(section.fixes)} positions of the satellite receiver are not used: they need an anchor"
        )
    pose = np.zeros((count, 6))
    pose[:, 1] = along
    pose[:, 2] = height
    return np.arange(count), pose


def _ways_to_place(section: GprSection, dashes: str = "") -> str:
    """Name the options that place the traces of a line whose headers do not."""
    names = ["step"]
    if len(section.marks) > 1:
        names.append("mark-spacing")
    if len(section.fixes) > 1:
        names += ["anchor", "anchor-from-track"]
    options = [dashes + name for name in names]
    return options[0] if len(options) == 1 else f"{', '.join(options[:-1])} or {options[-1]}"


def _topography(
    section: GprSection, ground: NDArray[np.float64], anchor: Anchor, wanted: bool, notes: list[str]
) -> NDArray[np.float64]:
    """Return what the receiver's heights (fix,), m in the lane, add to the antennas'; what is not used is told."""
    if not anchor.heights_known or not np.isfinite(ground).all():
        if wanted:
            raise ValueError(
                f"{section.path}: topography needs an anchor with heights and a height of every position"
            )
        return np.zeros(ground.size)
    low = float(ground.min())
    high = float(ground.max())
    if wanted:
        notes.append(
            f"antennas are put on the receiver's heights, {low:.2f} to {high:.2f} m in the lane; its own height over "
            "the ground is not taken off"
        )
        return ground
    if high - low > _LEVEL:
        notes.append(
            f"heights of the receiver from {low:.2f} to {high:.2f} m in the lane are not used: the ground is taken as "
            "level; --topography puts the line on them"
        )
    return np.zeros(ground.size)


def _plausible_fixes(
    section: GprSection, place: NDArray[np.float64], notes: list[str]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Leave out fixes (fix, 3) in the lane that no vehicle reaches, with a note; give the others' traces and places.

    Traces in between are put on the line from fix to fix, so that one wrong fix would move all to its next ones. The
    times are the receiver's own; the headers tell at best a nominal rate of traces.
    """
    at = section.fixes[:, 0]
    motion = _judge_fixes(section, place)
    if motion.left_out:
        notes.append(
            f"{len(motion.left_out)} of {len(at)} positions of the satellite receiver left out, which no vehicle "
            f"reaches; traces are counted as scans: {some_steps(motion.steps)}"
        )
    elif motion.steps:
        notes.append(
            f"{len(motion.steps)} of {len(at)} positions of the satellite receiver lie farther from those before than "
            f"a vehicle goes; they are too many to be faults, and all are used: {some_steps(motion.steps)}"
        )
    used = np.flatnonzero(motion.plausible)
    near = _near_by_distance(section, at[used], place[used])
    if not near.all():
        notes.append(
            f"{np.count_nonzero(~near)} of {len(at)} positions of the satellite receiver left out, which are farther "
            f"from those about them than the traces' own distance: at trace "
            f"{', '.join(f'{trace:g}' for trace in at[used][~near][:_LISTED])}"
        )
    used = used[near]
    return at[used], place[used]


def _near_by_distance(
    section: GprSection, trace: NDArray[np.float64], place: NDArray[np.float64]
) -> NDArray[np.bool_]:  # fmt: skip
    """Tell which places (fix, 3), m, at traces (fix,) lie as near to one about them as the traces' distance allows."""
    count = len(place)
    if section.distance is None or count < 3:
        return np.ones(count, bool)
    way = np.append(0.0, np.abs(np.diff(section.distance)).cumsum())
    along = np.interp(trace, np.arange(len(way)), way)

    def near(step: int) -> NDArray[np.bool_]:
        """Tell of fixes and those so many behind them whether they agree."""
        apart = np.hypot(*(place[step:, :2] - place[:-step, :2]).T)
        return np.asarray(apart <= 2 * (along[step:] - along[:-step]) + _CLOSE)

    agrees = np.zeros(count, bool)
    for step in (1, 2):
        fits = near(step)
        agrees[step:] |= fits
        agrees[:-step] |= fits
    # Where hardly any agree, it is the distance that is wrong.
    return agrees if 2 * np.count_nonzero(agrees) > count else np.ones(count, bool)


def _judge_fixes(section: GprSection, place: NDArray[np.float64]) -> Motion:
    """Judge places (fix, 3), m, of the receiver as those of a vehicle, by their times where these go on."""
    pose = np.concatenate([place, np.zeros_like(place)], axis=1)
    # Fixes may be as many traces apart as they like, and a receiver without corrections wanders
    # from fix to fix.
    limits = MotionLimits(scans=int(LARGEST), acceleration=1000.0)
    time = section.fix_time
    timed = (
        time.size == len(place)
        and bool((np.diff(time) > 0).any())
        and not bool((np.diff(time) < 0).any())
    )
    if not timed and section.time is not None:
        time = np.interp(section.fixes[:, 0], np.arange(len(section.time)), section.time)
        timed = True
    return judge_poses(pose, time if timed else None, limits, np.round(section.fixes[:, 0]))


def _fix_doubts(section: GprSection) -> list[str]:
    """Tell in lines which positions of the receiver no vehicle reaches, and where they contradict the distances."""
    if len(section.fixes) < 2:
        return []
    # Near the middle of the line a degree is as long as there; far away it need only be far.
    longitude = np.radians(section.fixes[:, 1])
    latitude = np.radians(section.fixes[:, 2])
    middle = float(np.median(latitude))
    east = np.angle(np.exp(1j * (longitude - np.median(longitude)))) * math.cos(middle)
    place = _EARTH * np.stack([east, latitude - middle, np.zeros_like(east)], axis=1)
    lines: list[str] = []
    at, kept = _plausible_fixes(section, place, lines)
    lines = [
        line.replace("left out, which", "an import with an anchor leaves out, which")
        for line in lines
    ]
    if section.distance is not None and len(at) > 1:
        way = float(np.hypot(*np.diff(kept[:, :2], axis=0).T).sum())
        first = int(np.ceil(at[0]))
        last = int(np.floor(at[-1]))
        told = float(np.abs(np.diff(section.distance[first : last + 1])).sum())
        if abs(way - told) > _CLOSE and not 0.5 < way / max(told, 1e-9) < 2.0:
            lines.append(
                f"the satellite receiver went {way:.4g} m from trace {first} to trace {last}, where the traces' own "
                f"distance is {told:.4g} m: is their spacing right?"
            )
    return lines


def _given_instead(
    section: GprSection, channel: int, step: float | None, time_zero: float | None, window: float | None,
    separation: float | None,
) -> list[str]:  # fmt: skip
    """Tell in lines what was given in place of what the file tells."""
    delay = section.delay_of(channel)
    told: dict[str, tuple[float | None, float | None, str]] = {
        "separation": (separation, section.separation, "m"),
        "time window": (window, (delay[1] - delay[0]) * delay.size, "s"),
        "time zero": (time_zero, -float(delay[0]), "s"),
    }
    lines = []
    for name, (given, own, unit) in told.items():
        if (
            given is not None
            and own is not None
            and not math.isclose(given, own, rel_tol=1e-9, abs_tol=1e-15)
        ):
            lines.append(
                f"{name} {given:.6g} {unit} is given in place of the file's, {own:.6g} {unit}"
            )
    if step is not None and section.distance is not None:
        lines.append(
            f"equal steps of {step:.6g} m are given in place of the file's {section.distance.size} places"
        )
    return lines


def _spectra(
    traces: NDArray[np.floating], delay: NDArray[np.float64], band: tuple[float, float]
) -> tuple[NDArray[np.complex64], NDArray[np.float64]]:
    """Take traces to frequency in blocks, for a transform of all at once takes many times their room."""
    parts = [
        impulse_to_frequency(traces[k : k + _BLOCK], delay, band)
        for k in range(0, len(traces), _BLOCK)
    ]
    return np.concatenate([part.astype(np.complex64) for part, _ in parts]), parts[0][1]
