"""What comes in live under any order of scans, faults, kills and restarts, against models that are plain dicts."""

import json
import shutil
import tempfile
import threading
import time
from pathlib import Path
from unittest import mock

import numpy as np
import pytest
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, invariant, precondition, rule

from damage import CASES, MACHINE
from flgpr.live import session, watch
from flgpr.live.intake import Intake
from flgpr.live.session import LiveOptions, LiveRun
from flgpr.live.watch import FolderWatch, Inbox
from flgpr.model import make_run
from flgpr.store import ScanFileError, describe_for_live, encode_scan
from flgpr.store.scan_file import scan_name
from live_lane import make_lane_run, small_recipe

TINY = describe_for_live(
    make_run(np.zeros((1, 1, 1, 2)), [1e9, 2e9], ["HH"], [[0, 0, 0]], [[1, 0, 0]], np.zeros((1, 6)))
)
NUMBERS = st.integers(0, 30)
FEW = st.integers(0, 4)


class IntakeMachine(RuleBasedStateMachine):
    """A number is used once at most, the counts add up, and a pose that was filled in lies on its neighbours' line."""

    def __init__(self):
        super().__init__()
        self.intake = Intake(TINY)
        self.known = set()
        self.went = []
        self.poses = {}
        self.kept = None
        self.frames = self.bad = 0

    def frame(self, number, pose=True, whole=True, run=TINY.run_id):
        signal = np.full(TINY.shape, 1.0 if whole else np.nan)
        where = [np.sin(number), 0.4 * number, 2.0, 0.02 * number, 0, 0] if pose else None
        return encode_scan(number, signal, where, run_id=run), where

    @rule(
        number=NUMBERS,
        pose=st.sampled_from([True, True, True, False]),
        whole=st.sampled_from([True, True, False]),
    )
    def give(self, number, pose, whole):
        data, where = self.frame(number, pose, whole)
        scan = self.intake.admit(data)
        new = number not in self.went
        self.frames += 1
        if new:
            self.known.add(number)
        if new and pose:
            self.poses[number] = np.array(where)
        if not (new and whole):
            assert scan is None
        elif pose:
            assert scan.pose.tolist() == where
        else:
            self.check_filled(number, scan)
        if scan is not None:
            assert scan.number == number
            assert number not in self.went
            self.went.append(number)
            self.intake.judged(number, "taken", None)

    def check_filled(self, number, scan):
        near = [
            known for known in sorted(self.poses)[-8:] if known != number
        ]  # its own came with a bad signal
        before = ([n for n in near if n < number] or [None])[-1]
        after = ([n for n in near if n > number] or [None])[0]
        pair = (
            (before, after)
            if None not in (before, after)
            else tuple(near[-2:] if after is None else near[:2])
        )
        if len(near) < 2 or min(abs(number - n) for n in pair) > 3:
            assert scan is None
            return
        (a, b), share = (self.poses[n] for n in pair), (number - pair[0]) / (pair[1] - pair[0])
        np.testing.assert_allclose(scan.pose, a + share * (b - a), atol=1e-12)

    @rule(number=NUMBERS, at=st.integers(0, 10**6), other=st.booleans())
    def give_what_is_bad(self, number, at, other):
        data, _ = self.frame(number, run="0123456789abcdef" if other else TINY.run_id)
        raw = bytearray(data)
        raw[at % len(raw)] ^= 0 if other else 8
        self.frames = self.frames + 1
        self.bad = self.bad + 1
        with pytest.raises(ScanFileError, match=r"frame|scan"):
            self.intake.admit(bytes(raw))

    @rule()
    def keep(self):
        model = set(self.known), list(self.went), dict(self.poses), self.frames, self.bad
        self.kept = json.loads(json.dumps(self.intake.state())), model

    @precondition(lambda self: self.kept)
    @rule()
    def go_on_from_what_was_kept(self):
        state, (known, went, poses, self.frames, self.bad) = self.kept
        self.known = set(known)
        self.went = list(went)
        self.poses = dict(poses)
        self.intake = Intake(TINY)
        self.intake.restore(state)

    @invariant()
    def counts_add_up(self):
        counts = self.intake.counts
        assert counts["received"] == self.frames
        assert counts["corrupt"] == self.bad
        assert counts["taken"] == len(self.went)
        left_out = ("duplicate", "masked", "pose_missing", "corrupt")
        assert counts["taken"] + sum(counts[name] for name in left_out) == self.frames
        span = max(self.known) - min(self.known) + 1 if self.known else 0
        assert counts["missing"] == span - len(self.known)


