"""Bad frames on the live socket: each is told once with its reason, and the next good one is taken."""

import json
import math
import socket
import struct
import threading
import time
import zlib

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from damage import FUZZ, damaged
from flgpr.live.events import EventFile
from flgpr.live.options import LiveOptions
from flgpr.live.senders import FrameStream
from flgpr.live.session import LiveRun
from flgpr.store import describe_for_live, encode_frame, encode_scan
from flgpr.store.scan_file import MAGIC, parse_description
from live_lane import make_lane_run, small_recipe

RUN = make_lane_run(scans=2)
DESCRIPTION = describe_for_live(RUN)
SIGNAL = np.asarray(RUN["signal"].values)
ODD = [
    0,
    -1,
    1e9,
    1e300,
    1e308,
    math.inf,
    math.nan,
    10**250,
    None,
    "x",
    [],
    {},
    True,
    [[1e308] * 3],
    "\ud800",
    [[[]]],
]


def run_frame(**change):
    return raw_frame("run", DESCRIPTION.as_json() | change)


def raw_frame(kind, header, payload=b""):
    """A frame with the right checksum whatever its header holds."""
    text = json.dumps({"kind": kind, **header}).encode()
    body = struct.pack("<8sIQ", MAGIC, len(text), len(payload)) + text + payload
    return body + struct.pack("<I", zlib.crc32(body))


def scan_frame(number, **change):
    pose = [0.0, 0.4 * number, 2.0, 0.0, 0.0, 0.0]
    return raw_frame(
        "scan",
        {"scan": number, "time": None, "pose": pose} | change,
        SIGNAL[0].astype("<c8").tobytes(),
    )


@pytest.fixture(scope="module")
def live(tmp_path_factory):
    """A live run that knows its run, without threads."""
    folder = tmp_path_factory.mktemp("fuzz")
    (folder / "recipe.toml").write_text(small_recipe())
    run = LiveRun(LiveOptions(folder / "recipe.toml", folder / "out", socket=folder / "s"))
    (folder / "out").mkdir()
    with EventFile(folder / "out" / "live.jsonl", fresh=True, burst=10**9) as events:
        (arrival,) = FrameStream().take(run_frame(), True)
        run._take_description(arrival, events)
        assert run._intake is not None
        yield run, events, folder / "out" / "live.jsonl"


def given_to(live, data, over=True, stream=None):
    """Hand bytes over as the socket does; the events they make and the kinds of what was cut out of them."""
    run, events, path = live
    before = path.stat().st_size
    kinds = []
    for arrival in (stream or FrameStream()).take(data, over):
        kinds.append(
            "bad" if arrival.kind == "frame" and arrival.value is not None else arrival.kind
        )
        if arrival.kind == "run":
            run._take_description(arrival, events)
        elif arrival.kind == "frame":
            run._take_frame(arrival, events)
    with path.open() as file:
        file.seek(before)
        return [json.loads(line) for line in file], kinds


def problems(lines):
    return [line["words"] for line in lines if line["event"] == "problem"]


@FUZZ
@given(st.data())
def test_damaged_frames_are_told_and_the_next_is_taken(live, data):
    which = data.draw(
        st.sampled_from(
            [run_frame(), scan_frame(0), scan_frame(1, pose=None), encode_frame("end", {})]
        )
    )
    bad = damaged(which, data.draw)
    lines, kinds = given_to(live, bad + scan_frame(3))
    assert "frame" in kinds
    assert len(problems(lines)) >= kinds.count("bad")
    assert all(problems(lines))


@FUZZ
@given(st.integers(0, 10**9), st.integers(0, 7))
def test_a_flipped_bit_is_one_problem(live, where, bit):
    good = scan_frame(5)
    raw = bytearray(good)
    raw[where % len(raw)] ^= 1 << bit
    lines, kinds = given_to(live, scan_frame(4) + bytes(raw) + scan_frame(6))
    assert kinds == ["frame", "bad", "frame"]
    assert [words.startswith("frame") for words in problems(lines)].count(
        True
    ) == 1  # no word on the others' format


@FUZZ
@given(
    st.sampled_from(["scan", "time", "pose", "run", "kind"]),
    st.sampled_from(ODD),
    st.integers(0, 5),
)
def test_odd_headers_of_scans_are_survived(live, entry, value, at):
    pose = [0.0, 1.0, 2.0, 0.0, 0.0, 0.0]
    pose[at] = value
    for header in ({entry: value}, {"pose": pose}):
        lines, kinds = given_to(live, scan_frame(7, **header))
        assert len(kinds) == 1
        # A pose that is filled in is told by itself, whatever else is wrong with the scan.
        of_pose = [words for words in problems(lines) if "it was filled in" in words]
        assert len(of_pose) <= 1
        assert len(problems(lines)) - len(of_pose) <= 1


