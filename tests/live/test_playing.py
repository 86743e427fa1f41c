"""A recording played as a live source: order, pace, restart, and the alarms of the same scans."""

import threading
import time
from types import SimpleNamespace

import numpy as np
import pytest

from flgpr.live.feeding import feed
from flgpr.live.options import LiveOptions
from flgpr.live.session import LiveRun
from flgpr.live.source import Inbox, RunPlayer, due_times, in_time_order
from flgpr.store import decode_frame, describe_for_live, save_run
from flgpr.store.scan_file import scan_name
from live_lane import make_lane_run, small_recipe

SCANS = 8
RUN = make_lane_run(scans=SCANS)
FAST = float("inf")


def played(run, rate=FAST, known=None):
    inbox = Inbox()
    RunPlayer(run, inbox, rate, known).run()
    return list(inbox.arrivals.queue)


def test_scans_are_played_in_the_order_of_their_times():
    order = [3, 0, 1, 2, 7, 6, 5, 4]
    arrivals = played(RUN.isel(scan=order))
    assert [arrival.kind for arrival in arrivals] == ["run", *["frame"] * SCANS, "end"]
    assert arrivals[0].value == describe_for_live(RUN).as_json()
    for number, arrival in enumerate(arrivals[1:-1]):
        frame = decode_frame(arrival.data)
        assert (arrival.name, frame.header["scan"]) == (scan_name(number), number)
        assert frame.header["time"] == RUN["time"].values[number]
        assert frame.header["pose"] == RUN["pose"].values[number].tolist()
        assert frame.payload == RUN["signal"].values[number].astype("<c8").tobytes()


def test_without_times_the_order_stays_and_a_rate_is_needed():
    unknown = RUN.isel(scan=[2, 0, 1]).assign(time=("scan", [0.0, np.nan, 1.0]))
    assert in_time_order(unknown).identical(unknown)
    with pytest.raises(ValueError, match="rate must be given for a recording without times"):
        due_times(unknown, None)
    np.testing.assert_array_equal(due_times(unknown, 2.0), [0.0, 0.5, 1.0])
    np.testing.assert_array_equal(due_times(unknown, FAST), np.zeros(3))
    with pytest.raises(ValueError, match="rate must be positive, got -1"):
        due_times(RUN, -1.0)


def test_a_recording_is_played_as_it_was_recorded(monkeypatch):
    late = RUN.isel(scan=slice(3)).assign(time=("scan", [100.0, 100.25, 103.0]))
    np.testing.assert_array_equal(due_times(late, None), [0.0, 0.25, 3.0])

    class Clock:
        """Counts the time that is waited for."""

        def __init__(self):
            self.waits = []

        def wait(self, seconds):
            self.waits.append(seconds)
            return False

        def is_set(self):
            return False

    standing = SimpleNamespace(monotonic=lambda: 5.0, time=time.time)
    monkeypatch.setattr("flgpr.live.source.time", standing)
    inbox = Inbox()
    inbox.stop = Clock()
    RunPlayer(late, inbox).run()
    assert inbox.stop.waits == [0.0, 0.25, 3.0]
    inbox.stop = Clock()
    RunPlayer(late, inbox, 2.0, {scan_name(0)}).run()
    assert inbox.stop.waits == [0.0, 0.5]


def test_playing_stops_with_the_live_run():
    inbox = Inbox()
    slow = RUN.assign(time=("scan", 1e6 * np.arange(SCANS)))
    player = RunPlayer(slow, inbox)
    player.start()
    while inbox.arrivals.qsize() < 2:
        time.sleep(0.01)
    inbox.stop.set()
    player.join(20)
    assert not player.is_alive()
    assert inbox.arrivals.qsize() == 2


@pytest.fixture(scope="module")
def home(tmp_path_factory):
    folder = tmp_path_factory.mktemp("played")
    save_run(RUN, folder / "run.zarr")
    (folder / "recipe.toml").write_text(small_recipe())
    feed(folder / "run.zarr", folder / "incoming", FAST)
    LiveRun(LiveOptions(folder / "recipe.toml", folder / "watched", folder / "incoming")).run()
    return folder


def options(home, output, run=RUN, **more):
    return LiveOptions(home / "recipe.toml", output, played=run, rate=FAST, **more)


def test_alarms_are_those_of_the_same_scans_from_a_folder(home, tmp_path):
    report = LiveRun(options(home, tmp_path / "out", RUN.isel(scan=slice(None, None, -1)))).run()
    assert (report.counts["received"], report.counts["taken"]) == (SCANS, SCANS - 4)
    assert report.alarms > 0
    table = (home / "watched" / "alarms.csv").read_bytes()
    assert (tmp_path / "out" / "alarms.csv").read_bytes() == table


def test_a_recording_goes_on_behind_the_last_snapshot(home, tmp_path):
    output = tmp_path / "out"
    slow = RUN.assign(time=("scan", [0, 0, 0, 0, 0, 0, 1e6, 1e6]))
    first = LiveRun(LiveOptions(home / "recipe.toml", output, played=slow))
    thread = threading.Thread(target=first.run)
    thread.start()
    log = output / "live.jsonl"
    while not log.is_file() or '"scan":5,"pose"' not in log.read_text():
        time.sleep(0.01)
    first.stop()
    thread.join(60)
    report = LiveRun(options(home, output, slow)).run()
    assert (report.counts["received"], report.counts["duplicate"]) == (SCANS, 0)
    assert log.read_text().count('"event":"resume"') == 1
    other = RUN.assign_attrs(title="another")
    with pytest.raises(ValueError, match=r"recording: .* another run"):
        LiveRun(options(home, output, other)).run()


def test_a_rate_goes_with_a_recording(home, tmp_path):
    with pytest.raises(ValueError, match="rate goes with a recording that is played, got 3"):
        LiveRun(LiveOptions(home / "recipe.toml", tmp_path, home / "incoming", rate=3.0))
    with pytest.raises(ValueError, match="a TCP address or a recording to take scans from"):
        LiveRun(LiveOptions(home / "recipe.toml", tmp_path))
