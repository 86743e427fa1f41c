"""``flgpr trial``: a test from plan to verdict in one folder."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from typer import Argument, Option

from flgpr.commands.options import LaneOption, Overwrite, PathLike
from flgpr.commands.score_request import Columns, ListAnchor, Passphrase, Unranked
from flgpr.commands.shell import Arguments, command

if TYPE_CHECKING:
    from flgpr_trials.folder import TrialFolder
    from flgpr_trials.intake import Intake
    from flgpr_trials.verdict import Verdict

_TOO_LATE = "a list must be taken in before the truth is opened; the register tells of an opening"
Folder = Annotated[PathLike, Argument(metavar="DIR", help="Folder of the trial.")]


def _new_lines(trial: TrialFolder, _: Arguments) -> Iterator[Any]:
    """Yield the folder, and what comes next."""
    yield trial.home
    wanted = trial.entries.requirement
    yield f"to show: {wanted.in_words()} at {wanted.far:g} false alarms per m²"
    yield f"next: {trial.home / 'README.md'} has the commands, from plan to verdict"


@command(lines=_new_lines)
def trial_new(
    home: Folder,
    pd_claim: Annotated[float, Option("--pd")] = 0.9,
    far: float = 0.05,
    confidence: float = 0.95,
    halo: float = 1.0,
    lane: LaneOption = None,
) -> TrialFolder:
    """Begin a trial: write its folder, and register what a detector has to show.

    Parameters
    ----------
    far
        At this false alarm rate, per m².
    confidence
        With this confidence.
    halo
        Halo radius, m.
    lane
        or of several; an example by default
    pd_claim
        Probability of detection to be shown.

    Returns
    -------
    TrialFolder
        The trial.

    Raises
    ------
    ValueError
        If a number is out of range, or the lanes are not valid.
    FileExistsError
        If something else is there.
    """
    from flgpr.commands.scoring import borders, read_lanes
    from flgpr_trials.folder import begin_trial

    requirement = {"pd": pd_claim, "far": far, "confidence": confidence}
    lanes = None if lane is None else borders(read_lanes(lane))
    return begin_trial(Path(home), requirement, halo, lanes)


def _intake_lines(intake: Intake, _: Arguments) -> Iterator[Any]:
    """Yield the sentence, what is doubtful, the page, and whether the list is signed."""
    yield f"{intake.read.in_words()}."
    for doubt in intake.read.doubts:
        yield f"  {doubt}."
    yield f"page: {intake.page.resolve()}"
    if intake.replaced is not None:
        before = intake.replaced
        yield f"it takes the place of the list that {before['signed']} signed, line {before['number']}"
    if intake.line is None:
        yield 'not signed: look at the page, then give the command again with --signed "Your Name"'
    else:
        yield f"signed by {intake.line['signed']}, line {intake.line['number']} of the register"


def _intake_json(intake: Intake, _: Arguments) -> dict[str, Any]:
    """Return counts, dropped rows, doubts and the signature."""
    read = intake.read
    return {
        "vendor": read.vendor,
        "rows": read.count,
        "used": len(read.used),
        "dropped": [{"line": row.line, "reason": row.reason} for row in read.dropped],
        "doubts": read.doubts,
        "page": str(intake.page),
        "signed": None if intake.line is None else intake.line["signed"],
        "replaced_line": None if intake.replaced is None else intake.replaced["number"],
    }


@command(
    lines=_intake_lines,
    as_json=_intake_json,
)
def trial_intake(
    home: Folder,
    vendor: str,
    alarms: PathLike,
    signed: str | None = None,
    columns: Columns = None,
    anchor: ListAnchor = None,
    unranked: Unranked = False,
    unit: str | None = None,
) -> Intake:
    """Show a vendor's list before it is scored, and register it once a person signs it.

    No truth is opened.

    Parameters
    ----------
    vendor
        Whose list it is.
    alarms
        The list (CSV).
    signed
        Name of the person who has looked at the page and signs the list.

    How the list is read
    --------------------
    columns
    anchor
    unranked
    unit
        Unit of x and y where the header states none: m, ft, cm, ...

    Returns
    -------
    Intake
        What was read, the page, and the line of the register.

    Raises
    ------
    ValueError
        If the truth was opened, the file cannot be read, or what is signed is doubtful.
    FileNotFoundError
        If there is no such trial or list.

    Notes
    -----
    A list that is signed again takes the place of the one before.
    """
    from flgpr.commands.entrants import checked_name
    from flgpr.commands.positions import table_reading
    from flgpr.commands.scoring import borders, read_lanes
    from flgpr.door import read_named, refuse_links
    from flgpr.scoring import as_lanes
    from flgpr.store.dialects import TableReading
    from flgpr.store.files import existing
    from flgpr.store.outputs import log_finished
    from flgpr.store.writing import csv_text
    from flgpr_trials.folder import open_trial, used_rows, write_changed
    from flgpr_trials.intake import Intake, read_vendor_list
    from flgpr_trials.ledger import content_hash, enter_unopened, read_register, require_unopened
    from flgpr_trials.pages import intake_html

    reading = table_reading(columns, anchor, unranked) or TableReading()
    trial = open_trial(Path(home))
    vendor = checked_name(vendor)
    if signed is not None:
        signed = checked_name(signed, "signed")
    lines = read_register(trial.register)
    require_unopened(lines, _TOO_LATE)
    path = trial.own_list_path(vendor, lines)

    data = read_named(existing(alarms, "alarms file"))
    lanes = as_lanes(read_lanes(trial.lanes))
    planned = [line["lanes"] for line in lines if line.get("event") == "plan"]
    if planned and planned[-1] != borders(lanes):
        raise ValueError(
            f"lanes must be those of the plan in {trial.register}, got others in {trial.lanes}"
        )
    halo = trial.entries.halo
    read = read_vendor_list(data, Path(alarms).name, vendor, lanes, halo, reading, unit)
    if signed is not None:
        read.require_clear()
    used = csv_text(read.used)
    refuse_links(path.parent)
    path.parent.mkdir(exist_ok=True)
    is_new = write_changed(path, data)
    is_new |= write_changed(used_rows(path), used.encode())

    # The list itself is what fixes a detector's answer: scores ask for it as for a recipe.
    entry = {
        "event": "list",
        "vendor": vendor,
        "file": read.file,
        "recipe": content_hash(data),
        "used": content_hash(used),
        "rows": [len(read.used), read.count],
    }
    if signed is not None:
        entry["signed"] = signed
    # The last list that a vendor's name was signed for counts, and it may be this one.
    before = [one.line for one in trial.signed_lists(lines) if one.vendor == vendor]
    line = replaced = before[0] if before else None
    if line is not None and entry.items() <= line.items():
        replaced = None
    else:
        line = None if signed is None else enter_unopened(trial.register, entry, _TOO_LATE)
    page = path.with_suffix(".html")
    html = intake_html(read, lanes, halo, read.facts(lanes, data), line)
    if not write_changed(page, html.encode()) and not is_new:
        log_finished(page, "another list of this vendor takes its place")
    return Intake(read, page, line, replaced)


def _verdict_lines(verdict: Verdict | None, call: Arguments) -> Iterator[Any]:
    """Yield the verdict and where its pages are."""
    yield _verdict_json(verdict, call)["verdict"]
    for name in ("verdict.html", "verdict.pdf"):
        yield f"page: {(Path(call.home) / name).resolve()}"


def _verdict_json(_: Verdict | None, call: Arguments) -> Any:
    """Return the JSON that was written."""
    from flgpr.door import Folder as UntrustedFolder

    return UntrustedFolder(Path(call.home)).json("verdict.json")


def _asked_passphrase() -> str:
    """Ask for the passphrase."""
    from flgpr_trials.commands.scores import ask_passphrase

    return ask_passphrase()


@command(
    lines=_verdict_lines,
    as_json=_verdict_json,
    python_values=lambda _: {"passphrase": _asked_passphrase},
)
def trial_verdict(
    home: Folder, overwrite: Overwrite = False, *, passphrase: Passphrase = None
) -> Verdict | None:
    """Open the sealed truth, score all signed lists at the registered rate, and write the verdict.

    Returns
    -------
    Verdict or None
        The verdict; None where this very verdict is there already.

    Raises
    ------
    ValueError
        If there is no signed list, one is not signed or was changed, or the passphrase is not the right one.
    FileNotFoundError
        If there is no trial or no sealed truth.
    """
    from flgpr_trials.commands.judging import give_verdict

    return give_verdict(Path(home), passphrase, overwrite)
