"""A secret that sender and receiver share, by which a TCP sender shows that it may send.

The receiver begins: it sends :data:`MARK` and 32 random bytes. The sender answers with the same
mark and the HMAC-SHA256 of mark and random bytes under the secret; then its frames follow. The
secret itself never crosses the network, and an answer is of use for one connection alone. What
follows is neither encrypted nor signed: who can change the bytes of a connection on their way needs
no secret.
"""

from __future__ import annotations

import hmac
import os
import secrets
import socket
from pathlib import Path

from flgpr.door import read_named

MARK = b"FLGPRAU1"
"""Beginning of a challenge and of its answer."""
VARIABLE = "FLGPR_LIVE_SECRET"
"""Variable of the environment that may hold the secret."""
ANSWER_BYTES = len(MARK) + 32
"""Bytes of a challenge, and of its answer."""
_FEWEST = 16  # bytes of a secret
_MOST = 4096
_PATIENCE = 10.0  # s that a sender waits for the challenge


def live_secret(path: str | Path | None) -> bytes | None:
    """Return the secret in a file, else that of the environment, else None.

    Parameters
    ----------
    path : path, optional
        The file; blanks and ends of lines around the secret do not count.

    Returns
    -------
    bytes or None
        The secret.

    Raises
    ------
    ValueError
        If it is shorter than 16 bytes, or the file longer than 4096.
    """
    if path is not None:
        name = str(path)
        secret = read_named(path, _MOST).strip()
    elif VARIABLE in os.environ:
        name = VARIABLE
        secret = os.environ[VARIABLE].encode("utf-8", "surrogateescape").strip()
    else:
        return None
    if len(secret) < _FEWEST:
        raise ValueError(
            f"secret must have {_FEWEST} bytes or more, got {len(secret)} in {name}: make one by "
            '`python -c "import secrets; print(secrets.token_hex())"`'
        )
    return secret


def challenge() -> bytes:
    """Return a new challenge."""
    return MARK + secrets.token_bytes(ANSWER_BYTES - len(MARK))


def answer(secret: bytes, asked: bytes) -> bytes:
    """Return the answer of a sender that knows the secret.

    Parameters
    ----------
    secret : bytes
        The secret.
    asked : bytes
        The challenge.

    Returns
    -------
    bytes
        :data:`ANSWER_BYTES` bytes.
    """
    return MARK + hmac.digest(secret, asked, "sha256")


def is_answer(secret: bytes, asked: bytes, given: bytes) -> bool:
    """Return whether an answer is right, in a time that does not tell how much of it is."""
    return hmac.compare_digest(answer(secret, asked), given)


def answer_challenge(connection: socket.socket, secret: bytes) -> None:
    """Wait for the challenge of ``flgpr live`` on a new connection, and answer it.

    Parameters
    ----------
    connection : socket.socket
        The connection.
    secret : bytes
        The secret.

    Raises
    ------
    ValueError
        If no challenge comes: the receiver asks for no secret, or is none.
    """
    asked = b""
    before = connection.gettimeout()
    connection.settimeout(_PATIENCE)
    try:
        while len(asked) < ANSWER_BYTES:
            data = connection.recv(ANSWER_BYTES - len(asked))
            if not data:
                break
            asked += data
    except OSError:
        asked = b""
    finally:
        connection.settimeout(before)
    if len(asked) < ANSWER_BYTES or not asked.startswith(MARK):
        raise ValueError(
            "secret must be asked for by flgpr live at the other end, got no challenge from it: "
            "start it with the same secret"
        )
    connection.sendall(answer(secret, asked))
