import errno
import json
import os

import numpy as np
import pytest
from typer.testing import CliRunner

from flgpr.commands.app import app
from flgpr.commands.run_report import run_info
from flgpr.store import open_run, sample_lane, save_run
from flgpr.store.bundle import write_bundle

RUN = str(sample_lane() / "run.zarr")


def call(*arguments):
    return CliRunner().invoke(app, list(map(str, arguments)))


def test_import_detect_and_score_a_lane_from_its_archive(fullwave_archive, tmp_path):
    """What a user does with a lane of their own."""
    assert call("import", "fullwave", fullwave_archive, "-o", tmp_path / "b.zarr").exit_code == 0
    assert open_run(tmp_path / "b.zarr").sizes["scan"] == 3
    found = call(
        "detect", tmp_path / "b.zarr", "--recipe", "demo", "-o", tmp_path / "result", "--json"
    )
    assert found.exit_code == 0, found.output
    assert json.loads(found.stdout)["alarms"] > 3
    truth = tmp_path / "b-truth.csv"
    objects = tmp_path / "b-objects.csv"
    scored = call(
        "score",
        tmp_path / "result" / "alarms.csv",
        "--truth",
        truth,
        "--objects",
        objects,
        "--json",
    )
    assert scored.exit_code == 0, scored.output
    summary = json.loads(scored.stdout)
    assert summary["targets"] == 3
    assert summary["found"] == sum(
        o["detected"] for o in summary["outcomes"] if o["detection"] == "main"
    )


def test_a_lane_without_targets_is_scored_by_its_false_alarms(demo, tmp_path):
    (tmp_path / "truth.csv").write_text("target_id,x,y,kind,depth\n")
    scored = call(
        "score", demo[0].folder, "--truth", tmp_path / "truth.csv", "-o", tmp_path / "score"
    )
    assert scored.exit_code == 0, scored.output
    assert "no targets" in scored.stdout
    roc = json.loads((tmp_path / "score" / "roc.json").read_text())
    main = roc["detections"]["main"]
    assert main["pd_mean"] is None
    assert main["points"][-1]["n_false"] == main["n_false"] > 0


def test_info_says_it_in_words_and_as_json(tmp_path):
    words = call("info", RUN, "--recipe", "demo", "--plot", tmp_path / "info.png").stdout
    for text in (
        "3 over 1.00 m",
        "142 from 0.4425 to 1.5 GHz",
        "none missing",
        "unambiguous to 40.0 m",
        "looks",
    ):
        assert text in words
    assert (tmp_path / "info.png").read_bytes().startswith(b"\x89PNG")
    told = json.loads(call("info", RUN, "--json").stdout)
    assert told["pairs"] == 32
    assert told["unambiguous_path_m"] == pytest.approx(39.97, abs=0.01)


def test_info_tells_which_recipes_fit_and_why_others_do_not():
    told = json.loads(call("info", RUN, "--recipes", "--json").stdout)["recipes"]
    assert told["demo"] == told["miniature"] == []
    assert any("echoes repeat after 39.97 m of path" in one for one in told["wang2007"])
    words = call("info", RUN, "--recipe", "wang2007").stdout
    assert "wang2007: image.subbands.F4 must lie in the run's band" in words
    assert "recipe for RUN" in words
    assert "demo fits" in call("info", RUN, "--recipe", "demo").stdout


def test_info_warns_of_an_array_that_no_vehicle_carries_or_that_lies_on_the_ground(tmp_path):
    run = open_run(RUN)
    pose = run["pose"].values.copy()
    pose[:, 2] = 0.0
    save_run(
        run.assign(pose=(run["pose"].dims, pose), tx_position=40 * run["tx_position"]),
        tmp_path / "odd.zarr",
    )
    shown = call("info", tmp_path / "odd.zarr", "--plot", tmp_path / "odd.png")
    assert shown.exit_code == 0, shown.output
    words = " ".join(shown.stdout.split())
    assert "72.00 m across" in words
    assert "antennas lie up to 72 m apart, more than 10 m" in words
    assert "m above the ground on average" in words
    assert not run_info(RUN)["warnings"]


