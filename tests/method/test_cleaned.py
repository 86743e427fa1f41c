"""A run's cleaned images, as far ahead as counts."""

import numpy as np
import pytest

from divided import SCANS, results_of_lane, setup
from small_lane import small_recipe

NEAR = small_recipe().replace("y_max = 4.5", "y_max = 3.5", 1)


@pytest.fixture(scope="module")
def lane():
    """The small lane with images that count less far ahead than they are made."""
    return setup(NEAR, results=dict(results_of_lane()))


def test_fewer_rows_count_than_are_made(lane):
    assert lane.near.ny < lane.imager.grid.ny


def test_images_are_those_of_the_nearest_rows(lane):
    assert len(lane) == SCANS
    assert lane.reads_data
    image = lane.near_image(6)
    whole = lane.scan_image(6).values
    near = whole[..., : lane.near.ny, :]
    # Other pixels make another grid of the operator, which keeps the recipe's tolerance.
    atol = lane.recipe.image.tolerance * np.abs(whole).max()
    np.testing.assert_allclose(image.values, near, atol=atol)
    assert image.attrs["scan"] == int(lane.imager.scans[6])


def test_data_that_were_read_already_give_the_same_image(lane):
    data = lane.imager.signal(int(lane.imager.scans[6]))
    np.testing.assert_array_equal(lane.near_image(6, data).values, lane.near_image(6).values)


def test_whole_images_that_are_in_memory_are_cut(lane, monkeypatch):
    asked = []
    make = lane.scan_image

    def whole_image(index):
        asked.append(index)
        return make(index)

    monkeypatch.setattr(lane, "in_memory", True)
    monkeypatch.setattr(lane, "scan_image", whole_image)
    assert not lane.reads_data
    assert lane.near_image(6).sizes["y"] == lane.near.ny
    assert asked == [6]


def test_the_coherent_image_keeps_the_phase_of_what_is_left(lane):
    """Each polarization has a gain of its own: what is left of Eq. 5 before its magnitude."""
    gain = lane.results["gain"]
    rows = lane.near.ny
    left = lane.near_image(3).values / gain["gains"][3][..., None, None]
    left = (left - gain["signature"][..., :rows, :]) / gain["gain"][..., :rows, :]
    found = lane.coherent(3)
    np.testing.assert_allclose(found.values, left, rtol=1e-3, atol=1e-4)
    assert found.attrs["scan"] == int(lane.imager.scans[3])
