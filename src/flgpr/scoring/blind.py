"""Blind scoring: an encrypted truth, scores without positions, and a log of every look.

This guards against accidents, not against the holder of the passphrase, who can open the truth at will.
"""

from __future__ import annotations

import base64
import json
import secrets
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from flgpr.model import check_truth
from flgpr.scoring.chance_level import Chance, chance
from flgpr.scoring.curve import operating_row
from flgpr.scoring.lane_roc import assign, roc_of
from flgpr.scoring.ledger import (
    OPENED,
    alarm_hash,
    content_hash,
    read_register,
    register,
    require_registered,
    require_truth,
)
from flgpr.scoring.matching import LaneLike, Match, as_lanes, match, one_of

FORMAT = "flgpr-sealed-truth-1"
FAR_GRID = (0.001, 0.002, 0.005, 0.01, 0.02, 0.05, 0.1)
_COST = 2**15
_MOST_COST = 2**20  # a sealed file may not make its reader take gigabytes
_SHORTEST = 8
PASSPHRASE_RULE = f"at least {_SHORTEST} characters; whoever loses it cannot open the truth again"
SHOWS = ("curve", "targets")
"""What a blind score may tell: operating points and counts, or also which targets are found, without places."""
Phrase = str | Callable[[], str]
"""A passphrase, or what asks for it once all else is found right."""


@dataclass(frozen=True)
class Registration:
    """What must stand in a register before a sealed truth is looked at."""

    book: Path  #: the register
    #: recipe, model: hash of the recipe whose alarms are scored, and of its model if it is known to have one
    recipe: str
    model: str | None = None


@dataclass(frozen=True)
class BlindScore:
    """What a blind scoring tells."""

    #: one row per group and allowed FAR: ``group``, ``far_allowed``, ``far``, ``far_low``, ``far_high``, ``pd``,
    #: ``pd_low``, ``pd_high``, ``n_detected``, ``n_targets``, ``n_false``, and the Pd that ``chance`` gives. It has no
    #: thresholds: the confidence at which Pd rises would tell which alarm lies on a target
    points: pd.DataFrame
    counts: dict[str, Any]  #: ``n_alarms``, ``n_targets``, ``area`` (m²), ``halo_radius`` (m), ``area_rule``
    looks: int  #: how often this truth was scored or opened so far, this time included
    lists: int  #: how many different alarm lists that were
    #: where the truth's owner allows it, a row per target: ``target_id``, ``kind``, ``depth``, and ``found_from``, the
    #: least allowed FAR of the points at which it is found (NaN: at none); never a place
    targets: pd.DataFrame | None = None
    registered: dict[str, Any] | None = None  #: the register's line of the recipe, if that had to be there


def seal_truth(
    truth: pd.DataFrame,
    lane: LaneLike,
    path: str | Path,
    passphrase: Phrase,
    *,
    halo: float = 1.0,
    area: str = "union",
    by: str | None = "kind",
    show: str = "curve",
    book: Mapping[str, str] | None = None,
) -> Path:
    """Write an encrypted truth together with the lane and the rules it is to be scored by.

    The key comes from the passphrase by scrypt, the content is encrypted and authenticated with Fernet (AES-128-CBC
    and HMAC-SHA-256); both from the library ``cryptography``, the extra ``seal``, without which it is a
    ModuleNotFoundError.

    Parameters
    ----------
    truth, lane, halo, area
        As for :func:`flgpr.scoring.roc`; area is "union" or "paper".
    path : str or Path
        File to write, and returned; an existing one is refused.
    passphrase : str or callable
        At least 8 characters; or what asks for it, when everything else is found right.
    by : str, optional
        Column of truth whose groups get curves of their own beside that of all targets.
    show : {"curve", "targets"}
        What a score may tell: operating points and counts, or also which target is found at which of the points. Either
        way no places.
    book : mapping, optional
        ``truth``, hash of the truth in a register, and ``line``, hash of that register's last line: scores then demand
        this register, with the recipe in it.
    """
    lanes = as_lanes(lane)
    one_of("show", show, SHOWS)
    if Path(path).exists():
        raise FileExistsError(f"output must not exist yet, got {path}")
    if by is not None and by not in truth.columns:
        raise ValueError(f"by must name a column of truth, got {by!r}")
    # An empty alarm list is scored once, so that a truth that cannot be scored is never sealed.
    trial = match(pd.DataFrame({"x": [], "y": [], "confidence": [], "lane": []}), truth, lanes, halo)
    roc_of(trial, area=area)  # type: ignore[arg-type]
    content = {
        "truth": check_truth(truth).to_dict("list"),
        "lanes": {name: vars(one) for name, one in lanes.items()},
        "rules": {"halo": float(halo), "area": area, "by": by, "show": show},
        "book": None if book is None else dict(book),
    }
    passphrase = passphrase() if callable(passphrase) else passphrase
    if len(passphrase) < _SHORTEST:
        raise ValueError(f"passphrase must have at least {_SHORTEST} characters, got {len(passphrase)}")
    salt = secrets.token_bytes(16)
    token = _fernet(passphrase, salt, _COST).encrypt(json.dumps(content, default=_plain).encode())
    sealed = {
        "format": FORMAT,
        "note": "encrypted truth of a blind test; guards against accidents, not against the holder of the passphrase",
        "scrypt": {"n": _COST, "r": 8, "p": 1, "salt": base64.b64encode(salt).decode()},
        "token": token.decode(),
    }
    file = Path(path)
    with file.open("x", encoding="utf-8") as stream:
        json.dump(sealed, stream, indent=1)
    return file


