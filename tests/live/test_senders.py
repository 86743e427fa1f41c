"""Programs that send over the live socket: how many may, and how long one may hold up the others."""

import contextlib
import json
import select
import socket
import struct
import threading
import time

import numpy as np
import pytest

from flgpr.live.options import LiveOptions
from flgpr.live.senders import SenderLimits, SocketWatch
from flgpr.live.session import LiveRun
from flgpr.live.source import Inbox
from flgpr.store import ScanFileError, describe_for_live, encode_frame, encode_scan
from flgpr.store.scan_file import MAGIC
from live_lane import make_lane_run, small_recipe
from live_sockets import QUICK, first_scan, is_ended, sending_over, wait_for, watching

pytestmark = pytest.mark.slow("waits for senders")

RUN = make_lane_run(scans=2)
DESCRIPTION = describe_for_live(RUN)
DESCRIBED = encode_frame("run", DESCRIPTION.as_json())
SCAN = first_scan(RUN)


def listening(path, limits=QUICK):
    """Listen on a Unix socket."""
    return watching(SocketWatch, path, limits)


def connected(path):
    """Return a connection to a Unix socket."""
    sender = socket.socket(socket.AF_UNIX)
    sender.connect(str(path))
    return sender


def sending(path, data=b""):
    """Send to the Unix socket that is listened on."""
    return sending_over(lambda: connected(path), data)


def test_more_senders_than_may_be_are_refused_and_counted(tmp_path):
    """All that are connected sent a good frame just now."""
    path = tmp_path / "s"
    patient = SenderLimits(senders=3, pause=60.0)
    with listening(path, patient) as (inbox, watch), contextlib.ExitStack() as held:
        good = [held.enter_context(sending(path, SCAN)) for _ in range(3)]
        wait_for(lambda: inbox.arrivals.qsize() == 3)
        for _ in range(5):
            with sending(path) as further:
                assert is_ended(further)
        good[0].sendall(SCAN)
        wait_for(lambda: inbox.arrivals.qsize() == 4)
        assert inbox.take_senders() == {"refused": 5}
        assert len(watch._senders) == 3


def test_who_sends_nothing_of_use_gives_way_and_a_silent_radar_does_not(tmp_path):
    path = tmp_path / "s"
    limits = SenderLimits(senders=3, pause=0.2, silence=60.0)
    with listening(path, limits) as (inbox, _), contextlib.ExitStack() as held:
        radar = held.enter_context(sending(path, SCAN))
        assert inbox.arrivals.get(timeout=20).data == SCAN
        for _ in range(6):
            held.enter_context(sending(path, SCAN[:100]))
            time.sleep(0.25)
        new = held.enter_context(sending(path, SCAN))
        radar.sendall(SCAN)
        wait_for(lambda: [one.data for one in inbox.arrivals.queue].count(SCAN) == 2)
        assert inbox.take_senders()["ended"] >= 4
        new.sendall(SCAN)
        wait_for(lambda: [one.data for one in inbox.arrivals.queue].count(SCAN) == 3)


def test_a_radar_that_connects_anew_without_leaving_comes_in(tmp_path):
    path = tmp_path / "s"
    with listening(path) as (inbox, _), contextlib.ExitStack() as held:
        for _ in range(6):
            held.enter_context(sending(path, SCAN))
            assert inbox.arrivals.get(timeout=20).data == SCAN
            time.sleep(0.3)
        assert inbox.take_senders() == {"ended": 3}


@pytest.mark.parametrize("begun", [b"GET / HT", SCAN[:10], SCAN[:100]])
def test_a_sender_that_sent_half_a_frame_and_no_more_is_ended(tmp_path, begun):
    path = tmp_path / "s"
    with listening(path) as (inbox, _), sending(path, begun) as half, sending(path, SCAN) as good:
        assert is_ended(half)
        good.sendall(SCAN)
        arrivals = [inbox.arrivals.get(timeout=20) for _ in range(3)]
        assert sum(one.data == SCAN for one in arrivals) == 2
        assert sum(isinstance(one.value, ScanFileError) for one in arrivals) == 1
        assert inbox.take_senders() == {"ended": 1}


