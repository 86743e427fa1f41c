"""What the readers of commercial radars share: text headers, records of one length, measurements.

Every function that replaces, leaves out or assumes something notes it in ``notes``, with a count.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import accumulate
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flgpr.door import Folder, open_named, refuse_linked_companion
from flgpr.store.text import decode_text
from flgpr.types import AnyArray, ArrayLike, BoolArray, Entries, FloatArray, Notes, floats

NANOSECOND = 1e-9
FOOT = 0.3048
INTERVALS = (1e-13, 1e-6)
"""Shortest and longest time between samples that any such radar has, s."""
MOST_SAMPLES = 2**20
"""Most samples of a trace."""
FARTHEST = 1e7
"""Farthest position along a line, m."""
LARGEST_TEXT = 64 * 2**20
DAY = 86_400.0
ZERO_ASSUMED = "the header tells no time zero: it is put at the first sample"
_LARGEST_COUNT = 1e30  # magnitude that no recorder reaches but a wrong byte order makes
_LENGTHS = {
    "m": 1.0,
    "metre": 1.0,
    "meter": 1.0,
    "mt": 1.0,
    "cm": 0.01,
    "centimetre": 0.01,
    "centimeter": 0.01,
    "mm": 1e-3,
    "millimetre": 1e-3,
    "millimeter": 1e-3,
    "dm": 0.1,
    "km": 1e3,
    "ft": FOOT,
    "foot": FOOT,
    "feet": FOOT,
    "'": FOOT,
    "in": 0.0254,
    "inch": 0.0254,
    "inche": 0.0254,
    '"': 0.0254,
    "yd": 0.9144,
    "yard": 0.9144,
}
_FARTHEST_APART = 1000.0  # m, of two antennas in a gather
_MOST_COMPARED = 2000  # traces, by which it is decided whether they are of several channels
_ALIKE = 1.5  # times that changes from trace to trace differ within one channel, at most
_USUAL_JUMP = 20.0  # times the usual step, from which on a step is a jump that is noted
_LEAST_JUMP = 1.0  # m, and at least this


class MissingHeaderError(FileNotFoundError):
    """A file that a recording cannot be read without does not lie beside it."""


@dataclass
class Header:
    """The lines ``name = value`` of a text header."""

    path: Path
    values: dict[str, str]

    def number(self, name: str, low: float, high: float) -> float | None:
        """Return the number of an entry.

        Parameters
        ----------
        name : str
            The entry.
        low, high : float
            Its bounds.

        Returns
        -------
        float or None
            The number; None where the entry is absent.

        Raises
        ------
        ValueError
            If it is out of bounds.
        """
        cells = self.values.get(name, "").split()
        if not cells:
            return None
        try:
            value = float(cells[0].replace(",", "."))
        except ValueError:
            value = np.nan
        if not low <= value <= high:
            raise ValueError(
                f"{self.path.name}: {name} must be a number from {low:g} to {high:g}, "
                f"got {cells[0][:40]!r}"
            )
        return value

    def needed(self, name: str, low: float, high: float) -> float:
        """Return the number of an entry that must be there."""
        value = self.number(name, low, high)
        if value is None:
            raise ValueError(f"{self.path.name} must hold {name}, which it does not")
        return value

    def text(self, *names: str) -> str:
        """Return the first of these entries that is not empty, else an empty text."""
        return next((self.values[name] for name in names if self.values.get(name)), "")


def words_type(words: Mapping[str, tuple[Any, int]], size: int, order: str) -> np.dtype[Any]:
    """Return the type of a binary header, by a table of its words.

    Parameters
    ----------
    words : mapping of str to (type, int)
        Type, without its byte order, and first byte of each word, by its name.
    size : int
        Bytes of the header.
    order : str
        Byte order, "<" or ">".

    Returns
    -------
    numpy.dtype
        Of a record with a field for every word.
    """
    fields: Any = {
        "names": list(words),
        "formats": [order + kind for kind, _ in words.values()],
        "offsets": [offset for _, offset in words.values()],
        "itemsize": size,
    }
    return np.dtype(fields)


def header_words(raw: bytes, words: Mapping[str, tuple[str, int]], order: str) -> Entries:
    """Return the words of a binary header by their names, see :func:`words_type`."""
    (values,) = np.frombuffer(raw, words_type(words, len(raw), order)).tolist()
    return dict(zip(words, values, strict=True))


def note_count(notes: Notes, found: ArrayLike, text: str) -> int:
    """Add a note that begins with a count, unless that is zero.

    Parameters
    ----------
    notes : list of str
        Takes the note.
    found : array_like of bool, or int
        What is counted, or the count.
    text : str
        What follows the count.

    Returns
    -------
    int
        The count.
    """
    count = int(np.sum(found))
    if count:
        notes.append(f"{count} {text}")
    return count


def first_bytes(path: Path, size: int, start: int = 0, header: str = "", least: int = 0) -> bytes:
    """Return up to so many bytes of a recording from ``start`` on.

    Parameters
    ----------
    path : Path
        The recording.
    size : int
        Most bytes.
    start : int
        First byte.
    header : str
        What they are, for the error.
    least : int
        Fewest bytes.

    Returns
    -------
    bytes
        Fewer than ``size`` where the file ends.

    Raises
    ------
    ValueError
        If there are fewer than ``least``.
    """
    with open_named(path) as file:
        file.seek(start)
        raw = file.read(size)
    if len(raw) < least:
        raise ValueError(f"{header} must have {least} bytes, the file has {len(raw)}")
    return raw


def find_companion(path: Path, suffix: str) -> Path | None:
    """Find the file of the same name and another ending, in any case.

    Parameters
    ----------
    path : Path
        The recording.
    suffix : str
        The ending, such as ".gps".

    Returns
    -------
    Path or None
        The file; None if there is none.

    Raises
    ------
    ValueError
        If it is a symbolic link: the user named the recording, and nobody where this leads.
    """
    companion_name = (path.stem + suffix).lower()
    for other in sorted(path.parent.iterdir()):
        if other.name.lower() == companion_name and other.is_file():
            refuse_linked_companion(other)
            return other
    return None


def read_header(path: Path, suffix: str, mark: str, notes: Notes) -> Header:
    """Read the text header beside a recording.

    Parameters
    ----------
    path : Path
        The recording.
    suffix : str
        Ending of the header.
    mark : str
        What separates the name and the value of an entry.
    notes : list of str
        Notes of the encoding are added to it.

    Returns
    -------
    Header
        The entries, their names in capitals.

    Raises
    ------
    MissingHeaderError
        If there is no such file.
    """
    companion = find_companion(path, suffix)
    if companion is None:
        raise MissingHeaderError(
            f"{path}: its header {path.stem}{suffix} must lie beside it, it does not"
        )
    values = {}
    for line in read_companion(companion, notes).splitlines():
        name, separator, value = line.partition(mark)
        if separator:
            values[name.strip().upper()] = value.strip()
    return Header(companion, values)


def read_companion(path: Path, notes: Notes) -> str:
    """Read a text file that lies beside a recording, in an encoding of :mod:`flgpr.store.text`.

    Parameters
    ----------
    path : Path
        The file.
    notes : list of str
        Takes a line for an encoding other than UTF-8.

    Returns
    -------
    str
        Its text.

    Raises
    ------
    ValueError
        If it is too large, or no text.
    """
    size = path.lstat().st_size
    if size > LARGEST_TEXT:
        raise ValueError(f"{path.name} must hold at most {LARGEST_TEXT} bytes, got {size}")
    return decode_text(Folder(path.parent).read(path.name), path.name, notes)


def length_unit(text: str) -> float | None:
    """Return how many metres a unit of length is.

    Parameters
    ----------
    text : str
        Name or sign of the unit.

    Returns
    -------
    float or None
        Metres; None if the unit is not known.
    """
    word = text.strip().lower().removesuffix("(s)").rstrip(".")
    return _LENGTHS.get(word) or _LENGTHS.get(word.rstrip("s"))


def read_records(
    path: Path,
    start: int,
    kind: np.dtype[Any],
    stated: float | None,
    notes: Notes,
    limit: int,
    end: int = 0,
) -> AnyArray:
    """Read records of one length, after they were counted by the size of the file.

    Parameters
    ----------
    path : Path
        The recording.
    start, end : int
        Bytes before the first record, and behind the last.
    kind : dtype
        Type of a record: samples, or fields with one called "samples".
    stated : float or None
        Traces by the header; others than there are get a note.
    notes : list of str
        Notes are added to it.
    limit : int
        Bytes that all traces may take in memory.

    Returns
    -------
    (trace,) ndarray
        The records.

    Raises
    ------
    ValueError
        If there is no trace, or they take too much memory.
    """
    samples = kind if kind.fields is None else kind["samples"]
    growth = 4 if samples.base.itemsize == 1 else 2  # of counts that become floating point
    available = path.stat().st_size - start - end
    count, rest = divmod(max(available, 0), kind.itemsize)
    if count < 1:
        raise ValueError(
            f"it must hold at least one trace of {kind.itemsize} bytes after {start}, "
            f"the file has {available + start}"
        )
    needed = count * kind.itemsize * growth
    if needed > limit:
        raise ValueError(
            f"it must fit into {limit / 1e9:.3g} GB, its traces take {needed / 1e9:.3g} GB"
        )
    if rest:
        notes.append(f"the last trace is cut off and left out ({rest} of {kind.itemsize} bytes)")
    if stated is not None and count < stated - 1:  # headers count from 0 or from 1
        notes.append(f"truncated: the header tells {stated:g} traces, the file holds {count}")
    if stated is not None and count > stated + 1:
        notes.append(
            f"the header tells {stated:g} traces, the file holds {count}, all of which are read"
        )
    return np.fromfile(path, dtype=kind, count=count, offset=start)


def exact_floats(samples: AnyArray, notes: Notes) -> NDArray[np.floating[Any]]:
    """Return samples as floating point in which every count is exact.

    Parameters
    ----------
    samples : (trace, ...) ndarray
        Counts or numbers.
    notes : list of str
        Takes a line on traces with samples that are no numbers.

    Returns
    -------
    (trace, ...) ndarray of float
        In single precision, or in double where that would round counts or numbers.

    Raises
    ------
    ValueError
        If a magnitude is beyond 1e30.
    """
    # Single precision holds whole numbers of up to 24 bit exactly.
    width = samples.dtype.itemsize
    is_wide = width > 4 or (width == 4 and samples.dtype.kind in "iu")
    with np.errstate(invalid="ignore"):  # a signalling NaN is a NaN
        real: NDArray[np.floating[Any]] = samples.astype(np.float64 if is_wide else np.float32)
    finite = np.isfinite(real)
    size = np.abs(real[finite]).max(initial=0.0)
    if size > _LARGEST_COUNT:
        raise ValueError(
            f"samples must be below 1e30 in magnitude, got {size:g}: is the byte order wrong?"
        )
    missing = ~finite.reshape(len(real), -1).all(axis=1)
    note_count(notes, missing, f"of {len(real)} traces hold samples that are no numbers")
    return real


def float64(values: AnyArray) -> FloatArray:
    """Return header words as float64; a signalling NaN becomes a quiet one, without a warning."""
    with np.errstate(invalid="ignore"):
        return values.astype(np.float64)


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
    steps = np.hypot(*np.diff(positions[:, :2], axis=0).T)
    notes.append(f"the distance along the line is that of the traces' coordinates, {what}")
    distance = np.append(0.0, steps.cumsum())
    return measured_distance(distance, None, "distances from trace to trace", "the header", notes)


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


def interleaved_channels(traces: AnyArray, stated: int, entry: str, notes: Notes) -> AnyArray:
    """Return traces (scan, channel, sample) of a file whose header states several channels.

    Some recorders write the channels of a place one after the other, others a file for each. The
    traces decide: side by side in one file, they change otherwise from the last channel to the next
    place than from channel to channel.

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
    if len(traces) <= stated or not _change_by_channel(traces, stated):
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


def numbers_in(text: bytes, widths: list[int]) -> list[float]:
    """Return numbers that are written as text in fields of fixed widths.

    Parameters
    ----------
    text : bytes
        The fields, one after the other.
    widths : list of int
        Bytes of each field.

    Returns
    -------
    list of float
        A number per field; NaN for what is none.
    """
    numbers = []
    for end, width in zip(accumulate(widths), widths, strict=True):
        try:
            numbers.append(float(text[end - width : end].split(b"\0")[0]))
        except ValueError:
            numbers.append(np.nan)
    return numbers


def is_header_line(line: str) -> bool:
    """Return whether a line of a table names columns or is a comment.

    It is empty, begins with a mark of comments, or holds no digit.
    """
    content = line.strip()
    return not content or content[0] in "#;!%/" or not re.search(r"\d", content)
