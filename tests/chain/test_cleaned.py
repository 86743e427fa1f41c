"""A run's cleaned images, as far ahead as counts."""

import numpy as np
import pytest

from divided import SCANS, with_results
from flgpr.chain.cleaned import CleanedRun


@pytest.fixture(scope="module")
def lane():
    return with_results()


def test_images_are_those_of_the_nearest_rows(lane):
    cleaned = CleanedRun(lane.images, lane.results["gain"])
    assert len(cleaned) == SCANS
    assert cleaned.reads_data
    image = cleaned.scan(6)
    np.testing.assert_array_equal(image.values, lane.image(6).values[..., : cleaned.grid.ny, :])
    assert image.attrs["scan"] == int(lane.imager.scans[6])


def test_data_that_were_read_already_give_the_same_image(lane):
    cleaned = CleanedRun(lane.images, lane.results["gain"])
    data = lane.imager.signal(int(lane.imager.scans[6]))
    np.testing.assert_array_equal(cleaned.scan(6, data).values, cleaned.scan(6).values)


def test_whole_images_that_are_in_memory_are_cut(lane):
    asked = []

    def whole_image(index):
        asked.append(index)
        return lane.image(index)

    cleaned = CleanedRun(lane.images, lane.results["gain"], whole_image)
    assert not cleaned.reads_data
    assert cleaned.scan(6).sizes["y"] == cleaned.grid.ny
    assert asked == [6]


def test_the_coherent_image_keeps_the_phase_of_what_is_left(lane):
    """Each polarization has a gain of its own: what is left of Eq. 5 before its magnitude."""
    cleaned = CleanedRun(lane.images, lane.results["gain"])
    gain = lane.results["gain"]
    rows = cleaned.grid.ny
    left = cleaned.scan(3).values / gain["gains"][3][..., None, None]
    left = (left - gain["signature"][..., :rows, :]) / gain["gain"][..., :rows, :]
    found = cleaned.coherent(3)
    np.testing.assert_allclose(found.values, left, rtol=1e-3, atol=1e-4)
    assert found.attrs["scan"] == int(lane.imager.scans[3])
