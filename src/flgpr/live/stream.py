"""Cuts what a sender sends over a socket into frames."""

from __future__ import annotations

import contextlib
import math
import time
from collections.abc import Iterator

from flgpr.live.watch import LARGEST_FRAME, SOCKET, Arrival
from flgpr.store import RunDescription, ScanFileError, canonical_json, decode_frame
from flgpr.store.scan_file import (
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
    """Give the bytes that a frame of a run may have: a scan, or the description written with more digits."""
    scan = 8 * math.prod(description.shape)
    return min(
        2 * max(scan, len(canonical_json(description.as_json()))) + _HEADER_ROOM, LARGEST_FRAME
    )


class FrameStream:
    """Cuts what a sender sends into frames; after a bad one it goes on where the next frame begins.

    ``largest`` is the most bytes that a frame may have, None while the run is not known: then a description may come,
    and after it scans of the size that it states.
    """

    def __init__(self, largest: int | None = None) -> None:
        self.largest = largest
        self._described = _LARGEST_DESCRIPTION  # what the sender's own description makes of it
        self._kept = bytearray()
        self._usual = 0  # bytes of the largest good frame so far
        self._lost = False  # between a bad frame, which was told, and the next beginning

    @property
    def waiting(self) -> int:
        """Bytes of a frame that is not whole."""
        return len(self._kept)

    def take(self, data: bytes, over: bool) -> Iterator[Arrival]:
        """Give what is whole or bad; with ``over`` nothing more comes of the last frame."""
        self._kept += data
        while self._kept:
            if self._lost and not self._find():
                break
            try:
                arrival, size = self._first()
            except TruncatedFrameError as error:
                if not over:
                    return
                yield self._bad(error)
            except ScanFileError as error:
                yield self._bad(error)
            else:
                del self._kept[:size]
                yield arrival
        if self._lost and over:  # what comes after a pause is told anew
            self._kept.clear()
            self._lost = False

    def _first(self) -> tuple[Arrival, int]:
        if not MAGIC.startswith(self._kept[: len(MAGIC)]):
            raise ScanFileError(
                f"frame must begin with {MAGIC.decode()}, got {bytes(self._kept[: len(MAGIC)])!r}"
            )
        size = frame_size(bytes(self._kept[: head_size()]))
        most = self._described if self.largest is None else self.largest
        if size > most:
            raise ScanFileError(f"frame must have at most {most} bytes, got {size}")
        if len(self._kept) < size and 0 < 2 * self._usual < size and self._within():
            raise ScanFileError(
                f"frame must have {size} bytes, got {len(self._kept)} before the next one begins"
            )
        if len(self._kept) < size:
            raise TruncatedFrameError(f"frame must have {size} bytes, got {len(self._kept)}")
        data = bytes(self._kept[:size])
        frame = decode_frame(data)
        now = time.time()
        self._usual = max(self._usual, size)
        if frame.kind == "run":
            description = {k: v for k, v in frame.header.items() if k != "kind"}
            with contextlib.suppress(ScanFileError):  # whoever takes it tells what is wrong with it
                self._described = max(
                    largest_frame(parse_description(description)), _LARGEST_DESCRIPTION
                )
            return Arrival("run", SOCKET, now, value=description), size
        if frame.kind == "end":
            return Arrival("end", SOCKET, now), size
        return Arrival("frame", SOCKET, now, data), size

    def _within(self) -> bool:
        """Tell whether a whole frame lies in what is kept, after its beginning."""
        at = self._kept.find(MAGIC, 1)
        for _ in range(_CANDIDATES):  # else a sender of beginnings alone keeps a processor busy
            if at < 0:
                return False
            with contextlib.suppress(ScanFileError):
                size = frame_size(bytes(self._kept[at : at + head_size()]))
                decode_frame(bytes(self._kept[at : at + size]))
                return True
            at = self._kept.find(MAGIC, at + 1)
        return False

    def _bad(self, error: ScanFileError) -> Arrival:
        del self._kept[:1]  # its length cannot be trusted: the next frame is looked for within it
        self._lost = True
        return Arrival("frame", SOCKET, time.time(), value=error)

    def _find(self) -> bool:
        """Leave out what comes before the beginning of a frame; tell whether there is one."""
        at = self._kept.find(MAGIC)
        self._lost = at < 0
        del self._kept[: at if at >= 0 else max(len(self._kept) - len(MAGIC) + 1, 0)]
        return at >= 0
