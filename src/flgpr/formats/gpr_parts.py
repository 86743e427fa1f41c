"""What the readers of commercial radars share: text headers, records of one length, and what is kept of measurements.

Every function that replaces, leaves out or assumes something says so in ``notes``, with a count.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flgpr.door import open_named, read_named
from flgpr.store.text import decode_text

FloatArray = NDArray[np.float64]
NANOSECOND = 1e-9
FOOT = 0.3048
INTERVALS = (1e-13, 1e-6)
"""Shortest and longest time between samples that any such radar has, s."""
MOST_SAMPLES = 2**20
FARTHEST = 1e7
"""Most samples of a trace, and the farthest along a line, m."""
LARGEST_TEXT = 64 * 2**20
DAY = 86_400.0
ZERO_ASSUMED = "the header tells no time zero: it is put at the first sample"
_LENGTHS = {
    "m": 1.0, "metre": 1.0, "meter": 1.0, "mt": 1.0, "cm": 0.01, "centimetre": 0.01, "centimeter": 0.01, "mm": 1e-3,
    "millimetre": 1e-3, "millimeter": 1e-3, "dm": 0.1, "km": 1e3, "ft": FOOT, "foot": FOOT, "feet": FOOT, "'": FOOT,
    "in": 0.0254, "inch": 0.0254, "inche": 0.0254, '"': 0.0254, "yd": 0.9144, "yard": 0.9144,
}  # fmt: skip
_FARTHEST_APART = 1000.0  # m, of two antennas in a gather
_USUAL_JUMP = 20.0  # times the usual step that a step is told to be, and metres at least
_LEAST_JUMP = 1.0


class MissingHeaderError(FileNotFoundError):
    """A file that a recording cannot be read without does not lie beside it."""


@dataclass
class Header:
    """The lines ``name = value`` of a text header."""

    path: Path
    values: dict[str, str]

    def number(self, name: str, low: float, high: float, needed: bool = True) -> float | None:
        """Return an entry's number; None where it is absent and not ``needed``. One out of bounds is a ValueError."""
        text = self.values.get(name, "").split()
        if not text:
            if needed:
                raise ValueError(f"{self.path.name} must hold {name}, which it does not")
            return None
        try:
            value = float(text[0].replace(",", "."))
        except ValueError:
            value = np.nan
        if not low <= value <= high:
            raise ValueError(
                f"{self.path.name}: {name} must be a number from {low:g} to {high:g}, got {text[0][:40]!r}"
            )
        return value

    def needed(self, name: str, low: float, high: float) -> float:
        """Return the number of an entry that must be there."""
        return float(self.number(name, low, high) or 0.0)

    def text(self, *names: str) -> str:
        """Return the first of these entries that is not empty, else an empty text."""
        return next((self.values[name] for name in names if self.values.get(name)), "")


def first_bytes(path: Path, size: int, start: int = 0) -> bytes:
    """Return up to so many bytes of a recording from ``start`` on."""
    with open_named(path) as file:
        file.seek(start)
        return file.read(size)


def find_beside(path: Path, suffix: str) -> Path | None:
    """Return the file of the same name and another ending, in any case, if it is there."""
    wanted = (path.stem + suffix).lower()
    return next(
        (
            one
            for one in sorted(path.parent.iterdir())
            if one.name.lower() == wanted and one.is_file()
        ),
        None,
    )


def read_header(path: Path, suffix: str, mark: str, notes: list[str]) -> Header:
    """Read the text header beside a recording; no such file is a :class:`MissingHeaderError`."""
    beside = find_beside(path, suffix)
    if beside is None:
        raise MissingHeaderError(
            f"{path}: its header {path.stem}{suffix} must lie beside it, it does not"
        )
    pairs = (line.partition(mark) for line in text_beside(beside, notes).splitlines())
    return Header(
        beside, {name.strip().upper(): value.strip() for name, found, value in pairs if found}
    )


def text_beside(path: Path, notes: list[str]) -> str:
    """Read a text file that lies beside a recording, in any of the encodings of :mod:`flgpr.store.text`."""
    if path.stat().st_size > LARGEST_TEXT:
        raise ValueError(
            f"{path.name} must hold at most {LARGEST_TEXT} bytes, got {path.stat().st_size}"
        )
    return decode_text(read_named(path), path.name, notes)


