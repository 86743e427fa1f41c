"""Fixtures of the tests of commands."""

import pytest

from io_geodesy import anchor_text

LANE_TOML = "x_min = -2.0\nx_max = 2.0\ny_min = 0.0\ny_max = 60.0\n"


@pytest.fixture(scope="session")
def anchor(tmp_path_factory):
    """Path of an anchor (TOML) whose points were surveyed by geodesics."""
    path = tmp_path_factory.mktemp("anchor") / "anchor.toml"
    path.write_text(anchor_text())
    return path


@pytest.fixture
def scoring_files(tmp_path):
    """Folder of a lane, a recipe, a truth, an alarm list and the sorts of targets of a plan."""
    (tmp_path / "lane.toml").write_text(LANE_TOML)
    (tmp_path / "recipe.toml").write_text("name = 'x'\n")
    (tmp_path / "truth.csv").write_text(
        "target_id,x,y,kind,depth\na,0,10,metal,0\nb,1,30,plastic,0.05\n"
    )
    (tmp_path / "alarms.csv").write_text("x,y,confidence\n0.1,10.2,3\n-1,50,2\n1,30,1\n")
    (tmp_path / "sorts.csv").write_text("kind,depth,count\nmetal,0.05,5\nplastic,0.1,3\n")
    return tmp_path
