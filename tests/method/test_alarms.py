"""The pass that finds the maxima of the run-view."""

import numpy as np
import pandas as pd

from divided import results_of_lane, with_results
from flgpr.engine import group_of
from flgpr.method.imaged_run import array_table
from flgpr.method.passes.run_view import Maxima
from flgpr.method.sections import Section
from flgpr.screen import select


def table_of(result):
    return array_table(group_of(result, "maximum"))


def test_a_maximum_is_the_largest_of_its_neighbours():
    lane = with_results()
    screen = lane.recipe.prescreen
    channel = select(lane.view(), screen.polarization, screen.subband)
    values = np.nan_to_num(channel.values, nan=-np.inf)
    maxima = table_of(results_of_lane()["alarms"])
    assert len(maxima) >= 3
    for one in maxima.itertuples():
        row = int(np.argmin(np.abs(channel["y"].values - one.y)))
        column = int(np.argmin(np.abs(channel["x"].values - one.x)))
        around = values[max(row - 1, 0) : row + 2, max(column - 1, 0) : column + 2]
        assert around.max() == values[row, column]


def test_pixels_that_were_seen_are_counted():
    lane = with_results()
    screen = lane.recipe.prescreen
    channel = select(lane.view(), screen.polarization, screen.subband)
    assert int(results_of_lane()["alarms"]["seen"]) == int(np.isfinite(channel.values).sum())


def test_sections_together_have_the_maxima_of_the_lane():
    rows = with_results().grid.ny
    whole = table_of(results_of_lane()["alarms"])
    view = results_of_lane()["view"]
    parts = []
    seen = 0
    for section in (Section(0, rows // 3), Section(rows // 3, rows)):
        lane = with_results(section=section)
        lane.results["view"] = {
            "view": view["view"][..., lane.view_rows, :],
            "looks": view["looks"][lane.view_rows],
        }
        found = Maxima(lane, None).result()
        parts.append(table_of(found))
        seen += int(found["seen"])
    together = pd.concat(parts).sort_values(["y", "x"], ignore_index=True)
    pd.testing.assert_frame_equal(together, whole.sort_values(["y", "x"], ignore_index=True))
    assert seen == int(results_of_lane()["alarms"]["seen"])


def test_no_scan_is_read():
    assert Maxima.needs_no_scans
    assert Maxima(with_results(), range(0, 3)).state(True) == {}
