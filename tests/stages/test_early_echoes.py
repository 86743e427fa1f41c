"""The stage `early` takes out what arrives before the nearest pixel of the images."""

import numpy as np
import pytest

from flgpr.method.imaged_run import ImagedRun
from flgpr.model import Lane
from flgpr.recipe.schema import parse_recipe, recipe_text
from flgpr.store import open_run, sample_lane

LANE = Lane(-1.0, 1.0, 2.0, 6.2)
EARLY = '[[clutter]]\nstage = "early"\n'


@pytest.fixture(scope="module")
def run():
    return open_run(sample_lane() / "run.zarr")


def setup(run, added):
    return ImagedRun(run, parse_recipe(recipe_text("miniature") + added), LANE, explains=False)


def test_the_path_is_that_by_way_of_the_nearest_pixel(run):
    stage = setup(run, EARLY).clutter_stages["clutter.early"]
    # A transmitter at x = -0.9 m and the receiver nearest to it, 1.5 and 1.47 m above the ground
    # 1.2 m ahead.
    apart = np.abs(run["rx_position"].values[:, 0] + 0.9).min()
    heights = 1.5 + 1.47
    assert stage.notes()["early_path"] == pytest.approx(
        np.sqrt(apart**2 + heights**2 + (2 * 1.2) ** 2), abs=5e-3
    )


def test_a_path_may_be_given(run):
    stage = setup(run, EARLY + "path = 2.5\n").clutter_stages["clutter.early"]
    assert stage.notes()["early_path"] == 2.5
    with pytest.raises(ValueError, match="path"):
        setup(run, EARLY + "path = -1.0\n")


def test_the_direct_wave_of_the_full_wave_lane_no_longer_covers_a_narrow_sub_band(run):
    narrow = recipe_text("miniature").replace("F0 = [0.45e9, 1.5e9]", "F0 = [0.45e9, 0.6e9]")
    levels = []
    for added in ("", EARLY):
        lane = ImagedRun(run, parse_recipe(narrow + added), LANE, explains=False)
        image = np.abs(lane.scan_image(0).sel(polarization="HH", subband="F0").values)
        levels.append(20 * np.log10(np.median(image)))
    assert levels[0] - levels[1] > 20
