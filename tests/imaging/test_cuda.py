"""Run the CUDA tests under the simulator in a process of their own: numba decides at import which one it is."""

import importlib.util
import os
import subprocess
import sys
from pathlib import Path

import pytest

from flgpr.imaging import ImagingOperator


@pytest.mark.skipif(importlib.util.find_spec("numba_cuda") is None, reason="needs numba-cuda")
def test_kernels_under_the_simulator():
    tests = Path(__file__).with_name("cuda_simulated.py")
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", str(tests)]
    environment = {**os.environ, "NUMBA_ENABLE_CUDASIM": "1"}
    done = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=600, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "passed" in done.stdout


@pytest.mark.skipif(os.environ.get("NUMBA_ENABLE_CUDASIM") == "1", reason="the simulator is a device")
def test_a_missing_device_is_named():
    position = [[0.0, 0.0, 5.0]]
    try:
        ImagingOperator([1e9, 1.1e9], position, position, [[0.0, 8.0, 0.0]], device="cuda")
    except ValueError as error:
        assert "device" in str(error)  # noqa: PT017
