"""What ``flgpr train`` refuses before it works, and what it ends in."""

from types import SimpleNamespace

import pytest
from typer.testing import CliRunner

from flgpr.commands.app import app
from flgpr.commands.train import _train_lines, train
from flgpr.method.model import Model
from flgpr.store import sample_lane

RUN = sample_lane() / "run.zarr"
TRUTH = sample_lane() / "truth.csv"


@pytest.mark.parametrize(
    ("runs", "truths", "lanes", "counts"),
    [
        ([RUN, RUN], [TRUTH], None, "got 2 runs and 1 truths"),
        ([], [], None, "got 0 runs and 0 truths"),
    ],
)
def test_every_run_has_its_truth(runs, truths, lanes, counts):
    with pytest.raises(ValueError, match=f"train needs one truth per run, {counts}"):
        train(runs, truths, lanes=lanes)


def test_every_run_has_its_lane():
    with pytest.raises(ValueError, match="lane must be given once per run, got 2 for 1 runs"):
        train([RUN], [TRUTH], lanes=["a.toml", "b.toml"])


@pytest.mark.parametrize("recipe", ["demo", "demo-mean-self-signature"])
def test_a_recipe_in_which_nothing_learns_is_refused_before_a_run_is_read(recipe, tmp_path):
    run = tmp_path / "no-such-run.zarr"
    words = ["train", str(run), "--truth", str(TRUTH), "--recipe", recipe]
    done = CliRunner().invoke(app, [*words, "-o", str(tmp_path / "model")])
    assert done.exit_code == 2
    assert f"recipe must have features or a stage that learns to train, got {recipe}" in done.output
    assert not (tmp_path / "model").exists()


def test_a_run_of_a_name_must_come_once_per_run():
    with pytest.raises(ValueError, match="with must give low once per run, got 2 for 1 runs"):
        train([RUN], [TRUTH], others=["low=a.zarr", "low=b.zarr"])


def test_training_ends_in_what_it_was_learnt_from(tmp_path):
    notes = {"hits": 12, "false_alarms": 67, "lanes": ["1:a", "2:b"]}
    call = SimpleNamespace(output=tmp_path / "model")
    _, learnt = _train_lines(Model(notes=notes), call)
    assert learnt == "learnt from 12 alarms at targets and 67 elsewhere, on 2 lanes"
