"""Blind scoring: scores against a sealed truth without positions, and a log of every look.

The sealed file itself is that of ``flgpr_trials/sealing.py``.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass, field
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from flgpr.commands.reach import are_near
from flgpr.scoring import Match, assign, chance, match, roc_of
from flgpr.scoring.comparison import points_at
from flgpr.types import Entries, PathLike
from flgpr_trials.ledger import (
    RegisterLike,
    WitnessedRegister,
    alarm_hash,
    enter,
    enter_opening,
    head_of,
    read_checked_register,
    read_register,
    require_registered,
    require_truth,
)
from flgpr_trials.sealing import Phrase, SealedTruth, decrypt_truth

FAR_GRID = (0.001, 0.002, 0.005, 0.01, 0.02, 0.05, 0.1)
_LOG_ENDING = ".log.jsonl"
_COUNTS = ("n_alarms", "n_targets", "area", "halo_radius", "area_rule")


@dataclass(frozen=True)
class Registration:
    """What must stand in a register before the first look at a sealed truth."""

    register: RegisterLike  #: the register
    #: recipe, model: hash of the recipe whose alarms are scored, and of its model if it has one
    recipe: str
    model: str | None = None


@dataclass(frozen=True)
class BlindScore:
    """Result of a blind scoring."""

    #: one row per group and allowed FAR: ``group``, ``far_allowed``, ``far``, ``far_low``,
    #: ``far_high``, ``pd``, ``pd_low``, ``pd_high``, ``n_detected``, ``n_targets``, ``n_false``,
    #: and the Pd that ``chance`` gives. It has no thresholds: the confidence at which Pd rises
    #: would show which alarm lies on a target
    points: pd.DataFrame
    #: ``n_alarms``, ``n_targets``, ``area`` (m²), ``halo_radius`` (m), ``area_rule``, and
    #: ``targets_outside``, where targets lie too far outside the lane to be found or missed
    counts: Entries
    looks: int  #: how often this truth was scored or opened so far, this time included
    lists: int  #: number of different alarm lists among them
    #: where the truth's owner allows it, a row per target: ``target_id``, ``kind``, ``depth``, and
    #: ``found_from``, the least allowed FAR of the points at which it is found (NaN: at none);
    #: never a position
    targets: pd.DataFrame | None = None
    #: the register's line of the recipe, if that had to be there
    registered: Entries | None = None
    #: of the ``log`` and the ``register``, the number of ``lines`` and the ``head``, the last one's
    #: hash, which an older copy lacks
    heads: dict[str, Entries] = field(default_factory=dict)


def open_truth(
    path: str | Path, passphrase: str, log: str | Path | None = None
) -> tuple[pd.DataFrame, Entries, Entries]:
    """Decrypt what :func:`flgpr.trials.seal_truth` wrote, which the log counts as a look.

    Parameters
    ----------
    path : str or Path
        The sealed file.
    passphrase : str
        Its passphrase.
    log : str or Path, optional
        Log of the looks, by default that of :func:`score_blind`.

    Returns
    -------
    truth : DataFrame
        Truth table.
    lanes : dict
        Borders of the lanes by name, m.
    rules : dict
        ``halo``, ``area``, ``by`` and ``show``.

    Raises
    ------
    ValueError
        If it is no sealed truth or was altered, or the passphrase is wrong.
    """
    opened = decrypt_truth(path, passphrase)
    _enter(opened.identity, _log_of(path, log, opened.identity), event="open")
    return opened.truth, opened.lanes, opened.rules


def _enter(identity: str, log: RegisterLike, **entry: Any) -> tuple[list[Entries], list[Entries]]:
    """Enter a look into a log; return the truth's looks, this one last, and all lines."""
    lines = enter(log, lambda _: {"sealed": identity, **entry})
    return _looks(identity, lines), lines


def _looks(identity: str, lines: Sequence[Entries]) -> list[Entries]:
    """Return the lines of a log that are looks at a sealed truth."""
    looks = []
    for line in lines:
        if line.get("sealed") == identity and line.get("event") in ("score", "open"):
            looks.append(line)
    return looks


