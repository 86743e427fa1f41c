"""Recordings of live runs and results, opened by the library of MCAP and by flgpr itself."""

import base64
import json
from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader
from typer.testing import CliRunner

from exchange.test_exporting import written
from flgpr.commands.app import app
from flgpr.commands.export import export
from flgpr.commands.exports import Wish, write_export
from flgpr.commands.live import live
from flgpr.live.feeding import feed
from flgpr.store import read_table, save_run
from flgpr_exchange.bags.foxglove import SCHEMAS
from flgpr_exchange.bags.recording import Recording
from flgpr_exchange.bags.writer import mcap_file
from flgpr_exchange.commands.recording_export import TOPICS, LiveRecorder
from foxglove_schemas import faults
from live_lane import LANE, make_lane_run, small_recipe

TIED = {"longitude": 11.0, "latitude": 48.0, "azimuth": 30.0}
SCANS = 14
RUN = make_lane_run(scans=SCANS).assign_attrs(georeference=TIED)


@pytest.fixture(scope="module")
def driven(tmp_path_factory):
    """The folder of a live run with its recording."""
    home = tmp_path_factory.mktemp("driven")
    save_run(RUN, home / "run.zarr")
    feed(home / "run.zarr", home / "incoming", float("inf"))
    (home / "recipe.toml").write_text(small_recipe())
    lane = "".join(f"{name} = {value}\n" for name, value in vars(LANE).items())
    (home / "lane.toml").write_text(lane)
    live(
        home / "incoming",
        str(home / "recipe.toml"),
        output=home / "out",
        lane=home / "lane.toml",
        mcap=True,
    )
    return home / "out"


def read(path):
    """Return the messages of every topic, each checked against the schema in the file."""
    topics = {}
    last = 0
    with path.open("rb") as file:
        for schema, channel, message in make_reader(file, validate_crcs=True).iter_messages():
            assert TOPICS[channel.topic] == schema.name
            assert json.loads(schema.data) == SCHEMAS[schema.name]
            content = json.loads(message.data)
            assert not list(faults(content, json.loads(schema.data)))
            assert message.log_time >= last
            last = message.log_time
            topics.setdefault(channel.topic, []).append((message.log_time, content))
    return topics


def events(folder, kind):
    lines = [json.loads(line) for line in (folder / "live.jsonl").read_text().splitlines()]
    return [line for line in lines if line["event"] == kind]


def levels(grid):
    data = np.frombuffer(base64.b64decode(grid["data"]), np.uint8)
    cells = data.reshape(-1, grid["column_count"], grid["cell_stride"])
    return np.ascontiguousarray(cells[..., :4]).view("<f4")[..., 0]


def test_every_scan_has_its_pose(driven):
    topics = read(driven / "live.mcap")
    assert set(topics) == set(TOPICS)
    poses = [message for _, message in topics["/flgpr/pose"]]
    scans = events(driven, "scan")
    assert len(poses) == len(scans) == SCANS
    for message, event in zip(poses, scans, strict=True):
        place = message["pose"]["position"]
        assert [place["x"], place["y"], place["z"]] == event["pose"][:3]
    times = [time / 1e9 for time, _ in topics["/flgpr/transform"]]
    np.testing.assert_allclose(times, [event["arrived"] for event in scans], atol=1e-3)


def test_the_run_view_of_a_scan_and_of_the_lane_are_those_of_the_events(driven):
    topics = read(driven / "live.mcap")
    views = events(driven, "view")
    lattice = events(driven, "start")[0]["grid"]
    assert len(topics["/flgpr/run_view"]) == len(views)
    newest = {}
    for (_, grid), event in zip(topics["/flgpr/run_view"], views, strict=True):
        halves = np.frombuffer(base64.b64decode(event["halves"]), "<f2").astype(np.float32)
        rows = halves.reshape(event["rows"], -1)
        np.testing.assert_array_equal(levels(grid), rows)
        corner = grid["pose"]["position"]
        assert corner["x"] == pytest.approx(lattice["x"] - lattice["dx"] / 2)
        first_row = lattice["y"] + (event["row"] - 0.5) * lattice["dy"]
        assert corner["y"] == pytest.approx(first_row)
        for number, row in enumerate(rows):
            newest[event["row"] + number] = row
    [(_, whole)] = topics["/flgpr/run_view_of_lane"]
    for number, row in enumerate(levels(whole), min(newest)):
        expected = newest.get(number, np.full(row.size, np.nan))
        np.testing.assert_array_equal(row, expected)


