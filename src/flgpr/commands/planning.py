"""Planning a test: the emplacement plan, the crew's papers, and the survey of what was emplaced."""

from __future__ import annotations

import os
import secrets
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from flgpr.commands.exporting import export_table
from flgpr.commands.registering import REGISTER_COLUMN, default_register, recipe_hash
from flgpr.commands.scoring import borders, read_lanes
from flgpr.door import read_named
from flgpr.geo import read_anchor
from flgpr.geo.anchor import Anchor, transform_lonlat
from flgpr.model import check_truth
from flgpr.report import sheet_html
from flgpr.scoring import as_lanes
from flgpr.scoring.matching import LaneLike
from flgpr.store.extras import optional
from flgpr.store.files import check_new, existing, faults_of
from flgpr.store.outputs import other_output, tell_finished, write_new
from flgpr.store.tables import parse_table, read_columns, table_text
from flgpr.trials import content_hash, emplacement_plan, read_register
from flgpr.trials.ledger import before_opening, enter

PathLike = str | Path
Line = dict[str, Any]
"""A line of a register."""
_CREW_COLUMNS = ("emplaced", "emplaced_x_m", "emplaced_y_m", "emplaced_depth_m", "remark")
_YES = ("yes", "y", "x", "1", "true")
_NO = ("no", "n", "0", "false")


def plan_files(output: PathLike, anchored: bool = False) -> dict[str, Path]:
    """Return the paths of a plan's files by name.

    They are the ``plan``, the crew's ``page`` and ``sheet``, and, if it is anchored, the points on
    the Earth as ``gpkg`` and ``gpx``.
    """
    plan = Path(output)
    files = {
        "plan": plan,
        "page": plan.with_suffix(".html"),
        "sheet": plan.with_name(f"{plan.stem}-sheet.csv"),
    }
    if anchored:
        for kind in ("gpkg", "gpx"):
            files[kind] = plan.with_suffix(f".{kind}")
    return files


@dataclass(frozen=True)
class PlanOrder:
    """What a plan is drawn from, and where it is written."""

    #: TOML or CSV of the lane or lanes, see :func:`flgpr.commands.scoring.read_lanes`
    lane: PathLike
    targets: PathLike  #: CSV with ``kind``, ``depth`` (m) and ``count``, a row for each sort
    output: Path  #: the plan, a CSV; its other files are those of :func:`plan_files`
    seed: int | None  #: None draws one
    spacing: float  #: least distance between targets, m
    edge: float  #: least distance to the lane's border, m
    recipe: PathLike | None  #: its hash is registered before anybody can open the truth
    register: PathLike | None  #: beside the plan by default
    anchor: PathLike | None  #: TOML that ties the lane to the Earth
    rules: Mapping[str, float]  #: ``halo`` (m) and ``far`` (per m²) that scores must use

    def register_path(self) -> Path:
        """Return the path of the register."""
        if self.register is None:
            return Path(f"{self.output}.register.jsonl")
        return Path(self.register)


