"""The survey of a test: what the crew emplaced, as truth and in the register of the plan."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd

from flgpr.door import read_named
from flgpr.model import check_truth
from flgpr.model.faults import faults_of
from flgpr.store.files import existing
from flgpr.store.outputs import write_new
from flgpr.store.tables import csv_text, parse_table, read_columns
from flgpr.types import BoolArray, FloatArray
from flgpr_trials.commands.planning import CREW_COLUMNS, RegisterLine
from flgpr_trials.commands.registering import default_register
from flgpr_trials.ledger import content_hash, enter_unopened, read_register, require_unopened

PathLike = str | Path
_TEXT_COLUMNS = ("target_id", "lane", "emplaced", "remark")
_YES = ("yes", "y", "x", "1", "true")
_NO = ("no", "n", "0", "false")


def register_survey(
    plan: PathLike,
    sheet: PathLike,
    output: PathLike,
    register: PathLike | None = None,
    within: float = 1.0,
) -> tuple[pd.DataFrame, RegisterLine]:
    """Read the sheet of a plan, write what was emplaced as truth, and register it.

    Every row says in ``emplaced`` yes or no. A target that was not emplaced is left out; where
    position or depth is empty it is as planned.

    Parameters
    ----------
    plan : path
        The plan (CSV).
    sheet : path
        Its sheet, filled in by the crew.
    output : path
        The truth to write (CSV).
    register : path, optional
        Register in place of the plan's own.
    within : float
        Largest difference from the plan, across, along or down, m. A larger one is rather a slip
        of the pen or another unit, and is refused.

    Returns
    -------
    truth : pandas.DataFrame
        What was emplaced.
    line : dict
        The line of the register, with the number of targets that were moved and the largest
        offset, m.

    Raises
    ------
    ValueError
        If a truth was opened under the register, or the sheet does not fit the plan; nothing is
        written.
    FileExistsError
        If another file is at the output.
    """
    data = read_named(existing(plan, "truth file"))
    planned = parse_table(data, "truth", plan)
    path = default_register(plan, planned) if register is None else Path(register)
    if path is None:
        raise ValueError(f"book must be given: {plan} names no register")
    lines = read_register(existing(path, "register"))

    digest = content_hash(data)
    plan_lines = [
        line for line in lines if (line.get("event"), line.get("plan")) == ("plan", digest)
    ]
    if not plan_lines:
        raise ValueError(f"plan must be one that stands in {path}, unaltered, got {plan}")
    too_late = (
        f"what was emplaced must be entered before the truth is opened; {path} tells of an opening"
    )

    truth, offset = _read_sheet(sheet, planned, within)
    text = csv_text(truth)
    entry = _survey_entry(plan_lines[-1], offset, len(planned) - len(truth), text)

    # The same survey may have been entered, and its truth be missing: it is written again.
    earlier = [line for line in lines if entry.items() <= line.items()]
    if not earlier:
        require_unopened(lines, too_late)
    write_new(Path(output), text)
    return truth, earlier[-1] if earlier else enter_unopened(path, entry, too_late)


def _survey_entry(
    plan_line: RegisterLine, offset: FloatArray, left_out: int, text: str
) -> RegisterLine:
    """Return the register entry of a survey: its plan, how far targets lie off it, and the truth.

    ``offset`` are the distances of the targets from the plan, m; ``text`` is the truth as written.
    """
    entry: RegisterLine = {"event": "survey"}
    for name in ("plan", "lanes", "rules"):
        if name in plan_line:
            entry[name] = plan_line[name]
    entry["moved"] = int((offset > 0).sum())
    entry["largest_offset"] = round(float(offset.max()), 3)
    entry["left_out"] = left_out
    entry["truth"] = content_hash(text)
    return entry


def _read_sheet(
    sheet: PathLike, planned: pd.DataFrame, within: float
) -> tuple[pd.DataFrame, FloatArray]:
    """Read what was emplaced, and how far each target lies from its plan, m.

    Targets have the positions and depths that the crew recorded.
    """
    path = existing(sheet, "sheet")
    with faults_of(path):
        recorded = _recorded_rows(read_columns(path, *_TEXT_COLUMNS), planned)
        is_emplaced = _ticked(recorded)
        values = {}
        for name in ("x", "y", "depth"):
            values[name] = _recorded_values(name, planned, recorded, within)
        is_half = recorded["emplaced_x_m"].isna() != recorded["emplaced_y_m"].isna()
        for target in recorded.index[is_half]:
            raise ValueError(f"{target}: emplaced_x_m and emplaced_y_m must be filled in together")
        truth = check_truth(planned.assign(**values)[is_emplaced].reset_index(drop=True))
        if truth.empty:
            raise ValueError("sheet must have a target that was emplaced, got none")
    step = values["x"] - planned["x"], values["y"] - planned["y"]
    return truth, np.hypot(*step).to_numpy()[is_emplaced]


def _recorded_rows(sheet: pd.DataFrame, plan: pd.DataFrame) -> pd.DataFrame:
    """Return the rows of the sheet by the targets' names, in the order of the plan.

    Each target must be there once.
    """
    keys = ["lane", "target_id"] if "lane" in plan else ["target_id"]
    missing = [name for name in (*keys, *CREW_COLUMNS[:-1]) if name not in sheet]
    if missing:
        columns = ", ".join(map(str, sheet))
        raise ValueError(f"sheet must have the columns {', '.join(missing)}; got {columns}")
    names, planned_names = (
        [" ".join(map(str, row)) for row in table[keys].to_numpy()] for table in (sheet, plan)
    )
    if sorted(names) != sorted(planned_names):
        differing = sorted({*names} ^ {*planned_names})
        raise ValueError(
            "sheet must have each target of the plan once and no other, "
            f"got a difference in {differing[0] if differing else 'one of them twice'}"
        )
    return sheet.set_axis(names).loc[planned_names]


def _ticked(recorded: pd.DataFrame) -> BoolArray:
    """Return by target whether it was emplaced; the crew must say yes or no."""
    # A spreadsheet turns a tick of 1 into 1.0.
    ticks = recorded["emplaced"].fillna("").astype(str).str.strip().str.lower()
    ticks = ticks.str.removesuffix(".0")
    for target, tick in ticks[~ticks.isin((*_YES, *_NO))].items():
        raise ValueError(f"{target}: emplaced must be yes or no, got {tick!r}")
    return ticks.isin(_YES).to_numpy()


def _recorded_values(
    name: str, plan: pd.DataFrame, recorded: pd.DataFrame, within: float
) -> FloatArray:
    """Return a coordinate of all targets, m: the crew's to a millimetre, or the planned one."""
    cells = recorded[f"emplaced_{name}_m"]
    planned = plan[name].set_axis(cells.index)
    values = pd.to_numeric(cells, errors="coerce")
    is_off = cells.notna() & ~((values - planned.fillna(0.0)).abs() <= within)
    for target in cells.index[is_off]:
        raise ValueError(
            f"{target}: emplaced_{name}_m must be within {within:g} m of the planned "
            f"{planned[target]:g} m, got {cells[target]}"
        )
    return np.where(cells.isna(), planned, values.to_numpy(dtype=np.float64).round(3))
