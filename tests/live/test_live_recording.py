"""Recorded events played again: the same but for the clock; and the packaged drive."""

import gzip
import json

import numpy as np
import pytest

from flgpr.live.recording import play_recording, read_recording
from flgpr.store import read_table, sample_drive

EVENTS = [
    {"event": "start", "title": "small"},
    {"event": "scan", "scan": 4, "arrived": 1.0, "latency_ms": 2.0},
    {"event": "alarm", "alarm_id": "a", "scan": 4},
    {"event": "scan", "scan": 5, "arrived": 9.0, "latency_ms": 1.0},
    {"event": "end", "alarms": 1},
]


@pytest.fixture
def recording(tmp_path):
    return write(tmp_path / "small.jsonl.gz", EVENTS)


def write(path, events):
    lines = "".join(json.dumps(event) + "\n" for event in events)
    path.write_bytes(gzip.compress(lines.encode()))
    return path


def played(folder):
    return [json.loads(line) for line in (folder / "live.jsonl").read_text().splitlines()]


def test_events_are_the_recorded_ones_at_the_pace_of_the_radar(recording, tmp_path):
    assert play_recording(recording, tmp_path / "live", rate=50.0) == 2
    events = played(tmp_path / "live")
    arrived = [event.pop("arrived") for event in events if event["event"] == "scan"]
    assert arrived[1] - arrived[0] == pytest.approx(1 / 50.0, abs=2e-3)
    assert arrived[0] > 1e9
    for event in EVENTS:
        event = {name: value for name, value in event.items() if name != "arrived"}
        assert event in events
    assert [event["event"] for event in events] == [event["event"] for event in EVENTS]


def test_playing_stops_when_it_is_asked_to_and_begins_anew(recording, tmp_path):
    assert play_recording(recording, tmp_path / "live", rate=1e-3, wait=lambda _: True) == 0
    assert [event["event"] for event in played(tmp_path / "live")] == ["start"]
    assert play_recording(recording, tmp_path / "live", rate=1e3) == 2
    assert len(played(tmp_path / "live")) == len(EVENTS)


def test_what_cannot_be_played_is_refused(recording, tmp_path):
    with pytest.raises(ValueError, match="rate must be positive, got 0"):
        play_recording(recording, tmp_path / "live", rate=0)
    empty = write(tmp_path / "empty.jsonl.gz", EVENTS[:1])
    with pytest.raises(ValueError, match="recording must hold scans"):
        read_recording(empty)


def test_alarms_of_the_packaged_drive_grow_more_certain_as_the_vehicle_comes_nearer():
    before, scans, after = read_recording(sample_drive() / "drive.jsonl.gz")
    assert [event["event"] for event in [*before, *after]] == ["start", "end"]
    assert len(scans) / 4.2 == pytest.approx(30, abs=1)  # half a minute
    alarms = [event for scan in scans for event in scan.events if event["event"] == "alarm"]
    truth = read_table(sample_drive() / "truth.csv", "truth")
    first = []
    last = []
    for mine in truth.to_dict("records"):
        near = []
        for alarm in alarms:
            is_ahead = alarm["left_m"] > 3.0 and alarm["state"] in ("new", "update")
            if is_ahead and np.hypot(alarm["x"] - mine["x"], alarm["y"] - mine["y"]) <= 1.0:
                near.append(alarm["p"])
        first.append(near[0])
        last.append(near[-1])
    assert len(first) == 10
    assert np.mean(last) > np.mean(first) + 0.1
