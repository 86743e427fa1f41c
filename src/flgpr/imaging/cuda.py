"""The profile engine on a CUDA device: passes of a few scans in several streams, transfers beside sums."""

from __future__ import annotations

import math
import time
from threading import Lock
from typing import Any

import numpy as np
from numba import cuda
from numpy.typing import NDArray

from flgpr.imaging.engines import Engine
from flgpr.imaging.plan import Plan
from flgpr.kernels import gpu
from flgpr.kernels.layout import padded
from flgpr.kernels.transform import Spectrum
from flgpr.model.arrays import ComplexArray, FloatArray

GROUP = 16
"""Most channels that a thread keeps in registers."""
STREAMS = 3
"""Passes in flight: one going in, one being summed, one coming out."""
PASS_BYTES = 1 << 28
"""Memory for the profiles of a pass."""


_Launches = list[tuple[Any, tuple[Any, ...]]]


class _Lane:
    """A stream and the memory of its passes: page-locked input, input, profiles, spectra in work and output."""

    def __init__(
        self, given: tuple[int, ...], out: tuple[int, ...], table: int, spare: tuple[int, int]
    ) -> None:
        self.stream = cuda.stream()
        self.staging = cuda.pinned_array(given, np.complex64)
        self.given = cuda.device_array(given, np.complex64)
        self.out = cuda.device_array(out, np.complex64)
        self.table = cuda.device_array(table, np.complex64)
        self.spare = cuda.device_array(spare, np.complex64)


