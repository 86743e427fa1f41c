import json
import re
import shutil

import numpy as np
import pandas as pd
import pytest

import flgpr
from flgpr.commands.demo import demo as make_demo
from flgpr.commands.replay import replay
from flgpr.commands.runs import DEMO_COMPARISONS
from flgpr.method.method import detect
from flgpr.recipe.schema import load_recipe, parse_recipe, recipe_text
from flgpr.results.manifest import ResultError
from flgpr.results.result import read_result
from flgpr.scoring import roc
from flgpr.store import (
    json_with_digest,
    open_run,
    parse_with_digest,
    read_table,
    sample_lane,
    save_run,
    sha256,
)


@pytest.fixture(scope="module")
def untold(tmp_path_factory):
    """The demo's run alone, without truth beside it, detected with the demo's recipe."""
    folder = tmp_path_factory.mktemp("untold")
    shutil.copytree(sample_lane() / "run.zarr", folder / "run.zarr")
    return flgpr.detect(folder / "run.zarr", "demo", folder / "result")


def outcome(scored, name):
    one = next(one for one in scored if one.name == name)
    return one.outcomes.set_index("target_id")


def test_both_metal_mines_stand_above_every_false_alarm(demo):
    table = outcome(demo[1], "main")
    metal = table[table["kind"] == "metal"]
    assert metal["detected"].all()
    assert (metal["n_false"] == 0).all()
    assert (metal["distance"] < 0.2).all()


def test_subtracting_the_roadside_leaves_the_mines_and_takes_the_post_away(demo):
    result, scored = demo
    suppressed = next(d for d in result.detections if d.name == "roadside-suppressed")
    post = read_table(sample_lane() / "objects.csv", "objects").query("kind == 'post'").iloc[0]
    near = np.hypot(suppressed.alarms["x"] - post["x"], suppressed.alarms["y"] - post["y"]) < 0.3
    assert not near.any()
    assert suppressed.notes["mask_peak_reduced_by_db"] > 20
    assert (
        np.hypot(*(np.array(suppressed.notes["mask_centre"]) - post[["x", "y"]].astype(float)))
        < 0.2
    )
    assert outcome(scored, "roadside-suppressed")["detected"].all()


def test_alarms_tell_what_the_roadside_made(demo):
    alarms = demo[0].detections[0].alarms
    post = np.hypot(alarms["x"] + 1.2, alarms["y"] - 4.0) < 0.2
    assert alarms["roadside"][post].item() == pytest.approx(1, abs=0.1)
    mine = np.hypot(alarms["x"] + 0.4, alarms["y"] - 3.0) < 0.2
    assert alarms["roadside"][mine].item() < 0.05


def test_the_roc_file_holds_what_scoring_computes(demo):
    result, _ = demo
    stored = json.loads((result.folder / "roc.json").read_text())
    truth = read_table(sample_lane() / "truth.csv", "truth")
    curve = roc(result.detections[0].alarms, truth, result.lane, halo=0.5)
    assert list(stored["detections"]) == [one.name for one in result.detections]
    points = pd.DataFrame(stored["detections"]["main"]["points"])
    assert points["threshold"].iloc[0] is None or np.isnan(points["threshold"].iloc[0])
    np.testing.assert_allclose(points["pd"], curve["pd"])
    np.testing.assert_allclose(points["far"], curve["far"])
    area = 2.0 * 4.2 - 3 * np.pi * 0.25
    assert (
        0 <= stored["detections"]["main"]["area"] - area < 0.1
    )  # the halos overlap nowhere, one crosses no border


def test_the_report_needs_nothing_beside_it(demo):
    page = (demo[0].folder / "report.html").read_text(encoding="utf-8")
    assert page.count('src="data:image/png;base64,') == 11
    assert not re.search(r'(src|href)="(?!data:)', page)
    assert "http" not in re.sub(r'data:image/png;base64,[^"]*', "", page)
    for word in ("mine-3", "95 %", "recipe.toml", "SHA-256", "roadside"):
        assert word in page


def test_json_and_csv_hold_the_same_alarms_and_no_map_takes_metres_for_degrees(demo):
    folder = demo[0].folder
    table = read_table(folder / "alarms.csv", "alarms")
    assert not list(folder.rglob("*.geojson"))
    features = json.loads((folder / "alarms.json").read_text())["features"]
    assert [f["geometry"]["coordinates"] for f in features] == table[["x", "y"]].to_numpy().tolist()
    assert [f["properties"]["confidence"] for f in features] == table["confidence"].tolist()
    assert table["confidence"].is_monotonic_decreasing


@pytest.mark.slow("runs the demo again")
def test_the_same_input_gives_the_same_bytes(demo, untold, tmp_path):
    """And the same identity, which is the digest of all that is compared and of where the run lies."""
    again, _ = make_demo(tmp_path / "again")
    assert again.manifest["identity"] == demo[0].manifest["identity"]
    alone = untold.manifest["files"]
    shared = {"alarms.csv", "alarms.json", "features.csv", "run_view.npz", "recipe.toml"}
    assert shared < alone.keys()
    assert {name: alone[name] for name in shared} == {
        name: demo[0].manifest["files"][name] for name in shared
    }


