"""A live run from end to end: folder and socket, faults, restarts, events."""

import json
import multiprocessing
import os
import shutil
import signal
import socket
import subprocess
import sys
import threading
import time

import numpy as np
import pandas as pd
import pytest
from typer.testing import CliRunner

from flgpr.commands.app import app
from flgpr.live.feeding import feed
from flgpr.live.options import LiveOptions
from flgpr.live.senders import SocketWatch
from flgpr.live.session import LiveRun
from flgpr.live.source import FolderWatch, Inbox
from flgpr.live.state import read_snapshot
from flgpr.method.model import Model, array_of, save_model
from flgpr.model.vehicle import Vehicle
from flgpr.scoring import roc
from flgpr.store import (
    decode_frame,
    describe_for_live,
    encode_frame,
    encode_scan,
    read_table,
    save_run,
)
from flgpr.store.scan_file import scan_name
from live_lane import SCANS, make_lane_run, small_recipe

FAST = float("inf")


@pytest.fixture(scope="module")
def home(tmp_path_factory):
    folder = tmp_path_factory.mktemp("live")
    save_run(make_lane_run(), folder / "run.zarr")
    (folder / "recipe.toml").write_text(small_recipe())
    feed(folder / "run.zarr", folder / "incoming", FAST)
    return folder


def options(home, output, incoming=None, **more):
    return LiveOptions(home / "recipe.toml", output, incoming or home / "incoming", **more)


def events(folder, kind=None):
    lines = [json.loads(line) for line in (folder / "live.jsonl").read_text().splitlines()]
    return [line for line in lines if kind in (None, line["event"])]


def without_times(lines):
    return [
        {k: v for k, v in line.items() if k not in ("arrived", "latency_ms", "latency", "margin_m")}
        for line in lines
    ]


@pytest.fixture(scope="module")
def whole(home):
    """An undisturbed live run."""
    told = []
    report = LiveRun(
        options(home, home / "whole", vehicle=Vehicle(speed=15 / 3.6, front=0.4)), told.append
    ).run()
    return home / "whole", report, told


def test_a_run_is_played_to_its_end(whole, home):
    folder, report, told = whole
    assert report.counts == {
        **dict.fromkeys(report.counts, 0),
        "received": SCANS,
        "taken": SCANS - 4,
        "warm_up": 4,
    }
    assert report.latency_ms["scans"] == SCANS - 4
    lines = events(folder)
    assert [lines[0]["event"], lines[-1]["event"]] == ["start", "end"]
    assert lines[0]["grid"] == {
        "x": -1.2,
        "y": pytest.approx(1.5, abs=1e-6),
        "nx": 25,
        "dx": 0.1,
        "dy": 0.1,
    }
    assert [line["scan"] for line in events(folder, "scan")] == list(range(SCANS))
    assert [json.loads(line) for line in told] == events(folder, "alarm")
    table = read_table(folder / "alarms.csv", "alarms")
    assert len(table) == report.alarms > 20
    assert json.loads((folder / "live.json").read_text())["counts"] == report.counts


def test_another_speed_after_a_restart_is_told_and_states_a_start_anew(home, tmp_path):
    incoming = tmp_path / "incoming"
    last = sorted((home / "incoming").glob("*.scan"))[-4:]
    shutil.copytree(home / "incoming", incoming, ignore=lambda *_: [one.name for one in last])
    out = tmp_path / "out"
    LiveRun(options(home, out, incoming=incoming, vehicle=Vehicle(speed=2.0))).run()
    for one in last[:2]:
        shutil.copy(one, incoming)
    LiveRun(options(home, out, incoming=incoming, vehicle=Vehicle(speed=2.0))).run()
    told = [line["name"] for line in events(out, "problem")]
    assert told == ["end.json"] * 2
    assert len(events(out, "start")) == 1
    for one in last[2:]:
        shutil.copy(one, incoming)
    LiveRun(options(home, out, incoming=incoming, vehicle=Vehicle(speed=9.0))).run()
    [other] = [line for line in events(out, "problem") if line["name"] == "vehicle"]
    assert other["words"].startswith("it goes on with other options of the vehicle")
    assert [line["vehicle"]["speed"] for line in events(out, "start")] == [2.0, 9.0]


