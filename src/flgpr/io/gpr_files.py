"""Files of commercial ground-penetrating radars: one line of traces, with what its headers say of it.

Layouts are as their makers publish them: Sensors & Software's DT1 and HD, GSSI's DZT (the structure tagRFHeader of the
SIR manuals), MALÅ's RD3, RD7 and RAD, ImpulseRadar's IPRB and IPRH, SEG-Y revision 1. That of IDS GeoRadar's DT is not
published; it is as the programs of others find it.
"""

from __future__ import annotations

import re
import struct
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

from flgpr.door import read_named
from flgpr.io.declared import MAX_MEMORY
from flgpr.io.files import existing

FloatArray = NDArray[np.float64]
_NS, _FOOT = 1e-9, 0.3048
_INTERVALS = (1e-13, 1e-6)  # s, shortest and longest time between samples that any such radar has
_MOST_SAMPLES, _FARTHEST = 2**20, 1e7  # samples of a trace; m along a line
_LARGEST_HEADER = 64 * 2**20
_DZT_HEADER, _IDS_HEADER = 1024, 2**20  # bytes; of the latter at most

NOT_READ = {
    ".ogpr": ("OpenGPR", "there is no reader for it yet; export SEG-Y"),
    ".3dra": ("3d-radar", "its layout is not published; export SEG-Y from the maker's Examiner"),
    ".gsf": ("Geoscanners", "there is no reader for it; export SEG-Y from the maker's GPRSoft"),
}
"""Endings of recordings that are known and cannot be read: what they are, and what to do."""


class MissingHeaderError(FileNotFoundError):
    """A file that a recording cannot be read without does not lie beside it."""


@dataclass(frozen=True)
class GprSection:
    """One line of a ground-penetrating radar: the traces of a file, and what its headers say."""

    path: Path
    format: str  #: what it was read as, in words
    #: (trace, channel, sample) counts of the recorder, float; NaN where the recorder says that a trace is no data
    traces: NDArray[np.floating[Any]]
    delay: FloatArray  #: (sample,) two-way delay, s; zero where the header puts time zero, else at the first sample
    distance: FloatArray | None = None  #: (trace,) along the line, m; None if the header does not tell
    time: FloatArray | None = None  #: (trace,) s, on a clock of the recorder's own; None if unknown
    #: (fix, 4) of a satellite receiver: trace (from 0), longitude, latitude (degrees, WGS 84), ellipsoidal height (m)
    fixes: FloatArray = field(default_factory=lambda: np.empty((0, 4)))
    marks: tuple[int, ...] = ()  #: traces, from 0, at which the operator set a mark
    frequencies: tuple[float | None, ...] = (None,)  #: nominal frequency of each channel's antenna, Hz
    separation: float | None = None  #: between transmitter and receiver, m
    title: str = ""  #: what the header calls the line, else the file's name
    history: tuple[str, ...] = ()  #: what was found and assumed on reading, in words


def read_gpr(path: str | Path, max_memory: int = MAX_MEMORY) -> GprSection:
    """Read a line of traces from a file of Sensors & Software, GSSI, MALÅ, ImpulseRadar or IDS, or from SEG-Y.

    The ending, of any case, tells the format: ``.dt1``, ``.dzt``, ``.rd3``, ``.rd7``, ``.iprb``, ``.dt``, ``.sgy``,
    ``.segy``.
    Headers and positions (``.hd``, ``.gps``, ``.dzg``, ``.rad``, ``.iprh``, ``.cor``) lie beside it under the same
    name. A header that is missing is a FileNotFoundError; one that contradicts the file's size, holds nonsense, or asks
    for more than ``max_memory`` bytes is a ValueError. A last trace that is cut off is left out, which ``history``
    says.
    """
    path = existing(path)
    suffix = path.suffix.lower()
    if suffix in NOT_READ:
        raise ValueError("{}: {} files cannot be read: {}".format(path, *NOT_READ[suffix]))
    if suffix in _HEADERS:
        raise ValueError(f"{path}: this is the header of a recording; give the {_HEADERS[suffix]} file beside it")
    if suffix not in READERS:
        raise ValueError(f"{path}: the ending must be one of {', '.join(READERS)}, got {suffix!r}")
    words, reader = READERS[suffix]
    try:
        found = reader(path, max_memory)
    except MissingHeaderError:
        raise
    except Exception as error:
        said = " ".join(str(error).split())[:240] or type(error).__name__
        raise ValueError(f"{path}: cannot be read as {words}: {said}") from None
    return GprSection(path, words, **{"title": path.stem, **found})


