"""A proving ground in small: made, run, scored, and its truth looked at only where that is counted."""

import json
import shutil
from importlib import resources
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from typer.testing import CliRunner

import flgpr
from flgpr.commands.app import app
from flgpr.jobs.workers import RunOptions
from flgpr.proving_ground import (
    load_ground,
    make_ground,
    run_benchmark,
    run_oracle,
    score_entries,
    write_score_tables,
)
from flgpr.simulate import draw_world
from flgpr.store import read_manifest, read_table, sample_lane
from flgpr.trials import open_truth
from flgpr_ground import oracle
from flgpr_ground.lanes import PRINTS, SEALED, passphrase, same_lanes
from flgpr_ground.running import ALARMS
from flgpr_ground.table import pd_in_words
from grounds import SMALL, looks, write_runnable_ground
from robust import digests
from systems import test_plugin
from systems.lanes import small_recipe

pytestmark = pytest.mark.slow("trains and runs detectors on the lanes of a proving ground")

DETECTOR = '\n[detector]\nestimator = "logistic"\nfeatures = ["C_HH_F1", "M_VV_F1"]\n'


@pytest.fixture(scope="module")
def field(tmp_path_factory) -> Path:
    """A folder with the ground, two recipes and what running both gave."""
    folder = tmp_path_factory.mktemp("field")
    write_runnable_ground(folder, SMALL)
    (folder / "one.toml").write_text(small_recipe("wang2007"))
    (folder / "two.toml").write_text(small_recipe("wang2007") + DETECTOR)
    run_benchmark(
        [folder / "one.toml", folder / "two.toml"], folder / "out", ground=folder / "ground.toml"
    )
    return folder


def truth_of(ground, split="standard"):
    tables = []
    for lane in ground.tested(split):
        truth = draw_world(lane.scene, lane.seed).truth()
        tables.append(truth.assign(lane=lane.name))
    return pd.concat(tables, ignore_index=True)


def test_nothing_in_the_folder_tells_where_the_targets_of_test_lanes_lie(field):
    ground = load_ground(False, field / "ground.toml")
    files = {path.name for path in (field / "out" / "lanes").iterdir()}
    for name, lane in ground.lanes.items():
        assert {f"{name}.zarr", f"{name}-lane.toml"} <= files
        assert (f"{name}-truth.csv" in files) == (lane.part == "train")
        assert not {f"{name}-objects.csv", f"{name}-truth.json"} & files
    places = [f"{x:.2f}" for x in truth_of(ground)["y"]]
    sealed = (field / "out" / "lanes" / SEALED).read_text("utf-8")
    assert not [place for place in places if place in sealed]


def test_every_opening_of_the_truth_is_counted(field):
    out = field / "out"
    ground = load_ground(False, field / "ground.toml")
    write_score_tables([out], out)
    before = looks(out)
    truth, _, rules = open_truth(out / "lanes" / SEALED, passphrase(ground))
    assert rules["halo"] == 1.0
    np.testing.assert_allclose(truth["y"], truth_of(ground)["y"])
    assert looks(out) == [*before, "open"]
    write_score_tables([out], out)  # nothing new: no look is needed
    assert looks(out) == [*before, "open"]
    with pytest.raises(ValueError, match="passphrase"):
        open_truth(out / "lanes" / SEALED, "some other words")


def test_a_second_run_gives_the_same_table_to_the_digit(field, tmp_path):
    entries = [field / "one.toml", field / "two.toml"]
    write_score_tables([field / "out"], field / "out")
    # Of the lanes the workers make one anew; the fingerprints of all are taken again.
    anew = shutil.ignore_patterns("gravel-test-1*", SEALED, PRINTS)
    shutil.copytree(field / "out" / "lanes", tmp_path / "again" / "lanes", ignore=anew)
    how = RunOptions(workers=2)
    again = run_benchmark(entries, tmp_path / "again", how=how, ground=field / "ground.toml")
    write_score_tables([again], again)
    for name in ("scores.csv", f"lanes/{PRINTS}"):
        assert (again / name).read_bytes() == (field / "out" / name).read_bytes()
    page = (again / "index.html").read_text("utf-8")
    assert "another site" in page
    assert "http" not in page.replace("data:image", "")


