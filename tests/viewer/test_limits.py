"""Clients that connect and do not go on: each step has its time, and what they hold is bounded."""

import contextlib
import http.client
import json
import logging
import socket
import subprocess
import sys
import threading
import time
from dataclasses import replace
from pathlib import Path

import pytest
from starlette.responses import Response

from flgpr.store import sample_lane
from flgpr.viewer import Viewer
from flgpr.viewer.limits import FewRecords, Limits, fit_to_process

pytestmark = pytest.mark.slow("waits for connections")

RUN = sample_lane() / "run.zarr"
LINUX = pytest.mark.skipif(not Path("/proc/self/fd").exists(), reason="needs Linux")
SHORT = Limits(connections=8, header=0.5, body=0.3, unread=0.3)
SIZE = 30_000_000
PATIENT = Limits(connections=8, header=30.0, body=30.0, unread=30.0)


def limited(limits, paths=(RUN,), **options):
    return type("Limited", (Viewer,), {"limits": limits})(paths, **options)


def connect(viewer, data=b""):
    sender = socket.create_connection(("127.0.0.1", viewer.port), timeout=10)
    sender.sendall(data)
    return sender


def ends(sender, drip=b""):
    """Wait for the server to end a connection, while a byte now and then goes to it; what it had answered."""
    sender.settimeout(0.05)
    answer = b""
    last = time.monotonic() + 20.0
    while time.monotonic() < last:
        try:
            part = sender.recv(65536)
            if not part:
                return answer
            answer += part
        except TimeoutError:
            with contextlib.suppress(ConnectionError):
                sender.sendall(drip)
        except ConnectionError:
            return answer
    raise AssertionError(f"the connection is still open after {answer[:200]!r}")


def page(viewer, timeout=10):
    connection = http.client.HTTPConnection("127.0.0.1", viewer.port, timeout=timeout)
    connection.request("GET", f"/{viewer.token}/")
    answer = connection.getresponse()
    body = answer.read()
    connection.close()
    return answer.status, body


def request(viewer, method="GET", path="", **headers):
    lines = [f"{method} /{viewer.token}/{path} HTTP/1.1", f"Host: 127.0.0.1:{viewer.port}"]
    lines += [f"{name}: {value}" for name, value in headers.items()]
    return "\r\n".join([*lines, "", ""]).encode()


@pytest.mark.parametrize(
    ("begun", "drip"),
    [
        (b"", b""),
        (b"GET / HT", b""),
        (b"GET /", b"a"),
        (b"GET / HTTP/1.1\r\nHost: x\r\nlong: ", b"a"),
    ],
)
def test_a_header_that_does_not_come_whole_in_time_ends_the_connection(serving, begun, drip):
    with serving(limited(SHORT)) as viewer, connect(viewer, begun) as sender:
        ends(sender, drip)
        assert page(viewer)[0] == 200


@pytest.mark.parametrize("next_one", [b"", b"GET / HT"])
def test_a_kept_connection_that_asks_no_more_ends(serving, next_one):
    with serving(limited(SHORT)) as viewer, connect(viewer, request(viewer)) as sender:
        sender.sendall(next_one)
        assert ends(sender).startswith(b"HTTP/1.1 200 OK")


def test_a_kept_connection_that_goes_on_asking_stays(serving):
    """As the page does that follows a live run: longer in all than any deadline."""
    with serving(limited(replace(SHORT, header=1.0))) as viewer:
        connection = http.client.HTTPConnection("127.0.0.1", viewer.port, timeout=10)
        connection.connect()
        own = connection.sock
        for _ in range(12):
            connection.request("GET", f"/{viewer.token}/data/session.json")
            assert json.loads(connection.getresponse().read())["live"] is False
            assert connection.sock is own
            time.sleep(0.1)
        connection.close()


@pytest.fixture
def judged(demo, serving, tmp_path):
    with serving(limited(SHORT, [demo[0].folder], verdicts=tmp_path / "verdicts.json")) as viewer:
        yield viewer, tmp_path / "verdicts.json"


@pytest.mark.parametrize("drip", [b"", b" "])
def test_a_body_that_does_not_come_whole_in_time_ends_the_connection(judged, drip, caplog):
    viewer, file = judged
    begun = request(viewer, "PUT", "data/verdicts.json", **{"Content-Length": 5000}) + b'{"format"'
    with connect(viewer, begun) as sender:
        assert ends(sender, drip) == b""
    assert page(viewer)[0] == 200
    assert not file.exists()
    assert [
        record.getMessage() for record in caplog.records
    ] == []  # a client that leaves is no fault of the server


def test_a_body_of_a_stranger_is_answered_and_not_waited_for(judged):
    viewer, _ = judged
    begun = request(viewer, "PUT", "data/verdicts.json", **{"Content-Length": 5000})
    with connect(viewer, begun.replace(viewer.token.encode(), b"wrong")) as sender:
        assert ends(sender, b" ").startswith(b"HTTP/1.1 403")