def is_gpr(path: Path) -> bool:
    """Tell by its ending whether a file is a recording of a ground-penetrating radar, or belongs to one."""
    return path.suffix.lower() in {**READERS, **NOT_READ, **_HEADERS}


@dataclass
class _Header:
    """The lines ``name = value`` of a text header."""

    path: Path
    values: dict[str, str]

    def number(self, name: str, low: float, high: float, needed: bool = True) -> float | None:
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
        return float(self.number(name, low, high) or 0.0)

    def text(self, *names: str) -> str:
        return next((self.values[name] for name in names if self.values.get(name)), "")


def _beside(path: Path, suffix: str) -> Path | None:
    """Find a file of the same name and another ending, in any case."""
    wanted = (path.stem + suffix).lower()
    return next((one for one in sorted(path.parent.iterdir()) if one.name.lower() == wanted and one.is_file()), None)


def _header(path: Path, suffix: str, mark: str) -> _Header:
    beside = _beside(path, suffix)
    if beside is None:
        raise MissingHeaderError(f"{path}: its header {path.stem}{suffix} must lie beside it, it does not")
    pairs = (line.partition(mark) for line in _text(beside).splitlines())
    return _Header(beside, {name.strip().upper(): value.strip() for name, found, value in pairs if found})


def _text(path: Path) -> str:
    if path.stat().st_size > _LARGEST_HEADER:
        raise ValueError(f"{path.name} must hold at most {_LARGEST_HEADER} bytes, got {path.stat().st_size}")
    return read_named(path).decode("latin-1")


def _read_dt1(path: Path, limit: int) -> dict[str, Any]:
    head, notes = _header(path, ".hd", "="), list[str]()
    samples = int(head.needed("NUMBER OF PTS/TRC", 2, _MOST_SAMPLES))
    window = head.needed("TOTAL TIME WINDOW", _INTERVALS[0] / _NS, _INTERVALS[1] / _NS * samples) * _NS
    kind = head.text("DATA TYPE").upper().replace(" ", "") or "I*2"
    if kind not in ("I*2", "F*4"):
        raise ValueError(f"{head.path.name}: DATA TYPE must be I*2 or F*4, got {kind[:40]!r}")
    sample = "<i2" if kind == "I*2" else "<f4"
    record = np.dtype([("head", "<f4", 25), ("comment", "S28"), ("samples", sample, samples)])
    table = _records(path, 0, record, head.number("NUMBER OF TRACES", 0, 1e9, False), notes, limit)
    if (table["head"][:, 2] != samples).any():  # written on a machine of the other byte order?
        table = table.view(record.newbyteorder())
    told = table["head"].astype(np.float64)
    if (told[:, 2] != samples).any():
        bad = int(np.argmax(told[:, 2] != samples))
        raise ValueError(f"trace {bad} must have {samples} points as {head.path.name} says, got {told[bad, 2]:g}")
    traces = _real(table["samples"])
    empty = told[:, 21] == 1
    traces[empty] = np.nan
    if empty.any():
        notes.append(f"{np.count_nonzero(empty)} traces without data, as their headers say")
    unit = head.text("POSITION UNITS").lower()
    scale = _FOOT if unit.startswith(("f", "'")) else 1.0
    step = head.number("STEP SIZE USED", -1e4, 1e4, False)
    zero = head.number("TIMEZERO AT POINT", -1e6, 1e6, False)
    if zero is None:
        notes.append("the header tells no time zero: it is put at the first sample")
    megahertz = head.number("NOMINAL FREQUENCY", 0, 1e5, False)
    separation = head.number("ANTENNA SEPARATION", 0, 1e3, False)
    return {
        "traces": traces[:, None],
        # Points are counted from 1.
        "delay": (np.arange(samples) - ((zero or 1.0) - 1.0)) * window / samples,
        "distance": _distance(told[:, 1] * scale, None if step is None else step * scale),
        "time": _clock(told[:, 23]),
        "fixes": _gga(_beside(path, ".gps"), len(traces), notes),
        "marks": tuple(np.flatnonzero(told[:, 24] == 1).tolist()),
        "frequencies": (megahertz * 1e6 if megahertz else None,),
        "separation": None if separation is None else separation * scale,
        "history": tuple(notes),
    }


