"""Masks and thresholds of Fuse et al. 2018, Sec. 2.2 and 2.4."""

import numpy as np
import pytest
from tests.reference.fuse2018 import extended_mask_as_written, regions_that_meet

from flgpr.clutter import (
    ThresholdCalibration,
    Thresholds,
    above,
    extended_mask,
    fundamental_mask,
    intersect,
    mixed_mask,
    roadside_level,
    subregions,
)

RNG = np.random.default_rng(3)
ACROSS, AHEAD = np.meshgrid(np.linspace(-11, 11, 45), np.linspace(4, 21, 35))
REGION = subregions(AHEAD, (5, 8.75, 12.5, 16.25, 20))


def speckle():
    return RNG.normal(size=ACROSS.shape) + 1j * RNG.normal(size=ACROSS.shape)


def thresholds(value=1.5, low=0.5, second=1.5):
    return Thresholds(
        *(np.full(4, v) for v in (value, value, low)),
        None if second is None else np.full(4, second),
    )


def test_sub_regions_divide_the_range_without_gap_or_overlap():
    assert subregions([4.99, 5, 8.74, 8.75, 20, 20.01], (5, 8.75, 12.5, 16.25, 20)).tolist() == [
        -1,
        0,
        0,
        1,
        3,
        -1,
    ]
    for edges in ([5], [5, 5], [8, 5]):
        with pytest.raises(ValueError, match="edges"):
            subregions([6.0], edges)


def test_each_sub_region_has_its_own_threshold():
    limit = np.array([0.5, 1.0, 1.5, 2.0])
    image = np.full(ACROSS.shape, 1.2 + 0j)
    marked = above(image, limit, REGION)
    assert np.array_equal(marked, np.isin(REGION, [0, 1]))
    with pytest.raises(ValueError, match="per sub-region"):
        above(image, limit[:2], REGION)
    with pytest.raises(ValueError, match="shape of region"):
        above(image[:3], limit, REGION)


@pytest.mark.parametrize("level", [0.6, 1.0, 1.8])
def test_regions_are_kept_whole_where_they_meet_the_other_mask(level):
    shape = np.abs(speckle()) > level
    other = np.abs(speckle()) > 2.2
    whole = intersect(shape, other, "region")
    assert np.array_equal(whole, regions_that_meet(shape, other))
    assert np.array_equal(intersect(shape, other), shape & other)
    assert (whole >= (shape & other)).all()
    assert (whole <= shape).all()
    with pytest.raises(ValueError, match="pixel or region"):
        intersect(shape, other, "both")


def test_the_fundamental_mask_is_vv_and_vh_or_vv_and_x():
    vv = speckle()
    vh = speckle()
    x = speckle()
    a, b, c = (np.abs(one) > 1.5 for one in (vv, vh, x))
    inside = REGION >= 0
    assert np.array_equal(
        fundamental_mask(vv, vh, thresholds(), REGION, x), ((a & b) | (a & c)) & inside
    )
    assert np.array_equal(fundamental_mask(vv, vh, thresholds(second=None), REGION), a & b & inside)
    with pytest.raises(ValueError, match="second band"):
        fundamental_mask(vv, vh, thresholds(second=None), REGION, x)


@pytest.mark.parametrize("low_vv", [0.0, 0.7, 5.0])
def test_the_extended_mask_as_written_is_the_low_vh_mask_at_the_roadside(low_vv):
    vv = speckle()
    vh = speckle()
    written = extended_mask_as_written(vv, vh, low_vv, 0.5, ACROSS) & (REGION >= 0)
    assert np.array_equal(extended_mask(vh, thresholds(), REGION, ACROSS), written)
    assert np.array_equal(
        written, (np.abs(vh) > 0.5) & (np.abs(ACROSS) >= 4) & (np.abs(ACROSS) <= 10) & (REGION >= 0)
    )


