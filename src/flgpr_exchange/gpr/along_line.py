"""What traces along a line measured: distances, clock, separations and channels.

Every function that replaces, leaves out or assumes something notes it in ``notes``, with a count.
"""

from __future__ import annotations

import numpy as np

from flgpr.model.frames import steps_of
from flgpr.types import AnyArray, BoolArray, FloatArray, Notes, floats
from flgpr_exchange.gpr.parts import Header, note_count

FARTHEST = 1e7
"""Farthest position along a line, m."""
DAY = 86_400.0
_FARTHEST_APART = 1000.0  # m, of two antennas in a gather
_MOST_COMPARED = 2000  # traces, by which it is decided whether they are of several channels
_ALIKE = 1.5  # times that changes from trace to trace differ within one channel, at most
_USUAL_JUMP = 20.0  # times the usual step, from which on a step is a jump that is noted
_EVERY = 10  # traces over which the way is compared with that from trace to trace
_LEAST_JUDGED = 40  # traces of a line whose coordinates are judged
_SCATTER = 1.05  # times as long as the former, from where on coordinates scatter
_STRAIGHT = 0.02  # of its length, by which a straight line lies aside of its course
_LEAST_JUMP = 1.0  # m, and at least this


def equal_steps(count: int, step: float | None, where: str, notes: Notes) -> FloatArray | None:
    """Return distances (trace,) in equal steps, m, as a header states them; None without any.

    Parameters
    ----------
    count : int
        Number of traces.
    step : float or None
        Step from trace to trace, m; None or 0 where none is stated.
    where : str
        What states it, for the notes.
    notes : list of str
        Takes what is assumed, replaced or not used.

    Returns
    -------
    (trace,) ndarray of float or None
        The distances, m.
    """
    if not step or not np.isfinite(step):
        return None
    direction = ", counted towards smaller positions" if step < 0 else ""
    notes.append(f"traces are put at equal steps of {abs(step):.6g} m, by {where}{direction}")
    return np.arange(count, dtype=np.float64) * abs(step)


def measured_distance(
    distance: FloatArray, step: float | None, where: str, nominal: str, notes: Notes
) -> FloatArray | None:
    """Return the traces' distances along the line as they were measured.

    One that is no number is put between its neighbours. Distances that all are the same are
    not used: the header's nominal step replaces them. Traces that do not move or go
    back stay where they were measured. A line that only goes towards smaller distances begins at 0.

    Parameters
    ----------
    distance : (trace,) ndarray
        Distances in the file, m.
    step : float or None
        Nominal step, m.
    where, nominal : str
        What holds the distances and the step, for the notes.
    notes : list of str
        Notes are added to it.

    Returns
    -------
    (trace,) ndarray or None
        Distances, m; None if the file holds neither distances nor a step.
    """
    count = distance.size
    usable = np.isfinite(distance) & (np.abs(np.nan_to_num(distance)) < FARTHEST)
    unusable = np.count_nonzero(~usable)
    if count < 2 or count - unusable < 2 or np.ptp(distance[usable]) == 0:
        if count > 1:
            note_count(notes, unusable, f"of {count} {where} are no places and are not used")
        return equal_steps(count, step, nominal, notes)
    filled = between_neighbours(distance[:, None], usable)[:, 0]
    note_count(notes, unusable, f"of {count} {where} are no numbers: put between their neighbours")
    steps = np.diff(filled)
    if (steps <= 0).all():
        notes.append(f"{where} fall from trace to trace: places are counted from the first one on")
        filled = filled[0] - filled
        steps = -steps
    unmoved = np.count_nonzero(steps == 0)
    back = np.count_nonzero(steps < 0)
    if unmoved or back:
        notes.append(
            f"by {where} {unmoved} traces stand where the one before was and {back} lie behind it: "
            "they are kept as measured"
        )
    size = np.abs(steps)
    usual = float(np.median(size[size > 0]))
    jumps = np.count_nonzero(size > max(_USUAL_JUMP * usual, _LEAST_JUMP))
    if jumps:
        notes.append(
            f"{where} jump {jumps} times, by up to {size.max():.6g} m (usually {usual:.3g} m): "
            "kept as measured"
        )
    return floats(filled)


def way_along(positions: FloatArray, what: str, notes: Notes) -> FloatArray | None:
    """Return the distance (trace,) along positions (trace, 2 or 3), m, by x and y.

    Parameters
    ----------
    positions : (trace, 2 or 3) ndarray
        Positions, m.
    what : str
        Whose coordinates they are, for the notes.
    notes : list of str
        Notes are added to it.

    Returns
    -------
    (trace,) ndarray or None
        The distance, see :func:`measured_distance`.
    """
    notes.append(f"the distance along the line is that of the traces' coordinates, {what}")
    distance = np.append(0.0, steps_of(positions).cumsum())
    if len(positions) >= _LEAST_JUDGED:
        distance = _without_scatter(positions[:, :2], distance, notes)
    return measured_distance(distance, None, "distances from trace to trace", "the header", notes)


