"""OpenGPR (.ogpr), the open format of IDS GeoRadar.

It is a preamble, a JSON descriptor, and blocks of binary data. The preamble has three lines:
``ogpr``, a check sum of 32 hexadecimal digits and a length of eight; the descriptor follows and
states where each block lies. The block "Radar Volume" holds slices x channels x samples,
little-endian. The block "Sample Geolocations" holds easting, northing and elevation, of every
sample or of every trace. In version 2 it holds a record of every slice: its number, and of every
channel easting, northing, depth and elevation of the first sample and of the last (archeogpr,
``src/archaeogpr/io/ogpr_reader.py``, https://github.com/bruhnioli/archeogpr, which found this in a
recorder's file). Other blocks are noted and not read.
"""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from flgpr.door import open_named
from flgpr.json_text import parse_json
from flgpr.types import Entries, FloatArray, IndexArray, Notes
from flgpr_exchange.gpr.along_line import between_neighbours, way_along
from flgpr_exchange.gpr.parts import (
    INTERVALS,
    MOST_SAMPLES,
    NANOSECOND,
    exact_floats,
    first_bytes,
    note_count,
)
from flgpr_exchange.gpr.positions import Fixes

_Shape = tuple[int, int, int]
"""Slices, channels and samples of a volume."""
_PREAMBLE = 47  # bytes: 5 + 33 + 9
_LARGEST_DESCRIPTOR = 4 * 2**20
_MOST_CHANNELS = 256
_FARTHEST = 1e8  # m, of a coordinate
_POINT = 24  # bytes of easting, northing and elevation
_VERSIONS = (1, 2)  # major numbers, whose layouts are known
_SLICE_NUMBER = 8  # bytes at the begin of a record of version 2
_CHANNEL_POINTS = 64  # bytes of a channel in it: eight numbers
_TYPES = {2: "<i2", 4: "<f4"}  # by the bytes of a sample: counts, or floats
_VOLUME = "Radar Volume"
_GEOLOCATIONS = "Sample Geolocations"


class _PointLayout(NamedTuple):
    """Where the first position of every slice lies."""

    start: int  # bytes from the begin of the slice
    columns: list[int]  # of easting, northing and elevation, in numbers of 8 bytes


def read_ogpr(path: Path, limit: int, notes: Notes) -> Entries:
    """Read an OpenGPR file.

    Parameters, entries and errors are those of :func:`flgpr_exchange.gpr.dt1.read_dt1`.
    """
    descriptor = _descriptor_of(path)
    main = _table(descriptor, "mainDescriptor")
    samples = _number(main, "samplesCount", 2, MOST_SAMPLES, int)
    channels = _number(main, "channelsCount", 1, _MOST_CHANNELS, int)
    slices = _number(main, "slicesCount", 1, 2**31, int)
    shape = (slices, channels, samples)

    blocks: dict[str, Entries] = {}
    repeated: list[str] = []
    for block in descriptor.get("dataBlockDescriptors") or []:
        if isinstance(block, dict):
            kind = str(block.get("type"))
            if kind in blocks:
                repeated.append(kind)
            blocks.setdefault(kind, block)
    if _VOLUME not in blocks:
        raise ValueError(
            f"its descriptor must name a block {_VOLUME}, got {', '.join(blocks) or 'none'}"
        )
    version = descriptor.get("version")
    major = version.get("major") if isinstance(version, dict) else version
    if version is not None and major not in _VERSIONS:
        stated = version if major is None else major
        notes.append(
            f"its version is {str(stated)[:40]!r}, which is not known: "
            f"it is read as version {_VERSIONS[-1]}"
        )
    volume = blocks[_VOLUME]
    traces = _radar_volume(path, volume, shape, limit, notes)

    radar = _table(volume, "radar")
    shortest, longest = (edge / NANOSECOND for edge in INTERVALS)
    interval = _number(radar, "samplingTime_ns", shortest, longest) * NANOSECOND
    step = _number(radar, "samplingStep_m", 0.0, 1e3)
    notes.append("the descriptor tells no time zero: it is put at the first sample")

    positions, fixes = _geolocations(path, blocks.get(_GEOLOCATIONS), shape, notes)
    unknown_blocks = sorted(set(blocks) - {_VOLUME, _GEOLOCATIONS})
    if unknown_blocks:
        notes.append(f"blocks found and not understood: {', '.join(unknown_blocks)}")
    kinds = ", ".join(sorted(set(repeated)))
    note_count(notes, len(repeated), f"further blocks of {kinds} not read")
    frequency = _frequency_of(radar, notes)

    distance: FloatArray | None = None
    if positions is not None:
        distance = way_along(positions, "of the first channel", notes)
    elif step > 0:
        distance = step * np.arange(slices, dtype=np.float64)
        notes.append(f"traces are put at equal steps of {step:g} m, by samplingStep_m")

    metadata = main.get("metadata")
    name = metadata.get("swathName") if isinstance(metadata, dict) else None
    return {
        "traces": traces,
        "delay": np.arange(samples) * interval,
        "distance": distance,
        "fixes": fixes,
        "frequencies": (frequency,) * channels,
        "title": str(name) if name else "",
    }


