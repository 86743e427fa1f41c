"""The pass that raises alarms on every scan's image."""

from dataclasses import replace

import numpy as np
import pytest

from divided import DIVISIONS, SCANS, in_blocks, same_bits, with_results
from flgpr.method.passes.run_view import FrameAlarms, alarms_by_frame
from flgpr.method.passes.traversal import ImagedScan
from flgpr.screen import frame_alarms


@pytest.fixture(scope="module")
def one_block():
    return in_blocks(FrameAlarms, with_results(), DIVISIONS[0])


@pytest.mark.parametrize("blocks", DIVISIONS[1:])
def test_the_division_into_blocks_changes_no_bit(blocks, one_block):
    assert same_bits(in_blocks(FrameAlarms, with_results(), blocks), one_block)


def test_every_frame_has_the_alarms_of_its_own_image(one_block):
    lane = with_results()
    lane.results["frames"] = one_block
    alarms, poses = alarms_by_frame(lane)
    assert list(poses) == list(range(SCANS))
    np.testing.assert_array_equal(poses[6], lane.setup.pose(6))
    screen = lane.recipe.prescreen
    labels = lane.labels()
    channel = (
        labels["polarization"].index(screen.polarization),
        labels["subband"].index(screen.subband),
    )
    magnitude = ImagedScan(lane, 6).magnitude()[channel]
    area = lane.recipe.frame_area()
    wanted = frame_alarms(magnitude, lane.near, area, screen.radius)
    own = alarms[alarms["frame"] == 6]
    assert len(own) == len(wanted) > 0
    np.testing.assert_allclose(own["across"], wanted["x"])
    np.testing.assert_allclose(own["confidence"], wanted["magnitude"], rtol=1e-6)


def test_frames_begin_once_enough_scans_are_summed():
    lane = with_results()
    lane.setup = replace(lane.setup, summed=4)
    found = in_blocks(FrameAlarms, lane, DIVISIONS[0])
    assert found["frame"].tolist() == list(range(3, SCANS))
