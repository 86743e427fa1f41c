"""Other codes at the work of :mod:`flgpr.commands.imaging_speed`, each as fast as we could make it run.

Plans are not timed.
"""

from __future__ import annotations

import importlib
import importlib.util
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
from numba import cuda, get_num_threads
from numpy.typing import NDArray
from scipy import fft

from flgpr.commands.imaging_speed import SUBBANDS, Case, Scan, Truth
from flgpr.kernels import gpu
from flgpr.kernels.windows import band_weights, boxcar
from flgpr.model import SPEED_OF_LIGHT

ComplexArray = NDArray[np.complex64]

BIN_SIZES = (256, 512, 1024, 2048, 4096)
"""Bins of cuFINUFFT that are tried; it takes none that its shared memory does not hold."""


def missing_peers(device: str = "cpu") -> list[str]:
    """Name the peers of a device that are not installed."""
    names = ("finufft", "fastsar") if device == "cpu" else ("cufinufft",)
    return [name for name in names if importlib.util.find_spec(name) is None]


def peer_cases(scan: Scan, truth: Truth) -> list[Case]:
    """List the installed peers' cases; NumPy is always there."""
    cases = _numpy_cases(scan, truth)
    missing = missing_peers()
    if "finufft" not in missing:
        cases += _finufft_cases(scan, truth, 1e-3, "") + _finufft_cases(scan, truth, 1e-5, ", 1e-5")
    if "fastsar" not in missing:
        cases += _fastsar_cases(scan, truth)
    return cases


def _paths(scan: Scan) -> NDArray[np.float64]:
    """Paths of all pairs and pixels, m, shape (pair, pixel)."""
    distance = [np.linalg.norm(scan.pixels - p, axis=1) for p in np.concatenate([scan.tx, scan.rx])]
    return np.array(distance[: len(scan.tx)]) + np.array(distance[len(scan.tx) :])


