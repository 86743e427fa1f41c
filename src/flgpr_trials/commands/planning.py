"""Planning a test: the emplacement plan, the crew's papers, and their register."""

from __future__ import annotations

import os
import secrets
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from flgpr.commands.exports import Wish, write_export
from flgpr.commands.scoring import borders, read_lanes
from flgpr.commands.trials import REGISTER_COLUMN
from flgpr.door import read_named
from flgpr.geo import read_anchor
from flgpr.geo.anchor import Anchor
from flgpr.geo.geodesy import transform_lonlat
from flgpr.model.faults import faults_of
from flgpr.scoring import as_lanes
from flgpr.scoring.matching import LaneLike
from flgpr.store.extras import optional
from flgpr.store.files import check_new, existing
from flgpr.store.outputs import log_finished, output_exists_error, write_new
from flgpr.store.tables import csv_text, parse_table, read_columns
from flgpr_trials.commands.registering import recipe_hash
from flgpr_trials.folder import require_trial_rules, trial_register
from flgpr_trials.ledger import content_hash, enter, read_register, require_unopened
from flgpr_trials.pages import sheet_html
from flgpr_trials.planning import emplacement_plan

PathLike = str | Path
RegisterLine = dict[str, Any]  # a line of a register
CREW_COLUMNS = ("emplaced", "emplaced_x_m", "emplaced_y_m", "emplaced_depth_m", "remark")
"""Columns of the sheet that the crew fills in."""


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
    #: by default that of the trial in whose folder the plan is written, or one beside the plan
    register: PathLike | None
    anchor: PathLike | None  #: TOML that ties the lane to the Earth
    rules: Mapping[str, float]  #: ``halo`` (m) and ``far`` (per m²) that scores must use

    def register_path(self) -> Path:
        """Return the path of the register."""
        if self.register is not None:
            return Path(self.register)
        return trial_register(self.output) or Path(f"{self.output}.register.jsonl")


def draw_and_register(order: PlanOrder) -> tuple[pd.DataFrame, RegisterLine]:
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
    require_trial_rules(lines, order.rules, register)

    if os.path.lexists(files["plan"]):
        plan = _existing_plan(files["plan"], plan, order.seed)
        entry["plan"] = content_hash(files["plan"])
        registered = _line_of_plan(lines, entry, files["plan"])
        if registered is not None:
            log_finished(files["plan"], "choose another name for another plan")
            return plan, registered
        require_unopened(lines, too_late)
    else:
        # A plan without its papers, or papers of another plan, would mislead the crew.
        for file in files.values():
            check_new(file)
        require_unopened(lines, too_late)
        write_new(files["plan"], csv_text(plan))
        entry["plan"] = content_hash(files["plan"])

    _write_crew_papers(plan, lanes, files, entry["plan"], anchor)
    if order.anchor is not None:
        for kind in ("gpkg", "gpx"):
            write_export(Wish(files["plan"], files[kind], kind, order.anchor))

    def entry_unless_opened(lines_now: list[RegisterLine]) -> RegisterLine:
        require_unopened(lines_now, too_late)
        if _line_of_plan(lines_now, entry, files["plan"]) is not None:
            raise output_exists_error(
                files["plan"], "another process has just drawn and registered it"
            )
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


def _plan_entry(order: PlanOrder, lanes: LaneLike) -> RegisterLine:
    """Return the register entry of a plan, without the plan's hash.

    The seed is not in it: whoever knows it, lane and sorts can draw the plan again, and a register
    is for all to read.
    """
    entry: RegisterLine = {
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
    write_new(files["sheet"], csv_text(sheet))
    page = sheet_html(sheet, as_lanes(lanes), files["plan"].name, digest, anchor)
    write_new(files["page"], page)


def _existing_plan(path: Path, drawn: pd.DataFrame, seed: int | None) -> pd.DataFrame:
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


def _line_of_plan(
    lines: Sequence[RegisterLine], entry: RegisterLine, path: Path
) -> RegisterLine | None:
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
