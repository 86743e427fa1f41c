"""CUDA's kernels under numba's simulator, in a process of its own; imaging/test_cuda.py runs them all."""

import importlib.util
import os
import subprocess
import sys

import pytest

PROGRAM = """
import numpy as np
from flgpr.kernels import gpu
rng = np.random.default_rng(0)
pixels = np.concatenate([rng.uniform(-5, 5, (2, 4)), rng.uniform(-0.5, 0, (1, 4))])
antenna = np.array([[0.0, -9.0, 2.0], [1.0, -9.0, 3.0]])
straight = np.linalg.norm(pixels.T[None] - antenna[:, None], axis=-1)
gain = rng.uniform(0.5, 2, (2, 4)).astype(np.float32)
per_turn, carrier = 0.03, 3.3
delay = np.zeros((2, 4), np.uint32)
phasor = np.zeros((2, 4), np.complex64)
gpu.locate[(4, 2), (1, 1)](pixels, antenna, np.array([1.5, 0.0]), per_turn, carrier, gain, delay, phasor)
missed = (delay / 2.0**32 - 1.5 * straight * per_turn + 0.5) % 1 - 0.5
assert np.abs(missed).max() < 1e-8, missed
want = gain * np.exp(2j * np.pi * 1.5 * straight * carrier)
np.testing.assert_allclose(phasor, want, atol=1e-5)
"""


@pytest.mark.skipif(importlib.util.find_spec("numba_cuda") is None, reason="needs numba-cuda")
def test_delays_and_phasors_are_those_of_the_straight_path():
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM],
        env={**os.environ, "NUMBA_ENABLE_CUDASIM": "1"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
