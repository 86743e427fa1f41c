"""``flgpr trial``: a test from plan to verdict in one folder."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from typer import Argument, Option

from flgpr.commands.options import Overwrite, PathLike, lane_option
from flgpr.commands.score_options import Columns, ListAnchor, Passphrase, Unranked
from flgpr.commands.shell import Arguments, command

if TYPE_CHECKING:
    from flgpr_trials.commands.taking_in import Intake
    from flgpr_trials.folder import TrialFolder
    from flgpr_trials.verdict import Verdict

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
    pd_claim: Annotated[float, Option("--pd", help="Probability of detection to be shown.")] = 0.9,
    far: Annotated[float, Option(help="At this false alarm rate, per m².")] = 0.05,
    confidence: Annotated[float, Option(help="With this confidence.")] = 0.95,
    halo: Annotated[float, Option(help="Halo radius, m.")] = 1.0,
    lane: Annotated[PathLike | None, lane_option("or of several; an example by default")] = None,
) -> TrialFolder:
    """Begin a trial: write its folder, and register what a detector has to show.

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
    }


@command(
    lines=_intake_lines,
    as_json=_intake_json,
    panels={"How the list is read": ("columns", "anchor", "unranked", "unit")},
)
def trial_intake(
    home: Folder,
    vendor: Annotated[str, Argument(help="Whose list it is.")],
    alarms: Annotated[PathLike, Argument(help="The list (CSV).")],
    signed: Annotated[
        str | None, Option(help="Name of the person who has looked at the page and signs the list.")
    ] = None,
    columns: Columns = None,
    anchor: ListAnchor = None,
    unranked: Unranked = False,
    unit: Annotated[
        str | None, Option(help="Unit of x and y where the header states none: m, ft, cm, ...")
    ] = None,
) -> Intake:
    """Show a vendor's list before it is scored, and register it once a person signs it.

    No truth is opened.

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
    """
    from flgpr.commands.positions import table_reading
    from flgpr.store.dialects import TableReading
    from flgpr_trials.commands.taking_in import IntakeOrder, take_in

    reading = table_reading(columns, anchor, unranked) or TableReading()
    return take_in(IntakeOrder(Path(home), vendor, Path(alarms), reading, unit, signed))


def _verdict_lines(verdict: Verdict | None, call: Arguments) -> Iterator[Any]:
    """Yield the verdict and where its pages are."""
    if verdict is not None:
        yield verdict.in_words()
        for name in ("verdict.html", "verdict.pdf"):
            yield f"page: {(Path(call.home) / name).resolve()}"


def _verdict_json(_: Verdict | None, call: Arguments) -> Any:
    """Return the JSON that was written."""
    from flgpr.door import Folder as UntrustedFolder

    return UntrustedFolder(Path(call.home)).json("verdict.json")


def _passphrase(_: Arguments) -> dict[str, Any]:
    """Return the function that asks for the passphrase."""
    from flgpr_trials.commands.scores import ask_passphrase

    return {"passphrase": ask_passphrase}


@command(lines=_verdict_lines, as_json=_verdict_json, python_values=_passphrase)
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
