"""Rivals after papers that could be read in part: trained on one lane, run on another, to the same bytes."""

import pandas as pd
import pytest

import flgpr
from flgpr.method.model import load_model
from small_lane import cut_down
from systems.lanes import small_recipe

pytestmark = pytest.mark.slow("trains three recipes on a simulated lane and runs them with workers")

COMPONENTS = cut_down(
    small_recipe("cosgrove2004"),
    [
        ('stage = "deflection" ', 'stage = "principal-components" '),
        ("ddof = 1 ", "edges = [4.0, 6.0, 8.0] "),
        ('polarization = "deflection"', 'polarization = "principal-components"'),
    ],
)
REFLECTIONS = (
    small_recipe("wang2007")
    + '\n[[columns]]\nstage = "time-frequency"\n'
    + '\n[detector]\nestimator = "svm"\nfeatures = ["tf_*"]\n'
)
KERNELS = (
    small_recipe("wang2007")
    + '\n[detector]\nestimator = "mkl"\nfeatures = ["C_*", "M_*", "R_*", "P_*"]\n'
)
RIVALS = {"components": COMPONENTS, "reflections": REFLECTIONS, "kernels": KERNELS}


@pytest.mark.parametrize("name", RIVALS)
def test_it_learns_from_training_lanes_and_gives_the_same_bytes(lanes, name, tmp_path):
    recipe = tmp_path / "rival.toml"
    recipe.write_text(RIVALS[name])
    lane = lanes / "lane.toml"
    known = [lanes / "train.zarr"], [lanes / "train.csv"]
    flgpr.train(*known, recipe, tmp_path / "model", lanes=[lane])
    flgpr.train(*known, recipe, tmp_path / "again", lanes=[lane], workers=2)
    bundles = [(tmp_path / folder / "model.bundle").read_bytes() for folder in ("model", "again")]
    assert bundles[0] == bundles[1]
    assert (
        load_model(tmp_path / "model").notes["runs"] == load_model(tmp_path / "again").notes["runs"]
    )

    where = lanes / "test.zarr", recipe
    options = {"model": tmp_path / "model", "report": False}
    flgpr.detect(*where, tmp_path / "one", lane, **options)
    flgpr.detect(*where, tmp_path / "two", lane, workers=2, **options)
    for file in ("alarms.csv", "features.csv", "run_view.npz"):
        assert (tmp_path / "one" / file).read_bytes() == (tmp_path / "two" / file).read_bytes()
    alarms = pd.read_csv(tmp_path / "one" / "alarms.csv")
    truth = pd.read_csv(lanes / "test.csv")
    nearest = ((alarms["x"].to_numpy()[:, None] - truth["x"].to_numpy()) ** 2
               + (alarms["y"].to_numpy()[:, None] - truth["y"].to_numpy()) ** 2).min(axis=1) ** 0.5  # fmt: skip
    hit = nearest < 0.75
    assert alarms["confidence"][hit].median() > alarms["confidence"][~hit].median()


def test_features_that_are_named_in_place_of_the_recipes_are_its_kernels(lanes, tmp_path):
    recipe = tmp_path / "rival.toml"
    recipe.write_text(KERNELS)
    model = flgpr.train(
        [lanes / "train.zarr"],
        [lanes / "train.csv"],
        recipe,
        tmp_path / "model",
        lanes=[lanes / "lane.toml"],
        features=["*_F2", "C_HH_*"],
    )
    assert model.detector.features[-1] == "C_HH_F1"
    assert model.detector.scorer.group.tolist() == [0] * 10 + [1]
