"""Verdicts and notes of an analyst on the alarms of results: one JSON file, beside the results and never in them."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from flgpr.door import parse_json, read_named
from flgpr.store.files import existing

VERDICTS = ("mine", "unsure", "clutter")
VERDICTS_FORMAT = "flgpr-notes"
VERDICTS_VERSION = 1
MOST_VERDICT_BYTES = 16 * 2**20
_KEY = ("result_sha256", "result", "detection", "alarm_id")
_MOST_TEXT = 500


def read_verdicts(path: str | Path) -> list[dict[str, Any]]:
    """Read the notes of a file that the viewer wrote or saved; what is none is a ValueError that names it.

    A note has the ``result``, its title, and ``result_sha256``, its identity, ``detection``, ``alarm_id``, the alarm's
    ``x`` and ``y`` (m), ``verdict`` ("mine", "unsure", "clutter" or none, "") and ``text``.
    """
    place = existing(path, "verdicts")
    return parse_verdicts(read_named(place, MOST_VERDICT_BYTES), place)


def parse_verdicts(data: bytes, path: Path) -> list[dict[str, Any]]:
    """Read the notes in the bytes of a file, which errors name."""
    try:
        return check_verdicts(parse_json(data))
    except ValueError as error:
        raise ValueError(f"{path}: not verdicts of flgpr view ({error})") from None


def verdict_bytes(notes: list[dict[str, Any]]) -> bytes:
    """Write notes as such a file."""
    whole = {"format": VERDICTS_FORMAT, "version": VERDICTS_VERSION, "notes": notes}
    return json.dumps(whole, indent=1, allow_nan=False).encode() + b"\n"


def check_verdicts(told: Any) -> list[dict[str, Any]]:
    """Take the notes out of what a file or a page says; a ValueError names the rule that it breaks."""
    if not isinstance(told, dict) or (told.get("format"), told.get("version")) != (
        VERDICTS_FORMAT,
        VERDICTS_VERSION,
    ):
        raise ValueError(f"format must be {VERDICTS_FORMAT} version {VERDICTS_VERSION}")
    notes = told.get("notes")
    if not isinstance(notes, list):
        raise ValueError("notes must be a list")
    checked = [_checked(one, number) for number, one in enumerate(notes)]
    if len({verdict_key(one) for one in checked}) < len(checked):
        raise ValueError("notes must name every alarm once")
    return checked


def verdict_key(note: dict[str, Any]) -> tuple[str, str, str]:
    """Tell which alarm a note is on: result by its identity, else by its title, detection and alarm."""
    return note["result_sha256"] or note["result"], note["detection"], note["alarm_id"]


def _checked(note: Any, number: int) -> dict[str, Any]:
    if not isinstance(note, dict):
        raise ValueError(f"notes[{number}] must be an object")
    text = {name: note.get(name, "") for name in (*_KEY, "verdict", "text")}
    wrong = next((name for name, value in text.items() if not isinstance(value, str)), None)
    if wrong is not None or not text["alarm_id"]:
        raise ValueError(f"notes[{number}].{wrong or 'alarm_id'} must be text")
    if text["verdict"] not in (*VERDICTS, ""):
        raise ValueError(
            f"notes[{number}].verdict must be {', '.join(VERDICTS)} or empty, got {text['verdict']!r}"
        )
    place = {name: note.get(name) for name in ("x", "y")}
    if not all(
        one is None or (isinstance(one, int | float) and abs(one) < 1e9) for one in place.values()
    ):
        raise ValueError(f"notes[{number}] must have x and y in metres")
    own = {name: text[name] for name in _KEY}
    return {**own, **place, "verdict": text["verdict"], "text": text["text"][:_MOST_TEXT]}
