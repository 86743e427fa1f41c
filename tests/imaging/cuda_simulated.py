"""The CUDA backend on tiny arrays. Run in its own process, under the simulator or on a device (see test_cuda.py)."""

import itertools
import sys
from pathlib import Path
from threading import Thread
from types import SimpleNamespace

import numpy as np
import pytest
from numba import config, cuda

from flgpr.imaging import ImagingOperator
from flgpr.imaging import cuda as backend
from flgpr.method.imaged_run import imager_of
from flgpr.recipe.schema import parse_recipe, recipe_text
from flgpr.store import open_run, sample_lane

sys.path.append(str(Path(__file__).parents[2] / "benchmarks"))

from imaging_speed import cases as bench_cases
from imaging_speed import peers as bench_peers
from imaging_speed import speed as bench

TONES = 500e6 + 40e6 * np.arange(20)
TX = np.array([[-1.5, 0.0, 5.0], [-1.5, 0.0, 5.0], [1.5, 0.0, 5.2]])
RX = np.array([[-2.0, 0.0, 5.0], [2.0, 0.0, 5.0], [2.0, 0.0, 5.0]])
BANDS = ((0.5e9, 1.0e9), (0.9e9, 1.3e9))


@pytest.fixture(autouse=True)
def few_threads(monkeypatch):
    """Simulated threads are real ones, and those of a transform wait for each other."""
    if config.ENABLE_CUDASIM:
        monkeypatch.setattr(backend.gpu, "THREADS", 4)
        monkeypatch.setattr(backend, "_block", lambda size: 3)
        from numba.cuda.simulator.kernel import BlockThread

        # The simulator asks its threads again and again: it shall wait a moment for each, not take
        # their time.
        monkeypatch.setattr(
            BlockThread, "is_alive", lambda thread: thread.join(1e-4) or Thread.is_alive(thread)
        )


def scene(low=(-1, 7, -0.2), high=(1, 9, 0.1), count=8):
    return np.random.default_rng(0).uniform(low, high, size=(count, 3))


def noise(shape, seed=0):
    rng = np.random.default_rng(seed)
    return (rng.normal(size=shape) + 1j * rng.normal(size=shape)).astype(np.complex64)


def beam(position, points):
    return 1 + 0.1 * (points[:, 1] - position[0])


def relative(value, truth):
    return np.linalg.norm(value - truth) / np.linalg.norm(truth)


CASES = {
    "bands": {"subbands": BANDS, "tolerance": 1e-3, "window": "hann"},
    "odd width": {"tolerance": 4e-3},
    "fine": {"tolerance": 1e-5, "subbands": BANDS},
    "ground": {"half_space": 3.4},
    "pattern and offset": {"tx_pattern": beam, "rx_pattern": beam, "path_offset": [0.0, 1.0, 30.0]},
    "uneven": {
        "frequency": np.sort(np.random.default_rng(1).uniform(0.5e9, 1.3e9, 20)),
        "subbands": BANDS,
    },
    "wrapping": {"pixels": scene((-20, 7, 0), (20, 30, 1))},
}


@pytest.mark.parametrize("name", CASES)
def test_both_directions_agree_with_the_direct_sum(name):
    case = {
        "frequency": TONES,
        "tx_position": TX,
        "rx_position": RX,
        "pixels": scene(),
        **CASES[name],
    }
    operator = ImagingOperator(**case, device="cuda")
    exact = ImagingOperator(**case, method="direct")
    data = noise((2, 3, 20))
    image = noise((2, len(exact.subbands), 8), seed=1)
    adjoint = operator.adjoint(data)
    forward = operator.forward(image)
    assert relative(adjoint, exact.adjoint(data)) < exact.tolerance
    assert relative(forward, exact.forward(image)) < exact.tolerance
    gap = np.vdot(forward.astype(complex), data) - np.vdot(image, adjoint.astype(complex))
    assert abs(gap) < 1e-6 * np.linalg.norm(forward) * np.linalg.norm(data)


def test_profiles_too_long_for_shared_memory_are_transformed_in_the_device_s(monkeypatch):
    makers = backend.gpu.compress_kernel, backend.gpu.expand_kernel
    monkeypatch.setattr(backend.gpu, "SHARED_BINS", 1)
    for maker in makers:
        maker.cache_clear()
    test_both_directions_agree_with_the_direct_sum("odd width")
    assert backend.CudaBackend._shared_lanes[1][0].spare.shape[1] > 1
    for maker in makers:
        maker.cache_clear()


def test_scans_go_through_in_batches(monkeypatch):
    monkeypatch.setattr(backend, "BATCH_BYTES", 1)
    operator = ImagingOperator(TONES, TX, RX, scene(count=5), device="cuda")
    data = noise((4, 1, 3, 20))
    images = operator.adjoint(data)
    assert images.shape == (4, 1, 1, 5)
    assert np.array_equal(images[2], operator.adjoint(data[2]))
    assert np.array_equal(operator.forward(images)[3], operator.forward(images[3]))


