"""The imaging sums on a CUDA device, from range profiles: a few scans a batch, in several streams.

A batch is copied to the device, summed there and copied back in one stream, so that the transfers
of one batch overlap with the sums of another.
"""

from __future__ import annotations

import math
import time
from threading import Lock
from typing import Any

import numpy as np
from numba import cuda

from flgpr.imaging.backend import Backend
from flgpr.imaging.plan import Plan
from flgpr.kernels import gpu
from flgpr.kernels.layout import padded
from flgpr.kernels.transform import Spectrum
from flgpr.types import AnyArray, Complex128Array, FloatArray

GROUP = 16
"""Most channels that a thread keeps in registers."""
STREAMS = 3
"""Batches in flight: one going in, one being summed, one coming out."""
BATCH_BYTES = 1 << 28
"""Memory for the profiles of a batch."""


_Launches = list[tuple[Any, tuple[Any, ...]]]


class _Lane:
    """A stream and the memory of its batches."""

    def __init__(
        self, source: tuple[int, ...], out: tuple[int, ...], table: int, spare: tuple[int, int]
    ) -> None:
        self.stream = cuda.stream()
        self.staging = cuda.pinned_array(source, np.complex64)  # page-locked copy of the input
        self.source = cuda.device_array(source, np.complex64)
        self.out = cuda.device_array(out, np.complex64)
        self.table = cuda.device_array(table, np.complex64)  # range profiles
        self.spare = cuda.device_array(spare, np.complex64)  # spectra beyond shared memory


