"""The sample senders send what flgpr sends, the one in C++ the same bytes, and raise its alarms."""

import json
import shutil
import socket
import subprocess
import sys
import threading
import time
from pathlib import Path

import numpy as np
import pytest

from flgpr.live.feeding import feed
from flgpr.live.options import LiveOptions
from flgpr.live.session import LiveRun
from flgpr.store import decode_frame, describe_for_live, save_run
from flgpr.store.scan_file import frame_size
from live_lane import make_lane_run, small_recipe

pytestmark = pytest.mark.slow("compiles senders and runs them in processes of their own")

SENDERS = Path(__file__).parents[2] / "examples" / "senders"
SCANS = 8
RUN = make_lane_run(scans=SCANS)
COMPILER = shutil.which("c++") or shutil.which("g++") or shutil.which("clang++")
LANGUAGES = [
    "python",
    pytest.param("c++", marks=pytest.mark.skipif(COMPILER is None, reason="no C++ compiler")),
]


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """The files that a radar's program has: its description, its samples and its poses."""
    home = tmp_path_factory.mktemp("array")
    description = json.dumps(describe_for_live(RUN).as_json(), indent=1)
    (home / "run.json").write_text(description + "\n")
    np.save(home / "scans.npy", RUN["signal"].values.astype(np.complex64))
    lines = ["time,x,y,z,heading,pitch,roll"]
    for moment, pose in zip(RUN["time"].values, RUN["pose"].values, strict=True):
        lines.append(",".join(repr(float(value)) for value in (moment, *pose)))
    (home / "poses.csv").write_text("\n".join(lines) + "\n")
    return home


@pytest.fixture(scope="module")
def programs(tmp_path_factory):
    """The command of each sender; that in C++ is built without a warning."""
    commands = {"python": [sys.executable, str(SENDERS / "send.py")]}
    if COMPILER is not None:
        program = tmp_path_factory.mktemp("built") / "send"
        source = str(SENDERS / "send.cpp")
        strict = ["-std=c++17", "-Wall", "-Wextra", "-Wpedantic", "-Werror"]
        subprocess.run([COMPILER, *strict, "-o", str(program), source], check=True, timeout=300)
        commands["c++"] = [str(program)]
    return commands


def send(command, home, address, *rate, poses="poses.csv"):
    words = [*command, *(str(home / name) for name in ("run.json", "scans.npy", poses))]
    return subprocess.run(
        [*words, address, *rate], capture_output=True, text=True, timeout=300, check=False
    )


def received(command, home, poses="poses.csv"):
    """Return all bytes that a sender sends."""
    data = bytearray()
    with socket.create_server(("127.0.0.1", 0)) as server:
        address = f"127.0.0.1:{server.getsockname()[1]}"

        def take():
            connection, _ = server.accept()
            with connection:
                while piece := connection.recv(2**20):
                    data.extend(piece)

        thread = threading.Thread(target=take)
        thread.start()
        done = send(command, home, address, poses=poses)
        thread.join(60)
    assert done.returncode == 0, done.stderr
    return bytes(data), done.stdout


def frames(data):
    while data:
        size = frame_size(data)
        yield decode_frame(data[:size])
        data = data[size:]


@pytest.mark.parametrize("language", LANGUAGES)
def test_a_sender_sends_the_frames_of_the_format(files, programs, language):
    data, words = received(programs[language], files)
    assert words == f"sent {SCANS} scans\n"
    first, *scans, last = frames(data)
    description = {name: value for name, value in first.header.items() if name != "kind"}
    assert (first.kind, last.kind) == ("run", "end")
    assert description == describe_for_live(RUN).as_json()
    assert len(scans) == SCANS
    for number, scan in enumerate(scans):
        assert scan.header["scan"] == number
        assert scan.header["time"] == RUN["time"].values[number]
        assert scan.header["pose"] == RUN["pose"].values[number].tolist()
        samples = RUN["signal"].values[number].astype("<c8").tobytes()
        assert scan.payload == samples


