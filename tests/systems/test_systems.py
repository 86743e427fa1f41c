"""Every packaged system on simulated lanes of 30 m, by each verb."""

import hashlib
import json
import shutil

import numpy as np
import pandas as pd
import pytest
from typer.testing import CliRunner

import flgpr
from flgpr.commands.app import app
from flgpr.commands.replay import replay
from flgpr.commands.runs import DEMO_COMPARISONS
from flgpr.live.detector import LiveDetector, LiveSettings
from flgpr.live.options import LiveOptions
from flgpr.live.session import LiveRun
from flgpr.recipe.schema import load_recipe, recipe_names
from flgpr.results.result import read_result
from flgpr.results.sections import results_at
from flgpr.store import Scan, describe_for_live, open_run, read_lane
from reference.slow_scoring import frame_counts
from scored import score_result
from systems.lanes import LENGTH, SMALL

pytestmark = pytest.mark.slow("trains every packaged recipe and runs it by each verb")

SYSTEMS = sorted(SMALL)
DEMO = [f"demo-{name}" for name in DEMO_COMPARISONS]
SECOND_BAND = {"fuse2018", "fuse2018-printed"}
LIVE = {"wang2007", "wang2007-printed", "fused"}
MOST = 1e-5


@pytest.fixture(scope="session", params=SYSTEMS)
def system(request, lanes):
    """A system, trained and run on the test lane."""
    name = request.param
    others = {"x": lanes / "train-x.zarr"} if name in SECOND_BAND else {}
    folder = lanes / name
    folder.mkdir()
    model = flgpr.train(
        [lanes / "train.zarr"], [lanes / "train.csv"], lanes / f"{name}.toml", folder / "model",
        lanes=[lanes / "lane.toml"], others=[others],
    )  # fmt: skip
    system = System(name, lanes, model)
    system.detect("result")
    return system


class System:
    def __init__(self, name, lanes, model):
        self.name = name
        self.lanes = lanes
        self.model = model
        self.folder = lanes / name

    @property
    def truth(self):
        return self.lanes / "test.csv"

    @property
    def options(self):
        others = {"x": self.lanes / "test-x.zarr"} if self.name in SECOND_BAND else {}
        return {"model": self.folder / "model", "others": others, "report": False}

    def detect(self, output, **more):
        where = self.lanes / "test.zarr", self.lanes / f"{self.name}.toml", self.folder / output
        return flgpr.detect(*where, self.lanes / "lane.toml", **{**self.options, **more})

    def digests(self, output):
        home = self.folder / output
        return {
            file.relative_to(home).as_posix(): hashlib.sha256(file.read_bytes()).hexdigest()
            for file in sorted(home.rglob("*"))
            if file.is_file() and file.name != "manifest.json"
        }


def test_these_are_the_packaged_systems():
    assert set(recipe_names()) == {*SYSTEMS, "demo", *DEMO, "miniature"}


def test_train_learns_what_the_recipe_names_and_detect_finds_mines(system):
    recipe = load_recipe(system.lanes / f"{system.name}.toml")
    assert list(system.model.stages) == recipe.learning()
    result = read_result(system.folder / "result")
    assert result.model().notes["recipe"] == system.name
    alarms, truth = (
        pd.read_csv(path)[["x", "y"]]
        for path in (system.folder / "result/alarms.csv", system.truth)
    )
    assert len(alarms) >= 10
    assert _finds_more_than_chance(alarms, truth)


def _finds_more_than_chance(alarms, truth):
    """Tell whether the first alarms find more mines where they are than wherever else the lane is shifted to."""
    shifted = [
        truth.assign(y=(truth["y"] + shift) % LENGTH) for shift in np.arange(2.0, LENGTH - 1.0, 2.0)
    ]
    found, *by_chance = (_found(alarms[:15], places) for places in (truth, *shifted))
    return found > max(by_chance)


def _found(alarms, places):
    """How many of the places have an alarm within 0.75 m."""
    away = alarms.to_numpy()[:, None] - places.to_numpy()
    return int((np.hypot(away[..., 0], away[..., 1]).min(axis=0) <= 0.75).sum())


def test_two_workers_that_are_stopped_and_one_that_goes_on_give_the_same_bytes(system):
    left = [5]

    def note(report):
        left[0] -= 1
        if not left[0]:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        system.detect("shared", note=note, workers=2)
    assert (system.folder / "shared.work").is_dir()
    system.detect("shared")
    assert system.digests("shared") == system.digests("result")


