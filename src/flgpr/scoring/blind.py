"""Blind scoring: an encrypted truth, scores without positions, and a log of every look.

This guards against accidents, not against the holder of the passphrase, who can open the truth at will.
"""

from __future__ import annotations

import base64
import json
import secrets
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from flgpr.model import check_truth
from flgpr.scoring.chance_level import Chance, chance
from flgpr.scoring.checks import LaneLike, as_lanes
from flgpr.scoring.curve import operating_row
from flgpr.scoring.lane_roc import roc_of
from flgpr.scoring.ledger import alarm_hash, content_hash, read_register, register
from flgpr.scoring.matching import Match, match

FORMAT = "flgpr-sealed-truth-1"
FAR_GRID = (0.001, 0.002, 0.005, 0.01, 0.02, 0.05, 0.1)
_COST = 2**15
_MOST_COST = 2**20  # a sealed file may not make its reader take gigabytes
_SHORTEST = 8


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


def seal_truth(
    truth: pd.DataFrame,
    lane: LaneLike,
    path: str | Path,
    passphrase: str,
    *,
    halo: float = 1.0,
    area: str = "union",
    by: str | None = "kind",
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
    passphrase : str
        At least 8 characters.
    by : str, optional
        Column of truth whose groups get curves of their own beside that of all targets.
    """
    lanes = as_lanes(lane)
    if len(passphrase) < _SHORTEST:
        raise ValueError(f"passphrase must have at least {_SHORTEST} characters, got {len(passphrase)}")
    if by is not None and by not in truth.columns:
        raise ValueError(f"by must name a column of truth, got {by!r}")
    # An empty alarm list is scored once, so that a truth that cannot be scored is never sealed.
    trial = match(pd.DataFrame({"x": [], "y": [], "confidence": [], "lane": []}), truth, lanes, halo)
    roc_of(trial, area=area)  # type: ignore[arg-type]
    content = {
        "truth": check_truth(truth).to_dict("list"),
        "lanes": {name: vars(one) for name, one in lanes.items()},
        "rules": {"halo": float(halo), "area": area, "by": by},
    }
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
    """Decrypt what :func:`seal_truth` wrote: truth table, lanes by name, and the rules ``halo``, ``area`` and ``by``.

    The log of :func:`score_blind` counts it as a look. A file that is no sealed truth or was altered, or a wrong
    passphrase, is a ValueError.
    """
    content = _decrypted(path, passphrase)
    _enter(path, log, event="open")
    return content


def _enter(sealed: str | Path, log: str | Path | None, **entry: Any) -> list[dict[str, Any]]:
    """Enter a look into a sealed truth's log and give all its looks so far."""
    book, key = Path(f"{sealed}.log.jsonl") if log is None else Path(log), content_hash(Path(sealed))
    register(book, sealed=key, **entry)
    return [
        line for line in read_register(book) if line.get("sealed") == key and line.get("event") in ("score", "open")
    ]


def _decrypted(path: str | Path, passphrase: str) -> tuple[pd.DataFrame, dict[str, Any], dict[str, Any]]:
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
    try:
        content = json.loads(_fernet(passphrase, salt, cost).decrypt(token))
    except InvalidToken:
        raise ValueError("passphrase must be the one of the sealed truth, or the file was altered") from None
    truth = pd.DataFrame(content["truth"])
    return truth, content["lanes"], content["rules"]


def score_blind(alarms: pd.DataFrame, sealed: str | Path, passphrase: str, log: str | Path | None = None) -> BlindScore:
    """Score an alarm list against a sealed truth: operating points and counts, nothing that shows a position.

    Every call appends the hash of the alarm list to a log beside the sealed file (``<sealed>.log.jsonl`` if no other is
    named) before anything is shown, so that repeated looks show. Alarms, a file, a passphrase or a log that are not
    valid are a ValueError.
    """
    matched, truth, rules, mine = match_blind(alarms, sealed, passphrase, log)
    groups: list[tuple[str, Any]] = [("all", None)]
    if rules["by"] is not None:
        groups += [(str(value), {rules["by"]: value}) for value in sorted(truth[rules["by"]].dropna().unique())]
    level = chance(matched)
    tables = [_points(matched, level, name, subset, rules["area"]) for name, subset in groups]
    points = pd.concat(tables, ignore_index=True)
    curve = roc_of(matched, area=rules["area"])
    counts = {name: curve.attrs[name] for name in ("n_alarms", "n_targets", "area", "halo_radius", "area_rule")}
    return BlindScore(points, counts, len(mine), len({line["alarms"] for line in mine if "alarms" in line}))


def match_blind(
    alarms: pd.DataFrame,
    sealed: str | Path,
    passphrase: str,
    log: str | Path | None = None,
    some: Sequence[str] = (),
) -> tuple[Match, pd.DataFrame, dict[str, Any], list[dict[str, Any]]]:
    """Match an alarm list to a sealed truth, once the look is entered; with the truth, its rules and all looks so far.

    What it gives shows positions, and is for those who sum it up as :func:`score_blind` does. With ``some`` lanes the
    others and their targets are left out.
    """
    truth, lanes, rules = _decrypted(sealed, passphrase)
    if some:
        lanes = {name: lanes[name] for name in some}
        truth = truth[truth["lane"].isin(lanes)].reset_index(drop=True)
    matched = match(alarms, truth, lanes if list(lanes) != [""] else lanes[""], rules["halo"])
    entry = {"alarms": alarm_hash(matched.alarms), "n_alarms": len(matched.alarms)}
    return matched, truth, rules, _enter(sealed, log, event="score", **entry)


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