def test_scans_that_an_end_states_and_that_never_came_are_told(home, tmp_path):
    """The last ones were lost: no number between others is missing."""
    incoming = tmp_path / "incoming"
    shutil.copytree(home / "incoming", incoming)
    for name in sorted(incoming.glob("*.scan"))[-2:]:
        name.unlink()
    report = LiveRun(options(home, tmp_path / "out", incoming=incoming)).run()
    assert report.counts["missing"] == 0
    [told] = events(tmp_path / "out", "problem")
    assert told["name"] == "end.json"
    words = f"the sender states {SCANS} scans, {SCANS - 2} came: 2 missing"
    assert told["words"] == words
    for odd in ("", "[]", '{"scans": "many"}', '{"scans": true}', "{}"):
        (incoming / "end.json").write_text(odd)
        LiveRun(options(home, tmp_path / "odd", incoming=incoming, fresh=True)).run()
        assert events(tmp_path / "odd", "problem") == []


def test_alarm_lines_tell_place_confidence_and_what_is_left(whole, home):
    folder = whole[0]
    vehicle = Vehicle(speed=15 / 3.6, front=0.4)
    assert vehicle.stopping_distance == pytest.approx(15 / 3.6 * 1.5 + (15 / 3.6) ** 2 / 6)
    poses = {line["scan"]: line["pose"] for line in events(folder, "scan")}
    for line in events(folder, "alarm"):
        x, y, _, heading = poses[line["scan"]][:4]
        left = (line["x"] - x) * np.sin(heading) + (line["y"] - y) * np.cos(heading) - 0.4
        assert line["left_m"] == pytest.approx(left, abs=2e-3)
        margin = left - vehicle.speed * line["latency_ms"] / 1e3 - vehicle.stopping_distance
        assert line["margin_m"] == pytest.approx(margin, abs=5e-3)
        assert line["in_time"] == (line["margin_m"] >= 0)
    slow = Vehicle(speed=1.0, reaction=0.5, deceleration=3.0)
    assert slow.margin(3.0, 0.1) == pytest.approx(3.0 - 0.1 - 0.5 - 1 / 6)
    assert Vehicle().margin(3.0, 0.1) is None


def test_the_alarm_table_can_be_scored(whole):
    from live_lane import LANE, TARGETS

    truth = pd.DataFrame(TARGETS, columns=["x", "y"]).assign(kind="metal", depth=0.05)
    truth["target_id"] = [f"t{i}" for i in range(len(truth))]
    curve = roc(read_table(whole[0] / "alarms.csv", "alarms"), truth, LANE, halo=0.3)
    first = curve[curve["n_detected"] == len(TARGETS)].iloc[0]
    assert first["n_false"] <= 2


def frames(home):
    return [(home / "incoming" / scan_name(k)).read_bytes() for k in range(SCANS)]


def rewritten(frame, **change):
    one = decode_frame(frame)
    header = {k: v for k, v in one.header.items() if k != "kind"}
    return encode_frame("scan", header | change, one.payload)


