"""Registers that only grow: hashes of recipes, plans and alarm lists, each line sealed by the one before."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import pandas as pd


def content_hash(content: bytes | str | Path | Mapping[str, Any]) -> str:
    """Hash (SHA-256) bytes or text as they are, the file at a ``Path``, or a mapping as JSON with sorted keys."""
    if isinstance(content, Path):
        data = content.read_bytes()
    elif isinstance(content, bytes):
        data = content
    else:
        data = (content if isinstance(content, str) else json.dumps(content, sort_keys=True)).encode()
    return hashlib.sha256(data).hexdigest()


def alarm_hash(alarms: pd.DataFrame) -> str:
    """Hash what scoring sees of an alarm list; the order of rows and further columns do not matter."""
    names = [name for name in ("lane", "x", "y", "confidence") if name in alarms.columns]
    lines = sorted(
        ",".join(repr(value) for value in row) for row in alarms[names].astype(object).itertuples(index=False)
    )
    return content_hash("\n".join([",".join(names), *lines]))


def register(path: str | Path, **entry: Any) -> dict[str, Any]:
    """Append a line to a register, made if missing, with the time and the hash of the line before; give the line.

    The register holds one JSON object per line; an entry is e.g. ``recipe=content_hash(Path("recipe.toml"))``. One that
    was altered is a ValueError.
    """
    file = Path(path)
    lines = read_register(file)
    line = {**entry, "time": datetime.now(UTC).isoformat(timespec="seconds"), "number": len(lines) + 1}
    line["previous"] = lines[-1]["hash"] if lines else ""
    line["hash"] = content_hash(line)
    with file.open("a", encoding="utf-8") as stream:
        stream.write(json.dumps(line, sort_keys=True) + "\n")
    return line


def read_register(path: str | Path) -> list[dict[str, Any]]:
    """Read the lines of a register, none if it is missing; a ValueError names the first that was altered or put in."""
    file = Path(path)
    if not file.exists():
        return []
    lines: list[dict[str, Any]] = []
    for number, text in enumerate(file.read_text(encoding="utf-8").splitlines(), start=1):
        try:
            line = json.loads(text)
            body = {key: value for key, value in line.items() if key != "hash"}
            fits = line["hash"] == content_hash(body) and line["previous"] == (lines[-1]["hash"] if lines else "")
        except (json.JSONDecodeError, AttributeError, KeyError):
            fits = False
        if not fits:
            raise ValueError(f"register {file} must be unaltered, got a line {number} that does not fit")
        lines.append(line)
    return lines


def require_registered(path: str | Path, recipe: str) -> dict[str, Any]:
    """Demand that a recipe, by its :func:`content_hash`, was registered before the truth is opened; give its line.

    If no line holds the hash under ``recipe``, or the register was altered, that is a ValueError.
    """
    for line in read_register(path):
        if line.get("recipe") == recipe:
            return line
    raise ValueError(f"recipe must be registered in {path} before the truth is opened, got {recipe[:12]}...")