def open_truth(
    path: str | Path, passphrase: str, log: str | Path | None = None
) -> tuple[pd.DataFrame, dict[str, Any], dict[str, Any]]:
    """Decrypt what :func:`seal_truth` wrote: truth, lanes by name, and rules (``halo``, ``area``, ``by``, ``show``).

    The log of :func:`score_blind` counts it as a look. A file that is no sealed truth or was altered, or a wrong
    passphrase, is a ValueError.
    """
    content = _decrypted(path, passphrase)[0]
    _enter(path, log, event="open")
    return content


def _enter(sealed: str | Path, log: str | Path | None, **entry: Any) -> list[dict[str, Any]]:
    """Enter a look into a sealed truth's log and give all its looks so far."""
    register(_log_of(sealed, log), sealed=content_hash(Path(sealed)), **entry)
    return _looks(sealed, log)


def _looks(sealed: str | Path, log: str | Path | None) -> list[dict[str, Any]]:
    key = content_hash(Path(sealed))
    lines = read_register(_log_of(sealed, log))
    return [line for line in lines if line.get("sealed") == key and line.get("event") in ("score", "open")]


def _log_of(sealed: str | Path, log: str | Path | None) -> Path:
    """Find the log of a sealed truth: one for all links to it."""
    return Path(f"{Path(sealed).resolve()}.log.jsonl") if log is None else Path(log)


def _decrypted(
    path: str | Path, passphrase: Phrase
) -> tuple[tuple[pd.DataFrame, dict[str, Any], dict[str, Any]], dict[str, str] | None]:
    """Decrypt truth, lanes and rules, and tell the register that it is bound to."""
    from cryptography.fernet import InvalidToken

    try:
        sealed = json.loads(Path(path).read_text(encoding="utf-8"))
        known = sealed["format"] == FORMAT
        cost, salt = int(sealed["scrypt"]["n"]), base64.b64decode(sealed["scrypt"]["salt"])
        token = sealed["token"].encode()
    except (ValueError, KeyError, TypeError, AttributeError):
        known = False
    if not known:
        raise ValueError(f"sealed must be a file of the format {FORMAT}, got {path}")
    if not (2 <= cost <= _MOST_COST and cost & (cost - 1) == 0):
        raise ValueError(f"sealed must have a scrypt cost that is a power of two up to {_MOST_COST}, got {cost}")
    passphrase = passphrase() if callable(passphrase) else passphrase
    try:
        content = json.loads(_fernet(passphrase, salt, cost).decrypt(token))
    except InvalidToken:
        raise ValueError("passphrase must be the one of the sealed truth, or the file was altered") from None
    truth = pd.DataFrame(content["truth"])
    return (truth, content["lanes"], {"show": SHOWS[0], **content["rules"]}), content.get("book")


def score_blind(
    alarms: pd.DataFrame,
    sealed: str | Path,
    passphrase: Phrase,
    log: str | Path | None = None,
    registered: Registration | None = None,
) -> BlindScore:
    """Score an alarm list against a sealed truth: operating points and counts, nothing that shows a position.

    Every call appends the hash of the alarm list to a log beside the sealed file (``<sealed>.log.jsonl`` if no other is
    named) before anything is shown, so that repeated looks show. What is ``registered`` must stand in its register
    from before the first look, where the look is entered, too; a truth that was sealed with a register demands it.
    Alarms, a file, a passphrase, a log or a register that are not valid are a ValueError.
    """
    matched, truth, rules, mine, line = match_blind(alarms, sealed, passphrase, log, registered=registered)
    groups: list[tuple[str, Any]] = [("all", None)]
    if rules["by"] is not None:
        groups += [(str(value), {rules["by"]: value}) for value in sorted(truth[rules["by"]].dropna().unique())]
    level = chance(matched)
    tables = [_points(matched, level, name, subset, rules["area"]) for name, subset in groups]
    points = pd.concat(tables, ignore_index=True)
    curve = roc_of(matched, area=rules["area"])
    counts = {name: curve.attrs[name] for name in ("n_alarms", "n_targets", "area", "halo_radius", "area_rule")}
    targets = _found_from(matched, rules["area"]) if rules["show"] == "targets" else None
    return BlindScore(
        points, counts, len(mine), len({line["alarms"] for line in mine if "alarms" in line}), targets, line
    )


