"""A live run that is tied to the Earth: its alarms have places there."""

import json

import pytest

from flgpr.geo import own_anchor, read_anchor
from flgpr.live.feeding import feed
from flgpr.live.options import LiveOptions
from flgpr.live.session import LiveRun
from flgpr.store import save_run
from live_lane import make_lane_run, small_recipe

TIED = {"longitude": 11.0, "latitude": 48.0, "azimuth": 30.0}
ANCHOR = """
crs = "EPSG:4326"
accuracy = 0.02
azimuth_deg = 75.0
azimuth_accuracy_deg = 0.1

[[point]]
lane = [0.0, 0.0]
longitude = -71.0
latitude = 42.5
"""
RUN = make_lane_run(scans=8)


def events_of(tmp_path, reference, anchor=None):
    """Return the alarms' events and the others of a run whose description has a georeference."""
    attrs = {} if reference is None else {"georeference": reference}
    save_run(RUN.assign_attrs(attrs), tmp_path / "run.zarr")
    feed(tmp_path / "run.zarr", tmp_path / "incoming", float("inf"))
    (tmp_path / "recipe.toml").write_text(small_recipe())
    lines = []
    options = LiveOptions(
        tmp_path / "recipe.toml", tmp_path / "out", tmp_path / "incoming", anchor=anchor
    )
    LiveRun(options, lines.append).run()
    text = (tmp_path / "out" / "live.jsonl").read_text()
    written = [json.loads(line) for line in text.splitlines()]
    alarms = [event for event in written if event["event"] == "alarm"]
    assert [json.loads(line) for line in lines] == alarms
    assert alarms
    return alarms, [event for event in written if event["event"] != "alarm"]


def check_places(alarms, anchor):
    for event in alarms:
        longitude, latitude, _ = anchor.to_geodetic([event["x"], event["y"], 0.0])
        assert (event["longitude"], event["latitude"]) == pytest.approx((longitude, latitude))


def test_alarms_of_a_run_with_a_georeference_have_latitude_and_longitude(tmp_path):
    alarms, _ = events_of(tmp_path, TIED)
    check_places(alarms, own_anchor(TIED))


def test_an_anchor_that_is_given_counts_more_than_the_runs_own(tmp_path):
    (tmp_path / "anchor.toml").write_text(ANCHOR)
    alarms, others = events_of(tmp_path, TIED, tmp_path / "anchor.toml")
    check_places(alarms, read_anchor(tmp_path / "anchor.toml"))
    assert others[0]["georeference"]["longitude"] == pytest.approx(-71.0)


def test_without_an_anchor_alarms_have_places_in_the_lane_alone(tmp_path):
    alarms, others = events_of(tmp_path, None)
    assert not any({"latitude", "longitude"} & set(event) for event in alarms)
    assert not [event for event in others if event["event"] == "problem"]


@pytest.mark.parametrize(
    ("reference", "words"),
    [
        ({"longitude": 11.0, "latitude": 48.0}, "longitude, latitude and azimuth in degrees"),
        ({"longitude": 11.0, "latitude": 1e9, "azimuth": 0.0}, "must lie on the Earth"),
        ("Munich", "longitude, latitude and azimuth in degrees"),
    ],
)
def test_a_georeference_that_is_none_is_said_and_stops_nothing(tmp_path, reference, words):
    alarms, others = events_of(tmp_path, reference)
    assert not any("latitude" in event for event in alarms)
    [problem] = [event for event in others if event["event"] == "problem"]
    assert "alarms have places in the lane alone" in problem["words"]
    assert words in problem["words"]
