"""Blind scoring: an encrypted truth, scores without positions, and a log of every look.

This guards against accidents, not against the holder of the passphrase, who can open the truth at
will.
"""

from __future__ import annotations

import base64
import json
import os
import secrets
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from flgpr.door import read_named
from flgpr.json_text import parse_json
from flgpr.model import check_truth
from flgpr.scoring.chance_level import Chance, chance
from flgpr.scoring.curve import operating_row
from flgpr.scoring.lane_roc import assign, roc_of
from flgpr.scoring.matching import LaneLike, Match, as_lanes, match, one_of
from flgpr.trials.ledger import (
    OPENED,
    RegisterLike,
    WitnessedRegister,
    alarm_hash,
    enter,
    head_of,
    read_checked_register,
    read_register,
    register_paths,
    require_registered,
    require_truth,
)
from flgpr.trials.passphrase import check_passphrase

FORMAT = "flgpr-sealed-truth-2"
FAR_GRID = (0.001, 0.002, 0.005, 0.01, 0.02, 0.05, 0.1)
_COST = 2**17  # N of scrypt: half a second and 128 MiB for every guess; less is not opened either
_MOST_COST = 2**20  # a sealed file may not make its reader take gigabytes
_MOST_BYTES = 2**28  # of a sealed file
_LOG_ENDING = ".log.jsonl"
_COUNTS = ("n_alarms", "n_targets", "area", "halo_radius", "area_rule")
_POINT_COLUMNS = [
    "far",
    "far_low",
    "far_high",
    "pd",
    "pd_low",
    "pd_high",
    "n_detected",
    "n_targets",
    "n_false",
]
_NOTE = (
    "encrypted truth of a blind test; "
    "guards against accidents, not against the holder of the passphrase"
)
SHOWS = ("curve", "targets")
"""What a blind score may show: operating points and counts, or also which targets are found."""
Phrase = str | Callable[[], str]
"""A passphrase, or a function that asks for it after all other checks."""


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
    #: ``n_alarms``, ``n_targets``, ``area`` (m²), ``halo_radius`` (m), ``area_rule``
    counts: dict[str, Any]
    looks: int  #: how often this truth was scored or opened so far, this time included
    lists: int  #: number of different alarm lists among them
    #: where the truth's owner allows it, a row per target: ``target_id``, ``kind``, ``depth``, and
    #: ``found_from``, the least allowed FAR of the points at which it is found (NaN: at none);
    #: never a position
    targets: pd.DataFrame | None = None
    #: the register's line of the recipe, if that had to be there
    registered: dict[str, Any] | None = None
    #: of the ``log`` and the ``register``, the number of ``lines`` and the ``head``, the last one's
    #: hash, which an older copy lacks
    heads: dict[str, dict[str, Any]] = field(default_factory=dict)


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
    register: Mapping[str, str] | None = None,
) -> Path:
    """Write an encrypted truth together with the lane and the rules it is to be scored by.

    The key comes from the passphrase by scrypt. The content is encrypted with AES-256-GCM, and the
    whole file is authenticated with it: its format, note, cost and salt enter as associated data,
    and no other way of writing them is read. An identity within the ciphertext, drawn at random, is
    what looks are counted by, so that a copy, or a file sealed again, has a count of its own and an
    altered one none.

    Parameters
    ----------
    truth, lane, halo, area
        As for :func:`flgpr.scoring.roc`; area is "union" or "paper".
    path : str or Path
        File to write; an existing one is refused.
    passphrase : str or callable
        One that is hard to guess (:func:`flgpr.trials.check_passphrase`); or a function that asks
        for it after all other checks.
    by : str, optional
        Column of truth whose groups get curves of their own beside that of all targets.
    show : {"curve", "targets"}
        What a score may show: operating points and counts, or also which target is found at which
        of the points. Either way no positions.
    register : mapping, optional
        ``truth``, hash of the truth in a register, and ``line``, hash of that register's last line:
        scores then demand this register, with the recipe in it.

    Returns
    -------
    Path
        The file.

    Raises
    ------
    FileExistsError
        If the file exists.
    ValueError
        If the truth cannot be scored, an option is not valid, or the passphrase is weak.
    ModuleNotFoundError
        Without the libraries ``cryptography`` and ``zxcvbn``, the extra ``seal``.
    """
    if Path(path).exists():
        raise FileExistsError(f"output must not exist yet, got {path}")
    content = _to_seal(truth, lane, halo, area, by, show)
    content["book"] = None if register is None else dict(register)
    content["identity"] = secrets.token_hex(16)
    passphrase = passphrase() if callable(passphrase) else passphrase
    check_passphrase(passphrase)
    header = _header(secrets.token_bytes(16), secrets.token_bytes(12))
    plaintext = json.dumps(content, default=_json_value).encode()
    ciphertext = _cipher(passphrase, header).encrypt(*_cipher_arguments(header, plaintext))
    file = Path(path)
    with file.open("xb") as stream:
        stream.write(_file_content(header, ciphertext))
        stream.flush()
        os.fsync(stream.fileno())
    return file


