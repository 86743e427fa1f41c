"""Ground that is unlike the training, from lanes to what a result says of it."""

import json
import math

import numpy as np
import pandas as pd
import pytest
from typer.testing import CliRunner

from flgpr.commands.app import app
from flgpr.commands.detect import detect
from flgpr.commands.train import train
from flgpr.live.detector import LiveDetector, LiveSettings
from flgpr.live.events import ground_event
from flgpr.live.ground import AGREEING
from flgpr.method.estimators import probability
from flgpr.method.method import detect as detect_in_memory
from flgpr.method.model import load_model, save_model
from flgpr.model import Lane
from flgpr.recipe.schema import load_recipe
from flgpr.store import describe_for_live, open_run, save_run
from flgpr.store.scan_file import stored_scan
from freeze.lanes import make_lane
from systems.lanes import SENSOR, small_recipe

LENGTH = 10.0
LANE = Lane(-1.5, 1.5, 0.0, LENGTH)
LANES = 4


def written_lane(folder, name, seed, unlike=False):
    """Write a lane; one that is unlike has the echo of HH in every polarization."""
    rng = np.random.default_rng(seed)
    targets = np.column_stack([rng.uniform(-1.1, 1.1, 5), np.linspace(1.0, LENGTH - 1.0, 5)])
    run = make_lane(rng, targets, LENGTH, 1.0)
    if unlike:
        signal = run["signal"].copy()
        signal[:] = signal.values[:, :1]
        run = run.assign(signal=signal)
    save_run(run.assign_attrs(title=name), folder / f"{name}.zarr")
    rows = [f"mine-{k},metal,{x:.3f},{y:.3f},0.05" for k, (x, y) in enumerate(targets)]
    (folder / f"{name}.csv").write_text("\n".join(["target_id,kind,x,y,depth", *rows]) + "\n")
    return folder / f"{name}.zarr"


def trained_on(home, count, name):
    runs = [home / f"train-{number}.zarr" for number in range(count)]
    truths = [home / f"train-{number}.csv" for number in range(count)]
    train(runs, truths, home / "fused.toml", home / name, lanes=[LANE] * count)
    return home / name


@pytest.fixture(scope="module")
def home(tmp_path_factory):
    folder = tmp_path_factory.mktemp("unlike")
    (folder / "sensor.toml").write_text(SENSOR)
    text = small_recipe("fused").replace("SENSOR", str(folder / "sensor.toml"))
    (folder / "fused.toml").write_text(text.replace("copies = 4", "copies = 2"))
    for number in range(LANES):
        written_lane(folder, f"train-{number}", 100 + number)
    written_lane(folder, "like", 200)
    written_lane(folder, "other", 201, unlike=True)
    trained_on(folder, LANES, "model")
    trained_on(folder, 1, "one")
    return folder


def found(home, run, model="model", **options):
    return detect(
        home / f"{run}.zarr",
        home / "fused.toml",
        home / f"{run}-{model}-{len(options)}-{options.get('unlike', '')}",
        LANE,
        home / model,
        **options,
    )


@pytest.fixture(scope="module")
def other(home):
    return found(home, "other", far=0.1)


def said(result):
    return result.manifest["run"]["unlike"]


def test_a_model_keeps_what_it_needs_beside_arrays_that_are_what_they_were(home):
    model = load_model(home / "model")
    assert model.ground.lanes == LANES
    assert [size.scans for size in model.ground.sizes] == [1, 2, 4, 8]
    assert all(len(size.divergence) == LANES for size in model.ground.sizes)
    assert len(model.ground.free) == LANES
    assert "ground" not in model.stages
    save_model(model, home / "again")
    assert load_model(home / "again").ground == model.ground


def test_a_lane_like_those_of_training_is_ranked_as_ever(home):
    result = found(home, "like")
    assert said(result)["judged"]
    assert not said(result)["unlike"]
    assert said(result)["notes"] == []
    assert len(result.detections) == 1
    kept = found(home, "like", unlike="keep")
    alarms = kept.alarms
    assert alarms["p"].tolist() == [round(probability(odds), 4) for odds in alarms["confidence"]]
    pd.testing.assert_frame_equal(result.detections[0].alarms, kept.detections[0].alarms)


def test_other_ground_is_told_and_ranked_by_contrast_and_what_was_measured_stays(home, other):
    entries = said(other)
    assert entries["unlike"]
    assert entries["substitute"] == "contrast"
    assert entries["notes"][0].endswith("the confidences do not hold; ranked by contrast instead")
    beyond = [name for name, figure in entries["figures"].items() if figure["beyond"]]
    assert "divergence" in beyond
    main, learnt = other.detections
    kept = found(home, "other", unlike="keep").detections[0].alarms
    pd.testing.assert_frame_equal(learnt.alarms, kept)
    # Every confidence that stays is that of a learnt alarm within the radius of alarms.
    assert "p" not in main.alarms  # nobody knows how often there is a mine on such ground
    assert "p" not in kept
    both = main.alarms[main.alarms["confidence_as_learnt"].notna()]
    assert f"of {len(main.alarms)} alarms {len(both)} were alarms as learnt" in entries["notes"][-2]
    for alarm in both.itertuples():
        off = np.hypot(kept["x"] - alarm.x, kept["y"] - alarm.y)
        assert off.min() <= 0.5
        assert kept["confidence"][off.argmin()] == alarm.confidence_as_learnt
    assert (np.diff(main.alarms["confidence"]) <= 0).all()