def _read_dzt(path: Path, limit: int) -> dict[str, Any]:
    with path.open("rb") as file:
        raw = file.read(4 * _DZT_HEADER)
    if len(raw) < _DZT_HEADER:
        raise ValueError(f"its header must have {_DZT_HEADER} bytes, the file has {len(raw)}")
    tag, start, samples, bits = struct.unpack_from("<4H", raw, 0)
    per_second, per_metre, _, position, window = struct.unpack_from("<5f", raw, 10)
    (channels,) = struct.unpack_from("<H", raw, 52)
    if tag & 0xFF != 0xFF:
        raise ValueError(f"it must begin with the tag 0xnnFF, got {tag:#06x}")
    types: dict[int, tuple[DTypeLike, float]] = {8: ("u1", 128.0), 16: ("<u2", 32768.0), 32: ("<i4", 0.0)}
    if bits not in types or samples < 4 or not 1 <= channels <= 4:
        raise ValueError(
            f"it must have 8, 16 or 32 bits, 4 or more samples and 1 to 4 channels, got {bits}, {samples}, {channels}"
        )
    if not _INTERVALS[0] <= window * _NS / samples <= _INTERVALS[1] or not abs(position) <= 100 * window:
        raise ValueError(f"range and position must be times in ns, got {window:g} and {position:g}")
    sample, offset = types[bits]
    notes: list[str] = []
    begin = _DZT_HEADER * (start if 0 < start < _DZT_HEADER else channels)
    table = _records(path, begin, np.dtype((sample, (channels, samples))), None, notes, limit)
    words = table[:, 0, 1].astype(np.int64)
    traces = _real(table)
    traces -= offset
    traces[..., :2] = traces[..., 2:3]  # the first two samples are the scan's number and marks
    common = np.bincount(np.unique(words, return_inverse=True)[1]).argmax()
    marks = np.flatnonzero(words != np.unique(words)[common])
    names = [raw[_DZT_HEADER * k + 98 : _DZT_HEADER * k + 112] for k in range(channels)]
    antennas = [one.split(b"\0")[0].decode("latin-1").strip() for one in names]
    notes.append(f"antennas {', '.join(repr(one) for one in antennas)}; the file tells no antenna separation")
    if position == 0:
        notes.append("the header puts time zero at the first sample")
    count = len(traces)
    wheel = np.isfinite(per_metre) and 1e-3 <= per_metre <= 1e5
    timed = not wheel and np.isfinite(per_second) and 1e-3 <= per_second <= 1e6
    return {
        "traces": traces,
        "delay": position * _NS + np.arange(samples) * (window * _NS / samples),
        "distance": np.arange(count) / per_metre if wheel else None,
        "time": np.arange(count) / per_second if timed else None,
        "fixes": _gga(_beside(path, ".dzg"), count, notes),
        "marks": tuple(marks.tolist()) if 2 * marks.size < count else (),
        "frequencies": tuple(_gssi_frequency(one) for one in antennas),
        "history": tuple(notes),
    }


def _gssi_frequency(name: str) -> float | None:
    """Nominal frequency of an antenna by its model: 50400 and 5103 are models of 400 MHz, HS350 says 350 MHz."""
    models = {"3101": 900, "3102": 500, "3105": 300, "3207": 100, "5100": 1500, "5103": 400, "5104": 270, "5106": 200}
    digits = re.search(r"\d+", name)
    if digits is None or name.startswith("3200"):  # the model 3200 has antennas of any length
        return None
    number = digits[0]
    if number[:4] in models and len(number) == 4:
        return models[number] * 1e6
    value = int(number[1:] if len(number) == 5 and number[0] in "56" else number[:6])
    return value * 1e6 if 10 <= value <= 6000 else None


