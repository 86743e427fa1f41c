"""Range compression and its transpose, between the tones of a pair and the bins of its profile.

A tone takes part in one or more slots of the uniform spectrum (one where the tones are uniform).
The Fourier transform works on lane rows; it is written out here because no result may depend on the
number of threads, and because the profiles come out in the order in which they are read.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numba import uint64
from numpy.typing import NDArray

from flgpr.jit.compiled import njit
from flgpr.kernels.lanes import butterfly

_FAST = {"fastmath": True, "error_model": "numpy", "cache": True}


class Spectrum(NamedTuple):
    """How tones lie in the spectrum of ``size`` slots and bins in its transform.

    The slots of tone k are ``slot[entries[k]:entries[k + 1]]`` with the weights ``share``; bin i of
    a table is bin ``first + i`` of the transform, modulo ``size``, times ``factor[i]``; ``twiddle``
    holds exp(+j2πk/size).
    """

    size: int
    first: int
    entries: NDArray[np.int64]
    slot: NDArray[np.int64]
    share: NDArray[Any]
    factor: NDArray[Any]
    twiddle: NDArray[Any]

    def single(self) -> Spectrum:
        """Return the spectrum in single precision, for :func:`compress` and :func:`expand`."""
        share = self.share.astype(np.float32)
        factor = self.factor.astype(np.float32)
        return self._replace(share=share, factor=factor, twiddle=self.twiddle.astype(np.complex64))


class Form(NamedTuple):
    """Layout of profiles in a table, whose rows are ``row`` numbers, and in the transform.

    Of ``lane``, as long as a row of the transform, only the length counts. A single channel is
    transformed for as many pairs ``together`` and has ``width`` bins in a row of the table; of
    several, one pair is transformed at a time.
    """

    row: int
    width: int
    together: int
    lane: tuple[int, ...]


@njit(**_FAST)
def fourier(a, b, size, twiddle, channels):  # type: ignore[no-untyped-def]
    """Transform lane rows to Σ_k a_k exp(+j2πkm/size) with work space ``b``; return the result."""
    lanes = uint64(2 * len(channels))
    length = uint64(size)
    stride = uint64(1)
    while length >= uint64(4):
        quarter = length // uint64(4)
        gap = stride * quarter * lanes
        step = stride * lanes
        for p in range(quarter):
            for q in range(stride):
                at = (q + stride * p) * lanes
                to = (q + uint64(4) * stride * p) * lanes
                butterfly(a, at, gap, b, to, step, twiddle, p * stride, channels)
        a, b = b, a
        length = quarter
        stride = stride * uint64(4)
    if length == uint64(2):
        half = stride * lanes
        for i in range(half):
            x, y = a[i], a[i + half]
            b[i] = x + y
            b[i + half] = x - y
        a, b = b, a
    return a


@njit(nogil=True, **_FAST)
def compress(data, weight, spectrum, table, row, width, together, lane, begin, end):  # type: ignore[no-untyped-def]
    """Fill pairs of ``table`` (pair, bin, row) from ``data`` (polarization, pair, tone).

    The channel of a polarization and a sub-band is polarization·subbands + subband; the rest are
    zero. From ``row`` on, arguments are as in :class:`Form`.
    """
    size = spectrum.size
    first = spectrum.first
    factor = spectrum.factor
    entries = spectrum.entries
    slot = spectrum.slot
    share = spectrum.share
    twiddle = spectrum.twiddle
    half = len(lane)
    lanes = 2 * half
    bands = weight.shape[0]
    bins = factor.shape[0]
    source = np.empty(size * lanes, np.float32)
    work = np.empty(size * lanes, np.float32)
    for first_pair in range(begin, end, together):
        source[:] = 0
        for q in range(first_pair, min(first_pair + together, end)):
            for k in range(data.shape[2]):
                for e in range(entries[k], entries[k + 1]):
                    at = slot[e] * lanes + q - first_pair
                    for s in range(bands):
                        w = weight[s, k] * share[e]
                        if w == 0:
                            continue
                        for c in range(data.shape[0]):
                            source[at + c * bands + s] += w * data[c, q, k].real
                            source[at + half + c * bands + s] += w * data[c, q, k].imag
        profile = fourier(source, work, size, twiddle, lane)
        if together == 1:
            for i in range(bins):
                at = uint64(((first + i) % size) * lanes)
                to = uint64((first_pair * bins + i) * row)
                for j in range(uint64(lanes)):
                    table[to + j] = profile[at + j] * factor[i]
        else:
            for q in range(first_pair, min(first_pair + together, end)):
                table[q * bins * row : (q + 1) * bins * row] = 0
                for i in range(bins):
                    at = ((first + i) % size) * lanes + q - first_pair
                    for a in range(min(width, i + 1)):
                        to = (q * bins + i - a) * row + a
                        table[to] = profile[at] * factor[i]
                        table[to + row // 2] = profile[at + half] * factor[i]


@njit(nogil=True, **_FAST)
def expand(table, weight, spectrum, data, row, width, together, lane, begin, end):  # type: ignore[no-untyped-def]
    """Add the spectra of ``table`` to ``data`` (polarization, pair, tone).

    This is the transpose of :func:`compress`.
    """
    size = spectrum.size
    first = spectrum.first
    factor = spectrum.factor
    entries = spectrum.entries
    slot = spectrum.slot
    share = spectrum.share
    twiddle = spectrum.twiddle
    half = len(lane)
    lanes = 2 * half
    bands = weight.shape[0]
    bins = factor.shape[0]
    source = np.empty(size * lanes, np.float32)
    work = np.empty(size * lanes, np.float32)
    for first_pair in range(begin, end, together):
        source[:] = 0
        # Real and imaginary parts change places here and below: that conjugates the transform.
        if together == 1:
            for i in range(bins):
                to = uint64(((first + i) % size) * lanes)
                at = uint64((first_pair * bins + i) * row)
                for j in range(uint64(half)):
                    source[to + uint64(half) + j] += table[at + j] * factor[i]
                    source[to + j] += table[at + uint64(half) + j] * factor[i]
        else:
            for q in range(first_pair, min(first_pair + together, end)):
                for i in range(bins):
                    to = ((first + i) % size) * lanes + q - first_pair
                    for a in range(min(width, i + 1)):
                        at = (q * bins + i - a) * row + a
                        source[to + half] += table[at] * factor[i]
                        source[to] += table[at + row // 2] * factor[i]
        profile = fourier(source, work, size, twiddle, lane)
        for q in range(first_pair, min(first_pair + together, end)):
            for c in range(data.shape[0]):
                for k in range(data.shape[2]):
                    re = np.float32(0)
                    im = np.float32(0)
                    for e in range(entries[k], entries[k + 1]):
                        at = slot[e] * lanes + c * bands + q - first_pair
                        for s in range(bands):
                            w = weight[s, k] * share[e]
                            im += w * profile[at + s]
                            re += w * profile[at + half + s]
                    data[c, q, k] += complex(re, im)
