"""Planning a test: how many mines, where they go, the crew's papers, and what was emplaced in the end."""

from __future__ import annotations

import os
import secrets
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from flgpr.commands.exporting import export_table
from flgpr.commands.registering import BOOK, own_book, recipe_hash
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
_FILLED_IN = ("emplaced", "emplaced_x_m", "emplaced_y_m", "emplaced_depth_m", "remark")
_YES = ("yes", "y", "x", "1", "true")
_NO = ("no", "n", "0", "false")


def plan_files(output: PathLike, anchored: bool = False) -> dict[str, Path]:
    """Tell where the files of a plan lie: ``plan``, the crew's ``page`` and ``sheet``, and the points on the Earth."""
    plan = Path(output)
    files = {
        "plan": plan,
        "page": plan.with_suffix(".html"),
        "sheet": plan.with_name(f"{plan.stem}-sheet.csv"),
    }
    return files | (
        {kind: plan.with_suffix(f".{kind}") for kind in ("gpkg", "gpx")} if anchored else {}
    )


@dataclass(frozen=True)
class PlanOrder:
    """What a plan is drawn of, and where it is written."""

    #: TOML or CSV of the lane or lanes, see :func:`flgpr.commands.scoring.read_lanes`
    lane: PathLike
    targets: PathLike  #: CSV with ``kind``, ``depth`` (m) and ``count``, a row per sort
    output: Path  #: the plan, a CSV; its other files are those of :func:`plan_files`
    seed: int | None  #: None draws one
    spacing: float  #: least distance between targets, m
    edge: float  #: least distance to the lane's border, m
    recipe: PathLike | None  #: its hash is registered before anybody can open the truth
    book: PathLike | None  #: register; beside the plan by default
    anchor: PathLike | None  #: TOML that ties the lane to the Earth
    rules: Mapping[str, float]  #: ``halo`` (m) and ``far`` (per m²) that scores must use

    def register(self) -> Path:
        """Return the path of the register."""
        return Path(f"{self.output}.register.jsonl" if self.book is None else self.book)


def draw_and_register(order: PlanOrder) -> tuple[pd.DataFrame, dict[str, Any]]:
    """Draw a plan, write it with the crew's papers, and register it; return the table and the line."""
    if order.output.suffix != ".csv":
        raise ValueError(f"output must be a file name that ends in .csv, got {order.output}")
    files = plan_files(order.output, order.anchor is not None)
    book = order.register()
    too_late = f"book must be one under which no truth was opened yet, got {book}"
    where = read_lanes(order.lane)
    plan = _drawn_plan(order, where)
    tie = None if order.anchor is None else read_anchor(order.anchor)
    if tie is not None:
        optional("geopandas", "gis")
    entry = _entry_of(order, where)
    lines = read_register(book)
    if os.path.lexists(files["plan"]):
        plan = _plan_there(files["plan"], plan, order.seed)
        entry["plan"] = content_hash(files["plan"])
        registered = _line_of(lines, entry, files["plan"])
        if registered is not None:
            tell_finished(files["plan"], "choose another name for another plan")
            return plan, registered
        require_unopened(lines, too_late)
    else:
        for file in files.values():
            check_new(file)
        require_unopened(lines, too_late)
        write_new(files["plan"], table_text(plan))
        entry["plan"] = content_hash(files["plan"])
    _write_papers(plan, where, files, entry["plan"], tie)
    if order.anchor is not None:
        for kind in ("gpkg", "gpx"):
            export_table(files["plan"], files[kind], kind, order.anchor)

    def unless_opened(now: list[dict[str, Any]]) -> dict[str, Any]:
        require_unopened(now, too_late)
        if _line_of(now, entry, files["plan"]) is not None:
            raise other_output(files["plan"], "another process has just drawn and registered it")
        return entry

    return plan, enter(book, unless_opened)[-1]


def _drawn_plan(order: PlanOrder, where: LaneLike) -> pd.DataFrame:
    """Draw the places of the targets."""
    path = existing(order.targets, "targets file")
    with faults_of(path):
        seed = secrets.randbits(63) if order.seed is None else order.seed
        sorts = read_columns(path)
        plan = emplacement_plan(where, sorts, seed, spacing=order.spacing, edge=order.edge)
    plan[BOOK] = order.register().name
    return plan