def seals(
    path: str | Path,
    passphrase: str,
    truth: pd.DataFrame,
    lane: LaneLike,
    *,
    halo: float = 1.0,
    area: str = "union",
    by: str | None = "kind",
    show: str = "curve",
) -> tuple[bool, dict[str, str] | None]:
    """Return whether a file seals this truth, lane and rules, and the register it is bound to.

    The parameters are those of :func:`seal_truth`. Whoever asks has the truth already, so that this
    is no look at it.
    """
    expected = _as_json(_to_seal(truth, lane, halo, area, by, show))
    try:
        opened = _decrypted(path, passphrase)
    except (ValueError, OSError):
        return False, None
    sealed = {"truth": opened.truth.to_dict("list"), "lanes": opened.lanes, "rules": opened.rules}
    return _as_json(sealed) == expected, opened.register


def _as_json(content: dict[str, Any]) -> Any:
    """Return a content as reading its JSON gives it."""
    return json.loads(json.dumps(content, default=_json_value))


def _to_seal(
    truth: pd.DataFrame, lane: LaneLike, halo: float, area: str, by: str | None, show: str
) -> dict[str, Any]:
    """Return the checked content of a sealed file."""
    lanes = as_lanes(lane)
    one_of("show", show, SHOWS)
    if by is not None and by not in truth.columns:
        raise ValueError(f"by must name a column of truth, got {by!r}")
    # An empty alarm list is scored once, so that a truth that cannot be scored is never sealed.
    no_alarms = pd.DataFrame({"x": [], "y": [], "confidence": [], "lane": []})
    roc_of(match(no_alarms, truth, lanes, halo), area=area)  # type: ignore[arg-type]
    return {
        "truth": check_truth(truth).to_dict("list"),
        "lanes": {name: vars(borders) for name, borders in lanes.items()},
        "rules": {"halo": float(halo), "area": area, "by": by, "show": show},
    }


def open_truth(
    path: str | Path, passphrase: str, log: str | Path | None = None
) -> tuple[pd.DataFrame, dict[str, Any], dict[str, Any]]:
    """Decrypt what :func:`seal_truth` wrote, which the log counts as a look.

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
    opened = _decrypted(path, passphrase)
    _enter(opened.identity, _log_of(path, log, opened.identity), event="open")
    return opened.truth, opened.lanes, opened.rules


@dataclass(frozen=True)
class _Opened:
    """Content of a sealed file."""

    identity: str  #: name under which its looks are counted
    truth: pd.DataFrame
    lanes: dict[str, Any]
    rules: dict[str, Any]
    register: dict[str, str] | None  #: the register that it is bound to


def _enter(
    identity: str, log: RegisterLike, **entry: Any
) -> tuple[list[dict[str, Any]], list[dict[str, Any]]]:
    """Enter a look into a log; return the truth's looks, this one last, and all lines."""
    lines = enter(log, lambda _: {"sealed": identity, **entry})
    return _looks(identity, lines), lines