def test_head_of_the_verdicts_is_answered_as_get(judged):
    viewer, _ = judged
    answers = []
    for method in ("GET", "HEAD"):
        with connect(
            viewer, request(viewer, method, "data/verdicts.json", Connection="close")
        ) as sender:
            answers.append(ends(sender))
    body = answers[0].partition(b"\r\n\r\n")[2]
    assert json.loads(body) == {"sha256": "", "notes": []}
    assert answers[1].splitlines()[0] == b"HTTP/1.1 200 OK"
    assert answers[1].endswith(b"\r\n\r\n")
    assert b"content-length: %d" % len(body) in answers[1]


@pytest.fixture
def large(serving, monkeypatch):
    """Serve an answer that no socket's buffers hold."""
    monkeypatch.setattr(Viewer, "_session", lambda self, request: Response(b"a" * SIZE))

    @contextlib.contextmanager
    def start(**limits):
        with serving(limited(replace(SHORT, **limits))) as viewer:
            yield viewer

    return start


def test_an_answer_that_is_not_taken_ends_the_connection(large):
    with large() as viewer, connect(viewer, request(viewer, path="data/session.json")) as sender:
        for _ in range(400):
            if (
                viewer._server.server_state.total_requests
                and not viewer._server.server_state.connections
            ):
                break
            time.sleep(0.05)
        assert not viewer._server.server_state.connections
        assert len(ends(sender)) < SIZE


@pytest.mark.slow("takes an answer slowly")
def test_an_answer_that_is_taken_slowly_comes_whole(large):
    """It takes longer than the deadline, in which 64 KiB must be taken."""
    asking = {"path": "data/session.json", "Connection": "close"}
    with large(unread=3.0) as viewer, connect(viewer, request(viewer, **asking)) as sender:
        taken = 0
        began = time.monotonic()
        while time.monotonic() < began + 3.6:
            taken += len(sender.recv(200_000))
            time.sleep(0.05)
        assert taken < SIZE
        taken += len(ends(sender))
    assert taken > SIZE


def test_connections_are_at_most_so_many_and_a_good_one_comes_through(serving):
    with serving(limited(PATIENT)) as viewer, contextlib.ExitStack() as held:
        senders = [held.enter_context(connect(viewer, b"GET / HT")) for _ in range(60)]
        assert page(viewer, timeout=5)[0] == 200
        assert len(viewer._server.server_state.connections) <= PATIENT.connections
        for sender in senders[: -PATIENT.connections]:
            ends(sender)  # those that waited the longest


def test_when_all_connections_are_busy_a_further_one_is_told_so(serving, monkeypatch):
    may_answer = threading.Event()
    answered = Viewer._session

    def slow(self, request):
        may_answer.wait(20)
        return answered(self, request)

    monkeypatch.setattr(Viewer, "_session", slow)
    with serving(limited(PATIENT)) as viewer, contextlib.ExitStack() as held:
        try:
            asking = request(viewer, path="data/session.json", Connection="close")
            busy = [held.enter_context(connect(viewer, asking)) for _ in range(PATIENT.connections)]
            for _ in range(200):
                if sum(
                    one.cycle is not None for one in viewer._server.server_state.connections
                ) == len(busy):
                    break
                time.sleep(0.02)
            with connect(viewer) as further:
                assert ends(further).startswith(b"HTTP/1.1 503 ")
        finally:
            may_answer.set()
        assert all(ends(sender).startswith(b"HTTP/1.1 200 OK") for sender in busy)
        assert page(viewer)[0] == 200


@pytest.mark.parametrize("begun", [b"GET / HT", b"PUT"])
def test_a_server_ends_at_once_whatever_clients_hold(judged, begun):
    viewer, _ = judged
    viewer._server.config.limits = PATIENT  # of connections that come from now on
    if begun == b"PUT":
        begun = request(viewer, "PUT", "data/verdicts.json", **{"Content-Length": 5000})
    with connect(viewer, begun), connect(viewer, begun) as sender:
        for _ in range(100):
            if len(viewer._server.server_state.connections) == 2:
                break
            time.sleep(0.02)
        viewer.stop()
        ends(sender)  # the deadlines are 30 s; the fixture waits for the thread


SCARCE = """
import os, resource, sys, threading, time
resource.setrlimit(resource.RLIMIT_NOFILE, (64, 64))
from flgpr.viewer import Viewer
from flgpr.viewer.limits import LimitedServer
faults = []
report = LimitedServer._report
LimitedServer._report = lambda self, loop, context: (faults.append(context["message"]), report(self, loop, context))
viewer = Viewer([sys.argv[1]])
thread = threading.Thread(target=viewer.run); thread.start()
while not viewer._server.started: time.sleep(0.01)
taken = []
for line in sys.stdin:
    if line == "take\\n":
        try:
            while True: taken.append(os.open(os.devnull, os.O_RDONLY))
        except OSError: pass
    if line == "give back\\n":
        while taken: os.close(taken.pop())
    print(viewer.port, viewer.token, len(faults), flush=True)
viewer.stop(); thread.join()
"""


