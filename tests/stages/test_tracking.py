"""Alarms followed over scans: what stays where it is, what flashes, and flanks of something brighter."""

from types import SimpleNamespace

import numpy as np
import pytest
import xarray as xr

from flgpr.method.method import detect
from flgpr.recipe.schema import parse_recipe
from flgpr.stages import Setup
from flgpr.stages.tracking import Tracking, TrackingSettings
from small_lane import LANE, TARGETS, small_recipe, small_run

X = np.linspace(-2, 2, 81)
Y = np.linspace(3, 7, 81)


def stage(imaged=(0, 1), **settings):
    run = xr.Dataset(coords={"polarization": ["HH", "VV"]})
    imager = SimpleNamespace(run=run, subbands={"F1": None, "F2": None})
    setup = Setup(run, {}, LANE, imager, None, None, list(imaged), 1, {})
    return Tracking(TrackingSettings(**settings), setup)


def image(*spots):
    """Speckle of the background's level in all channels, and spots (x, y, height) in the first."""
    values = np.random.default_rng(3).rayleigh(0.5, (2, 2, Y.size, X.size)).astype(np.complex64)
    for x, y, height in spots:
        values[0, 0] += height * np.exp(-((X - x) ** 2 + (Y[:, None] - y) ** 2) / 0.15**2)
    return xr.DataArray(values, dims=("polarization", "subband", "y", "x"), coords={"x": X, "y": Y})


def tracked(one, *points, **settings):
    return stage(**settings).of_image(one, np.array(points, dtype=float))["tracked"]


def test_a_maximum_within_reach_is_followed_and_a_flank_is_not():
    one = image((0.0, 5.0, 6.0), (1.2, 5.0, 3.0))
    places = (0.2, 5.1), (1.2, 5.0), (0.55, 5.0), (-1.0, 6.0), (9.0, 5.0)
    np.testing.assert_array_equal(tracked(one, *places), [1, 1, 0, 0, np.nan])


def test_level_reach_and_channel_are_those_of_the_table():
    one = image((0.0, 5.0, 6.0))
    assert tracked(one, (0.3, 5.0)) == 1
    assert tracked(one, (0.3, 5.0), reach=0.2) == 0
    assert tracked(one, (0.0, 5.0), level=9.0) == 0
    assert tracked(one, (0.0, 5.0), polarization="VV", level=4.0) == 0
    alone = one.isel(polarization=[0])  # a recipe that images VV alone
    assert stage([1], polarization="VV").of_image(alone, np.array([[0.0, 5.0]]))["tracked"] == 1
    with pytest.raises(ValueError, match=r"tracking.polarization must be one of VV, got 'HH'"):
        stage([1], polarization="HH")
    with pytest.raises(ValueError, match=r"tracking.subband must be one of F1, F2, got 'F9'"):
        stage(subband="F9")


def test_its_column_joins_those_of_a_recipe():
    recipe = parse_recipe(small_recipe() + '\n[[columns]]\nstage = "tracking"\nlevel = 1.5\n')
    assert recipe.columns[0].settings.level == 1.5
    with pytest.raises(ValueError, match=r"reach: .* got 0"):
        parse_recipe(small_recipe() + '\n[[columns]]\nstage = "tracking"\nreach = 0\n')


def test_the_targets_of_a_lane_are_tracked_more_than_its_other_alarms():
    text = small_recipe() + '\n[[columns]]\nstage = "tracking"\npolarization = "HH"\nreach = 0.3\n'
    found = detect(small_run(), parse_recipe(text), LANE)
    tracked = found.features["tracked"].to_numpy()
    assert ((tracked >= 0) & (tracked <= 1)).all()
    away = np.hypot(
        *(found.alarms[axis].to_numpy()[:, None] - TARGETS[:, k] for k, axis in enumerate("xy"))
    )
    hit = away.min(axis=1) < 0.4
    assert hit.any()
    assert tracked[hit].mean() > tracked[~hit].mean()
