"""Verdicts and notes of an analyst on the alarms of results, in a JSON file outside the results."""

from __future__ import annotations

import json
from operator import itemgetter
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BaseModel, ConfigDict, Field

from flgpr.door import read_named
from flgpr.json_text import check_format, parse_json
from flgpr.model.faults import first_fault_of
from flgpr.store.files import existing

VERDICTS = ("mine", "unsure", "clutter")
VERDICTS_FORMAT = "flgpr-notes"
VERDICTS_VERSION = 1
MOST_VERDICT_BYTES = 16 * 2**20
_FARTHEST = 1e9  # coordinate of an alarm, m
_Coordinate = Annotated[float, Field(gt=-_FARTHEST, lt=_FARTHEST, allow_inf_nan=False)]


class _Verdict(BaseModel):
    """A note on an alarm; entries that are not known are left out."""

    model_config = ConfigDict(strict=True, allow_inf_nan=False)

    result_sha256: str = ""
    result: str = ""
    detection: str = ""
    alarm_id: Annotated[str, Field(min_length=1)]
    x: _Coordinate | None = None  #: m; None where it is unknown
    y: _Coordinate | None = None
    verdict: Literal["mine", "unsure", "clutter", ""] = ""
    text: Annotated[str, AfterValidator(itemgetter(slice(500)))] = ""


class _Verdicts(BaseModel):
    notes: list[_Verdict]


def read_verdicts(path: str | Path) -> list[dict[str, Any]]:
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
    with first_fault_of(_Verdicts):
        notes = _Verdicts.model_validate(content).notes
    checked = [note.model_dump() for note in notes]
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