def test_alarms_that_stand_at_the_end_are_those_of_the_table(driven):
    topics = read(driven / "live.mcap")
    standing = {}
    for _, scene in topics["/flgpr/alarms"]:
        for deletion in scene["deletions"]:
            standing.pop(deletion["id"], None)
        for entity in scene["entities"]:
            standing[entity["id"]] = entity["spheres"][0]["pose"]["position"]
    table = read_table(driven / "alarms.csv", "alarms")
    assert set(standing) == set(table["alarm_id"])
    for row in table.itertuples():
        place = standing[row.alarm_id]
        assert (place["x"], place["y"]) == pytest.approx((row.x, row.y), abs=1e-4)
    last = json.loads(topics["/flgpr/map"][-1][1]["geojson"])
    assert {feature["properties"]["alarm_id"] for feature in last["features"]} == set(standing)
    assert "not hazard areas" in last["statement"]
    by_name = {event["alarm_id"]: event for event in events(driven, "alarm")}
    for feature in last["features"]:
        event = by_name[feature["properties"]["alarm_id"]]
        assert feature["geometry"]["coordinates"] == [event["longitude"], event["latitude"]]


def test_flgpr_reads_its_own_recording(driven):
    recording = Recording(driven / "live.mcap", 2**24)
    positions = recording.read("/flgpr/pose/pose.position")
    np.testing.assert_allclose(positions, RUN["pose"].values[:, :3], atol=1e-4)


def test_the_same_events_give_the_same_bytes_and_another_file_stays(driven, tmp_path):
    words = ["export", str(driven), "--to", "mcap", "-o", str(tmp_path / "again.mcap")]
    done = CliRunner().invoke(app, words)
    assert done.exit_code == 0, done.output
    assert (tmp_path / "again.mcap").read_bytes() == (driven / "live.mcap").read_bytes()
    assert CliRunner().invoke(app, words).exit_code == 0
    (tmp_path / "again.mcap").write_bytes(b"mine")
    with pytest.raises(FileExistsError):
        export(driven, tmp_path / "again.mcap", "mcap")
    assert (tmp_path / "again.mcap").read_bytes() == b"mine"
    assert [path.name for path in tmp_path.iterdir()] == ["again.mcap"]
    write_export(Wish(driven, tmp_path / "again.mcap", "mcap", replace=True))
    assert (tmp_path / "again.mcap").read_bytes() == (driven / "live.mcap").read_bytes()


def test_a_live_run_goes_on_in_a_folder_with_a_recording(driven):
    """The recording is a file of the live run, and is made anew."""
    home = driven.parent
    before = (driven / "live.mcap").read_bytes()
    (driven / ".partial-live.mcap").mkdir()  # of a process that was killed
    report = live(
        home / "incoming",
        str(home / "recipe.toml"),
        output=driven,
        lane=home / "lane.toml",
        mcap=True,
    )
    assert report.alarms > 0
    assert (driven / "live.mcap").read_bytes() == before
    assert not (driven / ".partial-live.mcap").exists()


@pytest.mark.parametrize(
    "line",
    [
        b"no JSON",
        b"[1]",
        b'{"event": ["start"]}',
        b'{"event": "start", "grid": null}',
        b'{"event": "start", "grid": {"x": 0, "y": 0, "dx": 1, "dy": 1, "nx": 1e300}}',
        b'{"event": "start", "grid": {"x": NaN, "y": 0, "dx": 1, "dy": 1, "nx": 2}}',
        b'{"event": "scan", "arrived": 1e300, "pose": []}',
        b'{"event": "scan", "arrived": "now", "pose": []}',
        b'{"event": "scan", "arrived": 1.0, "pose": "x"}',
        b'{"event": "view", "row": 0, "rows": 1, "median_db": 0, "halves": "AAA"}',
        b'{"event": "view", "row": 1e300, "rows": 1, "median_db": 0, "halves": "AAAAAAAA"}',
        b'{"event": "view", "row": 0, "rows": 7, "median_db": 0, "halves": "AAAAAAAA"}',
        b'{"event": "view", "row": 0, "rows": 1, "median_db": NaN, "halves": "AAAAAAAA"}',
        b'{"event": "alarm", "alarm_id": 3, "state": "new", "x": 0, "y": 0, "confidence": 1}',
        b'{"event": "alarm", "alarm_id": "a", "state": "new", "x": NaN, "y": 0, "confidence": 1}',
        b'{"event": "alarm", "alarm_id": "a", "state": "new", "x": 0, "y": 0}',
        b'{"event": "alarm", "alarm_id": "a", "state": {}, "x": 0, "y": 0, "confidence": 1}',
    ],
)
def test_damaged_lines_are_counted_and_the_rest_is_written(tmp_path, line):
    good = b'{"event":"scan","scan":0,"arrived":5.5,"pose":[0,1,2,0,0,0]}\n'
    start = b'{"event":"start","grid":{"x":0.0,"y":0.0,"dx":0.1,"dy":0.1,"nx":3}}\n'
    with mcap_file(tmp_path / "a.mcap", TOPICS) as writer:
        recorder = LiveRecorder(writer)
        for each in (start, good, line, b"\n", b'{"event": "counts"}', good):
            recorder.take_line(each)
        recorder.finish()
    assert recorder.left_out == 1
    topics = read(tmp_path / "a.mcap")
    assert [time for time, _ in topics["/flgpr/pose"]] == [5_500_000_000] * 2


