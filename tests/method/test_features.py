"""The pass that gathers the features of alarms from the scans that see them."""

from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest

from divided import DIVISIONS, SCANS, in_blocks, same_bits, with_results
from flgpr.method.passes.features import Features, alarms_near
from flgpr.method.passes.traversal import ImagedScan


@pytest.fixture(scope="module")
def one_block():
    return in_blocks(Features, with_results(), DIVISIONS[0])


def test_a_pass_that_goes_on_from_a_state_has_the_same_bits(one_block):
    """So an interrupted pass resumes; blocks are always the same for so many scans."""
    lane = with_results()
    first = Features(lane, range(0, 5))
    resumed = Features(lane, None)
    for index in range(SCANS):
        if index == 5:
            resumed.merge(first.state(True))
        (first if index < 5 else resumed).add(ImagedScan(lane, index))
    assert same_bits(resumed.result(), one_block)


@pytest.mark.parametrize("blocks", DIVISIONS[1:])
def test_the_division_into_blocks_changes_no_more_than_rounding(blocks, one_block):
    divided = in_blocks(Features, with_results(), blocks)
    assert divided.keys() == one_block.keys()
    for name, values in one_block.items():
        np.testing.assert_allclose(divided[name], values, rtol=1e-9, atol=1e-12, err_msg=name)


def test_every_alarm_has_a_row_and_counts_the_scans_that_see_it(one_block):
    count = len(with_results().alarms())
    assert count > 0
    assert {len(values) for values in one_block.values()} == {count}
    assert (one_block["scans"] >= 1).all()
    assert (one_block["scans"] <= SCANS).all()


def test_a_block_takes_the_alarms_within_reach_of_its_scans():
    """Images reach 4 m ahead and 3 m to the side: no pixel is farther than 5 m from its scan."""
    pose = np.zeros((4, 6))
    pose[:, 1] = [0.0, 1.0, 20.0, 21.0]
    lane = SimpleNamespace(
        imager=SimpleNamespace(scans=np.arange(4)),
        setup=SimpleNamespace(run={"pose": SimpleNamespace(values=pose)}),
        near=SimpleNamespace(extent=lambda: (-3.0, 2.0, 1.0, 4.0)),
    )
    alarms = pd.DataFrame({"y": [-5.1, -5.0, 6.0, 6.1, 15.0, 26.0, 26.1]})
    assert alarms_near(lane, alarms, range(0, 2)).tolist() == [1, 2]
    assert alarms_near(lane, alarms, range(2, 4)).tolist() == [4, 5]
