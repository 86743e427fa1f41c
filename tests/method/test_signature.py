"""The pass that finds the self-signature and the gain of every scan."""

import numpy as np
import pytest

from divided import DIVISIONS, SCANS, in_blocks, same_bits, setup
from flgpr.method.passes.background import SelfSignaturePass
from flgpr.method.passes.traversal import ImagedScan


@pytest.fixture(scope="module")
def one_block():
    return in_blocks(SelfSignaturePass, setup(), DIVISIONS[0])


@pytest.mark.parametrize("blocks", DIVISIONS[1:])
def test_the_division_into_blocks_changes_no_bit(blocks, one_block):
    assert same_bits(in_blocks(SelfSignaturePass, setup(), blocks), one_block)


def test_every_scan_has_a_gain_and_every_pixel_a_signature(one_block):
    lane = setup()
    polarizations, subbands = len(lane.polarizations), len(lane.recipe.image.subbands)
    assert one_block["gains"].shape == (SCANS, polarizations, subbands)
    assert (one_block["gains"] > 0).all()
    shape = (polarizations, subbands, lane.background_rows, lane.imager.grid.nx)
    assert one_block["signature"].shape == shape
    assert one_block["shared"].shape == shape
    assert np.isfinite(one_block["signature"]).all()


@pytest.mark.parametrize("index", [4, 7])
def test_a_scan_that_is_twice_as_strong_has_twice_the_gain(index, monkeypatch):
    """Everything in the data is linear, and Eq. 2 divides every image by its gain."""
    lane = setup()
    image = lane.scan_image(index)
    shown = [image, 2 * image]
    monkeypatch.setattr(lane, "scan_image", shown.__getitem__)
    doubled = SelfSignaturePass(lane, range(0, 2))
    for number in range(2):
        doubled.add(ImagedScan(lane, number))
    gains = doubled.result()["gains"]
    np.testing.assert_allclose(gains[1], 2 * gains[0], rtol=1e-5)