def test_what_a_radar_gets_wrong_is_counted_and_survived(home, whole, tmp_path):
    """One folder with every fault; what is not at fault is found as ever."""
    incoming = tmp_path / "incoming"
    incoming.mkdir()
    (incoming / "run.json").write_bytes((home / "incoming" / "run.json").read_bytes())
    good = frames(home)
    sent = list(good)
    # out of order
    sent[12] = good[13]
    sent[13] = good[12]
    sent[16] = good[16][:5000] + b"\0" + good[16][5001:]  # corrupt
    hole = decode_frame(good[20])
    samples = np.frombuffer(hole.payload, "<c8").copy()
    samples[100] = np.nan
    header = {k: v for k, v in hole.header.items() if k != "kind"}
    sent[20] = encode_frame("scan", header, samples.tobytes())  # a missing sweep
    for k in (24, 25):
        sent[k] = rewritten(good[k], pose=None)  # poses that can be filled in
    for k in range(30, 35):
        sent[k] = rewritten(good[k], pose=[None] * 6)  # too many in a row
    sent.insert(28, good[27])  # twice
    sent.insert(36, good[5])  # late and twice: it had been taken
    sent.append(rewritten(good[-1], run="0123456789abcdef", scan=900))  # of another run
    sent[17] = None  # never comes
    for place, frame in enumerate(sent):
        if frame is not None:
            (incoming / f"{place:04d}.scan").write_bytes(frame)
    (incoming / "notes.txt").write_text("not a scan")
    (incoming / "0050.scan").symlink_to(home / "incoming" / scan_name(3))
    (incoming / "end.json").write_text("{}")
    report = LiveRun(options(home, tmp_path / "out", incoming)).run()
    counts = report.counts
    expected = {
        "corrupt": 3,
        "masked": 1,
        "duplicate": 2,
        "out_of_order": 1,
        "missing": 2,
        "refused": 0,
        "late": 0,
    }
    assert {name: counts[name] for name in expected} == expected
    assert counts["pose_filled"] + counts["pose_missing"] == 7
    assert counts["pose_missing"] == 2
    assert counts["received"] == len(sent)  # one never comes, and a link does
    problems = events(tmp_path / "out", "problem")
    health = [line["finding"] for line in problems if line.get("kind") == "health"]
    assert set(health) == {"no positions"}
    words = [line["words"] for line in problems if line.get("kind") != "health"]
    poses = [line for line in words if "pose must be six finite numbers" in line]
    # Those that are stated as unknown are no fault.
    assert [line.split(":")[0] for line in poses] == [f"scan {k}" for k in range(30, 35)]
    assert [line.endswith("the scan was left out") for line in poses].count(True) == 2
    checksum, another_run, link = [line for line in words if line not in poses]
    assert "checksum" in checksum
    assert "must be a regular file, got a symbolic link" in link
    assert "another run" in another_run
    usual, mine = (read_table(f / "alarms.csv", "alarms") for f in (whole[0], tmp_path / "out"))
    best = usual[usual["y"] > 10.5].head(4)  # before that three of the six scans of a mine are lost
    away = np.hypot(
        *(best[["x", "y"]].to_numpy()[:, None] - mine[["x", "y"]].to_numpy()).transpose(2, 0, 1)
    )
    assert (away.min(axis=1) < 0.25).all()


def test_late_scans_are_left_out(home, tmp_path):
    incoming = tmp_path / "incoming"
    incoming.mkdir()
    (incoming / "run.json").write_bytes((home / "incoming" / "run.json").read_bytes())
    good = frames(home)
    order = [*range(1, 25), 0, 25]
    for place, number in enumerate(order):
        (incoming / f"{place:04d}.scan").write_bytes(good[number])
    (incoming / "end.json").write_text("{}")
    report = LiveRun(options(home, tmp_path / "out", incoming)).run()
    assert (report.counts["late"], report.counts["missing"], report.counts["taken"]) == (1, 0, 21)


class Crash(Exception):
    pass


@pytest.mark.parametrize("after", [31, 90])
def test_a_run_that_was_killed_goes_on(home, whole, tmp_path, after):
    """Torn off between two events; the second process takes the snapshot and ends with the same files."""
    count = 0

    def tell(line):
        nonlocal count
        count += 1
        if count == after:
            raise Crash

    output = tmp_path / "out"
    vehicle = Vehicle(speed=15 / 3.6, front=0.4)
    with pytest.raises(Crash):
        LiveRun(options(home, output, vehicle=vehicle, snapshot=7), tell).run()
    for thread in threading.enumerate():
        if thread.name == "snapshot":
            thread.join()
    assert not (output / "alarms.csv").exists()
    with (output / "live.jsonl").open("a") as file:
        file.write('{"event":"al')  # the line that was being written
    report = LiveRun(options(home, output, vehicle=vehicle)).run()
    assert report.counts == whole[1].counts
    assert (output / "alarms.csv").read_bytes() == (whole[0] / "alarms.csv").read_bytes()
    lines = events(output)
    resumed = next(i for i, line in enumerate(lines) if line["event"] == "resume")
    first = lines[resumed + 1]["scan"]
    assert first == lines[resumed]["scan"] + 1
    mine = without_times(line for line in lines[resumed + 1 :])
    usual = without_times(events(whole[0]))
    assert mine == usual[-len(mine) :]


