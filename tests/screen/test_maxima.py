import math

import numpy as np
import pytest
import xarray as xr

from flgpr.model import Lane
from flgpr.screen import prescreen
from reference.wang2007 import local_maxima


def view_of(values, spacing=0.1, x0=-1.0, y0=2.0):
    y, x = (start + spacing * np.arange(n) for start, n in zip((y0, x0), values.shape, strict=True))
    return xr.DataArray(values, dims=("y", "x"), coords={"y": y, "x": x})


WIDE = Lane(-100, 100, -100, 100)


@pytest.mark.parametrize("radius", [0.1, 0.25, 0.75])
def test_alarms_are_the_local_maxima_within_the_radius(radius):
    values = np.random.default_rng(4).random((25, 19))
    alarms = prescreen(view_of(values), WIDE, radius, density=1e6)
    want = local_maxima(values, 0.1, radius)
    assert alarms["magnitude"].tolist() == [value for value, _, _ in want]
    np.testing.assert_allclose(alarms["y"], [2.0 + 0.1 * y for _, y, _ in want])
    np.testing.assert_allclose(alarms["x"], [-1.0 + 0.1 * x for _, _, x in want])


def test_a_plateau_gives_one_alarm():
    values = np.zeros((12, 12))
    values[4:6, 4:6] = 1.0
    assert len(prescreen(view_of(values), WIDE, 0.5, 1e6).query("magnitude == 1")) == 1


def test_borders_of_what_was_seen_raise_no_alarm():
    values = np.full((10, 10), np.nan)
    values[2:8, 2:8] = np.random.default_rng(0).random((6, 6))
    values[2, 5] = 9.0  # on the border of the seen area
    values[4, 4] = 5.0
    alarms = prescreen(view_of(values), WIDE, 0.1, 1e6)
    assert alarms["magnitude"].iloc[0] == 5.0
    assert 9.0 not in alarms["magnitude"].to_numpy()


def test_the_density_rule_counts_inside_the_lane():
    values = np.random.default_rng(8).random((60, 60))
    view = view_of(values)
    lane = Lane(0.0, 2.0, 3.0, 6.0)
    everything = prescreen(view, lane, 0.25, 1e6)
    alarms = prescreen(view, lane, 0.25, 0.75)
    keep = math.floor(0.75 * 6.0 / (math.pi * 0.25**2))
    inside = lane.contains(alarms["x"], alarms["y"])
    assert inside.sum() == keep < lane.contains(everything["x"], everything["y"]).sum()
    threshold = alarms["magnitude"][inside].min()
    assert len(alarms) == (everything["magnitude"] >= threshold).sum()


def test_the_density_rule_of_the_paper_counts_over_all_that_was_seen():
    values = np.random.default_rng(8).random((60, 60))
    values[:, 50:] = np.nan
    alarms = prescreen(view_of(values), Lane(0.0, 2.0, 3.0, 6.0), 0.25, 0.75, count="view")
    assert len(alarms) == math.floor(0.75 * 30.0 / (math.pi * 0.25**2))
    assert alarms["magnitude"].is_monotonic_decreasing


def test_nothing_found_is_an_empty_table():
    table = prescreen(view_of(np.full((9, 9), np.nan)), WIDE)
    assert table.empty
    assert list(table.columns) == ["x", "y", "magnitude"]


def test_bad_input():
    with pytest.raises(ValueError, match="radius"):
        prescreen(view_of(np.ones((5, 5))), WIDE, radius=0)
    with pytest.raises(ValueError, match="count"):
        prescreen(view_of(np.ones((5, 5))), WIDE, count="area")
    with pytest.raises(ValueError, match="dimensions"):
        prescreen(view_of(np.ones((5, 5))).expand_dims("polarization"), WIDE)
