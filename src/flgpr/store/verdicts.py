"""Verdicts and notes of an analyst on the alarms of results, in a JSON file outside the results."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from flgpr.door import read_named
from flgpr.json_text import check_format, parse_json
from flgpr.store.files import existing
from flgpr.types import PathLike

VERDICTS = ("mine", "unsure", "clutter")
VERDICTS_FORMAT = "flgpr-notes"
VERDICTS_VERSION = 1
MOST_VERDICT_BYTES = 16 * 2**20
_KEY = ("result_sha256", "result", "detection", "alarm_id")
_MOST_TEXT = 500  # characters of an analyst's text
_FARTHEST = 1e9  # coordinate of an alarm, m


def read_verdicts(path: PathLike) -> list[dict[str, Any]]:
    """Read the notes of a file that the viewer wrote or saved.

    Parameters
    ----------
    path : str or Path
        The file.

    Returns
    -------
    list of dict
        A note has ``result``, the title of a result, and ``result_sha256``, its identity;
        ``detection`` and ``alarm_id``; ``x`` and ``y`` of the alarm, m; ``verdict``, which is
        "mine", "unsure", "clutter" or empty; and ``text``.

    Raises
    ------
    FileNotFoundError
        If there is no file.
    ValueError
        If it is no such file; the error names it.
    """
    file = existing(path, "verdicts")
    return parse_verdicts(read_named(file, MOST_VERDICT_BYTES), file)


def parse_verdicts(data: bytes, path: Path) -> list[dict[str, Any]]:
    """Read notes as :func:`read_verdicts` does, from the bytes of a file.

    Parameters
    ----------
    data : bytes
        Content of the file.
    path : Path
        The file, which errors name.

    Returns
    -------
    list of dict
        The notes.

    Raises
    ------
    ValueError
        If it is no such file.
    """
    try:
        return check_verdicts(parse_json(data))
    except ValueError as error:
        raise ValueError(f"{path}: not verdicts of `flgpr.view` ({error})") from None


def verdict_bytes(notes: list[dict[str, Any]]) -> bytes:
    """Return notes as the bytes of a file.

    Parameters
    ----------
    notes : list of dict
        Notes as of :func:`read_verdicts`.

    Returns
    -------
    bytes
        JSON, which :func:`parse_verdicts` reads.
    """
    content = {"format": VERDICTS_FORMAT, "version": VERDICTS_VERSION, "notes": notes}
    return json.dumps(content, indent=1, allow_nan=False).encode() + b"\n"


def check_verdicts(content: Any) -> list[dict[str, Any]]:
    """Return the checked notes in the content of a file or a message of the viewer's page.

    Parameters
    ----------
    content : JSON value
        Content of a file of verdicts, from anywhere.

    Returns
    -------
    list of dict
        The notes.

    Raises
    ------
    ValueError
        If the content breaks a rule, which the error names.
    """
    if not isinstance(content, dict):
        content = {}
    check_format(content, VERDICTS_FORMAT, VERDICTS_VERSION)
    notes = content.get("notes")
    if not isinstance(notes, list):
        raise ValueError("notes must be a list")
    checked = [_checked(note, number) for number, note in enumerate(notes)]
    alarms = {verdict_key(note) for note in checked}
    if len(alarms) < len(checked):
        raise ValueError("notes must name every alarm once")
    return checked


def verdict_key(note: dict[str, Any]) -> tuple[str, str, str]:
    """Return the alarm that a note is on.

    Parameters
    ----------
    note : dict
        A note as of :func:`read_verdicts`.

    Returns
    -------
    tuple of str
        The result by its identity, or by its title if that is unknown; the detection; the alarm.
    """
    return note["result_sha256"] or note["result"], note["detection"], note["alarm_id"]


def _checked(note: Any, number: int) -> dict[str, Any]:
    """Return the known entries of a note; ``number`` is its place in the list, for messages."""
    if not isinstance(note, dict):
        raise ValueError(f"notes[{number}] must be an object")
    text = {name: note.get(name, "") for name in (*_KEY, "verdict", "text")}
    for name, value in text.items():
        if not isinstance(value, str):
            raise ValueError(f"notes[{number}].{name} must be text")
    if not text["alarm_id"]:
        raise ValueError(f"notes[{number}].alarm_id must be text")
    if text["verdict"] not in (*VERDICTS, ""):
        raise ValueError(
            f"notes[{number}].verdict must be {', '.join(VERDICTS)} or empty, "
            f"got {text['verdict']!r}"
        )
    position = {name: note.get(name) for name in ("x", "y")}
    if not all(map(_is_coordinate, position.values())):
        raise ValueError(f"notes[{number}] must have x and y in metres")
    key = {name: text[name] for name in _KEY}
    return {**key, **position, "verdict": text["verdict"], "text": text["text"][:_MOST_TEXT]}


def _is_coordinate(value: Any) -> bool:
    """Return whether a value is a coordinate in metres, or None where it is unknown."""
    if value is None:
        return True
    return isinstance(value, int | float) and abs(value) < _FARTHEST
