"""Changed lanes of Cosgrove et al. 2004, on lanes small enough for a test."""

import numpy as np
import pytest

from few_tones import few_tones
from flgpr_papers.cosgrove2004 import images as images_module
from flgpr_papers.cosgrove2004.detect import learn, target_cut
from flgpr_papers.cosgrove2004.images import lane_looks
from flgpr_papers.cosgrove2004.signature import polarization_correlation
from reasons.changed_lanes import LaneChange, open_looks, reflector_looks
from reasons.cosgrove2004 import SHIFTS, correlation_record, moment_record

pytestmark = pytest.mark.slow("studies of papers")


@pytest.fixture(scope="module", autouse=True)
def folded_ranges():
    """Few tones make these tests quick; test_tones.py asks whether the study refuses them."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(images_module, "check_tones", lambda *_: None)
        yield


@pytest.fixture(scope="module")
def recipe():
    return few_tones()


@pytest.fixture(scope="module")
def looks(recipe):
    return lane_looks(recipe, "sand", 3, 0.1)


@pytest.mark.slow("makes lanes of the study again with one thing changed")
def test_a_twin_with_nothing_changed_is_the_studys_open_lane(recipe, looks):
    twin = open_looks(recipe, "sand", 3, 0.1, LaneChange())
    assert len(twin) == len(looks["open"])
    for one, other in zip(twin, looks["open"], strict=True):
        np.testing.assert_array_equal(one.image.values, other.image.values)
        np.testing.assert_array_equal(one.position, other.position)
        assert (one.trains, one.depth, one.shift) == (other.trains, other.depth, other.shift)


def test_a_lane_without_its_mines_is_looked_at_where_they_lay(recipe, looks):
    bare = open_looks(recipe, "sand", 3, 0.1, LaneChange(mines=False))
    for one, other in zip(bare, looks["open"], strict=True):
        np.testing.assert_array_equal(one.position, other.position)
    peaks = [
        np.median([np.abs(target_cut(recipe, look)).max() for look in found])
        for found in (bare, looks["open"])
    ]
    assert peaks[0] < 0.7 * peaks[1]


@pytest.mark.slow("makes lanes of the study again with one thing changed")
def test_mines_and_ground_can_be_changed_one_by_one(recipe, looks):
    ahead = open_looks(recipe, "sand", 3, 0.1, LaneChange(mine={"x": 0.0}))
    assert all(abs(look.position[0]) < 0.1 for look in ahead)
    louder = open_looks(recipe, "sand", 3, 0.1, LaneChange({"surface": {"level_db": 20.0}}))
    level = [np.median(np.abs(found[0].image.values)) for found in (louder, looks["open"])]
    assert level[0] != pytest.approx(level[1], rel=1e-3)


def test_a_corner_reflector_returns_the_same_in_both_polarizations(recipe):
    for look in reflector_looks(recipe, "sand"):
        assert polarization_correlation(target_cut(recipe, look)[0]) > 0.999


def test_what_is_measured_on_a_changed_lane(recipe, looks):
    record = correlation_record(recipe, looks["open"])
    middle = record["mine_by_shift"][SHIFTS.index(0)]
    assert middle == pytest.approx(record["mine"])
    assert 0 < record["clutter"] < 1
    training = learn(recipe, [look for look in looks["open"] if look.trains])
    moments = moment_record(recipe, looks["open"], training.whitener)
    assert 0 < moments["share_filled"] <= 1
    assert moments["filled"] <= moments["fourth_moment"]
    assert moments["levelled"] < moments["filled"]
