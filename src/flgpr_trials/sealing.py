"""The sealed truth of a blind test: an encrypted file, all of which is authenticated.

It guards against accidents, not against the holder of the passphrase, who can open the truth at
will.
"""

from __future__ import annotations

import base64
import importlib.util
import json
import math
import os
import secrets
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from flgpr.door import read_named, refuse_links
from flgpr.json_text import parse_json
from flgpr.model import check_truth
from flgpr.scoring.lane_roc import roc_of
from flgpr.scoring.matching import LaneLike, as_lanes, match, one_of
from flgpr.types import Entries

FORMAT = "flgpr-sealed-truth-2"
_COST = 2**17  # N of scrypt: half a second and 128 MiB for every guess; less is not opened either
_MOST_COST = 2**20  # a sealed file may not make its reader take gigabytes
_MOST_BYTES = 2**28  # of a sealed file
_NOTE = (
    "encrypted truth of a blind test; "
    "guards against accidents, not against the holder of the passphrase"
)
SHOWS = ("curve", "targets")
"""What a blind score may show: operating points and counts, or also which targets are found."""
Phrase = str | Callable[[], str]
"""A passphrase, or a function that asks for it after all other checks."""
_SHORTEST = 8  # characters
_LEAST_GUESSES = 10**8  # at half a second each, some years of one processor
_JUDGED = 72  # characters that are judged: more can only be harder to guess
PASSPHRASE_RULE = (
    f"at least {_SHORTEST} characters and hard to guess, such as four words that do not belong "
    "together; whoever loses it cannot open the truth again"
)


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
        If the file exists or is a symbolic link.
    ValueError
        If the truth cannot be scored, an option is not valid, or the passphrase is weak.
    ModuleNotFoundError
        Without the libraries ``cryptography`` and ``zxcvbn``, the extra ``seal``.
    """
    refuse_links(Path(path))
    if Path(path).exists():
        raise FileExistsError(f"output must not exist yet, got {path}")
    content = to_seal(truth, lane, halo, area, by, show)
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
    path: str | Path, passphrase: str, content: Entries
) -> tuple[bool, dict[str, str] | None]:
    """Return whether a file seals just this, see :func:`to_seal`, and the register it is bound to.

    Whoever asks has the truth already, so that this is no look at it.
    """
    try:
        opened = decrypt_truth(path, passphrase)
    except (ValueError, OSError):
        return False, None
    sealed = {"truth": opened.truth.to_dict("list"), "lanes": opened.lanes, "rules": opened.rules}
    return _as_json(sealed) == _as_json(content), opened.register


def _as_json(content: Entries) -> Any:
    """Return a content as reading its JSON gives it."""
    return json.loads(json.dumps(content, default=_json_value))


def to_seal(
    truth: pd.DataFrame,
    lane: LaneLike,
    halo: float = 1.0,
    area: str = "union",
    by: str | None = "kind",
    show: str = "curve",
) -> Entries:
    """Return the checked content of a sealed file; the parameters are those of :func:`seal_truth`."""
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


@dataclass(frozen=True)
class SealedTruth:
    """Content of a sealed file."""

    identity: str  #: name under which its looks are counted
    truth: pd.DataFrame
    lanes: Entries
    rules: Entries
    register: dict[str, str] | None  #: the register that it is bound to


def decrypt_truth(path: str | Path, passphrase: Phrase) -> SealedTruth:
    """Decrypt a sealed file, all of which must be as it was written.

    Nothing is entered in a log: that is for the caller, see ``flgpr_trials/blind.py``.

    Parameters
    ----------
    path : str or Path
        The sealed file.
    passphrase : str or callable
        Its passphrase, or a function that asks for it.

    Returns
    -------
    SealedTruth
        Truth, lanes and rules.

    Raises
    ------
    ValueError
        If it is no sealed truth or was altered, or the passphrase is wrong.
    ModuleNotFoundError
        Without the library ``cryptography``.
    """
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
    return SealedTruth(content["identity"], truth, content["lanes"], rules, content.get("book"))


def _header(salt: bytes, nonce: bytes) -> Entries:
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


def _read_sealed(path: Path) -> tuple[Entries, bytes]:
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


def _json_value(value: Any) -> Any:
    """Return a value that JSON does not know as a number or text."""
    return value.item() if isinstance(value, np.generic) else str(value)


def _cipher(passphrase: str, header: Mapping[str, Any]) -> Any:
    """Return the cipher of a sealed file, whose key comes from the passphrase by scrypt."""
    require_seal()
    from cryptography.hazmat.primitives.ciphers.aead import AESGCM
    from cryptography.hazmat.primitives.kdf.scrypt import Scrypt

    scrypt = header["scrypt"]
    salt = base64.b64decode(scrypt["salt"])
    key = Scrypt(salt=salt, length=32, n=scrypt["n"], r=8, p=1).derive(passphrase.encode())
    return AESGCM(key)


def require_seal() -> None:
    """Refuse, before anybody types a passphrase, where a library for sealing is missing."""
    for library in ("cryptography", "zxcvbn"):
        if importlib.util.find_spec(library) is None:
            raise ModuleNotFoundError(
                f"sealed truth needs the library {library}: pip install 'flgpr[seal]'"
            )


def check_passphrase(passphrase: str) -> None:
    """Refuse a passphrase that a program guesses soon.

    The number of guesses is that of zxcvbn (Wheeler 2016), which knows common passwords, names,
    dates, keyboard rows and repetitions. The errors do not contain the passphrase.

    Parameters
    ----------
    passphrase : str
        The passphrase.

    Raises
    ------
    ValueError
        If it is shorter than 8 characters, or is found in fewer than 10⁸ guesses.
    ModuleNotFoundError
        Without the library zxcvbn, the extra ``seal``.

    Examples
    --------
    >>> from flgpr.trials import check_passphrase
    >>> check_passphrase("gravel otter seven lamps")
    >>> check_passphrase("12345678")  # doctest: +ELLIPSIS
    Traceback (most recent call last):
    ...
    ValueError: passphrase must be hard to guess: a program finds it in about 10^1 guesses...
    """
    if len(passphrase) < _SHORTEST:
        raise ValueError(
            f"passphrase must have at least {_SHORTEST} characters, got {len(passphrase)}"
        )
    require_seal()
    from zxcvbn import zxcvbn  # type: ignore[import-untyped]

    guesses = float(zxcvbn(passphrase[:_JUDGED])["guesses"])
    if guesses < _LEAST_GUESSES:
        exponent = max(round(math.log10(guesses)), 0)
        raise ValueError(
            f"passphrase must be hard to guess: a program finds it in about 10^{exponent} guesses, "
            "10^8 at least are asked for; take four words or more that do not belong together"
        )
