"""The pass that finds the gain background, in units of which images are cleaned."""

import numpy as np
import pytest

from divided import DIVISIONS, in_blocks, results_of_lane, same_bits, setup
from flgpr.method.passes.background import GAIN_BACKGROUND, NoGain, RowGain, SmoothGain


def lane_with_signature():
    lane = setup()
    lane.results["signature"] = results_of_lane()["signature"]
    return lane


@pytest.mark.parametrize("blocks", DIVISIONS[1:])
def test_the_division_into_blocks_changes_no_bit(blocks):
    divided = in_blocks(SmoothGain, lane_with_signature(), blocks)
    assert same_bits(divided, results_of_lane()["gain"])


def test_rows_have_the_mean_of_the_medians_of_their_scans():
    lane = lane_with_signature()
    found = in_blocks(RowGain, lane, DIVISIONS[1])
    first = lane.results["signature"]
    within = lane.recipe.background.within or np.inf
    near = np.abs(lane.imager.grid.x) <= within
    medians = []
    for index, gain in enumerate(first["gains"]):
        image = lane.scan_image(index, lane.background_rows).values[..., : lane.background_rows, :]
        left = np.abs(image / gain[..., None, None] - first["signature"])
        medians.append(np.median(left[..., near], axis=-1))
    np.testing.assert_allclose(found["gain"][..., 0], np.mean(medians, axis=0), rtol=1e-5)
    assert (found["gain"] == found["gain"][..., :1]).all()


def test_without_a_background_images_stay_in_units_of_their_gain():
    lane = lane_with_signature()
    found = in_blocks(NoGain, lane, DIVISIONS[0])
    assert (found["gain"] == 1).all()
    np.testing.assert_array_equal(found["gains"], lane.results["signature"]["gains"])


def test_images_that_equal_their_signature_are_refused():
    lane = lane_with_signature()
    nothing = RowGain(lane, None)  # no scan was added: the sum of the medians is zero
    with pytest.raises(ValueError, match="gain background must be positive everywhere, got zero"):
        nothing.result()


def test_recipes_name_every_method():
    assert {"smooth": SmoothGain, "rows": RowGain, "none": NoGain} == GAIN_BACKGROUND
    assert {kind.name for kind in GAIN_BACKGROUND.values()} == {"gain"}
    assert all(kind.all_scans for kind in GAIN_BACKGROUND.values())
