"""Scoring, blind scoring and test planning: files in, files out."""

from __future__ import annotations

import dataclasses
import importlib.util
import os
import tomllib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Literal

import pandas as pd

from flgpr.chain.progress import Track, silent
from flgpr.execution.lane_run import results_at
from flgpr.io import read_table, write_table, write_whole
from flgpr.io.files import existing, faults_of
from flgpr.model import Lane
from flgpr.report import score_files
from flgpr.results.result import SECTIONS, Result, add_files, join_sections, read_result
from flgpr.results.score import blind_roc_json, score_detections
from flgpr.results.view_score import VIEW_SCORE, view_score
from flgpr.scoring import BlindScore, Rules, SamplePlan, Score, as_lanes, content_hash, register, score
from flgpr.scoring.blind import score_blind, seal_truth
from flgpr.scoring.ledger import require_registered
from flgpr.scoring.planning import emplacement_plan, sample_size

PathLike = str | Path


def read_lanes(path: PathLike) -> Lane | dict[str, Lane]:
    """Read one lane or several from TOML or CSV; several come by name.

    TOML holds ``x_min``, ``x_max``, ``y_min``, ``y_max`` (m), or a table of these per lane; CSV has these columns, one
    row per lane, named in the column ``lane``. A file that holds no lanes is a ValueError.
    """
    path = existing(path, "lane file")
    with faults_of(path):
        table = path.suffix.lower() == ".csv"
        lanes = as_lanes(pd.read_csv(path) if table else tomllib.loads(path.read_text(encoding="utf-8")))
    return lanes[""] if list(lanes) == [""] else lanes


def score_result(
    folder: PathLike,
    truth: PathLike,
    objects: PathLike | None = None,
    output: PathLike | None = None,
    track: Track = silent,
    *,
    recipe: PathLike | None = None,
    book: PathLike | None = None,
    far: float = Rules.far,
) -> tuple[Result, list[Score]]:
    """Score a result, or a lane that was taken in sections as one, by its recipe's rules, and write the report.

    ``truth`` is CSV of the targets, ``objects`` of what else stands there, for the pictures; ``output`` takes the
    files, by default :func:`score_home`. Targets count as found or missed at the operating point ``far``, per m²;
    ``recipe`` and ``book`` are as for :func:`score_alarms`. If an input is not valid or altered, or the recipe is not
    registered, nothing is written.
    """
    home, homes = Path(folder), results_at(folder)
    whole = homes == [home]
    result = read_result(home) if whole else join_sections(home, homes)
    to = Path(output) if output is not None else score_home(home)
    targets, notes = _open_truth(truth, home / "alarms.csv", recipe, book)
    others = read_table(objects, "objects") if objects is not None else None
    scored = score_detections(result, targets, far)
    sections = {} if whole else {one.name: _page_of(one, to) for one in homes}
    files: dict[str, bytes | str] = {}
    for _ in track(["report.html"], "drawing the report", 1):
        files |= score_files(scored, notes, result=result, objects=others, sections=sections)
    if whole:
        files[VIEW_SCORE] = view_score(result, scored, others)
    to.mkdir(parents=True, exist_ok=True)
    if to.resolve() == home.resolve():
        add_files(to, files)
        return read_result(to), scored
    _write(to, files)
    return result, scored


def score_home(folder: PathLike) -> Path:
    """Tell where the score of a result is written by default: in it, or in ``score`` in a folder of sections."""
    return Path(folder) / "score" if (Path(folder) / SECTIONS).is_file() else Path(folder)


def score_alarms(
    alarms: PathLike,
    truth: PathLike,
    lane: PathLike,
    output: PathLike,
    *,
    recipe: PathLike | None = None,
    book: PathLike | None = None,
    title: str = "Detection report",
    **rules: Any,
) -> list[Score]:
    """Score an alarm list of any detector (CSV) and write the report; the list has the one score.

    ``lane`` is as for :func:`read_lanes`. ``output`` takes ``report.html``, ``roc.json`` and the figures as PNG and
    PDF. ``recipe`` and ``book``, only together, are a recipe and the register that must hold its hash before the truth
    is opened; the opening is entered there. ``rules`` are those of :class:`flgpr.scoring.Rules`.
    """
    table, where = read_table(alarms, "alarms"), read_lanes(lane)
    targets, notes = _open_truth(truth, alarms, recipe, book)
    scored = [score(table, targets, where, Rules(**rules))]
    _write(Path(output), score_files(scored, notes, title=title))
    return scored


def outcome_table(scored: Sequence[Score]) -> pd.DataFrame:
    """Gather what became of each target in every detection, a row per detection and target.

    Columns are detection, target_id, kind, depth, whether it is found at the operating point, whether any alarm detects
    it, and that alarm's far, rank, n_false and distance.
    """
    columns = ["target_id", "kind", "depth", "found", "detected", "far", "rank", "n_false", "distance"]
    return pd.concat([one.outcomes[columns].assign(detection=one.name) for one in scored], ignore_index=True)


