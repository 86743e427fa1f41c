"""Intake of alarm lists into the folder of a trial: files in, a page and a line of the register out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from flgpr.commands.scoring import borders, read_lanes
from flgpr.commands.trial_card import checked_name
from flgpr.door import read_named, refuse_links
from flgpr.model import Lane
from flgpr.scoring import as_lanes
from flgpr.store.dialects import TableReading
from flgpr.store.files import existing, write_whole
from flgpr.store.outputs import log_finished
from flgpr.store.tables import csv_text
from flgpr_trials.folder import TrialFolder, open_trial, used_rows
from flgpr_trials.intake import ReadList, read_vendor_list
from flgpr_trials.ledger import content_hash, enter_unopened, read_register, require_unopened
from flgpr_trials.pages import intake_html

_TOO_LATE = "a list must be taken in before the truth is opened; the register tells of an opening"


@dataclass(frozen=True)
class IntakeOrder:
    """A list that is taken in, how it is read, and who signs it."""

    home: Path  #: folder of the trial
    vendor: str
    alarms: Path  #: the list (CSV)
    reading: TableReading = field(default_factory=TableReading)
    unit: str | None = None  #: of x and y, where the header states none
    signed: str | None = None  #: name of the person who has looked at the page


@dataclass(frozen=True)
class Intake:
    """A list that was taken in."""

    read: ReadList
    page: Path
    line: dict[str, Any] | None  #: of the register; None where nobody signed


def take_in(order: IntakeOrder) -> Intake:
    """Keep a vendor's list in the folder of a trial, show it, and register it if it is signed.

    No truth is opened. A list that is signed again takes the place of the one before.

    Returns
    -------
    Intake
        What was read, the page, and the line of the register.

    Raises
    ------
    ValueError
        If the truth was opened, a name is not valid, the file cannot be read, or a list is signed
        of which no row is used or whose unit is doubtful.
    FileNotFoundError
        If there is no such trial or list.
    """
    trial = open_trial(order.home)
    vendor = checked_name(order.vendor)
    signed = None if order.signed is None else checked_name(order.signed, "signed")
    lines = read_register(trial.register)
    require_unopened(lines, _TOO_LATE)
    path = trial.list_path(vendor)
    _require_own_file(trial, lines, vendor, path)

    data = read_named(existing(order.alarms, "alarms file"))
    lanes = as_lanes(read_lanes(trial.lanes))
    planned = [line["lanes"] for line in lines if line.get("event") == "plan"]
    if planned and planned[-1] != borders(lanes):
        raise ValueError(
            f"lanes must be those of the plan in {trial.register}, got others in {trial.lanes}"
        )
    name = order.alarms.name
    read = read_vendor_list(
        data, name, vendor, lanes, trial.entries.halo, order.reading, order.unit
    )
    if signed is not None:
        _require_clear(read)
    used = csv_text(read.used)
    refuse_links(path.parent)
    path.parent.mkdir(exist_ok=True)
    kept = [_write_changed(path, data), _write_changed(used_rows(path), used.encode())]
    line = None
    if signed is not None:
        # The list itself is what fixes a detector's answer: scores ask for it as for a recipe.
        entry = {
            "event": "list",
            "vendor": vendor,
            "file": name,
            "recipe": content_hash(data),
            "used": content_hash(used),
            "rows": [len(read.used), read.count],
            "signed": signed,
        }
        same = [earlier for earlier in lines if entry.items() <= earlier.items()]
        line = same[-1] if same else enter_unopened(trial.register, entry, _TOO_LATE)
    page = path.with_suffix(".html")
    facts = _facts(read, lanes, name, data)
    html = intake_html(read, lanes, trial.entries.halo, facts, line)
    if not any([*kept, _write_changed(page, html.encode())]):
        log_finished(page, "another list of this vendor takes its place")
    return Intake(read, page, line)


def _write_changed(path: Path, data: bytes) -> bool:
    """Write a file unless it holds this already; return whether it was written."""
    if path.is_file() and read_named(path) == data:
        return False
    write_whole(path, data)
    return True


def _require_own_file(
    trial: TrialFolder, lines: Sequence[dict[str, Any]], vendor: str, path: Path
) -> None:
    """Refuse a vendor whose list would be kept under the name of another one's."""
    for other in trial.signed_lists(lines):
        if other.path == path and other.vendor != vendor:
            raise ValueError(
                f"vendor must differ from {other.vendor!r} in letters or digits, got {vendor!r}"
            )


def _require_clear(read: ReadList) -> None:
    """Refuse to sign a list of which no row is used, or that seems to be in another unit."""
    if read.unit:
        raise ValueError(
            f"a list must be in metres of the lane to be signed: {read.in_words()}; "
            f"{read.doubts[0]}"
        )
    if not len(read.used):
        raise ValueError(f"a list must have a row that is used to be signed: {read.in_words()}")


def _facts(read: ReadList, lanes: dict[str, Lane], name: str, data: bytes) -> dict[str, str]:
    """Return what the page states of a file."""
    facts = {
        "vendor": read.vendor,
        "file": f"{name}, {len(data)} bytes",
        "SHA-256": content_hash(data),
        "rows": f"{read.count}, {len(read.used)} used, {len(read.dropped)} not",
    }
    if len(read.rows):
        for axis in ("x", "y", "confidence"):
            values = read.rows[axis]
            unit = "" if axis == "confidence" else " m"
            facts[axis] = f"{values.min():.6g} to {values.max():.6g}{unit}"
    area = sum(lane.area for lane in lanes.values())
    facts["density"] = f"{len(read.used) / area:.3g} alarms per m² of {area:g} m² of lane"
    return facts
