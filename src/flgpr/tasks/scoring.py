"""Scoring without a result folder, blind scoring and test planning: files in, files out."""

from __future__ import annotations

import dataclasses
import importlib.util
import json
import math
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Literal

import pandas as pd

from flgpr.execution.lane_run import homes_at
from flgpr.io import read_table, write_table, write_whole
from flgpr.model import Lane
from flgpr.results.result import read_result
from flgpr.scoring import (
    BlindScore,
    SamplePlan,
    as_lanes,
    content_hash,
    emplacement_plan,
    register,
    require_registered,
    sample_size,
    score_blind,
    seal_truth,
    write_report,
)

PathLike = str | Path


def read_lanes(path: PathLike) -> Lane | dict[str, Lane]:
    """Read one lane or several from TOML or CSV.

    Parameters
    ----------
    path : path
        TOML with ``x_min``, ``x_max``, ``y_min``, ``y_max`` (m), or with a table of these per lane; or CSV with these
        columns, one row per lane, named in the column ``lane``.

    Returns
    -------
    Lane or dict of str to Lane
        The lane, or lanes by name.

    Raises
    ------
    FileNotFoundError
        If there is no such file.
    ValueError
        If the file does not hold lanes; the message names it.
    """
    path = Path(path)
    if not path.is_file():
        raise FileNotFoundError(f"lane file not found: {path}")
    try:
        if path.suffix.lower() == ".csv":
            lanes = as_lanes(pd.read_csv(path))
        else:
            lanes = as_lanes(tomllib.loads(path.read_text(encoding="utf-8")))
    except (ValueError, TypeError) as error:
        raise ValueError(f"{path}: {error}") from None
    return lanes[""] if list(lanes) == [""] else lanes


def score_alarms(
    alarms: PathLike,
    truth: PathLike,
    lane: PathLike,
    output: PathLike,
    *,
    halo: float = 1.0,
    halo_as: Literal["radius", "diameter"] = "radius",
    area: Literal["union", "paper"] = "union",
    far: float = 0.01,
    draws: int = 1000,
    seed: int = 0,
    survey_error: float | None = None,
    recipe: PathLike | None = None,
    book: PathLike | None = None,
    title: str = "Detection report",
) -> dict[str, Any]:
    """Score an alarm list of any detector and write the report.

    Parameters
    ----------
    alarms, truth : path
        CSV tables.
    lane : path
        The scored lane or lanes, see :func:`read_lanes`.
    output : path
        Folder for ``report.html``, ``roc.json`` and the figures as PNG and PDF; made if missing.
    halo, halo_as, area, far, draws, seed, survey_error, title
        As for :func:`flgpr.scoring.write_report`.
    recipe, book : path, optional
        A recipe and the register that must hold its hash before the truth is opened; only both together. The opening
        is entered into the register.

    Returns
    -------
    dict
        ``files``, the paths by name, and the counts and PD_mean that ``roc.json`` begins with.

    Raises
    ------
    ValueError, FileNotFoundError
        If an input is not valid or the recipe is not registered; nothing is written then.
    """
    if (recipe is None) != (book is None):
        raise ValueError(f"recipe and book must be given together, got {recipe} and {book}")
    table, where = read_table(alarms, "alarms"), read_lanes(lane)
    notes: dict[str, Any] = {"alarms_sha256": content_hash(Path(alarms))}
    if recipe is not None and book is not None:
        entered = require_registered(book, content_hash(Path(recipe)))
        register(book, event="truth opened", recipe=entered["recipe"], alarms=notes["alarms_sha256"])
        notes["recipe_sha256"], notes["recipe_registered"] = entered["recipe"], entered["time"]
    targets = read_table(truth, "truth")
    notes["truth_sha256"] = content_hash(Path(truth))
    files = write_report(
        output, table, targets, where, halo=halo, halo_as=halo_as, area=area, far=far, draws=draws, seed=seed,
        survey_error=survey_error, title=title, notes=notes,
    )  # fmt: skip
    told = json.loads(files["json"].read_text(encoding="utf-8"))
    told.pop("points")
    return {**told, "files": {name: str(path) for name, path in files.items()}}


def score_sections(
    folder: PathLike,
    truth: PathLike,
    output: PathLike | None = None,
    *,
    recipe: PathLike | None = None,
    book: PathLike | None = None,
) -> dict[str, Any]:
    """Score a lane that was taken in sections as one lane, and write the report.

    Parameters
    ----------
    folder : path
        Folder of sections; the halo is that of its recipe.
    truth : path
        CSV table of the targets.
    output : path, optional
        Folder for the files; default ``score`` in ``folder``.
    recipe, book : path, optional
        As for :func:`score_alarms`.

    Returns
    -------
    dict
        As :func:`score_alarms` returns it.

    Raises
    ------
    ValueError, FileNotFoundError
        If an input is not valid or altered, or the recipe is not registered; nothing is written then.
    """
    home = Path(folder)
    halo = read_result(homes_at(home)[0]).recipe.score.halo
    to = Path(output) if output is not None else home / "score"
    return score_alarms(home / "alarms.csv", truth, home / "lane.toml", to, halo=halo, recipe=recipe, book=book)


