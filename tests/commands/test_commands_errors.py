"""Errors that the user can mend, in words that are not those of the program."""

import errno
from pathlib import Path

import pytest

from flgpr.commands.messages import USER_ERRORS, plain_message


def test_no_line_holds_what_the_program_calls_things():
    told = plain_message(
        ValueError("x (np.float64(1.5)) at PosixPath('/a b') [Errno 28] No space left on device")
    )
    assert told == "x (1.5) at /a b No space left on device"
    assert plain_message(OSError(errno.ENOSPC, "No space left on device", "/d/x")).endswith(
        "/d/x: No space left on device"
    )
    assert "nested" in plain_message(RecursionError("maximum recursion depth exceeded"))
    assert "memory" in plain_message(MemoryError())


@pytest.mark.parametrize(
    ("number", "rule"),
    [
        (errno.ENOENT, "file or folder must exist"),
        (errno.EEXIST, "output must not exist yet"),
        (errno.ENOTEMPTY, "output must not exist yet"),
        (errno.EACCES, "must be allowed to read"),
        (errno.EROFS, "must not be read-only"),
        (errno.EISDIR, "must be a file and not a folder"),
        (errno.ENXIO, "the system must allow what is asked for"),
    ],
)
def test_an_error_of_the_system_has_rule_file_and_cause(number, rule):
    message = plain_message(OSError(number, "said by the system", "/data/lane.zarr"))
    assert rule in message
    assert message.endswith(", got /data/lane.zarr: said by the system")


def test_a_file_is_named_only_where_it_is_known():
    assert plain_message(OSError(errno.EIO, "input/output error")).endswith(
        ", got input/output error"
    )
    assert "got stra\u00dfe: " in plain_message(OSError(errno.EIO, "x", "stra\u00dfe".encode()))


def test_a_text_without_words_of_python_stays_as_it_is():
    text = "far must be a positive number of false alarms per m\u00b2, got 0"
    assert plain_message(ValueError(text)) == text
    assert plain_message(ValueError(f"lane must be a file, got {Path('a')!r}")) == (
        "lane must be a file, got a"
    )
    assert (
        plain_message(ValueError("lane must be given, got None")) == "lane must be given, got none"
    )


def test_a_fault_of_the_program_is_no_error_of_the_user():
    assert not issubclass(KeyError, USER_ERRORS)
    assert not issubclass(TypeError, USER_ERRORS)
    assert issubclass(FileNotFoundError, USER_ERRORS)