TestIntake = IntakeMachine.TestCase
TestIntake.settings = MACHINE


@pytest.mark.parametrize("neighbours", [(4, 3), (0,)])
def test_a_pose_that_came_with_a_bad_signal_fills_no_scan_of_its_own_number(neighbours):
    machine = IntakeMachine()
    for number in neighbours:
        machine.give(number, pose=True, whole=True)
    machine.give(2, pose=True, whole=False)
    machine.give(2, pose=False, whole=True)
    machine.counts_add_up()


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
        self.handed = set()
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
        self.whole[path.name] = self.frame(number)

    @rule(number=FEW, share=st.floats(0, 1, exclude_max=True))
    def write_a_part(self, number, share):
        path = self.folder / scan_name(number)
        frame = self.frame(number)
        if path.name not in self.whole:
            path.write_bytes(frame[: int(share * len(frame))])
            self.torn.setdefault(path.name, None)

    @precondition(lambda self: self.torn)
    @rule(data=st.data())
    def complete(self, data):
        name = data.draw(st.sampled_from(sorted(self.torn)))
        frame = self.frame(int(name[5:11]))
        with (self.folder / name).open("ab") as file:
            file.write(frame[file.tell() :])
        del self.torn[name]
        self.whole[name] = frame

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

    @rule(what=st.sampled_from(["link.scan", "folder.scan", "notes.txt"]))
    def lay_down_something_else(self, what):
        path = self.folder / what
        if what == "link.scan" and not path.is_symlink():
            path.symlink_to(self.folder / "run.json")
        elif what == "folder.scan":
            path.mkdir(exist_ok=True)
        elif what == "notes.txt":
            path.write_text("no scan")

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
        self.start(set(self.handed))

    @rule(times=st.integers(1, 2))
    def look(self, times):
        for _ in range(times):
            self.look_once()

    def look_once(self):
        self.watch._look()
        arrivals = []
        while not self.watch._inbox.arrivals.empty():
            arrivals.append(self.watch._inbox.arrivals.get())
        if not self.told:
            assert arrivals.pop(0).kind == "run"
            self.told = True
        self.handed &= {*self.whole, *self.torn}
        now = time.time() + self.ahead
        given_up = set()
        for name in {*self.torn} - self.handed:
            size = (self.folder / name).stat().st_size
            before = self.torn[name]
            if before is None or before[0] != size:
                self.torn[name] = size, now
            elif now - before[1] > 1.0:
                given_up.add(name)
        due = sorted({*self.whole} - self.handed | given_up)
        frames = [one for one in arrivals if one.kind == "frame"]
        assert [one.name for one in frames] == due
        for one in frames:
            assert one.data == self.whole.get(one.name, one.data)
        self.handed.update(due)
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


class Killed(BaseException):
    """The process is gone."""


RUN = make_lane_run(scans=24)
DESCRIBED = describe_for_live(RUN)