def _frequency_of(radar: Entries, notes: Notes) -> float | None:
    """Return the antenna's nominal frequency, Hz, if it is stated; note entries that are not used.

    ``radar`` is the descriptor of the volume.
    """
    # The second name is how recorders spell it.
    megahertz = radar.get("frequency_MHz", radar.get("fequency_MHz"))
    frequency = None
    if isinstance(megahertz, int | float) and 1 <= megahertz <= 1e5:
        frequency = float(megahertz) * 1e6
    else:
        notes.append("the descriptor tells no frequency of the antenna: it is unknown")
    polarization = radar.get("polarization")
    if polarization is not None:
        notes.append(f"polarization {str(polarization)[:40]!r} of the descriptor is not used")
    speed = radar.get("propagationVelocity_mPerSec")
    if isinstance(speed, int | float):
        notes.append(f"the propagation velocity {speed:g} m/s of the descriptor is not used")
    return frequency


def _descriptor_of(path: Path) -> Entries:
    """Return the descriptor, JSON, behind the preamble."""
    raw = first_bytes(path, _PREAMBLE + _LARGEST_DESCRIPTOR)
    if not raw.startswith(b"ogpr\n"):
        raise ValueError(f"it must begin with the line ogpr, got {raw[:8]!r}")
    # In Latin-1 every byte is a letter, so that the end of the JSON is found in bytes.
    text = raw[_PREAMBLE:].decode("latin-1")
    content = text.lstrip()
    try:
        _, length = json.JSONDecoder().raw_decode(content)
    except ValueError as error:
        raise ValueError(
            f"its descriptor must be JSON of at most {_LARGEST_DESCRIPTOR} bytes: {error}"
        ) from None
    except RecursionError:
        raise ValueError("its descriptor must not be nested so deeply") from None
    begin = _PREAMBLE + len(text) - len(content)
    descriptor = parse_json(raw[begin : begin + length])
    if not isinstance(descriptor, dict):
        raise ValueError("its descriptor must be a JSON object")
    return descriptor


def _table(entries: Entries, name: str) -> Entries:
    """Return an entry that must be an object."""
    table = entries.get(name)
    if not isinstance(table, dict):
        raise ValueError(f"its descriptor must hold the object {name}")
    return table


def _number(entries: Entries, name: str, low: float, high: float, kind: type = float) -> Any:
    """Return an entry that must be a number of a kind, int or float, within bounds."""
    value: Any = entries.get(name)
    is_number = isinstance(value, int | kind) and not isinstance(value, bool)
    if not is_number or not low <= value <= high:
        words = "whole number" if kind is int else "number"
        low_text, high_text = (f"{edge:g}" if kind is float else edge for edge in (low, high))
        raise ValueError(f"{name} must be a {words} from {low_text} to {high_text}, got {value!r}")
    return kind(value)


def _block(path: Path, block: Entries) -> tuple[int, int]:
    """Return where a block begins and how many bytes it has; it must lie in the file."""
    size = path.stat().st_size
    offset = _number(block, "byteOffset", 0, 2**62, int)
    length = _number(block, "byteSize", 1, 2**62, int)
    if offset + length > size:
        raise ValueError(
            f"block {block.get('type')} must end within the file's {size} bytes, "
            f"got {offset + length}"
        )
    return offset, length


