"""Planning a test: how many mines, where they go, the crew's papers, and what was emplaced in the end."""

from __future__ import annotations

import os
import secrets
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from flgpr.door import read_named
from flgpr.geo import read_anchor
from flgpr.geo.anchor import Anchor, transform_lonlat
from flgpr.model import check_truth
from flgpr.report import sheet_html
from flgpr.scoring import Rules, as_lanes
from flgpr.store.extras import optional
from flgpr.store.files import check_new, existing, faults_of
from flgpr.store.outputs import other_output, tell_finished, write_new
from flgpr.store.tables import parse_table, read_columns, table_text
from flgpr.tasks.exchange import export_table
from flgpr.tasks.registering import BOOK, own_book, recipe_hash
from flgpr.tasks.scoring import borders, read_lanes
from flgpr.trials import SamplePlan, content_hash, emplacement_plan, read_register, sample_size
from flgpr.trials.ledger import before_opening, enter

PathLike = str | Path
_FILLED_IN = ("emplaced", "emplaced_x_m", "emplaced_y_m", "emplaced_depth_m", "remark")
_YES = ("yes", "y", "x", "1", "true")
_NO = ("no", "n", "0", "false")


def plan_mines(
    pd_claim: float = 0.9,
    far: float = 0.01,
    confidence: float = 0.95,
    *,
    true_pd: float | None = None,
    true_far: float | None = None,
    power: float = 0.8,
    joint: bool = False,
) -> tuple[SamplePlan, list[str]]:
    """Plan how many mines and how much ground a claim takes, also in words; see :func:`flgpr.trials.sample_size`."""
    plan = sample_size(
        pd_claim, far, confidence, true_pd=true_pd, true_far=true_far, power=power, joint=joint
    )
    sure = f"{100 * confidence:g} %" + (" for both together" if joint else " each")
    lines = [
        f"To show Pd >= {pd_claim:g} at FAR <= {far:g} per m² with {sure}:",
        f"  {plan.mines} mines, of which at most {plan.misses} may be missed",
        f"  {plan.area:.0f} m² of ground outside the halos, with at most {plan.false_alarms} false alarms",
    ]
    if true_pd is not None:
        lines.append(
            f"  a detector with Pd {true_pd:g} shows it with probability {plan.pd_power:.2f}"
        )
    if true_far is not None:
        lines.append(
            f"  a detector with FAR {true_far:g} per m² shows it with probability {plan.far_power:.2f}"
        )
    return plan, lines


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


def plan_lane(
    lane: PathLike,
    targets: PathLike,
    seed: int | None,
    output: PathLike,
    *,
    spacing: float = 3.0,
    edge: float = 0.5,
    recipe: PathLike | None = None,
    book: PathLike | None = None,
    anchor: PathLike | None = None,
    halo: float = Rules.halo,
    far: float = Rules.far,
) -> tuple[pd.DataFrame, dict[str, Any]]:
    """Draw an emplacement plan, write it with the crew's papers, and register it with the rules of its scoring.

    It gives the table and what was registered. ``lane`` is as for :func:`flgpr.tasks.scoring.read_lanes`, ``targets``
    CSV with ``kind``, ``depth`` (m) and ``count``, a row per sort; ``spacing`` and ``edge``, m, as for
    :func:`flgpr.trials.emplacement_plan`. Who can guess the ``seed`` has the plan; None draws one, which the table's
    ``attrs`` tell. The files are those of :func:`plan_files`: the plan itself, a truth table; a page to print for the
    crew, and a sheet that is filled in for :func:`survey_plan`; and, if an ``anchor`` (TOML) ties it to the Earth,
    the points as GeoPackage and GPX. The register ``book`` is ``<output>.register.jsonl`` by default; scoring will
    demand it, with ``halo``, m, and the operating point ``far``, per m². A ``recipe``'s hash is entered before anybody
    can open the truth. If something is not valid or lies where a file is to be made, nothing is written. A plan that
    was drawn of the same is left as it is; one that was stopped before it was registered is finished.
    """
    if Path(output).suffix != ".csv":
        raise ValueError(f"output must be a file name that ends in .csv, got {output}")
    files = plan_files(output, anchor is not None)
    book = Path(f"{output}.register.jsonl" if book is None else book)
    too_late = f"book must be one under which no truth was opened yet, got {book}"
    path = existing(targets, "targets file")
    where = read_lanes(lane)
    with faults_of(path):
        drawn_by = secrets.randbits(63) if seed is None else seed
        plan = emplacement_plan(where, read_columns(path), drawn_by, spacing=spacing, edge=edge)
    plan[BOOK] = book.name
    tie = None if anchor is None else read_anchor(anchor)
    if tie is not None:
        optional("geopandas", "gis")
    lanes = borders(where)
    rules = {"halo": float(halo), "far": float(far)}
    entry: dict[str, Any] = {"event": "plan", "lanes": lanes, "rules": rules}
    # Not the seed: who knows it, lane and sorts can draw the plan again, and a register is for all
    # to read.
    entry |= {"spacing": float(spacing), "edge": float(edge)}
    if recipe is not None:
        entry["recipe"] = recipe_hash(recipe)[0]
    lines = read_register(book)
    if os.path.lexists(files["plan"]):
        plan = _plan_there(files["plan"], plan, seed)
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
    sheet = _sheet(plan, tie)
    write_new(files["sheet"], table_text(sheet))
    write_new(
        files["page"], sheet_html(sheet, as_lanes(where), files["plan"].name, entry["plan"], tie)
    )
    if anchor is not None:
        for kind in ("gpkg", "gpx"):
            export_table(files["plan"], files[kind], kind, anchor)

    def unless_opened(now: list[dict[str, Any]]) -> dict[str, Any]:
        require_unopened(now, too_late)
        if _line_of(now, entry, files["plan"]) is not None:
            raise other_output(files["plan"], "another process has just drawn and registered it")
        return entry

    return plan, enter(book, unless_opened)[-1]


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


def survey_plan(
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
