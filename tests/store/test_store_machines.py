"""Journals and run stores under any order of appends, kills, damage and reopening, against models that are plain lists.

A kill is a writer that is left lying, with what the kernel may have kept of its last write, or an error raised inside.
"""

import errno
import math
import os
import shutil
import tempfile
from pathlib import Path
from unittest import mock

import numpy as np
import pytest
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, invariant, precondition, rule

from damage import MACHINE
from flgpr.store import RunStoreError, open_run, run_writer
from flgpr.store.files import replace_folder
from flgpr.store.journal import JOURNAL, Journal, JournalError, OtherRunError, WrittenScan
from flgpr.store.run_writer import RunWriter

ABOUT = {"title": "lane", "inputs": {"digest": "0f"}}


class Full(OSError):
    """The disk is full."""


class ShortFile:
    """A file of which the next write keeps only so many bytes, as on a full disk, and raises at the one after."""

    def __init__(self, file, keep):
        self.file = file
        self.keep = keep

    def write(self, data):
        if self.keep is None:
            raise Full(errno.ENOSPC, "No space left on device")
        kept = data[: self.keep]
        self.keep = None
        return self.file.write(kept)

    def __getattr__(self, name):
        return getattr(self.file, name)


class JournalMachine(RuleBasedStateMachine):
    """A journal gives back what was acknowledged and whose bytes stand, in order, whatever happened to the rest."""

    def __init__(self):
        super().__init__()
        self.folder = Path(tempfile.mkdtemp())
        # lines: what must stand in the file, after the head
        self.journal = None
        self.lines = []
        self.count = 0
        self.quick = mock.patch.object(os, "fsync", return_value=None)
        self.quick.start()
        self.open(True)

    def teardown(self):
        self.kill()
        self.quick.stop()
        shutil.rmtree(self.folder)

    @property
    def path(self):
        return self.folder / JOURNAL

    def open(self, resume):
        self.journal = Journal(self.folder, ABOUT, resume)
        self.head = self.path.read_bytes().split(b"\n")[0] + b"\n"

    def make(self):
        self.count += 1
        time = math.nan if self.count % 3 == 0 else self.count / 7
        return WrittenScan(
            f"{self.count:064d}",
            np.arange(6.0) + self.count,
            time,
            np.array([[True, self.count > 4]]),
        )

    @precondition(lambda self: self.journal)
    @rule()
    def append(self):
        scan = self.make()
        before = self.path.stat().st_size
        self.journal.append(scan)
        self.lines.append((scan, self.path.read_bytes()[before:]))

    @precondition(lambda self: self.journal)
    @rule(keep=st.integers(0, 300))
    def append_on_a_full_disk(self, keep):
        """It is refused or it is whole; what is appended later is not lost with it."""
        file = self.journal._log._file
        self.journal._log._file = ShortFile(file, keep)
        before = self.path.stat().st_size
        scan = self.make()
        try:
            self.journal.append(scan)
        except Full:
            assert len(self.journal.scans) == len(self.lines)
        else:
            self.lines.append((scan, self.path.read_bytes()[before:]))
        self.journal._log._file = file

    @precondition(lambda self: self.journal)
    @rule()
    def append_what_json_cannot_hold(self):
        with pytest.raises(ValueError, match="JSON"):
            self.journal.append(self.make()._replace(pose=np.full(6, np.nan)))

    @precondition(lambda self: self.journal)
    @rule(share=st.floats(0, 1))
    def keep(self, share):
        self.journal.keep(round(share * len(self.lines)))
        del self.lines[round(share * len(self.lines)) :]

    @rule()
    def kill(self):
        if self.journal:
            self.journal.close()
            self.journal = None

    @precondition(lambda self: not self.journal)
    @rule(data=st.binary(min_size=1, max_size=40), again=st.booleans())
    def leave_half_a_line(self, data, again):
        """What a kill in the middle of a write leaves, or the beginning of a line that stands already."""
        last = self.lines[-1][1] if again and self.lines else None
        with self.path.open("ab") as file:
            file.write(
                last[: max(1, len(data) * 5) % len(last)] if last else data.replace(b"\n", b" ")
            )

    @precondition(lambda self: not self.journal)
    @rule(share=st.floats(0, 1))
    def cut(self, share):
        """A crash of the machine may keep less than was written."""
        size = round(share * self.path.stat().st_size)
        os.truncate(self.path, size)
        end = len(self.head)
        kept = []
        for scan, line in self.lines if size >= end else []:
            end += len(line)
            kept += [(scan, line)] if end <= size else []
        self.lines = kept

    @precondition(lambda self: not self.journal and self.lines)
    @rule(
        share=st.floats(0, 1, exclude_max=True),
        bit=st.integers(0, 7),
        where=st.floats(0, 1, exclude_max=True),
    )
    def flip(self, share, bit, where):
        which = int(share * len(self.lines))
        at = len(self.head) + sum(len(line) for _, line in self.lines[:which])
        raw = bytearray(self.path.read_bytes())
        raw[at + int(where * len(self.lines[which][1]))] ^= 1 << bit
        self.path.write_bytes(raw)
        del self.lines[which:]

    @precondition(lambda self: not self.journal)
    @rule()
    def begin_with_another_run(self):
        if not self.path.read_bytes().startswith(self.head):
            return  # nothing stands that it could be told from
        with pytest.raises(OtherRunError, match=r"digest is \"0f\", this one's \"aa\""):
            Journal(self.folder, {**ABOUT, "inputs": {"digest": "aa"}}, True)

    @precondition(lambda self: not self.journal)
    @rule(resume=st.sampled_from([True, True, True, False]))
    def reopen(self, resume):
        self.lines = self.lines if resume else []
        self.open(resume)

    @precondition(lambda self: self.journal)
    @rule()
    def open_twice(self):
        with pytest.raises(JournalError, match="another process is writing"):
            Journal(self.folder, ABOUT, True)

    @invariant()
    def holds_what_was_acknowledged(self):
        if self.journal:
            assert len(self.journal.scans) == len(self.lines)
            for found, (want, _) in zip(self.journal.scans, self.lines, strict=True):
                np.testing.assert_equal(found._asdict(), want._asdict())
            assert self.path.read_bytes() == self.head + b"".join(line for _, line in self.lines)