def _read_mala(path: Path, limit: int) -> dict[str, Any]:
    head, notes = _header(path, ".rad", ":"), list[str]()
    samples = int(head.needed("SAMPLES", 2, _MOST_SAMPLES))
    interval = 1e-6 / head.needed("FREQUENCY", 1e-6 / _INTERVALS[1], 1e-6 / _INTERVALS[0])
    sample = "<i4" if path.suffix.lower() == ".rd7" else "<i2"
    table = _records(path, 0, np.dtype((sample, samples)), head.number("LAST TRACE", 0, 1e9, False), notes, limit)
    step = head.number("DISTANCE INTERVAL", -1e4, 1e4, False)
    if head.text("DISTANCE FLAG") == "0":
        step = None  # the interval is what the wheel would have had
    notes.append("the header tells no time zero: it is put at the first sample")
    return {
        "traces": _real(table)[:, None],
        "delay": np.arange(samples) * interval,
        "distance": _distance(np.zeros(len(table)), step),
        "fixes": _cor(_beside(path, ".cor"), len(table), notes),
        "frequencies": (_megahertz(head.text("ANTENNAS", "ANTENNA")),),
        "separation": head.number("ANTENNA SEPARATION", 0, 1e3, False),
        "title": head.text("SITE") or path.stem,
        "history": tuple(notes),
    }


def _read_impulse(path: Path, limit: int) -> dict[str, Any]:
    head, notes = _header(path, ".iprh", ":"), list[str]()
    samples = int(head.needed("SAMPLES", 2, _MOST_SAMPLES))
    interval = 1e-6 / head.needed("FREQUENCY", 1e-6 / _INTERVALS[1], 1e-6 / _INTERVALS[0])
    bits = head.number("DATA VERSION", 16, 32, False) or 16
    if bits not in (16, 32):
        raise ValueError(f"{head.path.name}: DATA VERSION must be 16 or 32, got {bits:g}")
    kind = np.dtype(("<i2" if bits == 16 else "<i4", samples))
    table = _records(path, 0, kind, head.number("LAST TRACE", 0, 1e9, False), notes, limit)
    step = head.number("USER DISTANCE INTERVAL", -1e4, 1e4, False) or head.number("DISTANCE INTERVAL", -1e4, 1e4, False)
    if head.text("TRIG SOURCE").lower().startswith("time"):
        step = None
    zero = head.number("ZERO LEVEL", 0, samples, False)
    if zero is None:
        notes.append("the header tells no time zero: it is put at the first sample")
    return {
        "traces": _real(table)[:, None],
        "delay": (np.arange(samples) - (zero or 0.0)) * interval,
        "distance": _distance(np.zeros(len(table)), step),
        "fixes": _cor(_beside(path, ".cor"), len(table), notes),
        "frequencies": (_megahertz(head.text("ANTENNA")),),
        "separation": head.number("ANTENNA SEPARATION", 0, 1e3, False),
        "history": tuple(notes),
    }