def length_unit(text: str) -> float | None:
    """Return how many metres a unit of length is; None if it is not known."""
    plain = text.strip().lower().removesuffix("(s)").rstrip(".")
    known = _LENGTHS.get(plain)
    return known if known is not None else _LENGTHS.get(plain.rstrip("s"))


def count_records(
    path: Path, start: int, size: int, stated: float | None, notes: list[str], limit: int, grow: float, end: int = 0
) -> int:  # fmt: skip
    """Count the traces that the file's own size allows, ``end`` bytes before its end, before anything is read."""
    room = path.stat().st_size - start - end
    count, rest = divmod(max(room, 0), size)
    if count < 1:
        raise ValueError(
            f"it must hold at least one trace of {size} bytes after {start}, the file has {room + start}"
        )
    if count * size * grow > limit:
        raise ValueError(
            f"it must fit into {limit / 1e9:.3g} GB, its traces take {count * size * grow / 1e9:.3g} GB"
        )
    if rest:
        notes.append(f"the last trace is cut off and left out ({rest} of {size} bytes)")
    if stated is not None and count < stated - 1:  # headers count from 0 or from 1
        notes.append(f"truncated: the header tells {stated:g} traces, the file holds {count}")
    if stated is not None and count > stated + 1:
        notes.append(
            f"the header tells {stated:g} traces, the file holds {count}, all of which are read"
        )
    return count


def read_records(
    path: Path,
    start: int,
    kind: np.dtype[Any],
    stated: float | None,
    notes: list[str],
    limit: int,
    end: int = 0,
) -> NDArray[Any]:
    """Read records of one length from ``start`` on to ``end`` bytes before the end of the file."""
    narrow = kind.base.itemsize if kind.fields is None else kind["samples"].base.itemsize
    count = count_records(
        path, start, kind.itemsize, stated, notes, limit, 4 if narrow == 1 else 2, end
    )
    return np.fromfile(path, dtype=kind, count=count, offset=start)


def exact_floats(samples: NDArray[Any], notes: list[str]) -> NDArray[np.floating[Any]]:
    """Return samples (trace, ...) as floating point in which every count is exact; those that are none are told."""
    wide = samples.dtype.itemsize > 4 or (
        samples.dtype.itemsize == 4 and samples.dtype.kind in "iu"
    )
    with np.errstate(invalid="ignore"):  # a signalling NaN is a NaN
        real: NDArray[np.floating[Any]] = samples.astype(np.float64 if wide else np.float32)
    finite = np.isfinite(real)
    size = np.abs(real[finite]).max(initial=0.0)
    if size > 1e30:
        raise ValueError(
            f"samples must be below 1e30 in magnitude, got {size:g}: is the byte order wrong?"
        )
    missing = np.count_nonzero(~finite.reshape(len(real), -1).all(axis=1))
    if missing:
        notes.append(f"{missing} of {len(real)} traces hold samples that are no numbers")
    return real


def float64(values: NDArray[Any]) -> FloatArray:
    """Return header words as float64; a signalling NaN becomes a quiet one, without a warning."""
    with np.errstate(invalid="ignore"):
        return values.astype(np.float64)


def equal_steps(count: int, step: float | None, where: str, notes: list[str]) -> FloatArray | None:
    """Return places (trace,) at equal steps, m, as a header tells them; None if it tells none."""
    if not step or not np.isfinite(step):
        return None
    back = ", counted towards smaller positions" if step < 0 else ""
    notes.append(f"traces are put at equal steps of {abs(step):.6g} m, by {where}{back}")
    return np.arange(count, dtype=np.float64) * abs(step)


