"""Who may send over TCP: those that know the secret, and silent connections keep nobody out."""

import contextlib
import queue
import socket
import threading
import time

import numpy as np
import pytest

from flgpr.live import feeding
from flgpr.live import sockets as secret
from flgpr.live.options import LiveOptions
from flgpr.live.senders import TcpWatch
from flgpr.live.session import LiveRun
from flgpr.live.sockets import (
    ANSWER_BYTES,
    MARK,
    VARIABLE,
    answer,
    answer_challenge,
    challenge,
    is_answer,
    live_secret,
    parse_tcp,
)
from flgpr.store import describe_for_live, encode_frame, encode_scan, save_run
from live_lane import make_lane_run, small_recipe
from live_sockets import QUICK, first_scan, is_ended, sending_over, wait_for, watching

WORD = b"forty two sheep of the moon"
RUN = make_lane_run(scans=2)
SCAN = first_scan(RUN)


@contextlib.contextmanager
def listening(word=WORD, limits=QUICK):
    """Yield the inbox and the way to connect to a TCP port that asks for a secret."""

    def watch(address, inbox, limits):
        return TcpWatch(parse_tcp(address), inbox, limits, secret=word)

    with watching(watch, "0", limits) as (inbox, source):
        yield inbox, lambda: socket.create_connection((source.address.host, source.address.port))


def received(connection, size=ANSWER_BYTES):
    """Return so many bytes that come."""
    data = b""
    while len(data) < size:
        data += connection.recv(size - len(data))
    return data


def test_an_answer_is_of_use_once():
    asked = challenge()
    assert asked.startswith(MARK)
    assert len(asked) == len(answer(WORD, asked)) == ANSWER_BYTES
    assert is_answer(WORD, asked, answer(WORD, asked))
    assert not is_answer(WORD, challenge(), answer(WORD, asked))
    assert not is_answer(WORD, asked, answer(WORD + b"!", asked))
    assert not is_answer(WORD, asked, b"")


def test_answers_are_compared_in_constant_time(monkeypatch):
    compared = []
    monkeypatch.setattr(secret.hmac, "compare_digest", lambda *two: compared.append(two) or True)
    assert is_answer(WORD, b"a", b"b")
    assert compared == [(answer(WORD, b"a"), b"b")]


def test_a_secret_comes_from_a_file_or_the_environment(tmp_path, monkeypatch):
    monkeypatch.delenv(VARIABLE, raising=False)
    assert live_secret(None) is None
    path = tmp_path / "secret"
    path.write_bytes(b"\n" + WORD + b"\r\n")
    assert live_secret(path) == WORD
    monkeypatch.setenv(VARIABLE, "another word of the moon ö")
    assert live_secret(None) == "another word of the moon ö".encode()
    assert live_secret(path) == WORD
    path.write_text("short")
    with pytest.raises(
        ValueError, match=r"secret must have 16 bytes or more, got 5 in .*secret: make"
    ):
        live_secret(path)
    path.write_bytes(b"x" * 5000)
    with pytest.raises(ValueError, match="must hold at most"):
        live_secret(path)
    monkeypatch.setenv(VARIABLE, "")
    with pytest.raises(ValueError, match=f"got 0 in {VARIABLE}"):
        live_secret(None)


def test_who_knows_the_secret_may_send():
    with listening() as (inbox, connect), sending_over(connect) as sender:
        answer_challenge(sender, WORD)
        sender.sendall(SCAN)
        assert inbox.arrivals.get(timeout=20).data == SCAN


@pytest.mark.parametrize(
    "forge",
    [
        lambda asked: SCAN,
        lambda asked: encode_frame("end", {"scans": 2}),
        lambda asked: asked + SCAN,
        lambda asked: answer(b"a guess of the secret", asked) + SCAN,
        lambda asked: answer(WORD, challenge()) + SCAN,
    ],
    ids=["scan", "end", "echo", "guess", "replay"],
)
def test_nothing_of_others_is_taken(forge):
    with listening() as (inbox, connect), sending_over(connect) as sender:
        with contextlib.suppress(OSError):
            sender.sendall(forge(received(sender)))
        assert is_ended(sender)
        wait_for(lambda: inbox._senders["ended"] == 1)
        assert inbox.arrivals.empty()


def test_who_never_answers_is_ended():
    with listening() as (inbox, connect), sending_over(connect) as sender:
        received(sender)
        sender.sendall(MARK)
        assert is_ended(sender)
        assert inbox.arrivals.empty()