def _read_ids(path: Path, limit: int) -> dict[str, Any]:
    with path.open("rb") as file:
        raw = file.read(_IDS_HEADER)
    size = int.from_bytes(raw[4:6], "little")
    if raw[:1] != b"V" or size < 256 or size % 2:
        raise ValueError(f"it must begin with V and the even length of its records, got {raw[:1]!r} and {size}")
    # Records of one length, each begins with its name: those of the header, then a trace each, whose name is R.
    names = [raw[k : k + 1] for k in range(0, len(raw), size)]
    if b"R" not in names:
        raise ValueError(f"it must hold a record R, the first trace, in its first {_IDS_HEADER} bytes, got none")
    start = names.index(b"R") * size
    header = {raw[k : k + 3].split(b"\0")[0].strip(): raw[k + 4 : k + size] for k in range(size, start, size)}
    if b"H" not in header:
        raise ValueError("it must hold a record H with the window and the step, got none")
    stated, samples = struct.unpack_from("<2i", header[b"H"], 12)
    offset = struct.unpack_from("<i", header[b"H"], 40)[0]
    if not 2 <= samples <= (size - 4) // 2:
        raise ValueError(f"samples must be from 2 to the {(size - 4) // 2} that a record holds, got {samples}")
    _, _, _, window, _, _, _, _, step, _ = _numbers_of(header[b"H"][44:], [16] * 10)
    if not _INTERVALS[0] <= window / samples <= _INTERVALS[1]:
        raise ValueError(f"its window must be a time in seconds, got {window:g}")
    notes = ["the layout of IDS files is not published: this is what others found in theirs"]
    record = np.dtype([("mark", "u1", 4), ("samples", "<i2", samples), ("rest", "u1", size - 4 - 2 * samples)])
    table = _records(path, start, record, stated, notes, limit)
    if (table["mark"][:, 0] != ord("R")).any():
        bad = int(np.argmax(table["mark"][:, 0] != ord("R")))
        raise ValueError(f"trace {bad} must begin with R, got byte {table['mark'][bad, 0]:#04x}")
    signed = table["samples"]
    bare = signed.view("<u2")
    rough = [np.abs(np.diff(one.astype(np.int32), axis=1)).mean() for one in (signed, bare)]  # a wrong sign leaps
    notes.append(f"counts taken as {'signed' if rough[0] <= rough[1] else 'unsigned'}, by their smaller leaps")
    traces = _real(signed if rough[0] <= rough[1] else bare) - np.float32(offset)
    lost = (table["mark"][:, 1] == 1) & (table["mark"][:, 2] == 6)
    traces[lost] = np.nan
    if lost.any():
        notes.append(f"{np.count_nonzero(lost)} traces without data, as their marks say")
    notes.append("the header tells no time zero: it is put at the first sample")
    places = _numbers_of(header.get(b"ATR", b""), [16, 16, 16, 5, 16, 16, 16, 5])
    apart = float(np.hypot(places[4] - places[0], places[5] - places[1]))
    megahertz = places[3] if np.isfinite(places[3]) else np.nan
    return {
        "traces": traces[:, None],
        "delay": np.arange(samples) * (window / samples),
        "distance": _distance(np.zeros(len(traces)), step if 0 < abs(step) < 1e3 else None),
        "marks": tuple(np.flatnonzero(np.isin(table["mark"][:, 1], (8, 9))).tolist()),
        "frequencies": (megahertz * 1e6 if 1 <= megahertz <= 1e5 else None,),
        "separation": apart if 0 < apart <= 1e3 else None,
        "history": tuple(notes),
    }


def _numbers_of(text: bytes, widths: list[int]) -> list[float]:
    """Read numbers written as text in fields of so many bytes, one after the other; NaN for what is none."""
    found = []
    for width in widths:
        field_, text = text[:width].split(b"\0")[0], text[width:]
        try:
            found.append(float(field_))
        except ValueError:
            found.append(np.nan)
    return found


def _read_segy(path: Path, limit: int) -> dict[str, Any]:
    with path.open("rb") as file:
        raw = file.read(3600)
    if len(raw) < 3600:
        raise ValueError(f"its headers must have 3600 bytes, the file has {len(raw)}")
    kinds = {1: "u4", 2: "i4", 3: "i2", 5: "f4", 8: "i1"}  # the first is IBM's floating point
    order = next((mark for mark in "><" if struct.unpack_from(mark + "H", raw, 3224)[0] in kinds), None)
    if order is None:
        code = struct.unpack_from(">H", raw, 3224)[0]
        raise ValueError(f"the code of its sample format must be one of {', '.join(map(str, kinds))}, got {code}")
    interval, _, samples, _, code = struct.unpack_from(order + "5H", raw, 3216)
    extended = struct.unpack_from(order + "h", raw, 3504)[0]
    if samples < 2 or interval < 1 or not 0 <= extended <= 1000:
        raise ValueError(f"it must tell samples, interval and extra headers, got {samples}, {interval}, {extended}")
    notes = [
        "the sample interval is taken as picoseconds, as radars write it; SEG-Y itself has microseconds",
        "the header tells no time zero: it is put at the first sample",
    ]
    named = {"scalar": ("i2", 70), "x": ("i4", 72), "y": ("i4", 76), "unit": ("i2", 88), "late": ("i2", 108)}
    layout: Any = {
        "names": [*named, "samples"],
        "formats": [*(order + one for one, _ in named.values()), (order + kinds[code], samples)],
        "offsets": [*(at for _, at in named.values()), 240],
        "itemsize": 240 + samples * np.dtype(kinds[code]).itemsize,
    }
    table = _records(path, 3600 + 3200 * extended, np.dtype(layout), None, notes, limit)
    if table["late"].any():
        notes.append("the delay of the recording is not applied; give the time zero")
    scalar = table["scalar"].astype(np.float64)
    scale = np.where(scalar < 0, 1 / np.maximum(-scalar, 1), np.maximum(scalar, 1))
    place = np.stack([table["x"] * scale, table["y"] * scale], axis=1)
    distance, fixes, unit = None, np.empty((0, 4)), int(table["unit"][0])
    if np.ptp(place, axis=0).any() and (table["unit"] == unit).all():
        if unit in (2, 3):  # seconds of arc, degrees
            degrees = (place / (3600 if unit == 2 else 1)).tolist()
            fixes = _fixes([(k, *one, 0.0) for k, one in enumerate(degrees)], len(table), notes)
        else:
            feet = struct.unpack_from(order + "H", raw, 3254)[0] == 2
            way = np.append(0.0, np.hypot(*np.diff(place, axis=0).T).cumsum()) * (_FOOT if feet else 1.0)
            distance = _distance(way, None)
            notes.append("the distance along the line is that of the traces' coordinates")
    values = table["samples"]
    return {
        "traces": _real(_ibm(values) if code == 1 else values)[:, None],
        "delay": np.arange(samples) * interval * 1e-12,
        "distance": distance,
        "fixes": fixes,
        "history": tuple(notes),
    }


