"""Blocks of scans: sums over blocks are sums over scans."""

import numpy as np
import pandas as pd
import pytest

from flgpr.clutter import BackgroundEstimator
from flgpr.model import Grid
from flgpr.pipeline.wang2007 import BLOCK, blocks_of
from flgpr.screen import RunViewSums


@pytest.mark.parametrize("scans", [1, 2, 15, 16, 17, 100, 600])
def test_blocks_hold_every_scan_once_and_are_even(scans):
    blocks = blocks_of(scans)
    assert [scan for block in blocks for scan in block] == list(range(scans))
    sizes = [len(block) for block in blocks]
    assert max(sizes) <= BLOCK
    assert max(sizes) - min(sizes) <= 1


def test_a_background_of_blocks_is_that_of_all_scans():
    rng = np.random.default_rng(3)
    images = (rng.normal(size=(11, 2, 2, 31, 29)) + 1j * rng.normal(size=(11, 2, 2, 31, 29))).astype(np.complex64)
    images += 3
    plain = BackgroundEstimator((5, 5), (11, 11), 2)
    for image in images:
        plain.add_signature(image)
    for image in images:
        plain.add_gain(image)
    folded = BackgroundEstimator((5, 5), (11, 11), 2)
    for block in (range(0, 4), range(4, 8), range(8, 11)):
        part = BackgroundEstimator((5, 5), (11, 11), 2)
        for scan in block:
            part.add_signature(images[scan])
        folded.take_first(part.first_sums())
    first = folded.first_result()
    for block in (range(0, 4), range(4, 8), range(8, 11)):
        part = BackgroundEstimator((5, 5), (11, 11), 2)
        part.continue_from(first, slice(block.start, block.stop))
        for scan in block:
            part.add_gain(images[scan])
        folded.take_second(part.second_sums())
    for name, value in vars(plain.result()).items():
        np.testing.assert_allclose(getattr(folded.result(), name), value, rtol=2e-6)
    np.testing.assert_array_equal(np.stack(plain.gains), first["gains"])
    with pytest.raises(ValueError, match="shape"):
        folded.take_first({"own": images[0, :1], "shared": images[0, :1], "gains": np.ones((1, 1, 2))})


def test_a_run_view_of_parts_in_any_order_is_exactly_that_of_all_scans():
    rng = np.random.default_rng(4)
    lane, image = Grid.spanning((-1, 1), (0, 8), 0.1), Grid.spanning((-1.5, 1.5), (1, 3), 0.05)
    values = rng.random((9, 2, *image.shape), dtype=np.float32)
    poses = [np.array([0.03 * k, 0.7 * k - 1, 2, 0.02 * k, 0, 0]) for k in range(9)]
    plain, folded = RunViewSums(lane, 2.5), RunViewSums(lane, 2.5)
    for one, pose in zip(values, poses, strict=True):
        plain.add(one, image, pose)
    for block in (range(6, 9), range(0, 3), range(3, 6)):
        reach = [plain.reach(image, poses[k]) for k in block]
        rows = slice(min(r.start for r in reach), max(r.stop for r in reach))
        assert rows.stop - rows.start < lane.ny
        part = RunViewSums(lane, 2.5, rows)
        for k in block:
            part.add(values[k], image, poses[k])
        folded.take(part.sums())
    for got, want in zip(folded.result(), plain.result(), strict=True):
        np.testing.assert_array_equal(got, want)


def test_sums_without_a_scan_are_refused():
    with pytest.raises(ValueError, match="at least one"):
        BackgroundEstimator().first_sums()
    with pytest.raises(ValueError, match="at least one"):
        BackgroundEstimator().second_sums()
    with pytest.raises(ValueError, match="at least one"):
        RunViewSums(Grid.spanning((0, 1), (0, 1), 0.1), 1).sums()


def test_tables_go_through_arrays_unchanged():
    from flgpr.pipeline.blocks import array_table, table_arrays

    table = pd.DataFrame({"x": [1.5, np.nan], "scans": [3, 4]})
    assert array_table({**table_arrays(table, "a."), "other": np.zeros(3)}, "a.").equals(table)