def _entry_of(order: PlanOrder, where: LaneLike) -> dict[str, Any]:
    """Return what the register says of a plan, but for the plan's hash.

    Not the seed: who knows it, lane and sorts can draw the plan again, and a register is for all to
    read.
    """
    entry: dict[str, Any] = {
        "event": "plan",
        "lanes": borders(where),
        "rules": dict(order.rules),
        "spacing": float(order.spacing),
        "edge": float(order.edge),
    }
    if order.recipe is not None:
        entry["recipe"] = recipe_hash(order.recipe)[0]
    return entry


def _write_papers(
    plan: pd.DataFrame,
    where: LaneLike,
    files: Mapping[str, Path],
    digest: str,
    tie: Anchor | None,
) -> None:
    """Write the crew's sheet and page."""
    sheet = _sheet(plan, tie)
    write_new(files["sheet"], table_text(sheet))
    page = sheet_html(sheet, as_lanes(where), files["plan"].name, digest, tie)
    write_new(files["page"], page)


def _plan_there(path: Path, drawn: pd.DataFrame, seed: int | None) -> pd.DataFrame:
    """Read a plan that is there, if it can be the one that was drawn; who gives no ``seed`` has any of its sorts."""
    if seed is not None and read_named(path).decode("utf-8", "replace") == table_text(drawn):
        return drawn
    same = False
    if seed is None:
        plan = parse_table(read_named(path), "truth", path)
        placed = ["x", "y", "target_id", "lane"]
        sorts = [
            table.drop(columns=placed, errors="ignore").astype(str).values.tolist()
            for table in (plan, drawn)
        ]
        same = list(plan.columns) == list(drawn.columns) and sorted(sorts[0]) == sorted(sorts[1])
        plan.attrs = drawn.attrs | {"seed": None}
    if not same:
        raise other_output(path, "a plan is drawn once, choose another name for another")
    return plan


def _line_of(
    lines: Sequence[dict[str, Any]], entry: dict[str, Any], path: Path
) -> dict[str, Any] | None:
    """Find the line of a plan in its register; one that tells other rules of the same plan is a FileExistsError."""
    for line in lines:
        if line.get("event") == entry["event"] and line.get("plan") == entry["plan"]:
            if {name: line.get(name) for name in entry} != entry:
                raise other_output(
                    path, "it was registered with other lanes or rules, choose another name"
                )
            return line
    return None


def _sheet(plan: pd.DataFrame, tie: Anchor | None) -> pd.DataFrame:
    """Make the sheet that the crew fills in; on the Earth with easting and northing, where a metre is a metre."""
    names = [name for name in ("target_id", "lane", "kind", "x", "y", "depth") if name in plan]
    sheet = plan[names].rename(columns={name: f"{name}_m" for name in ("x", "y", "depth")})
    if tie is not None:
        lane = np.stack([plan["x"], plan["y"], np.zeros(len(plan))], axis=-1).astype(float)
        grid = transform_lonlat(tie.to_geodetic(lane)[:, :2], tie.utm())
        sheet["easting_m"], sheet["northing_m"] = grid.round(3).T
    return sheet.assign(**dict.fromkeys(_FILLED_IN, ""))


