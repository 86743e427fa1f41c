"""A run's images as a recipe wants them."""

import numpy as np
import pytest

from divided import recorded
from flgpr.method.imaged_run import ImagedRun, imager_of
from flgpr.model import lane_to_scan, scan_to_lane
from flgpr.recipe.schema import parse_recipe
from small_lane import LANE, small_recipe


def images_of(**changes):
    """Make the images of the small run by a recipe whose table of images has other entries."""
    recipe = parse_recipe(small_recipe())
    table = recipe.image.model_copy(update=changes)
    recipe = recipe.model_copy(update={"image": table})
    return ImagedRun(recorded(), recipe, LANE)


def test_an_imager_makes_the_subbands_and_polarizations_that_are_asked_for():
    table = parse_recipe(small_recipe()).image
    name = next(iter(table.subbands))
    imager = imager_of(recorded(), table, subbands=[name], polarizations=["VV"])
    image = imager.image(0)
    assert list(image["polarization"].values) == ["VV"]
    assert list(image["subband"].values) == [name]
    everything = imager_of(recorded(), table).image(0)
    same = everything.sel(polarization=["VV"], subband=[name]).values
    # Fewer tones make another grid of the operator, which keeps the recipe's tolerance.
    np.testing.assert_allclose(image.values, same, atol=table.tolerance * np.abs(same).max())


def test_plain_images_are_those_of_the_imager():
    images = images_of()
    assert images.plain
    assert [stage.passes() for stage in images.all_stages] == []
    np.testing.assert_array_equal(images.scan_image(2).values, images.imager.image(2).values)


def test_the_nearest_rows_of_an_image_are_those_of_all_of_it():
    images = images_of()
    whole = images.scan_image(2).values
    near = images.scan_image(2, rows=5).values
    assert near.shape[-2] >= 5
    np.testing.assert_array_equal(near[..., :5, :], whole[..., :5, :])


def test_only_the_polarizations_of_the_recipe_are_imaged():
    images = images_of(polarizations=("VV", "HH"))
    assert list(images.scan_image(0)["polarization"].values) == ["VV", "HH"]
    assert images.setup.imaged == [1, 0]


def test_summed_images_are_means_on_the_ground_ahead_of_the_latest_scan():
    """Fuse et al. 2018, Eq. 4, written out with the operators of single scans."""
    images = images_of(frames=3)
    assert not images.plain
    index = 5
    points = scan_to_lane(images.imager.grid.points(), images.setup.pose(index))
    total = 0.0
    for scan in range(index - 2, index + 1):
        places = lane_to_scan(points, images.setup.pose(scan))
        operator = images.imager.operator_on(scan, places, images.imager.subbands)
        total = total + operator.adjoint(images.setup.imager.signal(scan))
    found = images.scan_image(index)
    wanted = (total / 3).reshape(found.shape)
    scale = np.abs(wanted).max()
    np.testing.assert_allclose(found.values, wanted, atol=1e-3 * scale)


@pytest.mark.parametrize("index", [0, 1])
def test_the_first_scans_are_means_of_those_there_are(index):
    images = images_of(frames=3)
    alone = images_of()
    first = images.scan_image(index)
    assert first.attrs["scan"] == index
    if index == 0:
        np.testing.assert_array_equal(first.values, alone.scan_image(0).values)
    else:
        assert np.abs(first.values - alone.scan_image(1).values).max() > 0
