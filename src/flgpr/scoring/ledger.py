"""Registers that only grow: hashes of recipes, plans and alarm lists, each line sealed by the one before."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import pandas as pd

OPENED = "truth opened"
"""Event of a register: what is registered after it was registered too late."""


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
    line = {**entry, "time": datetime.now(UTC).isoformat(timespec="milliseconds"), "number": len(lines) + 1}
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


def before_opening(lines: Sequence[dict[str, Any]]) -> Sequence[dict[str, Any]]:
    """Take the lines of a register that were entered before anybody looked at a truth."""
    opened = (number for number, line in enumerate(lines) if line.get("event") == OPENED)
    return lines[: next(opened, len(lines))]


def require_registered(path: str | Path, recipe: str, model: str | None = None) -> dict[str, Any]:
    """Demand that a recipe, by its :func:`content_hash`, was registered before any look at a truth; give its line.

    ``model`` is the hash of the model that it was run with, which must then stand in the same line. If no line before
    the first opening holds them under ``recipe`` and ``model``, or the register was altered, that is a ValueError.
    """
    lines = read_register(path)
    early = before_opening(lines)
    named = [line for line in lines if line.get("recipe") == recipe and line.get("event") != OPENED]
    for line in named:
        if line in early and model in (None, line.get("model")):
            return line
    got = f"{recipe[:12]}..."
    if any(line in early for line in named):
        raise ValueError(f"recipe must be registered with its model in {path}, got {got} with the model {model}")
    late = f" in line {named[0]['number']}, after the look in line {len(early) + 1}" if named else ""
    raise ValueError(f"recipe must be registered in {path} before the truth is opened, got {got}{late}")


def require_truth(
    path: str | Path,
    truth: str,
    lanes: Mapping[str, Mapping[str, float]],
    rules: Mapping[str, float],
    planned: bool = False,
) -> None:
    """Demand that a truth, by its :func:`content_hash`, is the one a register tells of, with its lanes and rules.

    A plan counts until it is surveyed, and then the last survey of it; what was entered after the first opening never
    does. Lanes, m, must be those of the plan, and so must what it says of the ``rules``. A register without a plan
    demands nothing, unless the truth is known to be ``planned``. Anything else is a ValueError.
    """
    lines = read_register(path)
    known = [line for line in before_opening(lines) if line.get("event") in ("plan", "survey")]
    if not known and not planned:
        return
    plan = {line.get("truth", line["plan"]): line["plan"] for line in known}.get(truth)
    if plan is None:
        raise ValueError(
            f"truth must be the plan or the survey of it that stands in {path}, got another or an altered one; "
            "`flgpr plan survey` enters what was emplaced"
        )
    last = [line for line in known if line["plan"] == plan][-1]
    if last.get("truth", plan) != truth:
        raise ValueError(f"truth must be the survey in line {last['number']} of {path}, got what it replaced")
    borders = list(last["lanes"].values())
    strange = [dict(one) for one in lanes.values() if dict(one) not in borders]
    if strange:
        raise ValueError(f"lane must be as planned in {path}, {borders}, got {strange[0]}")
    for name, value in rules.items():
        if last.get("rules", {}).get(name, value) != value:
            raise ValueError(f"{name} must be {last['rules'][name]:g} as planned in {path}, got {value:g}")
