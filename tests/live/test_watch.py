import json
import os
import queue
import shutil
import tempfile
import time
from pathlib import Path
from unittest import mock

import numpy as np
import pytest
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, precondition, rule

from damage import CASES, MACHINE
from flgpr.door import Folder
from flgpr.live import source as watch
from flgpr.live.intake import Intake
from flgpr.live.source import Arrival, ArrivalQueue, FolderWatch, Inbox
from flgpr.model import make_run
from flgpr.store import ScanFileError, describe_for_live, encode_scan
from flgpr.store.scan_file import scan_name

"""The folder that is watched and the queue of arrivals: every file once, in order, and no end of memory."""


TINY = describe_for_live(
    make_run(np.zeros((1, 1, 1, 2)), [1e9, 2e9], ["HH"], [[0, 0, 0]], [[1, 0, 0]], np.zeros((1, 6)))
)
NUMBERS = st.integers(0, 30)
FEW = st.integers(0, 4)


class WatchMachine(RuleBasedStateMachine):
    """A file is handed over once when it is whole, or damaged and no longer growing, in the order of names."""

    def __init__(self):
        super().__init__()
        self.folder = Path(tempfile.mkdtemp())
        self.ahead = 0.0
        (self.folder / "run.json").write_text(json.dumps(TINY.as_json()))
        clock = mock.Mock(wraps=time, time=lambda: time.time() + self.ahead)
        clock.time_ns = lambda: time.time_ns() + int(self.ahead * 1e9)
        self.clock = mock.patch.object(watch, "time", clock)
        self.clock.start()
        # torn: size when last looked at, and since when
        self.whole = {}
        self.torn = {}
        self.no_files = set()
        self.handed = set()
        # handed over as torn: read once more when they grow
        self.cut = set()
        self.ended = False
        self.start(None)

    def teardown(self):
        self.clock.stop()
        shutil.rmtree(self.folder)

    def start(self, known):
        self.watch = FolderWatch(self.folder, Inbox(), known)
        self.told = False
        self.ended_told = False

    def frame(self, number):
        return encode_scan(number, np.full(TINY.shape, number + 0.5), np.zeros(6))

    @rule(number=FEW)
    def write(self, number):
        """Write a scan as a radar should, over one of that name, too."""
        path = self.folder / scan_name(number)
        (self.folder / "new").write_bytes(self.frame(number))
        (self.folder / "new").rename(path)
        self.torn.pop(path.name, None)
        self.grows(path.name)
        self.whole[path.name] = self.frame(number)

    @rule(number=FEW, share=st.floats(0, 1, exclude_max=True))
    def write_a_part(self, number, share):
        path = self.folder / scan_name(number)
        frame = self.frame(number)
        if path.name not in self.whole:
            before = path.stat().st_size if path.exists() else -1
            path.write_bytes(frame[: int(share * len(frame))])
            self.torn.setdefault(path.name, None)
            if path.stat().st_size != before:
                self.grows(path.name)

    def grows(self, name):
        if name in self.cut:
            self.cut.remove(name)
            self.handed.discard(name)

    @precondition(lambda self: self.torn)
    @rule(data=st.data())
    def complete(self, data):
        name = data.draw(st.sampled_from(sorted(self.torn)))
        frame = self.frame(int(name[5:11]))
        with (self.folder / name).open("ab") as file:
            file.write(frame[file.tell() :])
        del self.torn[name]
        self.whole[name] = frame
        self.grows(name)

    @precondition(lambda self: self.whole or self.torn)
    @rule(data=st.data(), again=st.booleans())
    def take_away(self, data, again):
        """Take a file away; once that was seen, another of its name is another file."""
        number = int(data.draw(st.sampled_from(sorted({**self.whole, **self.torn})))[5:11])
        self.take_away_one(number)
        if again:
            self.look_once()
            self.write(number)

    def take_away_one(self, number):
        name = scan_name(number)
        (self.folder / name).unlink()
        self.whole.pop(name, None)
        self.torn.pop(name, None)
        self.cut.discard(name)

    @rule(what=st.sampled_from(["link.scan", "folder.scan", "notes.txt"]))
    def lay_down_something_else(self, what):
        """Links and folders with the name of a scan are handed over once, as what they are."""
        path = self.folder / what
        if what == "link.scan" and not path.is_symlink():
            path.symlink_to(self.folder / "run.json")
        elif what == "folder.scan":
            path.mkdir(exist_ok=True)
        elif what == "notes.txt":
            path.write_text("no scan")
        if what != "notes.txt":
            self.no_files.add(what)

    @rule(seconds=st.sampled_from([0.01, 0.3, 1.5]))
    def wait(self, seconds):
        self.ahead += seconds

    @rule()
    def end(self):
        (self.folder / "end.json").write_text("{}")
        self.ended = True

    @rule(lose=st.integers(0, 3))
    def restart(self, lose):
        """Another process goes on from a snapshot that may not know of the last files."""
        self.handed -= set(sorted(self.handed)[len(self.handed) - lose :])
        self.torn = dict.fromkeys(self.torn)
        self.cut = set()
        self.start(set(self.handed))

    @rule(times=st.integers(1, 2))
    def look(self, times):
        for _ in range(times):
            self.look_once()

    def look_once(self):
        self.watch._check()
        arrivals = []
        while not self.watch.inbox.arrivals.empty():
            arrivals.append(self.watch.inbox.arrivals.get())
        if not self.told:
            assert arrivals.pop(0).kind == "run"
            self.told = True
        self.handed &= {*self.whole, *self.torn, *self.no_files}
        now = time.time() + self.ahead
        given_up = set()
        for name in {*self.torn} - self.handed:
            size = (self.folder / name).stat().st_size
            before = self.torn[name]
            if before is None or before[0] != size:
                self.torn[name] = size, now
            elif now - before[1] > 1.0:
                given_up.add(name)
        due = sorted({*self.whole, *self.no_files} - self.handed | given_up)
        frames = [one for one in arrivals if one.kind == "frame"]
        assert [one.name for one in frames] == due
        for one in frames:
            assert one.data == self.whole.get(one.name, one.data)
            assert (one.name in self.no_files) == (one.value is not None)
        self.handed.update(due)
        self.cut |= given_up
        waiting = {*self.torn} - self.handed
        ends = self.ended and not due and not waiting and not self.ended_told
        assert [one.kind for one in arrivals if one.kind != "frame"] == ["end"] * ends
        self.ended_told |= ends


