"""Other codes at the work of :mod:`imaging_speed.cases`, each tuned as well as we could.

Making plans is not timed.
"""

from __future__ import annotations

import importlib
import importlib.util
import math
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
from numba import cuda, get_num_threads
from numpy.typing import NDArray
from scipy import fft

from flgpr.kernels import gpu
from flgpr.kernels.windows import band_weights, boxcar
from flgpr.model import SPEED_OF_LIGHT
from imaging_speed.cases import SUBBANDS, Case, ComplexArray, DirectSums, ImagedScan

BIN_SIZES = (256, 512, 1024, 2048, 4096)
"""Bins of cuFINUFFT that are tried; its shared memory must hold them."""


def missing_peers(device: str = "cpu") -> list[str]:
    """Return the names of a device's peers that are not installed."""
    names = ("finufft", "fastsar") if device == "cpu" else ("cufinufft",)
    return [name for name in names if importlib.util.find_spec(name) is None]


def peer_cases(scan: ImagedScan, exact: DirectSums) -> list[Case]:
    """Return the installed peers' cases; NumPy is always there."""
    cases = _numpy_cases(scan, exact)
    missing = missing_peers()
    if "finufft" not in missing:
        cases += _finufft_cases(scan, exact, 1e-3, "")
        cases += _finufft_cases(scan, exact, 1e-5, ", 1e-5")
    if "fastsar" not in missing:
        cases += _fastsar_cases(scan, exact)
    return cases


def _paths(scan: ImagedScan) -> NDArray[np.float64]:
    """Return the paths (pair, pixel) by way of every pixel, m."""
    paths = []
    for tx, rx in zip(scan.tx, scan.rx, strict=True):
        from_tx = np.linalg.norm(scan.pixels - tx, axis=1)
        to_rx = np.linalg.norm(scan.pixels - rx, axis=1)
        paths.append(from_tx + to_rx)
    return np.array(paths)


