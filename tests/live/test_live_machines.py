"""What comes in live under any order of scans, faults, kills and restarts, against models that are plain dicts."""

import json
import shutil
import tempfile
import threading
from pathlib import Path
from unittest import mock

import numpy as np
import pytest
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, precondition, rule

from damage import MACHINE
from flgpr.live import session
from flgpr.live.detector import LiveSettings
from flgpr.live.options import LiveOptions
from flgpr.live.session import LiveRun
from flgpr.model import make_run
from flgpr.store import describe_for_live, encode_scan
from live_lane import make_lane_run, small_recipe

TINY = describe_for_live(
    make_run(np.zeros((1, 1, 1, 2)), [1e9, 2e9], ["HH"], [[0, 0, 0]], [[1, 0, 0]], np.zeros((1, 6)))
)
NUMBERS = st.integers(0, 30)
FEW = st.integers(0, 4)


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
        take = run._take_frame

        def deal(*arguments):
            nonlocal seen
            seen += 1
            if seen == frames and before:
                raise Killed
            done = take(*arguments)
            if seen == frames:
                raise Killed
            return done

        gone = mock.patch.multiple(run, _take_frame=deal, _finish=mock.Mock(side_effect=Killed))
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
            other = LiveSettings(looks=2)
            with pytest.raises(ValueError, match=r"another run, recipe, model or setting; `fresh`"):
                self.options("out", settings=other).run()


TestSession = SessionMachine.TestCase
TestSession.settings = settings(
    MACHINE, max_examples=max(MACHINE.max_examples // 5, 1), stateful_step_count=8
)
