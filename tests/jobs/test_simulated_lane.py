"""A simulated lane, scan by scan into a run store."""

import numpy as np
import pandas as pd
import pytest

from flgpr.jobs.simulated_lane import simulate_to_store
from flgpr.model import Sensor, load_sensor
from flgpr.simulate import Scene, simulate
from flgpr.store import open_run, read_lane, read_table


@pytest.fixture
def small():
    data = load_sensor("sri-array").model_dump()
    data["rx"] = data["rx"][::6]
    data["tones"] = {"start": 600e6, "step": 5e6, "count": 64}
    scene = Scene(
        site="arid-sand",
        length=12.0,
        surface={"density": 5.0},
        draws=[{"kind": "metal", "depth": 0.05, "count": 2}],
        track={"positions": (0.0, 1.5, 3.0)},
    )
    return scene, Sensor.model_validate(data)


@pytest.mark.slow("simulates and detects twice")
def test_a_stored_lane_is_the_simulated_one(small, tmp_path, caplog):
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
    with pytest.raises(FileExistsError, match=r"its seed is 5, this one's 6"):
        simulate_to_store(scene, sensor, 6, tmp_path / "lane.zarr")
    with pytest.raises(FileExistsError, match=r"its errors is true"):
        simulate_to_store(scene, sensor, 5, tmp_path / "lane.zarr", errors=False)
    with caplog.at_level("INFO", "flgpr.outputs"):
        simulate_to_store(scene, sensor, 5, tmp_path / "lane.zarr")
    assert "lane.zarr exists already" in caplog.text
    simulate_to_store(scene, sensor, 5, tmp_path / "again.zarr", truth=tmp_path / "key.csv")
    assert (tmp_path / "key.csv").read_bytes() == (tmp_path / "lane-truth.csv").read_bytes()
    assert not (tmp_path / "again-truth.csv").exists()


def test_no_file_beside_a_lane_is_replaced_and_one_that_is_gone_is_written_again(small, tmp_path):
    scene, sensor = small
    scene = scene.model_copy(update={"track": scene.track.model_copy(update={"positions": (0.0,)})})
    store = tmp_path / "lane.zarr"
    for name in ("lane-truth.csv", "lane-objects.csv", "lane-lane.toml"):
        (tmp_path / name).write_text("surveyed by hand\n")
        with pytest.raises(FileExistsError, match=name):
            simulate_to_store(scene, sensor, 5, store)
        assert (tmp_path / name).read_text() == "surveyed by hand\n"
        assert not store.exists()
        (tmp_path / name).unlink()
    with pytest.raises(ValueError, match=r"truth must be another file than the output, got"):
        simulate_to_store(scene, sensor, 5, store, truth=store)
    with pytest.raises(FileExistsError, match=r"lane-lane\.toml"):
        simulate_to_store(scene, sensor, 5, store, truth=tmp_path / "lane-lane.toml")
    (tmp_path / "lane-lane.toml").unlink()
    written = simulate_to_store(scene, sensor, 5, store)
    assert store in written
    truth = (tmp_path / "lane-truth.csv").read_bytes()
    assert simulate_to_store(scene, sensor, 5, store) == []
    (tmp_path / "lane-truth.csv").unlink()
    assert simulate_to_store(scene, sensor, 5, store) == [tmp_path / "lane-truth.csv"]
    assert (tmp_path / "lane-truth.csv").read_bytes() == truth
