"""Registers that only grow: hashes of recipes, plans and alarm lists, each line sealed by the one before."""

from __future__ import annotations

import hashlib
import json
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import pandas as pd

from flgpr.append_log import AppendLog, read_log
from flgpr.door import MOST_CHECKED, parse_json, read_named

OPENED = "truth opened"
"""Event of a register: what is registered after it was registered too late."""
WITNESS = "witness"
"""Event of a witness: how many lines a register had, and the hash of its last."""
_PATIENCE = 30.0  # s to wait for another process that is adding a line


def content_hash(content: bytes | str | Path | Mapping[str, Any]) -> str:
    """Hash (SHA-256) bytes or text as they are, the file at a ``Path``, or a mapping as JSON with sorted keys."""
    if isinstance(content, Path):
        data = read_named(content, MOST_CHECKED)
    elif isinstance(content, bytes):
        data = content
    else:
        data = (
            content if isinstance(content, str) else json.dumps(content, sort_keys=True)
        ).encode()
    return hashlib.sha256(data).hexdigest()


def alarm_hash(alarms: pd.DataFrame) -> str:
    """Hash what scoring sees of an alarm list; the order of rows and further columns do not matter."""
    names = [name for name in ("lane", "x", "y", "confidence") if name in alarms.columns]
    lines = sorted(
        ",".join(repr(value) for value in row)
        for row in alarms[names].astype(object).itertuples(index=False)
    )
    return content_hash("\n".join([",".join(names), *lines]))


@dataclass(frozen=True)
class WitnessedRegister:
    """A register, and the file of a witness that must know its lines and is told of new ones."""

    path: Path
    witness: Path


Book = str | Path | WitnessedRegister
"""A register, by its path or with its witness."""


def parts_of(book: Book) -> tuple[Path, Path | None]:
    """Give the path of a register, and of its witness if it has one."""
    return (book.path, book.witness) if isinstance(book, WitnessedRegister) else (Path(book), None)


def register(path: Book, /, **entry: Any) -> dict[str, Any]:
    """Append a line to a register, made if missing, with the time and the hash of the line before; give the line.

    The register holds one JSON object per line; an entry is e.g. ``recipe=content_hash(Path("recipe.toml"))``. One that
    was altered is a ValueError. The rest is as for ``enter``.
    """
    return enter(path, lambda _: entry)[-1]


def enter(
    path: Book, make_entry: Callable[[list[dict[str, Any]]], Mapping[str, Any]]
) -> list[dict[str, Any]]:
    """Append a line that depends on those before it, while nobody else can; give all lines, the new one last.

    Parameters
    ----------
    path : str, Path or WitnessedRegister
        The register, made if missing. A witness (:func:`check_witness`) is asked before, and told
        of the new line afterwards.
    make_entry : callable
        What makes the entry of the lines so far; an error of it leaves the register as it is.

    Raises
    ------
    ValueError
        If the register was altered, lacks a line that the witness saw, or is held by another
        process for 30 s.
    """
    file, witness = parts_of(path)
    with AppendLog(file, _PATIENCE) as log:
        lines = _parsed(file, log.lines)
        _finish_torn(file, log, lines)
        if witness is not None:
            check_witness(lines, witness, file)
        line = dict(make_entry(lines))
        line |= {
            "time": datetime.now(UTC).isoformat(timespec="milliseconds"),
            "number": len(lines) + 1,
        }
        line["previous"] = lines[-1]["hash"] if lines else ""
        line["hash"] = content_hash(line)
        log.append(json.dumps(line, sort_keys=True).encode())
        lines.append(line)
    if witness is not None:
        register(witness, event=WITNESS, of=lines[0]["hash"], **head_of(lines))
    return lines


def read_register(path: str | Path) -> list[dict[str, Any]]:
    """Read the lines of a register, none if it is missing; a ValueError names the first that was altered or put in.

    Half a line at the end, as a full disk or a kill leaves it, is no line: it was never told to anybody.
    """
    file = Path(path)
    whole, torn = read_log(file, _PATIENCE)
    lines = _parsed(file, whole)
    if torn and (last := _fitting(torn, lines)):
        lines.append(last)  # whole but for the end of its line
    return lines