def _carriers(scan: Scan, paths: NDArray[np.float64]) -> ComplexArray:
    turns = paths * (scan.frequency[scan.frequency.size // 2] / SPEED_OF_LIGHT)
    return np.exp(2j * np.pi * (turns - np.floor(turns))).astype(np.complex64)


def _by_band(scan: Scan, q: int) -> ComplexArray:
    """Cut the data of a pair to every sub-band: shape (polarization·subband, tone)."""
    inside = band_weights(scan.frequency, SUBBANDS, boxcar).astype(np.float32)
    return (scan.data[:, None, q] * inside).reshape(-1, scan.frequency.size)


class _Finufft:
    """One-dimensional plans per pair, one thread each, the pairs shared by threads: faster here than threads inside."""

    def __init__(self, scan: Scan, tolerance: float) -> None:
        self._finufft = importlib.import_module("finufft")
        self._scan = scan
        self._tolerance = tolerance
        paths = _paths(scan)
        step = scan.frequency[1] - scan.frequency[0]
        turns = paths * (step / SPEED_OF_LIGHT)
        self._angle = (2 * np.pi * (turns - np.rint(turns))).astype(np.float32)
        self._carrier = _carriers(scan, paths)
        self._threads = get_num_threads()
        self._pool = ThreadPoolExecutor(self._threads)

    def _plans(self, kind: int, many: int) -> list[Any]:
        plans = []
        for angle in self._angle:
            options = {
                "eps": self._tolerance,
                "isign": 1 if kind == 2 else -1,
                "dtype": "complex64",
            }
            plan = self._finufft.Plan(
                kind, (self._scan.frequency.size,), many, nthreads=1, spread_sort=0, **options
            )
            plan.setpts(angle)
            plans.append(plan)
        return plans

    def images(
        self, data_of: Callable[[int], ComplexArray], many: int
    ) -> Callable[[], ComplexArray]:
        plans = self._plans(2, many)
        count = len(self._scan.pixels)
        work = np.empty((2, self._threads, many, count), np.complex64)

        def run() -> ComplexArray:
            work[1] = 0

            def share(t: int) -> None:
                for q in range(t, len(plans), self._threads):
                    data = data_of(q)
                    plans[q].execute(
                        data if many > 1 else data[0], out=work[0, t] if many > 1 else work[0, t, 0]
                    )
                    work[0, t] *= self._carrier[q]
                    work[1, t] += work[0, t]

            list(self._pool.map(share, range(self._threads)))
            return np.asarray(
                work[1].sum(axis=0).reshape(-1, many // 3 or 1, count), dtype=np.complex64
            )

        return run

    def forward(self) -> Callable[[], ComplexArray]:
        plans = self._plans(1, 1)
        back = self._carrier.conj()
        out = np.empty((1, len(plans), self._scan.frequency.size), np.complex64)

        def run() -> ComplexArray:
            def share(t: int) -> None:
                for q in range(t, len(plans), self._threads):
                    plans[q].execute(self._scan.image[0, 0] * back[q], out=out[0, q])

            list(self._pool.map(share, range(self._threads)))
            return out

        return run


def _finufft_cases(scan: Scan, truth: Truth, tolerance: float, suffix: str) -> list[Case]:
    peer = _Finufft(scan, tolerance)
    code = f"finufft, eps {tolerance:g}"
    images = Case(
        "15 images" + suffix, code, peer.images(lambda q: _by_band(scan, q), 15), truth.images, 15
    )
    if suffix:
        return [images]
    one = Case("one channel", code, peer.images(lambda q: scan.data[:1, q], 1), truth.channel, 1)
    return [images, one, Case("forward", code, peer.forward(), truth.forward[:1], 1)]


def _numpy_cases(scan: Scan, truth: Truth) -> list[Case]:
    """Zero-padded transforms read by linear interpolation, indices and weights shared by all images."""
    size = 8 * scan.frequency.size
    middle = scan.frequency.size // 2
    paths = _paths(scan)
    step = scan.frequency[1] - scan.frequency[0]
    where = (paths * (step / SPEED_OF_LIGHT) % 1) * size
    low = where.astype(np.int32)
    part = (where - low).astype(np.float32)
    carrier = _carriers(scan, paths)

    def images() -> ComplexArray:
        out = np.zeros((15, paths.shape[1]), np.complex64)
        for q in range(paths.shape[0]):
            tones = _by_band(scan, q)
            padded = np.zeros((15, size), np.complex64)
            padded[:, : tones.shape[1] - middle] = tones[:, middle:]
            padded[:, -middle:] = tones[:, :middle]
            profiles = fft.ifft(padded, axis=1, norm="forward", workers=get_num_threads())
            before = carrier[q] * (1 - part[q])
            after = carrier[q] * part[q]
            for image, profile in zip(out, profiles, strict=True):
                image += profile[low[q]] * before + profile[(low[q] + 1) % size] * after
        return out.reshape(3, 5, -1)

    return [Case("15 images", "numpy, linear", images, truth.images, 15)]


def _fastsar_cases(scan: Scan, truth: Truth) -> list[Case]:
    """Exact backprojection in C++; one image per call, its tones cut to the sub-band."""
    fastsar = importlib.import_module("fastsar")
    step = float(scan.frequency[1] - scan.frequency[0])
    origin = np.zeros(len(scan.tx))

    def image(data: ComplexArray, first: float) -> ComplexArray:
        options = {"rcv": scan.rx, "ref": origin, "backend": "cpu", "upsample": 8, "window": False}
        return np.asarray(fastsar.backproject(data, scan.tx, first, step, scan.pixels, **options))

    inside = band_weights(scan.frequency, SUBBANDS, boxcar) > 0
    cuts = [(scan.frequency[band][0], band) for band in inside]

    def images() -> ComplexArray:
        return np.array(
            [[image(data[:, band], first) for first, band in cuts] for data in scan.data]
        )

    def one() -> ComplexArray:
        return image(scan.data[0], float(scan.frequency[0]))[None, None]

    return [
        Case("15 images", "fastsar", images, truth.images, 15),
        Case("one channel", "fastsar", one, truth.channel, 1),
    ]


@cuda.jit
def _add(values, carrier, total, begins):  # type: ignore[no-untyped-def]
    """Add the channels of a pair, turned by its carrier, to those of the pairs before it."""
    p, c = cuda.grid(2)
    if p < total.shape[1]:
        value = values[c, p] * carrier[p]
        total[c, p] = value if begins else total[c, p] + value


def cufinufft_rows(scan: Scan, truth: Truth, rounds: int) -> list[tuple[Any, ...]]:
    """Rows of cuFINUFFT on data on the device, as those of :func:`flgpr.commands.imaging_speed.bench_imaging`.

    One plan per pair, all channels in one call of it; the carrier and the sum over the pairs are a kernel of ours. Of
    both methods and some bin sizes the fastest is told.
    """
    cufinufft = importlib.import_module("cufinufft")
    paths = _paths(scan)
    count = len(scan.pixels)
    step = scan.frequency[1] - scan.frequency[0]
    turns = paths * (step / SPEED_OF_LIGHT)
    angles = [
        cuda.to_device(row) for row in (2 * np.pi * (turns - np.rint(turns))).astype(np.float32)
    ]
    carriers = [cuda.to_device(row) for row in _carriers(scan, paths)]
    rows = []
    works = (("15 images", [_by_band(scan, q) for q in range(len(paths))], truth.images),
             ("one channel", [scan.data[:1, q] for q in range(len(paths))], truth.channel))  # fmt: skip
    for work, given, exact in works:
        many = len(given[0])
        data = [cuda.to_device(np.ascontiguousarray(one)) for one in given]
        values, total = (cuda.device_array((many, count), np.complex64) for _ in range(2))
        tried: list[tuple[float, str, float]] = []
        for method, bins in ((m, b) for m in (1, 2) for b in BIN_SIZES):
            options = {
                "eps": 1e-3,
                "isign": 1,
                "dtype": "complex64",
                "gpu_method": method,
                "gpu_binsizex": bins,
            }
            try:
                plans = [cufinufft.Plan(2, (scan.frequency.size,), many, **options) for _ in paths]
                for plan, angle in zip(plans, angles, strict=True):
                    plan.setpts(angle)
            except RuntimeError:  # a bin size that does not fit this device
                continue
            times = []
            for _ in range(rounds + 1):
                start = time.perf_counter()
                for q, plan in enumerate(plans):
                    plan.execute(
                        data[q] if many > 1 else data[q][0], out=values if many > 1 else values[0]
                    )
                    _add[(-(-count // gpu.THREADS), many), (gpu.THREADS, 1)](
                        values, carriers[q], total, int(q == 0)
                    )
                cuda.synchronize()
                times.append(time.perf_counter() - start)
            part = total.copy_to_host()[:, truth.pixel].reshape(exact.shape)
            error = float(np.linalg.norm(part - exact) / np.linalg.norm(exact))
            tried.append(
                (float(np.median(times[1:])), f"cufinufft, method {method}, bins {bins}", error)
            )
        if tried:
            seconds, code, error = min(tried)
            rate = count * len(paths) * many / seconds
            rows.append((f"{work}, on the device", code, seconds, error, rate, np.nan))
    return rows
