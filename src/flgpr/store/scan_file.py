"""Scans as a radar sends them while it drives, one frame per scan, in files or on a local socket.

A frame is, in little-endian order:

- the 8 bytes ``FLGPRSC1``,
- the length of the header (4 bytes) and of the payload (8 bytes),
- the header, a JSON object in UTF-8, whose ``kind`` is "scan", "run" or "end",
- the payload; that of a scan is the complex64 samples (polarization, pair, frequency),
- the CRC-32 of all that came before (4 bytes).
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

from flgpr.door import DoorError, Folder
from flgpr.json_text import canonical_json, parse_json, sha256
from flgpr.model import check_frequency, make_run
from flgpr.model.printable import shortened
from flgpr.model.run import check_polarization, polarizations_of
from flgpr.store.files import write_whole
from flgpr.types import ArrayLike, ComplexArray, FloatArray, floats

MAGIC = b"FLGPRSC1"
RUN_FORMAT = "flgpr-live-run"
RUN_VERSION = 1
RUN_FILE = "run.json"
END_FILE = "end.json"
SCAN_SUFFIX = ".scan"
_HEAD = struct.Struct("<8sIQ")
_LONGEST_HEADER = 2**22
LARGEST_FRAME = 2**28
"""Most bytes that a frame of any run may have."""
_LARGEST_PAYLOAD = 2**32
_MOST_PAIRS = 2**16  # of transmitter and receiver, a hundred times as many as any array has
_LARGEST_SCAN = 2**53  # up to here every reader of JSON holds integers exactly
_FARTHEST = 1e3  # distance of an antenna from the vehicle, m
_HIGHEST = 1e12  # frequency of a tone, Hz
_FARTHEST_POSE = 1e7  # coordinate of the vehicle in the lane, m
_DESCRIPTION_KEYS = ("polarization", "frequency_hz", "tx_m", "rx_m")


class ScanFileError(ValueError):
    """A frame or a description breaks the format."""


class TruncatedFrameError(ScanFileError):
    """A frame ends before the length it states: damaged, or still being written."""


@dataclass(frozen=True)
class Frame:
    """A frame that was checked against its checksum."""

    kind: str  #: "scan", "run" or "end"
    header: dict[str, Any]  #: JSON values
    payload: bytes  #: what follows the header


@dataclass(frozen=True)
class RunDescription:
    """What all scans of a run have in common."""

    frequency: FloatArray  #: tones, Hz
    polarization: list[str]
    #: tx_position, rx_position: (pair, 3): antenna positions of each pair in the vehicle frame, m
    tx_position: FloatArray
    rx_position: FloatArray
    title: str = "run"  #: what to call the run
    #: further attributes of the run, such as ``georeference``
    attrs: dict[str, Any] = field(default_factory=dict)

    @property
    def shape(self) -> tuple[int, int, int]:
        """Numbers of polarizations, pairs and tones of a scan."""
        return len(self.polarization), len(self.tx_position), self.frequency.size

    @cached_property
    def run_id(self) -> str:
        """Sixteen hexadecimal digits that every scan of this run carries."""
        return sha256(canonical_json(self.as_json()))[:16]

    def as_json(self) -> dict[str, Any]:
        """Return the description as JSON values."""
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
    #: x, y, z (m), heading, pitch, roll (rad) in the lane frame; None where it is unknown or
    #: cannot be a pose
    pose: FloatArray | None
    #: (polarization, pair, frequency): received field over transmitted field
    signal: ComplexArray


def describe_for_live(run: xr.Dataset) -> RunDescription:
    """Return the description of a stored run that a radar would send before its first scan.

    Parameters
    ----------
    run : Dataset
        A run, see :func:`flgpr.model.make_run`.

    Returns
    -------
    RunDescription
        Antennas, tones, title, georeference and source of the run.
    """
    attrs = {name: run.attrs[name] for name in ("georeference", "source") if name in run.attrs}
    return RunDescription(
        floats(run["frequency"].values),
        polarizations_of(run),
        floats(run["tx_position"].values),
        floats(run["rx_position"].values),
        str(run.attrs.get("title", "run")),
        attrs,
    )


def stored_scan(run: xr.Dataset, number: int) -> Scan:
    """Return a scan of a stored run as if it arrived.

    Parameters
    ----------
    run : Dataset
        A run, see :func:`flgpr.model.make_run`.
    number : int
        Its number, from 0.

    Returns
    -------
    Scan
        The scan, in memory of its own.
    """
    row = run.isel(scan=number)
    return Scan(
        int(number),
        float(row["time"]),
        np.array(row["pose"].values, dtype=np.float64),
        np.array(row["signal"].values, dtype=np.complex64),
    )


def parse_description(value: Any) -> RunDescription:
    """Return the run description that JSON holds, checked by the rules of ``make_run``.

    Parameters
    ----------
    value : JSON value
        Result of :meth:`RunDescription.as_json`, from anywhere.

    Returns
    -------
    RunDescription
        The checked description.

    Raises
    ------
    ScanFileError
        If it is of another format or breaks a rule of :func:`flgpr.model.make_run`.
    """
    if not isinstance(value, dict):
        raise ScanFileError(f"run description must be a JSON object, got {type(value).__name__}")
    if (value.get("format"), value.get("version")) != (RUN_FORMAT, RUN_VERSION):
        got = f"{value.get('format')!r} {value.get('version')!r}"
        raise ScanFileError(
            f"run description must have format {RUN_FORMAT} version {RUN_VERSION}, got {got}"
        )
    missing = [name for name in _DESCRIPTION_KEYS if name not in value]
    if missing:
        raise ScanFileError(f"run description must hold {', '.join(missing)}, which it does not")
    try:
        tx = floats(value["tx_m"]).reshape(-1, 3)
        rx = floats(value["rx_m"]).reshape(-1, 3)
        tones = floats(value["frequency_hz"])
        _check_bound("tx_m", tx, _FARTHEST)
        _check_bound("rx_m", rx, _FARTHEST)
        _check_bound("frequency_hz", tones, _HIGHEST)
        counts = (len(value["polarization"]), len(tx), tones.size)
        size = 8 * math.prod(counts)
        if size > LARGEST_FRAME or len(tx) > _MOST_PAIRS:
            raise ScanFileError(
                f"it must describe scans of at most {_MOST_PAIRS} pairs and {LARGEST_FRAME} bytes, got "
                f"{counts[0]} polarizations of {counts[1]} pairs and {counts[2]} tones, {size} bytes"
            )
        attrs = dict(value.get("attrs") or {})
        labels = [str(label) for label in value["polarization"]]
        title = str(value.get("title", "run"))
        check_frequency(tones)
        check_polarization(labels)
        probe = np.zeros((1, *counts[:2], 1), np.complex64)
        make_run(probe, tones[:1], labels, tx, rx, np.zeros((1, 6)))
        canonical_json(attrs)
    except (ValueError, TypeError, OverflowError, RecursionError) as error:
        raise ScanFileError(f"run description: {error}") from None
    return RunDescription(tones, labels, tx, rx, title, attrs)


def _check_bound(name: str, numbers: FloatArray, most: float) -> None:
    """Refuse numbers of which one is NaN or larger than ``most``."""
    if not numbers.size:
        return
    largest = np.abs(numbers).max()
    if not largest <= most:
        raise ScanFileError(f"{name} must hold numbers up to {most:g}, got {largest:g}")


def as_run(description: RunDescription, scan: Scan) -> xr.Dataset:
    """Return the run of one scan.

    Parameters
    ----------
    description : RunDescription
        The run that the scan belongs to.
    scan : Scan
        The scan.

    Returns
    -------
    Dataset
        A run as of :func:`flgpr.model.make_run`.

    Raises
    ------
    ValueError
        If the scan has no pose.
    """
    if scan.pose is None:
        raise ValueError(f"scan {scan.number} must have a pose, got none")
    return make_run(
        scan.signal[None],
        description.frequency,
        description.polarization,
        description.tx_position,
        description.rx_position,
        scan.pose[None],
    )


def encode_frame(kind: str, header: dict[str, Any], payload: bytes = b"") -> bytes:
    """Return a frame.

    Parameters
    ----------
    kind : {"scan", "run", "end"}
        What the frame is.
    header : dict
        JSON values.
    payload : bytes
        What follows the header.

    Returns
    -------
    bytes
        The frame, which :func:`decode_frame` reads.
    """
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
    """Return a scan as a frame.

    Parameters
    ----------
    number : int
        Number of the scan in its run, from 0.
    signal : (polarization, pair, frequency) array_like of complex
        Received field over transmitted field.
    pose : (6,) array_like or None
        x, y, z, m, and heading, pitch, roll, rad; None where it is unknown.
    time : float
        Time of the scan, s; NaN where it is unknown.
    run_id : str, optional
        :attr:`RunDescription.run_id` of its run.

    Returns
    -------
    bytes
        The frame.
    """
    header: dict[str, Any] = {"scan": int(number), "time": None, "pose": None}
    if math.isfinite(time):
        header["time"] = float(time)
    if pose is not None:
        header["pose"] = [float(value) for value in floats(pose)]
    if run_id is not None:
        header["run"] = run_id
    return encode_frame("scan", header, np.asarray(signal).astype("<c8").tobytes())


def frame_size(head: bytes) -> int:
    """Return the number of bytes of a frame from its first bytes.

    Parameters
    ----------
    head : bytes
        The first :func:`head_size` bytes or more.

    Returns
    -------
    int
        The number.

    Raises
    ------
    TruncatedFrameError
        If there are fewer bytes.
    ScanFileError
        If the size is impossible.
    """
    if len(head) < _HEAD.size:
        raise TruncatedFrameError(f"frame must have at least {_HEAD.size} bytes, got {len(head)}")
    magic, header_size, payload_size = _HEAD.unpack(head[: _HEAD.size])
    if magic != MAGIC:
        raise ScanFileError(f"frame must begin with {MAGIC.decode()}, got {magic!r}")
    if header_size > _LONGEST_HEADER or payload_size > _LARGEST_PAYLOAD:
        raise ScanFileError(
            f"frame states a header of {header_size} and a payload of {payload_size} bytes, "
            "which no scan has"
        )
    return int(_HEAD.size + header_size + payload_size + 4)


def head_size() -> int:
    """Return the number of bytes at the beginning of a frame that state its size."""
    return _HEAD.size


def decode_frame(data: bytes) -> Frame:
    """Read a frame and check its checksum.

    Parameters
    ----------
    data : bytes
        The whole frame.

    Returns
    -------
    Frame
        Its kind, header and payload.

    Raises
    ------
    TruncatedFrameError
        If the frame ends early: it is damaged, or still being written.
    ScanFileError
        If it is damaged, or no frame.
    """
    size = frame_size(data)
    if len(data) < size:
        raise TruncatedFrameError(f"frame must have {size} bytes, got {len(data)}")
    if len(data) > size:
        raise ScanFileError(f"frame must end after {size} bytes, got {len(data)}")
    if zlib.crc32(memoryview(data)[:-4]) != struct.unpack("<I", data[-4:])[0]:
        raise ScanFileError("frame has a wrong checksum: its bytes are not those that were written")
    _, header_size, _ = _HEAD.unpack(data[: _HEAD.size])
    payload_start = _HEAD.size + header_size
    try:
        header = parse_json(data[_HEAD.size : payload_start])
    except ValueError:
        raise ScanFileError("frame must have a header in JSON, got something else") from None
    if not isinstance(header, dict) or header.get("kind") not in ("scan", "run", "end"):
        raise ScanFileError("frame must have a header with the kind scan, run or end, got another")
    return Frame(header["kind"], header, data[payload_start:-4])


def scan_of(frame: Frame, description: RunDescription) -> Scan:
    """Return the scan in a frame.

    Parameters
    ----------
    frame : Frame
        A frame of the kind "scan".
    description : RunDescription
        The run that it must belong to.

    Returns
    -------
    Scan
        The scan; its pose is None if the one in the frame is not finite or out of bounds.

    Raises
    ------
    ScanFileError
        If the frame is of another kind or run, or has another number of samples.
    """
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
            f"scan must have {expected} bytes of samples (polarization, pair, frequency) = "
            f"{description.shape}, got {len(frame.payload)}"
        )
    signal = np.frombuffer(frame.payload, "<c8").reshape(description.shape).astype(np.complex64)
    stated_time = header.get("time")
    time = float(stated_time) if _is_finite(stated_time) else math.nan
    return Scan(number, time, _pose(header.get("pose")), signal)


def _is_finite(value: Any) -> TypeGuard[float]:
    """Return whether a JSON value is a number that a float holds; JSON has larger integers."""
    return isinstance(value, int | float) and abs(value) <= sys.float_info.max


def pose_fault(frame: Frame) -> str:
    """Return why the pose in a scan's frame cannot be one: the rule and the value.

    Parameters
    ----------
    frame : Frame
        A frame of the kind "scan".

    Returns
    -------
    str
        "" where the pose can be one, and where the frame states that it is unknown.
    """
    value = frame.header.get("pose")
    rule = "" if value is None else _broken_pose_rule(value)
    return f"pose must {rule}, got {shortened(repr(value))}" if rule else ""


def _pose(value: Any) -> FloatArray | None:
    """Return the pose in a header, or None if it is not finite or out of bounds."""
    if _broken_pose_rule(value):
        return None
    return floats(value)


def _broken_pose_rule(value: Any) -> str:
    """Return the rule that a JSON value breaks which should be a pose; "" if it breaks none."""
    if not isinstance(value, list) or len(value) != 6:
        return "be six numbers"
    if not all(_is_finite(component) for component in value):
        return "be six finite numbers"
    pose = floats(value)
    position = pose[:3]
    heading = pose[3]
    pitch_and_roll = pose[4:]
    if (np.abs(position) >= _FARTHEST_POSE).any():
        return f"have coordinates below {_FARTHEST_POSE:g} m"
    if abs(heading) > 2 * math.pi:
        return "have a heading within a full turn"
    if (np.abs(pitch_and_roll) > math.pi / 2).any():
        return "have pitch and roll within a quarter turn"
    return ""


def write_description(description: RunDescription, folder: Path) -> None:
    """Write a run's description into a folder of scans.

    Parameters
    ----------
    description : RunDescription
        The run.
    folder : Path
        The folder, which exists.

    Raises
    ------
    OSError
        If the file cannot be written.
    """
    write_whole(folder / RUN_FILE, description_text(description))


def description_text(description: RunDescription) -> str:
    """Return what the file of a run's description holds."""
    return json.dumps(description.as_json(), indent=1) + "\n"


def read_description(folder: Path) -> RunDescription | None:
    """Read a run's description from a folder of scans.

    Parameters
    ----------
    folder : Path
        The folder, from anywhere.

    Returns
    -------
    RunDescription or None
        The description; None while there is none.

    Raises
    ------
    ScanFileError
        If it is damaged or breaks a rule.
    """
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
    """Return the name of a scan's file, such as ``scan-000017.scan``."""
    return f"scan-{number:06d}{SCAN_SUFFIX}"