def test_a_run_view_too_large_is_left_out_and_said(tmp_path, caplog):
    start = b'{"event":"start","grid":{"x":0.0,"y":0.0,"dx":0.1,"dy":0.1,"nx":3}}'
    view = b'{"event":"view","row":%d,"rows":1,"median_db":0,"halves":"AAAAAAAA"}'
    with mcap_file(tmp_path / "a.mcap", TOPICS) as writer, caplog.at_level("INFO", "flgpr.notes"):
        recorder = LiveRecorder(writer)
        for line in (start, view % 0, view % 2_000_000_000):
            recorder.take_line(line)
        recorder.finish()
    assert recorder.left_out == 0
    assert "only that of each scan is in the recording" in caplog.messages[0]
    assert set(read(tmp_path / "a.mcap")) == {"/flgpr/run_view"}


@pytest.fixture(scope="module")
def result(tmp_path_factory):
    return written(tmp_path_factory.mktemp("result") / "demo")


def test_a_result_is_recorded_with_its_poses_one_second_apart(result, tmp_path):
    time = "2026-11-21T10:00:00Z"
    export(result, tmp_path / "a.mcap", "mcap", time=time)
    topics = read(tmp_path / "a.mcap")
    assert set(topics) == set(TOPICS) - {"/flgpr/run_view", "/flgpr/map"}
    begin = 1_795_255_200 * 10**9  # date -u -d 2026-11-21T10:00:00Z +%s
    poses = json.loads((result / "manifest.json").read_text())["run"]["pose"]
    assert len(topics["/flgpr/pose"]) == len(poses) > 2
    assert [moment for moment, _ in topics["/flgpr/pose"][:2]] == [begin, begin + 10**9]
    [(moment, scene)] = topics["/flgpr/alarms"]
    assert moment == begin
    assert [entity["id"] for entity in scene["entities"]] == ["a", "b", "c"]
    [(_, grid)] = topics["/flgpr/run_view_of_lane"]
    values = np.random.default_rng(0).random((31, 31), np.float32)
    np.testing.assert_allclose(levels(grid), 20 * np.log10(values), atol=0.04)
    assert grid["pose"]["position"]["y"] == pytest.approx(1.95)
    export(result, tmp_path / "b.mcap", "mcap", time=time)
    assert (tmp_path / "a.mcap").read_bytes() == (tmp_path / "b.mcap").read_bytes()


def test_a_result_that_is_anchored_has_a_map(result, anchor, tmp_path):
    export(result, tmp_path / "a.mcap", "mcap", anchor=anchor)
    export(result, tmp_path / "a.geojson", "geojson", anchor=anchor)
    points = json.loads((tmp_path / "a.geojson").read_text())["features"]
    [(_, message)] = read(tmp_path / "a.mcap")["/flgpr/map"]
    shown = json.loads(message["geojson"])["features"]
    for point, other in zip(points, shown, strict=True):
        expected = point["geometry"]["coordinates"][:2]
        assert other["geometry"]["coordinates"] == pytest.approx(expected, abs=1e-7)


@pytest.mark.parametrize("time", ["yesterday", "2026-11-21T10:00:00", "1960-01-01T00:00:00Z"])
def test_a_time_that_is_none_is_refused(result, tmp_path, time):
    with pytest.raises(ValueError, match="time must be ISO 8601 with a time zone, from 1970 on"):
        export(result, tmp_path / "a.mcap", "mcap", time=time)
    assert not list(tmp_path.iterdir())


def test_options_of_a_result_are_refused_for_a_live_run(driven, tmp_path):
    with pytest.raises(ValueError, match="anchor, time and detection go with a result"):
        export(driven, tmp_path / "a.mcap", "mcap", time="2026-11-21T10:00:00Z")


def test_that_the_library_is_missing_is_said_before_the_drive(monkeypatch, tmp_path):
    def missing(name):
        raise ImportError(f"No module named {name!r}")

    monkeypatch.setattr("flgpr.store.extras.import_module", missing)
    with pytest.raises(ValueError, match=r"pip install 'flgpr\[bags\]'"):
        live(tmp_path / "in", output=tmp_path / "out", mcap=True)
    assert not Path(tmp_path / "out").exists()