def _log_of(sealed: PathLike, log: PathLike | None, identity: str) -> Path:
    """Return the log of a sealed truth.

    All links to it have one log, and so have copies under other names in its folder.
    """
    if log is not None:
        return Path(log)
    file = Path(sealed).resolve()
    default_log = Path(f"{file}{_LOG_ENDING}")
    if os.path.lexists(default_log):
        return default_log
    for path in sorted(file.parent.iterdir()):
        if path.name.endswith(_LOG_ENDING) and _has_looks(path, identity):
            return path
    return default_log


def _has_looks(log: Path, identity: str) -> bool:
    """Return whether a file is a log with looks at a sealed truth."""
    try:
        return bool(_looks(identity, read_register(log)))
    except (ValueError, OSError):  # another file, or one that was altered
        return False


def score_blind(
    alarms: pd.DataFrame,
    sealed: str | Path,
    passphrase: Phrase,
    log: str | Path | None = None,
    registered: Registration | None = None,
    witness: str | Path | None = None,
) -> BlindScore:
    """Score an alarm list against a sealed truth without showing a position.

    Every call appends the hash of the alarm list to a log before anything is shown, so that
    repeated looks are visible.

    Parameters
    ----------
    alarms : DataFrame
        Alarm table.
    sealed : str or Path
        File of :func:`flgpr.trials.seal_truth`.
    passphrase : str or callable
        Its passphrase, or a function that asks for it after all other checks.
    log : str or Path, optional
        The log; by default the file ``<sealed>.log.jsonl``, or the one in the same folder that has
        looks at this truth already.
    registered : Registration, optional
        What must stand in a register from before the first look; the look is entered there, too. A
        truth that was sealed with a register demands it.
    witness : str or Path, optional
        A witness (:func:`flgpr.trials.check_witness`), which must know all lines of the log and is
        told of the new one.

    Returns
    -------
    BlindScore
        Operating points and counts.

    Raises
    ------
    ValueError
        If alarms, file, passphrase, log or register are not valid.
    """
    look = match_blind(alarms, sealed, passphrase, log, registered=registered, witness=witness)
    return blind_score(look)


def blind_score(look: BlindLook) -> BlindScore:
    """Summarise a look at a sealed truth: operating points and counts, and no positions."""
    matched = look.matched
    rules = look.rules
    area = rules["area"]
    column = rules["by"]
    subsets: Entries = {"all": None}
    if column is not None:
        for value in sorted(look.truth[column].dropna().unique()):
            subsets[str(value)] = {column: value}
    level = chance(matched)
    tables = []
    for name, subset in subsets.items():
        curve = level.add_chance_column(roc_of(matched, subset, area=area), subset)
        # More digits of the chance level could be held against guesses of where targets stand.
        tables.append(points_at(curve, FAR_GRID, "group", name).round({"chance": 2}))
    curve = roc_of(matched, area=area)
    lists = {line["alarms"] for line in look.looks if "alarms" in line}
    targets = None
    if rules["show"] == "targets":
        # The points are coarse enough to hide which alarm found a target.
        outcomes = assign(matched, area)
        first = np.searchsorted(FAR_GRID, outcomes["far"].to_numpy(), side="left")
        columns = [name for name in ("target_id", "lane", "kind", "depth") if name in outcomes]
        targets = outcomes[columns].assign(found_from=np.append(FAR_GRID, np.nan)[first])
    return BlindScore(
        points=pd.concat(tables, ignore_index=True),
        counts={name: curve.attrs[name] for name in _COUNTS} | look.outside,
        looks=len(look.looks),
        lists=len(lists),
        targets=targets,
        registered=look.line,
        heads=look.heads,
    )


@dataclass(frozen=True)
class BlindLook:
    """A look at a sealed truth that was entered in its log.

    It holds positions, and is for callers that summarise it.
    """

    matched: Match  #: alarms and targets
    truth: pd.DataFrame  #: truth table, of targets that the searched ground can show
    #: ``targets_outside``, how many lie farther outside than the halo, if there are any: no misses
    outside: dict[str, int]
    rules: dict[str, Any]  #: ``halo``, ``area``, ``by`` and ``show``
    looks: list[Entries]  #: all looks so far, this one last
    line: Entries | None  #: the register's line of the recipe
    #: of the ``log`` and the ``register``: number of lines, and the last one's hash
    heads: dict[str, Entries]