class CudaBackend(Backend):
    """Interpolate range profiles in single precision on a CUDA device.

    All backends share the memory of their batches: a vehicle that pitches and rolls needs one per
    scan.
    """

    # Shapes of the memory that all backends share, and its lanes.
    _shared_lanes: tuple[Any, list[_Lane]] | None = None
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

    def buffer(self, shape: tuple[int, ...], dtype: np.dtype[Any]) -> AnyArray:
        """Allocate page-locked memory, which transfers reach without a copy."""
        if not math.prod(shape):
            return np.empty(shape, dtype)
        return np.asarray(cuda.pinned_array(shape, dtype))

    def adjoint(self, data: AnyArray, out: AnyArray) -> None:
        """Fill ``out`` (polarization, subband, pixel) from ``data`` (polarization, pair, tone)."""
        self._run(data, out, self._adjoint_launches, out.shape[1])

    def forward(self, image: AnyArray, out: AnyArray) -> None:
        """Fill ``out`` (polarization, pair, tone) from ``image`` (polarization, subband, pixel)."""
        self._run(image, out, self._forward_launches, image.shape[1])

    def device_seconds(self, rows: int, subbands: int, repeats: int = 10) -> tuple[float, float]:
        """Measure the time of the adjoint, s, and of its interpolation alone, without transfers.

        ``rows`` are polarizations of all scans together.
        """
        shape = (self._geometry.tx.size, self._spectrum.entries.size - 1)
        with self._lock:
            lane = self._lanes(rows, shape, (subbands, self._geometry.pixel_count), subbands)[0]
            lane.staging[...] = 1
            lane.source.copy_to_device(lane.staging, stream=lane.stream)
            launches = self._adjoint_launches(lane, rows)
            seconds = []
            for timed in (launches, launches, launches[1:]):  # the first time it compiles
                start = time.perf_counter()
                for kernel, arguments in timed * repeats:
                    kernel(*arguments)
                lane.stream.synchronize()
                seconds.append((time.perf_counter() - start) / repeats)
            return seconds[1], seconds[2]

    def _run(self, source: AnyArray, out: AnyArray, step: Any, bands: int) -> None:
        """Send the rows of ``source`` through ``step``, a few at a time, in turn by stream."""
        row_bytes = 8 * bands * self._geometry.tx.size * (self._row() + self._spare())
        fits = BATCH_BYTES // row_bytes
        for_all_streams = -(-source.shape[0] // STREAMS)
        rows = max(1, min(fits, for_all_streams))
        with self._lock:
            lanes = self._lanes(rows, source.shape[1:], out.shape[1:], bands)
            for number, start in enumerate(range(0, source.shape[0], rows)):
                lane = lanes[number % STREAMS]
                count = min(rows, source.shape[0] - start)
                # The lane's memory is free once its last batch has come out.
                lane.stream.synchronize()
                lane.staging[:count] = source[start : start + count]
                lane.source[:count].copy_to_device(lane.staging[:count], stream=lane.stream)
                for kernel, arguments in step(lane, count):
                    kernel(*arguments)
                lane.out[:count].copy_to_host(out[start : start + count], stream=lane.stream)
            for lane in lanes:
                lane.stream.synchronize()

    def _row(self) -> int:
        """Return the length of a profile in the table: its bins for images, else its slots."""
        return max(self._stride, self._spectrum.size)

    def _spare(self) -> int:
        """Return the length of a spectrum that shared memory does not hold."""
        return 2 * self._spectrum.size if self._spectrum.size > gpu.SHARED_BINS else 0

    def _lanes(
        self, rows: int, source: tuple[int, ...], out: tuple[int, ...], bands: int
    ) -> list[_Lane]:
        """Return memory and streams for batches of ``rows`` rows, shared from call to call."""
        pairs = self._geometry.tx.size
        table = pairs * _groups(rows * bands)[1] * self._row()
        spare = (rows * bands * pairs, self._spare()) if self._spare() else (1, 1)
        shapes = ((rows, *source), (rows, *out), table, spare)
        if CudaBackend._shared_lanes is None or CudaBackend._shared_lanes[0] != shapes:
            CudaBackend._shared_lanes = None  # frees the memory before more is taken
            CudaBackend._shared_lanes = (shapes, [_Lane(*shapes) for _ in range(STREAMS)])
        return CudaBackend._shared_lanes[1]

    def _adjoint_launches(self, lane: _Lane, rows: int) -> _Launches:
        """Return the kernels of a batch with their arguments, in their order."""
        constants = self._on_device
        g = self._geometry
        stream = lane.stream
        bands, count = lane.out.shape[1:]
        pairs = g.tx.size
        size = self._spectrum.size
        # Groups are those of a full batch, so that no batch needs a kernel of its own.
        group, channels = _groups(lane.out.shape[0] * bands)
        table = lane.table[: pairs * channels * self._stride]
        compress = gpu.compress_kernel(size)[(pairs, rows * bands), _block(size), stream]
        tones = (
            lane.source[:rows],
            constants.weight,
            constants.begin,
            constants.tone,
            constants.slot_share,
            constants.phase,
            constants.factor,
            constants.twiddle,
            self._spectrum.first,
            self._bins,
            lane.spare,
            table.reshape(pairs, channels, self._stride),
        )
        blocks = (-(-count // gpu.THREADS), -(-rows * bands // group))
        interpolate = gpu.adjoint_kernel(self.width, group, self._stride)[
            blocks, gpu.THREADS, stream
        ]
        profiles = (
            table.view(np.uint64),
            channels,
            constants.tx,
            constants.rx,
            self._delay,
            self._phasor,
            g.origin,
            g.shift,
            self._unit,
            constants.taps,
            lane.out[:rows].reshape(rows * bands, count),
        )
        return [(compress, tones), (interpolate, profiles)]

    def _forward_launches(self, lane: _Lane, rows: int) -> _Launches:
        """Return the kernels of a batch with their arguments, in their order."""
        constants = self._on_device
        g = self._geometry
        stream = lane.stream
        bands, count = lane.source.shape[1:]
        channels = rows * bands
        pairs = g.tx.size
        size = self._spectrum.size
        table = lane.table[: pairs * channels * size].reshape(pairs, channels, size)
        begin, order = self._sorted_pixels()
        group, _ = _groups(lane.source.shape[0] * bands)
        # A thread for every slot of a profile, a block along y for every pair, along z for every
        # group of channels.
        blocks = (-(-size // gpu.THREADS), pairs, -(-channels // group))
        spread = gpu.forward_kernel(self.width, group)[blocks, (gpu.THREADS, 1, 1), stream]
        image = (
            lane.source[:rows].reshape(channels, count).view(np.uint64),
            constants.tx,
            constants.rx,
            self._delay,
            self._phasor,
            g.origin,
            g.shift,
            self._unit,
            begin,
            order,
            self._spectrum.first,
            self._bins,
            constants.taps,
            table,
        )
        expand = gpu.expand_kernel(size)[(pairs, channels), _block(size), stream]
        out = lane.out[:rows]
        collect = self._launch(gpu.collect, (out.shape[2], out.shape[1], out.shape[0]), stream)
        transformed = (table, constants.factor, constants.twiddle, lane.spare)
        tones = (
            table,
            constants.weight,
            constants.entries,
            constants.slot,
            constants.share,
            constants.phase,
            out,
        )
        return [(spread, image), (expand, transformed), (collect, tones)]

    @staticmethod
    def _launch(kernel: Any, size: tuple[int, ...], stream: Any) -> Any:
        """Configure a kernel with a thread for every element, in blocks along the first axis."""
        threads = min(gpu.THREADS, size[0])
        blocks = (-(-size[0] // threads), *size[1:])
        block_shape = (threads, *([1] * len(size[1:])))
        return kernel[blocks, block_shape, stream]

    def _place_antennas(self) -> None:
        """Compute the delays and phasors of all antennas and pixels on the device."""
        g = self._geometry
        shape = (g.antenna.shape[0], g.pixels.shape[1])
        delay = cuda.device_array(shape, np.uint32)
        phasor = cuda.device_array(shape, np.complex64)
        pixels = _to_device(g.pixels)
        antennas = _to_device(g.antenna)
        medium = _to_device(g.medium)
        no_gain = np.zeros((1, 1), np.float32)[:, :0]
        gain = cuda.to_device(g.gain if g.gain.size else no_gain)
        stream = cuda.default_stream()
        locate = self._launch(gpu.locate, (shape[1], shape[0]), stream)
        locate(pixels, antennas, medium, g.per_turn, g.carrier, gain, delay, phasor)
        stream.synchronize()

        # Flat: the kernels add a pixel's number to where its antenna begins.
        self._delay = delay.reshape(-1)
        self._phasor = phasor.reshape(-1).view(np.uint64)
        self._on_device.tx = cuda.to_device((g.tx * shape[1]).astype(np.uint64))
        self._on_device.rx = cuda.to_device((g.rx * shape[1]).astype(np.uint64))
        padded_taps = g.weight.reshape(-1, padded(self.width))
        self._on_device.taps = _to_device(padded_taps[:, : self.width].T)

    def _sorted_pixels(self) -> tuple[Any, Any]:
        """Return where each bin of every pair begins, and its pixels in the order of their bins.

        They are computed at the first use.
        """
        if self._order is None:
            g = self._geometry
            reach = self._bins - self.width
            all_delays = self._delay.copy_to_host().reshape(g.antenna.shape[0], -1)
            delay = all_delays[:, : g.pixel_count].astype(np.int64)
            order = np.empty((g.tx.size, g.pixel_count), np.int32)
            begin = np.empty((g.tx.size, reach + 1), np.int32)
            for q in range(g.tx.size):
                pair_delay = (delay[g.tx[q]] + delay[g.rx[q]] - g.origin) % 2**32
                bins = pair_delay >> g.shift
                order[q] = np.argsort(bins, kind="stable")
                begin[q] = np.searchsorted(bins[order[q]], np.arange(reach + 1))
            self._order = cuda.to_device(begin), cuda.to_device(order)
        return self._order


def _to_device(array: AnyArray) -> Any:
    """Copy an array to the device, row by row."""
    return cuda.to_device(np.ascontiguousarray(array))


def _groups(channels: int) -> tuple[int, int]:
    """Return the channels of each thread and of all together: ``channels`` or a few more."""
    groups = -(-channels // GROUP)
    group = -(-channels // groups)
    return group, groups * group


def _block(size: int) -> int:
    """Return the threads that transform a profile: one per butterfly of a pass, up to a limit."""
    return min(2 * gpu.THREADS, max(1, size // 4))


class _Constants:
    """Arrays of the tones and the window, on the device."""

    tx: Any
    rx: Any
    taps: Any

    def __init__(
        self, spectrum: Spectrum, weight: FloatArray, phase: Complex128Array | None
    ) -> None:
        # The entries of the tones by slot: a thread of the compression fills one slot.
        tone = np.repeat(np.arange(spectrum.entries.size - 1), np.diff(spectrum.entries))
        order = np.argsort(spectrum.slot, kind="stable")
        begin = np.searchsorted(spectrum.slot[order], np.arange(spectrum.size + 1))

        # The correction by slot of the transform, not by bin of the table.
        factor = np.ones(spectrum.size, np.float32)
        bins = min(spectrum.factor.size, spectrum.size)
        slots = (spectrum.first + np.arange(bins)) % spectrum.size
        factor[slots] = spectrum.factor[:bins]

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
