"""Sizes that kernels share."""

import numpy as np
import pytest

from flgpr.kernels.layout import aligned, padded, row_size


@pytest.mark.parametrize(("taps", "expected"), [(2, 4), (4, 4), (5, 8), (8, 8), (9, 16), (16, 16)])
def test_taps_are_padded_to_full_vectors(taps, expected):
    assert padded(taps) == expected


def test_a_row_holds_both_parts_of_every_channel_or_of_every_tap():
    assert row_size(5, 1) == 16
    assert row_size(5, 4) == 8
    assert row_size(5, 16) == 32


@pytest.mark.parametrize("size", [1, 63, 1000])
def test_arrays_start_on_a_cache_line(size):
    array = aligned(size, np.float32)
    assert array.shape == (size,)
    assert array.dtype == np.float32
    assert array.ctypes.data % 64 == 0
