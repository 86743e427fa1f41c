"""Sentences of NMEA 0183, checked by their sums; what cannot be used is counted, not refused."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import reduce
from operator import xor
from typing import NamedTuple

_SENTENCE = re.compile(r"\$([A-Z][^$*\r\n\"]*)(?:\*([0-9A-Fa-f]{2}))?")
_KINDS = {"PASHR": "PASHR", "PTNL,AVR": "AVR"}
"""Sentences of makers, which have no sender of two letters."""
_FOOT = 0.3048
_LEAST_WRONG = 3  # sums of zeros, or of another rule, that are no sums


class Sentence(NamedTuple):
    """A sentence: its kind, such as GGA, and the cells behind its name."""

    kind: str
    cells: list[str]


class Position(NamedTuple):
    """A position as a sentence of a satellite receiver states it."""

    time: float  #: s of the day; NaN if there is none
    longitude: float  #: degrees, WGS 84
    latitude: float
    altitude: float  #: over the sea, m; NaN if there is none
    separation: float  #: of the geoid from the ellipsoid, m; NaN if there is none
    quality: int  #: of GGA; -1 for RMC


@dataclass
class SentenceCounts:
    """How many sentences there were, and how many were left out for their sums."""

    total: int = 0
    damaged: int = 0
    unchecked: int = 0

    def notes(self, name: str) -> list[str]:
        """Return in lines what was left out, and what nothing could check."""
        lines = []
        if self.damaged:
            lines.append(
                f"{self.damaged} of {self.total} sentences of {name} are left out: they are cut "
                "off, or do not fit their checksums"
            )
        if self.unchecked:
            lines.append(
                f"{self.unchecked} of {self.total} sentences of {name} are used without a checksum "
                "that fits: no sentence has one, and damage is not found"
            )
        return lines


def sentences_of(
    texts: Sequence[str], kinds: Sequence[str], counts: SentenceCounts
) -> Iterator[tuple[int, int, Sentence]]:
    """Yield the sentences of lines that are whole.

    A sentence without a checksum is one that was cut off, unless none of all has one. Bytes of
    other protocols, comments and clocks before a sentence are passed over.

    Parameters
    ----------
    texts : sequence of str
        Lines, or one text of many.
    kinds : sequence of str
        Kinds to yield, such as GGA.
    counts : SentenceCounts
        Takes the counts.

    Yields
    ------
    line, begin, sentence : int, int, Sentence
        Number of the line, from 0, where in it the sentence begins, and the sentence.
    """
    found = []
    for number, text in enumerate(texts):
        for match in _SENTENCE.finditer(text):
            sentence = _parsed(match[1])
            if sentence.kind in kinds:
                found.append((number, match, sentence))
    fits = [
        match[2] is not None and int(match[2], 16) == reduce(xor, map(ord, match[1]))
        for _, match, _ in found
    ]
    have_none = not any(match[2] for _, match, _ in found)
    none_fits = not any(fits) and (have_none or len(found) >= _LEAST_WRONG)
    counts.total = len(found)
    for (number, match, sentence), is_whole in zip(found, fits, strict=True):
        if is_whole or none_fits:
            counts.unchecked += not is_whole
            yield number, match.start(), sentence
        else:
            counts.damaged += 1


def _parsed(text: str) -> Sentence:
    """Return the kind and the cells of a sentence."""
    for name, kind in _KINDS.items():
        if text.startswith(name + ","):
            return Sentence(kind, text[len(name) + 1 :].split(","))
    name, *cells = text.split(",")
    return Sentence(name[2:], cells)


def position_of(sentence: Sentence) -> Position | None:
    """Return the position of a GGA or RMC; None if it states none."""
    is_gga = sentence.kind == "GGA"
    cells = [cell.strip() for cell in sentence.cells]
    if len(cells) < (10 if is_gga else 6):
        return None
    place = cells[1:5] if is_gga else cells[2:6]
    altitude = separation = math.nan
    quality = -1
    try:
        latitude = _degrees(place[0], place[1], "NS")
        longitude = _degrees(place[2], place[3], "EW")
        if is_gga:
            quality = int(cells[5])
            altitude = _metres(cells[8], cells[9])
            separation = _metres(*cells[10:12]) if len(cells) > 11 else math.nan
    except (ValueError, OverflowError):
        return None
    if quality == 0 or (not is_gga and cells[1] in ("V", "")):
        return None
    return Position(clock_time(cells[0]), longitude, latitude, altitude, separation, quality)


def _degrees(text: str, side: str, sides: str) -> float:
    """Return degrees of ``dddmm.mmmm`` and a letter, one of two."""
    value = float(text)
    degrees = value // 100
    size = degrees + (value - 100 * degrees) / 60
    if not (math.isfinite(size) and value >= 0 and side in tuple(sides)):
        raise ValueError("no angle")
    return -size if side == sides[1] else size


def _metres(text: str, unit: str) -> float:
    """Return a height, m; NaN where there is none. F is feet, and all else metres."""
    if not text:
        return math.nan
    return float(text) * (_FOOT if unit.upper() == "F" else 1.0)


def clock_time(text: str) -> float:
    """Return the second of the day of ``hhmmss.ss`` or ``hh:mm:ss``; NaN if it is none."""
    match = re.fullmatch(r"(\d{1,2}):?(\d{2}):?(\d{2}(?:[.,]\d*)?)", text.strip())
    if match is None:
        return math.nan
    hours, minutes, seconds = match.groups()
    return 3600.0 * int(hours) + 60.0 * int(minutes) + float(seconds.replace(",", "."))


HEADINGS: Mapping[str, int] = {"HDT": 0, "THS": 0, "PASHR": 1, "AVR": 1}
"""Sentences of a true heading, the first that a log holds is used, and the cell that states it."""


def heading_time(sentence: Sentence) -> float:
    """Return the time of a sentence of :data:`HEADINGS`, s of the day; NaN where it states none."""
    has_time = HEADINGS[sentence.kind] > 0 and len(sentence.cells) > 0
    return clock_time(sentence.cells[0]) if has_time else math.nan


def heading_of(sentence: Sentence) -> float | None:
    """Return the true heading of a sentence of :data:`HEADINGS`, degrees; None if it has none.

    The mode of THS must be one of a measurement: A or D.
    """
    cell = HEADINGS[sentence.kind]
    try:
        heading = float(sentence.cells[cell])
    except (ValueError, IndexError):
        return None
    lost = sentence.kind == "THS" and sentence.cells[1:2] not in (["A"], ["D"])
    return None if lost or not abs(heading) <= 360 else heading
