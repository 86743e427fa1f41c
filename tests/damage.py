"""Damage to files, and what readers say of it."""

import faulthandler
import functools
import json
import os
import signal
import socket
import stat
import subprocess
import sys
import tempfile
import threading
import warnings
from contextlib import contextmanager
from pathlib import Path
from unittest import mock

import pytest
from hypothesis import HealthCheck, settings
from hypothesis import strategies as st

CASES = int(os.environ.get("FLGPR_CASES", "50"))
"""Cases per reader, drawn anew in every run; `make robustness` takes many more."""
FUZZ = settings(
    max_examples=CASES,
    deadline=None,
    database=None,
    suppress_health_check=[
        HealthCheck.function_scoped_fixture,
        HealthCheck.too_slow,
        HealthCheck.data_too_large,
    ],
)
MACHINE = settings(FUZZ, max_examples=max(CASES // 4, 1), stateful_step_count=20)
"""Of a state machine, whose cases are long."""

_BLOWS = st.lists(
    st.tuples(
        st.sampled_from(["cut", "flip", "write", "grow", "swap", "zero"]),
        st.integers(0, 2**32 - 1),
        st.integers(0, 7),
        st.binary(min_size=1, max_size=8),
    ),
    min_size=1,
    max_size=4,
)


def damaged(data, draw):
    """Cut, flip, swap, overwrite or lengthen."""
    raw = bytearray(data)
    for what, where, bit, new in draw(
        _BLOWS
    ):  # drawn at once, so that what is drawn does not depend on the data
        at = where % max(len(raw), 1)
        if what == "cut":
            del raw[at:]
        elif what == "flip" and raw:
            raw[at] ^= 1 << bit
        elif what == "write":
            raw[at : at + 4] = new
        elif what == "grow":
            raw += bytes(raw) * 9
        elif what == "swap":
            raw[at : at + 8] = raw[at : at + 8][::-1]
        elif what == "zero":
            raw[at : at + 16] = bytes(len(raw[at : at + 16]))
        if len(raw) > 200_000:
            break
    return bytes(raw)


def refusal(call, *arguments, **options):
    """What a reader says, None if it reads; any other exception than ValueError goes on."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # parsers warn of what they then refuse
        try:
            call(*arguments, **options)
        except ValueError as error:
            return str(error)
    return None


_READER = """
import json, os, runpy, signal, socket, sys
import h5py, scipy.io  # what the script imports
asked = socket.socket(fileno=int(sys.argv[1]))
while True:
    words, streams, *_ = socket.recv_fds(asked, 65536, 2)
    if not words:
        break
    patience, *sys.argv = json.loads(words)
    if pid := os.fork():
        asked.send(str(os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1])).encode())
        for stream in streams:
            os.close(stream)
        continue
    signal.alarm(patience)
    for number, stream in enumerate(streams, 1):
        os.dup2(stream, number)
    try:
        runpy.run_path(sys.argv[0], run_name="__main__")
    except BaseException as error:
        os.write(2, repr(error).encode()[:4096])
        os._exit(1)
    os._exit(0)
"""


@functools.cache
def _reader():
    """Start a process that forks itself for every file: of all the tests a fork takes ten times as long."""
    ours, theirs = socket.socketpair()
    with theirs:
        command = [sys.executable, "-c", _READER, str(theirs.fileno())]
        return ours, subprocess.Popen(
            command, pass_fds=[theirs.fileno()]
        )  # kept: it ends when our end is closed


@contextmanager
def in_forks():
    """Let files be read in a fork of a process that has imported the libraries instead of a new interpreter."""
    with mock.patch("flgpr.formats.arrays.subprocess.run", _forked):
        yield


def _forked(command, timeout, stdout, **_):
    """Run the child's script in a fork, which is a hundred times quicker than a new interpreter."""
    asked, _ = _reader()
    with tempfile.TemporaryFile() as said, open(os.devnull, "wb") as nothing:
        out = nothing if stdout == subprocess.DEVNULL else stdout
        words = json.dumps([max(1, int(timeout)), *command[2:]]).encode()
        socket.send_fds(asked, [words], [out.fileno(), said.fileno()])
        code = int(asked.recv(16))
        said.seek(0)
        words = said.read()
    if code == -signal.SIGALRM:
        raise subprocess.TimeoutExpired(command, timeout)
    return subprocess.CompletedProcess(command, code, None, words)


SPARSE = 2**31
"""Bytes of a file that takes no room on the disk and would fill the memory."""


def link_to_file(path, outside):
    """Put a link to a file outside, of the same content, in a file's place."""
    path.rename(outside / path.name)
    path.symlink_to(outside / path.name)


def link_to_folder(path, outside):
    """Put a link to a folder outside, of the same content, in the place of the folder that holds a file."""
    path.parent.rename(outside / "moved")
    path.parent.symlink_to(outside / "moved")


def pipe(path, _):
    """Put a pipe that nobody writes to in a file's place: opening it plainly would wait for ever."""
    path.unlink()
    os.mkfifo(path)


def unix_socket(path, _):
    path.unlink()
    os.mknod(path, stat.S_IFSOCK | 0o600)


def device(path, _):
    """Put a device that gives zeros without end in a file's place, where this user may make one."""
    path.unlink()
    try:
        os.mknod(path, stat.S_IFCHR | 0o600, os.makedev(1, 5))
    except PermissionError:
        pytest.skip("may not make devices")


def folder_instead(path, _):
    path.unlink()
    path.mkdir()


def sparse(path, _):
    """Lengthen a file by gigabytes of zeros that take no room on the disk."""
    os.truncate(path, SPARSE)


def one_byte_more(path, _):
    """Keep all that a digest was taken of, and add to it."""
    with path.open("ab") as file:
        file.write(b"\n")


DAMAGES = (
    link_to_file,
    link_to_folder,
    pipe,
    unix_socket,
    device,
    folder_instead,
    sparse,
    one_byte_more,
)


def answered(call, *arguments):
    """Give what a call gives or raises; fail instead of hanging if it waits for what never comes."""
    given = {}

    def run():
        try:
            given["value"] = call(*arguments)
        except BaseException as error:
            given["error"] = error

    thread = threading.Thread(target=run, daemon=True)
    thread.start()
    thread.join(60)
    if thread.is_alive():
        faulthandler.dump_traceback(all_threads=True)
        pytest.fail("it waits for what never comes")
    if "error" in given:
        raise given["error"]
    return given["value"]


@contextmanager
def memory_within(most):
    """Fail if the process takes so many bytes more at any moment of a ``with`` block."""
    Path("/proc/self/clear_refs").write_text("5")  # forget the peak of before
    before = _peak()
    yield
    assert _peak() - before < most


def _peak():
    return 1024 * int(Path("/proc/self/status").read_text().split("VmHWM:")[1].split()[0])