def register_survey(
    plan: PathLike,
    sheet: PathLike,
    output: PathLike,
    book: PathLike | None = None,
    within: float = 1.0,
) -> tuple[pd.DataFrame, dict[str, Any]]:
    """Read the filled-in sheet of a plan, write what was emplaced as truth, and register it in place of the plan.

    Every row says in ``emplaced`` yes or no. A target that was not emplaced is left out; where place or depth is empty
    it is as planned. A target more than ``within`` (m) from its plan, across, along or down, is refused, for that is
    rather a slip or another unit. It gives the truth and what was registered, the number of targets that were moved and
    the largest offset among it. Once a truth was opened under the register it is too late: a ValueError, as is a sheet
    of other targets. Nothing is written then, nor over another file; a survey that is there and registered stays.
    """
    data = read_named(existing(plan, "truth file"))
    planned = parse_table(data, "truth", plan)
    own = own_book(plan, planned) if book is None else Path(book)
    if own is None:
        raise ValueError(f"book must be given: {plan} names no register")
    lines = read_register(existing(own, "register"))
    digest = content_hash(data)
    entered = [line for line in lines if line.get("event") == "plan" and line.get("plan") == digest]
    if not entered:
        raise ValueError(f"plan must be one that stands in {own}, unaltered, got {plan}")
    too_late = (
        f"what was emplaced must be entered before the truth is opened; {own} tells of an opening"
    )
    path = existing(sheet, "sheet")
    with faults_of(path):
        truth = _emplaced(
            planned, read_columns(path, "target_id", "lane", "emplaced", "remark"), within
        )
    offset = np.hypot(truth["x"] - truth.pop("planned_x"), truth["y"] - truth.pop("planned_y"))
    text = table_text(truth)
    told: dict[str, Any] = {
        "moved": int((offset > 0).sum()),
        "largest_offset": round(float(offset.max()), 3),
    }
    told |= {"left_out": len(planned) - len(truth), "truth": content_hash(text)}
    same = {name: entered[-1][name] for name in ("plan", "lanes", "rules") if name in entered[-1]}
    entry = {"event": "survey"} | same | told
    known = [line for line in lines if entry.items() <= line.items()]
    if not known:
        require_unopened(lines, too_late)
    write_new(Path(output), text)
    if known:
        return truth, known[-1]

    def unless_opened(now: list[dict[str, Any]]) -> dict[str, Any]:
        require_unopened(now, too_late)
        return entry

    return truth, enter(own, unless_opened)[-1]


def require_unopened(lines: Sequence[dict[str, Any]], too_late: str) -> None:
    """Refuse, in these words, what comes after a truth was opened under a register."""
    if len(before_opening(lines)) < len(lines):
        raise ValueError(too_late)


def _emplaced(plan: pd.DataFrame, sheet: pd.DataFrame, within: float) -> pd.DataFrame:
    """Put what the crew noted in place of what was planned, row by row; ``planned_x`` and ``planned_y`` stay beside."""
    keys = ["lane", "target_id"] if "lane" in plan else ["target_id"]
    missing = [name for name in (*keys, *_FILLED_IN[:-1]) if name not in sheet]
    if missing:
        raise ValueError(
            f"sheet must have the columns {', '.join(missing)}; got {', '.join(map(str, sheet))}"
        )
    there, wanted = (
        [tuple(map(str, row)) for row in table[keys].to_numpy()] for table in (sheet, plan)
    )
    if sorted(there) != sorted(wanted):
        strange = [" ".join(key) for key in sorted({*there} ^ {*wanted})] or ["one of them twice"]
        raise ValueError(
            f"sheet must have each target of the plan once and no other, got a difference in {strange[0]}"
        )
    said = sheet.iloc[[there.index(key) for key in wanted]].reset_index(drop=True)
    ticked = said["emplaced"].fillna("").astype(str).str.strip().str.lower().str.removesuffix(".0")
    for key, word in zip(wanted, ticked, strict=True):
        if word not in (*_YES, *_NO):
            raise ValueError(f"{' '.join(key)}: emplaced must be yes or no, got {word!r}")
    truth = plan.assign(planned_x=plan["x"], planned_y=plan["y"])
    for name in ("x", "y", "depth"):
        noted = pd.to_numeric(said[f"emplaced_{name}_m"], errors="coerce").to_numpy(
            dtype=np.float64
        )
        empty = said[f"emplaced_{name}_m"].isna().to_numpy()
        off = ~empty & ~(np.abs(noted - plan[name].fillna(0.0).to_numpy()) <= within)
        if off.any():
            row = int(np.flatnonzero(off)[0])
            raise ValueError(
                f"{' '.join(wanted[row])}: emplaced_{name}_m must be within {within:g} m of the planned "
                f"{plan[name].iloc[row]:g} m, got {said[f'emplaced_{name}_m'].iloc[row]}"
            )
        truth[name] = np.where(empty, plan[name], noted.round(3))
    half = said["emplaced_x_m"].isna() != said["emplaced_y_m"].isna()
    if half.any():
        key = wanted[int(np.flatnonzero(half)[0])]
        raise ValueError(
            f"{' '.join(key)}: emplaced_x_m and emplaced_y_m must be filled in together"
        )
    kept = check_truth(truth[ticked.isin(_YES).to_numpy()].reset_index(drop=True))
    if kept.empty:
        raise ValueError("sheet must have a target that was emplaced, got none")
    return kept
