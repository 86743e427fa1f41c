"""The imaging sums for CUDA: a block per profile, then a thread per pixel or per profile bin.

The algorithm, the window and the 32-bit delays are those of ``profiles``. Delays and phasors of all
antennas and pixels are computed once and kept on the device; a profile is filled and transformed by
one block, in its shared memory where it fits; the channels are interpolated in groups small enough
for registers. No sum is split between threads, so that results do not depend on scheduling.

Complex numbers that are read many times are read as 64-bit words: the compiler makes two loads of a
complex64. Strides, widths and numbers of channels are compiled in, so that a channel's address
costs no instruction.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Any

import numpy as np
from numba import complex64, config, cuda, float32, int32, int64, uint32, uint64

from flgpr.kernels.geometry import bent_path, cos_sin, entry_distance

THREADS = 128
"""Threads of a block."""
SHARED_BINS = 2048
"""Bins of the longest profile transformed in shared memory: twice 16 kB of a device's 48 kB."""

_LOW32 = 0xFFFFFFFF
_cos_sin = cuda.jit(device=True)(cos_sin.py_func)
_entry_distance = cuda.jit(device=True)(entry_distance.py_func)
_bent_path = cuda.jit(device=True)(bent_path.py_func)

if config.ENABLE_CUDASIM:

    def _parts(word: Any) -> Any:
        """Split a 64-bit word into the real and the imaginary part that it holds."""
        return np.array([word], np.uint64).view(np.float32)

else:
    from numba.cuda.libdevice import int_as_float

    @cuda.jit(device=True)
    def _parts(word):  # type: ignore[no-untyped-def]
        """Split a 64-bit word into the real and the imaginary part that it holds."""
        return int_as_float(int32(uint32(word))), int_as_float(int32(uint32(word >> uint64(32))))


@cuda.jit
def locate(pixels, antenna, medium, per_turn, carrier, gain, delay, phasor):  # type: ignore[no-untyped-def]
    """Fill ``delay`` and ``phasor`` (antenna, pixel), one thread for each.

    The other arguments are those of :class:`flgpr.kernels.profiles.Geometry`.
    """
    p, a = cuda.grid(2)
    if p >= delay.shape[1] or a >= delay.shape[0]:
        return
    index = medium[0]
    ground = medium[1]
    x, y, z = pixels[0, p] - antenna[a, 0], pixels[1, p] - antenna[a, 1], pixels[2, p]
    if ground > 0.0:
        square = (ground / index) ** 2
        across = math.sqrt(x * x + y * y)
        height = antenna[a, 2] - max(z, 0.0)
        depth = max(-z, 0.0)
        entry = _entry_distance(across, height, depth, square, square - 1.0, 4)
        path = _bent_path(across, height, depth, entry, index, ground)
    else:
        z -= antenna[a, 2]
        path = index * math.sqrt(x * x + y * y + z * z)
    turns = path * per_turn
    delay[a, p] = uint32(uint64((turns - math.floor(turns)) * 4294967296.0))
    phase = path * carrier
    cosine, sine = _cos_sin(float32(phase - math.floor(phase + 0.5)))
    size = gain[a, p] if gain.shape[1] > 0 else float32(1)
    phasor[a, p] = complex64(complex(size * cosine, size * sine))


@cuda.jit(device=True)
def _turned(value, sign):  # type: ignore[no-untyped-def]
    """Return a value, or its conjugate where the sign is negative."""
    return complex64(complex(value.real, sign * value.imag))