def _radar_volume(
    path: Path, block: Entries, shape: _Shape, limit: int, notes: Notes
) -> NDArray[np.floating[Any]]:
    """Read the traces (slice, channel, sample)."""
    offset, length = _block(path, block)
    count = math.prod(shape)
    width, rest = divmod(length, count)
    if rest or width not in _TYPES:
        raise ValueError(
            f"block {_VOLUME} must hold {' x '.join(map(str, shape))} samples of 2 or 4 bytes, "
            f"got {length} bytes"
        )
    needed = 4 * count * 2  # as 32 bit floating point, and a copy of it
    if needed > limit:
        raise ValueError(
            f"it must fit into {limit / 1e9:.3g} GB, its traces take {needed / 1e9:.3g} GB"
        )
    stated = str(block.get("valueType", "")).lower()
    if stated and stated.startswith("float") != (width == 4):
        notes.append(
            f"valueType {stated!r} does not fit samples of {width} bytes: "
            f"they are read as {_TYPES[width]}"
        )
    values = np.frombuffer(first_bytes(path, length, offset), dtype=_TYPES[width])
    return exact_floats(values.reshape(shape), notes)


def _geolocations(
    path: Path, block: Entries | None, shape: _Shape, notes: Notes
) -> tuple[FloatArray | None, Fixes]:
    """Return the positions (trace, 3) of the first channel, m, and its fixes.

    There are no fixes if the reference system is not known.
    """
    if block is None:
        return None, Fixes()
    offset, length = _block(path, block)
    slices, channels, _ = shape
    layout = _point_layout(length, shape)
    if layout is None:
        notes.append(
            f"{_GEOLOCATIONS} of {length} bytes found, not understood: positions are not read"
        )
        return None, Fixes()

    # The first position of every slice: its first channel's first sample's.
    numbers = np.empty((slices, layout.columns[-1] + 1))
    with open_named(path) as file:
        for number in range(slices):
            file.seek(offset + number * (length // slices) + layout.start)
            numbers[number] = np.frombuffer(file.read(8 * numbers.shape[1]), "<f8")
    positions = numbers[:, layout.columns]
    usable = np.asarray((np.abs(positions) <= _FARTHEST).all(axis=1))
    unusable = np.count_nonzero(~usable)
    if slices - unusable < 2 or not np.ptp(positions[usable, :2], axis=0).any():
        notes.append(
            f"{unusable} of {slices} {_GEOLOCATIONS} are no places, and the others are too few or "
            "all at one place: positions are not read"
        )
        return None, Fixes()
    text = f"of {slices} {_GEOLOCATIONS} are no places: put between their neighbours"
    if note_count(notes, unusable, text):
        positions = between_neighbours(positions, usable)
    if channels > 1 and length > _POINT * slices:
        notes.append(
            f"{_GEOLOCATIONS} of {channels - 1} further channels are not used: "
            "channel_x places them"
        )
    return positions, _fixes(positions, np.flatnonzero(usable), block, notes)


def _point_layout(length: int, shape: _Shape) -> _PointLayout | None:
    """Return where positions lie in a block of so many bytes; None if that is not known."""
    slices, channels, samples = shape
    if length == slices * (_SLICE_NUMBER + _CHANNEL_POINTS * channels):
        return _PointLayout(_SLICE_NUMBER, [0, 1, 3])
    per_slice = _POINT * slices
    if length in {per_slice * channels * samples, per_slice * channels, per_slice}:
        return _PointLayout(0, [0, 1, 2])
    return None


def _fixes(positions: FloatArray, known: IndexArray, block: Entries, notes: Notes) -> Fixes:
    """Return the fixes of the traces whose positions (trace, 3) are ``known``.

    There are none if their reference system is not known.
    """
    system = block.get("srs")
    code = system.get("value") if isinstance(system, dict) else None
    if not isinstance(code, int):
        notes.append(f"{_GEOLOCATIONS} name no reference system: they give the distance alone")
        return Fixes()
    from flgpr.geo.geodesy import lonlat_of  # geodesy takes its time to load, and few lines need it

    try:
        lonlat = lonlat_of(positions[known, :2], f"EPSG:{code}")
    except ValueError as error:
        notes.append(
            f"{_GEOLOCATIONS} in EPSG:{code} are no places there, and give the distance alone: "
            f"{error}"
        )
        return Fixes()
    notes.append(f"heights are taken as ellipsoidal: EPSG:{code} does not tell")
    return Fixes(np.column_stack([known.astype(np.float64), lonlat, positions[known, 2]]))