def test_a_sender_that_waits_for_its_radar_is_not_ended(tmp_path):
    path = tmp_path / "s"
    with listening(path) as (inbox, _), sending(path) as early:
        time.sleep(1.0)
        early.sendall(SCAN)
        assert inbox.arrivals.get(timeout=20).data == SCAN
        assert not inbox.take_senders()


def test_a_frame_that_trickles_is_given_up_and_the_next_one_taken(tmp_path):
    path = tmp_path / "s"
    with listening(path) as (inbox, _), sending(path, SCAN) as sender:
        assert inbox.arrivals.get(timeout=20).data == SCAN
        sent = 0
        while inbox.arrivals.empty():
            sender.sendall(SCAN[sent : sent + 1])
            sent += 1
            time.sleep(0.05)
        assert "must have" in str(inbox.arrivals.get(timeout=20).value)
        sender.sendall(SCAN)
        assert inbox.arrivals.get(timeout=20).data == SCAN
        assert inbox.arrivals.empty()


def test_time_for_which_a_sender_is_held_back_does_not_count(tmp_path):
    """Nobody takes scans for longer than a frame may take; then all are there, and none is bad."""
    path = tmp_path / "s"
    frames = [encode_scan(k, RUN["signal"].values[0], np.zeros(6), 0.0) for k in range(60)]
    with listening(path) as (inbox, _):
        with sending(path) as sender:
            thread = threading.Thread(target=lambda: sender.sendall(b"".join(frames)))
            thread.start()
            wait_for(inbox.arrivals.full)
            time.sleep(0.8)
            arrivals = [inbox.arrivals.get(timeout=20) for _ in frames]
            thread.join(20)
        assert [one.data for one in arrivals] == frames
        assert not inbox.take_senders()


def test_a_lack_of_descriptors_makes_senders_wait(tmp_path, monkeypatch):
    accept = socket.socket.accept
    failures = [OSError(24, "Too many open files")] * 3

    def scarce(self):
        if failures:
            raise failures.pop()
        return accept(self)

    monkeypatch.setattr(socket.socket, "accept", scarce)
    path = tmp_path / "s"
    with listening(path) as (inbox, _), sending(path, SCAN):
        assert inbox.arrivals.get(timeout=20).data == SCAN
    assert not failures


@pytest.fixture
def live(tmp_path):
    """A live run on a socket, in a thread; gives its address, its events and what it reports in the end."""
    (tmp_path / "recipe.toml").write_text(small_recipe())
    run = LiveRun(LiveOptions(tmp_path / "recipe.toml", tmp_path / "out", socket=tmp_path / "s"))
    reports = []
    thread = threading.Thread(target=lambda: reports.append(run.run()))
    thread.start()
    wait_for((tmp_path / "s").is_socket)
    file = tmp_path / "out" / "live.jsonl"

    def ended():
        thread.join(60)
        lines = [json.loads(line) for line in file.read_text().splitlines()]
        return reports[0].counts, lines, file.stat().st_size

    yield tmp_path / "s", ended
    run.stop()
    thread.join(20)


def test_a_flood_of_forged_headers_makes_few_events_that_count_them_all(live):
    path, ended = live
    forged = struct.pack("<8sIQ", MAGIC, 2**31, 0) + bytes(128)
    with sending(path, DESCRIBED) as sender:
        sender.sendall(forged * 10_000)
        sender.sendall(SCAN + encode_frame("end", {}))
        counts, lines, size = ended()
    problems = [line for line in lines if line["event"] == "problem"]
    assert counts["corrupt"] == 10_000
    assert sum(line.get("more", 1) for line in problems) == 10_000
    assert [line["scan"] for line in lines if line["event"] == "scan"] == [0]
    assert lines[-1]["event"] == "end"
    assert size < 50_000


