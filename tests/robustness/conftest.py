"""One small lane, detected once, that every test of this folder compares with."""

import pytest

import flgpr
from flgpr.store import save_run
from robust import DetectedLane
from small_lane import LANE_TOML, small_recipe, small_run


@pytest.fixture(scope="session")
def lane(tmp_path_factory):
    home = tmp_path_factory.mktemp("lane")
    run = small_run(scans=36, step=0.21, tones=49).assign_attrs(title="small")
    save_run(run, home / "run.zarr")
    (home / "small.toml").write_text(small_recipe().replace("x = [-2.0, 2.0]", "x = [-1.5, 1.5]"))
    (home / "lane.toml").write_text(LANE_TOML)
    result = flgpr.detect(
        home / "run.zarr", home / "small.toml", home / "result", home / "lane.toml", report=False
    )  # fmt: skip
    return DetectedLane(home, result)