@cuda.jit(device=True)
def _transform(a, b, twiddle, sign):  # type: ignore[no-untyped-def]
    """Compute Σ_k a_k exp(sign·j2πkm/n) by the threads of a block; return whether it is in ``b``.

    It is Stockham's transform of radix 4, from one array to the other and back. ``twiddle`` holds
    exp(+j2πk/n).
    """
    begin = uint64(cuda.threadIdx.x)
    step = uint64(cuda.blockDim.x)
    size = uint64(a.shape[0])
    gap = size >> uint64(2)
    half = size >> uint64(1)
    stride = uint64(1)
    swapped = False
    while stride <= gap:
        for j in range(begin, gap, step):
            low = uint64(j) & (stride - uint64(1))
            turn = uint64(j) - low
            to = low + uint64(4) * turn
            x0 = a[j]
            x1 = a[j + gap]
            x2 = a[j + half]
            x3 = a[j + half + gap]
            plus = x0 + x2
            minus = x0 - x2
            even = x1 + x3
            odd = x1 - x3
            turned = complex64(complex(-sign * odd.imag, sign * odd.real))
            b[to] = plus + even
            b[to + stride] = (minus + turned) * _turned(twiddle[turn], sign)
            b[to + uint64(2) * stride] = (plus - even) * _turned(twiddle[uint64(2) * turn], sign)
            b[to + uint64(3) * stride] = (minus - turned) * _turned(twiddle[uint64(3) * turn], sign)
        cuda.syncthreads()
        a, b, swapped = b, a, not swapped
        stride *= uint64(4)
    if stride < size:
        for j in range(begin, half, step):
            x0 = a[j]
            x1 = a[j + half]
            b[j] = x0 + x1
            b[j + half] = x0 - x1
        cuda.syncthreads()
        swapped = not swapped
    return swapped


@lru_cache(maxsize=64)
def compress_kernel(size: int) -> Any:
    """Compile the range compression for a number of bins, a power of two."""
    shared = size <= SHARED_BINS
    room = 2 * size if shared else 2

    @cuda.jit
    def compress(  # type: ignore[no-untyped-def]
        data,
        weight,
        begin,
        tone,
        share,
        phase,
        factor,
        twiddle,
        first,
        bins,
        spare,
        profile,
    ):
        """Fill the first bins of ``profile`` from the tones of a scan.

        Parameters
        ----------
        data : (polarization, pair, tone) array of complex64
            Data of a scan.
        weight : (subband, tone) array of float32
            Weights of the tones.
        begin, tone, share
            Slot m of a spectrum is made of the tones ``tone[begin[m]:begin[m + 1]]`` with the
            weights ``share``.
        phase : (1 or pair, tone) array of complex64
            Factor on every tone, or (0, 0) for none.
        factor : (slot,) array of float32
            Correction of the bins.
        twiddle : (slot,) array of complex64
            Factors exp(+j2πk/n).
        first, bins : int
            Slot of bin 0, and number of bins.
        spare : (block, 2·slot) array of complex64
            Spectra that shared memory does not hold.
        profile : (pair, channel, bin) array of complex64
            Range profiles.
        """
        q = uint64(cuda.blockIdx.x)
        channel = uint64(cuda.blockIdx.y)
        c = channel // uint64(weight.shape[0])
        s = channel % uint64(weight.shape[0])
        buffers = cuda.shared.array(room, complex64)
        work = buffers if shared else spare[channel * uint64(cuda.gridDim.x) + q]
        a = work[:size]
        b = work[size:]
        for m in range(uint64(cuda.threadIdx.x), uint64(size), uint64(cuda.blockDim.x)):
            total = complex64(0)
            for e in range(begin[m], begin[m + uint64(1)]):
                k = tone[e]
                value = data[c, q, k] * (weight[s, k] * share[e])
                if phase.shape[0] > 0:
                    value *= phase[min(q, uint64(phase.shape[0] - 1)), k]
                total += value
            a[m] = total
        cuda.syncthreads()
        if _transform(a, b, twiddle, float32(1)):
            a = b
        for m in range(uint64(cuda.threadIdx.x), uint64(bins), uint64(cuda.blockDim.x)):
            slot = (uint64(first) + uint64(m)) & uint64(size - 1)
            profile[q, channel, m] = a[slot] * factor[slot]

    return compress


