"""Runs a command as on a system that is no POSIX one: ``python -m other_system -m flgpr demo``.

Taken away, from flgpr alone, are the modules and constants of POSIX; forbidden, for the whole process,
is what Windows forbids: opening a folder, and renaming or removing what is open. Processes are started
anew, and local sockets do not exist. What it cannot show is what Windows does by itself: drives,
reserved names, its locks.
"""

import builtins
import multiprocessing
import os
import runpy
import socket
import sys
import types

ABSENT_MODULES = {"fcntl", "resource", "grp", "pwd", "termios", "tty", "pty", "syslog"}
ABSENT_NAMES = {
    "O_DIRECTORY", "O_NOFOLLOW", "O_NONBLOCK", "O_NOCTTY", "O_CLOEXEC", "fork", "forkpty", "getuid", "geteuid",
    "getgid", "killpg", "setsid", "setpriority", "getpriority", "PRIO_PROCESS", "mkfifo", "sched_getaffinity", "uname",
    "pread", "pwrite", "statvfs", "fchmod", "nice", "wait4", "posix_fallocate", "getloadavg",
}  # fmt: skip
PACKAGES = ("flgpr", "flgpr_papers")


class Without(types.ModuleType):
    """A module without some of its names, and with others in their place."""

    def __init__(self, module, absent=(), **instead):
        super().__init__(module.__name__)
        self.__dict__.update(_module=module, _absent=frozenset(absent), **instead)

    def __getattr__(self, name):
        if name in self._absent:
            raise AttributeError(f"module {self.__name__!r} has no attribute {name!r}")
        return getattr(self._module, name)


def refuse_folders(open_):
    """Let a folder be opened by nobody, and nothing by the descriptor of a folder."""

    def opened(path, flags, mode=0o777, *, dir_fd=None):
        if dir_fd is not None:
            raise NotImplementedError("dir_fd unavailable on this platform")
        if os.path.isdir(path):
            raise PermissionError(13, "Permission denied", str(path))
        return open_(path, flags, mode)

    return opened


def open_paths():
    """What this process has open."""
    for descriptor in os.listdir("/proc/self/fd"):
        try:
            yield os.readlink(f"/proc/self/fd/{descriptor}")
        except OSError:
            continue


def refuse_open(function, *places):
    """Let a function fail that renames or removes what this process has open."""

    def guarded(*paths, **options):
        caller = sys._getframe(1).f_globals.get("__name__", "")
        for place in places:
            path = os.path.abspath(os.fspath(paths[place]))
            taken = [name for name in open_paths() if name == path or name.startswith(f"{path}/")]
            if taken and caller != "tempfile" and "dir_fd" not in options:
                raise PermissionError(13, f"it is open ({taken[0]})", path)
        return function(*paths, **options)

    return guarded


def become_another_system():
    """Take away from flgpr what POSIX alone has, and forbid what Windows forbids."""
    without = {
        "os": Without(os, ABSENT_NAMES, open=refuse_folders(os.open), supports_dir_fd=frozenset()),
        "socket": Without(socket, {"AF_UNIX"}),
    }
    import_ = builtins.__import__

    def importing(name, globals=None, locals=None, fromlist=(), level=0):
        caller = (globals or {}).get("__name__", "")
        ours = (
            caller.split(".")[0] in PACKAGES
            or (globals or {}).get("__file__", "").find("/flgpr") >= 0
        )
        if ours and level == 0:
            if name.split(".")[0] in ABSENT_MODULES:
                raise ModuleNotFoundError(f"No module named {name!r}", name=name)
            if name in without:
                return without[name]
        return import_(name, globals, locals, fromlist, level)

    builtins.__import__ = importing
    os.rename = refuse_open(os.rename, 0, 1)
    os.replace = refuse_open(os.replace, 0, 1)
    os.unlink = os.remove = refuse_open(os.unlink, 0)
    os.rmdir = refuse_open(os.rmdir, 0)
    multiprocessing.get_all_start_methods = lambda: ["spawn"]


if __name__ == "__main__":
    become_another_system()
    del sys.argv[0]
    if sys.argv[0] == "-m":
        del sys.argv[0]
        name = sys.argv[0]
        runpy.run_module(name, run_name="__main__", alter_sys=True)
    else:
        runpy.run_path(sys.argv[0], run_name="__main__")
