"""What a score states of its trial: vendor, file and day, in the notes of its report."""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import pandas as pd

from flgpr.commands.entrants import Entrant
from flgpr.door import MOST_JSON, Folder
from flgpr.json_text import parse_json

_HEAD_LINES = 50  # of an alarm list in which its comments are looked for
_HEAD_BYTES = 20_000
_LONGEST_VENDOR = 120  # characters
_VENDOR_COMMENT = re.compile(
    r"\s*#\s*(?:vendor|manufacturer|supplier|hersteller|fabricant)\s*[:=]\s*(?P<name>.+)",
    re.IGNORECASE,
)
UNRANKED = "none: the list has no confidences, so that all its alarms rank equal"


@dataclass(frozen=True)
class TrialCard:
    """What the user states of a trial; a score without it is of no trial."""

    vendors: tuple[str, ...] = ()  #: one for each alarm list, or none
    scored_on: str = ""  #: day of the score, ISO 8601; empty where it is not to be stated

    def notes(self, number: int, entrant: Entrant) -> dict[str, str]:
        """Return what the report of an alarm list states: vendor, file, and the day of the score.

        Parameters
        ----------
        number : int
            Which of the lists.
        entrant : Entrant
            The list. Its own comment ``# vendor: NAME`` counts where no vendor was named.
        """
        vendor = self.vendors[number] if self.vendors else stated_vendor(entrant)
        folder = f"{entrant.path.resolve().parent.name}/" if entrant.of_result else ""
        notes = {"vendor": vendor or "not stated", "alarms_file": folder + entrant.path.name}
        if self.scored_on:
            notes["scored_on"] = self.scored_on
        return notes


def checked_vendors(vendors: Sequence[str], lists: int) -> tuple[str, ...]:
    """Return the names of vendors, one for each alarm list, or none.

    A name that is empty, long or of several lines is a ValueError.
    """
    if vendors and len(vendors) != lists:
        raise ValueError(
            f"vendor must be given once per alarm list, got {len(vendors)} for {lists} lists"
        )
    return tuple(checked_name(name) for name in vendors)


def checked_name(name: str, what: str = "vendor") -> str:
    """Return the name of a vendor or a person without spaces around it; no name is a ValueError."""
    stripped = name.strip()
    if not stripped or len(stripped) > _LONGEST_VENDOR or not _is_one_line(stripped):
        raise ValueError(
            f"{what} must be a name of 1 to {_LONGEST_VENDOR} characters in one line, got {name!r}"
        )
    return stripped


def _is_one_line(text: str) -> bool:
    """Return whether a text has no control characters and no marks that change its direction."""
    return all(unicodedata.category(letter) not in ("Cc", "Cf", "Zl", "Zp") for letter in text)


def stated_vendor(entrant: Entrant) -> str:
    """Return the vendor that a comment at the head of an alarm list names; "" if none does.

    Such a comment is ``# vendor: NAME``. A list of a result has no comments.
    """
    head = entrant.data[:_HEAD_BYTES].decode("utf-8-sig", errors="replace")
    for line in head.splitlines()[:_HEAD_LINES]:
        if line.strip() and not line.lstrip().startswith("#"):
            return ""
        comment = _VENDOR_COMMENT.fullmatch(line)
        if comment is not None:
            return checked_name(comment["name"].rstrip(",;\t "))
    return ""


def ranking_notes(alarms: pd.DataFrame) -> dict[str, str]:
    """Return a note that an alarm list has no ranks, for its report; none where it has."""
    return {"ranking": UNRANKED} if alarms.attrs.get("unranked") else {}


def day_of_score(folder: Path, report: str, overwrite: bool) -> str:
    """Return the day that a score states: today (UTC), or that of the score that is there already.

    The same score made on a later day is then the same to the byte, and nothing is written.

    Parameters
    ----------
    folder : Path
        Where the score is written.
    report : str
        Its JSON, "roc.json" or "comparison.json".
    overwrite : bool
        Whether the score is made anew.

    Returns
    -------
    str
        The day, ISO 8601.
    """
    today = datetime.now(UTC).date().isoformat()
    if overwrite or not (folder / report).is_file():
        return today
    try:
        notes = parse_json(Folder(folder).read(report, MOST_JSON))["notes"]
        stated = [
            of_list["scored_on"] for of_list in notes_of_lists(notes) if "scored_on" in of_list
        ]
        return datetime.strptime([*stated, today][0], "%Y-%m-%d").date().isoformat()
    except (OSError, ValueError, KeyError, TypeError, AttributeError):
        return today


def notes_of_lists(notes: Mapping[str, Any]) -> list[Mapping[str, Any]]:
    """Return the notes of a report's one alarm list, or those of several, which stand by name."""
    return [notes, *(value for value in notes.values() if isinstance(value, dict))]
