"""The file of live events and what its lines say."""

import base64
import json
from types import SimpleNamespace

import numpy as np
import pytest

from flgpr.geo import own_anchor
from flgpr.live.events import (
    EventFile,
    add_places_on_earth,
    alarm_event,
    anew_event,
    as_line,
    position_events,
    scan_event,
    start_event,
    view_event,
)
from flgpr.live.updates import LiveAlarm, LiveUpdate
from flgpr.model import Lane
from flgpr.model.plausible import MotionLimits, Sighting, step_between
from flgpr.model.vehicle import Vehicle
from flgpr.store import Scan


def test_a_line_that_was_torn_off_is_dropped(tmp_path):
    path = tmp_path / "live.jsonl"
    path.write_text('{"event":"scan"}\n{"eve' + "x" * 70_000)
    with EventFile(path, fresh=False) as file:
        file.append([{"event": "resume"}])
    assert path.read_text() == '{"event":"scan"}\n{"event":"resume"}\n'
    path.write_text("x" * 10)
    with EventFile(path, fresh=False) as file:
        file.append([])
    assert path.read_text() == ""


ALARM = LiveAlarm("alarm-7", 0.25, 14.0, 1.5, 2.5, 4, "new", 9.0)
POSE = np.array([0.0, 10.0, 2.0, 0.0, 0.0, 0.0])


def test_an_alarms_event_says_what_is_left_and_whether_that_is_enough():
    vehicle = Vehicle(speed=2.0, reaction=0.5, deceleration=2.0, front=1.0)  # stops within 2 m
    event = alarm_event(ALARM, 12, POSE, vehicle, 0.25)
    assert (event["left_m"], event["raised_left_m"], event["latency_ms"]) == (3.0, 8.0, 250.0)
    assert (event["in_time"], event["margin_m"]) == (True, 0.5)
    assert "margin_m" not in alarm_event(ALARM, 12, POSE, Vehicle(), 0.25)
    assert json.loads(as_line(event)) == event


def test_places_on_earth_are_those_of_the_anchor():
    """By lengths of a degree at 48 degrees north: 111.2 km along a meridian, 74.6 km across."""
    north = own_anchor({"longitude": 11.0, "latitude": 48.0, "azimuth": 0.0})
    east = own_anchor({"longitude": 11.0, "latitude": 48.0, "azimuth": 90.0})
    event = alarm_event(ALARM, 12, POSE, Vehicle(), 0.25)
    there, turned = dict(event), dict(event)
    add_places_on_earth([there], north)
    assert there["latitude"] == pytest.approx(48.0 + 14.0 / 111_200, abs=1e-7)
    assert there["longitude"] == pytest.approx(11.0 + 0.25 / 74_600, abs=1e-8)
    add_places_on_earth([turned, turned], east)
    assert turned["latitude"] == pytest.approx(48.0 - 0.25 / 111_200, abs=1e-8)
    assert turned["longitude"] == pytest.approx(11.0 + 14.0 / 74_600, abs=1e-6)
    assert event | {"latitude": 0, "longitude": 0} == there | {"latitude": 0, "longitude": 0}
    add_places_on_earth([], north)


def test_only_what_is_not_plausible_is_a_problem():
    wrong = step_between(
        MotionLimits(), Sighting(0, 0.0, POSE), Sighting(1, 1.0, POSE + [0, 500, 0, 0, 0, 0])
    )
    good = step_between(
        MotionLimits(), Sighting(0, 0.0, POSE), Sighting(1, 1.0, POSE + [0, 1, 0, 0, 0, 0])
    )
    assert wrong.strain > 1 >= good.strain
    assert position_events("a.scan", LiveUpdate("held", [], step=good)) == []
    events = position_events("a.scan", LiveUpdate("held", [], step=wrong, clock=good))
    assert [event["kind"] for event in events] == ["pose", "clock"]
    assert all(event["name"] == "a.scan" for event in events)


def test_a_new_beginning_names_the_scans_that_were_held_back():
    held = Scan(3, 0.0, POSE, np.zeros((1, 1, 2), np.complex64))
    update = LiveUpdate("taken", [], forgotten=True, released=[(held, LiveUpdate("taken", []))])
    event = anew_event(5, update, POSE)
    assert (event["scan"], event["held"], event["forgotten"]) == (5, [3], True)
    assert event["pose"] == POSE.tolist()


def test_rows_of_the_view_are_half_floats_in_decibels():
    view = np.array([[9.0, 9.0], [1.0, 10.0], [np.nan, 100.0]], np.float32)
    event = view_event(-1, view)
    values = np.frombuffer(base64.b64decode(event["halves"]), "<f2").reshape(event["rows"], -1)
    np.testing.assert_allclose(values, [[0, 20], [np.nan, 40]])
    assert (event["row"], event["median_db"]) == (0, 20.0)


def test_the_event_of_a_scan_names_its_outcome_and_when_it_came():
    scan = Scan(3, 1.5, np.array([0.1, 2.0, 1.23456, 0.0, 0.0, 0.0]), np.zeros((1, 1, 1)))
    event = scan_event(scan, "taken", 1000.12345, 0.0123)
    assert event["scan"] == 3
    assert event["outcome"] == "taken"
    assert event["pose"] == [0.1, 2.0, 1.2346, 0.0, 0.0, 0.0]
    assert (event["arrived"], event["latency_ms"]) == (1000.123, 12.3)
    assert scan_event(Scan(4, 1.5, None, scan.signal), "refused", 0.0, 0.0)["pose"] == []


def test_the_event_of_the_start_says_what_is_searched():
    prescreen = SimpleNamespace(polarization="HH", subband="F1")
    recipe = SimpleNamespace(name="own", prescreen=prescreen)
    grid = {"dx": 0.1}
    detector = SimpleNamespace(recipe=recipe, lane=None, earlier=None, view_grid=lambda: grid)
    detector.description = SimpleNamespace(title="a drive")
    event = start_event(detector, None, Vehicle(threshold=0.5))
    assert (event["title"], event["recipe"], event["threshold"]) == ("a drive", "own", 0.5)
    assert event["channel"] == ["HH", "F1"]
    assert event["lane"] is None
    assert event["vehicle"]["front"] == Vehicle().front
    detector.lane = Lane(-1.0, 1.0, 0.0, 9.0)
    borders = start_event(detector, None, Vehicle(threshold=0.5))["lane"]
    assert borders == {"x_min": -1.0, "x_max": 1.0, "y_min": 0.0, "y_max": 9.0}
