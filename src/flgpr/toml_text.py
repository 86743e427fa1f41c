"""TOML text: parsed within limits, and written with a comment beside every entry that has one."""

from __future__ import annotations

import json
import re
import tomllib
from collections.abc import Mapping
from decimal import Decimal
from typing import Any

from flgpr.json_text import MANY_DIGITS, MOST_DIGITS, MOST_NESTING

MOST_TOML = 16 * 2**20
"""Longest file of TOML that is parsed, characters."""
_MOST_ENTRIES = 100_000  # and tables: each is looked up, and a fault in it is told
_TOML_TEXT = re.compile(
    r"""
    "{3}(?:[^"\\]|\\.|"(?!""))*+(?:"{3})?  # where the end is missing it takes all that is left,
    | '{3}(?:[^']|'(?!''))*+(?:'{3})?      # so that no character is read twice
    | "(?:[^"\\\n]|\\[^\n])*+"?
    | '[^'\n]*+'?
    | \#[^\n]*+
    """,
    re.VERBOSE | re.DOTALL,
)
"""Strings and comments of TOML."""
_TOML_MARKS = re.compile(r"[=,{}\[\]\n]")
"""Characters that a key of TOML does not have outside its strings."""
_BARE_KEY = re.compile(r"[A-Za-z0-9_-]+")


class InlineTable(dict[str, Any]):
    """A table that is written in one line, as the value of an entry."""


def parse_toml(data: bytes | str) -> dict[str, Any]:
    """Parse TOML in UTF-8 of at most :data:`MOST_TOML` characters; anything else is a ValueError.

    So are more than 100,000 entries and tables, numbers of 300 digits, values nested so deep that
    the parser gives up, and keys of more than :data:`MOST_NESTING` parts, for which it takes time
    that grows with their square.
    """
    text = data if isinstance(data, str) else data.decode("utf-8")
    if len(text) > MOST_TOML:
        raise ValueError(f"it must have at most {MOST_TOML} characters, got {len(text)}")
    without_text = _TOML_TEXT.sub("", text)
    if any(key.count(".") >= MOST_NESTING for key in _TOML_MARKS.split(without_text)):
        raise ValueError(f"its keys must have at most {MOST_NESTING} parts, got more")
    entries = without_text.count("=") + without_text.count("\n[")
    if entries > _MOST_ENTRIES:
        raise ValueError(f"it must have at most {_MOST_ENTRIES} entries and tables, got {entries}")
    if MANY_DIGITS.search(without_text):
        raise ValueError(f"its numbers must have fewer than {MOST_DIGITS} digits, got more")
    try:
        return tomllib.loads(text)
    except RecursionError:
        raise ValueError("it is nested too deeply") from None


def toml_lines(
    table: Mapping[str, Any], comments: Mapping[str, str], path: tuple[str, ...] = ()
) -> list[str]:
    """Return the lines of a table, its own entries before the tables within it.

    Parameters
    ----------
    table : mapping of str to value or table
        The entries.
    comments : mapping of str to str
        What stands beside an entry or a table's header, by names joined by dots.
    path : tuple of str
        Names of the tables that it lies in.
    """
    lines = []
    inner_lines: list[str] = []
    for name, value in table.items():
        comment = comments.get(".".join([*path, name]), "")
        beside = f"  # {comment}" if comment else ""
        if isinstance(value, dict) and not isinstance(value, InlineTable):
            header = ".".join(_toml_key(part) for part in (*path, name))
            inner_lines += ["", f"[{header}]{beside}"]
            inner_lines += toml_lines(value, comments, (*path, name))
        else:
            lines.append(f"{_toml_key(name)} = {toml_value(value)}{beside}")
    return lines + inner_lines


def _toml_key(name: str) -> str:
    """Return a key as TOML writes it."""
    return name if _BARE_KEY.fullmatch(name) else toml_value(name)


def toml_value(value: Any) -> str:
    """Return a value as TOML writes it; numbers from a million on, which are frequencies, in 1e9."""
    if isinstance(value, dict):
        entries = (f"{_toml_key(name)} = {toml_value(entry)}" for name, entry in value.items())
        return f"{{{', '.join(entries)}}}"
    if isinstance(value, list) and any(isinstance(member, list) for member in value):
        rows = "".join(f"    {toml_value(member)},\n" for member in value)
        return f"[\n{rows}]"
    if isinstance(value, list | tuple):
        return f"[{', '.join(toml_value(member) for member in value)}]"
    if isinstance(value, float) and abs(value) >= 1e6:
        # The fewest digits that give the same number, so that a tone at the edge of a band stays.
        billions = Decimal(repr(float(value))).scaleb(-9).normalize()
        return f"{billions:f}e9"
    # JSON leaves as it is the one character that TOML does not allow in a text.
    return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
