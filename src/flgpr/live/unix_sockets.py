"""Unix sockets, where the system has them: sockets at a path, between programs of one machine."""

from __future__ import annotations

import socket
from pathlib import Path


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


def unix_socket(path: Path) -> socket.socket:
    """Return a new Unix socket, neither bound nor connected.

    Parameters
    ----------
    path : Path
        Where it is to listen, or what it is to connect to.

    Returns
    -------
    socket.socket
        The socket.

    Raises
    ------
    ValueError
        If this system has none.
    """
    check_unix_sockets(path)
    return socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
