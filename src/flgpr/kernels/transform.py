"""Range compression and its transpose, between the tones of a pair and the bins of its profile.

A tone takes part in one or more slots of the uniform spectrum (one where the tones are uniform).
The Fourier transform works on lane rows; it is written out here because no result may depend on the
number of threads, and because the profiles come out in the order in which they are read.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import uint64

from flgpr.jit.compiled import njit
from flgpr.kernels.lanes import butterfly
from flgpr.types import AnyArray, IntArray

_FAST = {"fastmath": True, "error_model": "numpy", "cache": True}


class Spectrum(NamedTuple):
    """Positions of tones in a uniform spectrum, and of a table's bins in its transform.

    The slots of tone k are ``slot[entries[k]:entries[k + 1]]``; bin i of a table is bin
    ``first + i`` of the transform, modulo ``size``, times ``factor[i]``.
    """

    size: int  #: slots of the spectrum, a power of two
    first: int  #: bin of the transform that is bin 0 of a table
    entries: IntArray  #: (tone + 1,) begin of every tone's entries in ``slot``
    slot: IntArray  #: (entry,) slots of the tones
    share: AnyArray  #: (entry,) weights of the tones in their slots
    factor: AnyArray  #: (bin,) correction of the bins for the spread of the tones
    twiddle: AnyArray  #: (size,) exp(+j2πk/size)

    def single(self) -> Spectrum:
        """Return the spectrum in single precision, for :func:`compress` and :func:`expand`."""
        share = self.share.astype(np.float32)
        factor = self.factor.astype(np.float32)
        return self._replace(share=share, factor=factor, twiddle=self.twiddle.astype(np.complex64))


class Form(NamedTuple):
    """Layout of profiles in a table and in the transform.

    A single channel would waste most of a lane row: it is transformed for several pairs together,
    and a row of its table holds the bins of all taps. Several channels are transformed for one pair
    at a time.
    """

    row: int  #: float32 numbers in a row of the table
    width: int  #: bins in a row of the table of a single channel
    together: int  #: pairs that are transformed together
    lane: tuple[int, ...]  #: as long as a row of the transform; only the length counts


@njit(**_FAST)
def fourier(a, b, size, twiddle, channels):  # type: ignore[no-untyped-def]
    """Transform lane rows to Σ_k a_k exp(+j2πkm/size); return ``a`` or ``b``, which holds it.

    The transform is Stockham's: every pass writes its results in the order of the next one, from
    one array to the other, so that no bits of an index are reversed.

    Parameters
    ----------
    a : (size·2·channel,) ndarray of float32
        Lane rows of the spectrum, overwritten.
    b : (size·2·channel,) ndarray of float32
        Work space.
    size : int
        Slots, a power of two.
    twiddle : (size,) ndarray of complex64
        Factors exp(+j2πk/size).
    channels : tuple
        As long as a row has channels.
    """
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
        # A size that is no power of four leaves one pass of radix 2.
        half = stride * lanes
        for i in range(half):
            x, y = a[i], a[i + half]
            b[i] = x + y
            b[i + half] = x - y
        a, b = b, a
    return a


@njit(nogil=True, **_FAST)
def compress(data, weight, spectrum, table, row, width, together, lane, begin, end):  # type: ignore[no-untyped-def]
    """Fill pairs of a table of range profiles from the tones of a scan.

    The channel of a polarization and a sub-band is polarization·subbands + subband; the rest are
    zero.

    Parameters
    ----------
    data : (polarization, pair, tone) ndarray of complex64
        Data of a scan.
    weight : (subband, tone) ndarray of float32
        Weights of the tones.
    spectrum : Spectrum
        Positions of tones and bins, in single precision.
    table : (pair·bin·row,) ndarray of float32
        Range profiles.
    row, width, together, lane
        Layout, as in :class:`Form`.
    begin, end : int
        Pairs of this call.
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
                        if w == 0:  # tones of other sub-bands: most of them
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
                # A bin is written into the rows of all bins whose window reaches it.
                for i in range(bins):
                    at = ((first + i) % size) * lanes + q - first_pair
                    for a in range(min(width, i + 1)):
                        to = (q * bins + i - a) * row + a
                        table[to] = profile[at] * factor[i]
                        table[to + row // 2] = profile[at + half] * factor[i]


@njit(nogil=True, **_FAST)
def expand(table, weight, spectrum, data, row, width, together, lane, begin, end):  # type: ignore[no-untyped-def]
    """Add the spectra of a table of profiles to ``data`` (polarization, pair, tone).

    This is the transpose of :func:`compress`, whose arguments it takes.
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