class SessionMachine(RuleBasedStateMachine):
    """However often a live run is killed or stopped, it ends as one that saw the same files undisturbed."""

    def __init__(self):
        super().__init__()
        self.home = Path(tempfile.mkdtemp())
        (self.home / "recipe.toml").write_text(small_recipe())
        (self.home / "in").mkdir()
        (self.home / "in" / "run.json").write_text(json.dumps(DESCRIBED.as_json()))
        self.files = self.number = 0
        self.datum = 0.0  # m, that positions have moved along the lane for good
        self.quick = mock.patch.object(session, "rehearse")
        self.quick.start()

    def teardown(self):
        (self.home / "in" / "end.json").write_text("{}")
        report = self.options("out").run()
        twin = self.options("twin").run()
        self.quick.stop()
        assert report.counts == twin.counts
        assert (self.home / "out" / "alarms.csv").read_bytes() == (
            self.home / "twin" / "alarms.csv"
        ).read_bytes()
        mine, undisturbed = (self.told(name) for name in ("out", "twin"))
        assert {key: mine[key] for key in undisturbed} == undisturbed
        shutil.rmtree(self.home)

    def told(self, name):
        """What was told last of every scan, without the times it took."""
        lines = [
            json.loads(line) for line in (self.home / name / "live.jsonl").read_text().splitlines()
        ]
        return {
            line["scan"]: (line["pose"], line["outcome"])
            for line in lines
            if line["event"] == "scan"
        }

    def options(self, output, **more):
        return LiveRun(
            LiveOptions(self.home / "recipe.toml", self.home / output, self.home / "in", **more)
        )

    def write(self, data):
        name = f"{self.files:04d}.scan"
        (self.home / "in" / (name + ".new")).write_bytes(data)
        (self.home / "in" / (name + ".new")).rename(self.home / "in" / name)
        self.files += 1

    def frame(self, number, fault=""):
        signal = RUN["signal"].values[number]
        pose = RUN["pose"].values[number].copy()
        pose[1] += self.datum + (45.0 if fault == "wrong" else 0.0)
        data = encode_scan(
            number,
            signal * (np.nan if fault == "masked" else 1),
            None if fault == "pose" else pose,
            number / 4.2,
        )
        return data[:-1] + bytes([data[-1] ^ 1]) if fault == "corrupt" else data

    @precondition(lambda self: self.number < 20)
    @rule(
        scans=st.integers(1, 6),
        fault=st.sampled_from(
            ["", "", "lost", "late", "twice", "masked", "pose", "corrupt", "wrong", "moved"]
        ),
    )
    def drive(self, scans, fault):
        """Go on by some scans, of which the second has a fault."""
        numbers = list(range(self.number, min(self.number + scans, 24)))
        self.number = numbers[-1] + 1
        second = numbers[1] if len(numbers) > 1 else None
        if fault == "late" and second is not None:
            numbers = [*numbers[:1], *numbers[2:], second]
        for number in numbers:
            self.datum += 60.0 if number == second and fault == "moved" else 0.0
            if number != second or fault != "lost":
                self.write(self.frame(number, fault if number == second else ""))
            if number == second and fault == "twice":
                self.write(self.frame(number))

    @precondition(lambda self: self.files)
    @rule(frames=st.integers(1, 12), before=st.booleans(), every=st.integers(1, 4))
    def run_and_kill(self, frames, before, every):
        """Killed before a frame is dealt with or after its events are written, with snapshots in between."""
        run = self.options("out", snapshot=every, idle=0.0)
        seen = 0
        take = run._take

        def deal(*arguments):
            nonlocal seen
            seen += 1
            if seen == frames and before:
                raise Killed
            done = take(*arguments)
            if seen == frames:
                raise Killed
            return done

        gone = mock.patch.multiple(run, _take=deal, _finish=mock.Mock(side_effect=Killed))
        with gone, pytest.raises(Killed):
            run.run()
        for thread in threading.enumerate():
            if thread.name == "snapshot":
                thread.join()
        with (self.home / "out" / "live.jsonl").open("ab") as file:
            file.write(b'{"event":"sc')
        (self.home / "out" / "snapshot.bundle.7-aa.partial").write_bytes(b"torn")

    @precondition(lambda self: self.files)
    @rule()
    def run_and_stop(self):
        """Ctrl-C while it waits: it writes its snapshot and its table."""
        self.options("out", idle=0.0).run()

    @precondition(lambda self: self.files)
    @rule()
    def other_settings_are_refused(self):
        if (self.home / "out" / "snapshot.bundle").is_file():
            other = session.LiveSettings(looks=2)
            with pytest.raises(ValueError, match=r"another run, recipe, model or setting; --fresh"):
                self.options("out", settings=other).run()


TestSession = SessionMachine.TestCase
TestSession.settings = settings(
    MACHINE, max_examples=max(MACHINE.max_examples // 5, 1), stateful_step_count=8
)
