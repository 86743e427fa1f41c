"""The passes that lay the images of all scans on the lane."""

import numpy as np
import pytest

from divided import DIVISIONS, SCANS, in_blocks, results_of_lane, same_bits, with_results
from flgpr.method.passes.run_view import PlainRunView, RunView
from flgpr.screen import RunViewSums
from small_lane import TARGETS


@pytest.mark.parametrize("blocks", DIVISIONS[1:])
def test_the_division_into_blocks_changes_no_bit(blocks):
    assert same_bits(in_blocks(RunView, with_results(), blocks), results_of_lane()["view"])


@pytest.mark.parametrize("blocks", DIVISIONS[1:])
def test_nor_does_it_before_the_background_is_removed(blocks):
    one_block = in_blocks(PlainRunView, with_results(), DIVISIONS[0])
    assert same_bits(in_blocks(PlainRunView, with_results(), blocks), one_block)
    np.testing.assert_array_equal(one_block["looks"], results_of_lane()["view"]["looks"])


def test_before_the_background_is_removed_the_looks_are_magnitudes_of_images():
    lane = with_results()
    sums = RunViewSums(lane.grid, lane.recipe.run_view.y_max)
    for index in range(SCANS):
        image = lane.near_image(index)
        sums.add(np.abs(image.values), lane.near, image.attrs["pose"])
    found = in_blocks(PlainRunView, lane, DIVISIONS[0])
    np.testing.assert_array_equal(found["view"], sums.result()[0])


def test_a_place_that_fewer_than_two_scans_saw_has_no_second_look():
    view = results_of_lane()["view"]
    seen_twice = view["looks"] >= 2
    assert seen_twice.any()
    assert np.isfinite(view["view"][..., seen_twice]).all()
    assert np.isnan(view["view"][..., ~seen_twice]).all()


def test_targets_stand_out_of_the_ground():
    lane = with_results()
    channel = lane.view()[0, 0]
    for x, y in TARGETS[:2]:
        near = channel.sel(x=slice(x - 0.2, x + 0.2), y=slice(y - 0.2, y + 0.2))
        assert float(near.max()) > 2 * float(channel.median())


def test_only_the_view_of_cleaned_images_goes_into_a_result_without_explanations():
    assert PlainRunView.explains
    assert not RunView.explains
    assert RunView.needs == PlainRunView.needs == ("gain",)
