"""What outshines the lane from beside it: its mask, its fit, and the column that tells it."""

import numpy as np
import pytest

from divided import SCANS, recorded
from flgpr.engine import block_name, blocks_of
from flgpr.method.imaged_run import ImagedRun
from flgpr.model import Lane
from flgpr.recipe.schema import parse_recipe
from flgpr.stages.roadside import (
    FIT,
    MASK,
    RoadsideModel,
    RoadsideSettings,
    RoadsideShare,
    RoadsideShareSettings,
)
from small_lane import LANE, TARGETS, small_recipe

ENTRIES = {"subband": "F1", "spacing": 0.1, "grow": 0.1, "iterations": 5}
BARE = Lane(-0.15, 0.05, 3.0, 8.0)  # a strip of ground with all targets beside it


def setup_of(lane):
    return ImagedRun(recorded(), parse_recipe(small_recipe()), lane, explains=False).setup


def measured(setup):
    return lambda index: setup.imager.signal(int(setup.imager.scans[index]))


def run_passes(model):
    """Do both passes as the engine does: the mask of all scans, then the fit block by block."""
    mask, fit = model.passes()
    assert (mask.name, fit.name, fit.needs) == (MASK, FIT, (MASK,))
    found = mask.start(None)
    for index in range(SCANS):
        found.add(index)
    model.setup.results[MASK] = found.result()
    for number, block in enumerate(blocks_of(SCANS)):
        fitted = fit.start(block)
        for index in block:
            fitted.add(index)
        model.setup.results[block_name(FIT, number)] = fitted.state(True)
    return model


@pytest.fixture(scope="module")
def bright():
    """The model of targets that lie beside a strip of ground."""
    setup = setup_of(BARE)
    return run_passes(RoadsideModel(RoadsideSettings(**ENTRIES), setup, measured(setup)))


def test_the_mask_lies_beside_the_lane_and_on_what_is_bright(bright):
    x, y = bright.points[:, :2].T
    assert len(bright.points) > 0
    assert not BARE.contains(x, y).any()
    distance = np.hypot(x[:, None] - TARGETS[:, 0], y[:, None] - TARGETS[:, 1])
    assert distance.min(axis=0)[:2].max() < 0.3


def test_the_fitted_response_is_subtracted(bright):
    notes = bright.notes()
    assert notes["mask_pixels"] == len(bright.points)
    assert notes["mask_peak_reduced_by_db"] > 3
    original = measured(bright.setup)(4)
    cleaned = bright.cleaned(4)
    assert cleaned.shape == original.shape
    assert np.linalg.norm(cleaned) < np.linalg.norm(original)


def test_where_nothing_outshines_the_lane_data_stay_as_they_are():
    setup = setup_of(LANE)
    model = run_passes(RoadsideModel(RoadsideSettings(**ENTRIES), setup, measured(setup)))
    assert model.notes() == {"mask_pixels": 0}
    np.testing.assert_array_equal(model.cleaned(7), measured(setup)(7))


def test_subbands_polarizations_and_scans_are_named_in_errors(bright):
    setup = bright.setup
    unknown = RoadsideSettings(**(ENTRIES | {"subband": "F9"}))
    with pytest.raises(ValueError, match=r"roadside\.subband must be one of .*, got 'F9'"):
        RoadsideModel(unknown, setup, measured(setup))
    share = RoadsideShareSettings(**ENTRIES, polarization="VH")
    with pytest.raises(ValueError, match=r"roadside\.polarization must be one of .*, got 'VH'"):
        RoadsideShare(share, setup)
    with pytest.raises(ValueError, match=f"index must be one of {SCANS} scans, got {SCANS}"):
        bright.cleaned(SCANS)


def test_what_the_mask_explains_has_a_larger_share_than_the_rest(bright):
    stage = RoadsideShare(RoadsideShareSettings(**ENTRIES), bright.setup)
    index = 5
    image = bright.image(index, measured(bright.setup)(index))
    grid = bright.setup.imager.grid
    away = np.array([[grid.x_min - 5.0, 4.0]])
    target = TARGETS[1] - bright.setup.pose(index)[:2]
    share = stage.of_image(image, np.vstack([target, away]))["roadside"]
    assert share[0] > 0.5
    assert np.isnan(share[1])
