"""A socket that listens, or the reason why it cannot."""

from __future__ import annotations

import errno
import socket

_ANOTHER = "give another port, or port 0 (--port 0) for one that is free"


def listening_socket(host: str, port: int) -> socket.socket:
    """Return a socket that listens on an address of this machine.

    Parameters
    ----------
    host : str
        Address or name of this machine.
    port : int
        The port; 0 takes a free one.

    Returns
    -------
    socket.socket
        The socket.

    Raises
    ------
    ValueError
        If the address cannot be listened on; it says why and what to do.
    """
    if not 0 <= port <= 65535:
        raise ValueError(f"port must be 0 to 65535, got {port}: {_ANOTHER}")
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    try:
        listener = socket.socket(family, socket.SOCK_STREAM)
    except OSError as error:
        raise ValueError(
            f"host must be an address of this machine, got {host}: {error.strerror}"
        ) from None
    listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        listener.bind((host, port))
        listener.listen(128)
    except OSError as error:
        listener.close()
        raise ValueError(_reason(host, port, error)) from None
    return listener


def _reason(host: str, port: int, error: OSError) -> str:
    """Return why an address cannot be listened on, and what to do."""
    if isinstance(error, socket.gaierror) or error.errno == errno.EADDRNOTAVAIL:
        return (
            f"host must be an address of this machine, got {host}: "
            "give 127.0.0.1, or one that this machine has"
        )
    if error.errno == errno.EADDRINUSE:
        return f"port must be free, got {port}, on which another program listens: {_ANOTHER}"
    if error.errno in (errno.EACCES, errno.EPERM):
        return (
            "port must be one that this user may listen on (1024 or above as a rule), "
            f"got {port}: {_ANOTHER}"
        )
    return (
        f"port must be one that can be listened on, got {port} of {host} "
        f"({error.strerror}): {_ANOTHER}"
    )