def _looks(identity: str, lines: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
    """Return the lines of a log that are looks at a sealed truth."""
    looks = []
    for line in lines:
        if line.get("sealed") == identity and line.get("event") in ("score", "open"):
            looks.append(line)
    return looks


def _log_of(sealed: str | Path, log: str | Path | None, identity: str) -> Path:
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


def _decrypted(path: str | Path, passphrase: Phrase) -> _Opened:
    """Decrypt a sealed file, all of which must be as it was written."""
    header, ciphertext = _read_sealed(Path(path))
    cost = header["scrypt"]["n"]
    is_power_of_two = cost & (cost - 1) == 0
    if not (_COST <= cost <= _MOST_COST and is_power_of_two):
        raise ValueError(
            "sealed must have a scrypt cost that is a power of two "
            f"from {_COST} to {_MOST_COST}, got {cost}"
        )
    passphrase = passphrase() if callable(passphrase) else passphrase
    cipher = _cipher(passphrase, header)
    from cryptography.exceptions import InvalidTag  # installed, since the cipher was made

    try:
        content = parse_json(cipher.decrypt(*_cipher_arguments(header, ciphertext)))
    except InvalidTag:
        raise ValueError(
            "passphrase must be the one of the sealed truth, or the file was altered"
        ) from None
    rules = {"show": SHOWS[0], **content["rules"]}
    truth = pd.DataFrame(content["truth"])
    return _Opened(content["identity"], truth, content["lanes"], rules, content.get("book"))


def _header(salt: bytes, nonce: bytes) -> dict[str, Any]:
    """Return the part of a sealed file that is not encrypted; all of it is authenticated."""
    return {
        "format": FORMAT,
        "note": _NOTE,
        "nonce": base64.b64encode(nonce).decode(),
        "scrypt": {"n": _COST, "r": 8, "p": 1, "salt": base64.b64encode(salt).decode()},
    }


def _file_content(header: Mapping[str, Any], ciphertext: bytes) -> bytes:
    """Return the content of a sealed file, of which there is one form only."""
    content = {**header, "sealed": base64.b64encode(ciphertext).decode()}
    return json.dumps(content, indent=1).encode() + b"\n"


def _read_sealed(path: Path) -> tuple[dict[str, Any], bytes]:
    """Read header and ciphertext of a sealed file, which must be as it was written."""
    data = read_named(path, _MOST_BYTES)
    try:
        content = parse_json(data)
        format_ = content["format"]
        salt = base64.b64decode(content["scrypt"]["salt"])
        nonce = base64.b64decode(content["nonce"])
        ciphertext = base64.b64decode(content["sealed"])
        header = _header(salt, nonce)
        header["scrypt"]["n"] = int(content["scrypt"]["n"])
        as_written = _file_content(header, ciphertext) == data
    except (ValueError, KeyError, TypeError, AttributeError):
        if b"flgpr-sealed-truth-1" in data[:200]:
            raise ValueError(
                f"sealed must be a file of the format {FORMAT}, got {path} of an earlier version, "
                "which did not authenticate all of it: seal the truth again"
            ) from None
        format_ = None
        as_written = False
    if format_ != FORMAT:
        raise ValueError(f"sealed must be a file of the format {FORMAT}, got {path}")
    if not as_written or len(nonce) != 12:
        raise ValueError(f"sealed must be as it was written, got {path}, which was altered")
    return header, ciphertext


def _cipher_arguments(header: Mapping[str, Any], data: bytes) -> tuple[bytes, bytes, bytes]:
    """Return what a cipher takes: nonce, data, and the header as associated data."""
    nonce = base64.b64decode(header["nonce"])
    associated = json.dumps(header, sort_keys=True).encode()
    return nonce, data, associated


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
        File of :func:`seal_truth`.
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
    matched = look.matched
    rules = look.rules
    area = rules["area"]
    column = rules["by"]
    subsets: dict[str, Any] = {"all": None}
    if column is not None:
        for value in sorted(look.truth[column].dropna().unique()):
            subsets[str(value)] = {column: value}
    level = chance(matched)
    tables = []
    for name, subset in subsets.items():
        tables.append(_points(matched, level, name, subset, area))
    curve = roc_of(matched, area=area)
    lists = {line["alarms"] for line in look.looks if "alarms" in line}
    targets = None
    if rules["show"] == "targets":
        targets = _found_from(matched, area)
    return BlindScore(
        points=pd.concat(tables, ignore_index=True),
        counts={name: curve.attrs[name] for name in _COUNTS},
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
    truth: pd.DataFrame  #: truth table
    rules: dict[str, Any]  #: ``halo``, ``area``, ``by`` and ``show``
    looks: list[dict[str, Any]]  #: all looks so far, this one last
    line: dict[str, Any] | None  #: the register's line of the recipe
    #: of the ``log`` and the ``register``: number of lines, and the last one's hash
    heads: dict[str, dict[str, Any]]


def match_blind(
    alarms: pd.DataFrame,
    sealed: str | Path,
    passphrase: Phrase,
    log: str | Path | None = None,
    only_lanes: Sequence[str] = (),
    registered: Registration | None = None,
    witness: str | Path | None = None,
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
    opened = _decrypted(sealed, passphrase)
    log_file = _log_of(sealed, log, opened.identity)
    line = _admitted(sealed, log_file, opened, registered)
    truth = opened.truth
    lanes = opened.lanes
    if only_lanes:
        lanes = {name: lanes[name] for name in only_lanes}
        truth = truth[truth["lane"].isin(lanes)].reset_index(drop=True)
    scored_lanes = lanes if list(lanes) != [""] else lanes[""]
    matched = match(alarms, truth, scored_lanes, opened.rules["halo"])
    entry = {"alarms": alarm_hash(matched.alarms), "n_alarms": len(matched.alarms)}
    checked_log = log_file if witness is None else WitnessedRegister(log_file, Path(witness))
    looks, lines = _enter(opened.identity, checked_log, event="score", **entry)
    heads = {"log": head_of(lines)}
    if registered is not None:
        opening = {
            "event": OPENED,
            "recipe": registered.recipe,
            "alarms": entry["alarms"],
            "sealed": opened.identity,
            "look": looks[-1]["hash"],
        }
        heads["register"] = head_of(enter(registered.register, lambda _: opening))
    return BlindLook(matched, truth, opened.rules, looks, line, heads)


def _admitted(
    sealed: str | Path, log: Path, opened: _Opened, registered: Registration | None
) -> dict[str, Any] | None:
    """Return the register's line of the recipe, or refuse the look.

    It is None for a truth without a register.
    """
    bound = opened.register
    if registered is None:
        if bound is not None:
            raise ValueError(
                f"{sealed} was sealed with a register: it is scored with --recipe and --book only"
            )
        return None
    register, _ = register_paths(registered.register)
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
            f"recipe must be registered before the first look at {sealed}, got it at {line['time']}"
        )
    return line


def _found_from(matched: Match, area: Any) -> pd.DataFrame:
    """Return the least FAR of the points at which every target is found.

    The points are coarse enough to hide which alarm found it.
    """
    outcomes = assign(matched, area)
    first = np.searchsorted(FAR_GRID, outcomes["far"].to_numpy(), side="left")
    columns = [name for name in ("target_id", "lane", "kind", "depth") if name in outcomes]
    return outcomes[columns].assign(found_from=np.append(FAR_GRID, np.nan)[first])


def _points(matched: Match, level: Chance, name: str, subset: Any, area: Any) -> pd.DataFrame:
    """Return the operating points of a group of targets."""
    curve = level.add_chance_column(roc_of(matched, subset, area=area), subset)
    rows = curve.iloc[operating_row(curve, np.array(FAR_GRID))].reset_index(drop=True)
    # More digits of the chance level could be held against guesses of where targets stand.
    rows = rows[[*_POINT_COLUMNS, "chance"]].round({"chance": 2})
    rows = rows.assign(group=name, far_allowed=FAR_GRID)
    rows.attrs = {}
    return rows[["group", "far_allowed", *_POINT_COLUMNS, "chance"]]


def _json_value(value: Any) -> Any:
    """Return a value that JSON does not know as a number or text."""
    return value.item() if isinstance(value, np.generic) else str(value)


def _cipher(passphrase: str, header: Mapping[str, Any]) -> Any:
    """Return the cipher of a sealed file, whose key comes from the passphrase by scrypt."""
    try:
        from cryptography.hazmat.primitives.ciphers.aead import AESGCM
        from cryptography.hazmat.primitives.kdf.scrypt import Scrypt
    except ModuleNotFoundError as error:
        raise ModuleNotFoundError(
            'sealed truth needs the library cryptography: pip install "flgpr[seal]"'
        ) from error
    scrypt = header["scrypt"]
    salt = base64.b64decode(scrypt["salt"])
    key = Scrypt(salt=salt, length=32, n=scrypt["n"], r=8, p=1).derive(passphrase.encode())
    return AESGCM(key)
