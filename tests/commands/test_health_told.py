"""What is wrong with a radar is told by ``flgpr info`` and ``detect``, and left out of the result."""

import json

import numpy as np
import pytest
from typer.testing import CliRunner

from flgpr.commands.app import app
from flgpr.commands.detect import detect
from flgpr.commands.replay import replay
from flgpr.commands.run_report import run_info
from flgpr.jobs.job import make_job
from flgpr.jobs.pieces import open_lane
from flgpr.model import make_run
from flgpr.results.description import check_description
from flgpr.results.result import read_result
from flgpr.store import save_run
from small_lane import LANE, TARGETS, small_recipe, small_run


@pytest.fixture(scope="module")
def home(tmp_path_factory):
    """The small lane, clean and with faults."""
    folder = tmp_path_factory.mktemp("health")
    (folder / "recipe.toml").write_text(small_recipe())
    run = small_run()
    save_run(run, folder / "clean.zarr")
    signal = run["signal"].values.copy()
    rng = np.random.default_rng(1)

    def store(name, change):
        faulty = signal.copy()
        change(faulty)
        parts = [
            run[part].values
            for part in ("frequency", "polarization", "tx_position", "rx_position", "pose")
        ]
        save_run(make_run(faulty, *parts), folder / f"{name}.zarr")

    def disturb(faulty):
        level = np.sqrt(1000 * np.mean(np.abs(signal) ** 2))
        noise = rng.normal(size=(2, *faulty.shape[:3], 2))
        faulty[..., [20, 50]] += level * (noise[0] + 1j * noise[1])

    def hot(faulty):
        faulty[:, :, 3] *= 1e4

    def lost(faulty):
        faulty[:, :, 3] = np.nan

    def tone(faulty):
        faulty[:, 0, 3, 30] = np.nan

    for name, change in (("disturbed", disturb), ("hot", hot), ("lost", lost), ("tone", tone)):
        store(name, change)
    detect(folder / "clean.zarr", folder / "recipe.toml", folder / "clean", lane=LANE)
    return folder


def found(alarms):
    """Return how many targets have one of the six strongest alarms within 0.5 m."""
    best = alarms.head(6)[["x", "y"]].to_numpy()
    return int((np.linalg.norm(best[:, None] - TARGETS, axis=-1).min(axis=0) < 0.5).sum())


@pytest.mark.parametrize(
    ("name", "finding", "entries"),
    [
        ("hot", "hot pairs", {"pairs": [3]}),
        pytest.param("lost", "missing pairs", {"pairs": [3]}, marks=pytest.mark.slow("detections")),
        pytest.param(
            "tone", "missing tones", {"tones": [30]}, marks=pytest.mark.slow("detections")
        ),
        pytest.param(
            "disturbed",
            "disturbed tones",
            {"tones": [20, 50]},
            marks=pytest.mark.slow("detections"),
        ),
    ],
)
def test_a_detection_tells_what_it_left_out_and_finds_what_it_found(home, name, finding, entries):
    words = ["detect", str(home / f"{name}.zarr"), "--recipe", str(home / "recipe.toml")]
    words += ["-o", str(home / name), "--json"]
    (home / "lane.toml").write_text("x_min = -0.75\nx_max = 0.75\ny_min = 3.0\ny_max = 10.0\n")
    run = CliRunner().invoke(app, [*words, "--lane", str(home / "lane.toml")])
    assert run.exit_code == 0, run.output
    [told] = json.loads(run.stdout)["health"]
    assert told["name"] == finding
    assert entries.items() <= told.items()
    assert "left out" in told["done"]
    assert told["value"] > told["limit"]
    result = read_result(home / name)
    assert result.manifest["run"]["health"] == [told]
    assert told["sentence"][1:] in (home / name / "report.html").read_text()
    assert found(result.alarms) >= found(read_result(home / "clean").alarms) - 1


def test_a_clean_detection_tells_nothing(home):
    result = read_result(home / "clean")
    assert "health" not in result.manifest["run"]
    assert found(result.alarms) == 3
    assert "findings" not in run_info(home / "clean.zarr")


def test_info_tells_a_fault_in_text_and_json(home):
    told = run_info(home / "hot.zarr")["findings"]
    assert [finding["name"] for finding in told] == ["hot pairs"]
    run = CliRunner().invoke(app, ["info", str(home / "hot.zarr")])
    [line] = [line for line in run.stdout.splitlines() if line.startswith("  fault")]
    assert (
        "pair 3 of HH, VV, HV: 80 dB over the median pair, at most 20 dB; 1 pair left out" in line
    )


def test_a_run_that_lacks_a_tone_in_every_scan_is_described(home):
    report = run_info(home / "tone.zarr")
    assert report["missing_sweeps"] == report["scans"]
    assert [finding["name"] for finding in report["findings"]] == ["missing tones"]


def test_the_same_left_out_is_part_of_what_a_job_is(home):
    text = small_recipe()
    clean = make_job(home / "clean.zarr", text, LANE, home / "a")
    hot = make_job(home / "hot.zarr", text, LANE, home / "b")
    assert "left_out" not in clean.identity
    assert "left_out" not in clean.lasting_identity
    assert hot.identity["left_out"] == hot.lasting_identity["left_out"] == [[3], []]


def test_a_run_taken_together_with_another_is_judged_too(home):
    """Its findings are told with its name, its pair is left out, and a replay leaves it out again."""
    job = make_job(
        home / "clean.zarr", small_recipe(), LANE, home / "beside", others={"x": home / "hot.zarr"}
    )
    [finding] = job.health.findings
    assert finding.sentence.startswith("run x: pair 3")
    assert not job.left_out
    assert [one.pairs for one in job.left_out_of_others] == [(3,)]
    lane, _ = open_lane(job)
    assert lane.run.sizes["pair"] == lane.setup.others["x"].sizes["pair"] + 1
    clean = make_job(
        home / "clean.zarr",
        small_recipe(),
        LANE,
        home / "beside",
        others={"x": home / "clean.zarr"},
    )
    assert clean.left_out_of_others == ()
    assert set(job.identity) - set(clean.identity) == {"left_out_of_others"}


def test_a_replay_leaves_out_what_the_result_left_out(home):
    result = detect(home / "hot.zarr", home / "recipe.toml", home / "replayed", lane=LANE)
    assert result.manifest["run"]["left_out"] == {"pairs": [3], "tones": []}
    assert replay(home / "replayed")["agrees"]


@pytest.mark.parametrize("value", [3, {"pairs": "all"}, {"tones": [-1]}, {"tones": [1.5]}])
def test_what_a_forged_manifest_says_was_left_out_is_checked(value):
    with pytest.raises(ValueError, match=r"run\.left_out.* must be"):
        check_description({"left_out": value})
