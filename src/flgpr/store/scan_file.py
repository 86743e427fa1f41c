"""Scans as a radar hands them over while it drives: one frame per scan, in a file of its own or on a local socket.

A frame is, in little-endian order: the 8 bytes ``FLGPRSC1``; the length of the header (4 bytes) and of the payload (8
bytes); the header, a JSON object in UTF-8; the payload; the CRC-32 of all that came before (4 bytes). The header's
``kind`` is "scan", "run" or "end". A scan's payload are the complex64 samples (polarization, pair, frequency).
"""

from __future__ import annotations

import json
import math
import struct
import sys
import zlib
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any, TypeGuard

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike, NDArray

from flgpr.door import DoorError, Folder, parse_json
from flgpr.model import check_frequency, make_run
from flgpr.store.files import canonical_json, sha256, write_whole

MAGIC = b"FLGPRSC1"
RUN_FORMAT = "flgpr-live-run"
RUN_VERSION = 1
RUN_FILE = "run.json"
END_FILE = "end.json"
SCAN_SUFFIX = ".scan"
_HEAD = struct.Struct("<8sIQ")
_LONGEST_HEADER = 2**22
_LARGEST_PAYLOAD = 2**32
_LARGEST_SCAN = 2**53
# of an antenna from the vehicle, m; of a tone, Hz
_FARTHEST = 1e3
_HIGHEST = 1e12


class ScanFileError(ValueError):
    """A frame or a description breaks the format."""


class TruncatedFrameError(ScanFileError):
    """A frame ends before the length it states: damaged, or still being written."""


@dataclass(frozen=True)
class Frame:
    """A frame, "scan", "run" or "end", checked against its checksum."""

    kind: str
    header: dict[str, Any]
    payload: bytes


@dataclass(frozen=True)
class RunDescription:
    """What all scans of a run have in common."""

    frequency: NDArray[np.float64]  #: tones, Hz
    polarization: list[str]
    #: tx_position, rx_position: (pair, 3): antenna positions of each pair in the vehicle frame, m
    tx_position: NDArray[np.float64]
    rx_position: NDArray[np.float64]
    title: str = "run"  #: what to call the run
    attrs: dict[str, Any] = field(
        default_factory=dict
    )  #: more to remember, such as ``georeference``

    @property
    def shape(self) -> tuple[int, int, int]:
        """Samples of a scan: polarizations, pairs, tones."""
        return len(self.polarization), len(self.tx_position), self.frequency.size

    @cached_property
    def run_id(self) -> str:
        """Sixteen hexadecimal digits that scans of this run carry."""
        return sha256(canonical_json(self.as_json()))[:16]

    def as_json(self) -> dict[str, Any]:
        """Give the description as it is written."""
        return {
            "format": RUN_FORMAT,
            "version": RUN_VERSION,
            "title": self.title,
            "polarization": self.polarization,
            "frequency_hz": self.frequency.tolist(),
            "tx_m": self.tx_position.tolist(),
            "rx_m": self.rx_position.tolist(),
            "attrs": self.attrs,
        }


@dataclass(frozen=True)
class Scan:
    """One scan as it arrived."""

    number: int  #: its number in the run, from 0
    time: float  #: time of the scan, s; NaN where unknown
    #: x, y, z (m), heading, pitch, roll (rad) in the lane frame; None where the vehicle did not know it
    pose: NDArray[np.float64] | None
    signal: NDArray[
        np.complex64
    ]  #: (polarization, pair, frequency): received field over transmitted field


def describe_for_live(run: xr.Dataset) -> RunDescription:
    """Describe a stored run as a radar would before its first scan."""
    attrs = {name: run.attrs[name] for name in ("georeference", "source") if name in run.attrs}
    return RunDescription(
        np.asarray(run["frequency"].values, dtype=np.float64),
        [str(label) for label in run["polarization"].values],
        np.asarray(run["tx_position"].values, dtype=np.float64),
        np.asarray(run["rx_position"].values, dtype=np.float64),
        str(run.attrs.get("title", "run")),
        attrs,
    )


