"""The emplacement plan of a test and the crew's papers: written before, read when it is emplaced."""

from __future__ import annotations

import math
import secrets
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import pandas as pd

from flgpr.door import read_named
from flgpr.geo.anchor import Anchor
from flgpr.geo.geodesy import transform_lonlat
from flgpr.model import check_truth
from flgpr.model.faults import faults_of
from flgpr.scoring import as_lanes
from flgpr.scoring.matching import LaneLike
from flgpr.store.files import existing
from flgpr.store.outputs import output_exists_error, write_new
from flgpr.store.tables import parse_table, read_columns
from flgpr.store.writing import csv_text
from flgpr.types import BoolArray, Entries, FloatArray, PathLike, floats
from flgpr_trials.pages import sheet_html
from flgpr_trials.planning import emplacement_plan

CREW_COLUMNS = ("emplaced", "emplaced_x_m", "emplaced_y_m", "emplaced_depth_m", "remark")
"""Columns of the sheet that the crew fills in."""
_TEXT_COLUMNS = ("target_id", "lane", "emplaced", "remark")
_YES = ("yes", "y", "x", "1", "true")
_NO = ("no", "n", "0", "false")
_REWRITTEN = 0.01  # m: spreadsheets round what they write again
_SHOWN_SLIPS = 8  # of a sheet that an error lists


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


def drawn_plan(
    lanes: LaneLike, targets: PathLike, seed: int | None, spacing: float, edge: float
) -> pd.DataFrame:
    """Draw the positions of the targets of a CSV with ``kind``, ``depth`` (m) and ``count``."""
    path = existing(targets, "targets file")
    with faults_of(path):
        drawn_seed = secrets.randbits(63) if seed is None else seed
        sorts = read_columns(path)
        return emplacement_plan(lanes, sorts, drawn_seed, spacing=spacing, edge=edge)


def write_papers(
    plan: pd.DataFrame,
    lanes: LaneLike,
    path: Path,
    files: Mapping[str, Path],
    digest: str,
    anchor: Anchor | None,
) -> None:
    """Write the crew's sheet and page of the plan at ``path``, those that ``files`` name."""
    sheet = _crew_sheet(plan, anchor)
    if "sheet" in files:
        write_new(files["sheet"], csv_text(sheet))
    if "page" in files:
        write_new(files["page"], sheet_html(sheet, as_lanes(lanes), path.name, digest, anchor))


def existing_plan(path: Path, drawn: pd.DataFrame, seed: int | None) -> pd.DataFrame:
    """Read a plan that exists, if it can be the one that was drawn; else a FileExistsError.

    Without a ``seed`` any plan of the same sorts of targets can be.
    """
    content = read_named(path)
    if seed is not None:
        if content.decode("utf-8", "replace") == csv_text(drawn):
            return drawn
    else:
        plan = parse_table(content, "truth", path)
        has_same_columns = list(plan.columns) == list(drawn.columns)
        if has_same_columns and _sorts_of(plan) == _sorts_of(drawn):
            plan.attrs = drawn.attrs | {"seed": None}
            return plan
    raise output_exists_error(path, "a plan is drawn once, choose another name for another")


def _sorts_of(plan: pd.DataFrame) -> list[list[str]]:
    """Return the sorted rows of a plan without positions and names of its targets."""
    drawn_columns = ["x", "y", "target_id", "lane"]
    sorts = plan.drop(columns=drawn_columns, errors="ignore").astype(str)
    return sorted(sorts.to_numpy().tolist())


