"""TCP addresses that scans arrive on, and the sockets that listen on them or connect to them.

Without an address TCP is open to this machine alone. Any other interface must be asked for by its
address. There is no name look-up: a name that resolves to another machine opens nothing.
"""

from __future__ import annotations

import errno
import ipaddress
import re
import socket
from dataclasses import dataclass

LOOPBACK = "127.0.0.1"
_LARGEST_PORT = 65535
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
        host = f"[{self.host}]" if ":" in self.host else self.host
        return f"{host}:{self.port}"


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
    if port > _LARGEST_PORT:
        raise ValueError(f"tcp must have a port from 0 to {_LARGEST_PORT}, got {port}")
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
    listener = _new_socket(address)
    # A port of a run that ended a moment ago may be used at once.
    listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        listener.bind((address.host, address.port))
        listener.listen(backlog)
    except OSError as error:
        listener.close()
        raise ValueError(
            f"tcp must be an address that can be listened on, got {address}: {_reason(error)}"
        ) from None
    return listener


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
    connection = _new_socket(address)
    connection.settimeout(_CONNECT_TIMEOUT)
    try:
        connection.connect((address.host, address.port))
    except OSError as error:
        connection.close()
        reason = error.strerror or "it does not answer"
        raise ValueError(
            f"tcp must be an address that flgpr live listens on, got {address}: {reason}"
        ) from None
    connection.settimeout(None)
    # The last bytes of a scan are sent at once, and not together with the next scan.
    connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    return connection


def _new_socket(address: TcpAddress) -> socket.socket:
    """Return a TCP socket of the version of an address."""
    family = socket.AF_INET6 if ":" in address.host else socket.AF_INET
    try:
        return socket.socket(family, socket.SOCK_STREAM)
    except OSError as error:
        raise ValueError(
            f"tcp must be an address of a version that this machine has, got {address}: "
            f"{error.strerror}"
        ) from None


def _reason(error: OSError) -> str:
    """Return why an address cannot be listened on."""
    reasons = {
        errno.EADDRNOTAVAIL: "this machine has no such address",
        errno.EADDRINUSE: "another program listens on it; port 0 takes a free one",
        errno.EACCES: "this user may listen on ports from 1024 on",
    }
    return reasons.get(error.errno or 0, error.strerror or "the system refuses it")
