"""Range compression and its transpose: between the tones of a pair and the bins of its profile, all channels at once.

A tone takes part in one or more slots of the uniform spectrum (one where the tones are uniform). The Fourier transform
works on lane rows; it is written out here because no result may depend on the number of threads, and because
the profiles come out in the order in which they are read.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numba import uint64
from numpy.typing import NDArray

from flgpr.kernels.compiled import njit
from flgpr.kernels.lanes import butterfly

_FAST = {"fastmath": True, "error_model": "numpy", "cache": True}


class Spectrum(NamedTuple):
    """How tones lie in the spectrum of ``size`` slots and bins in its transform.

    The slots of tone k are ``slot[entries[k]:entries[k + 1]]`` with the weights ``share``; bin i of a table is bin
    ``first + i`` of the transform, modulo ``size``, times ``factor[i]``; ``twiddle`` holds exp(+j2πk/size).
    """

    size: int
    first: int
    entries: NDArray[np.int64]
    slot: NDArray[np.int64]
    share: NDArray[Any]
    factor: NDArray[Any]
    twiddle: NDArray[Any]

    def single(self) -> Spectrum:
        """Return the spectrum in single precision, which :func:`compress` and :func:`expand` work in."""
        share, factor = self.share.astype(np.float32), self.factor.astype(np.float32)
        return self._replace(share=share, factor=factor, twiddle=self.twiddle.astype(np.complex64))


@njit(**_FAST)
def fourier(a, b, size, twiddle, channels):  # type: ignore[no-untyped-def]
    """Transform lane rows ``a``, with ``b`` as work space, to Σ_k a_k exp(+j2πkm/size); returns the one that has it."""
    lanes = uint64(2 * len(channels))
    length, stride = uint64(size), uint64(1)
    while length >= uint64(4):
        quarter = length // uint64(4)
        gap, step = stride * quarter * lanes, stride * lanes
        for p in range(quarter):
            for q in range(stride):
                at, to = (q + stride * p) * lanes, (q + uint64(4) * stride * p) * lanes
                butterfly(a, at, gap, b, to, step, twiddle, p * stride, channels)
        a, b = b, a
        length, stride = quarter, stride * uint64(4)
    if length == uint64(2):
        half = stride * lanes
        for i in range(half):
            x, y = a[i], a[i + half]
            b[i], b[i + half] = x + y, x - y
        a, b = b, a
    return a


@njit(nogil=True, **_FAST)
def compress(data, weight, spectrum, table, channels, begin, end):  # type: ignore[no-untyped-def]
    """Fill ``table`` (pair, bin, lane) from ``data`` (polarization, pair, tone) for the pairs ``begin`` up to ``end``.

    The channel of a polarization and a sub-band is polarization·subbands + subband; the rest are zero.
    """
    half, size, first = len(channels), spectrum.size, spectrum.first
    entries, slot, share = spectrum.entries, spectrum.slot, spectrum.share
    factor, twiddle = spectrum.factor, spectrum.twiddle
    lanes, bands, bins = 2 * half, weight.shape[0], factor.shape[0]
    for q in range(begin, end):
        a, b = np.zeros(size * lanes, np.float32), np.empty(size * lanes, np.float32)
        for k in range(data.shape[2]):
            for e in range(entries[k], entries[k + 1]):
                at = slot[e] * lanes
                for s in range(bands):
                    w = weight[s, k] * share[e]
                    for c in range(data.shape[0]):
                        a[at + c * bands + s] += w * data[c, q, k].real
                        a[at + half + c * bands + s] += w * data[c, q, k].imag
        a = fourier(a, b, size, twiddle, channels)
        for i in range(bins):
            at, to = uint64(((first + i) % size) * lanes), uint64((q * bins + i) * lanes)
            for j in range(uint64(lanes)):
                table[to + j] = a[at + j] * factor[i]


@njit(nogil=True, **_FAST)
def expand(table, weight, spectrum, data, channels, begin, end):  # type: ignore[no-untyped-def]
    """Add the spectra of ``table`` to ``data`` (polarization, pair, tone): the transpose of :func:`compress`."""
    half, size, first = len(channels), spectrum.size, spectrum.first
    entries, slot, share = spectrum.entries, spectrum.slot, spectrum.share
    factor, twiddle = spectrum.factor, spectrum.twiddle
    lanes, bands, bins = 2 * half, weight.shape[0], factor.shape[0]
    for q in range(begin, end):
        a, b = np.zeros(size * lanes, np.float32), np.empty(size * lanes, np.float32)
        for i in range(bins):
            to, at = uint64(((first + i) % size) * lanes), uint64((q * bins + i) * lanes)
            # Real and imaginary parts change places here and below: that conjugates the transform.
            for j in range(uint64(half)):
                a[to + uint64(half) + j] += table[at + j] * factor[i]
                a[to + j] += table[at + uint64(half) + j] * factor[i]
        a = fourier(a, b, size, twiddle, channels)
        for c in range(data.shape[0]):
            for k in range(data.shape[2]):
                re, im = np.float32(0), np.float32(0)
                for e in range(entries[k], entries[k + 1]):
                    at = slot[e] * lanes + c * bands
                    for s in range(bands):
                        w = weight[s, k] * share[e]
                        im += w * a[at + s]
                        re += w * a[at + half + s]
                data[c, q, k] += complex(re, im)