def test_the_table_is_the_score_of_the_alarms(field):
    scores, costs = score_entries([field / "out"])
    ground = load_ground(False, field / "ground.toml")
    truth = truth_of(ground)
    assert set(scores["entry"]) == {"one", "two"}
    assert "tier" not in {*scores.columns, *costs.columns}  # the ground has none
    assert set(scores["group"]) == {"mines", "metal", "ap", "arid", "gravel"}
    alarms = read_table(field / "out" / "entries" / "two" / "standard" / ALARMS, "alarms")
    row = scores[
        (scores["entry"] == "two")
        & (scores["split"] == "standard")
        & (scores["far_allowed"] == 0.1)
    ]
    mines, arid = (row[row["group"] == group].iloc[0] for group in ("mines", "arid"))
    near = alarms.merge(truth, on="lane", suffixes=("", "_t"))
    near = near[np.hypot(near["x"] - near["x_t"], near["y"] - near["y_t"]) <= 1.0]
    best = (
        near.groupby(["lane", "target_id"])["confidence"]
        .max()
        .reindex(pd.MultiIndex.from_frame(truth[["lane", "target_id"]]))
    )
    assert mines["n_targets"] == len(truth) == 10
    assert arid["n_targets"] == 5
    assert mines["n_detected"] <= best.notna().sum()
    assert 0 <= mines["pd_low"] <= mines["pd"] <= mines["pd_high"] <= 1
    assert mines["n_false"] <= 0.1 * mines["area"]
    assert {"only", "reference_only", "p"} <= set(mines.dropna().index)
    reference = scores[
        (scores["entry"] == "one") & (scores["group"] == "mines") & (scores["far_allowed"] == 0.1)
    ]
    assert reference["p"].isna().all()
    assert "of 10" in pd_in_words(mines)
    assert (costs["seconds_per_km"] > 0).all()


def test_what_differs_in_its_detector_alone_shares_its_images(field):
    kept = [json.loads(path.read_text("utf-8")) for path in (field / "out" / "kept").glob("*.json")]
    passes = pd.DataFrame(kept).groupby(["lane", "stage"]).size()
    # Test lanes for both; the training of both folds and of the whole for the one that has a
    # detector.
    assert {name: int(count) for name, count in passes.groupby("stage").sum().items()} == {
        "signature": 4, "gain": 4, "view": 4, "features": 4,
    }  # fmt: skip
    one, two = (
        read_table(field / "out" / "entries" / name / "standard" / ALARMS, "alarms").sort_values(
            ["lane", "x", "y"]
        )
        for name in ("one", "two")
    )
    np.testing.assert_array_equal(one[["x", "y"]], two[["x", "y"]])
    assert not np.allclose(one["confidence"], two["confidence"])


def test_entries_cost_what_they_would_alone(field):
    costs = [
        json.loads((field / "out" / "entries" / name / "costs.json").read_text("utf-8"))
        for name in ("one", "two")
    ]
    assert {name for name in costs[1] if not name.startswith("training")} == set(costs[0])
    assert sum(name.startswith("training") for name in costs[1]) == 3
    shared: dict[str, float] = {}  # What was made once for both is charged to either.
    for path in (field / "out" / "kept").glob("*.json"):
        told = json.loads(path.read_text("utf-8"))
        shared[told["lane"]] = shared.get(told["lane"], 0.0) + told["processor_seconds"]
    assert set(costs[0]) < set(shared)
    for name in costs[0]:
        assert all(cost[name]["processor_seconds"] >= shared[name] > 0 for cost in costs)