def _open_truth(
    truth: PathLike, alarms: PathLike, recipe: PathLike | None, book: PathLike | None
) -> tuple[pd.DataFrame, dict[str, Any]]:
    """Read the truth, once the register holds the recipe if there is one, and note what is scored against what."""
    if (recipe is None) != (book is None):
        raise ValueError(f"recipe and book must be given together, got {recipe} and {book}")
    notes: dict[str, Any] = {"alarms_sha256": content_hash(Path(alarms))}
    if recipe is not None and book is not None:
        entered = require_registered(book, content_hash(Path(recipe)))
        register(book, event="truth opened", recipe=entered["recipe"], alarms=notes["alarms_sha256"])
        notes |= {"recipe_sha256": entered["recipe"], "recipe_registered": entered["time"]}
    targets = read_table(truth, "truth")
    return targets, notes | {"truth_sha256": content_hash(Path(truth))}


def _page_of(section: Path, to: Path) -> str:
    """Tell the address of a section's page as seen from another folder; "" if it has none."""
    page = section / "report.html"
    return Path(os.path.relpath(page, to)).as_posix() if page.is_file() else ""


def _write(home: Path, files: Mapping[str, bytes | str]) -> None:
    for name, data in files.items():
        (home / name).parent.mkdir(parents=True, exist_ok=True)
        write_whole(home / name, data)


def require_seal() -> None:
    """Refuse before anybody types a passphrase if the library that sealing needs is not installed."""
    if importlib.util.find_spec("cryptography") is None:
        raise ModuleNotFoundError("sealed truth needs the library cryptography: pip install 'flgpr[seal]'")


def seal(
    truth: PathLike,
    lane: PathLike,
    output: PathLike,
    passphrase: str,
    *,
    halo: float = 1.0,
    area: Literal["union", "paper"] = "union",
    by: str | None = "kind",
) -> Path:
    """Encrypt a truth (CSV) with its lane or lanes and rules for blind scoring; a file that exists is refused.

    The lane is as for :func:`read_lanes`, the rest as for :func:`flgpr.scoring.seal_truth`.
    """
    rules: dict[str, Any] = {"halo": halo, "area": area, "by": by}
    return seal_truth(read_table(truth, "truth"), read_lanes(lane), output, passphrase, **rules)


def score_sealed(
    alarms: PathLike, sealed: PathLike, passphrase: str, output: PathLike | None = None, log: PathLike | None = None
) -> BlindScore:
    """Score an alarm list (CSV) against a sealed truth; tells points and counts, nothing that shows a position.

    ``output`` is a folder for ``roc.json`` with what the score tells, ``log`` the log of all looks, beside the sealed
    file by default. Errors are those of :func:`flgpr.scoring.score_blind`.
    """
    told = score_blind(read_table(alarms, "alarms"), existing(sealed, "sealed truth"), passphrase, log)
    if output is not None:
        _write(Path(output), {"roc.json": blind_roc_json(told)})
    return told


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
    """Plan how many mines and how much ground a claim takes, also in words; see :func:`flgpr.scoring.sample_size`."""
    plan = sample_size(pd_claim, far, confidence, true_pd=true_pd, true_far=true_far, power=power, joint=joint)
    sure = f"{100 * confidence:g} %" + (" for both together" if joint else " each")
    lines = [
        f"To show Pd >= {pd_claim:g} at FAR <= {far:g} per m² with {sure}:",
        f"  {plan.mines} mines, of which at most {plan.misses} may be missed",
        f"  {plan.area:.0f} m² of ground outside the halos, with at most {plan.false_alarms} false alarms",
    ]
    if true_pd is not None:
        lines.append(f"  a detector with Pd {true_pd:g} shows it with probability {plan.pd_power:.2f}")
    if true_far is not None:
        lines.append(f"  a detector with FAR {true_far:g} per m² shows it with probability {plan.far_power:.2f}")
    return plan, lines


def plan_lane(
    lane: PathLike,
    targets: PathLike,
    seed: int,
    output: PathLike,
    *,
    spacing: float = 3.0,
    edge: float = 0.5,
    recipe: PathLike | None = None,
    book: PathLike | None = None,
) -> tuple[pd.DataFrame, dict[str, Any]]:
    """Draw an emplacement plan, write it as a truth table and register it with the recipe that will be scored.

    It gives the table and what was registered. ``lane`` is as for :func:`read_lanes`, ``targets`` CSV with ``kind``,
    ``depth`` (m) and ``count``, a row per sort; ``spacing`` and ``edge`` as for :func:`flgpr.scoring.emplacement_plan`,
    m. The register ``book`` is ``<output>.register.jsonl`` by default; the recipe's hash is entered before anybody can
    open the truth. A plan that exists is refused.
    """
    place = Path(output)
    if place.exists():
        raise FileExistsError(f"{place} exists: a plan is drawn once")
    sorts, where = pd.read_csv(existing(targets, "targets file")), read_lanes(lane)
    plan = emplacement_plan(where, sorts, seed, spacing=spacing, edge=edge)
    entry: dict[str, Any] = {"event": "plan", "lanes": _borders(where)}
    entry |= {str(name): value for name, value in plan.attrs.items()}
    if recipe is not None:
        entry["recipe"] = content_hash(Path(recipe))
    write_table(plan, place)
    entry["plan"] = content_hash(place)
    return plan, register(f"{place}.register.jsonl" if book is None else book, **entry)


def _borders(lanes: Lane | Mapping[str, Lane]) -> dict[str, dict[str, float]]:
    return {name: dataclasses.asdict(one) for name, one in as_lanes(lanes).items()}
