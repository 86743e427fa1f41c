"""Sockets that scans arrive on, TCP and Unix, that listen or connect, and why they cannot.

Without an address TCP is open to this machine alone. Any other interface must be asked for by its
address. There is no name look-up: a name that resolves to another machine opens nothing.

A secret that sender and receiver share, by which a TCP sender shows that it may send.

The receiver begins: it sends :data:`MARK` and 32 random bytes. The sender answers with the same
mark and the HMAC-SHA256 of mark and random bytes under the secret; then its frames follow. The
secret itself never crosses the network, and an answer is of use for one connection alone. What
follows is neither encrypted nor signed: who can change the bytes of a connection on their way needs
no secret.
"""

from __future__ import annotations

import errno
import hmac
import ipaddress
import os
import re
import secrets
import socket
import stat
from dataclasses import dataclass
from pathlib import Path

from flgpr import system
from flgpr.door import read_named
from flgpr.types import PathLike

LOOPBACK = "127.0.0.1"
_CONNECT_TIMEOUT = 10.0  # s until a machine that does not answer is given up
_ADDRESS = re.compile(
    r"(?:(?P<host>[^\[\]:]+):|\[(?P<long>[^\[\]]+)\]:)?(?P<port>[0-9]{1,5})", re.ASCII
)


@dataclass(frozen=True)
class TcpAddress:
    """An IP address and a port."""

    host: str
    port: int

    @property
    def is_loopback(self) -> bool:
        """Whether only programs on this machine can reach it."""
        return ipaddress.ip_address(self.host).is_loopback

    def __str__(self) -> str:
        return system.address_text(self.host, self.port)


def parse_tcp(text: str) -> TcpAddress:
    """Return the address that a text such as ``5601`` or ``192.168.1.10:5601`` names.

    Parameters
    ----------
    text : str
        ``PORT``, which is that of 127.0.0.1, or ``ADDRESS:PORT`` with an IP address;
        ``[::1]:5601`` with one of version 6. ``localhost`` stands for 127.0.0.1.

    Returns
    -------
    TcpAddress
        Address and port.

    Raises
    ------
    ValueError
        If the text is none of these.
    """
    rule = "tcp must be PORT or ADDRESS:PORT with an IP address, such as 5601 or 0.0.0.0:5601"
    matched = _ADDRESS.fullmatch(str(text))
    if matched is None:
        raise ValueError(f"{rule}, got {text!r}")
    port = int(matched["port"])
    if port > system.LARGEST_PORT:
        raise ValueError(f"tcp must have a port from 0 to {system.LARGEST_PORT}, got {port}")
    host = matched["host"] or matched["long"] or LOOPBACK
    if host == "localhost":
        host = LOOPBACK
    try:
        address = ipaddress.ip_address(host)
    except ValueError:
        raise ValueError(f"{rule}, got {text!r}") from None
    if isinstance(address, ipaddress.IPv6Address) and address.scope_id is not None:
        raise ValueError(f"tcp must have an address without a zone, got {text!r}")
    return TcpAddress(str(address), port)


def listening_tcp(address: TcpAddress, backlog: int) -> socket.socket:
    """Return a socket that listens on an address of this machine.

    Parameters
    ----------
    address : TcpAddress
        The address; port 0 takes a free one.
    backlog : int
        Connections that may wait.

    Returns
    -------
    socket.socket
        The socket.

    Raises
    ------
    ValueError
        If the address cannot be listened on; the error says why.
    """
    return system.listening_socket(address.host, address.port, backlog, "tcp")


def connected_tcp(address: TcpAddress) -> socket.socket:
    """Return a socket that is connected to an address on which ``flgpr live`` listens.

    Parameters
    ----------
    address : TcpAddress
        The address.

    Returns
    -------
    socket.socket
        The socket.

    Raises
    ------
    ValueError
        If nobody listens there; the error says why.
    """
    try:
        connection = socket.create_connection((address.host, address.port), _CONNECT_TIMEOUT)
    except OSError as error:
        reason = error.strerror or "it does not answer"
        raise ValueError(
            f"tcp must be an address that flgpr live listens on, got {address}: {reason}"
        ) from None
    connection.settimeout(None)
    # The last bytes of a scan are sent at once, and not together with the next scan.
    connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    return connection


