"""Run the CUDA tests under the simulator in a process of their own: numba decides at import which one it is."""

import importlib.util
import os
import subprocess
import sys
from pathlib import Path

import pytest

from flgpr.imaging import ImagingOperator


def has_device():
    if importlib.util.find_spec("numba_cuda") is None:
        return False
    from numba import cuda

    return cuda.is_available()


@pytest.mark.skipif(importlib.util.find_spec("numba_cuda") is None, reason="needs numba-cuda")
def test_kernels_under_the_simulator():
    tests = Path(__file__).with_name("cuda_simulated.py")
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", str(tests)]
    environment = {**os.environ, "NUMBA_ENABLE_CUDASIM": "1"}
    done = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=600, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "passed" in done.stdout


@pytest.mark.skipif(has_device(), reason="a device is here")
def test_a_missing_device_is_named():
    position = [[0.0, 0.0, 5.0]]
    with pytest.raises(ValueError, match="device"):
        ImagingOperator([1e9, 1.1e9], position, position, [[0.0, 8.0, 0.0]], device="cuda")
