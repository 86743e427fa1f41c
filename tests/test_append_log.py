"""Logs: a line counts when it is whole, and one process holds a log at a time."""

import pytest

from flgpr import append_log
from flgpr.append_log import AppendLog, LogHeldError, read_log


def test_lines_come_back(tmp_path):
    path = tmp_path / "new" / "a.log"
    with AppendLog(path) as log:
        log.append(b"one")
        log.append(b"two")
    assert read_log(path) == ([b"one", b"two"], b"")
    with AppendLog(path) as log:
        assert log.lines == [b"one", b"two"]
        log.keep(1)
        log.append(b"three")
    assert path.read_bytes() == b"one\nthree\n"


def test_half_a_line_is_dropped_when_the_log_is_held_next(tmp_path):
    path = tmp_path / "a.log"
    path.write_bytes(b"one\ntw")
    assert read_log(path) == ([b"one"], b"tw")
    with AppendLog(path) as log:
        assert log.torn == b"tw"
        log.append(b"two")
    assert path.read_bytes() == b"one\ntwo\n"


def test_a_second_holder_is_refused(tmp_path):
    path = tmp_path / "a.log"
    with AppendLog(path), pytest.raises(LogHeldError, match="another process holds it"):
        AppendLog(path)
    AppendLog(path).close()


def test_a_line_that_fails_leaves_the_log_as_it_was(tmp_path, monkeypatch):
    path = tmp_path / "a.log"

    def write_half(file, data):
        file.write(data[: len(data) // 2])
        raise OSError("no room")

    with AppendLog(path) as log:
        log.append(b"one")
        monkeypatch.setattr(append_log, "write_all", write_half)
        with pytest.raises(OSError, match="no room"):
            log.append(b"two")
        assert log.lines == [b"one"]
    assert path.read_bytes() == b"one\n"


def test_a_line_holds_no_end_of_line(tmp_path):
    with AppendLog(tmp_path / "a.log") as log, pytest.raises(ValueError, match="end of a line"):
        log.append(b"one\ntwo")


def test_what_is_no_log_is_refused(tmp_path, monkeypatch):
    assert read_log(tmp_path / "missing") == ([], b"")
    (tmp_path / "long").write_bytes(b"12345678\n")
    monkeypatch.setattr(append_log, "MOST_BYTES", 8)
    with pytest.raises(ValueError, match="must have at most"):
        read_log(tmp_path / "long")
