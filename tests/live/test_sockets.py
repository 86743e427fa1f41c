"""Scans over TCP: addresses, who may send, and that the alarms are those of any other way in."""

import contextlib
import socket
import threading
import time

import pytest

from flgpr.live.feeding import feed
from flgpr.live.options import LiveOptions
from flgpr.live.senders import SenderLimits, TcpWatch, largest_frame
from flgpr.live.session import LiveRun
from flgpr.live.sockets import TcpAddress, connected_tcp, listening_tcp, parse_tcp
from flgpr.live.source import Inbox
from flgpr.store import ScanFileError, describe_for_live, encode_frame, save_run
from flgpr.store.scan_file import MAGIC
from live_lane import make_lane_run, small_recipe
from live_sockets import QUICK, first_scan, is_ended, sending_over, wait_for, watching

RUN = make_lane_run(scans=8)
DESCRIPTION = describe_for_live(RUN)
SCAN = first_scan(RUN)
FREE = TcpAddress("127.0.0.1", 0)


def listening(limits=QUICK):
    """Listen on a free port."""
    return watching(TcpWatch, FREE, limits)


def sending(watch, data=b""):
    """Send to the port that is listened on."""
    return sending_over(lambda: connected_tcp(watch.address), data)


@pytest.mark.parametrize(
    ("text", "host", "port", "is_loopback"),
    [
        ("5601", "127.0.0.1", 5601, True),
        ("localhost:0", "127.0.0.1", 0, True),
        ("127.0.0.2:5601", "127.0.0.2", 5601, True),
        ("0.0.0.0:5601", "0.0.0.0", 5601, False),
        ("192.168.1.10:65535", "192.168.1.10", 65535, False),
        ("[::1]:5601", "::1", 5601, True),
        ("[::]:5601", "::", 5601, False),
    ],
)
def test_a_port_alone_is_that_of_this_machine(text, host, port, is_loopback):
    address = parse_tcp(text)
    assert (address.host, address.port, address.is_loopback) == (host, port, is_loopback)
    assert parse_tcp(str(address)) == address


@pytest.mark.parametrize(
    "text",
    ["", "x", ":5601", "-1", "radar.local:5601", "::1:5601", "127.1:5601", "[fe80::1%eth0]:5601",
     "5601:127.0.0.1", "127.0.0.1:", "127.0.0.1:5601 ", "٥٦٠١", "65536", "999999"],
)  # fmt: skip
def test_an_address_that_is_none_is_refused(text):
    with pytest.raises(ValueError, match="tcp must "):
        parse_tcp(text)


def test_by_default_no_other_machine_reaches_it():
    with listening() as (_, watch):
        assert watch._socket.getsockname()[0] == "127.0.0.1"
        assert watch.address.port > 0


def test_a_port_that_is_taken_is_told_in_words():
    with listening() as (_, watch):
        words = f"got {watch.address}: another program listens on it; port 0 takes a free one"
        with pytest.raises(ValueError, match=words):
            TcpWatch(watch.address, Inbox())
    with pytest.raises(ValueError, match="this machine has no such address"):
        TcpWatch(TcpAddress("192.0.2.1", 0), Inbox())  # of documents alone, RFC 5737


def test_a_feed_without_a_listener_is_told_in_words(tmp_path):
    save_run(RUN, tmp_path / "run.zarr")
    with listening_tcp(FREE, 1) as closed:
        address = TcpAddress("127.0.0.1", closed.getsockname()[1])
    with pytest.raises(ValueError, match=f"flgpr live listens on, got {address}: ") as told:
        feed(tmp_path / "run.zarr", tcp=str(address))
    assert "Errno" not in str(told.value)


@pytest.mark.parametrize(
    "first",
    [
        b"POST / HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n",
        b"F",  # as a frame begins, and then goes on as none does
        b"FLGPRSC2",
    ],
)
def test_who_does_not_begin_with_a_frame_is_ended_and_what_it_hides_is_not_taken(first):
    """A web page in a browser on the vehicle's computer may send to its ports."""
    with listening() as (inbox, watch):
        with sending(watch, first) as page:
            if first == b"F":
                time.sleep(0.1)
                page.sendall(b"X")
            with contextlib.suppress(ConnectionError):
                page.sendall(SCAN)
            assert is_ended(page)
        wait_for(lambda: not any(sender.is_alive() for sender in watch._senders))
        assert inbox.arrivals.empty()
        assert inbox.take_senders() == {"ended": 1}
        with sending(watch, SCAN[:3]) as slow:
            time.sleep(0.05)
            slow.sendall(SCAN[3:])
            assert inbox.arrivals.get(timeout=20).data == SCAN


