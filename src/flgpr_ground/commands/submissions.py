"""``flgpr benchmark`` for what is made elsewhere: lanes and submissions."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from flgpr.commands.options import OptionalOutput, Output, PathLike, Paths, Progress, Scheduler
from flgpr.commands.runs import run_options
from flgpr.commands.shell import Arguments, command
from flgpr_ground.commands.benchmark import Chosen, Quick, Tier, Workers

if TYPE_CHECKING:
    from flgpr.proving_ground import Submission
    from flgpr.types import Entries

Submissions = Annotated[
    Paths, "Folders of submissions: submission.toml, and SPLIT/LANE/alarms.csv."
]
OwnGround = Annotated[
    PathLike | None,
    "TOML of a ground of one's own; by default the card names a packaged one.",
]
_BROKEN = 2  # exit status, as of other input that breaks a rule


def _folder_lines(folder: Path, _: Arguments) -> Iterator[Any]:
    """Yield where the lanes are."""
    yield f"lanes: {(folder / 'lanes').resolve()}"


@command(lines=_folder_lines, resumes=True)
def make_benchmark(
    output: Output = Path("proving-ground"),
    quick: Quick = False,
    ground: Chosen = None,
    tier: Tier = None,
    workers: Workers = None,
    scheduler: Scheduler = None,
    *,
    track: Progress = None,
) -> Path:
    """Make the lanes and seal the truth of those that are tested on; no detector runs.

    Parameters
    ----------
    output
        folder of the ground

    Returns
    -------
    Path
        The folder. ``lanes`` has runs, borders, open truth, sealed truth and fingerprints.
    """
    from flgpr import proving_ground

    options = run_options(workers, scheduler, track=track)
    return proving_ground.make_ground(output, quick, options, ground, tier)


def _fault_lines(checked: list[Submission], _: Arguments) -> Iterator[str]:
    """Yield every fault and note of every submission, and what it holds."""
    for submission in checked:
        where = submission.folder
        yield from (f"{where}/{fault}" for fault in submission.faults)
        yield from (f"note: {where}/{note}" for note in submission.notes)
        count = len(submission.faults)
        if count:
            yield f"{where}: {count} {'fault' if count == 1 else 'faults'}"
            continue
        alarms = sum(map(len, submission.alarms.values()))
        lanes = sum(map(len, submission.lanes.values()))
        yield (
            f"{where}: {submission.name} is valid: {alarms} alarms in {lanes} lists of lanes; "
            f"splits {', '.join(submission.alarms)}"
        )


def _fault_object(checked: list[Submission], _: Arguments) -> Entries:
    """Return one object of JSON with every submission."""
    objects = []
    for submission in checked:
        objects.append(
            {
                "folder": str(submission.folder),
                "name": submission.name,
                "valid": not submission.faults,
                "faults": list(submission.faults),
                "notes": list(submission.notes),
                "alarms": {split: len(table) for split, table in submission.alarms.items()},
            }
        )
    return {"submissions": objects}


@command(
    lines=_fault_lines,
    as_json=_fault_object,
    status=lambda checked: _BROKEN if any(one.faults for one in checked) else 0,
    quiet=False,
)
def validate_submissions(submissions: Submissions, ground: OwnGround = None) -> list[Submission]:
    """Check submissions: all faults at once, and nothing is scored.

    Returns
    -------
    list of Submission
        Every submission with its card, alarms, faults and notes.
    """
    from flgpr import proving_ground

    return [proving_ground.check_submission(folder, ground) for folder in submissions]


def _entered_lines(text: str, call: Arguments) -> Iterator[Any]:
    """Yield the table of the scores, what was entered, and the address of the page."""
    yield text
    yield f"entered: {', '.join(map(str, call.submissions))}"
    yield f"page: {(Path(call.output) / 'leaderboard.html').resolve()}"


@command(lines=_entered_lines)
def enter_benchmark(
    submissions: Submissions,
    output: Output = Path("proving-ground"),
    ground: OwnGround = None,
) -> str:
    """Score submissions on the sealed truth, once, and write the leaderboard. The look is logged.

    Parameters
    ----------
    output
        folder of the ground, of `run`, `make` or a new one

    Returns
    -------
    str
        The table of the scores.
    """
    from flgpr import proving_ground

    return proving_ground.enter_submissions(submissions, output, ground)


@command()
def benchmark_leaderboard(
    folders: Paths,
    output: OptionalOutput = None,
) -> Path:
    """Write the leaderboard from files: submissions beside the packaged entries.

    Parameters
    ----------
    folders
        Folders of `flgpr benchmark enter` or `run`, of one ground.
    output
        HTML file, by default leaderboard.html in the first

    Returns
    -------
    Path
        The page.
    """
    from flgpr import proving_ground

    target = output or Path(folders[0]) / "leaderboard.html"
    return proving_ground.write_leaderboard(folders, target)