def _ibm(words: NDArray[Any]) -> NDArray[np.float32]:
    """Take IBM's floating point, sign, exponent of 16 less 64 and 24 bits of fraction, to IEEE's."""
    word = words.astype(np.uint32)
    fraction = (word & 0xFFFFFF).astype(np.float64) * 2.0**-24
    size = np.ldexp(fraction, 4 * (((word >> 24) & 0x7F).astype(np.int32) - 64))
    with np.errstate(over="ignore"):  # what is too large for any recorder is refused by what follows
        return np.where(word >> 31, -size, size).astype(np.float32)


def _count(
    path: Path, start: int, size: int, stated: float | None, notes: list[str], limit: int, grow: float
) -> int:  # fmt: skip
    """Count the traces that the file's own size allows, before anything is read."""
    room = path.stat().st_size - start
    count, rest = divmod(room, size)
    if count < 1:
        raise ValueError(f"it must hold at least one trace of {size} bytes after {start}, the file has {room + start}")
    if count * size * grow > limit:
        raise ValueError(f"it must fit into {limit / 1e9:.3g} GB, its traces take {count * size * grow / 1e9:.3g} GB")
    if rest:
        notes.append(f"the last trace is cut off and left out ({rest} of {size} bytes)")
    if stated is not None and count < stated - 1:  # headers count from 0 or from 1
        notes.append(f"truncated: the header tells {stated:g} traces, the file holds {count}")
    return count


def _records(
    path: Path, start: int, kind: np.dtype[Any], stated: float | None, notes: list[str], limit: int
) -> NDArray[Any]:
    narrow = kind.base.itemsize if kind.fields is None else kind["samples"].base.itemsize
    count = _count(path, start, kind.itemsize, stated, notes, limit, 4 if narrow == 1 else 2)
    return np.fromfile(path, dtype=kind, count=count, offset=start)


def _real(samples: NDArray[Any]) -> NDArray[np.floating[Any]]:
    """Take samples to floating point in which every count is exact."""
    wide = samples.dtype.itemsize == 4 and samples.dtype.kind == "i"
    real: NDArray[np.floating[Any]] = samples.astype(np.float64 if wide else np.float32)
    size = np.abs(real[np.isfinite(real)]).max(initial=0.0)
    if size > 1e30:
        raise ValueError(f"samples must be below 1e30 in magnitude, got {size:g}: is the byte order wrong?")
    return real


def _distance(place: FloatArray, step: float | None) -> FloatArray | None:
    """Take the traces' own positions where they go one way, else equal steps; a line surveyed backwards begins at 0."""
    if place.size > 1 and np.isfinite(place).all() and np.abs(place).max() < _FARTHEST:
        apart = np.diff(place)
        if (apart > 0).all():
            return place
        if (apart < 0).all():
            return np.asarray(place[0] - place, dtype=np.float64)
    return None if not step else np.arange(place.size, dtype=np.float64) * abs(step)


