"""Which recipes train a detector, and the lanes of a training."""

import pytest

from flgpr.jobs.training import learns_detector, training_lanes
from flgpr.recipe.schema import parse_recipe, recipe_text
from flgpr.store import save_run
from small_lane import LANE_TOML, small_recipe, small_run

TRUTH = "target_id,x,y,kind,depth,radius,height\nT1,0.2,4.5,metal,0.1,0.15,0.1\n"
GIGABYTE = 10**9


def test_a_recipe_with_a_detector_or_features_to_train_on_learns_one():
    assert learns_detector(parse_recipe(recipe_text("flsar2004")), ())
    plain = parse_recipe(small_recipe())
    assert plain.detector is None
    assert learns_detector(plain, ["C_*"])


def test_the_detector_of_a_recipe_without_features_reads_what_is_named():
    demo = parse_recipe(recipe_text("demo"))  # columns of a stage, and none of the ten features
    assert not learns_detector(demo, ())
    assert learns_detector(demo, ["roadside*"])


@pytest.fixture
def home(tmp_path):
    save_run(small_run(scans=4), tmp_path / "run.zarr")
    (tmp_path / "truth.csv").write_text(TRUTH)
    (tmp_path / "lane.toml").write_text(LANE_TOML)
    return tmp_path


def test_every_run_has_its_truth_and_borders(home):
    recipe = parse_recipe(small_recipe())
    runs, truths, borders = [home / "run.zarr"], [home / "truth.csv"], [home / "lane.toml"]
    (lane,) = training_lanes(recipe, runs, truths, borders, [{}], GIGABYTE)
    assert lane.run == home / "run.zarr"
    assert lane.targets["target_id"].tolist() == ["T1"]
    assert (lane.area.x_min, lane.area.x_max) == (-0.75, 0.75)


def test_a_truth_that_is_not_valid_is_named(home):
    (home / "truth.csv").write_text("target_id,x\nT1,0.2\n")
    recipe = parse_recipe(small_recipe())
    with pytest.raises(ValueError, match=r"truth\.csv"):
        training_lanes(
            recipe, [home / "run.zarr"], [home / "truth.csv"], [home / "lane.toml"], [{}], GIGABYTE
        )
