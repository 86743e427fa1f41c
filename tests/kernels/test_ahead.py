"""Another process compiles the kernels that a detection calls, and ends with it."""

import contextlib
import subprocess
import sys
from unittest import mock

import numpy as np
import pytest

from flgpr.imaging import ImagingOperator
from flgpr.kernels import ahead, profiles

DEMO = """
import sys
import numpy as np
import pytest
import flgpr
from flgpr.detect import RelevanceVectorClassifier
from flgpr.io import sample_lane
from flgpr.kernels import ahead
ahead.compile_usual()
ahead.compile_training()
loaded = [module for name, module in sys.modules.items() if name.startswith("flgpr.kernels.")]
found = {id(one): one for module in loaded for one in vars(module).values() if hasattr(one, "nopython_signatures")}
found |= {id(one.kernel): one.kernel for module in loaded for one in vars(module).values() if hasattr(one, "kernel")}
before = {key: set(one.signatures) for key, one in found.items()}
flgpr.detect(sample_lane() / "run.zarr", "demo", sys.argv[1], report=False)
sample = np.random.default_rng(0).normal(size=(40, 2))
RelevanceVectorClassifier().fit(sample, sample.sum(axis=1) > 0)
more = {one.py_func.__name__ for key, one in found.items() if set(one.signatures) - before[key]}
print(*sorted(more - {"row_size", "padded"}))
"""


@pytest.mark.slow("compiles in processes of its own")
def test_what_is_compiled_ahead_is_what_the_demo_and_a_training_call(tmp_path):
    command = [sys.executable, "-c", DEMO, str(tmp_path / "result")]
    ran = subprocess.run(command, text=True, check=True, capture_output=True)
    assert ran.stdout.split() == [], "more was compiled: add it to flgpr.kernels.ahead"


@pytest.mark.slow("compiles in processes of its own")
def test_imaging_to_other_tolerances_calls_what_was_compiled_ahead(monkeypatch):
    named = {kernel: [] for kernel in (profiles.adjoint, profiles.forward)}
    for kernel, given in named.items():
        monkeypatch.setattr(ahead, kernel.py_func.__name__, mock.Mock(compile=given.append))
    ahead.compile_tolerances()
    tones = np.linspace(0.8e9, 1.8e9, 24)
    ends = np.ones((2, 4, 3))
    ground = np.zeros((2, 2, 3))
    operator = ImagingOperator(tones, *ends, ground, tolerance=0.1, method="profile")
    operator.forward(operator.adjoint(np.zeros((1, 4, 24), np.complex64)))
    for kernel, given in named.items():
        assert len(set(given)) == 24
        called = {
            one for one in kernel.signatures if (len(one[4]), len(one[6])) == (operator.width, 1)
        }
        assert called
        assert called <= set(given)


@pytest.mark.slow("compiles in processes of its own")
def test_who_compiles_ahead_ends_with_the_process_that_asked_for_it(tmp_path, monkeypatch):
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "kernels"))
    monkeypatch.setattr(ahead, "cache_folder", lambda _: tmp_path / "done")
    monkeypatch.setattr(ahead.config, "NUMBA_NUM_THREADS", 2)
    started = []

    def start(*given, **more):
        started.append(subprocess.Popen(*given, **more))
        return started[-1]

    monkeypatch.setattr(ahead, "Popen", start)
    with contextlib.suppress(KeyboardInterrupt), ahead.compiled_beside():
        assert started[0].poll() is None
        raise KeyboardInterrupt
    assert started[0].returncode is not None
    with subprocess.Popen(
        started[0].args, stdin=subprocess.PIPE
    ) as other:  # as if the process had been killed
        other.stdin.close()
        assert other.wait(timeout=300) == 0
    assert not list(tmp_path.rglob("*.nbc")), "it ended before it had compiled anything"
    (tmp_path / "done").mkdir()
    with ahead.compiled_beside():
        assert len(started) == 1, "all is compiled"
    monkeypatch.setattr(ahead, "cache_folder", lambda _: tmp_path / "file" / "done")
    (tmp_path / "file").touch()
    with ahead.compiled_beside():
        assert len(started) == 1, "nothing can be kept"
    monkeypatch.setattr(ahead, "cache_folder", lambda _: tmp_path / "never")
    monkeypatch.setattr(ahead, "Popen", mock.Mock(side_effect=BlockingIOError))
    with ahead.compiled_beside():
        assert ahead.Popen.called, "without another process one does it alone"
