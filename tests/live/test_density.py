"""The density rule on the ground seen so far: what is final and what is open add up to the whole."""

import math

import numpy as np
import pandas as pd
import pytest
import xarray as xr

from flgpr.live.alarm_book import SeenDensity
from flgpr.model import Lane
from flgpr.recipe.tables import PrescreenTable
from flgpr.screen import density_threshold

LANE = Lane(-1.0, 1.0, 0.0, 10.0)
X = np.linspace(-1.5, 1.5, 31)
Y = np.linspace(0.05, 9.95, 100)


def screen(count="lane"):
    return PrescreenTable(polarization="HH", subband="F1", radius=0.4, density=0.5, count=count)


def seen_ground():
    """A run-view of which no scan has seen the last metre, and maxima on it."""
    rng = np.random.default_rng(4)
    values = np.ones((Y.size, X.size))
    values[Y > 9] = np.nan
    maxima = pd.DataFrame({"x": rng.uniform(-1.5, 1.5, 60), "y": rng.uniform(0, 9, 60)})
    view = xr.DataArray(values, coords={"y": Y, "x": X}, dims=("y", "x"))
    return maxima.assign(magnitude=rng.uniform(0, 1, 60)), view


@pytest.mark.parametrize(("count", "width"), [("lane", 2.1), ("view", 3.1)])
def test_ground_that_becomes_final_changes_no_threshold(count, width):
    maxima, view = seen_ground()
    rule = SeenDensity(screen(count), 0.1)
    whole = rule.threshold(maxima, view, -math.inf, LANE)
    counted = maxima[LANE.contains(maxima["x"], maxima["y"]) | (count == "view")]
    wanted = density_threshold(counted["magnitude"].to_numpy(), width * 9.0, 0.4, 0.5)
    assert whole == wanted

    rule.close(maxima, view, -math.inf, 4.0, LANE)
    assert rule.final_area == pytest.approx(width * 4.0)
    assert list(rule.magnitudes) == sorted(counted["magnitude"][counted["y"] <= 4.0])
    open_maxima = maxima[maxima["y"] > 4.0]
    assert rule.threshold(open_maxima, view, 4.0, LANE) == whole
    rule.close(open_maxima, view, 4.0, 6.0, LANE)
    assert rule.threshold(maxima[maxima["y"] > 6.0], view, 6.0, LANE) == whole


def test_ground_without_maxima_has_no_threshold():
    _, view = seen_ground()
    none = pd.DataFrame({"x": [], "y": [], "magnitude": []})
    alone = SeenDensity(screen(), 0.1).threshold(none, view, -math.inf, LANE)
    assert alone == density_threshold(np.zeros(0), 2.1 * 9.0, 0.4, 0.5)
