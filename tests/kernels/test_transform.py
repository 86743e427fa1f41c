import math

import numpy as np
import pytest
from numba import njit

from flgpr.kernels.geometry import cos_sin
from flgpr.kernels.transform import fourier


@pytest.mark.parametrize("channels", [4, 16])
@pytest.mark.parametrize("size", [32, 64, 1024, 2048])
def test_transform_of_lane_rows_is_the_inverse_fourier_sum(size, channels):
    rng = np.random.default_rng(size)
    values = rng.normal(size=(size, channels)) + 1j * rng.normal(size=(size, channels))
    rows = np.concatenate([values.real, values.imag], axis=1).astype(np.float32).reshape(-1)
    twiddle = np.exp(2j * np.pi * np.arange(size) / size).astype(np.complex64)
    result = fourier(rows, np.empty_like(rows), size, twiddle, (0,) * channels).reshape(
        size, 2, channels
    )
    exact = np.fft.ifft(values, axis=0, norm="forward")
    found = result[:, 0] + 1j * result[:, 1]
    assert np.linalg.norm(found - exact) < 5e-7 * np.linalg.norm(exact)


@njit
def _table(turns, out):
    for i in range(turns.size):
        out[i, 0], out[i, 1] = cos_sin(turns[i])


def test_cosine_and_sine_are_exact_to_single_precision():
    turns = np.linspace(-0.5, 0.5, 4001).astype(np.float32)
    out = np.empty((turns.size, 2), np.float32)
    _table(turns, out)
    angle = 2 * math.pi * turns.astype(np.float64)
    assert out[:, 0] == pytest.approx(np.cos(angle), abs=3e-7)
    assert out[:, 1] == pytest.approx(np.sin(angle), abs=3e-7)