def test_the_page_and_the_command_say_it(home, other):
    page = (other.folder / "report.html").read_text()
    assert "This ground is unlike the training: the confidences do not hold" in page
    words = [
        "detect",
        home / "other.zarr",
        "--recipe",
        home / "fused.toml",
        "--lane",
        home / "lane.toml",
    ]
    (home / "lane.toml").write_text("x_min = -1.5\nx_max = 1.5\ny_min = 0.0\ny_max = 10.0\n")
    words += ["--model", home / "model", "-o", home / "told"]
    done = CliRunner().invoke(app, [str(word) for word in words])
    assert "this ground is unlike the training" in done.output
    done = CliRunner().invoke(app, [str(word) for word in [*words, "--json", "--quiet"]])
    assert json.loads(done.stdout)["unlike"]["unlike"] is True


def test_it_is_refused_where_that_is_asked_for(home):
    with pytest.raises(ValueError, match=r"this ground is unlike the training.*it is refused"):
        found(home, "other", unlike="refuse")
    assert said(found(home, "like", unlike="refuse"))["unlike"] is False


def test_a_model_of_one_lane_and_one_of_before_say_that_they_cannot_judge(home):
    entries = said(found(home, "other", "one"))
    assert not entries["judged"]
    assert "on 1 of the 3 lanes" in entries["notes"][0]
    model = load_model(home / "model")
    old = type(model)(model.detector, model.stages, model.notes)
    save_model(old, home / "old")
    entries = said(found(home, "other", "old"))
    assert "was trained before that was learnt" in entries["notes"][0]
    assert len(found(home, "other", "old").detections) == 1


def test_a_threshold_for_a_rate_marks_the_alarms_above_it(home, other):
    entries = other.manifest["run"]["far"]
    alarms = other.detections[0].alarms
    assert entries["source"] == "lane"
    assert entries["above"] == alarms["above_threshold"].sum()
    inside = LANE.contains(alarms["x"], alarms["y"])
    assert alarms["above_threshold"][inside].sum() <= 0.1 * LANE.area
    like = found(home, "like", far=0.1)
    entries = like.manifest["run"]["far"]
    assert entries["source"] == "training"
    assert entries["share_of_lanes"] == pytest.approx(LANES / (LANES + 1))
    level = -math.inf if entries["threshold"] is None else entries["threshold"]
    alarms = like.detections[0].alarms
    assert (alarms["above_threshold"] == (alarms["confidence"] > level)).all()


def test_in_memory_it_is_the_same(home, other):
    alarms = detect_in_memory(
        open_run(home / "other.zarr"),
        load_recipe(home / "fused.toml"),
        LANE,
        model=load_model(home / "model"),
        far=0.1,
    ).alarms
    np.testing.assert_array_equal(alarms["confidence"], other.detections[0].alarms["confidence"])


def play(home, name, until=None):
    run = open_run(home / f"{name}.zarr")
    detector = LiveDetector(
        describe_for_live(run),
        load_recipe(home / "fused.toml"),
        LANE,
        load_model(home / "model"),
        LiveSettings(looks=2, warm_up=3),
    )
    changes = []
    for number in range(run.sizes["scan"])[:until]:
        changes.append(detector.add(stored_scan(run, number)).ground)
    return detector, changes


def test_live_it_is_told_from_a_scan_on(home):
    detector, changes = play(home, "other")
    told = [change for change in changes if change is not None]
    assert len(told) == 1
    assert told[0].unlike
    assert detector.ground.unlike
    assert changes.index(told[0]) >= 3 + AGREEING - 2
    event = ground_event(7, told[0])
    assert event["unlike"] is True
    assert event["words"][0] == "this ground is unlike the training: the confidences do not hold"
    detector, changes = play(home, "like")
    assert not detector.ground.unlike
    assert changes == [None] * len(changes)


def test_live_it_goes_on_from_a_snapshot(home):
    whole, _ = play(home, "other")
    half, _ = play(home, "other", until=6)
    later, _ = play(home, "other", until=0)
    later.ground.restore(half.ground.state())
    assert later.ground.unlike == half.ground.unlike
    for name, array in half.ground.state().items():
        np.testing.assert_array_equal(later.ground.state()[name], array)
    assert whole.ground.unlike