def parse_description(value: Any) -> RunDescription:
    """Check a description from JSON by :func:`flgpr.model.make_run`'s rules; what breaks one is a ScanFileError."""
    if not isinstance(value, dict):
        raise ScanFileError(f"run description must be a JSON object, got {type(value).__name__}")
    if (value.get("format"), value.get("version")) != (RUN_FORMAT, RUN_VERSION):
        got = f"{value.get('format')!r} {value.get('version')!r}"
        raise ScanFileError(
            f"run description must have format {RUN_FORMAT} version {RUN_VERSION}, got {got}"
        )
    missing = [
        name for name in ("polarization", "frequency_hz", "tx_m", "rx_m") if name not in value
    ]
    if missing:
        raise ScanFileError(f"run description must hold {', '.join(missing)}, which it does not")
    try:
        tx, rx = (
            np.asarray(value[name], dtype=np.float64).reshape(-1, 3) for name in ("tx_m", "rx_m")
        )
        tones = np.asarray(value["frequency_hz"], dtype=np.float64)
        for name, numbers, most in (
            ("tx_m", tx, _FARTHEST),
            ("rx_m", rx, _FARTHEST),
            ("frequency_hz", tones, _HIGHEST),
        ):
            if numbers.size and not np.abs(numbers).max() <= most:
                raise ScanFileError(
                    f"{name} must hold numbers up to {most:g}, got {np.abs(numbers).max():g}"
                )
        attrs = dict(value.get("attrs") or {})
        labels = [str(one) for one in value["polarization"]]
        found = RunDescription(tones, labels, tx, rx, str(value.get("title", "run")), attrs)
        check_frequency(tones)
        make_run(
            np.zeros((1, *found.shape[:2], 1), np.complex64),
            tones[:1],
            labels,
            tx,
            rx,
            np.zeros((1, 6)),
        )
        canonical_json(attrs)
    except (ValueError, TypeError, OverflowError, RecursionError) as error:
        raise ScanFileError(f"run description: {error}") from None
    return found


def as_run(description: RunDescription, scan: Scan) -> xr.Dataset:
    """Make the run of one scan, as :func:`flgpr.model.make_run` makes it; without a pose that is a ValueError."""
    if scan.pose is None:
        raise ValueError(f"scan {scan.number} must have a pose, got none")
    one = description
    array = (one.polarization, one.tx_position, one.rx_position)
    return make_run(scan.signal[None], one.frequency, *array, scan.pose[None])


def encode_frame(kind: str, header: dict[str, Any], payload: bytes = b"") -> bytes:
    """Write a frame, "scan", "run" or "end", with a header of JSON values and what follows it."""
    text = canonical_json({"kind": kind, **header})
    body = _HEAD.pack(MAGIC, len(text), len(payload)) + text + payload
    return body + struct.pack("<I", zlib.crc32(body))


def encode_scan(
    number: int,
    signal: ArrayLike,
    pose: ArrayLike | None,
    time: float = math.nan,
    run_id: str | None = None,
) -> bytes:
    """Write a scan as a frame: field (polarization, pair, frequency), pose or None, time or NaN, and its run's id."""
    header: dict[str, Any] = {
        "scan": int(number),
        "time": float(time) if math.isfinite(time) else None,
        "pose": None
        if pose is None
        else [float(value) for value in np.asarray(pose, dtype=np.float64)],
    }
    if run_id is not None:
        header["run"] = run_id
    return encode_frame("scan", header, np.asarray(signal).astype("<c8").tobytes())


def frame_size(head: bytes) -> int:
    """Tell how many bytes a frame has, from its first :func:`head_size` or more; too few are a TruncatedFrameError."""
    if len(head) < _HEAD.size:
        raise TruncatedFrameError(f"frame must have at least {_HEAD.size} bytes, got {len(head)}")
    magic, text, payload = _HEAD.unpack(head[: _HEAD.size])
    if magic != MAGIC:
        raise ScanFileError(f"frame must begin with {MAGIC.decode()}, got {magic!r}")
    if text > _LONGEST_HEADER or payload > _LARGEST_PAYLOAD:
        raise ScanFileError(
            f"frame states a header of {text} and a payload of {payload} bytes, which no scan has"
        )
    return int(_HEAD.size + text + payload + 4)