def head_of(lines: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Tell how many lines a register has, and the hash of the last: who keeps both can tell whether any was lost."""
    return {"lines": len(lines), "head": lines[-1]["hash"] if lines else ""}


def check_witness(lines: Sequence[Mapping[str, Any]], witness: str | Path, path: str | Path) -> int:
    """Demand that a register holds every line that a witness saw of it; give the number of its notes on this register.

    A witness is a register of its own, kept by somebody else or elsewhere. It notes how many lines a register had, and
    the last one's hash. A chain of hashes alone cannot show that its end was cut off, or that an older copy was put
    back.
    """
    notes = [note for note in read_register(witness) if note.get("event") == WITNESS]
    mine = [note for note in notes if not lines or note["of"] == lines[0]["hash"]]
    if notes and not mine:
        raise ValueError(
            f"register {path} must be one that {witness} knows, got one that begins otherwise"
        )
    for note in mine:
        if note["lines"] > len(lines):
            raise ValueError(
                f"register {path} lacks line {len(lines) + 1}: it has {len(lines)}, and {witness} saw {note['lines']} "
                f"on {note['time']}"
            )
        if lines[note["lines"] - 1]["hash"] != note["head"]:
            raise ValueError(
                f"register {path} has another line {note['lines']} than {witness} saw on {note['time']}"
            )
    return len(mine)


def check_head(
    lines: Sequence[Mapping[str, Any]], told: Mapping[str, Any], path: str | Path, source: str
) -> None:
    """Demand that a register holds what a report says of it (:func:`head_of`); a ValueError names the line."""
    count = told["lines"]
    head = told["head"]
    if count > len(lines):
        raise ValueError(
            f"register {path} lacks line {len(lines) + 1}: it has {len(lines)}, and {source} tells {count}"
        )
    if count and lines[count - 1]["hash"] != head:
        raise ValueError(f"register {path} has another line {count} than {source} tells")


def _parsed(file: Path, texts: Sequence[bytes]) -> list[dict[str, Any]]:
    """Read lines, each of which must fit the one before."""
    lines: list[dict[str, Any]] = []
    for number, text in enumerate(texts, start=1):
        line = _fitting(text, lines)
        if line is None:
            raise ValueError(
                f"register {file} must be unaltered, got a line {number} that does not fit"
            )
        lines.append(line)
    return lines


def _fitting(text: bytes, lines: Sequence[Mapping[str, Any]]) -> dict[str, Any] | None:
    """Read a line if its hash is that of its content and it follows the line before; else None."""
    try:
        line = parse_json(text)
        body = {key: value for key, value in line.items() if key != "hash"}
        fits = line["hash"] == content_hash(body) and line["previous"] == (
            lines[-1]["hash"] if lines else ""
        )
    except (ValueError, AttributeError, KeyError, TypeError):
        return None
    return line if fits else None


def _finish_torn(file: Path, log: AppendLog, lines: list[dict[str, Any]]) -> None:
    """Put back a last line that lacks nothing but its end; tell of what was dropped of half a line."""
    if not log.torn:
        return
    last = _fitting(log.torn, lines)
    if last is not None:
        log.append(log.torn)
        lines.append(last)
        return
    warnings.warn(
        f"register {file}: {len(log.torn)} bytes of an unfinished line {len(lines) + 1} were dropped; nobody was told "
        "that it was entered",
        stacklevel=3,
    )


def before_opening(lines: Sequence[dict[str, Any]]) -> Sequence[dict[str, Any]]:
    """Take the lines of a register that were entered before anybody looked at a truth."""
    opened = (number for number, line in enumerate(lines) if line.get("event") == OPENED)
    return lines[: next(opened, len(lines))]


def read_book(book: Book) -> list[dict[str, Any]]:
    """Read a register, which must hold whatever its witness saw of it."""
    path, witness = parts_of(book)
    lines = read_register(path)
    if witness is not None:
        check_witness(lines, witness, path)
    return lines


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
        raise ValueError(
            f"recipe must be registered with its model in {path}, got {got} with the model {model}"
        )
    late = (
        f" in line {named[0]['number']}, after the look in line {len(early) + 1}" if named else ""
    )
    raise ValueError(
        f"recipe must be registered in {path} before the truth is opened, got {got}{late}"
    )


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
        raise ValueError(
            f"truth must be the survey in line {last['number']} of {path}, got what it replaced"
        )
    borders = list(last["lanes"].values())
    strange = [dict(one) for one in lanes.values() if dict(one) not in borders]
    if strange:
        raise ValueError(f"lane must be as planned in {path}, {borders}, got {strange[0]}")
    for name, value in rules.items():
        if last.get("rules", {}).get(name, value) != value:
            raise ValueError(
                f"{name} must be {last['rules'][name]:g} as planned in {path}, got {value:g}"
            )