def test_refused_senders_are_told_and_counted_at_the_end(live):
    path, ended = live
    with sending(path, DESCRIBED + SCAN) as radar, contextlib.ExitStack() as held:
        wait_for(lambda: '"event":"scan"' in (path.parent / "out" / "live.jsonl").read_text())
        others = [held.enter_context(sending(path)) for _ in range(30)]
        wait_for(lambda: len(select.select(others, [], [], 0)[0]) == 30 - 15)
        radar.sendall(encode_frame("end", {}))
        counts, lines, _ = ended()
    # Those that never sent a good frame give way to those that come later.
    assert (counts["senders_refused"], counts["senders_ended"]) == (0, 30 - 15)
    words = [line["words"] for line in lines if line["event"] == "problem"]
    assert f"{30 - 15} in all; they sent nothing of use for too long" in words[-1]


def test_a_connection_goes_on_at_the_next_frame_after_a_bad_one(live):
    """As docs/reference/live-format.md says."""
    path, ended = live
    with sending(path, DESCRIBED) as radar:
        radar.sendall(SCAN[:200] + b"nonsense" + SCAN[:-1] + b"\0" + SCAN + encode_frame("end", {}))
        counts, lines, _ = ended()
    assert (counts["corrupt"], counts["warm_up"]) == (2, 1)
    assert [line["scan"] for line in lines if line["event"] == "scan"] == [0]


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("no/such/folder", "its folder does not exist"),
        ("file/socket", "what should be its folder is a file"),
        ("s" * 200, "too long"),
    ],
)
def test_a_socket_that_cannot_be_made_is_told_in_words(tmp_path, name, words):
    (tmp_path / "file").write_text("")
    with pytest.raises(
        ValueError, match=f"socket must be a path that can be made, got .*{words}"
    ) as told:
        SocketWatch(tmp_path / name, Inbox())
    assert "Errno" not in str(told.value)


@pytest.mark.parametrize("kind", [socket.SOCK_STREAM, socket.SOCK_DGRAM])
def test_the_socket_of_another_program_stays(tmp_path, kind):
    path = tmp_path / "theirs"
    with socket.socket(socket.AF_UNIX, kind) as theirs:
        theirs.bind(str(path))
        if kind == socket.SOCK_STREAM:
            theirs.listen(1)
        with pytest.raises(ValueError, match="on which another program listens: give another path"):
            SocketWatch(path, Inbox())
        assert path.is_socket()


def test_the_end_of_another_run_ends_nothing_and_is_told(live):
    path, ended = live
    other = describe_for_live(make_lane_run(scans=2).isel(frequency=slice(1, None)))
    assert other.run_id != DESCRIPTION.run_id
    with sending(path, DESCRIBED) as radar:
        with sending(path, encode_frame("run", other.as_json()) + encode_frame("end", {})):
            wait_for(lambda: "this run goes on" in (path.parent / "out" / "live.jsonl").read_text())
        radar.sendall(SCAN + encode_frame("end", {}))
        counts, lines, _ = ended()
    assert counts["warm_up"] == 1
    words = [line["words"] for line in lines if line["event"] == "problem"]
    assert words.count("a sender of another run ended: this run goes on") == 1


def test_a_description_that_is_refused_leaves_no_place_on_the_earth_behind(live):
    """The next one is of a run with its own."""
    path, ended = live
    here, there = (
        {"crs": "EPSG:4326", "latitude_deg": place, "longitude_deg": 11.0, "azimuth_deg": 0.0}
        for place in (48.0, -33.0)
    )
    run = make_lane_run(scans=2).assign_attrs(georeference=there)
    refused = describe_for_live(run.sel(polarization=["HV"]))
    taken = describe_for_live(RUN.assign_attrs(georeference=here))
    with sending(path, encode_frame("run", refused.as_json())) as radar:
        wait_for(lambda: '"problem"' in (path.parent / "out" / "live.jsonl").read_text())
        radar.sendall(
            encode_frame("run", taken.as_json()) + first_scan(RUN.assign_attrs(georeference=here))
        )
        radar.sendall(encode_frame("end", {}))
        _, lines, _ = ended()
    assert [line["georeference"]["latitude_deg"] for line in lines if "georeference" in line] == [
        48.0
    ]