def scatter_of(positions: FloatArray) -> str:
    """Return in words how much errors and coarse steps lengthen the way along positions (place, 2), m.

    Empty where they hardly do, or where there are too few to tell.
    """
    if len(positions) <= _EVERY:
        return ""
    coarse = np.append(np.arange(0, len(positions), _EVERY), len(positions) - 1)
    way, shorter = (float(steps_of(places).sum()) for places in (positions, positions[coarse]))
    if way <= _SCATTER * shorter:
        return ""
    return (
        f"positions scatter: from each to the next the way is {way:.4g} m, from every {_EVERY}th to "
        f"the next {shorter:.4g} m"
    )


def _without_scatter(positions: FloatArray, way: FloatArray, notes: Notes) -> FloatArray:
    """Return the way (trace,) along positions (trace, 2), m, along the course where they scatter.

    Errors and coarse steps of coordinates make the way from trace to trace longer than the line. A
    straight line that does not turn round is measured along its course.
    """
    too_long = scatter_of(positions)
    if not too_long:
        return way
    from_first = positions - positions[0]
    course = np.linalg.svd(positions - positions.mean(axis=0), full_matrices=False)[2][0]
    along = from_first @ (course * (np.sign(from_first[-1] @ course) or 1.0))
    aside = np.std(from_first @ [course[1], -course[0]])
    if aside > _STRAIGHT * np.ptp(along) or (np.diff(along[::_EVERY]) < 0).any():
        notes.append(f"{too_long}; the former is taken, for the line is not straight")
        return way
    # By means of as many traces: between them the scatter is most of what was measured.
    trace = np.arange(len(along))
    ends = np.arange(0, len(along) - _EVERY + 1, _EVERY)
    at, there = (np.add.reduceat(values, ends)[:-1] / _EVERY for values in (trace, along))
    smooth = np.interp(trace, at, there)
    for outside, edge in ((trace < at[0], 0), (trace > at[-1], -1)):
        pace = (there[1] - there[0]) if edge == 0 else (there[-1] - there[-2])
        smooth[outside] = there[edge] + (trace[outside] - at[edge]) * pace / _EVERY
    smooth -= smooth[0]
    notes.append(
        f"{too_long}; distances are those along the straight course, {smooth[-1]:.4g} m, by means of "
        f"{_EVERY} traces"
    )
    return floats(smooth)


def between_neighbours(values: FloatArray, usable: BoolArray) -> FloatArray:
    """Return values (trace, column), those that are not usable between those before and behind.

    Parameters
    ----------
    values : (trace, column) ndarray
        The values.
    usable : (trace,) ndarray of bool
        Which of them are kept; one at least.

    Returns
    -------
    (trace, column) ndarray
        All of them.
    """
    trace = np.arange(len(values))
    columns = [np.interp(trace, trace[usable], column[usable]) for column in values.T]
    return np.stack(columns, axis=1)


def gather_of_separations(apart: FloatArray, unit: str, notes: Notes) -> str:
    """Return what to call a survey by the separations of its antennas.

    Antennas that only move apart, or only together, make a gather. Separations that change
    otherwise are noted.

    Parameters
    ----------
    apart : (trace,) ndarray
        Separation of the antennas.
    unit : str
        Its unit, after a blank; empty if it is not known.
    notes : list of str
        Notes are added to it.

    Returns
    -------
    str
        What the gather is; empty for a line of one offset.
    """
    low = float(apart.min())
    high = float(apart.max())
    if high - low <= max(0.01, 0.1 * float(apart.mean())):
        return ""
    steps = np.diff(apart)
    one_direction = bool((steps >= 0).all() or (steps <= 0).all())
    separations = f"{low:g} to {high:g}{unit} apart"
    if one_direction and high <= _FARTHEST_APART:
        return f"antennas {separations}"
    notes.append(f"the trace headers put the antennas {separations}, which is not used")
    return ""


