"""What events tell of alarms: forecasts where the model has them, and advice to wait that is taken back."""

import json
import math

import pytest
from test_forecast import KNOWN, RECIPE, trained

from flgpr.live.feeding import feed
from flgpr.live.forecast import NAME
from flgpr.live.options import LiveOptions
from flgpr.live.session import LiveRun
from flgpr.method.model import Model, save_model
from flgpr.model.vehicle import Vehicle
from flgpr.store import save_run
from live_lane import LANE, make_lane_run

LANE_TOML = f"x_min = {LANE.x_min}\nx_max = {LANE.x_max}\ny_min = 2.0\ny_max = 20.0\n"


@pytest.fixture(scope="module")
def run():
    return make_lane_run()


@pytest.fixture(scope="module")
def model():
    return Model(trained(), {NAME: KNOWN.arrays()})


@pytest.mark.slow("plays a drive to its end")
def test_events_tell_it_where_the_model_does(run, model, tmp_path):
    (tmp_path / "recipe.toml").write_text(RECIPE)
    (tmp_path / "lane.toml").write_text(LANE_TOML)
    save_run(run, tmp_path / "run.zarr")
    feed(tmp_path / "run.zarr", tmp_path / "incoming", math.inf)

    def played(given, name, **more):
        save_model(given, tmp_path / f"model-{name}")
        options = LiveOptions(
            tmp_path / "recipe.toml", tmp_path / name, tmp_path / "incoming", model=tmp_path / f"model-{name}",
            lane=tmp_path / "lane.toml", **more,
        )  # fmt: skip
        LiveRun(options).run()
        lines = [
            json.loads(line) for line in (tmp_path / name / "live.jsonl").read_text().splitlines()
        ]
        return [line for line in lines if line["event"] == "alarm"]

    lines = played(model, "new", vehicle=Vehicle(speed=1.0))
    for line in lines:
        assert line["p"] == pytest.approx(1 / (1 + math.exp(-line["confidence"])), abs=1e-4)
        assert ("wait" in line) == ("looks_left" in line) == (line["state"] in ("new", "update"))
        assert ("next_p" in line) == ("change" in line)
        assert ("last_p" in line) == (line.get("looks_left", 0) > 0)
    assert {line.get("wait") for line in lines} >= {True, False}
    with pytest.warns(UserWarning, match="trained before that was learnt; train it again"):
        old = played(Model(model.detector), "old", vehicle=Vehicle(speed=1.0))
    members = {"p", "next_p", "last_p", "looks_left", "change", "wait"}
    assert not any(members & set(line) for line in old)
    untimed = ("latency_ms", "margin_m", "in_time")
    assert [{k: v for k, v in one.items() if k not in untimed} for one in old] == [
        {k: v for k, v in one.items() if k not in {*untimed, *members}} for one in lines
    ]
    with pytest.raises(ValueError, match="worth must be a probability"):
        played(model, "worth", worth=1.5)


def test_who_was_told_to_wait_is_told_when_no_look_came(run, model, tmp_path, monkeypatch):
    (tmp_path / "recipe.toml").write_text(RECIPE)
    (tmp_path / "lane.toml").write_text(LANE_TOML)
    run = run.copy()
    run["signal"] = run["signal"].where(run["scan"] % 5 != 4)  # every fifth comes without values
    save_run(run, tmp_path / "run.zarr")
    feed(tmp_path / "run.zarr", tmp_path / "incoming", math.inf)
    save_model(model, tmp_path / "model")
    live = LiveRun(
        LiveOptions(
            tmp_path / "recipe.toml", tmp_path / "out", tmp_path / "incoming", model=tmp_path / "model",
            lane=tmp_path / "lane.toml", vehicle=Vehicle(speed=0.1),
        )
    )  # fmt: skip
    take = live._take_frame
    waited = []

    def taken(arrival, events):
        whole = take(arrival, events)
        lines = [
            json.loads(line) for line in (tmp_path / "out" / "live.jsonl").read_text().splitlines()
        ]
        last = {line["alarm_id"]: line for line in lines if line["event"] == "alarm"}
        waiting = [line for line in last.values() if line.get("wait")]
        assert all(
            live._detector.expected_looks(live._detector.alarms.open[line["alarm_id"]])
            for line in waiting
        )
        waited.append(len(waiting))
        return whole

    monkeypatch.setattr(live, "_take_frame", taken)
    live.run()
    assert sum(waited) > 3, sum(waited)