@lru_cache(maxsize=64)
def expand_kernel(size: int) -> Any:
    """Compile the transpose of a profile's transform for a number of bins, a power of two."""
    shared = size <= SHARED_BINS
    room = 2 * size if shared else 2

    @cuda.jit
    def expand(profile, factor, twiddle, spare):  # type: ignore[no-untyped-def]
        """Transform ``profile`` (pair, channel, slot) to spectra; arguments as in compression."""
        q = uint64(cuda.blockIdx.x)
        channel = uint64(cuda.blockIdx.y)
        buffers = cuda.shared.array(room, complex64)
        work = buffers if shared else spare[channel * uint64(cuda.gridDim.x) + q]
        a = work[:size]
        b = work[size:]
        for m in range(uint64(cuda.threadIdx.x), uint64(size), uint64(cuda.blockDim.x)):
            a[m] = profile[q, channel, m] * factor[m]
        cuda.syncthreads()
        if _transform(a, b, twiddle, float32(-1)):
            a = b
        for m in range(uint64(cuda.threadIdx.x), uint64(size), uint64(cuda.blockDim.x)):
            profile[q, channel, m] = a[m]

    return expand


@cuda.jit
def collect(profile, weight, entries, slot, share, phase, data):  # type: ignore[no-untyped-def]
    """Sum the slots of all sub-bands into ``data``: the transpose of filling them.

    Tone k has ``slot[entries[k]:...]``.
    """
    k, q, c = cuda.grid(3)
    if k >= data.shape[2] or q >= data.shape[1] or c >= data.shape[0]:
        return
    bands = weight.shape[0]
    total = complex64(0)
    for e in range(entries[k], entries[k + 1]):
        for s in range(bands):
            total += profile[q, c * bands + s, slot[e]] * (weight[s, k] * share[e])
    if phase.shape[0] > 0:
        total *= phase[min(q, phase.shape[0] - 1), k].conjugate()
    data[c, q, k] = total


@lru_cache(maxsize=64)
def adjoint_kernel(width: int, group: int, stride: int) -> Any:
    """Compile the interpolation for a window width, channels per thread and bins of a profile."""
    powers = width + 4
    half = (width + 1) // 2
    even = (width + 3) // 2 + 1
    odd = (width + 4) // 2

    @cuda.jit(fastmath=True)
    def adjoint(profile, channels, tx, rx, delay, phasor, origin, shift, unit, weight, out):  # type: ignore[no-untyped-def]
        """Fill ``out`` (channel, pixel) from range profiles.

        Parameters
        ----------
        profile : (pair·channel·bin,) array of uint64
            Words of the profiles.
        channels : int
            Channels of a profile, a multiple of the group, of which ``out`` holds the first.
        tx, rx : (pair,) array of uint64
            Where the pixels of the pair's antennas begin in ``delay`` and ``phasor``.
        delay : (antenna·pixel,) array of uint32
            32-bit delays.
        phasor : (antenna·pixel,) array of uint64
            Words of the phasors.
        origin, shift : int
            Delay at which bin 0 starts, and number of a delay's bits below a bin.
        unit : float
            2^-shift.
        weight : (tap, power) array of float32
            Polynomials of the taps.
        out : (channel, pixel) array of complex64
            Image.
        """
        pixel = uint64(cuda.grid(1))
        channel = cuda.blockIdx.y * group
        if pixel >= uint64(out.shape[1]):
            return
        taps = cuda.local.array(width, float32)
        form = cuda.local.array((half, powers), float32)
        real = cuda.local.array(group, float32)
        imag = cuda.local.array(group, float32)
        for c in range(group):
            real[c] = imag[c] = float32(0)
        for a in range(half):
            for n in range(powers):
                form[a, n] = weight[a, n]
        low = uint32(shift)
        below = uint32((1 << shift) - 1)
        # Unsigned everywhere: it spares the device the tests for negative indices.
        row = uint64(channel) * uint64(stride)
        step = uint64(channels) * uint64(stride)
        for q in range(uint64(tx.shape[0])):
            i = tx[q] + pixel
            j = rx[q] + pixel
            d = uint32((int64(delay[i]) + int64(delay[j]) - origin) & _LOW32)
            y = float32(uint32(d & below)) * unit - float32(0.5)
            yy = y * y
            # Tap width - 1 - a is tap a at -y: the even powers and the odd ones are shared.
            for a in range(half):
                e = form[a, 2 * even - 2]
                o = form[a, 2 * odd - 1]
                for n in range(1, even):
                    e = e * yy + form[a, 2 * (even - 1 - n)]
                for n in range(1, odd):
                    o = o * yy + form[a, 2 * (odd - n) - 1]
                o *= y
                taps[a] = e + o
                taps[width - 1 - a] = e - o
            (ci, si), (cj, sj) = _parts(phasor[i]), _parts(phasor[j])
            cosine = ci * cj - si * sj
            sine = ci * sj + si * cj
            at = row + uint64(d >> low)
            row += step
            for c in range(group):
                x, z = _parts(profile[at + uint64(c * stride)])
                x = x * taps[0]
                z = z * taps[0]
                for a in range(1, width):
                    u, v = _parts(profile[at + uint64(c * stride + a)])
                    x = x + u * taps[a]
                    z = z + v * taps[a]
                # One product and one sum each, so that they become multiply-adds.
                real[c] += x * cosine
                real[c] -= z * sine
                imag[c] += x * sine
                imag[c] += z * cosine
        for c in range(group):
            if channel + c < out.shape[0]:
                out[channel + c, pixel] = complex64(complex(real[c], imag[c]))

    return adjoint


