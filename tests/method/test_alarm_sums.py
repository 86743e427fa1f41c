"""Features of alarms gathered scan by scan: means over the scans, merged from block to block."""

from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
import xarray as xr

from divided import SCANS, setup, with_results
from flgpr.method.alarm_sums import AlarmSums, own_column_count
from flgpr.method.passes.traversal import ImagedScan
from flgpr.stages.sums import StageSums
from small_lane import small_recipe

TWO_ALARMS = pd.DataFrame({"x": [0.0, 1.0], "y": [5.0, 6.0]})


def seen_at(y):
    """Return an image of a scan at a place along the lane; only its pose is read here."""
    return xr.DataArray(np.zeros((1, 1)), attrs={"pose": [0.0, y, 0.0, 0.0, 0.0, 0.0]})


def ahead_stage():
    """Return a stage whose column is how far ahead an alarm lies, unknown beyond 5 m."""

    def of_image(image, points):
        ahead = points[:, 1]
        return {"ahead": np.where(ahead <= 5.0, ahead, np.nan)}

    return SimpleNamespace(columns=("ahead",), of_image=of_image)


def test_a_column_is_the_mean_over_the_scans_that_gave_a_value():
    sums = StageSums(ahead_stage(), TWO_ALARMS)
    for y in (0.0, 2.0):
        sums.add(seen_at(y))
    assert sums.table()["ahead"].tolist() == [4.0, 4.0]  # (5 + 3) / 2, and 4 of the second scan


def test_a_column_that_no_scan_gave_is_missing_and_merged_sums_are_those_of_all_scans():
    first = StageSums(ahead_stage(), TWO_ALARMS)
    first.add(seen_at(0.0))
    assert np.isnan(first.table()["ahead"].iloc[1])
    second = StageSums(ahead_stage(), TWO_ALARMS)
    second.add(seen_at(2.0))
    first.merge(second.state())
    assert first.table()["ahead"].tolist() == [4.0, 4.0]


def test_alarms_of_another_block_that_are_not_among_these_are_left_out():
    lane = with_results()
    alarms = lane.alarms()
    assert len(alarms) > 1
    everything = AlarmSums(lane.steps, alarms)
    for index in range(SCANS):
        everything.add(ImagedScan(lane, index).cleaned)
    last = len(alarms) - 1
    some = AlarmSums(lane.steps, alarms.iloc[[last]], np.array([last]))
    some.merge(everything.state())
    wanted = everything.table().iloc[last]
    np.testing.assert_array_equal(some.table().iloc[0].to_numpy(), wanted.to_numpy())


@pytest.mark.parametrize("features", ["none", "ten", "variants"])
def test_the_columns_that_belong_to_no_stage_are_counted(features):
    text = small_recipe()
    if features == "ten":
        text = text.replace("variants = true\n", "")
    if features == "none":
        before, rest = text.split("[features]\n")
        text = before + rest[rest.index("\n[") :]
    lane = setup(text)
    table = AlarmSums(lane.steps, TWO_ALARMS).table()
    added_when_ranked = features == "none"  # the magnitude, which the ten features have already
    assert own_column_count(lane.recipe) == len(table.columns) + added_when_ranked