def require_seal() -> None:
    """Refuse before anybody types a passphrase if what sealing needs is not installed.

    Raises
    ------
    ModuleNotFoundError
        If the library cryptography is missing.
    """
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
    """Encrypt a truth with its lane and rules for blind scoring.

    Parameters
    ----------
    truth : path
        CSV of the targets.
    lane : path
        The scored lane or lanes, see :func:`read_lanes`.
    output : path
        File to write; an existing one is refused.
    passphrase, halo, area, by
        As for :func:`flgpr.scoring.seal_truth`.

    Returns
    -------
    Path
        The sealed file.

    Raises
    ------
    ValueError, FileNotFoundError, FileExistsError, ModuleNotFoundError
        As :func:`flgpr.scoring.seal_truth`.
    """
    return seal_truth(
        read_table(truth, "truth"), read_lanes(lane), output, passphrase, halo=halo, area=area, by=by
    )  # fmt: skip


def score_sealed(
    alarms: PathLike, sealed: PathLike, passphrase: str, output: PathLike | None = None, log: PathLike | None = None
) -> BlindScore:
    """Score an alarm list against a sealed truth; tells operating points and counts, nothing that shows a position.

    Parameters
    ----------
    alarms : path
        CSV table.
    sealed : path
        File that :func:`seal` wrote.
    passphrase : str
        Its passphrase.
    output : path, optional
        Folder for ``roc.json`` with what the score tells.
    log : path, optional
        Log of all looks; beside the sealed file by default.

    Returns
    -------
    BlindScore
        The score.

    Raises
    ------
    ValueError, FileNotFoundError, ModuleNotFoundError
        As :func:`flgpr.scoring.score_blind`.
    """
    if not Path(sealed).is_file():
        raise FileNotFoundError(f"sealed truth not found: {sealed}")
    score = score_blind(read_table(alarms, "alarms"), sealed, passphrase, log)
    if output is not None:
        home = Path(output)
        home.mkdir(parents=True, exist_ok=True)
        rows = [
            {str(k): None if isinstance(v, float) and not math.isfinite(v) else v for k, v in row.items()}
            for row in score.points.to_dict("records")
        ]
        told = {**score.counts, "looks": score.looks, "lists": score.lists, "points": rows}
        write_whole(home / "roc.json", json.dumps(told, indent=1, allow_nan=False) + "\n")
    return score


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
    """Plan how many mines and how much ground a claim takes, and say it in words.

    Parameters
    ----------
    pd_claim, far, confidence, true_pd, true_far, power, joint
        As for :func:`flgpr.scoring.sample_size`.

    Returns
    -------
    plan : SamplePlan
        The sizes.
    lines : list of str
        The same in words.

    Raises
    ------
    ValueError
        As :func:`flgpr.scoring.sample_size`.
    """
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

    Parameters
    ----------
    lane : path
        The lane or lanes, see :func:`read_lanes`.
    targets : path
        CSV with ``kind``, ``depth`` (m) and ``count``, one row per sort.
    seed : int
        Seed of the draw.
    output : path
        CSV to write; an existing file is refused.
    spacing, edge : float
        As for :func:`flgpr.scoring.emplacement_plan`, m.
    recipe : path, optional
        Recipe whose hash is registered beside the plan's, before anybody can open the truth.
    book : path, optional
        The register; ``<output>.register.jsonl`` by default.

    Returns
    -------
    plan : DataFrame
        Truth table.
    line : dict
        What was registered.

    Raises
    ------
    ValueError, FileNotFoundError, FileExistsError
        If an input is not valid or the plan exists.
    """
    place = Path(output)
    if place.exists():
        raise FileExistsError(f"{place} exists: a plan is drawn once")
    if not Path(targets).is_file():
        raise FileNotFoundError(f"targets file not found: {targets}")
    where = read_lanes(lane)
    plan = emplacement_plan(where, pd.read_csv(targets), seed, spacing=spacing, edge=edge)
    entry: dict[str, Any] = {"event": "plan", "lanes": _borders(where)}
    entry |= {str(name): value for name, value in plan.attrs.items()}
    if recipe is not None:
        entry["recipe"] = content_hash(Path(recipe))
    write_table(plan, place)
    entry["plan"] = content_hash(place)
    return plan, register(f"{place}.register.jsonl" if book is None else book, **entry)


def _borders(lanes: Lane | Mapping[str, Lane]) -> dict[str, dict[str, float]]:
    return {name: dataclasses.asdict(one) for name, one in as_lanes(lanes).items()}
