"""The lines of a live detection keep to the published schema, and altered ones do not."""

import json

import numpy as np
import pytest

from flgpr.geo import own_anchor
from flgpr.live.events import (
    add_places_on_earth,
    alarm_event,
    anew_event,
    as_line,
    ground_event,
    position_events,
    problem_event,
    view_event,
)
from flgpr.live.options import LiveOptions
from flgpr.live.session import LiveRun
from flgpr.live.updates import LiveAlarm, LiveUpdate
from flgpr.method.unlike import Comparison, Figure
from flgpr.model.plausible import MotionLimits, Sighting, step_between
from flgpr.model.vehicle import Vehicle
from flgpr.store import Scan, describe_for_live, encode_scan
from live_lane import make_lane_run, small_recipe
from published_schemas import check, keeps_to, maker

SCANS = 13
ANCHORED = {"longitude": 11.0, "latitude": 48.0, "azimuth": 30.0}
POSE = np.array([0.0, 10.0, 2.0, 0.0, 0.0, 0.0])
ALARM = LiveAlarm("alarm-7", 0.25, 14.0, 1.5, 2.5, 4, "new", 9.0)


def frames():
    """Scans of which one is damaged, one has a pose that no vehicle reaches, and the last moved."""
    run = make_lane_run(scans=SCANS).assign_attrs(georeference=ANCHORED)
    made = []
    for number in range(SCANS):
        pose = run["pose"].values[number].copy()
        if number == 6:
            pose[1] += 45.0
        if number >= 9:
            pose[1] -= 500.0
        signal = run["signal"].values[number]
        frame = encode_scan(number, signal, pose, float(run["time"].values[number]))
        if number == 3:
            frame = frame[:5000] + b"\0\1" + frame[5002:]
        made.append(frame)
    return describe_for_live(run), made


def lines_of(folder):
    return [json.loads(line) for line in (folder / "live.jsonl").read_text().splitlines()]


def test_a_live_session_keeps_to_the_schema_with_events_of_every_kind(tmp_path):
    description, made = frames()
    incoming = tmp_path / "incoming"
    incoming.mkdir()
    (incoming / "run.json").write_text(json.dumps(description.as_json()))
    (tmp_path / "recipe.toml").write_text(small_recipe())

    def play(first, last, **more):
        for number in range(first, last):
            (incoming / f"{number:04d}.scan").write_bytes(made[number])
        recipe = tmp_path / "recipe.toml"
        vehicle = Vehicle(speed=2.0, front=0.4)
        LiveRun(LiveOptions(recipe, tmp_path / "out", incoming, vehicle=vehicle, **more)).run()

    play(0, 8, idle=0.3)
    (incoming / "end.json").write_text("{}")
    play(8, SCANS)

    lines = lines_of(tmp_path / "out")
    for line in lines:
        check("live-event", line)
    check("live-report", json.loads((tmp_path / "out" / "live.json").read_text()))
    kinds = {line["event"] for line in lines}
    assert kinds == {
        "start", "scan", "view", "alarm", "anew", "problem", "counts", "resume", "end",
    }  # fmt: skip
    # Positions and health are problems, too, and without a model nothing is said of the ground.
    assert len(kinds) == len(maker().EVENTS) - 3
    assert any("kind" in line for line in lines if line["event"] == "problem")
    assert any({"latitude", "margin_m"} <= line.keys() for line in lines)


def events():
    """Return an event of every kind that functions make."""
    vehicle = Vehicle(speed=2.0, front=1.0)
    alarm = alarm_event(ALARM, 12, POSE, vehicle, 0.25)
    add_places_on_earth([alarm], own_anchor(ANCHORED))
    before = Sighting(0, 0.0, POSE)
    after = Sighting(1, 1.0, POSE + [0, 500, 0, 0, 0, 0])
    step = step_between(MotionLimits(), before, after)
    [position] = position_events("a.scan", LiveUpdate("held", [], step=step))
    signal = np.zeros((1, 1, 1), np.complex64)
    released = [(Scan(3, 0.0, POSE, signal), LiveUpdate("taken", []))]
    anew = anew_event(5, LiveUpdate("taken", [], anew=True, released=released), POSE)
    view = view_event(2, np.ones((3, 4), np.float32))
    problem = problem_event("a.scan", "frame has a wrong checksum")
    ground = ground_event(7, Comparison((Figure("divergence", 0.9, 0.4),)))
    made = [alarm, position, anew, view, problem, ground]
    return {name: json.loads(as_line(event)) for name, event in zip(NAMES, made, strict=True)}


NAMES = ("alarm", "position", "anew", "view", "problem", "ground")


@pytest.mark.parametrize("name", NAMES)
def test_an_event_that_lacks_a_member_or_has_a_foreign_one_is_refused(name):
    event = events()[name]
    check("live-event", event)
    assert not keeps_to("live-event", event | {"nonsense": 1})
    left_out = {"alarm": "scan", "position": "limit", "anew": "held", "view": "row"}
    rest = {key: value for key, value in event.items() if key != left_out.get(name, "words")}
    assert not keeps_to("live-event", rest)


@pytest.mark.parametrize(
    ("name", "change"),
    [
        ("alarm", {"event": "alarms"}),
        ("alarm", {"state": "gone"}),
        ("alarm", {"scan": -1}),
        ("alarm", {"confidence": None}),
        ("alarm", {"latitude": 91.0}),
        ("alarm", {"p": 1.5}),
        ("alarm", {"next_p": [0.5]}),
        ("position", {"kind": "place"}),
        ("position", {"more": 0}),
        ("anew", {"pose": [0.0] * 5}),
        ("view", {"halves": None}),
    ],
)
def test_an_altered_event_is_refused(name, change):
    assert not keeps_to("live-event", events()[name] | change)


def test_members_of_a_forecast_may_come_with_an_alarm():
    forecast = {"p": 0.8, "looks_left": 2, "next_p": [0.7, 0.9], "change": 0.1, "wait": True}
    check("live-event", events()["alarm"] | forecast | {"last_p": [0.6, 0.95]})
