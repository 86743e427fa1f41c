"""Positions of a satellite receiver in files that lie beside a recording.

``.gps`` and ``.gp2`` are Sensors & Software's, ``.dzg`` GSSI's, ``.cor`` MALÅ's and ImpulseRadar's.
Their layouts are as files show them and as RGPR, readgssi, ridal and ImpDAR read them. What is in
them and not used is counted in ``notes``; nothing in such a file keeps the recording itself from
being read.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from flgpr.formats.nmea import (
    SentenceCounts,
    clock_time,
    position_of,
    sentences_of,
)
from flgpr.types import ArrayLike, BoolArray, FloatArray, Notes, floats
from flgpr_exchange.gpr.along_line import DAY
from flgpr_exchange.gpr.parts import find_companion, is_header_line, note_count, read_companion

CHANNEL_OF_NAME = re.compile(r"(.+)_[A-Za-z]?\d{1,3}")
"""A file of one channel of several, such as line_A03, whose positions may lie in line.cor."""
_TRACE = re.compile(r"\s*Trace\s*#\s*(\d{1,9})", re.IGNORECASE)
_SCAN = re.compile(r"\s*\$GSSIS,(\d{1,9})")
_NOT_MEASURED = {6: "dead reckoning", 7: "put in by hand", 8: "simulated"}
"""Qualities of GGA (NMEA 0183) that are no measurement of a satellite receiver."""
_ROW = re.compile(r"\s*\"?(\d{1,9})\"?\s*[,;\t]")
_ANGLE = re.compile(r"([NSEW]?)([-+]?[\d.:]+)([NSEW]?)")
_ANGLE_SIGNS = re.compile("[°º'’′\"”″]+")  # of degrees, minutes and seconds
_HEIGHT = re.compile(r"[-+]?\d+(?:\.\d*)?(?:[eE][-+]?\d+)?")
_LARGEST_HEIGHT = 1e5  # m


Fix = tuple[float, float, float, float, float]
"""A position as a file states it.