def run_command(words):
    """Run the command line in a process of its own, which takes functions of modules alone."""
    app(words)


@pytest.mark.slow("is killed, and begins again, several times")
def test_a_live_process_that_is_killed_again_and_again_ends_alike(home, whole, tmp_path):
    """SIGKILL after so many lines of the event file, three times, snapshots being written all along; one is whole."""
    incoming = tmp_path / "in"
    output = tmp_path / "out"
    feed(home / "run.zarr", incoming, FAST, count=SCANS - 3)  # it waits for the rest
    words = [
        "live",
        str(incoming),
        "--recipe",
        str(home / "recipe.toml"),
        "-o",
        str(output),
        "--snapshot",
        "3",
    ]
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload(["flgpr.jobs.preload"])
    for line in (12, 45, 70):
        process = context.Process(target=run_command, args=([*words, "--quiet"],), daemon=True)
        process.start()
        wait_for(lambda at=line, one=process: not one.is_alive() or lines_of(output) >= at)
        if line == 70:  # where the disk is slow, none may be there yet
            wait_for((output / "snapshot.bundle").exists)
        process.kill()
        process.join()
        assert process.exitcode == -signal.SIGKILL
        assert not (output / "alarms.csv").exists()
    feed(home / "run.zarr", incoming, FAST, first=SCANS - 3)
    report = LiveRun(options(home, output, incoming)).run()
    assert report.counts == whole[1].counts
    assert (output / "alarms.csv").read_bytes() == (whole[0] / "alarms.csv").read_bytes()
    assert len(events(output, "resume")) >= 1


@pytest.mark.parametrize(("width", "count"), [(9.0, 1), (None, 0)])
def test_a_model_of_another_array_is_told_once(home, tmp_path, width, count):
    array = array_of(make_lane_run())
    save_model(
        Model(), tmp_path / "model", {"array": array | ({"width_m": width} if width else {})}
    )
    LiveRun(options(home, tmp_path / "out", model=tmp_path / "model")).run()
    words = [event["words"] for event in events(tmp_path / "out", "problem")]
    assert sum("trained with another array" in one for one in words) == count


def test_files_that_were_taken_away_are_forgotten(home, whole, tmp_path):
    incoming = tmp_path / "in"
    output = tmp_path / "out"
    feed(home / "run.zarr", incoming, FAST, count=SCANS - 3)
    LiveRun(options(home, output, incoming, idle=0.5)).run()
    assert len(read_snapshot(output / "snapshot.bundle")[0]["names"]) == SCANS - 3
    for k in range(SCANS - 5):
        (incoming / scan_name(k)).unlink()
    feed(home / "run.zarr", incoming, FAST, first=SCANS - 3)
    report = LiveRun(options(home, output, incoming)).run()
    assert report.counts == whole[1].counts
    assert read_snapshot(output / "snapshot.bundle")[0]["names"] == [
        scan_name(k) for k in range(SCANS - 5, SCANS)
    ]
    assert (output / "alarms.csv").read_bytes() == (whole[0] / "alarms.csv").read_bytes()


def lines_of(output):
    file = output / "live.jsonl"
    return file.read_bytes().count(b"\n") if file.is_file() else 0


def test_going_on_needs_the_same_recipe_unless_fresh(home, whole, tmp_path):
    output = tmp_path / "out"
    vehicle = Vehicle(speed=15 / 3.6, front=0.4)
    shutil.copytree(whole[0], output)
    (tmp_path / "other.toml").write_text(small_recipe().replace("radius = 0.4", "radius = 0.5"))
    other = LiveOptions(tmp_path / "other.toml", output, home / "incoming", vehicle=vehicle)
    with pytest.raises(ValueError, match=r"another run, recipe, model or setting; `fresh`"):
        LiveRun(other).run()
    fresh = LiveOptions(
        tmp_path / "other.toml", output, home / "incoming", vehicle=vehicle, fresh=True
    )
    assert LiveRun(fresh).run().counts["taken"] == SCANS - 4
    assert events(output)[0]["event"] == "start"


