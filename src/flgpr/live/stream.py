"""Cuts the bytes that a sender sends over a socket into frames."""

from __future__ import annotations

import contextlib
import math
import time
from collections.abc import Iterator

from flgpr.live.source import SOCKET, Arrival
from flgpr.store import RunDescription, ScanFileError, canonical_json, decode_frame
from flgpr.store.scan_file import (
    LARGEST_FRAME,
    MAGIC,
    TruncatedFrameError,
    frame_size,
    head_size,
    parse_description,
)

_LARGEST_DESCRIPTION = 2**22 + 2**10  # bytes of the frame of the longest header
_HEADER_ROOM = 2**16  # bytes for the header of a scan
_CANDIDATES = 16  # beginnings of frames that are tried within a frame that may be damaged


def largest_frame(description: RunDescription) -> int:
    """Return the most bytes that a frame of a run may have.

    A frame is a scan, or the description, perhaps written with more digits than ours.

    Parameters
    ----------
    description : RunDescription
        The run.

    Returns
    -------
    int
        Bytes.
    """
    scan_size = 8 * math.prod(description.shape)
    description_size = len(canonical_json(description.as_json()))
    return min(2 * max(scan_size, description_size) + _HEADER_ROOM, LARGEST_FRAME)


class FrameStream:
    """Cuts the bytes of a sender into frames.

    After a bad one it continues where the next frame begins. ``largest`` is the most bytes that a
    frame may have, None while the run is not known: then a description may come, and after it scans
    of the size that it states.
    """

    def __init__(self, largest: int | None = None) -> None:
        self.largest = largest
        self._described = (
            _LARGEST_DESCRIPTION  # as ``largest``, by the description that the sender sent
        )
        self._buffer = bytearray()
        self._usual = 0  # bytes of the largest good frame so far
        # whether we are between a bad frame, which was reported, and the next beginning
        self._lost = False

    @property
    def waiting(self) -> int:
        """Bytes of a frame that is not complete."""
        return len(self._buffer)

    def take(self, data: bytes, over: bool) -> Iterator[Arrival]:
        """Yield the frames that are complete or bad.

        With ``over`` nothing more comes of the last frame.
        """
        self._buffer += data
        while self._buffer:
            if self._lost and not self._find_beginning():
                break
            try:
                arrival, size = self._first_frame()
            except TruncatedFrameError as error:
                if not over:
                    return
                yield self._bad(error)
            except ScanFileError as error:
                yield self._bad(error)
            else:
                del self._buffer[:size]
                yield arrival
        if self._lost and over:  # a bad frame after a pause is reported anew
            self._buffer.clear()
            self._lost = False

    def _first_frame(self) -> tuple[Arrival, int]:
        """Return the arrival at the beginning of the buffer, and its bytes."""
        size = self._checked_size()
        data = bytes(self._buffer[:size])
        frame = decode_frame(data)
        now = time.time()
        self._usual = max(self._usual, size)
        if frame.kind == "run":
            description = {key: value for key, value in frame.header.items() if key != "kind"}
            # A description that is not valid is reported by whoever takes it.
            with contextlib.suppress(ScanFileError):
                largest = largest_frame(parse_description(description))
                self._described = max(largest, _LARGEST_DESCRIPTION)
            return Arrival("run", SOCKET, now, value=description), size
        if frame.kind == "end":
            return Arrival("end", SOCKET, now), size
        return Arrival("frame", SOCKET, now, data), size

    def _checked_size(self) -> int:
        """Return the bytes of the first frame; refuse one that is not complete or too large."""
        beginning = bytes(self._buffer[: len(MAGIC)])
        if not MAGIC.startswith(beginning):
            raise ScanFileError(f"frame must begin with {MAGIC.decode()}, got {beginning!r}")
        size = frame_size(bytes(self._buffer[: head_size()]))
        most = self._described if self.largest is None else self.largest
        if size > most:
            raise ScanFileError(f"frame must have at most {most} bytes, got {size}")
        is_short = len(self._buffer) < size
        is_unusual = 0 < 2 * self._usual < size
        if is_short and is_unusual and self._holds_complete_frame():
            raise ScanFileError(
                f"frame must have {size} bytes, got {len(self._buffer)} before the next one begins"
            )
        if is_short:
            raise TruncatedFrameError(f"frame must have {size} bytes, got {len(self._buffer)}")
        return size

    def _holds_complete_frame(self) -> bool:
        """Return whether a complete frame lies in the buffer after its beginning."""
        start = self._buffer.find(MAGIC, 1)
        # Without a limit a sender of beginnings alone would keep a processor busy.
        for _ in range(_CANDIDATES):
            if start < 0:
                return False
            with contextlib.suppress(ScanFileError):
                size = frame_size(bytes(self._buffer[start : start + head_size()]))
                decode_frame(bytes(self._buffer[start : start + size]))
                return True
            start = self._buffer.find(MAGIC, start + 1)
        return False

    def _bad(self, error: ScanFileError) -> Arrival:
        """Return the arrival of a bad frame, and look for the next frame within it.

        The length that it states cannot be trusted.
        """
        del self._buffer[:1]
        self._lost = True
        return Arrival("frame", SOCKET, time.time(), value=error)

    def _find_beginning(self) -> bool:
        """Delete what comes before the beginning of a frame; return whether there is one."""
        start = self._buffer.find(MAGIC)
        self._lost = start < 0
        if self._lost:
            # The last bytes may be the first of a beginning.
            start = max(len(self._buffer) - len(MAGIC) + 1, 0)
        del self._buffer[:start]
        return not self._lost
