"""OpenGPR (.ogpr), the open format of IDS GeoRadar: a preamble, a JSON descriptor, and blocks of binary data.

The preamble has three lines: ``ogpr``, a check sum of 32 hexadecimal digits and a length of eight; the descriptor
follows and tells where each block lies. The block "Radar Volume" holds slices x channels x samples, little-endian. The
block "Sample Geolocations" holds easting, northing and elevation, of every sample or of every trace. In version 2 it
holds a record of every slice: its number, and of every channel easting, northing, depth and elevation of the first
sample and of the last (archeogpr, ``src/archaeogpr/io/ogpr_reader.py``, https://github.com/bruhnioli/archeogpr, which
found this in a recorder's file). Other blocks are told and not read.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flgpr.door import open_named, parse_json
from flgpr.formats.gpr_parts import exact_floats, first_bytes, measured_places

FloatArray = NDArray[np.float64]
_PREAMBLE = 47  # bytes: 5 + 33 + 9
_LARGEST_DESCRIPTOR = 4 * 2**20
_MOST_CHANNELS = 256
_INTERVALS = (1e-13, 1e-6)  # s
_FARTHEST = 1e8  # m, of a coordinate
_TYPES = {2: "<i2", 4: "<f4"}  # by the bytes of a sample: counts, or floats
_VERSIONS = (1, 2)  # major numbers, whose layouts are known
_SLICE_NUMBER = 8  # bytes at the begin of a record of version 2
_CHANNEL_PLACES = 64  # bytes of a channel in it: eight numbers


def read_ogpr(path: Path, limit: int) -> dict[str, Any]:
    """Read an OpenGPR file: the entries of a :class:`flgpr.formats.gpr_files.GprSection`.

    What contradicts itself or the file's size, or takes more than ``limit`` bytes, is a ValueError.
    """
    descriptor = _descriptor_of(path)
    main = _table(descriptor, "mainDescriptor")
    samples = _count(main, "samplesCount", 2, 2**20)
    channels = _count(main, "channelsCount", 1, _MOST_CHANNELS)
    slices = _count(main, "slicesCount", 1, 2**31)
    blocks = descriptor.get("dataBlockDescriptors")
    named: dict[str, dict[str, Any]] = {}
    further: list[str] = []  # blocks of a type that is there already
    for block in blocks or []:
        if not isinstance(block, dict):
            continue
        kind = str(block.get("type"))
        if kind in named:
            further.append(kind)
        named.setdefault(kind, block)
    if "Radar Volume" not in named:
        raise ValueError(
            f"its descriptor must name a block Radar Volume, got {', '.join(named) or 'none'}"
        )
    notes: list[str] = []
    _note_version(descriptor, notes)
    volume = named["Radar Volume"]
    values = _radar_volume(path, volume, (slices, channels, samples), limit, notes)
    radar = _table(volume, "radar")
    interval = _number(radar, "samplingTime_ns", _INTERVALS[0] * 1e9, _INTERVALS[1] * 1e9) * 1e-9
    step = _number(radar, "samplingStep_m", 0.0, 1e3)
    megahertz = radar.get(
        "frequency_MHz", radar.get("fequency_MHz")
    )  # the second is how recorders spell it
    frequency = None
    if isinstance(megahertz, int | float) and 1 <= megahertz <= 1e5:
        frequency = float(megahertz) * 1e6
    notes.append("the descriptor tells no time zero: it is put at the first sample")
    place, fixes = _places(
        path, named.get("Sample Geolocations"), (slices, channels, samples), notes
    )
    others = sorted(set(named) - {"Radar Volume", "Sample Geolocations"})
    if others:
        notes.append(f"blocks found and not understood: {', '.join(others)}")
    if further:
        notes.append(f"{len(further)} further blocks of {', '.join(sorted(set(further)))} not read")
    _note_unused_entries(radar, frequency, notes)
    distance: FloatArray | None = None
    if place is not None:
        way = np.append(0.0, np.hypot(*np.diff(place[:, :2], axis=0).T).cumsum())
        notes.append(
            "the distance along the line is that of the traces' coordinates, of the first channel"
        )
        distance = measured_places(
            way, None, "distances from trace to trace", "the descriptor", notes
        )
    elif step > 0:
        distance = step * np.arange(slices, dtype=np.float64)
        notes.append(f"traces are put at equal steps of {step:g} m, by samplingStep_m")
    metadata = main.get("metadata")
    name = metadata.get("swathName") if isinstance(metadata, dict) else None
    return {
        "traces": values,
        "delay": np.arange(samples) * interval,
        "distance": distance,
        "fixes": fixes,
        "frequencies": (frequency,) * channels,
        "title": str(name) if name else path.stem,
        "history": tuple(notes),
    }


def _note_version(descriptor: dict[str, Any], notes: list[str]) -> None:
    """Tell if the file declares a version that is not known."""
    version = descriptor.get("version")
    major = version.get("major") if isinstance(version, dict) else version
    if version is not None and major not in _VERSIONS:
        told = version if major is None else major
        notes.append(
            f"its version is {str(told)[:40]!r}, which is not known: it is read as version {_VERSIONS[-1]}"
        )


def _note_unused_entries(radar: dict[str, Any], frequency: float | None, notes: list[str]) -> None:
    """Tell what the descriptor of the radar tells and is not used, and whether its frequency is missing."""
    if frequency is None:
        notes.append("the descriptor tells no frequency of the antenna: it is unknown")
    polarization = radar.get("polarization")
    if polarization is not None:
        notes.append(f"polarization {str(polarization)[:40]!r} of the descriptor is not used")
    speed = radar.get("propagationVelocity_mPerSec")
    if isinstance(speed, int | float):
        notes.append(f"the propagation velocity {speed:g} m/s of the descriptor is not used")


def _descriptor_of(path: Path) -> dict[str, Any]:
    raw = first_bytes(path, _PREAMBLE + _LARGEST_DESCRIPTOR)
    if not raw.startswith(b"ogpr\n"):
        raise ValueError(f"it must begin with the line ogpr, got {raw[:8]!r}")
    text = raw[_PREAMBLE:].decode(
        "latin-1"
    )  # every byte is a letter, so that the end of the JSON is found
    try:
        _, end = json.JSONDecoder().raw_decode(text.lstrip())
    except ValueError as error:
        raise ValueError(
            f"its descriptor must be JSON of at most {_LARGEST_DESCRIPTOR} bytes: {error}"
        ) from None
    except RecursionError:
        raise ValueError("its descriptor must not be nested so deeply") from None
    begin = len(text) - len(text.lstrip())
    found = parse_json(raw[_PREAMBLE + begin : _PREAMBLE + begin + end])
    if not isinstance(found, dict):
        raise ValueError("its descriptor must be a JSON object")
    return found


def _table(entries: dict[str, Any], name: str) -> dict[str, Any]:
    found = entries.get(name)
    if not isinstance(found, dict):
        raise ValueError(f"its descriptor must hold the object {name}")
    return found


def _count(entries: dict[str, Any], name: str, low: int, high: int) -> int:
    value = entries.get(name)
    if not isinstance(value, int) or isinstance(value, bool) or not low <= value <= high:
        raise ValueError(f"{name} must be a whole number from {low} to {high}, got {value!r}")
    return value


def _number(entries: dict[str, Any], name: str, low: float, high: float) -> float:
    value = entries.get(name)
    if not isinstance(value, int | float) or isinstance(value, bool) or not low <= value <= high:
        raise ValueError(f"{name} must be a number from {low:g} to {high:g}, got {value!r}")
    return float(value)


def _block(path: Path, block: dict[str, Any]) -> tuple[int, int]:
    """Return where a block begins and how many bytes it has; it must lie in the file."""
    size = path.stat().st_size
    offset = _count(block, "byteOffset", 0, 2**62)
    length = _count(block, "byteSize", 1, 2**62)
    if offset + length > size:
        raise ValueError(
            f"block {block.get('type')} must end within the file's {size} bytes, got {offset + length}"
        )
    return offset, length


def _radar_volume(
    path: Path, block: dict[str, Any], shape: tuple[int, int, int], limit: int, notes: list[str]
) -> NDArray[np.floating[Any]]:
    offset, length = _block(path, block)
    count = int(np.prod([float(one) for one in shape]))
    width, rest = divmod(length, count)
    if rest or width not in _TYPES:
        raise ValueError(
            f"block Radar Volume must hold {' x '.join(map(str, shape))} samples of 2 or 4 bytes, got {length} bytes"
        )
    if 4 * count * 2 > limit:
        raise ValueError(
            f"it must fit into {limit / 1e9:.3g} GB, its traces take {8 * count / 1e9:.3g} GB"
        )
    stated = str(block.get("valueType", "")).lower()
    if stated and stated.startswith("float") != (width == 4):
        notes.append(
            f"valueType {stated!r} does not fit samples of {width} bytes: they are read as {_TYPES[width]}"
        )
    with open_named(path) as file:
        file.seek(offset)
        values = np.frombuffer(file.read(length), dtype=_TYPES[width]).reshape(shape)
    return exact_floats(values, notes)


def _places(
    path: Path, block: dict[str, Any] | None, shape: tuple[int, int, int], notes: list[str]
) -> tuple[FloatArray | None, FloatArray]:
    """Read the places (trace, 3) of the first channel, m, and its fixes (fix, 4) if the system is known."""
    none = np.empty((0, 4))
    if block is None:
        return None, none
    offset, length = _block(path, block)
    slices, channels, samples = shape
    by_slice = slices * (_SLICE_NUMBER + _CHANNEL_PLACES * channels)
    if length == by_slice:
        start = _SLICE_NUMBER
        columns = [0, 1, 3]
    elif length in {24 * slices * channels * samples, 24 * slices * channels, 24 * slices}:
        start = 0
        columns = [0, 1, 2]
    else:
        notes.append(
            f"Sample Geolocations of {length} bytes found, not understood: positions are not read"
        )
        return None, none
    # The first place of a slice is that of its first channel's first sample.
    stride = length // slices
    width = 8 * (columns[-1] + 1)
    raw = bytearray()
    with open_named(path) as file:
        for number in range(slices):
            file.seek(offset + number * stride + start)
            raw += file.read(width)
    numbers = np.frombuffer(bytes(raw), dtype="<f8").reshape(slices, -1)
    place = numbers[:, columns].astype(np.float64)
    usable = np.isfinite(place).all(axis=1) & (np.abs(np.nan_to_num(place)) <= _FARTHEST).all(
        axis=1
    )
    known = np.flatnonzero(usable)
    if known.size < 2 or not np.ptp(place[usable, :2], axis=0).any():
        notes.append(
            f"{slices - known.size} of {slices} Sample Geolocations are no places, and the others are too few or "
            "all at one place: positions are not read"
        )
        return None, none
    if known.size < slices:
        notes.append(
            f"{slices - known.size} of {slices} Sample Geolocations are no places: put between their neighbours"
        )
        trace = np.arange(slices)
        for column in range(3):
            place[:, column] = np.interp(trace, known, place[usable, column])
    if channels > 1 and length > 24 * slices:
        notes.append(
            f"Sample Geolocations of {channels - 1} further channels are not used: --channel-x places them"
        )
    return place, _fixes(place, known, block, notes)


def _fixes(
    place: FloatArray, known: NDArray[np.intp], block: dict[str, Any], notes: list[str]
) -> FloatArray:
    """Return the fixes (fix, 4) of the traces whose places (trace, 3) are ``known``; none if their system is not."""
    none = np.empty((0, 4))
    system = block.get("srs")
    code = system.get("value") if isinstance(system, dict) else None
    if not isinstance(code, int):
        notes.append("Sample Geolocations name no reference system: they give the distance alone")
        return none
    from flgpr.geo.anchor import lonlat_of  # geodesy takes its time to load, and few lines need it

    try:
        lonlat = lonlat_of(place[known, :2], f"EPSG:{code}")
    except ValueError as error:
        notes.append(
            f"Sample Geolocations in EPSG:{code} are no places there, and give the distance alone: {error}"
        )
        return none
    notes.append(f"heights are taken as ellipsoidal: EPSG:{code} does not tell")
    return np.column_stack([known.astype(np.float64), lonlat, place[known, 2]])
