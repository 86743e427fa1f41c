import numpy as np
import pandas as pd
import pytest

from flgpr.io import open_run, read_lane, read_table
from flgpr.model import Sensor, load_sensor
from flgpr.pipeline.simulation import preview_figure, simulate_to_store
from flgpr.simulate import Scene, simulate


@pytest.fixture
def small():
    data = load_sensor("sri-array").model_dump()
    data["rx"], data["tones"] = data["rx"][::6], {"start": 600e6, "step": 20e6, "count": 64}
    scene = Scene(
        site="arid-sand",
        length=12.0,
        surface={"density": 5.0},
        draws=[{"kind": "metal", "depth": 0.05, "count": 2}],
        track={"positions": (0.0, 1.5, 3.0)},
    )
    return scene, Sensor.model_validate(data)


def test_a_stored_lane_is_the_simulated_one(small, tmp_path):
    scene, sensor = small
    written = simulate_to_store(scene, sensor, 5, tmp_path / "lane.zarr")
    run, truth = simulate(scene, sensor, 5)
    stored = open_run(tmp_path / "lane.zarr")
    np.testing.assert_array_equal(stored["signal"].values, run["signal"].values)
    np.testing.assert_array_equal(stored["pose"].values, run["pose"].values)
    got = read_table(tmp_path / "lane-truth.csv", "truth")
    pd.testing.assert_frame_equal(got, truth, check_dtype=False)
    assert read_lane(tmp_path / "lane-lane.toml") == scene.lane
    assert all(path.exists() for path in written)
    with pytest.raises(FileExistsError):
        simulate_to_store(scene, sensor, 5, tmp_path / "lane.zarr")


def test_the_preview_draws_every_target(small, tmp_path):
    scene, _ = small
    figure = preview_figure(scene, 5)
    figure.savefig(tmp_path / "preview.png")
    labels = [text.get_text() for text in figure.axes[0].get_legend().get_texts()]
    assert "metal (2)" in labels
