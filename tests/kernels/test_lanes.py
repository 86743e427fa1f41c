"""Vector operations of the imaging kernels against the same sums in numpy."""

import numpy as np
import pytest
from numba import njit, uint64

from flgpr.kernels.lanes import gather_pairs
from flgpr.kernels.layout import BLOCK, padded

PAIRS = 3
PIXEL = 5
TAPS = 4


@njit
def gather(total, table, starts, fields, taps, channels):
    """Call the operation for one pixel."""
    gather_pairs(
        total, uint64(0), table, starts, fields, uint64(PIXEL), uint64(PAIRS), taps, channels
    )


@pytest.mark.parametrize("channels", [4, 16])
def test_profiles_are_interpolated_rotated_and_added_over_pairs(channels):
    width = padded.py_func(TAPS)
    rng = np.random.default_rng(channels)
    lanes = 2 * channels
    table = rng.normal(size=60 * lanes).astype(np.float32)
    starts = np.zeros((PAIRS, BLOCK), np.uint32)
    starts[:, PIXEL] = np.array([0, 7, 31]) * lanes
    fields = np.zeros((PAIRS, (2 + width) * BLOCK), np.float32)
    cosine, sine = rng.normal(size=(2, PAIRS)).astype(np.float32)
    weights = rng.normal(size=(PAIRS, width)).astype(np.float32)
    fields[:, PIXEL] = cosine
    fields[:, BLOCK + PIXEL] = sine
    for q in range(PAIRS):
        first = 2 * BLOCK + PIXEL * width
        fields[q, first : first + width] = weights[q]
    before = rng.normal(size=lanes).astype(np.float32)
    total = before.copy()
    gather(total, table, starts.ravel(), fields.ravel(), (0,) * TAPS, (0,) * channels)
    want = before.view(np.complex64).astype(complex)
    rows = table.reshape(-1, lanes).astype(float)
    for q in range(PAIRS):
        row = starts[q, PIXEL] // lanes
        value = weights[q, :TAPS].astype(float) @ rows[row : row + TAPS]
        profile = value[:channels] + 1j * value[channels:]
        want += (cosine[q] + 1j * sine[q]) * profile
    np.testing.assert_allclose(total.view(np.complex64), want, atol=1e-5)
