"""The folder of a trial: the requirement, and where lanes, truth, lists and verdict lie."""

from __future__ import annotations

import math
import os
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

from pydantic import Field

from flgpr.door import read_named
from flgpr.model.bounds import Entries, Positive
from flgpr.model.faults import parse_entries
from flgpr.store.files import existing, write_whole
from flgpr.store.outputs import atomic_output, log_finished, output_exists_error
from flgpr.toml_text import toml_lines
from flgpr_trials.ledger import TRIAL, read_register, register
from flgpr_trials.planning import mines_needed, sample_size

TRIAL_FILE = "trial.toml"
REGISTER_FILE = "register.jsonl"
USED_ROWS = ".used.csv"
"""Ending of the file with the rows of a list that are scored."""
_COMMENTS = {
    "halo": "m: an alarm within this distance of a mine finds it",
    "requirement": "what a detector has to show; registered, and the same until the verdict",
    "requirement.pd": "probability of detection",
    "requirement.far": "at so many false alarms per m²",
    "requirement.confidence": "with this confidence",
}
_EXAMPLE_LANE = {"x_min": -2.0, "x_max": 2.0, "y_min": 0.0, "y_max": 200.0}
_EXAMPLE_SORTS = (("metal", 0.05), ("metal", 0.15), ("plastic", 0.05), ("plastic", 0.15))
_LONGEST_NAME = 60  # characters of a file's name


class Requirement(Entries):
    """What a detector has to show."""

    pd: Annotated[float, Field(gt=0, lt=1)]
    far: Positive  #: at this false alarm rate, per m²
    confidence: Annotated[float, Field(gt=0.5, lt=1)]  #: one-sided

    def in_words(self) -> str:
        """Return what is to be shown."""
        return f"Pd >= {self.pd:g} with {100 * self.confidence:g} % confidence"

    def least_mines(self) -> int:
        """Return how many mines it takes at least, if none is missed."""
        return mines_needed(self.pd, 0, self.confidence)


class TrialEntries(Entries):
    """Content of ``trial.toml``."""

    halo: Positive  #: m
    requirement: Requirement


@dataclass(frozen=True)
class SignedList:
    """An alarm list that a person signed, as the register holds it."""

    vendor: str
    path: Path  #: the list as the vendor sent it
    line: dict[str, Any]  #: of the register


@dataclass(frozen=True)
class TrialFolder:
    """A trial that is under way."""

    home: Path
    entries: TrialEntries

    @property
    def lanes(self) -> Path:
        """The lanes (TOML)."""
        return self.home / "lanes.toml"

    @property
    def sealed(self) -> Path:
        """The sealed truth."""
        return self.home / "truth.sealed"

    @property
    def register(self) -> Path:
        """The register of requirement, plan, lists and looks."""
        return self.home / REGISTER_FILE

    def list_path(self, vendor: str) -> Path:
        """Return where a vendor's list is kept."""
        name = re.sub(r"\W+", "-", vendor.casefold()).strip("-")[:_LONGEST_NAME]
        return self.home / "lists" / f"{name or 'list'}.csv"

    def own_list_path(self, vendor: str, lines: Sequence[dict[str, Any]]) -> Path:
        """Return where a vendor's list is kept; refuse a name that would be kept as another's."""
        path = self.list_path(vendor)
        for other in self.signed_lists(lines):
            if other.path == path and other.vendor != vendor:
                raise ValueError(
                    f"vendor must differ from {other.vendor!r} in letters or digits, got {vendor!r}"
                )
        return path

    def signed_lists(self, lines: Sequence[dict[str, Any]]) -> list[SignedList]:
        """Return the last list that was signed of every vendor, by their names."""
        last = {line["vendor"]: line for line in lines if line.get("event") == "list"}
        names = sorted(last, key=str.casefold)
        return [SignedList(name, self.list_path(name), last[name]) for name in names]


def used_rows(list_path: Path) -> Path:
    """Return where the rows of a list that are scored are kept, in flgpr's own form."""
    return list_path.with_suffix(USED_ROWS)


def write_changed(path: Path, data: bytes) -> bool:
    """Write a file unless it holds this already; return whether it was written."""
    if path.is_file() and read_named(path) == data:
        return False
    write_whole(path, data)
    return True


