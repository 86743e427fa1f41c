"""Damage to files, and what readers say of it."""

import faulthandler
import os
import runpy
import signal
import subprocess
import sys
import warnings
from contextlib import contextmanager
from unittest import mock

from hypothesis import HealthCheck, settings
from hypothesis import strategies as st

CASES = int(os.environ.get("FLGPR_CASES", "50"))
"""Cases per reader, drawn anew in every run; `make robustness` takes many more."""
FUZZ = settings(
    max_examples=CASES,
    deadline=None,
    database=None,
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow, HealthCheck.data_too_large],
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
    for what, where, bit, new in draw(_BLOWS):  # drawn at once, so that what is drawn does not depend on the data
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


@contextmanager
def in_forks():
    """Let files be read in a fork of this process instead of a new interpreter."""
    # A fork takes the address space of all the tests, beside which the limit of 64 MB could not be kept.
    with mock.patch("flgpr.io.arrays._SPARE", 2**38), mock.patch("flgpr.io.arrays.subprocess.run", _forked):
        yield


def _forked(command, timeout, stdout, **_):
    """Run the child's script in a fork, which is a hundred times quicker than a new interpreter."""
    reader, writer = os.pipe()
    pid = os.fork()
    if not pid:
        try:
            faulthandler.disable()
            signal.alarm(max(1, int(timeout)))
            if stdout != subprocess.DEVNULL:
                os.dup2(stdout.fileno(), 1)
            sys.argv = command[2:]
            runpy.run_path(command[2], run_name="__main__")
            os._exit(0)
        except BaseException as error:
            os.write(writer, repr(error).encode()[:4096])
            os._exit(1)
    os.close(writer)
    with open(reader, "rb") as said:
        words = said.read()
    code = os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1])
    if code == -signal.SIGALRM:
        raise subprocess.TimeoutExpired(command, timeout)
    return subprocess.CompletedProcess(command, code, None, words)