def test_sections_find_the_same_alarms(system):
    system.detect("sections", section=12.5)
    assert len(results_at(system.folder / "sections")) == 3
    whole = pd.read_csv(system.folder / "result" / "alarms.csv")
    parts = pd.read_csv(system.folder / "sections" / "alarms.csv")
    pd.testing.assert_frame_equal(
        parts.drop(columns="alarm_id").sort_values(["y", "x"], ignore_index=True),
        whole.drop(columns="alarm_id").sort_values(["y", "x"], ignore_index=True),
        rtol=MOST, atol=MOST, check_dtype=False,
    )  # fmt: skip


def test_replay_gives_the_same_bytes(system):
    assert replay(system.folder / "result") == {
        "identical": True,
        "agrees": True,
        "files": [],
        "difference": 0.0,
    }


def test_the_viewer_explains_the_alarms(system):
    shown = json.loads((system.folder / "result" / "view" / "index.json").read_text())
    (main,) = shown["detections"]
    total = np.sum([np.array(column) for column in main["contributions"].values()], axis=0)
    np.testing.assert_allclose(total, main["alarms"]["confidence"], rtol=1e-4, atol=1e-4)
    assert all(main["evidence"]["scans"])
    channel = {
        (layer["polarization"], layer["subband"])
        for layer in shown["layers"]
        if layer["detection"] == "main"
    }
    assert tuple(shown["channel"]) in channel


def test_live_runs_it_or_says_why_not(system):
    recipe = load_recipe(system.lanes / f"{system.name}.toml")
    assert (not recipe.not_live_because()) == (system.name in LIVE)
    if system.name in LIVE:
        return
    options = LiveOptions(recipe=system.lanes / f"{system.name}.toml", output=system.folder / "live",
                                incoming=system.lanes)  # fmt: skip
    with pytest.raises(ValueError, match=f"recipe '{system.name}' cannot run live: .*: ") as told:
        LiveRun(options)
    assert all(reason in str(told.value) for reason in recipe.not_live_because())
    assert not (system.folder / "live").exists()


@pytest.mark.parametrize("system", ["fused"], indirect=True)
def test_live_maps_what_detection_maps(system):
    """The run-view of the scans that have come is that of the whole run, but for what the background knew by then."""
    run = open_run(system.lanes / "test.zarr")
    recipe = load_recipe(system.lanes / "fused.toml")
    lane = read_lane(system.lanes / "lane.toml")
    model = read_result(system.folder / "result").model()
    detector = LiveDetector(describe_for_live(run), recipe, lane, model, LiveSettings(looks=1))
    whole = read_result(system.folder / "result").detections[0].view.values[0, 0]
    likeness = []
    for number in range(run.sizes["scan"]):
        one = run.isel(scan=number)
        scan = Scan(number, float(one["time"]), one["pose"].values, one["signal"].values)
        update = detector.add(scan)
        if update.outcome == "taken" and scan.number > run.sizes["scan"] // 2:
            theirs = whole[update.row : update.row + len(update.view)]
            both = np.isfinite(update.view[: len(theirs)]) & np.isfinite(theirs)
            likeness.append(np.corrcoef(update.view[: len(theirs)][both], theirs[both])[0, 1])
    assert np.median(likeness) > 0.8
    detector.finish()
    alarms = detector.table()
    truth = pd.read_csv(system.truth)[["x", "y"]]
    assert _finds_more_than_chance(alarms[["x", "y"]], truth)


@pytest.mark.parametrize("system", ["fused"], indirect=True)
def test_what_each_look_says_adds_up_to_the_confidence(system):
    """The causes of an alarm are all its looks; with one constant for all alarms they make its confidence."""
    index = json.loads((system.folder / "result" / "view" / "index.json").read_text())
    shown = next(one for one in index["detections"] if one["main"])
    evidence = shown["evidence"]
    added = shown["contributions"]
    assert list(added) == ["likelihood", "contrast HH", "contrast VV", "constant"]
    assert evidence["alone"] == ["B1", "B2", "mine over stone"]
    total = np.sum(list(added.values()), axis=0)
    np.testing.assert_allclose(total, shown["alarms"]["confidence"], atol=1e-4)
    np.testing.assert_allclose(added["constant"], added["constant"][0], atol=1e-3)
    detector = system.model.detector
    low, high = detector.confidence(pd.DataFrame({"magnitude": [0.0, 1.0]}))
    assert added["constant"][0] == pytest.approx(
        low + 40.0 * (high - low), abs=1e-3
    )  # the map's offset
    alarms = pd.read_csv(system.folder / "result/alarms.csv")
    assert all(
        len(looks) >= scans > 0
        for looks, scans in zip(evidence["causes"], alarms["scans"], strict=True)
    )
    for looks in evidence["causes"]:
        _, distance, share, *_ = np.array(looks).T
        np.testing.assert_allclose(share, distance**-2.0 / (distance**-2.0).sum(), atol=2e-3)
        assert (np.diff(distance) >= 0).all()