def match_blind(
    alarms: pd.DataFrame,
    sealed: str | Path,
    passphrase: Phrase,
    log: str | Path | None = None,
    some: Sequence[str] = (),
    registered: Registration | None = None,
) -> tuple[Match, pd.DataFrame, dict[str, Any], list[dict[str, Any]], dict[str, Any] | None]:
    """Match an alarm list to a sealed truth, once the look is entered; with the truth, its rules and all looks so far.

    The last that it gives is the register's line of the recipe. What it gives shows positions, and is for those who sum
    it up as :func:`score_blind` does. With ``some`` lanes the others and their targets are left out.
    """
    (truth, lanes, rules), bound = _decrypted(sealed, passphrase)
    line = _admitted(sealed, log, lanes, rules, bound, registered)
    if some:
        lanes = {name: lanes[name] for name in some}
        truth = truth[truth["lane"].isin(lanes)].reset_index(drop=True)
    matched = match(alarms, truth, lanes if list(lanes) != [""] else lanes[""], rules["halo"])
    entry = {"alarms": alarm_hash(matched.alarms), "n_alarms": len(matched.alarms)}
    mine = _enter(sealed, log, event="score", **entry)
    if registered is not None:
        looked = {"sealed": content_hash(Path(sealed)), "look": mine[-1]["hash"]}
        register(registered.book, event=OPENED, recipe=registered.recipe, alarms=entry["alarms"], **looked)
    return matched, truth, rules, mine, line


def _admitted(
    sealed: str | Path,
    log: str | Path | None,
    lanes: Mapping[str, Any],
    rules: Mapping[str, Any],
    bound: Mapping[str, str] | None,
    registered: Registration | None,
) -> dict[str, Any] | None:
    """Find the line of the recipe in the register, or refuse the look; None where no register is asked for."""
    if registered is None:
        if bound is not None:
            raise ValueError(f"{sealed} was sealed with a register: it is scored with --recipe and --book only")
        return None
    book = registered.book
    if bound is not None:
        if bound["line"] not in {line["hash"] for line in read_register(book)}:
            raise ValueError(f"book must be the register that {sealed} was sealed with, unaltered, got {book}")
        require_truth(book, bound["truth"], lanes, {"halo": rules["halo"]}, planned=True)
    line = require_registered(book, registered.recipe, registered.model)
    looks, key = _looks(sealed, log), content_hash(Path(sealed))
    entered = {one["look"] for one in read_register(book) if one.get("sealed") == key and "look" in one}
    if not entered <= {look["hash"] for look in looks}:
        raise ValueError(f"log of {sealed} must have every look that {book} has, got one without them")
    if looks and datetime.fromisoformat(line["time"]) >= datetime.fromisoformat(looks[0]["time"]):
        raise ValueError(f"recipe must be registered before the first look at {sealed}, got it at {line['time']}")
    return line


def _found_from(matched: Match, area: Any) -> pd.DataFrame:
    """Tell of every target the least FAR of the points at which it is found, coarse enough to hide which alarm did."""
    outcomes = assign(matched, area)
    first = np.searchsorted(FAR_GRID, outcomes["far"].to_numpy(), side="left")
    columns = [name for name in ("target_id", "lane", "kind", "depth") if name in outcomes]
    return outcomes[columns].assign(found_from=np.append(FAR_GRID, np.nan)[first])


def _points(matched: Match, level: Chance, name: str, subset: Any, area: Any) -> pd.DataFrame:
    curve = level.beside(roc_of(matched, subset, area=area), subset)
    rows = curve.iloc[operating_row(curve, np.array(FAR_GRID))].reset_index(drop=True)
    columns = ["far", "far_low", "far_high", "pd", "pd_low", "pd_high", "n_detected", "n_targets", "n_false"]
    # More digits of the chance level could be held against guesses of where targets stand.
    rows = rows[[*columns, "chance"]].round({"chance": 2}).assign(group=name, far_allowed=FAR_GRID)
    rows.attrs = {}
    return rows[["group", "far_allowed", *columns, "chance"]]


def _plain(value: Any) -> Any:
    return value.item() if isinstance(value, np.generic) else str(value)


def _fernet(passphrase: str, salt: bytes, cost: int) -> Any:
    try:
        from cryptography.fernet import Fernet
        from cryptography.hazmat.primitives.kdf.scrypt import Scrypt
    except ModuleNotFoundError as error:
        raise ModuleNotFoundError('sealed truth needs the library cryptography: pip install "flgpr[seal]"') from error
    key = Scrypt(salt=salt, length=32, n=cost, r=8, p=1).derive(passphrase.encode())
    return Fernet(base64.urlsafe_b64encode(key))