@FUZZ
@given(st.sampled_from(sorted(DESCRIPTION.as_json())), st.sampled_from(ODD), st.booleans())
def test_odd_descriptions_are_refused_with_a_reason(live, entry, value, inside):
    change = {entry: [value] * 3 if inside else value}
    lines, kinds = given_to(live, run_frame(**change))
    assert kinds in (["run"], ["bad"])
    assert len(problems(lines)) == 1 or run_id_of(change) == DESCRIPTION.run_id


def run_id_of(change):
    return parse_description(json.loads(json.dumps(DESCRIPTION.as_json() | change))).run_id


def test_a_first_description_that_cannot_be_used_is_told(tmp_path):
    """Before a run is known: each gives one problem, and a good one is then taken."""
    (tmp_path / "recipe.toml").write_text(small_recipe())
    run = LiveRun(LiveOptions(tmp_path / "recipe.toml", tmp_path, socket=tmp_path / "s"))
    one = DESCRIPTION.as_json()
    wrong = [
        {"tx_m": [[1e308, 0, 0], *one["tx_m"][1:]]},
        {"rx_m": [[0, -1e308, 0], *one["rx_m"][1:]]},
        {"rx_m": [[0, math.nan, 0], *one["rx_m"][1:]]},
        {"frequency_hz": [1e300, 2e300, 3e300]},
        {"frequency_hz": one["frequency_hz"][:1]},
        {
            "frequency_hz": list(range(10**6, 10**6 + 40_000)),
            "tx_m": one["tx_m"] * 500,
            "rx_m": one["rx_m"] * 500,
        },
        {"polarization": ["VH"]},
        {"tx_m": [[10**250, 0, 0]]},
        {"tx_m": [], "rx_m": []},
    ]
    with EventFile(tmp_path / "live.jsonl", fresh=True, burst=10**9) as events:
        live = run, events, tmp_path / "live.jsonl"
        for change in wrong:
            lines, kinds = given_to(live, run_frame(**change))
            assert (kinds, len(problems(lines))) == (["run"], 1), change
        lines, kinds = given_to(live, b"nonsense" * 4)
        assert "must begin with" in problems(lines)[0]
        assert run._intake is None
        assert given_to(live, run_frame()) == ([], ["run"])
        assert run._intake is not None


@pytest.mark.slow("many bad frames")
def test_the_socket_answers_every_bad_frame_on_one_connection(tmp_path):
    (tmp_path / "recipe.toml").write_text(small_recipe())
    run = LiveRun(LiveOptions(tmp_path / "recipe.toml", tmp_path / "out", socket=tmp_path / "s"))
    thread = threading.Thread(target=run.run)
    thread.start()
    path = tmp_path / "out" / "live.jsonl"

    def told():
        lines = (
            [json.loads(line) for line in path.read_text().splitlines()] if path.is_file() else []
        )
        return [line["words"] for line in lines if line["event"] == "problem"]

    def wait(condition):
        for _ in range(3000):
            if condition():
                return
            time.sleep(0.02)
        raise AssertionError(told())

    wait((tmp_path / "s").is_socket)
    good = scan_frame(0)
    long = bytearray(good)
    long[12] ^= 64  # states more bytes than come
    bad = [
        b"GET / HTTP/1.1\r\n\r\n",
        good[:9],
        good[:-1],
        bytes(long),
        good[:-1] + b"\0",
        MAGIC + b"\xff" * 12,
    ]
    words = ["begin with", "at least", "must have", "must have", "checksum", "which no scan has"]
    with socket.socket(socket.AF_UNIX) as sender:
        sender.connect(str(tmp_path / "s"))
        for number, data in enumerate(bad, 1):
            sender.sendall(data)
            wait(lambda n=number: len(told()) >= n)
        sender.sendall(run_frame() + encode_scan(0, SIGNAL[0], np.zeros(6)))
        wait(lambda: '"event":"scan"' in path.read_text())
        sender.sendall(encode_frame("end", {}))
        thread.join(60)
    assert not thread.is_alive()
    assert [one in said for one, said in zip(words, told(), strict=True)] == [True] * len(bad)