def test_a_socket_gives_the_same_alarms(home, whole, tmp_path):
    path = tmp_path / "radar.sock"
    run = LiveRun(LiveOptions(home / "recipe.toml", tmp_path / "out", socket=path))
    found = []
    thread = threading.Thread(target=lambda: found.append(run.run()))
    thread.start()
    wait_for(path.is_socket)
    assert path.stat().st_mode & 0o077 == 0
    feed(home / "run.zarr", rate=FAST, socket_path=path)
    thread.join(60)
    assert found[0].counts == whole[1].counts
    assert (tmp_path / "out" / "alarms.csv").read_bytes() == (whole[0] / "alarms.csv").read_bytes()
    assert not path.exists()


def test_a_sender_goes_on_after_a_restart_without_describing_the_run_again(home, whole, tmp_path):
    path = tmp_path / "radar.sock"
    output = tmp_path / "out"
    good = frames(home)
    description = (home / "incoming" / "run.json").read_text()

    def play(*data):
        run = LiveRun(LiveOptions(home / "recipe.toml", output, socket=path))
        found = []
        thread = threading.Thread(target=lambda: found.append(run.run()))
        thread.start()
        wait_for(path.is_socket)
        with socket.socket(socket.AF_UNIX) as sender:
            sender.connect(str(path))
            sender.sendall(b"".join(data))
        thread.join(60)
        return found[0]

    end = encode_frame("end", {})
    wrong = encode_frame("run", {"format": "other"})
    play(good[0], wrong, encode_frame("run", json.loads(description)), *good[:20], end)
    words = [line["words"] for line in events(output, "problem")]
    assert ["before the description" in words[0], "format" in words[1]] == [True, True]
    other = json.loads(description) | {"title": "another"}
    report = play(encode_frame("run", other), *good[20:], end)
    assert report.counts == whole[1].counts
    assert "another run" in events(output, "problem")[-1]["words"]
    assert (output / "alarms.csv").read_bytes() == (whole[0] / "alarms.csv").read_bytes()


def wait_for(condition):
    for _ in range(6000):
        if condition():
            return
        time.sleep(0.02)
    raise AssertionError(condition)


def test_a_socket_survives_bad_senders(home, tmp_path):
    inbox = Inbox()
    path = tmp_path / "s.sock"
    watch = SocketWatch(path, inbox)
    watch.start()
    description = describe_for_live(make_lane_run(scans=1))
    frame = encode_scan(1, np.zeros(description.shape), np.zeros(6), 0.0)

    def send(data):
        with socket.socket(socket.AF_UNIX) as sender:
            sender.connect(str(path))
            sender.sendall(data)

    send(b"GET / HTTP/1.1\r\n\r\n  ")
    send(frame[:-1])  # torn off
    send(frame + encode_frame("run", description.as_json()) + encode_frame("end", {}))
    arrivals = [inbox.arrivals.get(timeout=10) for _ in range(5)]
    inbox.stop.set()
    watch.join(5)
    assert sorted(one.kind for one in arrivals) == ["end", "frame", "frame", "frame", "run"]
    assert [one.data for one in arrivals if len(one.data) == len(frame)] == [frame]
    (tmp_path / "file").write_text("mine")
    with pytest.raises(ValueError, match="where another file lies"):
        SocketWatch(tmp_path / "file", inbox)
    assert (tmp_path / "file").read_text() == "mine"