def test_coverage_lies_where_the_vehicle_heads(tmp_path):
    run = open_run(RUN)
    pose = run["pose"].values.copy()
    pose[:, [0, 1, 3]] = np.stack([pose[:, 1], 0 * pose[:, 1], 0 * pose[:, 1] + np.pi / 2], axis=1)
    save_run(run.assign(pose=(run["pose"].dims, pose)), tmp_path / "rail.zarr")
    ahead = run_info(RUN)
    across = run_info(tmp_path / "rail.zarr")
    assert across["lane"]["x"] == pytest.approx(ahead["lane"]["y"])
    assert across["lane"]["y"] == pytest.approx(ahead["lane"]["x"])
    assert across["looks"]["unseen_share"] < 0.1


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["info", "nowhere.zarr"], ["nowhere.zarr"]),
        (["detect", RUN, "--recipe", "none", "-o", "x"], ["recipe", "demo"]),
        (["detect", RUN, "--lane", "no.toml", "-o", "x"], ["no.toml"]),
        (["score", "no-result", "--truth", "t.csv"], ["manifest.json"]),
        (["import", "fullwave", "no.npz", "-o", "x.zarr"], ["no.npz"]),
        (["import", "gprmax", "decks", "-o", "x.zarr"], ["decks", "not found"]),
        (["score", "a.csv", "--truth", "t.csv"], ["--lane", "a.csv"]),
        (["design", "sri-array", "--site", "moon"], ["site", "arid-sand", "'moon'"]),
    ],
)
def test_what_the_user_can_mend_is_one_line(arguments, words, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    result = call(*arguments)
    assert result.exit_code == 2
    assert result.stderr.startswith("error: ")
    assert result.stderr.count("\n") == 1
    for word in words:
        assert word in result.stderr
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("number", "words"),
    [(errno.ENOSPC, "the disk must have room"), (errno.EIO, "the disk must work")],
)
def test_a_full_disk_is_told_in_a_line_and_the_same_command_goes_on(
    number, words, tmp_path, monkeypatch
):
    written = []

    def write(path, arrays):
        if len(written) == 2:
            raise OSError(number, os.strerror(number))
        written.append(path)
        write_bundle(path, arrays)

    command = "detect", RUN, "--recipe", "demo", "-o", tmp_path / "result", "--quiet"
    with monkeypatch.context() as patch:
        patch.setattr("flgpr.execution.checkpoint.write_bundle", write)
        result = call(*command)
    assert not (tmp_path / "result").exists()
    assert result.exit_code == 2
    assert result.stderr.startswith(f"error: {words}")
    assert result.stderr.count("\n") == 1
    assert call(*command).exit_code == 0
    assert (tmp_path / "result" / "alarms.csv").is_file()


def test_an_empty_lane_is_refused(tmp_path):
    lane = tmp_path / "lane.toml"
    lane.write_text("x_min = 0\nx_max = 0\ny_min = 2\ny_max = 6\n")
    result = call("detect", RUN, "--lane", lane, "-o", tmp_path / "result")
    assert result.exit_code == 2
    assert "empty lane" in result.stderr
    assert not (tmp_path / "result").exists()


def test_version():
    assert call("--version").stdout.startswith("flgpr ")


def test_recipes_can_be_listed_shown_and_checked(tmp_path):
    assert "demo" in call("recipe", "list").stdout
    text = call("recipe", "show", "demo").stdout
    path = tmp_path / "mine.toml"
    path.write_text(text.replace("halo = 0.5", "halo = 0"))
    result = call("recipe", "check", path)
    assert result.exit_code == 2
    assert "score.halo" in result.stderr
    assert "line " in result.stderr
    path.write_text(text)
    assert "good" in call("recipe", "check", path).stdout


def test_replay_says_identical(demo):
    assert "identical" in call("replay", demo[0].folder, "--quiet").stdout