def draw_and_register(order: PlanOrder) -> tuple[pd.DataFrame, Line]:
    """Draw a plan, write it with the crew's papers, and register it.

    A plan that was drawn of the same inputs stays; one that was not registered is completed.

    Returns
    -------
    plan : pandas.DataFrame
        The plan; its attribute ``seed`` is None where the seed is not known.
    line : dict
        The line of the register.

    Raises
    ------
    ValueError
        If an input is not valid, or a truth was opened under the register.
    FileExistsError
        If another file is there, or the plan is registered with other lanes or rules.
    """
    if order.output.suffix != ".csv":
        raise ValueError(f"output must be a file name that ends in .csv, got {order.output}")
    files = plan_files(order.output, order.anchor is not None)
    register = order.register_path()
    too_late = f"book must be one under which no truth was opened yet, got {register}"

    lanes = read_lanes(order.lane)
    plan = _drawn_plan(order, lanes)
    anchor = None if order.anchor is None else read_anchor(order.anchor)
    # What may be missing is looked for before anything is written.
    if anchor is not None:
        optional("geopandas", "gis")

    entry = _plan_entry(order, lanes)
    lines = read_register(register)

    if os.path.lexists(files["plan"]):
        plan = _existing_plan(files["plan"], plan, order.seed)
        entry["plan"] = content_hash(files["plan"])
        registered = _line_of_plan(lines, entry, files["plan"])
        if registered is not None:
            tell_finished(files["plan"], "choose another name for another plan")
            return plan, registered
        require_unopened(lines, too_late)
    else:
        # A plan without its papers, or papers of another plan, would mislead the crew.
        for file in files.values():
            check_new(file)
        require_unopened(lines, too_late)
        write_new(files["plan"], table_text(plan))
        entry["plan"] = content_hash(files["plan"])

    _write_crew_papers(plan, lanes, files, entry["plan"], anchor)
    if order.anchor is not None:
        for kind in ("gpkg", "gpx"):
            export_table(files["plan"], files[kind], kind, order.anchor)

    def entry_unless_opened(lines_now: list[Line]) -> Line:
        require_unopened(lines_now, too_late)
        if _line_of_plan(lines_now, entry, files["plan"]) is not None:
            raise other_output(files["plan"], "another process has just drawn and registered it")
        return entry

    return plan, enter(register, entry_unless_opened)[-1]


def _drawn_plan(order: PlanOrder, lanes: LaneLike) -> pd.DataFrame:
    """Draw the positions of the targets."""
    path = existing(order.targets, "targets file")
    with faults_of(path):
        seed = secrets.randbits(63) if order.seed is None else order.seed
        sorts = read_columns(path)
        plan = emplacement_plan(lanes, sorts, seed, spacing=order.spacing, edge=order.edge)
    plan[REGISTER_COLUMN] = order.register_path().name
    return plan


def _plan_entry(order: PlanOrder, lanes: LaneLike) -> Line:
    """Return the register entry of a plan, without the plan's hash.

    The seed is not in it: whoever knows it, lane and sorts can draw the plan again, and a register
    is for all to read.
    """
    entry: Line = {
        "event": "plan",
        "lanes": borders(lanes),
        "rules": dict(order.rules),
        "spacing": float(order.spacing),
        "edge": float(order.edge),
    }
    if order.recipe is not None:
        entry["recipe"] = recipe_hash(order.recipe).of_file
    return entry


def _write_crew_papers(
    plan: pd.DataFrame,
    lanes: LaneLike,
    files: Mapping[str, Path],
    digest: str,
    anchor: Anchor | None,
) -> None:
    """Write the crew's sheet and page."""
    sheet = _crew_sheet(plan, anchor)
    write_new(files["sheet"], table_text(sheet))
    page = sheet_html(sheet, as_lanes(lanes), files["plan"].name, digest, anchor)
    write_new(files["page"], page)


def _existing_plan(path: Path, drawn: pd.DataFrame, seed: int | None) -> pd.DataFrame:
    """Read a plan that exists, if it can be the one that was drawn; else a FileExistsError.

    Without a ``seed`` any plan of the same sorts of targets can be.
    """
    if seed is not None:
        if read_named(path).decode("utf-8", "replace") == table_text(drawn):
            return drawn
    else:
        plan = parse_table(read_named(path), "truth", path)
        if list(plan.columns) == list(drawn.columns) and _sorts_of(plan) == _sorts_of(drawn):
            plan.attrs = drawn.attrs | {"seed": None}
            return plan
    raise other_output(path, "a plan is drawn once, choose another name for another")


def _sorts_of(plan: pd.DataFrame) -> list[list[str]]:
    """Return the sorted rows of a plan without positions and names of its targets."""
    drawn_columns = ["x", "y", "target_id", "lane"]
    rows = plan.drop(columns=drawn_columns, errors="ignore").astype(str).to_numpy().tolist()
    return sorted(rows)