@pytest.mark.skipif(COMPILER is None, reason="no C++ compiler")
def test_both_senders_send_the_same_bytes(files, programs):
    awkward = ["time,x,y,z,heading,pitch,roll", ",0.1,1e-7,-0.0,1e22,0.3,2", "1,,,,,,"]
    awkward += ["5e-324,1,2,3,nan,5,6", "0.30000000000000004,1,2,3,4,5,123456789012345678"]
    awkward += ["7,1,2,3,4,5,6"] * (SCANS - 4)
    (files / "awkward.csv").write_text("\r\n".join(awkward) + "\r\n")
    for poses in ("poses.csv", "awkward.csv"):
        data, _ = received(programs["c++"], files, poses)
        assert data == received(programs["python"], files, poses)[0]
    headers = [frame.header for frame in frames(data)][1:-1]
    assert [header["pose"] is None for header in headers[:4]] == [False, True, True, False]
    assert headers[0]["time"] is None
    assert headers[0]["pose"] == [0.1, 1e-7, -0.0, 1e22, 0.3, 2]


@pytest.fixture(scope="module")
def expected(files):
    """Alarms of the same scans from a folder."""
    save_run(RUN, files / "run.zarr")
    (files / "recipe.toml").write_text(small_recipe())
    feed(files / "run.zarr", files / "incoming", float("inf"))
    options = LiveOptions(files / "recipe.toml", files / "folder", files / "incoming")
    report = LiveRun(options).run()
    assert report.alarms > 0
    return (files / "folder" / "alarms.csv").read_bytes(), report.counts


@pytest.mark.parametrize("language", LANGUAGES)
def test_a_live_run_raises_the_alarms_of_these_scans(files, programs, expected, language, tmp_path):
    run = LiveRun(LiveOptions(files / "recipe.toml", tmp_path / "out", tcp="0"))
    reports = []
    thread = threading.Thread(target=lambda: reports.append(run.run()))
    thread.start()
    last = time.monotonic() + 60
    while run.listens_on is None:
        assert time.monotonic() < last
        time.sleep(0.01)
    done = send(programs[language], files, str(run.listens_on), "1000")
    thread.join(300)
    assert done.returncode == 0, done.stderr
    table, counts = expected
    assert reports[0].counts == counts
    assert (tmp_path / "out" / "alarms.csv").read_bytes() == table


@pytest.mark.parametrize("language", LANGUAGES)
def test_what_cannot_be_sent_is_said(files, programs, language, tmp_path):
    for name in ("run.json", "scans.npy", "poses.csv"):
        shutil.copy(files / name, tmp_path)
    with socket.create_server(("127.0.0.1", 0)) as server:
        address = f"127.0.0.1:{server.getsockname()[1]}"
        np.save(tmp_path / "scans.npy", np.zeros((SCANS, 2), np.complex128))
        done = send(programs[language], tmp_path, address)
        assert done.returncode != 0
        assert "samples must be complex64" in done.stderr
    assert send(programs[language], files, address).returncode != 0  # nobody listens
    usage = subprocess.run(programs[language], capture_output=True, text=True, check=False)
    assert usage.returncode != 0
    assert "usage:" in usage.stderr


def test_the_sender_in_python_knows_a_secret(files, programs, tmp_path, monkeypatch):
    (tmp_path / "recipe.toml").write_text(small_recipe())
    monkeypatch.setenv("FLGPR_LIVE_SECRET", "forty two sheep of the moon")
    run = LiveRun(LiveOptions(tmp_path / "recipe.toml", tmp_path / "out", tcp="0"))
    reports = []
    thread = threading.Thread(target=lambda: reports.append(run.run()))
    thread.start()
    while run.listens_on is None:
        time.sleep(0.01)
    ran = send(programs["python"], files, str(run.listens_on))
    assert ran.returncode == 0, ran.stderr
    thread.join(60)
    assert reports[0].counts["received"] == SCANS
    assert reports[0].counts["senders_ended"] == 0