def check_unix_sockets(path: Path) -> None:
    """Check that this system has Unix sockets; Python on Windows has none.

    Parameters
    ----------
    path : Path
        Where one is wanted.

    Raises
    ------
    ValueError
        If it has none.
    """
    if not hasattr(socket, "AF_UNIX"):
        raise ValueError(
            f"socket must be left out, since this system has no Unix sockets, got {path}: "
            "use tcp instead, such as 5601, the port of this machine"
        )


def _new_unix_socket(path: Path) -> socket.socket:
    """Return a new Unix socket, neither bound nor connected, for a path."""
    check_unix_sockets(path)
    return socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)


def listening_unix(path: Path, backlog: int) -> socket.socket:
    """Return a Unix socket that listens on a path, which only this user may open.

    It appears there once it listens: a sender that waits for it is never refused.

    Parameters
    ----------
    path : Path
        The path; a socket there that nobody listens on is replaced.
    backlog : int
        Connections that may wait.

    Returns
    -------
    socket.socket
        The socket.

    Raises
    ------
    ValueError
        If the path cannot be listened on, or this system has no Unix sockets.
    """
    not_yet = path.with_name(f"~{path.name}")
    for one in (path, not_yet):
        _remove_stale_socket(one)
    listener = _new_unix_socket(path)
    previous_mask = os.umask(0o177)
    try:
        listener.bind(str(not_yet))
        listener.listen(backlog)
        not_yet.rename(path)
    except OSError as error:
        listener.close()
        raise ValueError(
            f"socket must be a path that can be made, got {path}: {_unix_reason(error)}"
        ) from None
    finally:
        os.umask(previous_mask)
    return listener


def _unix_reason(error: OSError) -> str:
    """Return why a path cannot be listened on."""
    reasons = {
        errno.ENOENT: "its folder does not exist",
        errno.ENOTDIR: "what should be its folder is a file",
        errno.EACCES: "this user may not write into its folder",
        errno.EROFS: "its disk cannot be written to",
        errno.EADDRINUSE: "another program listens on it",
    }
    if error.errno is None:
        return "it is too long; about 100 characters are possible"
    return reasons.get(error.errno, error.strerror or "the system refuses it")


def _remove_stale_socket(path: Path) -> None:
    """Remove a socket that nobody listens on; refuse any other file."""
    if not path.exists() and not path.is_symlink():
        return
    if not stat.S_ISSOCK(path.lstat().st_mode):
        raise ValueError(f"socket must be a new path, got {path}, where another file lies")
    with _new_unix_socket(path) as probe:
        probe.settimeout(1.0)
        try:
            probe.connect(str(path))
        except ConnectionRefusedError:
            path.unlink()
            return
        except FileNotFoundError:
            return
        except OSError:  # a program may listen that refuses us
            pass
    raise ValueError(
        f"socket must be free, got {path}, on which another program listens: give another path"
    )


def connected_unix(path: Path) -> socket.socket:
    """Return a socket that is connected to a Unix socket on which ``flgpr live`` listens.

    Parameters
    ----------
    path : Path
        The socket.

    Returns
    -------
    socket.socket
        The connection.

    Raises
    ------
    ValueError
        If nobody listens there, or this system has no Unix sockets.
    """
    connection = _new_unix_socket(path)
    try:
        connection.connect(str(path))
    except OSError as error:
        connection.close()
        reason = error.strerror or "its path is too long"
        raise ValueError(
            f"socket must be one that flgpr live listens on, got {path}: {reason}"
        ) from None
    return connection


MARK = b"FLGPRAU1"
"""Beginning of a challenge and of its answer."""
VARIABLE = "FLGPR_LIVE_SECRET"
"""Variable of the environment that may hold the secret."""
ANSWER_BYTES = len(MARK) + 32
"""Bytes of a challenge, and of its answer."""
_FEWEST = 16  # bytes of a secret
_MOST = 4096
_PATIENCE = 10.0  # s that a sender waits for the challenge


def live_secret(path: PathLike | None) -> bytes | None:
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