def test_training_on_shared_images_is_that_of_train_and_detect(field, tmp_path):
    out = field / "out"
    lanes = ["arid-known-1", "gravel-known-1"]
    runs, truths, areas = (
        [out / "lanes" / f"{name}{end}" for name in lanes]
        for end in (".zarr", "-truth.csv", "-lane.toml")
    )
    flgpr.train(runs, truths, field / "two.toml", tmp_path / "model", lanes=areas)
    home = out / "lanes"
    result = flgpr.detect(
        home / "arid-test-1.zarr", field / "two.toml", tmp_path / "result", home / "arid-test-1-lane.toml",
        model=tmp_path / "model", report=False,
    )  # fmt: skip
    ours = read_table(out / "entries" / "two" / "standard" / ALARMS, "alarms")
    ours = ours[ours["lane"] == "arid-test-1"].sort_values("confidence", ascending=False)
    np.testing.assert_allclose(
        ours[["x", "y", "confidence"]], result.detections[0].alarms[["x", "y", "confidence"]]
    )


def test_alarms_made_elsewhere_enter(field, tmp_path):
    out = field / "out"
    ground = load_ground(False, field / "ground.toml")
    truth = truth_of(ground)
    given = tmp_path / "perfect"
    given.mkdir()
    truth[["x", "y", "lane"]].assign(confidence=1.0).to_csv(given / "standard.csv", index=False)
    run_benchmark([given], out, ground=field / "ground.toml")
    scores, _ = score_entries([out])
    mines = scores[(scores["entry"] == "perfect") & (scores["group"] == "mines")]
    assert set(mines["split"]) == {"standard"}
    assert (mines["pd"] == 1).all()
    assert (mines["n_false"] == 0).all()
    truth[["x", "y"]].assign(confidence=1.0, lane="somewhere").to_csv(
        given / "standard.csv", index=False
    )
    with pytest.raises(ValueError, match="lanes of standard"):
        run_benchmark([given], out, ground=field / "ground.toml")
    (given / "standard.csv").rename(given / "average.csv")
    with pytest.raises(ValueError, match="named after splits"):
        run_benchmark([given], out, ground=field / "ground.toml")
    given.rename(tmp_path / "oracle")
    with pytest.raises(ValueError, match="must not be called oracle"):
        run_benchmark([tmp_path / "oracle"], out, ground=field / "ground.toml")


def test_lanes_that_are_there_are_not_made_again(field, caplog):
    out = field / "out"
    before = digests(out / "lanes")
    with caplog.at_level("INFO"):
        assert make_ground(out, ground=field / "ground.toml") == out
    assert digests(out / "lanes") == before
    assert "exists already" in caplog.text
    with pytest.raises(ValueError, match="output must be a folder of proving-ground-2-quick"):
        make_ground(out, quick=True)


def test_an_entry_that_cannot_be_trained_does_not_stop_the_others(field, tmp_path):
    lost = tmp_path / "lost.toml"
    lost.write_text(
        small_recipe("wang2007")
        + DETECTOR.replace("logistic", "svm")
        + "options = { kernel = 'none' }\n"
    )
    with pytest.warns(UserWarning, match="lost did not finish"):
        run_benchmark([lost, field / "one.toml"], field / "out", ground=field / "ground.toml")
    text = write_score_tables([field / "out"], tmp_path / "table")
    assert "lost did not finish" in text
    assert "  one " in text


def test_a_stage_that_spends_all_its_mines_enters(field):
    """Where every mine made the signature none is left to train a detector with, and none is wanted."""
    stage = '\n[[columns]]\nstage = "matched"\n'
    (field / "matched.toml").write_text('confidence = "amf"\n' + small_recipe("wang2007") + stage)
    run_benchmark([field / "matched.toml"], field / "out", ground=field / "ground.toml")
    about = json.loads((field / "out" / "entries" / "matched" / "entry.json").read_text("utf-8"))
    assert about["fault"] == ""
    out = field / "out" / "lanes"
    runs, truths, areas = (
        [out / f"{name}-known-1{end}" for name in ("arid", "gravel")]
        for end in (".zarr", "-truth.csv", "-lane.toml")
    )
    flgpr.train(runs, truths, field / "matched.toml", field / "amf", lanes=areas)
    result = flgpr.detect(
        out / "arid-test-1.zarr", field / "matched.toml", field / "by-amf", out / "arid-test-1-lane.toml",
        model=field / "amf", report=False,
    )  # fmt: skip
    alarms = read_table(field / "out" / "entries" / "matched" / "standard" / ALARMS, "alarms")
    ours = alarms[alarms["lane"] == "arid-test-1"].sort_values("confidence", ascending=False)
    np.testing.assert_allclose(ours["confidence"], result.detections[0].features["amf"], rtol=1e-5)