def test_more_channels_than_registers():
    edges = np.linspace(0.5e9, 1.3e9, 11)
    bands = tuple(itertools.pairwise(edges))
    operator = ImagingOperator(TONES, TX, RX, scene(count=4), bands, device="cuda")
    exact = ImagingOperator(TONES, TX, RX, scene(count=4), bands, method="direct")
    data = noise((1, 3, 20))
    assert relative(operator.adjoint(data), exact.adjoint(data)) < 1e-3
    image = exact.adjoint(data)
    assert relative(operator.forward(image), exact.forward(image)) < 1e-3


def test_double_precision_is_refused():
    with pytest.raises(
        ValueError, match=r"dtype must be complex64 .* with device 'cuda', got complex128"
    ):
        ImagingOperator(TONES, TX, RX, scene(), tolerance=1e-7, device="cuda")
    with pytest.raises(
        ValueError, match=r"method must be 'auto' or 'profile' with device 'cuda', got 'direct'"
    ):
        ImagingOperator(TONES, TX, RX, scene(), device="cuda", method="direct")


def test_nothing_in_nothing_out():
    operator = ImagingOperator(TONES, TX, RX, scene(), device="cuda")
    assert operator.adjoint(np.zeros((0, 3, 20))).shape == (0, 1, 8)


def test_page_locked_memory_holds_images():
    operator = ImagingOperator(TONES, TX, RX, scene(), device="cuda")
    data = noise((1, 3, 20))
    out = operator.image_buffer(1)
    assert operator.adjoint(data, out=out) is out
    assert np.array_equal(out, operator.adjoint(data))
    assert cuda.is_available()


def test_sums_on_the_device_are_timed():
    operator = ImagingOperator(TONES, TX, RX, scene(count=2), device="cuda")
    assert min(operator.backend.device_seconds(1, 1, repeats=1)) > 0
    assert np.isfinite(operator.adjoint(noise((1, 3, 20)))).all()


def test_a_recipe_chooses_the_device():
    text = recipe_text("demo").replace("[image]\n", '[image]\ndevice = "cuda"\n')
    imager = imager_of(open_run(sample_lane() / "run.zarr"), parse_recipe(text).image)
    assert isinstance(imager.operator_on(0, scene(count=2)).backend, backend.CudaBackend)


class Plan:
    """What cuFINUFFT's plan does, by sums over the points; bins over 1000 it refuses."""

    def __init__(self, kind, modes, many, eps, isign, dtype, gpu_method, gpu_binsizex):
        if gpu_binsizex > 1000:
            raise RuntimeError("Error creating plan.")
        assert (kind, isign, dtype) == (2, 1, "complex64")
        self.modes = np.arange(modes[0]) - modes[0] // 2
        self.many = many

    def setpts(self, x):
        self.kernel = np.exp(1j * np.outer(self.modes, x.copy_to_host()))

    def execute(self, data, out):
        assert data.shape == ((self.many, len(self.modes)) if self.many > 1 else (len(self.modes),))
        out.copy_to_device((data.copy_to_host() @ self.kernel).astype(np.complex64))


def test_the_benchmark_counts_batches_the_device_and_its_peer(monkeypatch):
    tones = 0.8e9 + 0.2e9 * np.arange(11)
    points = scene(count=3)
    monkeypatch.setitem(sys.modules, "cufinufft", SimpleNamespace(Plan=Plan))
    monkeypatch.setattr(bench, "missing_peers", lambda device: [])
    monkeypatch.setattr(bench_peers, "BIN_SIZES", (512, 2048))
    monkeypatch.setattr(bench, "REPEATS", 1)
    monkeypatch.setattr(
        backend, "_block", lambda size: 1
    )  # waiting for each other takes simulated threads longest
    scan = bench_cases.ImagedScan(
        tones, TX[:2], RX[:2], points, noise((3, 2, 11)), noise((3, 1, 3))
    )
    monkeypatch.setattr(bench, "sri_scan", lambda: scan)
    monkeypatch.setattr(bench_cases, "CHECKED_PIXELS", 3)
    monkeypatch.setattr(bench_cases, "CHECKED_TONES", 11)
    monkeypatch.setattr(bench, "BATCH", 2)
    monkeypatch.setattr(
        bench,
        "_interleaved_times",
        lambda runs, rounds: bench._Times([1.0] * len(runs), 1.0, 1.0),
    )
    table = bench.bench_imaging(peers=True, rounds=1, device="cuda")
    own = table[table["code"] == "flgpr cuda"].set_index("work")
    assert own.loc["15 images of 2 scans", "time"] == 0.5
    for work in ("15 images", "15 images of 2 scans", "one channel", "one channel of 2 scans"):
        assert own.loc[f"{work}, on the device", "rate"] > 0
        assert own.loc[f"{work}, interpolation alone", "rate"] > 0
    peer = table[table["code"].str.startswith("cufinufft, method")].set_index("work")
    assert set(peer.index) == {"15 images, on the device", "one channel, on the device"}
    assert (peer["ratio"] > 0).all()
    assert (table["error"] < 1e-3).all()
    assert "| 15 images, on the device | flgpr cuda |" in bench.format_bench(table)