def test_a_scene_is_drawn_or_simulated(tmp_path):
    scene = tmp_path / "scene.toml"
    scene.write_text(
        'name = "yard"\nsite = "gravel"\nlength = 8.0\n[surface]\ndensity = 2.0\n[track]\npositions = [0.0]\n'
        '[[draws]]\nkind = "metal"\ndepth = 0.05\ncount = 1\n'
    )
    drawn = call("simulate", scene, "--preview", tmp_path / "scene.png")
    assert drawn.exit_code == 0, drawn.output
    assert sorted(p.name for p in tmp_path.iterdir()) == ["scene.png", "scene.toml"]
    made = call("simulate", scene, "-o", tmp_path / "yard.zarr", "--seed", 3, "--quiet")
    assert made.exit_code == 0, made.output
    assert open_run(tmp_path / "yard.zarr").attrs["seed"] == 3
    scene.write_text("length = -1")
    failed = call("simulate", scene, "-o", tmp_path / "x.zarr")
    assert failed.exit_code == 2
    assert "length" in failed.stderr


def test_a_plan_is_drawn_registered_and_counted(tmp_path):
    words = call("plan", "mines", "--pd", 0.9, "--far", 0.01).stdout
    assert "29 mines" in words
    (tmp_path / "lane.toml").write_text("x_min = -1.5\nx_max = 1.5\ny_min = 0\ny_max = 60\n")
    (tmp_path / "sorts.csv").write_text("kind,depth,count\nmetal,0.05,3\nplastic,0.1,2\n")
    made = call(
        "plan", "lane", tmp_path / "lane.toml", tmp_path / "sorts.csv", "-o", tmp_path / "plan.csv"
    )
    assert made.exit_code == 0, made.output
    assert "5 targets" in made.stdout
    assert len((tmp_path / "plan.csv").read_text().splitlines()) == 6


def test_nobody_types_a_passphrase_in_vain(tmp_path, monkeypatch):
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    told = call("score", "plan.csv", "--seal", "--lane", "lane.toml", "-o", tmp_path / "sealed")
    assert told.exit_code == 2
    assert "passphrase" not in told.output
    assert "flgpr[seal]" in told.output


def test_an_alarm_list_of_any_detector_is_scored_open_or_sealed(tmp_path):
    pytest.importorskip("cryptography")
    (tmp_path / "lane.toml").write_text("x_min = -1.5\nx_max = 1.5\ny_min = 0\ny_max = 60\n")
    (tmp_path / "truth.csv").write_text(
        "target_id,x,y,kind,depth\na,0,10,metal,0.05\nb,0.5,30,plastic,0.1\n"
    )
    (tmp_path / "alarms.csv").write_text("x,y,confidence\n0.1,10.2,5\n-1,50,3\n0.4,30.1,2\n")
    lane = tmp_path / "lane.toml"
    alarms = tmp_path / "alarms.csv"
    truth = tmp_path / "truth.csv"
    done = call(
        "score", alarms, "--truth", truth, "--lane", lane, "-o", tmp_path / "score", "--json"
    )
    assert done.exit_code == 0, done.output
    assert (tmp_path / "score" / "report.html").exists()
    sealing = ["score", str(truth), "--seal", "--lane", str(lane), "-o", str(tmp_path / "sealed")]
    made = CliRunner().invoke(
        app, sealing, input="gravel otter seven lamps\ngravel otter seven lamps\n"
    )
    assert made.exit_code == 0, made.output
    assert b"plastic" not in (tmp_path / "sealed").read_bytes()
    assert "at least 8 characters" in made.output.split("\n")[0]
    blind = [
        "score",
        str(alarms),
        "--sealed",
        str(tmp_path / "sealed"),
        "-o",
        str(tmp_path / "blind"),
    ]
    told = CliRunner().invoke(app, blind, input="gravel otter seven lamps\n")
    assert told.exit_code == 0, told.output
    assert "n_targets 2" in told.stdout
    assert "look 1" in told.stdout
