"""The imaging sums for CUDA: profiles of every channel and pair, one thread per pixel or per profile bin.

The algorithm, the window and the 32-bit delays are those of ``profiles``. Delays and phasors of all antennas and pixels
are computed once and kept on the device; the channels are worked on in groups small enough for registers. No sum is
split between threads, so that results do not depend on scheduling.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Any

from numba import complex64, cuda, float32, int64, uint32, uint64

from flgpr.kernels.geometry import bent_path, entry_distance

THREADS = 128
"""Threads of a block."""

_LOW32 = 0xFFFFFFFF
_entry_distance = cuda.jit(device=True)(entry_distance.py_func)
_bent_path = cuda.jit(device=True)(bent_path.py_func)


@cuda.jit
def locate(pixels, antenna, medium, per_turn, carrier, gain, delay, phasor):  # type: ignore[no-untyped-def]
    """Fill ``delay`` and ``phasor`` (antenna, pixel); arguments as in :class:`flgpr.kernels.profiles.Geometry`."""
    p, a = cuda.grid(2)
    if p >= delay.shape[1] or a >= delay.shape[0]:
        return
    index, ground = medium[0], medium[1]
    x, y, z = pixels[0, p] - antenna[a, 0], pixels[1, p] - antenna[a, 1], pixels[2, p]
    if ground > 0.0:
        square = (ground / index) ** 2
        across, height, depth = math.sqrt(x * x + y * y), antenna[a, 2] - max(z, 0.0), max(-z, 0.0)
        entry = _entry_distance(across, height, depth, square, square - 1.0, 4)
        path = _bent_path(across, height, depth, entry, index, ground)
    else:
        z -= antenna[a, 2]
        path = index * math.sqrt(x * x + y * y + z * z)
    turns = path * per_turn
    delay[a, p] = uint32(int64((turns - math.floor(turns)) * 4294967296.0))
    phase = path * carrier
    angle = 2 * math.pi * (phase - math.floor(phase))
    size = gain[a, p] if gain.shape[1] > 0 else 1.0
    phasor[a, p] = complex64(complex(size * math.cos(angle), size * math.sin(angle)))


@cuda.jit
def fill(data, weight, begin, tone, share, phase, profile):  # type: ignore[no-untyped-def]
    """Put ``data`` (polarization, pair, tone) into the slots of the spectra ``profile`` (channel, pair, slot).

    Slot m is made of the tones ``tone[begin[m]:begin[m + 1]]`` with the weights ``share``; ``weight`` (subband, tone);
    ``phase`` (1 or pair, tone), or (0, 0) for none.
    """
    m, q, channel = cuda.grid(3)
    if m >= profile.shape[2] or q >= profile.shape[1] or channel >= profile.shape[0]:
        return
    c, s = channel // weight.shape[0], channel % weight.shape[0]
    total = complex64(0)
    for e in range(begin[m], begin[m + 1]):
        k = tone[e]
        value = data[c, q, k] * (weight[s, k] * share[e])
        if phase.shape[0] > 0:
            value *= phase[min(q, phase.shape[0] - 1), k]
        total += value
    profile[channel, q, m] = total


@cuda.jit
def collect(profile, weight, entries, slot, share, phase, data):  # type: ignore[no-untyped-def]
    """Transpose of :func:`fill`: sum slots and sub-bands into ``data``; tone k has ``slot[entries[k]:...]``."""
    k, q, c = cuda.grid(3)
    if k >= data.shape[2] or q >= data.shape[1] or c >= data.shape[0]:
        return
    bands = weight.shape[0]
    total = complex64(0)
    for e in range(entries[k], entries[k + 1]):
        for s in range(bands):
            total += profile[c * bands + s, q, slot[e]] * (weight[s, k] * share[e])
    if phase.shape[0] > 0:
        total *= phase[min(q, phase.shape[0] - 1), k].conjugate()
    data[c, q, k] = total


@cuda.jit
def scale(profile, factor):  # type: ignore[no-untyped-def]
    """Multiply the bins of ``profile`` by ``factor`` (bin,)."""
    m, q, c = cuda.grid(3)
    if m < profile.shape[2] and q < profile.shape[1] and c < profile.shape[0]:
        profile[c, q, m] = profile[c, q, m] * factor[m]


@cuda.jit
def pass_four(source, target, stride, twiddle, sign):  # type: ignore[no-untyped-def]
    """Make one radix-4 pass of Σ_k x_k exp(sign·j2πkm/n) along the last axis; ``twiddle`` holds exp(+j2πk/n)."""
    j, q, c = cuda.grid(3)
    size = source.shape[2]
    if j >= size // 4 or q >= source.shape[1] or c >= source.shape[0]:
        return
    low, p = j % stride, j // stride
    gap = size // 4
    x0, x1 = source[c, q, j], source[c, q, j + gap]
    x2, x3 = source[c, q, j + 2 * gap], source[c, q, j + 3 * gap]
    plus, minus, even, odd = x0 + x2, x0 - x2, x1 + x3, x1 - x3
    turned = complex64(complex(-sign * odd.imag, sign * odd.real))
    to = low + 4 * stride * p
    target[c, q, to] = plus + even
    for i in range(1, 4):
        w = twiddle[i * p * stride]
        w = complex64(complex(w.real, sign * w.imag))
        value = plus - even if i == 2 else (minus + turned if i == 1 else minus - turned)
        target[c, q, to + i * stride] = value * w


@cuda.jit
def pass_two(source, target):  # type: ignore[no-untyped-def]
    """Finish a transform whose length is an odd power of two."""
    j, q, c = cuda.grid(3)
    half = source.shape[2] // 2
    if j < half and q < source.shape[1] and c < source.shape[0]:
        a, b = source[c, q, j], source[c, q, j + half]
        target[c, q, j] = a + b
        target[c, q, j + half] = a - b


@lru_cache(maxsize=64)
def adjoint_kernel(width: int, group: int) -> Any:
    """Compile the interpolation for a window width and a number of channels per thread."""
    powers = width + 4

    @cuda.jit(fastmath=True)
    def adjoint(profile, size, tx, rx, delay, phasor, origin, shift, first, weight, out):  # type: ignore[no-untyped-def]
        """Fill ``out`` (channel, pixel) from ``profile``, flat (channel, pair, bin) with ``size`` bins per pair."""
        p = cuda.grid(1)
        channel = cuda.blockIdx.y * group
        if p >= out.shape[1]:
            return
        held = min(group, out.shape[0] - channel)
        taps = cuda.local.array(width, float32)
        form = cuda.local.array((width, powers), float32)
        spot = cuda.local.array(width, uint64)
        total = cuda.local.array(group, complex64)
        for c in range(group):
            total[c] = complex64(0)
        for a in range(width):
            for n in range(powers):
                form[a, n] = weight[a, n]
        last = size - 1
        # Unsigned flat indices: they spare the device the tests for negative ones.
        stride = uint64(tx.shape[0] * size)
        below = (1 << shift) - 1
        unit = float32(1.0 / (1 << shift))
        for q in range(tx.shape[0]):
            i, j = tx[q], rx[q]
            d = (int64(delay[i, p]) + int64(delay[j, p]) - origin) & _LOW32
            y = float32(d & below) * unit - float32(0.5)
            for a in range(width):
                tap = form[a, powers - 1]
                for n in range(powers - 2, -1, -1):
                    tap = tap * y + form[a, n]
                taps[a] = tap
                spot[a] = uint64(((d >> shift) + first + a) & last)
            row = uint64((channel * tx.shape[0] + q) * size)
            turn = phasor[i, p] * phasor[j, p]
            for c in range(group):
                if c < held:
                    value = profile[row + spot[0]] * taps[0]
                    for a in range(1, width):
                        value += profile[row + spot[a]] * taps[a]
                    total[c] += value * turn
                row += stride
        for c in range(group):
            if c < held:
                out[channel + c, p] = total[c]

    return adjoint


@lru_cache(maxsize=64)
def forward_kernel(group: int) -> Any:
    """Compile the transpose of the interpolation for a number of channels per thread."""

    @cuda.jit(fastmath=True)
    def forward(image, tx, rx, delay, phasor, origin, shift, begin, order, first, bins, weight, profile):  # type: ignore[no-untyped-def]  # fmt: skip
        """Fill ``profile`` (channel, pair, bin) from ``image`` (channel, pixel).

        ``order[q, begin[q, b]:begin[q, b + 1]]`` are the pixels of pair q whose paths end in bin b.
        """
        m, q = cuda.grid(2)
        channel = cuda.blockIdx.z * group
        size = profile.shape[2]
        if m >= size or q >= profile.shape[1]:
            return
        held = min(group, profile.shape[0] - channel)
        total = cuda.local.array(group, complex64)
        for c in range(group):
            total[c] = complex64(0)
        below = (1 << shift) - 1
        unit = float32(1.0 / (1 << shift))
        i, j = tx[q], rx[q]
        # A table longer than the transform wraps: the thread of a bin takes every turn of it.
        for bin_ in range((m - first) % size, bins, size):
            for a in range(weight.shape[0]):
                b = bin_ - a
                if b < 0 or b + 1 >= begin.shape[1]:
                    continue
                for e in range(begin[q, b], begin[q, b + 1]):
                    p = order[q, e]
                    d = (int64(delay[i, p]) + int64(delay[j, p]) - origin) & _LOW32
                    y = float32(d & below) * unit - float32(0.5)
                    tap = weight[a, weight.shape[1] - 1]
                    for n in range(weight.shape[1] - 2, -1, -1):
                        tap = tap * y + weight[a, n]
                    turn = (phasor[i, p] * phasor[j, p]).conjugate() * tap
                    for c in range(group):
                        if c < held:
                            total[c] += image[channel + c, p] * turn
        for c in range(group):
            if c < held:
                profile[channel + c, q, m] = total[c]

    return forward