def test_the_recipes_beside_the_demo_find_alone_what_they_find_in_it(demo):
    run = open_run(sample_lane() / "run.zarr")
    result, _ = demo
    assert [one.name for one in result.detections] == ["main", *DEMO_COMPARISONS]
    for beside in result.detections[1:]:
        alone = detect(run, load_recipe(f"demo-{beside.name}"))
        assert beside.recipe_text == recipe_text(f"demo-{beside.name}")
        np.testing.assert_array_equal(alone.view.values, beside.view.values)
        np.testing.assert_allclose(alone.alarms["x"], beside.alarms["x"])
        np.testing.assert_allclose(alone.alarms["confidence"], beside.alarms["confidence"])


def test_a_recipe_with_variants_is_told_what_became_of_them():
    text = recipe_text("demo") + '\n[[variants]]\nname = "other"\n'
    with pytest.raises(ValueError, match="what was a variant is a recipe of its own"):
        parse_recipe(text)


@pytest.mark.slow("runs the demo again")
def test_the_demo_stays_or_is_refused_where_it_may_not_overwrite(demo, tmp_path):
    folder = shutil.copytree(demo[0].folder, tmp_path / "result")
    again, _ = make_demo(folder, overwrite=False)
    assert again.manifest["identity"] == demo[0].manifest["identity"]
    flgpr.detect(sample_lane() / "run.zarr", "demo", tmp_path / "other", report=False)
    with pytest.raises(FileExistsError, match="overwrite"):
        make_demo(tmp_path / "other", overwrite=False)


def test_replay_finds_the_same_and_notices_another_run(demo, tmp_path):
    assert replay(demo[0].folder) == {
        "identical": True,
        "agrees": True,
        "files": [],
        "difference": 0.0,
    }
    run = open_run(sample_lane() / "run.zarr").load()
    save_run(run.assign(signal=1.5 * run["signal"]), tmp_path / "louder.zarr")
    with pytest.raises(ValueError, match="must be the one the result was made of"):
        replay(demo[0].folder, tmp_path / "louder.zarr")


@pytest.mark.slow("runs the demo again")
def test_replay_tells_a_result_that_differs(demo, tmp_path):
    other = recipe_text("demo").replace('window = "hann"', 'window = "taylor"')
    folder = shutil.copytree(demo[0].folder, tmp_path / "result")
    (folder / "recipe.toml").write_text(other)
    manifest = parse_with_digest((folder / "manifest.json").read_bytes())
    del manifest["sha256"]
    manifest["files"]["recipe.toml"] = sha256(other.encode())
    manifest["sizes"]["recipe.toml"] = len(other.encode())
    (folder / "manifest.json").write_bytes(json_with_digest(manifest))
    outcome = replay(folder)
    assert not outcome["identical"]
    assert not outcome["agrees"]
    assert "run_view.npz" in outcome["files"]


def test_detection_needs_no_truth_and_scoring_adds_it_later(demo, untold):
    pd.testing.assert_frame_equal(untold.detections[0].alarms, demo[0].detections[0].alarms)
    assert not (untold.folder / "roc.json").exists()
    assert "Not scored" in (untold.folder / "report.html").read_text()


def test_a_nan_sweep_masks_its_scan_and_is_counted(tmp_path):
    run = open_run(sample_lane() / "run.zarr").load()
    run["signal"][1, 2, 7, 50] = np.nan
    run["valid"][1, 2, 7] = False
    save_run(run, tmp_path / "run.zarr")
    result = flgpr.detect(tmp_path / "run.zarr", "demo", tmp_path / "result")
    assert result.manifest["run"]["masked_scans"] == [1]
    assert result.manifest["run"]["missing_sweeps"] == 1
    assert result.detections[0].view["looks"].max() == 2
    assert "1 sweeps are missing" in (tmp_path / "result" / "report.html").read_text()


def test_an_altered_result_is_refused(demo, tmp_path):
    shutil.copytree(demo[0].folder, tmp_path / "result")
    (tmp_path / "result" / "alarms.csv").write_text("x,y,confidence\n0,3,99\n")
    with pytest.raises(ResultError, match=r"alarms\.csv differs"):
        read_result(tmp_path / "result")
    (tmp_path / "result" / "manifest.json").unlink()
    with pytest.raises(ResultError, match=r"manifest\.json"):
        read_result(tmp_path / "result")


def test_output_never_overwrites_other_files(tmp_path):
    (tmp_path / "notes.txt").write_text("mine")
    with pytest.raises(FileExistsError, match="other files"):
        make_demo(tmp_path)
    assert [p.name for p in tmp_path.iterdir()] == ["notes.txt"]


def test_a_channel_the_run_lacks_is_named():
    run = open_run(sample_lane() / "run.zarr").isel(polarization=[3])
    with pytest.raises(ValueError, match=r"prescreen\.polarization.*VV.*'HH'"):
        detect(run, load_recipe("demo"))