class CudaEngine(Engine):
    """Range profiles and their interpolation in single precision on a CUDA device.

    All engines share the memory of their passes: a vehicle that pitches and rolls needs an engine per scan.
    """

    _held: tuple[Any, list[_Lane]] | None = None
    _lock = Lock()

    def __init__(self, plan: Plan, weight: FloatArray) -> None:
        if not cuda.is_available():
            raise ValueError("device must be 'cpu' on a machine without a CUDA device, got 'cuda'")
        self._spectrum = plan.spectrum.single()
        self._bins = plan.bins
        self.width = plan.window.width
        self._geometry = plan.geometry()
        self._on_device = _Constants(self._spectrum, weight, plan.phase)
        self._place_antennas()
        self._order: tuple[Any, Any] | None = None
        self._unit = np.float32(0.5**self._geometry.shift)
        self._stride = 1 << max(5, (plan.bins - 1).bit_length())

    def buffer(self, shape: tuple[int, ...], dtype: np.dtype[Any]) -> NDArray[Any]:
        """Make page-locked memory, which transfers reach without a copy."""
        return (
            np.asarray(cuda.pinned_array(shape, dtype))
            if math.prod(shape)
            else np.empty(shape, dtype)
        )

    def adjoint(self, data: NDArray[Any], out: NDArray[Any]) -> None:
        """Fill ``out`` (polarization, subband, pixel) from ``data`` (polarization, pair, tone)."""
        self._run(data, out, self._adjoint_pass, out.shape[1])

    def forward(self, image: NDArray[Any], out: NDArray[Any]) -> None:
        """Fill ``out`` (polarization, pair, tone) from ``image`` (polarization, subband, pixel)."""
        self._run(image, out, self._forward_pass, image.shape[1])

    def device_seconds(self, rows: int, subbands: int, repeats: int = 10) -> tuple[float, float]:
        """Time the adjoint of all rows, polarizations of all scans together, on data on the device already, s.

        The second time is that of the interpolation alone.
        """
        shape = (self._geometry.tx.size, self._spectrum.entries.size - 1)
        with self._lock:
            lane = self._lanes(rows, shape, (subbands, self._geometry.pixel_count), subbands)[0]
            lane.staging[...] = 1
            lane.given.copy_to_device(lane.staging, stream=lane.stream)
            launches = self._adjoint_pass(lane, rows)
            seconds = []
            for some in (launches, launches, launches[1:]):  # the first time it compiles
                start = time.perf_counter()
                for kernel, arguments in some * repeats:
                    kernel(*arguments)
                lane.stream.synchronize()
                seconds.append((time.perf_counter() - start) / repeats)
            return seconds[1], seconds[2]

    def _run(self, given: NDArray[Any], out: NDArray[Any], step: Any, bands: int) -> None:
        """Send the rows of ``given`` through ``step``, a few at a time, each pass in the next stream."""
        row_bytes = 8 * bands * self._geometry.tx.size * (self._row() + self._spare())
        rows = max(1, min(PASS_BYTES // row_bytes, -(-given.shape[0] // STREAMS)))
        with self._lock:
            lanes = self._lanes(rows, given.shape[1:], out.shape[1:], bands)
            for number, start in enumerate(range(0, given.shape[0], rows)):
                lane = lanes[number % STREAMS]
                count = min(rows, given.shape[0] - start)
                lane.stream.synchronize()
                lane.staging[:count] = given[start : start + count]
                lane.given[:count].copy_to_device(lane.staging[:count], stream=lane.stream)
                for kernel, arguments in step(lane, count):
                    kernel(*arguments)
                lane.out[:count].copy_to_host(out[start : start + count], stream=lane.stream)
            for lane in lanes:
                lane.stream.synchronize()

    def _row(self) -> int:
        """Places of a profile in the table: its bins when images are made of it, else its slots."""
        return max(self._stride, self._spectrum.size)

    def _spare(self) -> int:
        """Places for a spectrum in work that shared memory does not hold."""
        return 2 * self._spectrum.size if self._spectrum.size > gpu.SHARED_BINS else 0

    def _lanes(
        self, rows: int, given: tuple[int, ...], out: tuple[int, ...], bands: int
    ) -> list[_Lane]:
        """Memory and streams for passes of ``rows`` rows, kept from call to call."""
        pairs = self._geometry.tx.size
        table = pairs * _groups(rows * bands)[1] * self._row()
        spare = (rows * bands * pairs, self._spare()) if self._spare() else (1, 1)
        wanted = ((rows, *given), (rows, *out), table, spare)
        if CudaEngine._held is None or CudaEngine._held[0] != wanted:
            CudaEngine._held = None  # lets the memory go before more is taken
            CudaEngine._held = (wanted, [_Lane(*wanted) for _ in range(STREAMS)])
        return CudaEngine._held[1]

    def _adjoint_pass(self, lane: _Lane, rows: int) -> _Launches:
        """Kernels of a pass with their arguments, in their order."""
        here = self._on_device
        g = self._geometry
        stream = lane.stream
        bands, count = lane.out.shape[1:]
        pairs = g.tx.size
        size = self._spectrum.size
        # Groups are those of a full pass, so that no pass needs a kernel of its own.
        group, channels = _groups(lane.out.shape[0] * bands)
        table = lane.table[: pairs * channels * self._stride]
        compress = gpu.compress_kernel(size)[(pairs, rows * bands), _block(size), stream]
        tones = (
            lane.given[:rows], here.weight, here.begin, here.tone, here.slot_share, here.phase, here.factor,
            here.twiddle, self._spectrum.first, self._bins, lane.spare, table.reshape(pairs, channels, self._stride),
        )  # fmt: skip
        blocks = (-(-count // gpu.THREADS), -(-rows * bands // group))
        interpolate = gpu.adjoint_kernel(self.width, group, self._stride)[
            blocks, gpu.THREADS, stream
        ]
        profiles = (
            table.view(np.uint64), channels, here.tx, here.rx, self._delay, self._phasor, g.origin, g.shift, self._unit,
            here.taps, lane.out[:rows].reshape(rows * bands, count),
        )  # fmt: skip
        return [(compress, tones), (interpolate, profiles)]

    def _forward_pass(self, lane: _Lane, rows: int) -> _Launches:
        """Kernels of a pass with their arguments, in their order."""
        here = self._on_device
        g = self._geometry
        stream = lane.stream
        bands, count = lane.given.shape[1:]
        channels = rows * bands
        pairs = g.tx.size
        size = self._spectrum.size
        table = lane.table[: pairs * channels * size].reshape(pairs, channels, size)
        begin, order = self._sorted_pixels()
        group, _ = _groups(lane.given.shape[0] * bands)
        blocks = (-(-size // gpu.THREADS), pairs, -(-channels // group))
        spread = gpu.forward_kernel(self.width, group)[blocks, (gpu.THREADS, 1, 1), stream]
        image = (
            lane.given[:rows].reshape(channels, count).view(np.uint64), here.tx, here.rx, self._delay, self._phasor,
            g.origin, g.shift, self._unit, begin, order, self._spectrum.first, self._bins, here.taps, table,
        )  # fmt: skip
        expand = gpu.expand_kernel(size)[(pairs, channels), _block(size), stream]
        out = lane.out[:rows]
        collect = self._launch(gpu.collect, (out.shape[2], out.shape[1], out.shape[0]), stream)
        tones = (table, here.weight, here.entries, here.slot, here.share, here.phase, out)
        return [
            (spread, image),
            (expand, (table, here.factor, here.twiddle, lane.spare)),
            (collect, tones),
        ]

    @staticmethod
    def _launch(kernel: Any, size: tuple[int, ...], stream: Any) -> Any:
        threads = min(gpu.THREADS, size[0])
        return kernel[
            (-(-size[0] // threads), *size[1:]), (threads, *(1 for _ in size[1:])), stream
        ]

    def _place_antennas(self) -> None:
        g = self._geometry
        shape = (g.antenna.shape[0], g.pixels.shape[1])
        delay = cuda.device_array(shape, np.uint32)
        phasor = cuda.device_array(shape, np.complex64)
        arrays = (
            cuda.to_device(np.ascontiguousarray(array)) for array in (g.pixels, g.antenna, g.medium)
        )
        gain = cuda.to_device(g.gain if g.gain.size else np.zeros((1, 1), np.float32)[:, :0])
        stream = cuda.default_stream()
        self._launch(gpu.locate, (shape[1], shape[0]), stream)(
            *arrays, g.per_turn, g.carrier, gain, delay, phasor
        )
        stream.synchronize()
        self._delay = delay.reshape(-1)
        self._phasor = phasor.reshape(-1).view(np.uint64)
        begins = (
            cuda.to_device((antenna * shape[1]).astype(np.uint64)) for antenna in (g.tx, g.rx)
        )
        self._on_device.tx, self._on_device.rx = begins
        weight = g.weight.reshape(-1, padded(self.width))[:, : self.width].T
        self._on_device.taps = cuda.to_device(np.ascontiguousarray(weight))

    def _sorted_pixels(self) -> tuple[Any, Any]:
        """Pixels of every pair in the order of their bins, and where each bin begins; made at the first use."""
        if self._order is None:
            g = self._geometry
            reach = self._bins - self.width
            delay = (
                self._delay.copy_to_host()
                .reshape(g.antenna.shape[0], -1)[:, : g.pixel_count]
                .astype(np.int64)
            )
            order = np.empty((g.tx.size, g.pixel_count), np.int32)
            begin = np.empty((g.tx.size, reach + 1), np.int32)
            for q in range(g.tx.size):
                bins = ((delay[g.tx[q]] + delay[g.rx[q]] - g.origin) % 2**32) >> g.shift
                order[q] = np.argsort(bins, kind="stable")
                begin[q] = np.searchsorted(bins[order[q]], np.arange(reach + 1))
            self._order = cuda.to_device(begin), cuda.to_device(order)
        return self._order


def _groups(channels: int) -> tuple[int, int]:
    """Channels per thread, as many for every thread, and those of all threads together: ``channels`` or a few more."""
    number = -(-channels // GROUP)
    group = -(-channels // number)
    return group, number * group


def _block(size: int) -> int:
    """Threads that transform a profile: one per butterfly of a pass, or several turns of them."""
    return min(2 * gpu.THREADS, max(1, size // 4))


class _Constants:
    """Arrays of the tones and the window, on the device."""

    tx: Any
    rx: Any
    taps: Any

    def __init__(self, spectrum: Spectrum, weight: FloatArray, phase: ComplexArray | None) -> None:
        tone = np.repeat(np.arange(spectrum.entries.size - 1), np.diff(spectrum.entries))
        order = np.argsort(spectrum.slot, kind="stable")
        begin = np.searchsorted(spectrum.slot[order], np.arange(spectrum.size + 1))
        factor = np.ones(spectrum.size, np.float32)
        bins = min(spectrum.factor.size, spectrum.size)
        factor[(spectrum.first + np.arange(bins)) % spectrum.size] = spectrum.factor[:bins]
        none = np.zeros((1, 1), np.complex64)[:0]
        self.weight = cuda.to_device(weight.astype(np.float32))
        self.begin = cuda.to_device(begin.astype(np.uint64))
        self.tone = cuda.to_device(tone[order].astype(np.uint64))
        self.slot_share = cuda.to_device(spectrum.share[order])
        self.share = cuda.to_device(spectrum.share)
        self.entries = cuda.to_device(spectrum.entries)
        self.slot = cuda.to_device(spectrum.slot)
        self.phase = cuda.to_device(none if phase is None else phase.astype(np.complex64))
        self.factor = cuda.to_device(factor)
        self.twiddle = cuda.to_device(spectrum.twiddle)
