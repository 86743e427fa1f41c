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
from flgpr.kernels.transform import Spectrum
from flgpr.model.arrays import ComplexArray, FloatArray

GROUP = 8
"""Channels that a thread keeps in registers."""
STREAMS = 3
"""Passes in flight: one going in, one being summed, one coming out."""
PASS_BYTES = 1 << 28
"""Memory for the profiles of a pass."""


class _Lane:
    """A stream and the memory of its passes: input, output and two sets of spectra, and page-locked input."""

    def __init__(self, given: tuple[int, ...], out: tuple[int, ...], spectra: tuple[int, ...]) -> None:
        self.stream = cuda.stream()
        self.staging = cuda.pinned_array(given, np.complex64)
        self.given, self.out = cuda.device_array(given, np.complex64), cuda.device_array(out, np.complex64)
        self.spectra = [cuda.device_array(spectra, np.complex64) for _ in range(2)]


class CudaEngine(Engine):
    """Range profiles and their interpolation in single precision on a CUDA device."""

    def __init__(self, plan: Plan, weight: FloatArray) -> None:
        if not cuda.is_available():
            raise ValueError("device must be 'cpu' on a machine without a CUDA device, got 'cuda'")
        self._spectrum, self._bins, self.width = plan.spectrum.single(), plan.bins, plan.window.width
        self._geometry = plan.geometry()
        self._on_device = _Constants(self._spectrum, weight, plan.phase)
        self._place_antennas()
        self._order: tuple[Any, Any] | None = None
        self._held: tuple[Any, list[_Lane]] | None = None
        self._lock = Lock()

    def buffer(self, shape: tuple[int, ...], dtype: np.dtype[Any]) -> NDArray[Any]:
        """Make page-locked memory, which transfers reach without a copy."""
        return np.asarray(cuda.pinned_array(shape, dtype)) if math.prod(shape) else np.empty(shape, dtype)

    def adjoint(self, data: NDArray[Any], out: NDArray[Any]) -> None:
        """Fill ``out`` (polarization, subband, pixel) from ``data`` (polarization, pair, tone)."""
        self._run(data, out, self._adjoint_pass, out.shape[1])

    def forward(self, image: NDArray[Any], out: NDArray[Any]) -> None:
        """Fill ``out`` (polarization, pair, tone) from ``image`` (polarization, subband, pixel)."""
        self._run(image, out, self._forward_pass, image.shape[1])

    def device_seconds(self, rows: int, subbands: int, repeats: int = 10) -> float:
        """Time the adjoint of all rows, polarizations of all scans together, on data on the device already, s."""
        shape = (self._geometry.tx.size, self._spectrum.entries.size - 1)
        with self._lock:
            lane = self._lanes(rows, shape, (subbands, self._geometry.pixel_count), subbands)[0]
            lane.staging[...] = 1
            lane.given.copy_to_device(lane.staging, stream=lane.stream)
            self._adjoint_pass(lane, rows)
            lane.stream.synchronize()
            start = time.perf_counter()
            for _ in range(repeats):
                self._adjoint_pass(lane, rows)
            lane.stream.synchronize()
            return (time.perf_counter() - start) / repeats

    def _run(self, given: NDArray[Any], out: NDArray[Any], step: Any, bands: int) -> None:
        """Send the rows of ``given`` through ``step``, a few at a time, each pass in the next stream."""
        row_bytes = 16 * bands * self._geometry.tx.size * self._spectrum.size
        rows = max(1, min(PASS_BYTES // row_bytes, -(-given.shape[0] // STREAMS)))
        with self._lock:
            lanes = self._lanes(rows, given.shape[1:], out.shape[1:], bands)
            for number, start in enumerate(range(0, given.shape[0], rows)):
                lane, count = lanes[number % STREAMS], min(rows, given.shape[0] - start)
                lane.stream.synchronize()
                lane.staging[:count] = given[start : start + count]
                lane.given[:count].copy_to_device(lane.staging[:count], stream=lane.stream)
                step(lane, count)
                lane.out[:count].copy_to_host(out[start : start + count], stream=lane.stream)
            for lane in lanes:
                lane.stream.synchronize()

    def _lanes(self, rows: int, given: tuple[int, ...], out: tuple[int, ...], bands: int) -> list[_Lane]:
        """Memory and streams for passes of ``rows`` rows, kept from call to call."""
        if self._held is None or self._held[0] != (rows, given, out):
            spectra = (rows * bands, self._geometry.tx.size, self._spectrum.size)
            self._held = None
            self._held = ((rows, given, out), [_Lane((rows, *given), (rows, *out), spectra) for _ in range(STREAMS)])
        return self._held[1]

    def _adjoint_pass(self, lane: _Lane, rows: int) -> None:
        here, g, stream = self._on_device, self._geometry, lane.stream
        bands, count = lane.out.shape[1:]
        channels, pairs, size = rows * bands, g.tx.size, self._spectrum.size
        a, b = lane.spectra[0][:channels], lane.spectra[1][:channels]
        everything = (size, pairs, channels)
        self._launch(gpu.fill, everything, stream)(
            lane.given[:rows], here.weight, here.begin, here.tone, here.slot_share, here.phase, a
        )
        a = self._transform(a, b, 1.0, stream)
        if here.factor is not None:
            self._launch(gpu.scale, everything, stream)(a, here.factor)
        group = min(GROUP, channels)
        blocks = (-(-count // gpu.THREADS), -(-channels // group))
        gpu.adjoint_kernel(self.width, group)[blocks, gpu.THREADS, stream](
            a.reshape(channels * pairs * size), size, here.tx, here.rx, self._delay, self._phasor, g.origin, g.shift,
            self._spectrum.first, here.taps, lane.out[:rows].reshape(channels, count),
        )  # fmt: skip

    def _forward_pass(self, lane: _Lane, rows: int) -> None:
        here, g, stream = self._on_device, self._geometry, lane.stream
        bands, count = lane.given.shape[1:]
        channels, pairs, size = rows * bands, g.tx.size, self._spectrum.size
        a, b = lane.spectra[0][:channels], lane.spectra[1][:channels]
        begin, order = self._sorted_pixels()
        group = min(GROUP, channels)
        blocks = (-(-size // gpu.THREADS), pairs, -(-channels // group))
        gpu.forward_kernel(group)[blocks, (gpu.THREADS, 1, 1), stream](
            lane.given[:rows].reshape(channels, count), here.tx, here.rx, self._delay, self._phasor, g.origin, g.shift,
            begin, order, self._spectrum.first, self._bins, here.taps, a,
        )  # fmt: skip
        if here.factor is not None:
            self._launch(gpu.scale, (size, pairs, channels), stream)(a, here.factor)
        a = self._transform(a, b, -1.0, stream)
        out = lane.out[:rows]
        self._launch(gpu.collect, (out.shape[2], out.shape[1], out.shape[0]), stream)(
            a, here.weight, here.entries, here.slot, here.share, here.phase, out
        )

    def _transform(self, a: Any, b: Any, sign: float, stream: Any) -> Any:
        """Transform the last axis of ``a`` with ``b`` as work space; returns the one that holds the result."""
        channels, pairs, size = a.shape
        stride = 1
        while size // stride >= 4:
            self._launch(gpu.pass_four, (size // 4, pairs, channels), stream)(
                a, b, stride, self._on_device.twiddle, np.float32(sign)
            )
            a, b, stride = b, a, 4 * stride
        if size // stride == 2:
            self._launch(gpu.pass_two, (size // 2, pairs, channels), stream)(a, b)
            a, b = b, a
        return a

    @staticmethod
    def _launch(kernel: Any, size: tuple[int, ...], stream: Any) -> Any:
        threads = min(gpu.THREADS, size[0])
        return kernel[(-(-size[0] // threads), *size[1:]), (threads, *(1 for _ in size[1:])), stream]

    def _place_antennas(self) -> None:
        g = self._geometry
        shape = (g.antenna.shape[0], g.pixels.shape[1])
        self._delay, self._phasor = cuda.device_array(shape, np.uint32), cuda.device_array(shape, np.complex64)
        arrays = (cuda.to_device(np.ascontiguousarray(array)) for array in (g.pixels, g.antenna, g.medium))
        gain = cuda.to_device(g.gain if g.gain.size else np.zeros((1, 1), np.float32)[:, :0])
        stream = cuda.default_stream()
        self._launch(gpu.locate, (shape[1], shape[0]), stream)(
            *arrays, g.per_turn, g.carrier, gain, self._delay, self._phasor
        )
        stream.synchronize()
        self._on_device.tx, self._on_device.rx = cuda.to_device(g.tx), cuda.to_device(g.rx)
        self._on_device.taps = cuda.to_device(g.weight)

    def _sorted_pixels(self) -> tuple[Any, Any]:
        """Pixels of every pair in the order of their bins, and where each bin begins; made at the first use."""
        if self._order is None:
            g, reach = self._geometry, self._bins - self.width
            delay = self._delay.copy_to_host()[:, : g.pixel_count].astype(np.int64)
            order = np.empty((g.tx.size, g.pixel_count), np.int32)
            begin = np.empty((g.tx.size, reach + 1), np.int32)
            for q in range(g.tx.size):
                bins = ((delay[g.tx[q]] + delay[g.rx[q]] - g.origin) % 2**32) >> g.shift
                order[q] = np.argsort(bins, kind="stable")
                begin[q] = np.searchsorted(bins[order[q]], np.arange(reach + 1))
            self._order = cuda.to_device(begin), cuda.to_device(order)
        return self._order


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
        self.begin, self.tone = cuda.to_device(begin.astype(np.int64)), cuda.to_device(tone[order].astype(np.int64))
        self.slot_share, self.share = cuda.to_device(spectrum.share[order]), cuda.to_device(spectrum.share)
        self.entries, self.slot = cuda.to_device(spectrum.entries), cuda.to_device(spectrum.slot)
        self.phase = cuda.to_device(none if phase is None else phase.astype(np.complex64))
        self.factor = None if (factor == 1).all() else cuda.to_device(factor)
        self.twiddle = cuda.to_device(spectrum.twiddle)