@lru_cache(maxsize=64)
def forward_kernel(width: int, group: int) -> Any:
    """Compile the transpose of the interpolation for a window width and channels per thread."""
    powers = width + 4

    @cuda.jit(fastmath=True)
    def forward(  # type: ignore[no-untyped-def]
        image,
        tx,
        rx,
        delay,
        phasor,
        origin,
        shift,
        unit,
        begin,
        order,
        first,
        bins,
        weight,
        profile,
    ):
        """Fill ``profile`` (pair, channel, slot) from the words of ``image`` (channel, pixel).

        ``order[q, begin[q, b]:begin[q, b + 1]]`` are the pixels of pair q whose paths end in bin b;
        the rest as in the adjoint.
        """
        m, q = cuda.grid(2)
        channel = cuda.blockIdx.z * group
        size = profile.shape[2]
        if m >= size or q >= profile.shape[0]:
            return
        form = cuda.local.array(powers, float32)
        real = cuda.local.array(group, float32)
        imag = cuda.local.array(group, float32)
        for c in range(group):
            real[c] = imag[c] = float32(0)
        below = uint32((1 << shift) - 1)
        # A table longer than the transform wraps: the thread of a bin takes every turn of it.
        for bin_ in range((m - first) & (size - 1), bins, size):
            for a in range(width):
                b = bin_ - a
                if b < 0 or b + 1 >= begin.shape[1]:
                    continue
                for n in range(powers):
                    form[n] = weight[a, n]
                for e in range(begin[q, b], begin[q, b + 1]):
                    pixel = uint64(order[q, e])
                    i = tx[q] + pixel
                    j = rx[q] + pixel
                    d = uint32((int64(delay[i]) + int64(delay[j]) - origin) & _LOW32)
                    y = float32(uint32(d & below)) * unit - float32(0.5)
                    tap = form[powers - 1]
                    for n in range(powers - 2, -1, -1):
                        tap = tap * y + form[n]
                    (ci, si), (cj, sj) = _parts(phasor[i]), _parts(phasor[j])
                    cosine = tap * (ci * cj - si * sj)
                    sine = tap * (ci * sj + si * cj)
                    for c in range(group):
                        if channel + c < profile.shape[1]:
                            x, z = _parts(image[channel + c, pixel])
                            real[c] += x * cosine
                            real[c] += z * sine
                            imag[c] += z * cosine
                            imag[c] -= x * sine
        for c in range(group):
            if channel + c < profile.shape[1]:
                profile[q, channel + c, m] = complex64(complex(real[c], imag[c]))

    return forward