def line_of_plan(lines: Sequence[Entries], entry: Entries, path: Path) -> Entries | None:
    """Return the line of a plan in its register; one with other rules is a FileExistsError."""
    for line in lines:
        if line.get("event") != entry["event"] or line.get("plan") != entry["plan"]:
            continue
        if any(line.get(name) != value for name, value in entry.items()):
            raise output_exists_error(
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
        lonlat = anchor.to_geodetic(positions)[:, :2]
        utm = transform_lonlat(lonlat, anchor.utm()).round(3)  # to a millimetre
        sheet["easting_m"] = utm[:, 0]
        sheet["northing_m"] = utm[:, 1]
    return sheet.assign(**dict.fromkeys(CREW_COLUMNS, ""))


def read_sheet(
    sheet: PathLike, planned: pd.DataFrame, within: float
) -> tuple[pd.DataFrame, FloatArray, FloatArray]:
    """Read what was emplaced, and how far each target lies from its plan, along and in depth, m.

    Targets have the positions and depths that the crew recorded.
    """
    if not (math.isfinite(within) and within >= 0):
        raise ValueError(f"within must be finite and not negative (m), got {within:g}")
    path = existing(sheet, "sheet")
    with faults_of(path):
        recorded = _recorded_rows(read_columns(path, *_TEXT_COLUMNS), planned)
        is_emplaced, slips = _ticked(recorded)
        slips += _changed_plan(recorded, planned)
        values = {}
        for name in ("x", "y", "depth"):
            values[name], of_name = _recorded_values(name, planned, recorded, within)
            slips += of_name
        is_half = recorded["emplaced_x_m"].isna() != recorded["emplaced_y_m"].isna()
        for target in recorded.index[is_half]:
            slips.append(f"{target}: emplaced_x_m and emplaced_y_m must be filled in together")
        if slips:
            # All at once: the crew is called back once.
            more = f"; and {len(slips) - _SHOWN_SLIPS} more" if len(slips) > _SHOWN_SLIPS else ""
            raise ValueError("; ".join(slips[:_SHOWN_SLIPS]) + more)
        truth = check_truth(planned.assign(**values)[is_emplaced].reset_index(drop=True))
        if truth.empty:
            raise ValueError("sheet must have a target that was emplaced, got none")
    x_step, y_step, depth_step = (
        (values[name] - floats(planned[name]))[is_emplaced] for name in ("x", "y", "depth")
    )
    return truth, np.hypot(x_step, y_step), np.abs(depth_step)


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
        counted, planned = Counter(names), Counter(planned_names)
        differing = min(counted - planned or planned - counted)
        raise ValueError(
            "sheet must have each target of the plan once and no other, "
            f"got {counted[differing]} × {differing}"
        )
    return sheet.set_axis(names).loc[planned_names]


def _ticked(recorded: pd.DataFrame) -> tuple[BoolArray, list[str]]:
    """Return by target whether it was emplaced, and where the crew does not say yes or no."""
    # A spreadsheet turns a tick of 1 into 1.0.
    ticks = recorded["emplaced"].fillna("").astype(str).str.strip().str.lower()
    ticks = ticks.str.removesuffix(".0")
    slips = []
    for target, tick in ticks[~ticks.isin((*_YES, *_NO))].items():
        slips.append(f"{target}: emplaced must be yes or no, got {tick!r}")
    return ticks.isin(_YES).to_numpy(), slips


def _changed_plan(recorded: pd.DataFrame, plan: pd.DataFrame) -> list[str]:
    """Return where a sheet has other planned values than the plan: they would count for nothing."""
    slips = []
    for name in ("x", "y", "depth"):
        if f"{name}_m" not in recorded:
            continue
        cells = recorded[f"{name}_m"]
        planned = plan[name].set_axis(cells.index)
        is_other = (pd.to_numeric(cells, errors="coerce") - planned).abs() > _REWRITTEN
        for target in cells.index[is_other]:
            slips.append(
                f"{target}: {name}_m must stay the planned {planned[target]:g} m, what was emplaced "
                f"goes into emplaced_{name}_m, got {cells[target]}"
            )
    return slips


def _recorded_values(
    name: str, plan: pd.DataFrame, recorded: pd.DataFrame, within: float
) -> tuple[FloatArray, list[str]]:
    """Return a coordinate of all targets, m, and its slips: the crew's, to a millimetre, or the plan's."""
    cells = recorded[f"emplaced_{name}_m"]
    planned = plan[name].set_axis(cells.index)
    values = pd.to_numeric(cells, errors="coerce")
    is_off = cells.notna() & ~((values - planned.fillna(0.0)).abs() <= within)
    slips = []
    for target in cells.index[is_off]:
        rule = f"within {within:g} m of the planned {planned[target]:g} m"
        if np.isnan(values[target]):
            rule = "a number of metres with a decimal point, or commas in a sheet with semicolons"
        slips.append(f"{target}: emplaced_{name}_m must be {rule}, got {cells[target]}")
    return np.where(cells.isna(), planned, floats(values).round(3)), slips