def head_size() -> int:
    """Tell how many bytes tell a frame's length."""
    return _HEAD.size


def decode_frame(data: bytes) -> Frame:
    """Read a whole frame; one that ends early is a TruncatedFrameError, a damaged or strange one a ScanFileError."""
    size = frame_size(data)
    if len(data) < size:
        raise TruncatedFrameError(f"frame must have {size} bytes, got {len(data)}")
    if len(data) > size:
        raise ScanFileError(f"frame must end after {size} bytes, got {len(data)}")
    if zlib.crc32(memoryview(data)[:-4]) != struct.unpack("<I", data[-4:])[0]:
        raise ScanFileError("frame has a wrong checksum: its bytes are not those that were written")
    text = _HEAD.unpack(data[: _HEAD.size])[1]
    try:
        header = parse_json(data[_HEAD.size : _HEAD.size + text])
    except ValueError:
        raise ScanFileError("frame must have a header in JSON, got something else") from None
    if not isinstance(header, dict) or header.get("kind") not in ("scan", "run", "end"):
        raise ScanFileError("frame must have a header with the kind scan, run or end, got another")
    return Frame(header["kind"], header, data[_HEAD.size + text : -4])


def scan_of(frame: Frame, description: RunDescription) -> Scan:
    """Take the scan out of a frame, or raise a ScanFileError; a pose that is not finite or out of bounds is none."""
    header = frame.header
    if frame.kind != "scan":
        raise ScanFileError(f"frame must be a scan, got the kind {frame.kind!r}")
    if header.get("run", description.run_id) != description.run_id:
        raise ScanFileError(
            f"scan belongs to another run: {header['run']!r}, not {description.run_id!r}"
        )
    number = header.get("scan")
    if not isinstance(number, int) or isinstance(number, bool) or not 0 <= number < _LARGEST_SCAN:
        raise ScanFileError(f"scan must have a number from 0, got {number!r}")
    expected = 8 * math.prod(description.shape)
    if len(frame.payload) != expected:
        raise ScanFileError(
            f"scan must have {expected} bytes of samples (polarization, pair, frequency) = {description.shape}, "
            f"got {len(frame.payload)}"
        )
    signal = np.frombuffer(frame.payload, "<c8").reshape(description.shape).astype(np.complex64)
    time = header.get("time")
    moment = float(time) if _is_finite(time) else math.nan
    return Scan(number, moment, _pose(header.get("pose")), signal)


def _is_finite(value: Any) -> TypeGuard[float]:
    """Tell a number from all else; JSON has integers that no float holds."""
    return isinstance(value, int | float) and abs(value) <= sys.float_info.max


def _pose(value: Any) -> NDArray[np.float64] | None:
    if not isinstance(value, list) or len(value) != 6:
        return None
    if not all(_is_finite(one) for one in value):
        return None
    pose = np.asarray(value, dtype=np.float64)
    sane = (
        abs(pose[3]) <= 2 * math.pi
        and (np.abs(pose[4:]) <= math.pi / 2).all()
        and (np.abs(pose[:3]) < 1e7).all()
    )
    return pose if sane else None


def write_description(description: RunDescription, folder: Path) -> None:
    """Write a run's description into a folder of scans."""
    write_whole(folder / RUN_FILE, json.dumps(description.as_json(), indent=1) + "\n")


def read_description(folder: Path) -> RunDescription | None:
    """Read a run's description from a folder of scans, None while there is none; a damaged one is a ScanFileError."""
    path = folder / RUN_FILE
    try:
        data = Folder(folder).read(RUN_FILE, _LONGEST_HEADER)
    except FileNotFoundError:
        return None
    except DoorError as error:
        raise ScanFileError(str(error)) from None
    try:
        content = parse_json(data)
    except ValueError:
        raise ScanFileError(f"{path}: not valid JSON") from None
    try:
        return parse_description(content)
    except ScanFileError as error:
        raise ScanFileError(f"{path}: {error}") from None


def scan_name(number: int) -> str:
    """Name of a scan's file, such as ``scan-000017.scan``."""
    return f"scan-{number:06d}{SCAN_SUFFIX}"
