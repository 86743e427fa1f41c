"""Where the traces of a line are: along +y by their distances, or by a satellite receiver."""

from __future__ import annotations

import math

import numpy as np

from flgpr.formats.section import GprSection
from flgpr.geo.anchor import Anchor
from flgpr.geo.track_anchor import is_astray
from flgpr.model.bounds import LARGEST
from flgpr.model.frames import steps_of, wrapped
from flgpr.model.motion import Motion, judge_poses, some_steps
from flgpr.model.plausible import MotionLimits
from flgpr.model.track import course, make_track, poses_at
from flgpr.types import BoolArray, FloatArray, IntArray, Notes
from flgpr_exchange.gpr.along_line import scatter_of
from flgpr_exchange.gpr.parts import note_count

_MOST_HEADINGS = 4000  # fixes of a course, whose computation takes the square of their number
_LISTED = 3  # fixes that are named
_OF_FIXES = ("position", "lines of", "sentences of")  # in notes that tell what became of fixes
_EARTH = 6_371_000.0  # m, its mean radius
_LEVEL = 0.01  # m of height, that are none
_CLOSE = 20.0  # m that the path of a receiver without corrections may be off
_SLIP = 2  # times the traces' own distance that positions may lie apart


def poses_by_distance(
    section: GprSection, step: float | None, height: float, notes: Notes
) -> tuple[IntArray, FloatArray]:
    """Return all traces of a line that is put along +y, and their poses.

    Parameters
    ----------
    section : GprSection
        The line.
    step : float or None
        Distance between traces, m, in place of the file's.
    height : float
        Height of the antennas over the ground, m.
    notes : list of str
        Notes are added to it.

    Returns
    -------
    traces : (scan,) ndarray of int
        Traces, from 0.
    poses : (scan, 6) ndarray
        Their poses, m and rad.

    Raises
    ------
    ValueError
        If the step is none that traces have, or no distances are known.
    """
    if step is not None and not 1e-5 <= step <= 1e3:
        raise ValueError(f"step must be from 1e-5 to 1e3 m, got {step:g}")
    count = len(section.traces)
    along = section.distance if step is None else step * np.arange(count)
    if along is None:
        raise ValueError(
            f"{section.path}: its headers tell no trace spacing: give the "
            f"{options_that_place(section)}"
        )
    notes.append("the line is put along +y of the lane, at x = 0")
    not_used = "positions of the satellite receiver are not used: they need an anchor"
    note_count(notes, len(section.fixes), not_used)
    pose = np.zeros((count, 6))
    pose[:, 1] = along
    pose[:, 2] = height
    return np.arange(count), pose


def poses_by_fixes(
    section: GprSection, height: float, anchor: Anchor, topography: bool, notes: Notes
) -> tuple[IntArray, FloatArray]:
    """Return the traces between the satellite receiver's first and last position, and their poses.

    Parameters
    ----------
    section : GprSection
        The line.
    height : float
        Height of the antennas over the ground, m.
    anchor : Anchor
        Takes the receiver's positions to the lane.
    topography : bool
        Whether the receiver's heights are used.
    notes : list of str
        Notes are added to it.

    Returns
    -------
    traces, poses
        As of :func:`poses_by_distance`.

    Raises
    ------
    ValueError
        If positions or heights that are needed are missing.
    """
    if len(section.fixes) < 2:
        reasons = [note for note in section.history if any(word in note for word in _OF_FIXES)]
        raise ValueError(
            f"{section.path}: an anchor needs positions of two traces or more, "
            f"got {'; '.join([str(len(section.fixes)), *reasons])}"
        )
    position = anchor.from_geodetic(section.fixes[:, 1:])
    ground = position[:, 2].copy()
    position[:, 2] = height
    trace, position = _plausible_fixes(section, position, notes)
    ground = ground[np.isin(section.fixes[:, 0], trace)]
    have_heights = anchor.heights_known and bool(np.isfinite(ground).all())
    low, high = ground.min(initial=np.inf), ground.max(initial=-np.inf)
    span = f"{low:.2f} to {high:.2f} m in the lane"
    if topography:
        if not have_heights:
            raise ValueError(
                f"{section.path}: topography needs an anchor with heights and a height of every "
                "position"
            )
        notes.append(
            f"antennas are put on the receiver's heights, {span}; "
            "its own height over the ground is not taken off"
        )
        position[:, 2] += ground
    elif have_heights and high - low > _LEVEL:
        notes.append(
            f"heights of the receiver from {span} are not used: "
            "the ground is taken as level; --topography puts the line on them"
        )

    scatter = scatter_of(position[:, :2])
    if scatter:
        notes.append(f"{scatter}; the line and its headings follow them as they are")
    every = 1 + len(trace) // _MOST_HEADINGS
    heading_of_some = np.unwrap(course(position[::every]))
    heading = np.interp(trace, trace[::every], heading_of_some)
    track = make_track(trace, position, heading)
    between = np.arange(math.ceil(trace[0]), math.floor(trace[-1]) + 1)
    notes.append(
        f"{len(between)} of {len(section.traces)} traces lie between positions of the satellite "
        "receiver and are kept"
    )
    return between, poses_at(track, between)


def options_that_place(section: GprSection, dashes: str = "") -> str:
    """Return the options that place the traces of a line whose headers do not, in words.

    Parameters
    ----------
    section : GprSection
        The line.
    dashes : str
        What stands before the name of an option.

    Returns
    -------
    str
        The options, such as "step or mark-spacing".
    """
    options = [f"{dashes}step"]
    if len(section.marks) > 1:
        options.append(f"{dashes}mark-spacing")
    if len(section.fixes) > 1:
        options += [f"{dashes}anchor", f"{dashes}anchor-from-track"]
    *first, last = options
    return f"{', '.join(first)} or {last}" if first else last


