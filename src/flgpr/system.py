"""What operating systems do differently, or refuse: locks, limits, folders, interrupts, ports.

All else in the package is the same everywhere, but for the Unix sockets of ``live/sockets.py`` and
the memory limit in ``formats/child.py``, a script that imports nothing of flgpr. Linux is where it
is tested; `tests/other_system.py` takes away what Windows lacks and forbids what it forbids.
"""

from __future__ import annotations

import errno
import os
import signal
import socket
import sys
import time
from typing import BinaryIO

import portalocker

OPENS_FOLDERS = hasattr(os, "O_DIRECTORY")
"""Whether a folder can be opened: to lock it, to flush its entries, to open files from it.

Where it cannot, as on Windows, an open file cannot be renamed or removed either.
"""
DIRECTORY = getattr(os, "O_DIRECTORY", 0)
"""Flag of ``os.open``: nothing but a folder."""
NO_LINK = getattr(os, "O_NOFOLLOW", 0)
"""Flag of ``os.open``: no symbolic link; zero where there is none, and links are to be looked for."""
AT_ONCE = getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_NOCTTY", 0)
"""Flags of ``os.open``: never wait for a pipe or a device, and take no terminal."""
PLAIN = getattr(os, "O_BINARY", 0) | getattr(os, "O_CLOEXEC", 0)
"""Flags of ``os.open``: bytes as they are, in no child process."""
LARGEST_PORT = 65535
_PAUSE = 0.02  # s between two tries to lock a file


def lock(file: BinaryIO | int, *, shared: bool = False, wait: bool = False) -> None:
    """Lock an open file, or a folder where folders can be opened, against other processes.

    Closing it, or the end of the process, ends the lock.

    Parameters
    ----------
    file : file or int
        An open file or its descriptor.
    shared : bool
        Whether others may hold it in this way as well. Where there are no such locks it is locked
        for this process alone.
    wait : bool
        Whether to wait until it is free.

    Raises
    ------
    BlockingIOError
        If another process holds it, and ``wait`` is False.
    OSError
        If the file system has no locks.
    """
    kind = portalocker.LockFlags.EXCLUSIVE
    if shared and OPENS_FOLDERS:
        kind = portalocker.LockFlags.SHARED
    # The C library of Windows waits for ten seconds at most, so that waiting is done here.
    in_one_call = wait and OPENS_FOLDERS
    flags = kind if in_one_call else kind | portalocker.LockFlags.NON_BLOCKING
    while True:
        try:
            portalocker.lock(file, flags)
            return
        except portalocker.AlreadyLocked as error:
            if not wait:
                raise BlockingIOError(str(error)) from None
        except portalocker.LockException as error:
            raise OSError(str(error)) from None
        time.sleep(_PAUSE)


def unlock(file: BinaryIO | int) -> None:
    """End the lock of a file that stays open."""
    portalocker.unlock(file)


def peak_memory() -> int:
    """Return the most memory that this process has held, bytes; 0 where the system does not tell."""
    try:
        import resource
    except ImportError:  # Windows
        return 0
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    # Linux counts in KiB, macOS in bytes.
    return peak if sys.platform == "darwin" else 1024 * peak


def most_open_files() -> int | None:
    """Return how many files and connections this process may open; None where no limit is known."""
    try:
        import resource
    except ImportError:  # Windows
        return None
    files = resource.getrlimit(resource.RLIMIT_NOFILE)[0]
    return None if files == resource.RLIM_INFINITY else files


def start_method() -> str:
    """Return how child processes are started: from a small server, or anew where there is none."""
    import multiprocessing

    methods = multiprocessing.get_all_start_methods()
    return "forkserver" if "forkserver" in methods else "spawn"


def begin_worker() -> None:
    """Set up this process to work for another one, without a word of its own when it is ended.

    Ctrl-C on a terminal reaches every process of a command, and only the first has something to
    say. The others end at once, wherever they are, and a pool ends them when the first of them is
    gone. What their libraries made must not outlast them then: Python would warn of named locks
    below the last line of the command.
    """
    import multiprocessing

    signal.signal(signal.SIGINT, signal.SIG_DFL)
    if "fork" in multiprocessing.get_all_start_methods():
        # Locks for children that are forked have no name. This process starts no others.
        multiprocessing.set_start_method("fork", force=True)


def address_text(host: str, port: int) -> str:
    """Return a host and a port as they are typed."""
    return f"[{host}]:{port}" if ":" in host else f"{host}:{port}"


def listening_socket(host: str, port: int, backlog: int, parameter: str) -> socket.socket:
    """Return a socket that listens on an address of this machine.

    Parameters
    ----------
    host : str
        Address or name of this machine.
    port : int
        The port; 0 takes a free one.
    backlog : int
        Connections that may wait.
    parameter : str
        What names the address where it was asked for.

    Raises
    ------
    ValueError
        If the address cannot be listened on; the error says why.
    """
    if not 0 <= port <= LARGEST_PORT:
        raise ValueError(f"port must be 0 to {LARGEST_PORT}, got {port}; port 0 takes a free one")
    try:
        listener = socket.socket(
            socket.AF_INET6 if ":" in host else socket.AF_INET, socket.SOCK_STREAM
        )
        try:
            # A port of a run that ended a moment ago may be used at once.
            listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            listener.bind((host, port))
            listener.listen(backlog)
        except OSError:
            listener.close()
            raise
    except OSError as error:
        raise ValueError(
            f"{parameter} must be an address that can be listened on, "
            f"got {address_text(host, port)}: {_refusal(error)}"
        ) from None
    return listener


def _refusal(error: OSError) -> str:
    """Return why an address cannot be listened on."""
    if isinstance(error, socket.gaierror):
        return "this machine has no such address"
    reasons = {
        errno.EADDRNOTAVAIL: "this machine has no such address",
        errno.EADDRINUSE: "another program listens on it; port 0 takes a free one",
        errno.EACCES: "this user may listen on ports from 1024 on",
    }
    return reasons.get(error.errno or 0, error.strerror or "the system refuses it")