def begin_trial(
    home: Path,
    requirement: Mapping[str, float],
    halo: float,
    borders: Mapping[str, Mapping[str, float]] | None = None,
) -> TrialFolder:
    """Write the folder of a trial, and register the requirement.

    Parameters
    ----------
    home : Path
        The folder. One that holds this trial already is left as it is.
    requirement : mapping
        ``pd``, ``far`` (per m²) and ``confidence``.
    halo : float
        Halo radius, m.
    borders : mapping of str to mapping, optional
        Borders of the lanes by name, m; by default an example.

    Returns
    -------
    TrialFolder
        The trial.

    Raises
    ------
    ValueError
        If a number is out of range.
    FileExistsError
        If something else is there.
    """
    for name, value in {"halo": halo, **requirement}.items():
        if not math.isfinite(value):  # TOML of ours has no such number
            raise ValueError(f"{name} must be finite, got {value}")
    stated = _toml({"halo": float(halo), "requirement": dict(requirement)}, _COMMENTS)
    entries = parse_entries(TrialEntries, stated, "trial")
    if os.path.lexists(home):
        if (home / TRIAL_FILE).is_file() and open_trial(home).entries == entries:
            log_finished(home, "choose another folder for another trial")
            return open_trial(home)
        raise output_exists_error(home, "choose another folder")
    wanted = entries.requirement
    mines = sample_size(wanted.pd, wanted.far, wanted.confidence).mines
    lanes = dict(borders or {"": _EXAMPLE_LANE})
    with atomic_output(home) as partial:
        partial.mkdir()
        contents = {
            TRIAL_FILE: stated,
            "lanes.toml": _toml(lanes.get("", lanes), {}),
            "sorts.csv": _sorts_text(mines),
            "README.md": _readme(entries, mines),
        }
        for name, text in contents.items():
            (partial / name).write_text(text, encoding="utf-8", newline="\n")
        register(partial / REGISTER_FILE, event=TRIAL, **entries.model_dump())
    return TrialFolder(home, entries)


def _toml(table: Mapping[str, Any], comments: Mapping[str, str]) -> str:
    """Return a table as the text of a TOML file."""
    return "\n".join(toml_lines(table, comments)) + "\n"


def open_trial(home: Path) -> TrialFolder:
    """Read the folder of a trial, whose requirement must be the one that was registered.

    Parameters
    ----------
    home : Path
        The folder.

    Returns
    -------
    TrialFolder
        The trial.

    Raises
    ------
    FileNotFoundError
        If there is no ``trial.toml``.
    ValueError
        If it is not valid, or differs from the register's first line.
    """
    path = existing(home / TRIAL_FILE, "trial file")
    entries = parse_entries(TrialEntries, read_named(path), str(path))
    trial = TrialFolder(home, entries)
    lines = read_register(existing(trial.register, "register"))
    stated = entries.model_dump()
    if not lines or any(lines[0].get(name) != value for name, value in stated.items()):
        raise ValueError(
            f"{path}: requirement and halo must be those registered in line 1 of "
            f"{trial.register}, got others: flgpr trial new begins another trial"
        )
    return trial


def trial_register(neighbour: Path) -> Path | None:
    """Return the register of the trial in whose folder a file lies, or is to lie; else None."""
    path = neighbour.resolve().with_name(REGISTER_FILE)
    return path if path.is_file() and path.with_name(TRIAL_FILE).is_file() else None


def require_trial_rules(
    lines: Sequence[dict[str, Any]], rules: Mapping[str, float], path: Path
) -> None:
    """Refuse rules, ``halo`` or ``far``, other than those with which a trial's register begins."""
    if not lines or lines[0].get("event") != TRIAL:
        return
    stated = {"halo": lines[0]["halo"], **lines[0]["requirement"]}
    for name, value in rules.items():
        if value != stated[name]:
            raise ValueError(
                f"{name} must be {stated[name]} as the trial of {path} asks for, got {value}"
            )


def too_few_mines(neighbour: Path, count: int) -> str:
    """Return in words that so many mines cannot show what a trial asks for; "" where they can.

    The trial is the one in whose folder ``neighbour`` lies; outside of one nothing is asked for.
    """
    path = trial_register(neighbour)
    if path is None:
        return ""
    wanted = Requirement(**read_register(path)[0]["requirement"])
    least = wanted.least_mines()
    if count >= least:
        return ""
    return (
        f"{count} mines are too few: {wanted.in_words()} takes {least} without a miss, "
        "so that no detector can show it"
    )


def _sorts_text(mines: int) -> str:
    """Return a table of as many mines as a test needs, of sorts that are to be changed."""
    rows = ["kind,depth,count"]
    for number, (kind, depth) in enumerate(_EXAMPLE_SORTS):
        share, rest = divmod(mines, len(_EXAMPLE_SORTS))
        rows.append(f"{kind},{depth},{share + (number < rest)}")
    return "\n".join(rows) + "\n"


def _readme(entries: TrialEntries, mines: int) -> str:
    """Return the next commands."""
    wanted = entries.requirement
    # Numbers in full: plans with rounded ones are refused.
    rule = f" --halo {entries.halo}" if entries.halo != 1 else ""
    return f"""# Trial

To show: {wanted.in_words()} at {wanted.far:g} false alarms per m². It takes {mines} mines without a miss.

1. Put the borders of your lanes into `lanes.toml`, kinds, depths (m) and counts of the mines into `sorts.csv`.
2. `flgpr plan lane lanes.toml sorts.csv -o plan.csv{rule} --far {wanted.far}`: print `plan.html` for the crew.
3. `flgpr plan survey plan.csv plan-sheet.csv -o truth.csv`, when the crew has filled in the sheet.
4. `flgpr seal truth.csv --lane lanes.toml -o truth.sealed{rule}`. Then move `plan*` and `truth.csv` away.
5. `flgpr trial intake . "ACME" acme.csv` for every list: look at the page, then again with `--signed "Your Name"`.
6. `flgpr trial verdict .` opens the truth, and writes `verdict.html` and `verdict.pdf`.
"""