@pytest.mark.parametrize("name", sorted(set(SYSTEMS) - {"wang2007", "wang2007-printed"}))
def test_without_a_model_it_says_how_to_get_one(lanes, name, tmp_path):
    with pytest.raises(ValueError, match=f"recipe '{name}' learns .* `flgpr.train`"):
        flgpr.detect(
            lanes / "test.zarr", lanes / f"{name}.toml", tmp_path / "result", lanes / "lane.toml"
        )
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("system", ["fuse2018-printed"], indirect=True)
def test_every_frame_counts_its_area_where_the_recipe_says_so(lanes, system, tmp_path):
    """Fuse et al. 2018, Sec. 4: alarms of every frame, the same ground again in each; counted here by hand."""
    recipe = lanes / "fuse2018-printed.toml"
    text = recipe.read_text("utf-8").replace('area = "union"', 'area = "frames"')
    (tmp_path / "frames.toml").write_text(text, encoding="utf-8")
    where = lanes / "test.zarr", tmp_path / "frames.toml"
    for name, more in (("whole", {}), ("sections", {"section": 12.5})):
        flgpr.detect(*where, tmp_path / name, lanes / "lane.toml", **system.options, **more)
    told = CliRunner().invoke(app, ["score", str(tmp_path / "whole"), "--truth", str(system.truth)])
    assert told.exit_code == 0, told.output
    result = read_result(tmp_path / "whole")
    alarms, poses = result.detections[0].frames
    assert sorted(poses) == list(
        range(1, open_run(lanes / "test.zarr").sizes["scan"])
    )  # two scans are summed
    area = result.recipe.frame_area()
    halo = result.recipe.score.halo
    assert (
        alarms["across"].between(area.x_min, area.x_max)
        & alarms["ahead"].between(area.y_min, area.y_max)
    ).all()
    looks, false = frame_counts(alarms, poses, pd.read_csv(system.truth), area, halo)
    scored = json.loads((tmp_path / "whole" / "roc.json").read_text())
    last = scored["detections"]["main"]["points"][-1]
    assert scored["rules"]["convention"] == "frames"
    assert scored["detections"]["main"]["area"] == pytest.approx(len(poses) * area.area)
    assert (scored["detections"]["main"]["n_targets"], last["n_detected"]) == (
        len(looks),
        sum(looks),
    )
    assert last["n_false"] == false
    assert "every frame counts its area" in (tmp_path / "whole" / "report.html").read_text()
    (tmp_path / "sections" / "score").mkdir(exist_ok=True)
    _, again = score_result(tmp_path / "sections", system.truth)
    pd.testing.assert_frame_equal(
        again[0].curve, score_result(tmp_path / "whole", system.truth)[1][0].curve
    )
    plain = read_result(system.folder / "result")
    assert plain.detections[0].frames is None
    pd.testing.assert_frame_equal(plain.detections[0].alarms, result.detections[0].alarms)


@pytest.mark.parametrize("system", ["fuse2018"], indirect=True)
def test_without_a_lane_all_of_the_run_view_is_searched(lanes, system):
    """The small recipe's run-view is 4 m wide, the lane of other recipes 3 m."""
    run = system.folder / "alone.zarr"
    shutil.copytree(lanes / "test.zarr", run)  # without the lane that lies beside the other
    where = run, lanes / "fuse2018.toml", system.folder / "no-lane"
    flgpr.detect(*where, **system.options)
    lane = read_result(system.folder / "no-lane").lane
    assert (lane.x_min, lane.x_max) == (-2.0, 2.0)


@pytest.mark.parametrize("system", ["fuse2018"], indirect=True)
def test_a_second_band_is_given_in_training_and_detection_or_in_neither(lanes, system):
    with pytest.raises(ValueError, match="model was trained with a second band"):
        system.detect("alone", others={})
    with pytest.raises(ValueError, match="runs must share their poses"):
        system.detect("alone", others={"x": lanes / "train-x.zarr"})