@pytest.mark.slow("runs in processes of its own")
@LINUX
def test_a_server_without_file_descriptors_waits_and_says_so_once():
    command = [sys.executable, "-c", SCARCE, str(RUN)]
    pipes = dict.fromkeys(("stdin", "stdout", "stderr"), subprocess.PIPE)
    with subprocess.Popen(command, text=True, bufsize=1, **pipes) as process:

        def order(line):
            process.stdin.write(f"{line}\n")
            port, token, faults = process.stdout.readline().split()
            return int(port), token, int(faults)

        port, token, _ = order("begin")
        kept = http.client.HTTPConnection("127.0.0.1", port, timeout=20)
        kept.request("GET", f"/{token}/data/session.json")
        assert kept.getresponse().read()
        order("take")
        began = time.monotonic()
        kept.request("GET", f"/{token}/app.js")
        answer = kept.getresponse()
        words = json.loads(answer.read())["error"]
        waiting = [socket.create_connection(("127.0.0.1", port), timeout=20) for _ in range(5)]
        waiting[0].sendall(
            f"GET /{token}/ HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\nConnection: close\r\n\r\n".encode()
        )
        time.sleep(1.5)
        seconds = time.monotonic() - began
        faults = order("give back")[2]
        assert waiting[0].recv(100).startswith(b"HTTP/1.1 200 OK")
        for one in waiting:
            one.close()
        kept.close()
        process.stdin.close()
        said = process.stderr.read()
    assert (answer.status, words) == (
        500,
        "what is shown must be readable, got: Too many open files",
    )
    assert said.count("no more files or connections") == len(said.splitlines()) == 1
    assert (
        1 <= faults <= 32 * (seconds + 2)
    )  # it tries again once a second, and not 2048 times then


@LINUX
def test_connections_fit_into_the_files_that_may_be_open(monkeypatch):
    import resource

    for files, connections in (
        (1024, 64),
        (256, 32),
        (64, 8),
        (16, 4),
        (resource.RLIM_INFINITY, 64),
    ):
        monkeypatch.setattr(resource, "getrlimit", lambda which, soft=files: (soft, soft))
        assert fit_to_process(Limits(header=1.5)) == Limits(connections, header=1.5)
    monkeypatch.setitem(sys.modules, "resource", None)  # a system that tells no limit
    assert fit_to_process(Limits(header=1.5)) == Limits(header=1.5)


def test_messages_of_the_server_are_few_and_the_others_are_counted(monkeypatch):
    now = [100.0]
    monkeypatch.setattr("flgpr.viewer.limits.time.monotonic", lambda: now[0])
    few = FewRecords(most=3, period=60.0)
    passed = []
    for moment in [0.0] * 1000 + [59.0, 61.0]:
        now[0] = 100.0 + moment
        record = logging.LogRecord(
            "uvicorn.error", logging.WARNING, "", 0, "bad request %d", (7,), None
        )
        if few.filter(record):
            passed.append(record.getMessage())
    assert passed == ["bad request 7"] * 3 + [
        "bad request 7 (998 messages before it were left out)"
    ]


def test_an_answer_that_takes_without_end_does_not_keep_the_server(serving, capfd):
    begun, told = threading.Event(), threading.Event()

    def without_end(*_):
        begun.set()
        told.wait(60)
        return Response()

    limits = replace(SHORT, ending=1)
    viewer = type("Endless", (Viewer,), {"limits": limits, "_session": without_end})([RUN])
    try:
        with serving(viewer), connect(viewer, request(viewer, path="data/session.json")):
            assert begun.wait(10)
        # It has ended: the thread that served it is waited for.
        assert viewer._socket.fileno() == -1
        assert not told.is_set()
    finally:
        told.set()
    [one] = capfd.readouterr().err.splitlines()
    assert "Cancel 1 running task" in one


def test_a_connection_that_is_accepted_while_the_server_ends_is_ended(serving):
    viewer = limited(PATIENT)
    with serving(viewer):
        assert page(viewer)[0] == 200
        viewer._server.config.is_ending = True
        with connect(viewer) as late:
            assert ends(late) == b""


def test_requests_that_are_none_do_not_fill_the_log(serving, capfd):
    with serving([RUN]) as viewer:
        for _ in range(100):
            with connect(viewer, b"\0\1\2 nonsense\r\n\r\n") as sender:
                assert ends(sender).startswith(b"HTTP/1.1 400")
        assert page(viewer)[0] == 200
    assert len(capfd.readouterr().err.splitlines()) <= 20
