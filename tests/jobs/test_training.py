"""Which recipes train a detector, and the lanes of a training."""

import pytest

import flgpr
from flgpr.jobs.job import make_job
from flgpr.jobs.training import TrainingLane, learns_detector, train_on_lanes
from flgpr.jobs.workers import DEFAULTS
from flgpr.method.model import load_model
from flgpr.recipe.schema import parse_recipe, recipe_text
from flgpr.store import read_table, save_run
from small_lane import LANE_TOML, small_recipe, small_run

TRUTH = "target_id,x,y,kind,depth,radius,height\nT1,0.2,4.5,metal,0.1,0.15,0.1\n"


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


def lane_job(home):
    return make_job(
        home / "run.zarr", small_recipe(), home / "lane.toml", home / "m", truth=home / "truth.csv"
    )


def test_a_lane_has_the_borders_and_the_name_of_its_job(home):
    lane = TrainingLane(lane_job(home), read_table(home / "truth.csv", "truth"))
    assert lane.name == "run"
    assert (lane.area.x_min, lane.area.x_max) == (-0.75, 0.75)


def test_a_truth_that_is_not_valid_is_named(home):
    (home / "truth.csv").write_text("target_id,x\nT1,0.2\n")
    with pytest.raises(ValueError, match=r"truth\.csv"):
        train_on_lanes([lane_job(home)], home / "m", (), 1.0, DEFAULTS, overwrite=True)
    assert not (home / "m").exists()


def test_a_detector_reads_the_magnitude_beside_features_where_it_is_named(home):
    named = ("magnitude", "C_*")
    train_on_lanes([lane_job(home)], home / "m", named, 1.0, DEFAULTS, overwrite=True)
    detector = load_model(home / "m").detector
    assert detector.features[0] == "magnitude"
    assert len(detector.features) > 1
    (home / "recipe.toml").write_text(small_recipe())
    of_run = {"recipe": home / "recipe.toml", "model": home / "m", "lane": home / "lane.toml"}
    found = flgpr.detect(home / "run.zarr", **of_run)
    assert len(found.alarms)