def _line_of_plan(lines: Sequence[Line], entry: Line, path: Path) -> Line | None:
    """Return the line of a plan in its register; one with other rules is a FileExistsError."""
    for line in lines:
        if line.get("event") != entry["event"] or line.get("plan") != entry["plan"]:
            continue
        if any(line.get(name) != value for name, value in entry.items()):
            raise other_output(
                path, "it was registered with other lanes or rules, choose another name"
            )
        return line
    return None


def _crew_sheet(plan: pd.DataFrame, anchor: Anchor | None) -> pd.DataFrame:
    """Return the sheet that the crew fills in, with UTM coordinates if the lane is anchored.

    In UTM a metre is a metre on the ground, as crews measure it.
    """
    names = [name for name in ("target_id", "lane", "kind", "x", "y", "depth") if name in plan]
    sheet = plan[names].rename(columns={name: f"{name}_m" for name in ("x", "y", "depth")})
    if anchor is not None:
        ground = np.zeros(len(plan))
        positions = np.stack([plan["x"], plan["y"], ground], axis=-1).astype(float)
        utm = transform_lonlat(anchor.to_geodetic(positions)[:, :2], anchor.utm())
        sheet["easting_m"], sheet["northing_m"] = utm.round(3).T
    return sheet.assign(**dict.fromkeys(_CREW_COLUMNS, ""))


def register_survey(
    plan: PathLike,
    sheet: PathLike,
    output: PathLike,
    register: PathLike | None = None,
    within: float = 1.0,
) -> tuple[pd.DataFrame, Line]:
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
    text = table_text(truth)

    entry: Line = {"event": "survey"}
    for name in ("plan", "lanes", "rules"):
        if name in plan_line:
            entry[name] = plan_line[name]
    entry["moved"] = int((offset > 0).sum())
    entry["largest_offset"] = round(float(offset.max()), 3)
    entry["left_out"] = len(planned) - len(truth)
    entry["truth"] = content_hash(text)

    same = [line for line in lines if entry.items() <= line.items()]
    if not same:
        require_unopened(lines, too_late)
    write_new(Path(output), text)
    if same:
        return truth, same[-1]

    def entry_unless_opened(lines_now: list[Line]) -> Line:
        require_unopened(lines_now, too_late)
        return entry

    return truth, enter(path, entry_unless_opened)[-1]


def _entered_plan(lines: Sequence[Line], digest: str) -> Line | None:
    """Return the last line that enters a plan of a digest."""
    for line in reversed(lines):
        if line.get("event") == "plan" and line.get("plan") == digest:
            return line
    return None


def require_unopened(lines: Sequence[Line], too_late: str) -> None:
    """Raise a ValueError with a message if a truth was opened under a register."""
    if len(before_opening(lines)) < len(lines):
        raise ValueError(too_late)


def _read_sheet(
    sheet: PathLike, planned: pd.DataFrame, within: float
) -> tuple[pd.DataFrame, NDArray[np.float64]]:
    """Read what was emplaced, and how far each target lies from its plan, m."""
    path = existing(sheet, "sheet")
    with faults_of(path):
        filled_in = read_columns(path, "target_id", "lane", "emplaced", "remark")
        truth = _emplaced_targets(planned, filled_in, within)
    planned_x = truth.pop("planned_x")
    planned_y = truth.pop("planned_y")
    offset = np.hypot(
        truth["x"].to_numpy() - planned_x.to_numpy(), truth["y"].to_numpy() - planned_y.to_numpy()
    )
    return truth, offset


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
    missing = [name for name in (*names, *_CREW_COLUMNS[:-1]) if name not in sheet]
    if missing:
        raise ValueError(
            f"sheet must have the columns {', '.join(missing)}; got {', '.join(map(str, sheet))}"
        )
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