def _carriers(scan: ImagedScan, paths: NDArray[np.float64]) -> ComplexArray:
    """Return the phase factors (pair, pixel) of the middle tone."""
    middle_tone = scan.frequency[scan.frequency.size // 2]
    turns = paths * (middle_tone / SPEED_OF_LIGHT)
    fraction = turns - np.floor(turns)
    return np.exp(2j * np.pi * fraction).astype(np.complex64)


def _angles(scan: ImagedScan, paths: NDArray[np.float64]) -> NDArray[np.float32]:
    """Return the phase (pair, pixel) between neighbouring tones, from -π to π, rad."""
    step = scan.frequency[1] - scan.frequency[0]
    turns = paths * (step / SPEED_OF_LIGHT)
    # Whole turns are dropped in double precision, before single precision loses them.
    return (2 * np.pi * (turns - np.rint(turns))).astype(np.float32)


def _subband_data(scan: ImagedScan, pair: int) -> ComplexArray:
    """Return the data (polarization·subband, tone) of a pair, cut to every sub-band."""
    weights = band_weights(scan.frequency, SUBBANDS, boxcar).astype(np.float32)
    of_subbands = scan.data[:, None, pair] * weights
    return of_subbands.reshape(-1, scan.frequency.size)


class _Finufft:
    """One-dimensional plans per pair, one thread each; threads share the pairs.

    That is faster here than threads inside a plan.
    """

    def __init__(self, scan: ImagedScan, tolerance: float) -> None:
        self._finufft = importlib.import_module("finufft")
        self._scan = scan
        self._tolerance = tolerance
        paths = _paths(scan)
        self._angle = _angles(scan, paths)
        self._carrier = _carriers(scan, paths)
        self._threads = get_num_threads()
        self._pool = ThreadPoolExecutor(self._threads)

    def _plans(self, kind: int, many: int) -> list[Any]:
        """Return a plan per pair, of a type of transform, for many data at once."""
        tones = self._scan.frequency.size
        plans = []
        for angle in self._angle:
            plan = self._finufft.Plan(
                kind,
                (tones,),
                many,
                eps=self._tolerance,
                isign=1 if kind == 2 else -1,
                dtype="complex64",
                nthreads=1,
                spread_sort=0,
            )
            plan.setpts(angle)
            plans.append(plan)
        return plans

    def images(
        self, data_of: Callable[[int], ComplexArray], many: int
    ) -> Callable[[], ComplexArray]:
        """Return a function that images the data (many, tone) of every pair."""
        plans = self._plans(2, many)
        count = len(self._scan.pixels)
        # One of each for every thread: they are added when all are done.
        images = np.empty((self._threads, many, count), np.complex64)
        totals = np.empty((self._threads, many, count), np.complex64)

        def image_share(thread: int) -> None:
            for pair in range(thread, len(plans), self._threads):
                data = data_of(pair)
                if many > 1:
                    plans[pair].execute(data, out=images[thread])
                else:
                    # A plan of a single transform takes arrays without the axis of transforms.
                    plans[pair].execute(data[0], out=images[thread, 0])
                images[thread] *= self._carrier[pair]
                totals[thread] += images[thread]

        def run() -> ComplexArray:
            totals[:] = 0
            self._on_all_threads(image_share)
            subbands = max(many // 3, 1)
            total = totals.sum(axis=0).reshape(-1, subbands, count)
            return np.asarray(total, dtype=np.complex64)

        return run

    def _on_all_threads(self, work: Callable[[int], None]) -> None:
        """Call a function with the number of every thread, each on its thread, and wait."""
        for _ in self._pool.map(work, range(self._threads)):
            pass

    def forward(self) -> Callable[[], ComplexArray]:
        """Return a function that computes the data of an image."""
        plans = self._plans(1, 1)
        conjugate = self._carrier.conj()
        data = np.empty((1, len(plans), self._scan.frequency.size), np.complex64)

        def compute_share(thread: int) -> None:
            for pair in range(thread, len(plans), self._threads):
                image = self._scan.image[0, 0] * conjugate[pair]
                plans[pair].execute(image, out=data[0, pair])

        def run() -> ComplexArray:
            self._on_all_threads(compute_share)
            return data

        return run


def _finufft_cases(
    scan: ImagedScan, exact: DirectSums, tolerance: float, suffix: str
) -> list[Case]:
    """Return the cases of FINUFFT; those with a suffix are of images alone."""
    peer = _Finufft(scan, tolerance)
    code = f"finufft, eps {tolerance:g}"

    def subband_data(pair: int) -> ComplexArray:
        return _subband_data(scan, pair)

    def channel_data(pair: int) -> ComplexArray:
        return scan.data[:1, pair]

    cases = [Case("15 images" + suffix, code, peer.images(subband_data, 15), exact.images, 15)]
    if not suffix:
        image_channel = peer.images(channel_data, 1)
        cases.append(Case("one channel", code, image_channel, exact.channel, 1))
        cases.append(Case("forward", code, peer.forward(), exact.forward[:1], 1))
    return cases


def _numpy_cases(scan: ImagedScan, exact: DirectSums) -> list[Case]:
    """Return the case of zero-padded transforms that are interpolated linearly.

    All images share the indices and the weights.
    """
    size = 8 * scan.frequency.size
    middle = scan.frequency.size // 2
    paths = _paths(scan)
    pairs, count = paths.shape
    step = scan.frequency[1] - scan.frequency[0]
    # A range profile repeats after the unambiguous path.
    share = paths * (step / SPEED_OF_LIGHT) % 1
    position = share * size
    low = position.astype(np.int32)
    fraction = (position - low).astype(np.float32)
    carrier = _carriers(scan, paths)

    def range_profiles(pair: int) -> ComplexArray:
        tones = _subband_data(scan, pair)
        # The middle tone is put at zero: it is the carrier's.
        padded = np.zeros((15, size), np.complex64)
        padded[:, : tones.shape[1] - middle] = tones[:, middle:]
        padded[:, -middle:] = tones[:, :middle]
        profiles = fft.ifft(padded, axis=1, norm="forward", workers=get_num_threads())
        return np.asarray(profiles)

    def images() -> ComplexArray:
        total = np.zeros((15, count), np.complex64)
        for pair in range(pairs):
            profiles = range_profiles(pair)
            before = carrier[pair] * (1 - fraction[pair])
            after = carrier[pair] * fraction[pair]
            high = (low[pair] + 1) % size
            for image, profile in zip(total, profiles, strict=True):
                image += profile[low[pair]] * before + profile[high] * after
        return total.reshape(3, 5, -1)

    return [Case("15 images", "numpy, linear", images, exact.images, 15)]


def _fastsar_cases(scan: ImagedScan, exact: DirectSums) -> list[Case]:
    """Return the cases of exact backprojection in C++, one image per call."""
    fastsar = importlib.import_module("fastsar")
    step = float(scan.frequency[1] - scan.frequency[0])
    origin = np.zeros(len(scan.tx))

    def image(data: ComplexArray, first_tone: float) -> ComplexArray:
        value = fastsar.backproject(
            data,
            scan.tx,
            first_tone,
            step,
            scan.pixels,
            rcv=scan.rx,
            ref=origin,
            backend="cpu",
            upsample=8,
            window=False,
        )
        return np.asarray(value)

    subbands = band_weights(scan.frequency, SUBBANDS, boxcar) > 0

    def subband_images(data: ComplexArray) -> list[ComplexArray]:
        values = []
        for is_inside in subbands:
            first_tone = scan.frequency[is_inside][0]
            values.append(image(data[:, is_inside], first_tone))
        return values

    def images() -> ComplexArray:
        return np.array([subband_images(data) for data in scan.data])

    def channel() -> ComplexArray:
        return image(scan.data[0], float(scan.frequency[0]))[None, None]

    return [
        Case("15 images", "fastsar", images, exact.images, 15),
        Case("one channel", "fastsar", channel, exact.channel, 1),
    ]


@cuda.jit
def _add(values, carrier, total, begins):  # type: ignore[no-untyped-def]
    """Add the channels of a pair, turned by its carrier, to those of the pairs before it."""
    p, c = cuda.grid(2)
    if p < total.shape[1]:
        value = values[c, p] * carrier[p]
        total[c, p] = value if begins else total[c, p] + value


def cufinufft_rows(scan: ImagedScan, exact: DirectSums, rounds: int) -> list[tuple[Any, ...]]:
    """Time cuFINUFFT on data on the device.

    One plan per pair, all channels in one call of it; the carrier and the sum over the pairs are a
    kernel of ours. Of both methods and some sizes of bins the fastest counts.

    Parameters
    ----------
    scan : ImagedScan
        The scan that is imaged.
    exact : DirectSums
        What images are checked against.
    rounds : int
        Rounds, whose medians count.

    Returns
    -------
    list of tuple
        Rows as those of :func:`imaging_speed.speed.bench_imaging`.
    """
    pairs = range(len(scan.tx))
    subband_data = [_subband_data(scan, pair) for pair in pairs]
    channel_data = [scan.data[:1, pair] for pair in pairs]
    works = (
        ("15 images", subband_data, exact.images),
        ("one channel", channel_data, exact.channel),
    )

    peer = _Cufinufft(scan)
    rows = []
    for work, data, sums in works:
        trials = _cufinufft_trials(peer, data, sums, exact.pixel, rounds)
        if not trials:
            continue
        seconds, code, error = min(trials)
        channels = len(data[0])
        updates = len(scan.pixels) * len(scan.tx) * channels
        rows.append((f"{work}, on the device", code, seconds, error, updates / seconds, np.nan))
    return rows


def _cufinufft_trials(
    peer: _Cufinufft,
    data: list[ComplexArray],
    sums: NDArray[np.complex128],
    pixel: NDArray[np.int64],
    rounds: int,
) -> list[tuple[float, str, float]]:
    """Return time (s), name and error for every method and size of bins that fits the device."""
    trials = []
    for method in (1, 2):
        for bins in BIN_SIZES:
            timed = peer.timed_images(data, method, bins, rounds)
            if timed is None:
                continue
            seconds, images = timed
            checked = images[:, pixel].reshape(sums.shape)
            error = float(np.linalg.norm(checked - sums) / np.linalg.norm(sums))
            trials.append((seconds, f"cufinufft, method {method}, bins {bins}", error))
    return trials


class _Cufinufft:
    """Plans of cuFINUFFT for all pairs, with their carriers on the device."""

    def __init__(self, scan: ImagedScan) -> None:
        self._cufinufft = importlib.import_module("cufinufft")
        self._tones = scan.frequency.size
        self._count = len(scan.pixels)
        paths = _paths(scan)
        self._angles = [cuda.to_device(row) for row in _angles(scan, paths)]
        self._carriers = [cuda.to_device(row) for row in _carriers(scan, paths)]

    def timed_images(
        self, data_by_pair: list[ComplexArray], method: int, bins: int, rounds: int
    ) -> tuple[float, ComplexArray] | None:
        """Return the median time, s, and the images; None where bins do not fit the device."""
        many = len(data_by_pair[0])
        plans = self._plans(many, method, bins)
        if plans is None:
            return None
        data = []
        for values in data_by_pair:
            data.append(cuda.to_device(np.ascontiguousarray(values)))
        image = cuda.device_array((many, self._count), np.complex64)
        total = cuda.device_array((many, self._count), np.complex64)

        times = []
        for _ in range(rounds + 1):
            start = time.perf_counter()
            for pair, plan in enumerate(plans):
                if many > 1:
                    plan.execute(data[pair], out=image)
                else:
                    # A plan of a single transform takes arrays without the axis of transforms.
                    plan.execute(data[pair][0], out=image[0])
                self._add_pair(image, pair, total)
            cuda.synchronize()
            times.append(time.perf_counter() - start)
        # The first round compiles and is not counted.
        return float(np.median(times[1:])), total.copy_to_host()

    def _add_pair(self, image: Any, pair: int, total: Any) -> None:
        """Add the channels of a pair (channel, pixel), turned by its carrier, to the total."""
        channels = image.shape[0]
        blocks = (math.ceil(self._count / gpu.THREADS), channels)
        threads = (gpu.THREADS, 1)
        begins = int(pair == 0)
        _add[blocks, threads](image, self._carriers[pair], total, begins)

    def _plans(self, many: int, method: int, bins: int) -> list[Any] | None:
        """Return a plan for each pair; None where a bin does not fit the device."""
        options = {
            "eps": 1e-3,
            "isign": 1,
            "dtype": "complex64",
            "gpu_method": method,
            "gpu_binsizex": bins,
        }
        plans = []
        try:
            for angle in self._angles:
                plan = self._cufinufft.Plan(2, (self._tones,), many, **options)
                plan.setpts(angle)
                plans.append(plan)
        except RuntimeError:
            return None
        return plans
