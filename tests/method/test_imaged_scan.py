"""One scan of a lane, as the passes see it."""

import numpy as np
import pytest

from divided import recorded, results_of_lane, setup
from flgpr.method.passes.traversal import ImagedScan
from small_lane import small_recipe

NEAR = small_recipe().replace("y_max = 4.5", "y_max = 3.5", 1)


@pytest.fixture(scope="module")
def lane():
    """The small lane with images that count less far ahead than they are made."""
    return setup(NEAR, results=dict(results_of_lane()))


def test_fewer_rows_count_than_are_made(lane):
    assert lane.near.ny < lane.imager.grid.ny


def test_number_pose_and_gain_are_those_of_its_scan(lane):
    scan = ImagedScan(lane, 4)
    assert scan.number == int(lane.imager.scans[4])
    np.testing.assert_array_equal(scan.pose, recorded()["pose"].values[scan.number])
    np.testing.assert_array_equal(scan.gain, lane.results["gain"]["gains"][4])


def test_an_image_is_made_once_and_reaches_as_far_as_counts(lane):
    scan = ImagedScan(lane, 3)
    assert scan.near_image is scan.near_image
    assert scan.near_image.sizes["y"] == lane.near.ny
    rows = lane.near.ny
    whole = lane.scan_image(3).values
    # Other pixels make another grid of the operator, which keeps the recipe's tolerance.
    atol = lane.recipe.image.tolerance * np.abs(whole).max()
    np.testing.assert_allclose(scan.near_image.values, whole[..., :rows, :], atol=atol)


def test_the_magnitude_is_in_units_of_the_background(lane):
    """Wang et al. 2007, Eq. 5, written out."""
    scan = ImagedScan(lane, 5)
    gain = lane.results["gain"]
    rows = lane.near.ny
    signature = gain["signature"][..., :rows, :]
    level = gain["gain"][..., :rows, :]
    wanted = np.abs(scan.near_image.values / scan.gain[..., None, None] - signature) / level
    np.testing.assert_allclose(scan.magnitude(), wanted, rtol=1e-4, atol=1e-5)


def test_data_are_read_for_images_alone_where_nothing_is_explained(lane):
    assert ImagedScan(lane, 1).data is None
