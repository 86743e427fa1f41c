"""Text of other programs' files in the encodings that they write."""

from __future__ import annotations

import codecs

_MARKS = (
    (codecs.BOM_UTF8, "utf-8-sig", "UTF-8"),
    (codecs.BOM_UTF32_LE, "utf-32", "UTF-32"),  # before UTF-16, whose mark it begins with
    (codecs.BOM_UTF32_BE, "utf-32", "UTF-32"),
    (codecs.BOM_UTF16_LE, "utf-16", "UTF-16"),
    (codecs.BOM_UTF16_BE, "utf-16", "UTF-16"),
)
"""Byte order marks at the beginning of a file, the codec that reads it, and its name."""
_LOOKED_AT = 4096  # bytes by which text without a mark is judged
_MOST_ZEROS = 0.7  # share of the high bytes that are zero in UTF-16 of European languages, at least


def decode_text(data: bytes, name: str, notes: list[str] | None = None) -> str:
    """Return bytes as text: by the byte order mark, else as UTF-16 where every other byte is zero, UTF-8, or Latin-1.

    ``notes`` get a line wherever the encoding is another than UTF-8; ``name`` is the file's in it. A file that breaks
    off within a character, or that is no text in the encoding of its mark, is a ValueError.
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


def _encoding_of(data: bytes) -> tuple[str, str]:
    """Return the codec of a text and the name of its encoding."""
    for mark, codec, encoding in _MARKS:
        if data.startswith(mark):
            return codec, encoding
    sample = data[: _LOOKED_AT - _LOOKED_AT % 2]
    if len(data) % 2 == 0 and len(sample) >= 4:
        first = sample[0::2]
        second = sample[1::2]
        if second.count(0) > _MOST_ZEROS * len(second) and 0 not in first:
            return "utf-16-le", "UTF-16 without a mark"
        if first.count(0) > _MOST_ZEROS * len(first) and 0 not in second:
            return "utf-16-be", "UTF-16 without a mark"
    return "utf-8", "UTF-8"
