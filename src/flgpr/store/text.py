"""Text that other programs wrote: of whatever encoding, and the times in it."""

from __future__ import annotations

import codecs
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from flgpr.door import read_named
from flgpr.store.store_layout import MAX_MEMORY

_MARKS = (
    (codecs.BOM_UTF8, "utf-8-sig", "UTF-8"),
    (codecs.BOM_UTF32_LE, "utf-32", "UTF-32"),  # before UTF-16, whose mark it begins with
    (codecs.BOM_UTF32_BE, "utf-32", "UTF-32"),
    (codecs.BOM_UTF16_LE, "utf-16", "UTF-16"),
    (codecs.BOM_UTF16_BE, "utf-16", "UTF-16"),
)
"""Byte order marks at the beginning of a file, the codec that reads it, and its name."""
_SAMPLE_BYTES = 4096  # bytes by which text without a mark is judged
_LEAST_ZEROS = 0.7  # share of the high bytes that are zero in UTF-16 of European languages


def decode_text(data: bytes, name: str, notes: list[str] | None = None) -> str:
    """Return bytes as text.

    The byte order mark decides. Without one, the text is UTF-16 where every other byte is zero,
    else UTF-8, or Latin-1 if it is no UTF-8.

    Parameters
    ----------
    data : bytes
        Content of the file.
    name : str
        What the file is called in messages.
    notes : list of str, optional
        Gets a line if the encoding is another than UTF-8.

    Returns
    -------
    str
        The text, without its mark.

    Raises
    ------
    ValueError
        If it is no text in the encoding of its mark, or breaks off within a character.
    """
    codec, encoding = _encoding_of(data)
    try:
        text = data.decode(codec)
    except UnicodeDecodeError as error:
        if codec != "utf-8":
            raise ValueError(
                f"{name} begins as {encoding} and is none at byte {error.start}"
            ) from None
        text = data.decode("latin-1")
        encoding = "Latin-1, which is assumed because it is no UTF-8"
    if notes is not None and encoding != "UTF-8":
        notes.append(f"{name} is text in {encoding}")
    return text


def text_of(path: Path, notes: list[str]) -> str:
    """Read a text file that a user named, of up to MAX_MEMORY bytes, by :func:`decode_text`."""
    return decode_text(read_named(path, MAX_MEMORY), path.name, notes)


def _encoding_of(data: bytes) -> tuple[str, str]:
    """Return the codec of a text and the name of its encoding."""
    for mark, codec, encoding in _MARKS:
        if data.startswith(mark):
            return codec, encoding
    sample = data[: _SAMPLE_BYTES - _SAMPLE_BYTES % 2]
    if len(data) % 2 == 0 and len(sample) >= 4:
        even = sample[0::2]
        odd = sample[1::2]
        if odd.count(0) > _LEAST_ZEROS * len(odd) and 0 not in even:
            return "utf-16-le", "UTF-16 without a mark"
        if even.count(0) > _LEAST_ZEROS * len(even) and 0 not in odd:
            return "utf-16-be", "UTF-16 without a mark"
    return "utf-8", "UTF-8"


def zoned_time(text: Any) -> datetime | None:
    """Return a time of ISO 8601 with a time zone; None for what is none.

    Parameters
    ----------
    text : Any
        Value of an entry or a cell, which may be something else than text.

    Returns
    -------
    datetime or None
        The time, in its own zone.
    """
    try:
        moment = datetime.fromisoformat(text)
    except (TypeError, ValueError):
        return None
    return None if moment.tzinfo is None else moment


def utc_text(moment: datetime) -> str:
    """Return a time with a zone in UTC as KML, GPX, CPHD and SigMF have it."""
    in_utc = moment.astimezone(UTC).replace(tzinfo=None)
    return in_utc.isoformat(timespec="microseconds") + "Z"