Trace, from 0, longitude and latitude, degrees, WGS 84, height over the ellipsoid, m, and second of
the day; the last two are NaN where the file states none.
"""


class Fixes(NamedTuple):
    """The positions that are used, in the order of their traces."""

    #: (fix, 4): trace, longitude, latitude, height
    table: FloatArray = np.empty((0, 4))
    #: (fix,) s of the first day, NaN where unknown
    time: FloatArray = np.empty(0)


def nmea_fixes(
    path: Path | None, count: int, notes: Notes, numbers: NDArray[np.integer] | None = None
) -> Fixes:
    """Read the positions of a file of NMEA sentences beside a recording.

    Each follows a line that names its trace, or stands in a row that begins with it. GGA is used;
    RMC, which has no height, where there is no GGA.

    Parameters
    ----------
    path : Path or None
        The file; None if there is none.
    count : int
        Traces of the recording.
    notes : list of str
        Notes are added to it.
    numbers : (trace,) ndarray of int, optional
        The traces' own numbers from 1 on, where a recording has them.

    Returns
    -------
    Fixes
        The positions that are used.
    """
    text = _companion_text(path, notes)
    if path is None or text is None:
        return Fixes()
    lines = text.splitlines()
    counts = SentenceCounts()
    fixes: dict[str, list[Fix]] = {"GGA": [], "RMC": []}
    separations: dict[str, list[float]] = {"GGA": [], "RMC": []}  # of geoid and ellipsoid, m
    unusable = 0
    without_trace = 0
    not_measured = Counter[str]()
    trace_of_line: list[int | None] = []
    trace: int | None = None
    for line in lines:
        by_number, by_scan = _TRACE.match(line), _SCAN.match(line)
        if by_number is not None:
            trace = int(by_number[1]) - 1
        elif by_scan is not None:
            trace = int(by_scan[1])
        trace_of_line.append(trace)
    total = 0
    for number, begin, sentence in sentences_of(lines, ("GGA", "RMC"), counts):
        total += 1
        position = position_of(sentence)
        if position is None:
            unusable += 1
            continue
        not_measured[_NOT_MEASURED.get(position.quality, "")] += 1
        row = _ROW.match(lines[number][:begin])
        named = trace_of_line[number] if row is None else int(row[1]) - 1
        if named is None:
            without_trace += 1
            continue
        fixes[sentence.kind].append((named, *position[1:4], position.time))
        separations[sentence.kind].append(position.separation)

    name = path.name
    if not total:
        notes.append(f"{name} was found and holds no position that is understood")
    of_all = f"of {total} sentences of {name}"
    note_count(notes, unusable, f"{of_all} tell no position (the receiver had no fix)")
    del not_measured[""]
    for quality, number in not_measured.items():
        note_count(notes, number, f"{of_all} are {quality}: they are used")
    note_count(notes, without_trace, f"positions of {name} name no trace and are not used")
    notes += counts.notes(name)
    # RMC would add the same positions once more, without a height.
    used, others = fixes["GGA"], fixes["RMC"]
    if len(used) < min(2, len(others)):
        beside = "and a single GGA, which is not used" if used else "alone"
        notes.append(f"{name} holds RMC sentences {beside}, which tell no height")
        used = others
    stated = floats(used).reshape(-1, 5)
    if fixes["GGA"] and used is fixes["GGA"]:
        stated[:, 3] += _separations(floats(separations["GGA"]), notes)
    return settle_fixes(stated, count, notes, name, numbers)


def _separations(stated: FloatArray, notes: Notes) -> FloatArray:
    """Return the separations of the geoid from the ellipsoid, m; 0 where none at all is stated."""
    unknown = np.isnan(stated)
    if not unknown.any() or unknown.all():
        return np.nan_to_num(stated)
    note_count(
        notes,
        unknown,
        f"of {stated.size} positions tell no separation of the geoid from the ellipsoid: that of the "
        "others is taken",
    )
    return np.where(unknown, np.median(stated[~unknown]), stated)


def _companion_text(path: Path | None, notes: Notes) -> str | None:
    """Return the text of a file beside a recording; None if there is none or it is not a text."""
    if path is None:
        return None
    try:
        return read_companion(path, notes)
    except ValueError as error:
        notes.append(f"{path.name} was found and not understood: {error}")
        return None


def find_cor(path: Path, notes: Notes) -> Path | None:
    """Find the ``.cor`` beside a recording: of its own name, or common to all channels' files.

    Parameters
    ----------
    path : Path
        The recording.
    notes : list of str
        Takes a line where it is the common one.

    Returns
    -------
    Path or None
        The file; None if there is none.
    """
    own = find_companion(path, ".cor")
    line = CHANNEL_OF_NAME.fullmatch(path.stem)
    if own is not None or line is None:
        return own
    common = find_companion(path.with_name(line[1] + path.suffix), ".cor")
    if common is not None:
        notes.append(f"positions are those of {common.name}, common to the channels of the line")
    return common


def cor_fixes(path: Path | None, count: int, notes: Notes) -> Fixes:
    """Read the positions of a ``.cor``.

    Its columns are trace (from 1), date, time, latitude, N or S, longitude, E or W, height. They
    are parted by tabs, blanks, semicolons or commas; decimals may have commas where commas do not
    part the columns. Latitude and longitude may be ``deg:min:s``, or have the signs of these, and
    may carry their letter or a sign. A row with another letter is not understood: O is east in
    German, and west in French and Spanish.

    Parameters
    ----------
    path : Path or None
        The file; None if there is none.
    count : int
        Traces of the recording.
    notes : list of str
        Notes are added to it.

    Returns
    -------
    Fixes
        The positions that are used.
    """
    text = _companion_text(path, notes)
    if path is None or text is None:
        return Fixes()
    fixes: list[Fix] = []
    strange = 0
    for number, line in enumerate(text.splitlines()):
        content = line.strip()
        names_columns = not fixes and is_header_line(line)
        is_text = number == 0 and not content.lstrip("\"'")[:1].isdigit()
        if not content or names_columns or is_text:
            continue
        fix = _fix_of_row(_cor_cells(content))
        if fix is None:
            strange += 1
        else:
            fixes.append(fix)
    lines = f"of {strange + len(fixes)} lines of {path.name}"
    note_count(notes, strange, f"{lines} were not understood and are left out")
    return settle_fixes(fixes, count, notes, path.name)


def _cor_cells(line: str) -> list[str]:
    """Split a line of a ``.cor`` into cells with decimal points."""
    cells = re.split(r"[;\t ]+", line.strip(";"))
    if len(cells) >= 5:  # commas are decimal, or stand beside blanks
        return [cell.strip('",').replace(",", ".") for cell in cells]
    return [cell.strip('" ') for cell in re.split(r"[,;\t]", line)]


def _fix_of_row(cells: Sequence[str]) -> Fix | None:
    """Return the position that a row of a ``.cor`` states; None if it is not understood."""
    if len(cells) < 6 or not re.fullmatch(r"\d{1,9}(\.0*)?", cells[0]):
        return None
    latitude, position = _angle_at(cells, 3, "NS")
    longitude, position = _angle_at(cells, position, "EW")
    if latitude is None or longitude is None:
        return None
    match = _HEIGHT.match(cells[position]) if position < len(cells) else None
    height = float(match[0]) if match else np.nan
    return float(cells[0]) - 1, longitude, latitude, height, clock_time(cells[2])


def _angle_at(cells: Sequence[str], position: int, letters: str) -> tuple[float | None, int]:
    """Return an angle that begins at a cell, and the position of the cell that follows.

    Its letter is before, within or after it. The angle is None if the cell is none.
    """
    cells = [*cells, "", "", ""]  # so that there are cells behind the last one
    side = _letter_in(cells[position], letters)
    position += bool(side)
    # The sign behind the last number parts nothing.
    parted = re.sub(r":(?=[NSEW]?$)", "", _ANGLE_SIGNS.sub(":", cells[position].upper()))
    match = _ANGLE.fullmatch(parted)
    if match is None:
        return None, position
    before, digits, behind = match.groups()
    side = side or before or behind
    position += 1
    if not side:
        side = _letter_in(cells[position], letters)
        position += bool(side)
    # A further letter is of another language; M is the unit of a height that is missing.
    is_strange = re.fullmatch(r"[^\W\d_Mm]", cells[position]) is not None
    if (side and side not in letters) or is_strange:
        return None, position
    try:
        sexagesimal = [float(number) for number in digits.split(":")]
    except ValueError:
        return None, position
    angle = sum(abs(number) / 60**power for power, number in enumerate(sexagesimal))
    is_negative = digits.startswith("-") or side == letters[1]
    return (-angle if is_negative else angle), position


def _letter_in(cell: str, letters: str) -> str:
    """Return the letter in a cell that is one of two; empty if it is another cell."""
    letter = cell.upper()
    return letter if letter in tuple(letters) else ""


def settle_fixes(
    fixes: ArrayLike,
    count: int,
    notes: Notes,
    name: str,
    numbers: NDArray[np.integer] | None = None,
) -> Fixes:
    """Return the positions that lie on the Earth and on a trace, the first of each trace.

    Traces that were cut out of a line keep their own numbers, to which the positions belong. Where
    the trace numbers of a file begin anew, lines were merged: then a position belongs to the
    trace of its own line, if the traces' own numbers begin anew as often. Otherwise those from
    there on are left out.

    Parameters
    ----------
    fixes : (fix, 5) array_like
        The positions in the order of the file, each a :data:`Fix`.
    count : int
        Traces of the recording.
    notes : list of str
        Notes are added to it.
    name : str
        What holds the positions.
    numbers : (trace,) ndarray of int, optional
        The traces' own numbers from 1 on.

    Returns
    -------
    Fixes
        The positions that are used.
    """
    stated = floats(fixes).reshape(-1, 5)
    table = _on_cut_line(stated, notes, name, numbers)
    if table is stated:
        table = _on_own_lines(stated, notes, name, numbers)
    table = table[_on_earth(table, count, len(stated), notes)]
    # Times of the day are counted on where they pass midnight.
    known = np.flatnonzero(np.isfinite(table[:, 4]))
    passes = np.append(0, np.diff(table[known, 4]) < -DAY / 2)
    table[known, 4] += DAY * np.cumsum(passes)[: known.size]

    back = np.count_nonzero(np.diff(table[:, 4]) < 0)
    if back:
        notes.append(f"the receiver's clock in {name} goes back {back} times")
    _, first = np.unique(table[:, 0], return_index=True)
    further = len(table) - first.size
    note_count(notes, further, "positions are further ones of the same trace: its first is used")
    table = table[first]
    # Recorders write the latest position to every trace until the next one comes.
    is_new = np.ones(len(table), bool)
    is_new[1:] = (np.diff(table[:, [1, 2, 4]], axis=0) != 0).any(axis=1)
    if np.count_nonzero(is_new) > 1:
        note_count(notes, ~is_new, "positions repeat the one before, at its time: left out")
        table = table[is_new]
    unknown = np.isnan(table[:, 3])
    note_count(notes, unknown, f"of {len(table)} positions tell no height: 0 m is taken")
    table[unknown, 3] = 0.0
    return Fixes(table[:, :4], table[:, 4])


def _on_earth(table: FloatArray, count: int, total: int, notes: Notes) -> BoolArray:
    """Return which positions (fix, 5) lie on the Earth and on one of ``count`` traces.

    0 N 0 E is what recorders write without a position. ``total`` positions are in the file.
    """
    trace, longitude, latitude, height = table[:, :4].T
    at_zero = (longitude == 0) & (latitude == 0)
    left_out = f"of {total} positions left out"
    note_count(notes, at_zero, f"{left_out}: 0 N 0 E, where no receiver was")

    usable = np.isfinite(table[:, :3]).all(axis=1)
    usable &= (np.abs(longitude) <= 180) & (np.abs(latitude) <= 90)
    usable &= (trace >= 0) & (trace < count)
    usable &= ~(np.abs(height) >= _LARGEST_HEIGHT)  # an unknown height, NaN, is allowed
    note_count(notes, ~(usable | at_zero), f"{left_out}: no place on the Earth, or no trace")
    return usable & ~at_zero


def _on_cut_line(
    table: FloatArray, notes: Notes, name: str, numbers: NDArray[np.integer] | None
) -> FloatArray:
    """Return positions (fix, 5) on the traces whose own numbers they name.

    That is where these rise, do not begin at 1, and more of them are named than traces by place.
    """
    if numbers is None or numbers.size < 2 or numbers[0] <= 1 or (np.diff(numbers) <= 0).any():
        return table
    named = table[:, 0] + 1
    index = np.searchsorted(numbers, named)
    is_there = numbers[np.minimum(index, numbers.size - 1)] == named
    if np.count_nonzero(is_there) <= np.count_nonzero((named >= 1) & (named <= numbers.size)):
        return table
    notes.append(
        f"the traces' own numbers begin at {numbers[0]}: the positions of {name} are put on the "
        "traces of the numbers that they name"
    )
    placed = table.copy()
    placed[:, 0] = np.where(is_there, index, np.nan)
    return placed


def _on_own_lines(
    table: FloatArray, notes: Notes, name: str, numbers: NDArray[np.integer] | None
) -> FloatArray:
    """Return positions (fix, 5) of merged lines on their own traces.

    Those whose line is not known are left out. ``numbers`` (trace,) are the traces' own.
    """
    # Numbers begin anew where they fall, and the next one does not go on from before the fall.
    falls = np.flatnonzero(np.diff(table[:, 0]) < 0) + 1
    following = np.append(table[:, 0], -np.inf)
    restarts = falls[following[falls + 1] < table[falls - 1, 0]]
    if not restarts.size:
        return table
    starts = np.empty(0, int)
    if numbers is not None:
        starts = np.flatnonzero(np.diff(numbers) < 0) + 1
    if numbers is None or starts.size != restarts.size:
        lost = len(table) - restarts[0]
        notes.append(
            f"{lost} of {len(table)} positions of {name} left out: its trace numbers begin anew, "
            "as those of merged lines, and the traces do not tell where"
        )
        return table[: restarts[0]]

    settled = table.copy()
    line_of_fix = np.searchsorted(restarts, np.arange(len(table)), side="right")
    edges = [0, *starts.tolist(), len(numbers)]
    for line, (begin, end) in enumerate(pairwise(edges)):
        traces = np.arange(begin, end)
        fixes = np.flatnonzero(line_of_fix == line)
        trace_number = table[fixes, 0] + 1
        match = np.searchsorted(numbers[traces], trace_number)
        nearest = traces[np.minimum(match, traces.size - 1)]
        is_there = (match < traces.size) & (numbers[nearest] == trace_number)
        settled[fixes, 0] = np.where(is_there, nearest, np.nan)
    notes.append(
        f"{len(edges) - 1} lines were merged: the positions of {name} are put on the traces of "
        "their own line"
    )
    return settled


def note_unread(path: Path, suffixes: Sequence[str], notes: Notes) -> None:
    """Add notes of the files of the same name that lie beside a recording and are not read.

    Parameters
    ----------
    path : Path
        The recording.
    suffixes : sequence of str
        Endings of the files.
    notes : list of str
        Takes a line for each that is there.
    """
    for suffix in suffixes:
        companion = find_companion(path, suffix)
        if companion is not None:
            notes.append(f"{companion.name} lies beside it and is not read")