def test_a_file_that_is_still_written_is_waited_for(home, tmp_path):
    inbox = Inbox()
    frame = frames(home)[0]
    (tmp_path / "run.json").write_bytes((home / "incoming" / "run.json").read_bytes())
    (tmp_path / "a.scan").write_bytes(frame[:3000])
    watch = FolderWatch(tmp_path, inbox)
    watch.start()
    assert inbox.arrivals.get(timeout=10).kind == "run"
    time.sleep(0.1)
    assert inbox.arrivals.empty()
    with (tmp_path / "a.scan").open("ab") as file:
        file.write(frame[3000:])
    assert inbox.arrivals.get(timeout=10).data == frame
    (tmp_path / "b.scan").write_bytes(frame[:3000])  # taken away again
    time.sleep(0.1)
    (tmp_path / "b.scan").rename(tmp_path / "b.bad")
    (tmp_path / "b.scan").write_bytes(frame[:3000])  # never completed
    (tmp_path / "end.json").write_text("{}")
    assert [inbox.arrivals.get(timeout=10).name for _ in range(2)] == ["b.scan", "end.json"]
    inbox.stop.set()
    watch.join(5)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ([], "live needs a folder, a socket, a TCP address or a recording"),
        (["in", "--recipe", "nothing"], "recipe must be"),
        (["in", "--speed", "0"], "speed must lie"),
        (["in", "--speed", "15", "--deceleration", "0"], "deceleration: input should be"),
        (["in", "-o", "full"], "holds other files"),
        (["in", "--looks", "0"], "looks must be"),
        (["in", "--warm-up", "2"], "--warm-up"),
        (["in", "--span", "1"], "span must be"),
        (["in", "--model", "nothing"], "model"),
    ],
)
def test_bad_options_are_named(tmp_path, monkeypatch, options, words):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "mine.txt").write_text("x")
    done = CliRunner().invoke(app, ["live", *options])
    assert done.exit_code == 2
    assert words in done.output
    assert not (tmp_path / "live-result").exists()


@pytest.mark.slow("runs in processes of its own")
def test_the_command_line_ends_on_a_signal_and_keeps_what_it_has(home, tmp_path):
    """A process of its own, stopped by SIGTERM while it waits for more."""
    incoming = tmp_path / "in"
    feed(home / "run.zarr", incoming, FAST, count=12)
    command = [
        sys.executable,
        "-m",
        "flgpr",
        "live",
        str(incoming),
        "--recipe",
        str(home / "recipe.toml"),
    ]
    with subprocess.Popen(
        [*command, "-o", str(tmp_path / "out")], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
        env=os.environ | {"NUMBA_NUM_THREADS": "1"},
    ) as process:  # fmt: skip
        file = tmp_path / "out" / "live.jsonl"
        wait_for(
            lambda: (
                process.poll() is not None
                or (file.is_file() and '"scan":11,"pose"' in file.read_text())
            )
        )
        process.terminate()
        out, err = process.communicate(timeout=60)
    assert process.returncode == 0, err
    assert "12 frames that came" in err
    assert [json.loads(line)["event"] for line in out.splitlines()] == ["alarm"] * len(
        out.splitlines()
    )
    assert (tmp_path / "out" / "alarms.csv").is_file()
    assert (tmp_path / "out" / "snapshot.bundle").is_file()


def test_a_source_that_fails_ends_the_run_with_its_files(home, tmp_path, monkeypatch):
    """What was found is written before the error is told."""
    check = FolderWatch._check

    def check_until(self):
        came = check(self)
        if came:
            raise OSError(5, "Input/output error")
        return came

    monkeypatch.setattr(FolderWatch, "_check", check_until)
    run = LiveRun(LiveOptions(home / "recipe.toml", tmp_path / "out", home / "incoming"))
    with pytest.raises(ValueError, match="Input/output error"):
        run.run()
    report = json.loads((tmp_path / "out" / "live.json").read_text())
    assert report["counts"]["received"] > 0
    assert (tmp_path / "out" / "alarms.csv").is_file()
    assert (
        (tmp_path / "out" / "live.jsonl").read_text().splitlines()[-1].startswith('{"event":"end"')
    )


def test_a_lane_that_no_scan_sees_is_no_clear_road(home, tmp_path, caplog):
    caplog.set_level("INFO", "flgpr.notes")
    (tmp_path / "far.toml").write_text("x_min = -1\nx_max = 1\ny_min = 200\ny_max = 220\n")
    LiveRun(options(home, tmp_path / "out", lane=tmp_path / "far.toml")).run()
    unseen = "no scan saw the lane, y 200 to 220 m: nothing is said of it"
    assert unseen in [line.get("words") for line in events(tmp_path / "out", "problem")]
    assert unseen in caplog.text


def test_a_lane_beside_the_run_view_is_refused(home, tmp_path):
    (tmp_path / "aside.toml").write_text("x_min = 40\nx_max = 42\ny_min = 0\ny_max = 20\n")
    with pytest.raises(
        ValueError, match=r"lane must reach into the run-view, x .* got x 40 to 42 m"
    ):
        LiveRun(options(home, tmp_path / "out", lane=tmp_path / "aside.toml")).run()
