"""A process that compiles the kernels and one that loads what was compiled give the same bits."""

import os
import subprocess
import sys

PROGRAM = """
import hashlib
import numpy as np
from flgpr.imaging import ImagingOperator
from flgpr.kernels.focus import focus
rng = np.random.default_rng(0)
signal = (rng.normal(size=(3, 8, 48)) + 1j * rng.normal(size=(3, 8, 48))).astype(np.complex64)
path, kernel = rng.uniform(8, 20, (9, 8)), rng.normal(size=(2, 48, 61)).astype(np.float32)
out = np.empty((9, 3, 61), np.float32)
focus(signal, np.linspace(2.5, 6, 48), path, kernel, out)
ends, ground = rng.uniform(-1, 1, (2, 8, 3)) + [0, 0, 2], np.zeros((40, 30, 3))
ground[..., :2] = np.stack(np.meshgrid(np.linspace(-2, 2, 30), np.linspace(4, 9, 40)), axis=-1)
operator = ImagingOperator(np.linspace(0.8e9, 1.8e9, 48), *ends, ground, [(0.8e9, 1.8e9), (0.8e9, 1.3e9)])
images = operator.adjoint(signal)
data = operator.forward(images)
print(*(hashlib.sha256(np.ascontiguousarray(one).tobytes()).hexdigest() for one in (out, images, data)))
"""


def test_compiled_and_loaded_kernels_give_the_same_bits(tmp_path):
    told = [
        subprocess.run(
            [sys.executable, "-c", PROGRAM], env=os.environ | {"NUMBA_CACHE_DIR": str(tmp_path)}, text=True, check=True,
            capture_output=True,
        ).stdout.split()
        for _ in range(2)
    ]  # fmt: skip
    assert any(tmp_path.rglob("*.nbc"))
    assert told[0] == told[1]
    assert len(set(told[0])) == 3