def test_the_oracle_bounds_what_is_found(field, tmp_path):
    shutil.copytree(field / "out", tmp_path / "out")
    out = tmp_path / "out"
    ground = load_ground(False, field / "ground.toml")
    looked = len(looks(out))
    found = run_oracle(out, field / "one.toml")
    assert len(looks(out)) == looked + 1
    assert not {"x", "y", "depth"} & set(found.columns)
    assert (found["looks"] > 0).all()
    assert sorted(found["target_id"]) == sorted(
        truth_of(ground)["lane"] + "-" + truth_of(ground)["target_id"]
    )
    metal = found[found["kind"] == "metal"]
    assert (
        metal["far_phase"] <= metal["far"] + 0.05
    ).mean() > 0.8  # who knows the phase, too, finds no fewer
    scores, _ = score_entries([out])
    at = scores[(scores["split"] == "standard") & (scores["far_allowed"] == 0.1)].set_index(
        ["entry", "group"]
    )
    assert at.loc[("oracle", "mines"), "n_targets"] == 10
    assert at.loc[("oracle", "metal"), "pd"] == (metal["far"] <= 0.1).mean()
    assert at.loc[("oracle-phase", "metal"), "pd"] >= at.loc[("one", "metal"), "pd"]
    assert "oracle-phase" in write_score_tables([out], tmp_path / "table")
    assert (tmp_path / "table" / "index.html").read_text("utf-8").count(
        "reference</td>"
    ) == 2  # two splits


def test_the_oracle_finds_echoes_that_are_there_and_no_others(field):
    lane = load_ground(False, field / "ground.toml").lanes["arid-bare-1"]
    clutter = oracle.BareGround(
        oracle.cleaned_lane(str(field / "out"), lane, field / "one.toml"), lane.scene.lane
    )
    rng = np.random.default_rng(0)
    looks = oracle.Looks(clutter.place, clutter.ahead, clutter.chips["full"])
    with_echo = []
    without = []
    for place in rng.choice(np.unique(looks.place), 12, replace=False):
        at = looks.place == place
        own = rng.normal(size=(at.sum(), looks.chip.shape[1], 2)).view(np.complex128)[..., 0]
        power = [
            (echo.conj() @ clutter.inverse(y) @ echo).real
            for y, echo in zip(looks.ahead[at], own, strict=True)
        ]
        own *= 5 / np.sqrt(np.sum(power))  # deflection 5
        with_echo.append(clutter.rates(looks.ahead[at], looks.chip[at] + own, own)["far_phase"])
        without.append(clutter.rates(looks.ahead[at], looks.chip[at], own)["far_phase"])
    assert np.median(without) > 0.1
    assert np.median(with_echo) < 0.02


def test_lanes_that_are_stored_enter_with_those_that_are_simulated(tmp_path):
    text = (resources.files("flgpr_ground") / "full-wave-1.toml").read_text("utf-8")
    (tmp_path / "ground.toml").write_text(text.replace("copies = 24", "copies = 2"))
    out = run_benchmark(
        ["wang2007", "wang2007-b"], tmp_path / "out", ground=tmp_path / "ground.toml"
    )
    assert "arid-lane-1-truth.csv" not in {path.name for path in (out / "lanes").iterdir()}
    scores, _ = score_entries([out])
    mines = scores[(scores["group"] == "mines") & (scores["far_allowed"] == 0.4)].set_index("entry")
    assert list(mines["n_targets"]) == [3, 3]
    assert mines.loc["wang2007", "n_detected"] >= 1
    write_score_tables([out], out)
    page = (out / "index.html").read_text("utf-8")
    assert "1 of the lanes is a run store that was there already" in page
    assert "Lanes are simulated" not in page
    assert (
        page.count("<details class=fold open>") == 1
    )  # a ground without tiers has no picture above
    assert read_manifest(out / "lanes" / "arid-lane-1.zarr") == read_manifest(
        sample_lane() / "run.zarr"
    )