def test_a_feed_without_the_right_secret_is_told_so():
    class Silent(threading.Thread):
        def __init__(self):
            super().__init__(daemon=True)
            self.listener = socket.create_server(("127.0.0.1", 0))

        def run(self):
            connection, _ = self.listener.accept()
            connection.close()

    server = Silent()
    server.start()
    refusal = pytest.raises(ValueError, match="secret must be asked for by flgpr live at the other")
    with socket.create_connection(server.listener.getsockname()) as connection, refusal:
        answer_challenge(connection, WORD)
    server.listener.close()


def takes_scan(inbox):
    """Take what came up to a scan; the bad frames of others lie before it."""
    while inbox.arrivals.get(timeout=5).data != SCAN:
        pass


@pytest.mark.slow("waits for senders")
@pytest.mark.parametrize("word", [None, WORD])
@pytest.mark.parametrize("begun", [b"", b"F"])
def test_connections_that_come_one_after_another_keep_no_radar_out(word, begun):
    """A hundred a second, of which sixteen may be there: the radar sends at once and comes in.

    On a machine that is busy it may be ended before it is heard, or while its first scan is read, and connects again.
    """
    stop = threading.Event()

    def flood(connect):
        held = []
        while not stop.is_set():
            with contextlib.suppress(OSError):
                held.append(connect())
                held[-1].sendall(begun)
            time.sleep(0.01)
        for one in held:
            one.close()

    with listening(word, None) as (inbox, connect):
        flooding = threading.Thread(target=flood, args=(connect,))
        flooding.start()
        try:
            time.sleep(0.5)
            came = tries = 0
            while came < 5 and tries < 15:
                tries += 1
                with sending_over(connect) as radar:
                    try:
                        if word is not None:
                            answer_challenge(radar, word)
                        radar.sendall(SCAN)
                        takes_scan(inbox)
                        time.sleep(0.3)
                        radar.sendall(SCAN)  # it stays, because it sent a good frame
                        takes_scan(inbox)
                    except (OSError, ValueError, queue.Empty):
                        continue
                    came += 1
            assert came == 5
            assert inbox._senders["refused"] == 0
        finally:
            stop.set()
            flooding.join()


@pytest.mark.slow("runs live detection")
def test_a_live_run_with_a_secret_takes_the_radar_and_no_forger(tmp_path, caplog):
    run = make_lane_run()
    save_run(run, tmp_path / "run.zarr")
    (tmp_path / "recipe.toml").write_text(small_recipe())
    (tmp_path / "secret").write_bytes(WORD)
    (tmp_path / "wrong").write_bytes(WORD[::-1])
    options = LiveOptions(
        tmp_path / "recipe.toml", tmp_path / "out", tcp="0", secret_file=tmp_path / "secret"
    )
    live = LiveRun(options)
    reports = []
    thread = threading.Thread(target=lambda: reports.append(live.run()))
    thread.start()
    wait_for(lambda: live.listens_on is not None)
    address = str(live.listens_on)
    forged = encode_scan(0, np.zeros(describe_for_live(run).shape), np.zeros(6))
    with socket.create_connection(("127.0.0.1", live.listens_on.port)) as forger:
        forger.sendall(forged + encode_frame("end", {"scans": 1}))
        received(forger)
        assert is_ended(forger)
    with contextlib.suppress(ValueError):
        feeding.feed(
            tmp_path / "run.zarr", rate=float("inf"), tcp=address, secret_file=tmp_path / "wrong"
        )
    feeding.feed(
        tmp_path / "run.zarr", rate=float("inf"), tcp=address, secret_file=tmp_path / "secret"
    )
    thread.join(60)
    [report] = reports
    assert report.counts["taken"] + report.counts["warm_up"] == run.sizes["scan"]
    assert report.counts["corrupt"] == 0
    assert report.counts["senders_ended"] == 2


def test_a_secret_goes_with_tcp(tmp_path):
    with pytest.raises(ValueError, match="secret-file goes with a TCP address"):
        LiveOptions(None, tmp_path / "out", incoming=tmp_path, secret_file=tmp_path / "secret")
    with pytest.raises(ValueError, match="secret-file goes with a TCP address"):
        feeding.feed(tmp_path / "run.zarr", tmp_path / "in", secret_file=tmp_path / "secret")