def test_limits_are_those_of_the_unix_socket():
    """Too many senders, half a frame, a frame that is too large, nonsense between frames."""
    with listening(SenderLimits(senders=2, pause=60.0)) as (inbox, watch):
        with sending(watch, SCAN) as good, sending(watch, SCAN):
            wait_for(lambda: inbox.arrivals.qsize() == 2)
            with sending(watch) as further:
                assert is_ended(further)
            assert inbox.take_senders() == {"refused": 1}
            inbox.largest = largest_frame(DESCRIPTION)
            too_large = MAGIC + (2**20).to_bytes(4, "little") + (2**31).to_bytes(8, "little")
            good.sendall(too_large + SCAN)
            arrivals = [inbox.arrivals.get(timeout=20) for _ in range(4)]
        errors = [arrival.value for arrival in arrivals if arrival.value is not None]
        assert [type(error) for error in errors] == [ScanFileError]
        assert f"at most {inbox.largest} bytes" in str(errors[0])
        assert [arrival.data for arrival in arrivals].count(SCAN) == 3
    with listening() as (inbox, watch), sending(watch, SCAN[:100]) as half:
        assert is_ended(half)
        assert "must have" in str(inbox.arrivals.get(timeout=20).value)


def test_a_live_run_over_tcp_raises_the_same_alarms_as_from_a_folder(tmp_path, caplog):
    save_run(RUN, tmp_path / "run.zarr")
    (tmp_path / "recipe.toml").write_text(small_recipe())
    feed(tmp_path / "run.zarr", tmp_path / "incoming", float("inf"))
    recipe = tmp_path / "recipe.toml"
    LiveRun(LiveOptions(recipe, tmp_path / "folder", tmp_path / "incoming")).run()

    run = LiveRun(LiveOptions(recipe, tmp_path / "tcp", tcp="0"))
    reports = []
    with caplog.at_level("INFO", "flgpr.notes"):
        thread = threading.Thread(target=lambda: reports.append(run.run()))
        thread.start()
        wait_for(lambda: run.listens_on is not None)
        with connected_tcp(run.listens_on) as page:
            page.sendall(b"GET / HTTP/1.1\r\n\r\n")
            assert is_ended(page)
        assert feed(tmp_path / "run.zarr", None, float("inf"), tcp=str(run.listens_on)) == 8
        thread.join(60)
    assert reports[0].alarms > 0
    assert reports[0].counts["senders_ended"] == 1
    assert caplog.messages == [f"listens on {run.listens_on}"]
    table = (tmp_path / "folder" / "alarms.csv").read_bytes()
    assert (tmp_path / "tcp" / "alarms.csv").read_bytes() == table
    with socket.socket() as probe:
        assert probe.connect_ex((run.listens_on.host, run.listens_on.port)) != 0


def test_other_interfaces_are_opened_only_when_asked_for_and_said(tmp_path, caplog):
    (tmp_path / "recipe.toml").write_text(small_recipe())
    options = LiveOptions(tmp_path / "recipe.toml", tmp_path / "out", tcp="0.0.0.0:0", idle=60.0)
    run = LiveRun(options)
    with caplog.at_level("INFO", "flgpr.notes"):
        thread = threading.Thread(target=run.run)
        thread.start()
        wait_for(lambda: run.listens_on is not None)
        with connected_tcp(TcpAddress("127.0.0.1", run.listens_on.port)) as sender:
            sender.sendall(encode_frame("run", DESCRIPTION.as_json()) + encode_frame("end", {}))
            thread.join(60)
    assert f"0.0.0.0:{run.listens_on.port}: whoever reaches this address" in caplog.messages[0]


def test_an_address_that_is_none_is_refused_before_anything_is_written(tmp_path):
    (tmp_path / "recipe.toml").write_text(small_recipe())
    with pytest.raises(ValueError, match="tcp must be PORT or ADDRESS:PORT"):
        LiveRun(LiveOptions(tmp_path / "recipe.toml", tmp_path / "out", tcp="radar:5601"))
    save_run(RUN, tmp_path / "run.zarr")
    with pytest.raises(ValueError, match="tcp must be PORT or ADDRESS:PORT"):
        feed(tmp_path / "run.zarr", tcp="radar:5601")
    assert sorted(path.name for path in tmp_path.iterdir()) == [
        "recipe.toml",
        "run.zarr",
    ]