def match_blind(
    alarms: pd.DataFrame,
    sealed: PathLike,
    passphrase: Phrase,
    log: PathLike | None = None,
    only_lanes: Sequence[str] = (),
    registered: Registration | None = None,
    witness: PathLike | None = None,
) -> BlindLook:
    """Match an alarm list to a sealed truth, and enter the look before anything is returned.

    The result holds positions, and is for callers that summarise it as :func:`score_blind` does.

    Parameters
    ----------
    alarms : pandas.DataFrame
        Alarms with ``x``, ``y`` (m) and ``confidence``.
    sealed : path
        The sealed file.
    passphrase : str or callable
        The passphrase, or a function that asks for it.
    log : path, optional
        Log of all looks, by default beside the sealed file.
    only_lanes : sequence of str
        Names of lanes; all others and their targets are left out. By default none is.
    registered : Registration, optional
        Register and recipe, which a truth that was sealed with a register demands.
    witness : path, optional
        File elsewhere that must know the lines of the log.

    Returns
    -------
    BlindLook
        The match, the rules and the looks so far.

    Raises
    ------
    ValueError
        If an input is not valid, the passphrase is not the right one, the log was changed, or the
        register lacks what the truth demands.
    """
    opened = decrypt_truth(sealed, passphrase)
    log_file = _log_of(sealed, log, opened.identity)
    line = _admitted(sealed, log_file, opened, registered)
    truth = opened.truth
    lanes = opened.lanes
    if only_lanes:
        lanes = {name: lanes[name] for name in only_lanes}
        truth = truth[truth["lane"].isin(lanes)].reset_index(drop=True)
    scored_lanes = lanes if list(lanes) != [""] else lanes[""]
    in_reach = are_near(truth, scored_lanes, opened.rules["halo"], "truth")
    beyond = len(truth) - int(in_reach.sum())
    outside = {"targets_outside": beyond} if beyond else {}
    truth = truth[in_reach].reset_index(drop=True)
    matched = match(alarms, truth, scored_lanes, opened.rules["halo"])
    entry = {"alarms": alarm_hash(matched.alarms), "n_alarms": len(matched.alarms)}
    checked_log = log_file if witness is None else WitnessedRegister(log_file, Path(witness))
    looks, lines = _enter(opened.identity, checked_log, event="score", **entry)
    heads = {"log": head_of(lines)}
    if registered is not None:
        opening = {
            "recipe": registered.recipe,
            "alarms": entry["alarms"],
            "sealed": opened.identity,
            "look": looks[-1]["hash"],
        }
        heads["register"] = enter_opening(registered.register, opening)
    return BlindLook(matched, truth, outside, opened.rules, looks, line, heads)


def _admitted(
    sealed: PathLike, log: Path, opened: SealedTruth, registered: Registration | None
) -> Entries | None:
    """Return the register's line of the recipe, or refuse the look.

    It is None for a truth without a register.
    """
    bound = opened.register
    if registered is None:
        if bound is not None:
            raise ValueError(
                f"{sealed} was sealed with a register: give it by `book`, and by `recipe` what fixes "
                "the detector"
            )
        return None
    register = Path(registered.register)
    lines = read_checked_register(registered.register)
    if bound is not None:
        if bound["line"] not in {line["hash"] for line in lines}:
            raise ValueError(
                f"book must be the register that {sealed} was sealed with, unaltered, "
                f"got {register}"
            )
        require_truth(
            register, bound["truth"], opened.lanes, {"halo": opened.rules["halo"]}, planned=True
        )
    line = require_registered(register, registered.recipe, registered.model)
    looks = _looks(opened.identity, read_register(log))
    entered = set()
    for entry in lines:
        if entry.get("sealed") == opened.identity and "look" in entry:
            entered.add(entry["look"])
    if not entered <= {look["hash"] for look in looks}:
        raise ValueError(
            f"log of {sealed} must have every look that {register} has, got one without them"
        )
    if looks and datetime.fromisoformat(line["time"]) >= datetime.fromisoformat(looks[0]["time"]):
        raise ValueError(
            f"what fixes the detector must be registered before the first look at {sealed}, "
            f"got it at {line['time']}"
        )
    return line
