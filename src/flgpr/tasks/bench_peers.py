"""Other codes at the work of :mod:`flgpr.tasks.bench`, each as fast as we could make it run; plans are not timed."""

from __future__ import annotations

import importlib
import importlib.util
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
from numba import get_num_threads
from numpy.typing import NDArray
from scipy import fft

from flgpr.kernels.windows import band_weights, boxcar
from flgpr.model import SPEED_OF_LIGHT
from flgpr.tasks.bench import SUBBANDS, Case, Scan, Truth

ComplexArray = NDArray[np.complex64]


def missing_peers() -> list[str]:
    """Name the peers that are not installed."""
    return [name for name in ("finufft", "fastsar") if importlib.util.find_spec(name) is None]


def peer_cases(scan: Scan, truth: Truth) -> list[Case]:
    """List the installed peers' cases; NumPy is always there."""
    cases, missing = _numpy_cases(scan, truth), missing_peers()
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
        self._scan, self._tolerance = scan, tolerance
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
            options = {"eps": self._tolerance, "isign": 1 if kind == 2 else -1, "dtype": "complex64"}
            plan = self._finufft.Plan(kind, (self._scan.frequency.size,), many, nthreads=1, spread_sort=0, **options)
            plan.setpts(angle)
            plans.append(plan)
        return plans

    def images(self, data_of: Callable[[int], ComplexArray], many: int) -> Callable[[], ComplexArray]:
        plans, count = self._plans(2, many), len(self._scan.pixels)
        work = np.empty((2, self._threads, many, count), np.complex64)

        def run() -> ComplexArray:
            work[1] = 0

            def share(t: int) -> None:
                for q in range(t, len(plans), self._threads):
                    data = data_of(q)
                    plans[q].execute(data if many > 1 else data[0], out=work[0, t] if many > 1 else work[0, t, 0])
                    work[0, t] *= self._carrier[q]
                    work[1, t] += work[0, t]

            list(self._pool.map(share, range(self._threads)))
            return np.asarray(work[1].sum(axis=0).reshape(-1, many // 3 or 1, count), dtype=np.complex64)

        return run

    def forward(self) -> Callable[[], ComplexArray]:
        plans, back = self._plans(1, 1), self._carrier.conj()
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
    images = Case("15 images" + suffix, code, peer.images(lambda q: _by_band(scan, q), 15), truth.images, 15)
    if suffix:
        return [images]
    one = Case("one channel", code, peer.images(lambda q: scan.data[:1, q], 1), truth.channel, 1)
    return [images, one, Case("forward", code, peer.forward(), truth.forward[:1], 1)]


def _numpy_cases(scan: Scan, truth: Truth) -> list[Case]:
    """Zero-padded transforms read by linear interpolation, indices and weights shared by all images."""
    size, middle = 8 * scan.frequency.size, scan.frequency.size // 2
    paths, step = _paths(scan), scan.frequency[1] - scan.frequency[0]
    where = (paths * (step / SPEED_OF_LIGHT) % 1) * size
    low = where.astype(np.int32)
    part, carrier = (where - low).astype(np.float32), _carriers(scan, paths)

    def images() -> ComplexArray:
        out = np.zeros((15, paths.shape[1]), np.complex64)
        for q in range(paths.shape[0]):
            tones = _by_band(scan, q)
            padded = np.zeros((15, size), np.complex64)
            padded[:, : tones.shape[1] - middle], padded[:, -middle:] = tones[:, middle:], tones[:, :middle]
            profiles = fft.ifft(padded, axis=1, norm="forward", workers=get_num_threads())
            before, after = carrier[q] * (1 - part[q]), carrier[q] * part[q]
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
        return np.array([[image(data[:, band], first) for first, band in cuts] for data in scan.data])

    def one() -> ComplexArray:
        return image(scan.data[0], float(scan.frequency[0]))[None, None]

    return [
        Case("15 images", "fastsar", images, truth.images, 15),
        Case("one channel", "fastsar", one, truth.channel, 1),
    ]