def measured_places(
    place: FloatArray, step: float | None, where: str, nominal: str, notes: list[str]
) -> FloatArray | None:
    """Return the traces' own places (trace,), m, as they were measured; equal steps where the file tells none.

    A place that is no number is put between its neighbours. Places that all are the same tell nothing, so that the
    header's nominal ``step`` stands in their place. Traces that stand still or go back stay where they were measured. A
    line that only goes towards smaller places begins at 0. ``where`` and ``nominal`` say what holds places and step.
    """
    usable = np.isfinite(place) & (np.abs(np.nan_to_num(place)) < FARTHEST)
    if place.size < 2 or np.count_nonzero(usable) < 2 or np.ptp(place[usable]) == 0:
        if place.size > 1 and np.count_nonzero(usable) < place.size:
            notes.append(
                f"{np.count_nonzero(~usable)} of {place.size} {where} are no places and are not used"
            )
        return equal_steps(place.size, step, nominal, notes)
    trace = np.arange(place.size)
    filled = np.interp(trace, trace[usable], place[usable])
    if not usable.all():
        notes.append(
            f"{np.count_nonzero(~usable)} of {place.size} {where} are no numbers: put between their neighbours"
        )
    apart = np.diff(filled)
    if (apart <= 0).all():
        notes.append(f"{where} fall from trace to trace: places are counted from the first one on")
        filled = filled[0] - filled
        apart = -apart
    _note_motion(apart, where, notes)
    return np.asarray(filled, dtype=np.float64)


def _note_motion(apart: FloatArray, where: str, notes: list[str]) -> None:
    """Tell of traces that stand still, go back or jump; they stay as they are."""
    still = np.count_nonzero(apart == 0)
    back = np.count_nonzero(apart < 0)
    if still or back:
        notes.append(
            f"by {where} {still} traces stand where the one before was and {back} lie behind it: they are kept as "
            "measured"
        )
    steps = np.abs(apart)
    usual = float(np.median(steps[steps > 0]))
    jumps = np.count_nonzero(steps > max(_USUAL_JUMP * usual, _LEAST_JUMP))
    if jumps:
        notes.append(
            f"{where} jump {jumps} times, by up to {steps.max():.6g} m (usually {usual:.3g} m): kept as measured"
        )


def gather_note(gather: str) -> str:
    """Return the note of a survey whose antennas move apart."""
    return f"its antennas move apart ({gather}): it is no line of one offset"


def gather_of_separations(apart: FloatArray, unit: str, notes: list[str]) -> str:
    """Return what to call a survey whose antennas lie ``apart`` (trace,), in ``unit``; empty for a line of one offset.

    Antennas that only move apart, or only together, make a gather. Separations that change otherwise are told.
    """
    low = float(apart.min())
    high = float(apart.max())
    if high - low <= max(0.01, 0.1 * float(apart.mean())):
        return ""
    steps = np.diff(apart)
    one_way = bool((steps >= 0).all() or (steps <= 0).all())
    words = f"{low:g} to {high:g}{unit} apart"
    if one_way and high <= _FARTHEST_APART:
        return f"antennas {words}"
    notes.append(f"the trace headers put the antennas {words}, which is not used")
    return ""


def measured_clock(time: FloatArray, notes: list[str]) -> FloatArray | None:
    """Return the traces' clock (trace,), s of the first day, if it never goes back; over midnight it goes on."""
    if not np.isfinite(time).all():
        notes.append(
            f"the clock of {np.count_nonzero(~np.isfinite(time))} of {time.size} traces is no number: not used"
        )
        return None
    if time.size < 2 or np.ptp(time) == 0:
        return None
    steps = np.diff(time)
    midnights = np.count_nonzero(steps < -DAY / 2)
    if midnights:
        notes.append(f"the clock passes midnight {midnights} times: it is counted on")
    # A leap of more than half a day ahead is one back over midnight: nobody records for so long between two traces.
    days = np.cumsum(np.append(0, (steps < -DAY / 2).astype(int) - (steps > DAY / 2)))
    rising = time + DAY * days
    back = np.diff(rising) < 0
    if back.any():
        notes.append(
            f"the clock goes back {np.count_nonzero(back)} times, by up to {-np.diff(rising).min():.6g} s: not used"
        )
        return None
    return np.asarray(rising, dtype=np.float64)


def numbers_in(text: bytes, widths: list[int]) -> list[float]:
    """Return numbers written as text in fields of so many bytes, one after the other; NaN for what is none."""
    found = []
    for width in widths:
        cell = text[:width].split(b"\0")[0]
        text = text[width:]
        try:
            found.append(float(cell))
        except ValueError:
            found.append(np.nan)
    return found


def is_header_line(line: str) -> bool:
    """Tell whether a line of a table names columns or is a comment: it is empty, begins so, or holds no digit."""
    return not line.strip() or line.lstrip()[0] in "#;!%/" or not re.search(r"\d", line)
