import errno
import json
import os

import pytest
from typer.testing import CliRunner

from flgpr.commands.app import app
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


@pytest.mark.slow("runs a whole command more than once")
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


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["info", "nowhere.zarr"], ["nowhere.zarr"]),
        (["detect", RUN, "--recipe", "none", "-o", "x"], ["recipe", "demo"]),
        (["detect", RUN, "--lane", "no.toml", "-o", "x"], ["no.toml"]),
        (["score", "no-result", "--truth", "t.csv"], ["no-result", "not found"]),
        (["import", "fullwave", "no.npz", "-o", "x.zarr"], ["no.npz"]),
        (["import", "gprmax", "decks", "-o", "x.zarr"], ["decks", "not found"]),
        (["score", "a.csv", "--truth", "t.csv"], ["a.csv", "not found"]),
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


@pytest.mark.slow("runs a whole command more than once")
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
        patch.setattr("flgpr.jobs.checkpoint.write_bundle", write)
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
    plan = tmp_path / "plan.csv"
    plan.write_text("target_id,x,y,kind\na,0,1,metal\n")
    refused = call("score", plan, "--seal", "--lane", "lane.toml", "-o", tmp_path / "sealed")
    assert refused.exit_code == 2
    assert "passphrase" not in refused.output
    assert "flgpr[seal]" in refused.output


def test_an_alarm_list_needs_a_lane(tmp_path):
    alarms = tmp_path / "a.csv"
    alarms.write_text("x,y,confidence\n0,1,2\n")
    refused = call("score", alarms, "--truth", "t.csv")
    assert refused.exit_code == 2
    assert "--lane" in refused.stderr
    assert "a.csv" in refused.stderr


@pytest.mark.slow("runs a whole command more than once")
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


def test_a_message_names_an_option_as_it_is_typed():
    refused = call("plan", "mines", "--true-pd", 0.5)
    assert refused.exit_code == 2
    assert refused.stderr == "error: --true-pd must be above pd = 0.9 and at most 1, got 0.5\n"


@pytest.mark.parametrize(
    "words",
    [
        ["detect", RUN, "--recipe", "demo", "-o", "/proc/x"],
        ["simulate", "signature", "m19", "-o", "/proc/x"],
        ["recipe", "for", RUN, "-o", "/proc/x"],
    ],
)
def test_an_output_that_cannot_be_made_is_named_as_it_was_typed(words):
    refused = call(*words)
    assert refused.exit_code == 2
    assert refused.stderr == (
        "error: file or folder must exist, got /proc/x: No such file or directory\n"
    )


def test_a_recipe_that_does_not_fit_is_named_with_what_the_run_lacks(tmp_path):
    save_run(open_run(RUN).isel(polarization=[0]), tmp_path / "hh.zarr")
    refused = call(
        "detect", tmp_path / "hh.zarr", "--recipe", "wang2007", "-o", tmp_path / "result"
    )
    assert refused.exit_code == 2
    assert refused.stderr.startswith("error: recipe wang2007 does not fit the run: ")
    assert "its features are of runs with HH, VV, and HV or VH, got a run with HH" in refused.stderr
    assert "must be left out" not in refused.stderr


def test_a_lane_for_each_run_is_asked_for_by_its_option(tmp_path):
    refused = call(
        "train", RUN, "--truth", "a.csv", "--lane", "a.toml", "--lane", "b.toml", "-o", tmp_path
    )
    assert refused.exit_code == 2
    assert refused.stderr == "error: lane must be given once per run, got 2 for 1 runs\n"