TestJournal = JournalMachine.TestCase
TestJournal.settings = MACHINE


class Kill(BaseException):
    """Comes at a place where a process may be killed."""


class StoreMachine(RuleBasedStateMachine):
    """A run store has the scans whose append returned, in order and to the bit, or says which file is wrong."""

    fixed = (1e9 + 1e8 * np.arange(3), ["HH"], [[-0.5, 0, 0], [0.4, 0, 0]], [[0.5, 0, 0]] * 2)

    def __init__(self):
        super().__init__()
        self.home = Path(tempfile.mkdtemp())
        self.path = self.home / "run.zarr"
        self.partial = self.home / "run.zarr.partial"
        # begun: scans of the writer or what it left
        self.writer = None
        self.begun = []
        self.stored = None
        self.count = 0
        self.inputs = {"digest": "0f"}
        self.quick = mock.patch.object(os, "fsync", return_value=None)
        self.quick.start()

    def teardown(self):
        self.kill()
        if self.begun:  # whatever happened, it can be ended
            self.open(True)
            self.commit()
        self.quick.stop()
        shutil.rmtree(self.home)

    def make(self):
        self.count += 1
        rng = np.random.default_rng(self.count)
        signal = (rng.normal(size=(1, 2, 3)) + 1j * rng.normal(size=(1, 2, 3))).astype(np.complex64)
        if self.count % 5 == 0:
            signal[0, 1, 1] = np.nan
        return (
            signal,
            np.append(rng.normal(size=3), np.zeros(3)),
            math.nan if self.count % 4 == 0 else self.count / 3,
        )

    @precondition(lambda self: self.writer is None)
    @rule(resume=st.sampled_from([True, True, True, False]))
    def open(self, resume):
        self.begun = self.begun if resume else []
        self.writer = RunWriter(
            self.path, *self.fixed, overwrite=True, resume=resume, inputs=self.inputs
        )
        assert len(self.writer) == len(self.begun)

    @precondition(lambda self: self.writer is None)
    @rule()
    def begin_with_other_inputs(self):
        """Refused while something stands, and nothing is lost by it."""
        if self.begun:
            with pytest.raises(RunStoreError, match=r"another unfinished run is there: its digest"):
                RunWriter(
                    self.path, *self.fixed, overwrite=True, resume=True, inputs={"digest": "aa"}
                )

    @precondition(lambda self: self.writer is not None)
    @rule()
    def open_twice(self):
        with pytest.raises(RunStoreError, match="another process is writing"):
            RunWriter(self.path, *self.fixed, overwrite=True, resume=True, inputs=self.inputs)

    @precondition(lambda self: self.writer is not None)
    @rule(times=st.integers(1, 3))
    def append(self, times):
        for _ in range(times):
            scan = self.make()
            self.writer.append(*scan)
            self.begun.append(scan)

    @precondition(lambda self: self.writer is not None)
    @rule(what=st.sampled_from(["signal", "pose", "nan", "time"]))
    def append_what_is_wrong(self, what):
        """It is refused when it comes, and not when the run is committed and all is lost."""
        signal, pose, time = self.make()
        signal = np.zeros((2, 1, 3)) if what == "signal" else signal
        pose = {"pose": np.zeros(3), "nan": np.full(6, np.nan)}.get(what, pose)
        with pytest.raises(ValueError, match=rf"{what if what != 'nan' else 'pose'} must"):
            self.writer.append(signal, pose, math.inf if what == "time" else time)
        assert len(self.writer) == len(self.begun)

    @precondition(lambda self: self.writer is not None)
    @rule(at=st.sampled_from(["sync_file", "sha256"]))
    def append_and_stop_inside(self, at):
        """A stop between chunk and journal: the scan was not acknowledged, and the next takes its place."""
        with mock.patch.object(run_writer, at, side_effect=Kill), pytest.raises(Kill):
            self.writer.append(*self.make())

    @rule()
    def kill(self):
        if self.writer is not None:
            self.writer._journal.close()
            self.writer = None

    @precondition(lambda self: self.writer is None and self.begun)
    @rule(data=st.data())
    def damage_what_was_begun(self, data):
        """Files other than they were, after a crash of the machine: from there on scans are made anew."""
        which = data.draw(st.integers(0, len(self.begun) - 1))
        chunk = self.partial / "signal" / "c" / str(which) / "0" / "0" / "0"
        what = data.draw(st.sampled_from(["cut", "gone", "flip", "more", "stray", "zarr", "half"]))
        if what in ("cut", "gone", "flip", "more"):
            _hurt(chunk, what)
            del self.begun[which:]
        elif what == "stray":
            (self.partial / "signal" / "c" / "77").mkdir(exist_ok=True)
            (self.partial / "signal" / "c" / "77" / "0").write_bytes(b"left")
            (self.partial / "commit.json.partial").write_text("{")
        elif what == "zarr":
            (self.partial / "zarr.json").write_text("{")
            (self.partial / "signal" / "zarr.json").unlink(missing_ok=True)
        else:
            with (self.partial / JOURNAL).open("ab") as file:
                file.write(b'0123 {"pose":[1,')

    @precondition(lambda self: self.writer is not None and self.begun)
    @rule()
    def commit(self):
        with self.writer:
            pass
        self.writer = None
        self.stored = self.begun
        self.begun = []
        assert not self.partial.exists()

    @precondition(lambda self: self.writer is not None and self.begun)
    @rule(at=st.sampled_from(["make_run", "_write_manifest", "write_whole", "replace_folder"]))
    def commit_and_stop_inside(self, at):
        with mock.patch.object(run_writer, at, side_effect=Kill), pytest.raises(Kill):
            self.writer.commit()
        self.kill()

    @precondition(lambda self: self.writer is not None and self.begun)
    @rule()
    def commit_and_stop_at_its_end(self):
        """The store has its name; only the journal was not yet taken out."""

        def stop(*folders):
            replace_folder(*folders)
            raise Kill

        with mock.patch.object(run_writer, "replace_folder", stop), pytest.raises(Kill):
            self.writer.commit()
        self.stored = self.begun
        self.begun = []
        self.kill()

    @precondition(lambda self: self.stored)
    @rule()
    def is_not_written_over(self):
        with pytest.raises(FileExistsError, match="must not exist yet"):
            RunWriter(self.path, *self.fixed)

    @precondition(lambda self: self.stored)
    @rule(
        what=st.sampled_from(["cut", "gone", "flip", "more"]),
        share=st.floats(0, 1, exclude_max=True),
    )
    def read_what_was_altered(self, what, share):
        which = int(share * len(self.stored))
        chunk = self.path / "signal" / "c" / str(which) / "0" / "0" / "0"
        good = chunk.read_bytes()
        _hurt(chunk, what)
        with pytest.raises(RunStoreError, match=rf"run\.zarr: signal/c/{which}/0/0/0 "):
            open_run(self.path).load()
        chunk.write_bytes(good)

    @invariant()
    def reads_what_was_stored(self):
        if self.stored is None:
            assert not self.path.exists()
            return
        run = open_run(self.path)
        for name, want in zip(
            ("signal", "pose", "time"), zip(*self.stored, strict=True), strict=True
        ):
            np.testing.assert_array_equal(run[name].values, np.stack(want))


def _hurt(path, what):
    data = path.read_bytes()
    if what == "gone":
        path.unlink()
    else:
        path.write_bytes(
            {
                "cut": data[:-3],
                "flip": data[:5] + bytes([data[5] ^ 4]) + data[6:],
                "more": data + b"\0",
            }[what]
        )


TestStore = StoreMachine.TestCase
TestStore.settings = MACHINE
