"""The pass that gathers what explains the alarms to the viewer."""

import numpy as np
import pytest

from divided import DIVISIONS, SCANS, in_blocks, with_results
from flgpr.method.passes.features import Explain, poses_near


def explained(lane, blocks):
    evidence = lane.evidence_sums()
    evidence.merge(in_blocks(Explain, lane, blocks))
    return evidence.result()


@pytest.mark.parametrize("blocks", DIVISIONS[1:])
def test_the_division_into_blocks_changes_no_look(blocks):
    lane = with_results()
    one_block = explained(lane, DIVISIONS[0])
    divided = explained(lane, blocks)
    assert any(one_block.scans)
    assert divided.scans == one_block.scans
    for first, second in zip(divided.blocks, one_block.blocks, strict=True):
        np.testing.assert_array_equal(first, second)


def test_poses_of_all_scans_that_may_see_the_same_ground_are_given():
    lane = with_results()
    near = poses_near(lane, range(0, 1))
    y = lane.setup.run["pose"].values[:, 1]
    farthest = np.abs(lane.near.extent()).max() * np.sqrt(2)
    wanted = [scan for scan in range(SCANS) if abs(y[scan] - y[0]) <= 2 * farthest]
    assert list(near) == wanted
    np.testing.assert_array_equal(near[0], lane.setup.pose(0))


def test_it_is_left_out_where_nothing_is_explained():
    assert Explain.explains
    assert Explain.needs == ("gain", "alarms")
