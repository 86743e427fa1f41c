"""TOML text, parsed within limits."""

from __future__ import annotations

import re
import tomllib
from typing import Any

from flgpr.json_text import MOST_NESTING

MOST_TOML = 16 * 2**20
"""Longest file of TOML that is parsed, characters."""
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


def parse_toml(data: bytes | str) -> dict[str, Any]:
    """Parse TOML in UTF-8 of at most :data:`MOST_TOML` characters; anything else is a ValueError.

    So are keys of more than :data:`MOST_NESTING` parts, for which the parser takes time that grows
    with their square, and values nested so deep that it gives up.
    """
    text = data if isinstance(data, str) else data.decode("utf-8")
    if len(text) > MOST_TOML:
        raise ValueError(f"it must have at most {MOST_TOML} characters, got {len(text)}")
    without_text = _TOML_TEXT.sub("", text)
    if any(key.count(".") >= MOST_NESTING for key in _TOML_MARKS.split(without_text)):
        raise ValueError(f"its keys must have at most {MOST_NESTING} parts, got more")
    try:
        return tomllib.loads(text)
    except RecursionError:
        raise ValueError("it is nested too deeply") from None