def test_folders_that_do_not_belong_together_are_refused(field, tmp_path):
    with pytest.raises(ValueError, match="flgpr benchmark run"):
        score_entries([tmp_path])
    other = tmp_path / "other.toml"
    other.write_text((field / "ground.toml").read_text().replace("version = 3", "version = 4"))
    with pytest.raises(ValueError, match="another ground"):
        run_benchmark([field / "one.toml"], field / "out", ground=other)
    bent = tmp_path / "bent.toml"
    bent.write_text("name = 3")
    with pytest.raises(ValueError, match="recipe"):
        run_benchmark([bent], tmp_path / "none", ground=field / "ground.toml")
    assert not (tmp_path / "none").exists()


def test_fingerprints_tell_the_same_bits_from_alike_and_other_lanes(field, tmp_path, monkeypatch):
    from flgpr_ground import lanes

    ground = load_ground(False, field / "ground.toml")
    prints = pd.read_csv(field / "out" / "lanes" / PRINTS)
    names = list(prints["lane"])
    assert names == list(ground.lanes)
    packaged = prints.assign(lane=[f"{ground.title} {name}" for name in names])
    packaged.loc[1, "sha256"] = "0" * 64
    packaged.loc[1, "HH"] *= 1 + 5e-5
    packaged.loc[2, "sha256"] = "0" * 64
    packaged.loc[2, "VV"] *= 1.001
    packaged.drop(index=3).to_csv(tmp_path / "fingerprints.csv", index=False)
    monkeypatch.setattr(lanes, "packaged_text", lambda name: (tmp_path / name).read_text())
    told = same_lanes(ground, field / "out" / "lanes")
    assert list(told.values()) == [
        "same bits",
        "alike",
        "other",
        "not known",
        "same bits",
        "same bits",
    ]


def test_the_commands_run_and_tell(field):
    out = field / "out"
    result = CliRunner().invoke(app, ["benchmark", "table", str(out)])
    assert result.exit_code == 0, result.output
    assert "standard: all" in result.output
    assert "; against one +" in result.output
    run = [
        "benchmark",
        "run",
        str(field / "one.toml"),
        "-o",
        str(out),
        "--ground",
        str(field / "ground.toml"),
    ]
    result = CliRunner().invoke(app, [*run, "--quiet"])
    assert result.exit_code == 0, result.output
    assert result.output == ""
    before = digests(out)
    result = CliRunner().invoke(app, run)
    assert result.exit_code == 0, result.output
    assert "index.html exists already" in result.stderr
    assert digests(out) == before
    result = CliRunner().invoke(app, ["benchmark", "run", "-o", str(out), "--quick"])
    assert result.exit_code == 2
    assert "got one of another ground" in result.stderr
    assert digests(out) == before
    result = CliRunner().invoke(app, ["benchmark", "run", "no-such-entry", "-o", str(out)])
    assert result.exit_code == 2
    assert "no-such-entry" in result.output


def test_a_recipe_of_another_distribution_enters(field, tmp_path, monkeypatch):
    shutil.unpack_archive(test_plugin.make_wheel(tmp_path), tmp_path / "site", "zip")
    monkeypatch.syspath_prepend(tmp_path / "site")
    (field / "sharp.toml").write_text(
        small_recipe("wang2007") + test_plugin.STAGE + test_plugin.DETECTOR
    )
    run_benchmark([field / "sharp.toml"], field / "out", ground=field / "ground.toml")
    scores, _ = score_entries([field / "out"])
    own = scores[(scores["entry"] == "sharp") & (scores["group"] == "mines")]
    assert set(own["split"]) == {"standard", "new-site"}
    assert (own["n_targets"] == 10).all()
