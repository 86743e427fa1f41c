"""JSON text: parsed within limits, in canonical form, and with a digest of its own."""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Callable, Mapping, Sequence
from typing import Any

MOST_VALUES = 8_000_000
"""Most values in a file of JSON: each takes up to 100 bytes of memory."""
MOST_NESTING = 100
"""Deepest nesting of JSON; Python itself gives up at about ten times that."""
MOST_DIGITS = 300
"""Digits of a number, of which no number of double precision has more before its point."""
MANY_DIGITS = re.compile(rf"(?<![0-9_])[0-9](?:_?[0-9]){{{MOST_DIGITS - 1}}}")
"""So many digits in a row, which TOML parts by underscores."""
_SURROGATE = (
    re.compile(r"\\u[dD][89a-fA-F]|[\ud800-\udfff]"),
    # As an escape, as bytes, and text that may be in another encoding than UTF-8.
    re.compile(rb"\\u[dD][89a-fA-F]|\xed[\xa0-\xbf]|\A(?:.?\x00|\xff\xfe|\xfe\xff)", re.DOTALL),
)
"""What half a pair of surrogates may come of, in text and in bytes."""


def count_values(data: bytes | str) -> int:
    """Return how many values a text of JSON has at most, without parsing it."""
    # Every value but the first follows one of these marks.
    marks: tuple[Any, ...] = (",", "[", "{") if isinstance(data, str) else (b",", b"[", b"{")
    return sum(data.count(mark) for mark in marks)


def parse_json(
    data: bytes | str,
    constant: Callable[[str], Any] | None = None,
    whole: Callable[[str], Any] | None = None,
) -> Any:
    """Parse JSON of at most :data:`MOST_VALUES` values, nested :data:`MOST_NESTING` deep.

    Anything else is a ValueError, as are whole numbers of more than :data:`MOST_DIGITS` digits and
    text with half a pair of surrogates, which cannot be written. ``constant`` returns what stands
    for NaN and infinity, by default these numbers; ``whole`` what stands for a whole number.
    """
    if count_values(data) > MOST_VALUES:
        raise ValueError(f"it must hold at most {MOST_VALUES} values, got more")
    # Both are rare: a search for them is much faster than a look at every value.
    if whole is None and _may_have_many_digits(data):
        whole = _short_number
    try:
        value = json.loads(data, parse_constant=constant, parse_int=whole)
    except RecursionError:
        raise ValueError(f"it must be nested at most {MOST_NESTING} deep, got more") from None
    of_text, of_bytes = _SURROGATE
    found = of_text.search(data) if isinstance(data, str) else of_bytes.search(data)
    if found is not None:
        try:  # half a pair of surrogates is no character and cannot be written
            json.dumps(value, ensure_ascii=False).encode()
        except UnicodeEncodeError as error:
            half = ord(error.object[error.start])
            raise ValueError(
                f"its text must be of whole characters, got half of one, U+{half:04X}"
            ) from None
    containers = [value]
    for _ in range(MOST_NESTING + 1):
        containers = _inner_containers(containers)
        if not containers:
            return value
    raise ValueError(f"it must be nested at most {MOST_NESTING} deep, got more")


def _short_number(digits: str) -> int:
    """Return a whole number; one of so many digits that no other number equals it is refused."""
    if len(digits) > MOST_DIGITS:
        raise ValueError(f"its numbers must have at most {MOST_DIGITS} digits, got {len(digits)}")
    return int(digits)


def _may_have_many_digits(data: bytes | str) -> bool:
    """Return whether there may be a number of so many digits: then a whole block is of digits."""
    block = MOST_DIGITS // 2
    return any(data[start : start + block].isdigit() for start in range(0, len(data), block))


def _inner_containers(values: Sequence[Any]) -> list[Any]:
    """Return the objects and lists that lie directly in these values."""
    containers = []
    for value in values:
        entries: Any = ()
        if isinstance(value, dict):
            entries = value.values()
        elif isinstance(value, list):
            entries = value
        containers += [entry for entry in entries if isinstance(entry, dict | list)]
    return containers


def sha256(data: bytes | memoryview) -> str:
    """Return the SHA-256 of bytes.

    Parameters
    ----------
    data : bytes or memoryview
        The bytes.

    Returns
    -------
    str
        64 hexadecimal digits.
    """
    return hashlib.sha256(data).hexdigest()


def compact_json(value: Any, sort_keys: bool = False) -> str:
    """Return a JSON value as ASCII text without spaces; a ValueError if a number is not finite."""
    return json.dumps(value, sort_keys=sort_keys, separators=(",", ":"), allow_nan=False)


def canonical_json(value: Any) -> bytes:
    """Return a JSON value in canonical form: sorted keys, no spaces, ASCII.

    Parameters
    ----------
    value : JSON value
        Nested dicts, lists, text, finite numbers, booleans and None.

    Returns
    -------
    bytes
        The same bytes for equal values, so that their digests are equal, too.

    Raises
    ------
    ValueError
        If a number is NaN or infinite.
    TypeError
        If an entry is no JSON value.
    """
    return compact_json(value, sort_keys=True).encode()


def json_with_digest(content: Mapping[str, Any]) -> bytes:
    """Return a JSON object as text with its own SHA-256 as last entry.

    Parameters
    ----------
    content : mapping of str to JSON value
        The object.

    Returns
    -------
    bytes
        Indented JSON whose last entry ``sha256`` is the digest of the rest in canonical form.

    Raises
    ------
    ValueError
        If a number is NaN or infinite, or there is an entry ``sha256`` already.
    """
    if "sha256" in content:
        raise ValueError("content must not hold the entry sha256, which is added")
    with_digest = {**content, "sha256": sha256(canonical_json(content))}
    return json.dumps(with_digest, indent=1, allow_nan=False).encode() + b"\n"


def parse_with_digest(data: bytes) -> dict[str, Any]:
    """Read the JSON object that :func:`json_with_digest` wrote, and check it.

    Parameters
    ----------
    data : bytes
        Text of :func:`json_with_digest`.

    Returns
    -------
    dict
        The object, with its entry ``sha256``.

    Raises
    ------
    ValueError
        If it is no such text, or a byte differs from what was written.
    """
    try:
        with_digest = parse_json(data)
        content = {name: value for name, value in with_digest.items() if name != "sha256"}
        is_unaltered = json_with_digest(content) == data
    except (ValueError, AttributeError) as error:
        raise ValueError(f"it cannot be read ({error})") from None
    if not is_unaltered:
        raise ValueError("it differs from what was written")
    return dict(with_digest)


def check_format(content: Mapping[str, Any], name: str, version: int) -> None:
    """Refuse a JSON object that is not of a format and version: a ValueError."""
    if (content.get("format"), content.get("version")) != (name, version):
        raise ValueError(f"format must be {name} version {version}")
