"""A model says which runs it was trained on, and a detection on one of them says so."""

import pytest
from typer.testing import CliRunner

from flgpr.commands.app import app
from flgpr.method.model import Model, save_model, trained_on
from flgpr.results.result import read_result
from flgpr.store import read_manifest, save_run
from robustness.test_flips import small_classifier
from small_lane import LANE_TOML, small_recipe, small_run

WARNING = "the model was trained on this very run"


def test_a_model_without_a_note_was_trained_on_nothing_known():
    assert not trained_on(None, "a")
    assert not trained_on(Model(), "a")
    assert not trained_on(Model(notes={"runs": "a"}), "a")
    assert trained_on(Model(notes={"runs": ["b", "a"]}), "a")


@pytest.mark.slow("trains and detects several times")
@pytest.mark.parametrize("is_trained_on_it", [True, False])
def test_a_detection_on_its_own_training_run_says_so(tmp_path, is_trained_on_it):
    save_run(small_run(), tmp_path / "road.zarr")
    digest = read_manifest(tmp_path / "road.zarr")["sha256"] if is_trained_on_it else "0" * 64
    model = save_model(small_classifier(), tmp_path / "model", {"runs": [digest]})
    (tmp_path / "lane.toml").write_text(LANE_TOML)
    (tmp_path / "own.toml").write_text(small_recipe())
    output = tmp_path / "out"
    words = ["detect", tmp_path / "road.zarr", "--recipe", tmp_path / "own.toml"]
    words += ["--lane", tmp_path / "lane.toml", "--model", model, "-o", output]
    done = CliRunner().invoke(app, [str(word) for word in words])
    assert done.exit_code == 0, done.output
    assert (WARNING in " ".join(done.output.split())) == is_trained_on_it
    assert ("trained on this very run" in (output / "report.html").read_text()) == is_trained_on_it
    stated = read_result(output).manifest["run"].get("trained_on_this_run", False)
    assert stated == is_trained_on_it