def measured_clock(time: FloatArray, notes: Notes) -> FloatArray | None:
    """Return the traces' clock, if it never goes back; over midnight it goes on.

    Parameters
    ----------
    time : (trace,) ndarray
        Times of the day, s.
    notes : list of str
        Notes are added to it.

    Returns
    -------
    (trace,) ndarray or None
        Seconds of the first day; None if the clock stands, goes back or is no number.
    """
    unknown = np.count_nonzero(~np.isfinite(time))
    if unknown:
        notes.append(f"the clock of {unknown} of {time.size} traces is no number: not used")
        return None
    if time.size < 2 or np.ptp(time) == 0:
        return None
    steps = np.diff(time)
    over_midnight = steps < -DAY / 2
    if over_midnight.any():
        notes.append(
            f"the clock passes midnight {np.count_nonzero(over_midnight)} times: it is counted on"
        )
    # A leap of more than half a day ahead is one back over midnight: nobody records for so long
    # between two traces.
    leaps = over_midnight.astype(int) - (steps > DAY / 2)
    days = np.cumsum(np.append(0, leaps))
    rising = time + DAY * days
    back = np.diff(rising) < 0
    if back.any():
        notes.append(
            f"the clock goes back {np.count_nonzero(back)} times, "
            f"by up to {-np.diff(rising).min():.6g} s: not used"
        )
        return None
    return floats(rising)


def interleaved_channels(
    traces: AnyArray,
    stated: int,
    entry: str,
    notes: Notes,
    places: float | None = None,
    is_named_one: bool = False,
) -> AnyArray:
    """Return traces (scan, channel, sample) of a file whose header states several channels.

    Some recorders write the channels of a place one after the other, others a file for each. What
    decides is the number of places that the header states, then the name of the file, then the
    traces: side by side in one file, they change otherwise from the last channel to the next place
    than from channel to channel.

    Parameters
    ----------
    traces : (trace, sample) ndarray
        All traces in the order of the file.
    stated : int
        Channels by the header.
    entry : str
        What states them, for the notes.
    notes : list of str
        Takes what was decided.
    places : float, optional
        Places, or traces, by the header.
    is_named_one : bool
        Whether the name of the file is that of one channel.

    Returns
    -------
    (scan, channel, sample) ndarray
        The traces.

    Raises
    ------
    ValueError
        If the channels lie side by side and a place lacks some.
    """
    if stated < 2 or len(traces) < 2:
        return traces[:, None]
    are_places = places is not None and places * stated == len(traces)
    is_one = is_named_one and places in (None, len(traces))
    if not are_places and (
        is_one or len(traces) <= stated or not _change_by_channel(traces, stated)
    ):
        notes.append(
            f"{entry} tells {stated} channels; the traces are those of one, as recorders write "
            "that have a file for each"
        )
        return traces[:, None]
    scans, rest = divmod(len(traces), stated)
    if rest:
        notes.append(f"the last place is cut off and left out ({rest} of {stated} channels)")
    notes.append(
        f"{entry} tells {stated} channels, one after the other in the file: {scans} places of "
        f"{stated} traces"
    )
    return traces[: scans * stated].reshape(scans, stated, -1)


def _change_by_channel(traces: AnyArray, channels: int) -> bool:
    """Return whether traces (trace, sample) change as those of so many channels side by side."""
    some = np.nan_to_num(traces[:_MOST_COMPARED].astype(np.float64))
    to_next = np.abs(np.diff(some, axis=0)).mean(axis=1)
    to_next_place = np.abs(some[channels:] - some[:-channels]).mean()
    of_channel = [float(to_next[channel::channels].mean()) for channel in range(channels)]
    is_smooth = to_next.mean() < to_next_place
    is_alike = max(of_channel) < _ALIKE * min(of_channel)
    return not (is_smooth and is_alike)


def channel_offsets(head: Header, channels: int, notes: Notes) -> FloatArray | None:
    """Return where the antennas of each channel are (channel, 2), m across and along.

    Parameters
    ----------
    head : Header
        A header with ``CH_X_OFFSETS`` and ``CH_Y_OFFSETS``, or the same of one channel.
    channels : int
        Channels of the file.
    notes : list of str
        Takes what is used, and offsets that do not fit.

    Returns
    -------
    (channel, 2) ndarray or None
        The offsets; None where none are stated.
    """
    columns = []
    for axis in "XY":
        stated = head.text(f"CH_{axis}_OFFSETS", f"CH_{axis}_OFFSET").replace(",", ".").split()
        try:
            values = np.array([float(cell) for cell in stated] or [0.0] * channels)
        except ValueError:
            values = np.empty(0)
        fits = values.size == channels and np.abs(values).max(initial=0.0) <= _FARTHEST_APART
        if not fits:
            notes.append(
                f"CH_{axis}_OFFSETS hold {len(stated)} offsets, not one for each of {channels} "
                "channels: they are not used"
            )
            return None
        columns.append(values)
    offsets = np.stack(columns, axis=1)
    if not offsets.any():
        return None
    x = ", ".join(f"{value:g}" for value in offsets[:, 0])
    notes.append(f"antennas of the channels are put {x} m across, by CH_X_OFFSETS of the header")
    return offsets