def _clock(time: FloatArray) -> FloatArray | None:
    rising = np.isfinite(time).all() and (np.diff(time) >= 0).all() and np.ptp(time) > 0
    return time if rising else None


def _megahertz(text: str) -> float | None:
    found = re.search(r"(\d+(?:[.,]\d+)?)\s*([MG])HZ", text.upper()) or re.fullmatch(r"\s*(\d+)()\s*", text)
    if found is None:
        return None
    value = float(found[1].replace(",", ".")) * (1e9 if found[2] == "G" else 1e6)
    return value if 1e6 <= value <= 1e11 else None


def _gga(path: Path | None, count: int, notes: list[str]) -> FloatArray:
    """Read positions of traces: a line that names the trace, then NMEA's sentence GGA."""
    found: list[tuple[float, ...]] = []
    trace = None
    for line in [] if path is None else _text(path).splitlines():
        named = re.match(r"\s*Trace\s*#\s*(\d{1,9})", line, re.IGNORECASE)
        scan = re.match(r"\s*\$GSSIS,(\d{1,9})", line)
        if named or scan:
            trace = int(named[1]) - 1 if named else int(scan[1])  # type: ignore[index]
        cells = line.split("*")[0].strip().split(",")
        if trace is not None and len(cells) > 11 and re.fullmatch(r"\$[A-Z]{2}GGA", cells[0]) and cells[6] != "0":
            try:
                lat, lon = (int(float(v) // 100) + float(v) % 100 / 60 for v in (cells[2], cells[4]))
                height = sum(float(v or 0) for v in (cells[9], cells[11]))
            except (ValueError, OverflowError):
                continue
            found.append((trace, -lon if cells[5] == "W" else lon, -lat if cells[3] == "S" else lat, height))
    return _fixes(found, count, notes)


def _cor(path: Path | None, count: int, notes: list[str]) -> FloatArray:
    """Read positions of traces: trace (from 1), date, time, latitude, N or S, longitude, E or W, height."""
    found: list[tuple[float, ...]] = []
    for line in [] if path is None else _text(path).splitlines():
        cells = line.replace(";", " ").split()
        try:
            trace, lat, lon, height = (float(cells[k]) for k in (0, 3, 5, 7))
        except (ValueError, IndexError):
            continue
        found.append((trace - 1, -lon if cells[6] == "W" else lon, -lat if cells[4] == "S" else lat, height))
    return _fixes(found, count, notes)


def _fixes(found: list[tuple[float, ...]], count: int, notes: list[str]) -> FloatArray:
    """Keep fixes that lie on the Earth and on a trace of the file, the first of each trace."""
    table = np.array(found, dtype=np.float64).reshape(-1, 4)
    good = np.isfinite(table).all(axis=1) & (np.abs(table[:, 1]) <= 180) & (np.abs(table[:, 2]) <= 90)
    good &= (table[:, 0] >= 0) & (table[:, 0] < count) & (np.abs(table[:, 3]) < 1e5)
    if not good.all():
        notes.append(
            f"{np.count_nonzero(~good)} of {len(table)} positions left out: no place on the Earth, or no trace"
        )
    kept = table[good]
    return kept[np.unique(kept[:, 0], return_index=True)[1]]


READERS: dict[str, tuple[str, Callable[[Path, int], dict[str, Any]]]] = {
    ".dt1": ("Sensors & Software DT1", _read_dt1),
    ".dzt": ("GSSI DZT", _read_dzt),
    ".rd3": ("MALÅ RD3", _read_mala),
    ".rd7": ("MALÅ RD7", _read_mala),
    ".iprb": ("ImpulseRadar IPRB", _read_impulse),
    ".dt": ("IDS DT", _read_ids),
    ".sgy": ("SEG-Y", _read_segy),
    ".segy": ("SEG-Y", _read_segy),
}
"""What each ending is, and how it is read."""
_HEADERS = {".hd": ".dt1", ".rad": ".rd3 or .rd7", ".iprh": ".iprb"}