TestWatch = WatchMachine.TestCase
TestWatch.settings = settings(MACHINE, max_examples=CASES)


def test_a_file_that_was_taken_away_may_come_again():
    machine = WatchMachine()
    for step in (machine.write, machine.take_away_one, machine.write):
        step(3)
        machine.look_once()
    machine.teardown()


def test_a_scan_in_two_halves_seconds_apart_is_read_when_it_is_whole():
    """The first half is handed over as damaged after a second; the rest comes after four."""
    machine = WatchMachine()
    frame = machine.frame(3)
    path = machine.folder / scan_name(3)
    path.write_bytes(frame[: len(frame) // 2])
    machine.watch._check()
    machine.ahead += 2.0
    machine.watch._check()
    machine.ahead += 2.0
    machine.watch._check()
    with path.open("ab") as file:
        file.write(frame[len(frame) // 2 :])
    machine.watch._check()
    arrivals = machine.watch.inbox.arrivals
    data = [arrivals.get().data for _ in range(arrivals.qsize())]
    assert data == [b"", frame[: len(frame) // 2], frame]
    intake = Intake(TINY)
    with pytest.raises(ScanFileError):
        intake.admit(data[1])
    assert intake.admit(data[2]).number == 3
    machine.teardown()


@pytest.mark.parametrize("share", [0.0, 0.5])
def test_a_file_of_zeros_is_read_when_it_has_been_filled_in_place(share):
    """Its size never changes; how much stood there when it was looked at first does not matter."""
    machine = WatchMachine()
    frame = machine.frame(3)
    begun = int(share * len(frame))
    path = machine.folder / scan_name(3)
    path.write_bytes(frame[:begun] + bytes(len(frame) - begun))
    machine.watch._check()
    arrivals = machine.watch.inbox.arrivals
    assert [arrivals.get().kind for _ in range(arrivals.qsize())] == ["run"]
    machine.ahead += 2.0
    machine.watch._check()  # nothing came for a while: handed over as it is
    with path.open("r+b") as file:
        file.write(frame)
    machine.watch._check()
    data = [arrivals.get().data for _ in range(arrivals.qsize())]
    assert data == [frame[:begun] + bytes(len(frame) - begun), frame]
    machine.teardown()


def test_a_folder_a_link_and_a_pipe_with_names_of_scans_are_told_and_counted(tmp_path):
    (tmp_path / "run.json").write_text(json.dumps(TINY.as_json()))
    (tmp_path / scan_name(0)).mkdir()
    (tmp_path / scan_name(1)).symlink_to(tmp_path / "run.json")
    os.mkfifo(tmp_path / scan_name(2))
    inbox = Inbox()
    source = FolderWatch(tmp_path, inbox)
    source._check()
    source._check()
    arrivals = [inbox.arrivals.get_nowait() for _ in range(4)]
    assert inbox.arrivals.empty()
    intake = Intake(TINY)
    for one, kind in zip(arrivals[1:], ("folder", "link", "pipe"), strict=True):
        with pytest.raises(ScanFileError, match=kind):
            intake.admit(one.data, one.value)
    assert intake.counts["received"] == intake.counts["corrupt"] == 3


def test_the_queue_is_full_with_so_many_arrivals_or_so_many_bytes():
    waiting = ArrivalQueue(most=5, most_bytes=1000)
    large = Arrival("frame", "a", 0.0, bytes(600))
    waiting.put_nowait(large)
    waiting.put_nowait(large)
    with pytest.raises(queue.Full):
        waiting.put_nowait(Arrival("frame", "b", 0.0))
    assert waiting.get_nowait() is large
    for _ in range(4):
        waiting.put_nowait(Arrival("frame", "b", 0.0))
    with pytest.raises(queue.Full):
        waiting.put_nowait(Arrival("frame", "b", 0.0))
    assert [len(waiting.get_nowait().data) for _ in range(5)] == [600, 0, 0, 0, 0]
    assert waiting.empty()


def test_a_file_that_cannot_be_read_is_told_once_and_the_rest_goes_on(tmp_path, monkeypatch):
    """It may be read after a moment: a radar may give the right to it after it has written it."""
    (tmp_path / "run.json").write_text(json.dumps(TINY.as_json()))
    for number in range(3):
        frame = encode_scan(number, np.full(TINY.shape, 0.5), np.zeros(6))
        (tmp_path / scan_name(number)).write_bytes(frame)
    refused = {scan_name(0), scan_name(1)}
    open_file = Folder.open

    def open_allowed(self, name, most):
        if name in refused:
            raise PermissionError(13, "Permission denied", name)
        return open_file(self, name, most)

    monkeypatch.setattr(Folder, "open", open_allowed)
    monkeypatch.setattr(watch, "_PATIENCE", 0.2)
    inbox = Inbox()
    source = FolderWatch(tmp_path, inbox)
    assert source._check()  # the third
    refused.remove(scan_name(1))
    source._check()
    time.sleep(0.25)
    source._check()
    source._check()
    arrivals = [inbox.arrivals.get_nowait() for _ in range(4)]
    assert inbox.arrivals.empty()
    assert [one.name for one in arrivals[1:]] == [scan_name(2), scan_name(1), scan_name(0)]
    assert [bool(one.data) for one in arrivals[1:]] == [True, True, False]
    assert str(arrivals[-1].value) == "file must be readable, got Permission denied"