def _plausible_fixes(
    section: GprSection, position: FloatArray, notes: Notes
) -> tuple[FloatArray, FloatArray]:
    """Return traces and positions of the fixes (fix, 3) in the lane that a vehicle can reach.

    Traces in between are put on the line from fix to fix, so that one wrong fix would move all to
    its next ones. The times are the receiver's own; the headers state at best a nominal rate of
    traces. Fixes left out are noted.
    """
    trace = section.fixes[:, 0]
    of_all = f"of {len(trace)} positions of the satellite receiver"

    def leave_out(bad: IntArray, reason: str) -> None:
        listed = ", ".join(f"{number:g}" for number in trace[bad][:_LISTED])
        note_count(notes, bad.size, f"{of_all} left out, which {reason}: at trace {listed}")

    motion = _judge_fixes(section, position)
    if motion.left_out:
        notes.append(
            f"{len(motion.left_out)} {of_all} left out, "
            f"which no vehicle reaches; traces are counted as scans: {some_steps(motion.steps)}"
        )
    elif motion.steps:
        notes.append(
            f"{len(motion.steps)} {of_all} lie farther "
            "from those before than a vehicle goes; they are too many to be faults, and all are "
            f"used: {some_steps(motion.steps)}"
        )
    used = np.flatnonzero(motion.plausible)
    agrees = _near_by_distance(section, trace[used], position[used])
    leave_out(used[~agrees], "are farther from those about them than the traces' own distance")
    used = used[agrees]
    astray = used[is_astray(position[used])]
    leave_out(astray, "lie aside of a way that goes on behind them")
    used = np.setdiff1d(used, astray)
    return trace[used], position[used]


def _near_by_distance(section: GprSection, trace: FloatArray, position: FloatArray) -> BoolArray:
    """Return which positions (fix, 3), m, are as near to others as the traces' distance allows.

    The others are the next two of each side.
    """
    count = len(position)
    if section.distance is None or count < 3:
        return np.ones(count, bool)
    travelled = np.append(0.0, np.abs(np.diff(section.distance)).cumsum())
    along = np.interp(trace, np.arange(len(travelled)), travelled)
    agrees = np.zeros(count, bool)
    for step in (1, 2):
        apart = np.hypot(*(position[step:, :2] - position[:-step, :2]).T)
        fits = apart <= _SLIP * (along[step:] - along[:-step]) + _CLOSE
        agrees[step:] |= fits
        agrees[:-step] |= fits
    # Where hardly any agree, it is the distance that is wrong.
    return agrees if 2 * np.count_nonzero(agrees) > count else np.ones(count, bool)


def _judge_fixes(section: GprSection, position: FloatArray) -> Motion:
    """Judge positions (fix, 3), m, of the receiver as those of a vehicle.

    They are judged by their times where these go on.
    """
    pose = np.pad(position, ((0, 0), (0, 3)))
    # Fixes may be as many traces apart as they like, and a receiver without corrections wanders
    # from fix to fix.
    limits = MotionLimits(scans=int(LARGEST), acceleration=1000.0)
    trace, time = section.fixes[:, 0], None
    steps = np.diff(section.fix_time)
    if section.fix_time.size == len(position) and (steps > 0).any() and not (steps < 0).any():
        time = section.fix_time
    elif section.time is not None:
        time = np.interp(trace, np.arange(len(section.time)), section.time)
    return judge_poses(pose, time, limits, np.round(trace))


def doubts_of_fixes(section: GprSection) -> list[str]:
    """Return in lines what of the receiver's positions is in doubt.

    Parameters
    ----------
    section : GprSection
        The line.

    Returns
    -------
    list of str
        On positions that no vehicle reaches, and on a path that contradicts the traces' distances.
    """
    if len(section.fixes) < 2:
        return []
    notes: Notes = []
    trace, position = _plausible_fixes(section, _near_middle(section.fixes), notes)
    later = "an import with an anchor leaves out, which"
    lines = [note.replace("left out, which", later) for note in notes]
    if section.distance is None or len(trace) < 2:
        return lines
    by_receiver = float(steps_of(position).sum())
    first = math.ceil(trace[0])
    last = math.floor(trace[-1])
    by_traces = float(np.abs(np.diff(section.distance[first : last + 1])).sum())
    is_near = abs(by_receiver - by_traces) <= _CLOSE
    if not is_near and not 0.5 < by_receiver / max(by_traces, 1e-9) < 2.0:
        lines.append(
            f"the satellite receiver went {by_receiver:.4g} m from trace {first} to trace {last}, "
            f"where the traces' own distance is {by_traces:.4g} m: is their spacing right?"
        )
    return lines


def _near_middle(fixes: FloatArray) -> FloatArray:
    """Return fixes (fix, 4) as positions (fix, 3) on a plane at the middle of the line, m.

    Near the middle of the line a degree is as long as there; far away it need only be far.
    """
    longitude, latitude = np.radians(fixes[:, 1:3]).T
    middle = float(np.median(latitude))
    # The difference of longitudes is wrapped: a line may cross the date line.
    difference = wrapped(longitude - np.median(longitude))
    east = difference * math.cos(middle)
    return _EARTH * np.stack([east, latitude - middle, np.zeros_like(east)], axis=1)


def option_that_places(section: GprSection) -> str:
    """Return the option to import a line with, its value to fill in; nothing if headers place it."""
    if section.distance is not None:
        return ""
    if len(section.fixes) > 1:
        return " --anchor-from-track"
    return f" {'--mark-spacing' if len(section.marks) > 1 else '--step'} METRES"
