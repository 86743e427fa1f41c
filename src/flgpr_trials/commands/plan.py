"""``flgpr plan``: plan a test, and keep its register."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from typer import Argument, Option

from flgpr.commands.options import AnchorOption, Output, PathLike, Paths, one_or_more
from flgpr.commands.shell import Arguments, command
from flgpr.commands.trials import REGISTER_COLUMN

if TYPE_CHECKING:
    import pandas as pd

    from flgpr.types import Entries
    from flgpr_trials.planning import SamplePlan


def _mines_lines(plan: SamplePlan, call: Arguments) -> Iterator[str]:
    """Yield the claims, the counts and, for a believed detector, its chance to show them."""
    confidence = f"{100 * call.confidence:g} % each"
    yield f"To show Pd >= {call.pd_claim:g} at FAR <= {call.far:g} per m² with {confidence}:"
    yield f"  {plan.mines} mines, of which at most {plan.misses} may be missed"
    # Rounded up: less ground would not show it.
    yield (
        f"  {math.ceil(plan.area)} m² of ground outside the halos, "
        f"with at most {plan.false_alarms} false alarms"
    )
    if call.true_pd is not None:
        yield f"  a detector with Pd {call.true_pd:g} shows it with probability {plan.pd_power:.2f}"
    if call.true_far is not None:
        yield (
            f"  a detector with FAR {call.true_far:g} per m² shows it with probability "
            f"{plan.far_power:.2f}"
        )


@command(lines=_mines_lines, quiet=False)
def plan_mines(
    pd_claim: Annotated[float, Option("--pd")] = 0.9,
    far: float = 0.01,
    confidence: float = 0.95,
    true_pd: float | None = None,
    true_far: float | None = None,
    *,
    power: float = 0.8,
    joint: bool = False,
) -> SamplePlan:
    """Return how many mines and how much ground it takes to show a performance.

    Parameters
    ----------
    far
        False alarms per m² to be shown.
    confidence
        Confidence of each claim.
    true_pd
        Pd the detector is believed to have.
    true_far
        FAR it is believed to have.
    power
        Probability with which the claim shall be shown.
    joint
        Whether the confidence is that of both claims together.
    pd_claim
        Probability of detection to be shown.

    Returns
    -------
    SamplePlan
        Counts and area, see :func:`flgpr.trials.sample_size`.

    Raises
    ------
    ValueError
        If a probability or a rate breaks its rule.
    """
    from flgpr_trials.planning import sample_size

    return sample_size(
        pd_claim, far, confidence, true_pd=true_pd, true_far=true_far, power=power, joint=joint
    )


def _lane_lines(returned: tuple[pd.DataFrame, Entries], call: Arguments) -> Iterator[str | Path]:
    """Yield the files, the seed and the time of the register line."""
    from flgpr_trials.folder import too_few_mines

    plan, line = returned
    yield from plan.attrs["written"]
    seed = plan.attrs["seed"]
    origin = "of a seed that was not kept" if seed is None else f"seed {seed}"
    yield f"{len(plan)} targets, {origin}; registered {line['time']}"
    if warning := too_few_mines(Path(call.output), len(plan)):
        yield warning
    yield (
        "keep these files and the seed from whoever runs a detector; "
        "the register is for all to read"
    )


@command(
    lines=_lane_lines,
)
def plan_lane(
    lane: PathLike,
    targets: PathLike,
    output: Output,
    seed: int | None = None,
    spacing: float = 3.0,
    edge: float = 0.5,
    recipe: str | None = None,
    book: PathLike | None = None,
    anchor: AnchorOption = None,
    halo: float = 1.0,
    far: float = 0.05,
) -> tuple[pd.DataFrame, dict[str, Any]]:
    """Draw an emplacement plan and register it with the rules of its scoring.

    The crew's page and sheet are written with it.

    Parameters
    ----------
    lane
        TOML or CSV of the lane or lanes.
    targets
        CSV with kind, depth (m) and count.

    Plan
    ----
    seed
        Seed to draw a plan again; who can guess it knows the plan. By default drawn, and printed.
    spacing
        Least distance between targets, m.
    edge
        Least distance to the lane's border, m.
    anchor
        adds GeoPackage and GPX

    Register
    --------
    recipe
        What fixes a detector, registered with the plan.
    book
        Register; beside the plan by default.
    halo
        Halo radius that scores must use, m.
    far
        Operating point that scores must use, false alarms per m².

    Returns
    -------
    plan, line
        The table, whose ``attrs`` have the seed and the files that were ``written``, and the line
        of the register.

    Raises
    ------
    ValueError
        If an input is not valid, one anchor is given for several lanes, or a truth was opened under
        the register; nothing is written then.
    FileExistsError
        If another plan or another file is there.

    Notes
    -----
    The files are those of :func:`flgpr_trials.commands.crew.plan_files`. Who can guess the seed has
    the plan. A plan that was drawn of the same inputs is left as it is, and so are its papers, but
    those that are gone are written again; one that was stopped before it was registered is finished.
    """
    from flgpr.commands.exports import Wish, write_export
    from flgpr.commands.positions import read_optional_anchor
    from flgpr.commands.reach import tell_doubts
    from flgpr.commands.scoring import borders, read_lanes
    from flgpr.door import read_named
    from flgpr.geo.points import require_one_lane
    from flgpr.store.extras import optional
    from flgpr.store.files import check_new
    from flgpr.store.outputs import atomic_output, log_finished, output_exists_error, write_new
    from flgpr.store.writing import csv_text
    from flgpr_trials.commands import crew
    from flgpr_trials.commands.scores import recipe_hash
    from flgpr_trials.folder import require_trial_rules, trial_register
    from flgpr_trials.ledger import content_hash, enter, read_register, require_unopened

    path = Path(output)
    if path.suffix != ".csv":
        raise ValueError(f"output must be a file name that ends in .csv, got {path}")
    files = crew.plan_files(path, anchor is not None)
    register = Path(book or trial_register(path) or f"{path}.register.jsonl")
    too_late = f"book must be one under which no truth was opened yet, got {register}"

    lanes = read_lanes(lane)
    plan = crew.drawn_plan(lanes, targets, seed, spacing, edge)
    plan[REGISTER_COLUMN] = register.name
    tell_doubts(plan, "truth", Path(targets).name, lanes)
    lane_anchor = read_optional_anchor(anchor)
    # What cannot be tied, or may be missing, is looked for before anything is written.
    if lane_anchor is not None:
        require_one_lane(plan)
        optional("geopandas", "gis")

    rules = {"halo": float(halo), "far": float(far)}
    for name, value in rules.items():
        if not (math.isfinite(value) and value > 0):
            raise ValueError(f"{name} must be positive and finite, got {value:g}")
    entry: Entries = {
        "event": "plan",
        "lanes": borders(lanes),
        "rules": rules,
        "spacing": float(spacing),
        "edge": float(edge),
    }
    if recipe is not None:
        entry["recipe"] = recipe_hash(recipe).of_file
    lines = read_register(register)
    require_trial_rules(lines, rules, register)

    registered = None
    if os.path.lexists(path):
        plan = crew.existing_plan(path, plan, seed)
        entry["plan"] = content_hash(path)
        registered = crew.line_of_plan(lines, entry, path)
        if registered is None:
            require_unopened(lines, too_late)
            # Written over, for what a killed process left beside it goes then: a hidden copy of it.
            with atomic_output(path, replace=True) as temporary:
                temporary.write_bytes(read_named(path))
        else:
            log_finished(path, "choose another name for another plan")
            # The crew may have filled in its sheet.
            files = {name: file for name, file in files.items() if not os.path.lexists(file)}
    else:
        # A plan without its papers, or papers of another plan, would mislead the crew.
        for file in files.values():
            check_new(file)
        require_unopened(lines, too_late)
        write_new(path, csv_text(plan))
        entry["plan"] = content_hash(path)

    crew.write_papers(plan, lanes, path, files, entry["plan"], lane_anchor)
    for kind in ("gpkg", "gpx"):
        if kind in files:
            write_export(Wish(path, files[kind], kind, anchor))
    plan.attrs["written"] = list(files.values())
    if registered is not None:
        return plan, registered

    def entry_unless_opened(lines_now: list[Entries]) -> Entries:
        require_unopened(lines_now, too_late)
        if crew.line_of_plan(lines_now, entry, path) is not None:
            raise output_exists_error(path, "another process has just drawn and registered it")
        return entry

    return plan, enter(register, entry_unless_opened)[-1]


def _register_lines(line: Entries, call: Arguments) -> Iterator[str]:
    """Yield where what fixes a detector stands in the register."""
    digest = line["recipe"][:12]
    yield f"{call.recipe} is line {line['number']} of {call.book}, {digest}..., {line['time']}"


@command(lines=_register_lines)
def register_recipe(
    recipe: Annotated[str, Argument(metavar="FILE")],
    book: Annotated[PathLike, Option()],
    model: PathLike | None = None,
    witness: PathLike | None = None,
) -> dict[str, Any]:
    """Register what fixes your detector, before the truth is opened; scores then ask for it.

    Parameters
    ----------
    model
        Model that it is run with, of `flgpr train`.
    witness
        A file elsewhere that must hold the register's lines; new ones are added.
    recipe
        What fixes your detector: any file of it, or a packaged recipe.
    book
        Register of the plan.

    Returns
    -------
    dict
        The line of the register, or the one where the recipe stands already.

    Raises
    ------
    ValueError
        If a truth was opened under the register, so that it is too late.
    FileNotFoundError
        If the register, the file or the model is missing.
    """
    from flgpr_trials.commands.scores import enter_recipe, with_witness

    return enter_recipe(recipe, with_witness(book, witness), model)


CheckedRegister = tuple[list[dict[str, Any]], dict[Any, dict[str, Any]]]


def _check_lines(returned: CheckedRegister, call: Arguments) -> Iterator[str]:
    """Yield the lines of a register, its head, and what witnesses know of it."""
    from flgpr_trials.ledger import head_of

    lines, heads = returned
    for line in lines:
        yield f"  {line['number']:4d}  {line['time']}  {json.dumps(line.get('event', ''))}"
    last = head_of(lines)["head"]
    yield f"{call.book}: {len(lines)} lines, each fits the one before; the last is {last}"
    for name, head in heads.items():
        yield f"{name} knows {head['lines']} of them"
    if not heads:
        yield "only --report or --witness shows whether lines are missing at the end"


def _check_json(returned: CheckedRegister, _: Arguments) -> Entries:
    """Return the lines and the head of a register, and the heads that reports and a witness know."""
    from flgpr_trials.ledger import head_of

    lines, heads = returned
    events = [{name: line.get(name, "") for name in ("number", "time", "event")} for line in lines]
    known = {str(name): head for name, head in heads.items()}
    return head_of(lines) | {"events": events, "reports": known}


@command(lines=_check_lines, as_json=_check_json, quiet=False)
def check_register(
    book: PathLike,
    report: Paths | None = None,
    witness: PathLike | None = None,
) -> CheckedRegister:
    """Check a register line by line.

    No line that a witness or a report knows may be missing.

    Parameters
    ----------
    book
        Register.
    report
        Report of a score with this register (roc.json or its folder); several may be.
    witness
        A file elsewhere that must hold the register's lines.

    Returns
    -------
    lines, heads
        The register's lines; and by report, and by witness, how many lines it knows, and the last
        one's hash.

    Raises
    ------
    ValueError
        If a line was altered, or one that the witness or a report knows is missing; it names the
        line. If the witness knows no line.
    FileNotFoundError
        If the register or the witness is missing.
    """
    from flgpr.append_log import read_log
    from flgpr.store.files import existing
    from flgpr.store.notes import log_note
    from flgpr_trials.commands.scores import (
        heads_of_reports,
        read_existing_register,
        with_witness,
    )
    from flgpr_trials.ledger import read_register

    register = with_witness(book, witness)
    lines = read_existing_register(register)
    complete, unfinished = read_log(Path(book))
    if unfinished and len(complete) == len(lines):
        log_note(f"{book}: {len(unfinished)} bytes of an unfinished line at the end are left out")
    heads = heads_of_reports(lines, register, one_or_more(report))
    if witness is not None:
        # Those that fit the register; that it lacks none of them has been checked.
        known = read_register(existing(witness, "witness"))
        records = [record for record in known if lines and record.get("of") == lines[0]["hash"]]
        if not records:
            raise ValueError(f"witness must know lines of {book}, got {witness}, which knows none")
        heads[witness] = {name: records[-1][name] for name in ("lines", "head")}
    return lines, heads


def _survey_lines(returned: tuple[pd.DataFrame, Entries], call: Arguments) -> Iterator[str | Path]:
    """Yield the truth, how it differs from the plan, and whether too few mines are left."""
    from flgpr_trials.folder import too_few_mines

    truth, line = returned
    yield call.output
    yield (
        f"{len(truth)} targets, {line['moved']} of them moved by at most "
        f"{line['largest_offset']:.3f} m, {line['other_depth']} at another depth than planned; "
        f"{line['left_out']} not emplaced and left out; "
        f"registered {line['time']}"
    )
    if warning := too_few_mines(Path(call.output), len(truth)):
        yield warning


@command(lines=_survey_lines)
def survey_plan(
    plan: PathLike,
    sheet: PathLike,
    output: Output,
    book: PathLike | None = None,
    within: float = 1.0,
) -> tuple[pd.DataFrame, dict[str, Any]]:
    """Read what was emplaced, write it as truth and register it in place of the plan.

    Parameters
    ----------
    plan
        Plan that was emplaced.
    sheet
        Its sheet, filled in by the crew.
    book
        Register; the plan names its own.
    within
        Largest difference from the plan that is believed, m.

    Returns
    -------
    truth, line
        The truth, and the line of the register with the number of targets that were moved, the
        largest offset, and how many lie at another depth than planned.

    Raises
    ------
    ValueError
        If the sheet does not fit the plan or changes what was planned, a target lies farther from
        its place than believed, or a truth was opened under the register; nothing is written then.
    FileExistsError
        If another file is at the output.

    Notes
    -----
    Every row of the sheet says in ``emplaced`` yes or no. Where place or depth is empty it is as
    planned.
    """
    from flgpr.commands.reach import tell_doubts
    from flgpr.door import read_named
    from flgpr.scoring import as_lanes
    from flgpr.store.files import existing
    from flgpr.store.outputs import write_new
    from flgpr.store.tables import parse_table
    from flgpr.store.writing import csv_text
    from flgpr_trials.commands.crew import read_sheet
    from flgpr_trials.commands.scores import default_register
    from flgpr_trials.ledger import content_hash, enter_unopened, read_register, require_unopened

    data = read_named(existing(plan, "truth file"))
    planned = parse_table(data, "truth", plan)
    path = default_register(plan, planned) if book is None else Path(book)
    if path is None:
        raise ValueError(f"book must be given: {plan} names no register")
    lines = read_register(existing(path, "register"))
    digest = content_hash(data)
    this_plan = {"event": "plan", "plan": digest}
    plan_lines = [line for line in lines if this_plan.items() <= line.items()]
    if not plan_lines:
        raise ValueError(f"plan must be one that stands in {path}, unaltered, got {plan}")
    too_late = (
        f"what was emplaced must be entered before the truth is opened; {path} tells of an opening"
    )
    truth, offset, depth_offset = read_sheet(sheet, planned, within)
    tell_doubts(truth, "truth", Path(sheet).name, as_lanes(plan_lines[-1]["lanes"]))
    text = csv_text(truth)
    kept: Entries = {
        name: plan_lines[-1][name] for name in ("plan", "lanes", "rules") if name in plan_lines[-1]
    }
    entry: Entries = {
        "event": "survey",
        **kept,
        "moved": int((offset > 0).sum()),
        "largest_offset": round(float(offset.max()), 3),
        "other_depth": int((depth_offset > 0).sum()),
        "left_out": len(planned) - len(truth),
        "truth": content_hash(text),
    }
    # The last survey counts. The same may have been entered, and its truth be missing: it is
    # written again.
    surveys = [line for line in lines if line.get("event") == "survey" and line["plan"] == digest]
    is_entered = bool(surveys) and entry.items() <= surveys[-1].items()
    if not is_entered:
        require_unopened(lines, too_late)
    write_new(Path(output), text)
    return truth, surveys[-1] if is_entered else enter_unopened(path, entry, too_late)