def test_the_mixture_is_the_union():
    vv = speckle()
    vh = speckle()
    x = speckle()
    both = fundamental_mask(vv, vh, thresholds(), REGION, x) | extended_mask(
        vh, thresholds(), REGION, ACROSS
    )
    assert np.array_equal(mixed_mask(vv, vh, thresholds(), REGION, ACROSS, x), both)


def calibrate(images, halos, roadside):
    calibration = ThresholdCalibration(4)
    for vv, vh, x in images:
        calibration.add(vv, vh, REGION, halos, roadside, x)
    return calibration.result()


def test_no_calibration_target_is_masked_and_thresholds_are_the_lowest_that_leave_them():
    places = [(0.0, 7.0), (1.0, 10.5), (-1.0, 14.5), (0.5, 18.5)]
    halos = [np.hypot(ACROSS - x, AHEAD - y) <= 1.0 for x, y in places]
    images = []
    for _ in range(3):
        vv = speckle()
        vv[np.any(halos, axis=0)] += 6
        images.append((vv, speckle(), speckle()))
    found = calibrate(images, halos, np.abs(ACROSS) >= 4)
    masked_then = np.zeros(REGION.shape, bool)
    for vv, vh, x in images:
        mask = fundamental_mask(vv, vh, found, REGION, x)
        lower = Thresholds(0 * found.vv, 0.999 * found.vh, found.low_vh, found.second)
        masked = fundamental_mask(vv, vh, lower, REGION)
        for halo in halos:
            strong = np.where(halo, np.abs(vv), 0)
            response = strong >= strong.max() / 2
            assert strong.max() >= found.vv[REGION[np.unravel_index(strong.argmax(), strong.shape)]]
            assert not (mask & response).any()
            masked_then |= masked & response
    assert np.unique(REGION[masked_then]).tolist() == [0, 1, 2, 3]


def test_the_low_threshold_is_the_roadside_mean_of_vh():
    halos = [np.hypot(ACROSS, AHEAD - y) <= 0.6 for y in (7, 10, 14, 18)]
    side = np.abs(ACROSS) >= 4
    images = [(speckle(), speckle(), None) for _ in range(2)]
    found = calibrate(images, halos, side)
    want = [
        np.mean([np.abs(vh)[side & (r == REGION)].mean() for _, vh, _ in images]) for r in range(4)
    ]
    np.testing.assert_allclose(found.low_vh, want)
    assert found.second is None


def test_the_roadside_of_the_frame_under_test_gives_the_papers_own_threshold():
    """Sec. 2.4: "the average value of the roadside clutter in a frame in test lane"; pixel by pixel."""
    vh = speckle() + 3.0 * (ACROSS > 4)
    beside = (np.abs(ACROSS) >= 4) & (np.abs(ACROSS) <= 10)
    level = roadside_level(vh, REGION, beside, 4)
    for number in range(4):
        pixels = [abs(vh[i]) for i in np.ndindex(*vh.shape) if beside[i] and REGION[i] == number]
        assert level[number] == pytest.approx(sum(pixels) / len(pixels))
    # What lies on the road does not enter, and a sub-region without roadside has no level.
    assert np.array_equal(roadside_level(np.where(beside, vh, 99.0), REGION, beside, 4), level)
    assert np.isnan(roadside_level(vh, REGION, beside & (REGION != 2), 4)).tolist() == [
        False,
        False,
        True,
        False,
    ]


def test_a_calibration_lane_must_show_targets_and_roadside_in_every_sub_region():
    halo = np.hypot(ACROSS, AHEAD - 7) <= 0.6
    calibration = ThresholdCalibration(4)
    calibration.add(speckle(), speckle(), REGION, [halo], np.abs(ACROSS) >= 4)
    with pytest.raises(ValueError, match="every sub-region must have shown a target"):
        calibration.result()
    with pytest.raises(ValueError, match="positive"):
        ThresholdCalibration(0)
