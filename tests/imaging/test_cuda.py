"""Run the CUDA tests under the simulator in a process of their own: numba decides at import which one it is."""

import importlib.util
import os
import re
import runpy
import subprocess
import sys
from pathlib import Path

import pytest

from flgpr.imaging import ImagingOperator

BENCHMARKS = Path(__file__).parents[2] / "benchmarks"


def has_device():
    if importlib.util.find_spec("numba_cuda") is None:
        return False
    from numba import cuda

    return cuda.is_available()


@pytest.mark.slow("CUDA's simulator runs every thread in Python")
@pytest.mark.skipif(importlib.util.find_spec("numba_cuda") is None, reason="needs numba-cuda")
def test_kernels_under_the_simulator():
    tests = Path(__file__).with_name("cuda_simulated.py")
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", str(tests)]
    environment = {**os.environ, "NUMBA_ENABLE_CUDASIM": "1"}
    done = subprocess.run(
        command, env=environment, capture_output=True, text=True, timeout=600, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr
    assert "passed" in done.stdout


def compiler():
    """The benchmark that compiles the kernels; skips where what it needs is not installed."""
    pathfinder = pytest.importorskip("cuda.pathfinder")
    pytest.importorskip("numba_cuda")
    try:
        for library in ("nvvm", "nvrtc"):
            pathfinder.load_nvidia_dynamic_lib(library)
    except RuntimeError as error:
        pytest.skip(f"needs NVIDIA's compiler: {error}")
    spec = importlib.util.spec_from_file_location("cuda_kernels", BENCHMARKS / "cuda_kernels.py")
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module


def test_the_compiled_interpolation_wastes_nothing():
    """No arithmetic in double precision, no registers in memory, one load of 64 bits for each complex sample."""
    made = compiler()
    for name, channels in (("interpolation, 15 channels", 15), ("interpolation, one channel", 1)):
        ptx = made.ptx_of(*made.kernels(4, 1024, 2048)[name], (9, 0))
        assert ".visible .entry" in ptx
        assert not re.search(r"\.f64\s+%", ptx)
        assert "__local_depot" not in ptx
        assert (
            len(re.findall(r"ld\.global\.[ub]64", ptx)) == 4 * channels + 4
        )  # two phasors and the pair's antennas


@pytest.mark.skipif(has_device(), reason="a device is here")
def test_a_missing_device_ends_the_measurement_in_one_line(tmp_path, monkeypatch, capfd):
    monkeypatch.syspath_prepend(BENCHMARKS)
    monkeypatch.setattr(sys, "argv", ["gpu.py", "-o", str(tmp_path / "gpu.json")])
    with pytest.raises(SystemExit) as ended:
        runpy.run_path(str(BENCHMARKS / "gpu.py"), run_name="__main__")
    assert ended.value.code == 2
    out, said = capfd.readouterr()
    assert said.startswith("error: device ")
    assert said.count("\n") == 1
    assert out == ""
    assert not list(tmp_path.iterdir())


@pytest.mark.skipif(has_device(), reason="a device is here")
def test_a_missing_device_is_named():
    position = [[0.0, 0.0, 5.0]]
    with pytest.raises(ValueError, match="device"):
        ImagingOperator([1e9, 1.1e9], position, position, [[0.0, 8.0, 0.0]], device="cuda")
