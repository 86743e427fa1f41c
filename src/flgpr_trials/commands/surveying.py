"""The survey of a test: what the crew emplaced, as truth and in the register of the plan."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from flgpr.door import read_named
from flgpr.model import check_truth
from flgpr.model.faults import faults_of
from flgpr.store.files import existing
from flgpr.store.outputs import write_new
from flgpr.store.tables import csv_text, parse_table, read_columns
from flgpr_trials.commands.planning import CREW_COLUMNS, RegisterLine, require_unopened
from flgpr_trials.commands.registering import default_register
from flgpr_trials.ledger import content_hash, enter, read_register

PathLike = str | Path
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

    plan_line = _entered_plan(lines, content_hash(data))
    if plan_line is None:
        raise ValueError(f"plan must be one that stands in {path}, unaltered, got {plan}")
    too_late = (
        f"what was emplaced must be entered before the truth is opened; {path} tells of an opening"
    )

    truth, offset = _read_sheet(sheet, planned, within)
    text = csv_text(truth)
    entry = _survey_entry(plan_line, offset, len(planned) - len(truth), text)

    # The same survey may have been entered, and its truth be missing: it is written again.
    earlier = [line for line in lines if entry.items() <= line.items()]
    if not earlier:
        require_unopened(lines, too_late)
    write_new(Path(output), text)
    if earlier:
        return truth, earlier[-1]

    def entry_unless_opened(lines_now: list[RegisterLine]) -> RegisterLine:
        require_unopened(lines_now, too_late)
        return entry

    return truth, enter(path, entry_unless_opened)[-1]


def _survey_entry(
    plan_line: RegisterLine, offset: NDArray[np.float64], left_out: int, text: str
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


def _entered_plan(lines: Sequence[RegisterLine], digest: str) -> RegisterLine | None:
    """Return the last line that enters a plan of a digest."""
    for line in reversed(lines):
        if line.get("event") == "plan" and line.get("plan") == digest:
            return line
    return None


def _read_sheet(
    sheet: PathLike, planned: pd.DataFrame, within: float
) -> tuple[pd.DataFrame, NDArray[np.float64]]:
    """Read what was emplaced, and how far each target lies from its plan, m."""
    path = existing(sheet, "sheet")
    with faults_of(path):
        filled_in = read_columns(path, "target_id", "lane", "emplaced", "remark")
        truth = _emplaced_targets(planned, filled_in, within)
    offset_x = (truth["x"] - truth.pop("planned_x")).to_numpy()
    offset_y = (truth["y"] - truth.pop("planned_y")).to_numpy()
    return truth, np.hypot(offset_x, offset_y)


def _emplaced_targets(plan: pd.DataFrame, sheet: pd.DataFrame, within: float) -> pd.DataFrame:
    """Return the targets that were emplaced, at the positions and depths that the crew recorded.

    The columns ``planned_x`` and ``planned_y`` have the positions of the plan.
    """
    keys = _target_keys(plan, sheet)
    recorded = _rows_in_order(sheet, keys, plan)
    is_emplaced = _ticked(recorded, keys)
    truth = plan.assign(planned_x=plan["x"], planned_y=plan["y"])
    for name in ("x", "y", "depth"):
        truth[name] = _recorded_values(name, plan, recorded, keys, within)

    is_half = recorded["emplaced_x_m"].isna() != recorded["emplaced_y_m"].isna()
    if is_half.any():
        key = keys[int(np.flatnonzero(is_half)[0])]
        raise ValueError(
            f"{' '.join(key)}: emplaced_x_m and emplaced_y_m must be filled in together"
        )

    emplaced = check_truth(truth[is_emplaced].reset_index(drop=True))
    if emplaced.empty:
        raise ValueError("sheet must have a target that was emplaced, got none")
    return emplaced


def _target_keys(plan: pd.DataFrame, sheet: pd.DataFrame) -> list[tuple[str, ...]]:
    """Return lane and name of each target of the plan, in its order; the sheet must have them."""
    names = _key_columns(plan)
    missing = [name for name in (*names, *CREW_COLUMNS[:-1]) if name not in sheet]
    if missing:
        columns = ", ".join(map(str, sheet))
        raise ValueError(f"sheet must have the columns {', '.join(missing)}; got {columns}")
    return _keys_of(plan, names)


def _key_columns(plan: pd.DataFrame) -> list[str]:
    """Return the columns that identify a target."""
    return ["lane", "target_id"] if "lane" in plan else ["target_id"]


def _keys_of(table: pd.DataFrame, names: list[str]) -> list[tuple[str, ...]]:
    """Return the values of key columns as texts, row by row."""
    return [tuple(map(str, row)) for row in table[names].to_numpy()]


def _rows_in_order(
    sheet: pd.DataFrame, keys: Sequence[tuple[str, ...]], plan: pd.DataFrame
) -> pd.DataFrame:
    """Return the rows of the sheet in the order of the plan; each target must be there once."""
    sheet_keys = _keys_of(sheet, _key_columns(plan))
    if sorted(sheet_keys) != sorted(keys):
        differing = sorted({*sheet_keys} ^ {*keys})
        difference = " ".join(differing[0]) if differing else "one of them twice"
        raise ValueError(
            "sheet must have each target of the plan once and no other, "
            f"got a difference in {difference}"
        )
    order = [sheet_keys.index(key) for key in keys]
    return sheet.iloc[order].reset_index(drop=True)


def _ticked(recorded: pd.DataFrame, keys: Sequence[tuple[str, ...]]) -> NDArray[np.bool_]:
    """Return by target whether it was emplaced; the crew must say yes or no."""
    # A spreadsheet turns a tick of 1 into 1.0.
    ticks = recorded["emplaced"].fillna("").astype(str).str.strip().str.lower()
    ticks = ticks.str.removesuffix(".0")
    for key, tick in zip(keys, ticks, strict=True):
        if tick not in (*_YES, *_NO):
            raise ValueError(f"{' '.join(key)}: emplaced must be yes or no, got {tick!r}")
    return ticks.isin(_YES).to_numpy()


def _recorded_values(
    name: str,
    plan: pd.DataFrame,
    recorded: pd.DataFrame,
    keys: Sequence[tuple[str, ...]],
    within: float,
) -> NDArray[np.float64]:
    """Return a coordinate of all targets, m: the crew's to a millimetre, or the planned one."""
    cells = recorded[f"emplaced_{name}_m"]
    values = pd.to_numeric(cells, errors="coerce").to_numpy(dtype=np.float64)

    is_empty = cells.isna().to_numpy()
    difference = np.abs(values - plan[name].fillna(0.0).to_numpy())
    is_off = ~is_empty & ~(difference <= within)
    if is_off.any():
        row = int(np.flatnonzero(is_off)[0])
        raise ValueError(
            f"{' '.join(keys[row])}: emplaced_{name}_m must be within {within:g} m of the planned "
            f"{plan[name].iloc[row]:g} m, got {cells.iloc[row]}"
        )
    return np.where(is_empty, plan[name], values.round(3))
