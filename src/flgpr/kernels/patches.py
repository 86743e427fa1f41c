"""Sampling of image patches about points and statistics of their regions, all channels at once."""

from __future__ import annotations

import numpy as np

from flgpr.jit.threads import shared

INNER = 1
OUTER = 2
PEAK, MEAN, OUTER_MEAN, OUTER_STD = range(4)


@shared(cache=True)
def region_statistics(images, row, column, offset, regions, out, begin, end):  # type: ignore[no-untyped-def]
    """Fill the statistics of patches about fractional pixels of images.

    Pixels of an outer region beyond the image's border do not count. The statistics are NaN where
    a part of the inner region lies beyond the border or the outer one has less than two pixels.

    Parameters
    ----------
    images : (channel, y, x) ndarray of float32
        Images of one size.
    row, column : (patch,) ndarray
        Centres of the patches, in fractional pixels.
    offset : (pixel,) ndarray
        Positions of a patch's pixels along either axis, in image pixels from its centre.
    regions : (set, pixel, pixel) ndarray of int8
        Region of every pixel of a patch: ``INNER``, ``OUTER`` or zero for neither.
    out : (patch, channel, set, statistic) ndarray
        Largest (``PEAK``) and mean value (``MEAN``) of the inner region, mean (``OUTER_MEAN``) and
        standard deviation (``OUTER_STD``) of the outer one.
    begin, end : int
        Patches of this call.
    """
    channels, ny, nx = images.shape
    size = offset.size
    sets = regions.shape[0]
    unit = np.float32(1)
    corner = np.empty((size * size, 2), np.int64)
    value = np.empty(size * size)
    right = np.empty(size * size, np.float32)
    below = np.empty(size * size, np.float32)
    members = np.empty((sets, 2, size * size), np.int64)
    count = np.empty((sets, 2), np.int64)
    complete = np.empty(sets, np.bool_)
    for p in range(begin, end):
        # First the corners and weights of the interpolation: they are the same for all channels.
        complete[:] = True
        count[:] = 0
        used = 0
        for i in range(size):
            r = row[p] + offset[i]
            for j in range(size):
                c = column[p] + offset[j]
                inside = -1e-9 <= r <= ny - 1 + 1e-9 and -1e-9 <= c <= nx - 1 + 1e-9
                is_used = False
                for s in range(sets):
                    kind = regions[s, i, j]
                    if kind != INNER and kind != OUTER:
                        continue
                    if inside:
                        members[s, kind - 1, count[s, kind - 1]] = used
                        count[s, kind - 1] += 1
                        is_used = True
                    elif kind == INNER:
                        complete[s] = False
                if is_used:
                    y = min(max(int(r), 0), ny - 2)
                    x = min(max(int(c), 0), nx - 2)
                    corner[used, 0] = y
                    corner[used, 1] = x
                    below[used] = np.float32(min(max(r - y, 0.0), 1.0))
                    right[used] = np.float32(min(max(c - x, 0.0), 1.0))
                    used += 1
        for k in range(channels):
            for m in range(used):
                y = corner[m, 0]
                x = corner[m, 1]
                fr = below[m]
                fc = right[m]
                top = images[k, y, x] * (unit - fc) + images[k, y, x + 1] * fc
                bottom = images[k, y + 1, x] * (unit - fc) + images[k, y + 1, x + 1] * fc
                value[m] = np.float64(top * (unit - fr) + bottom * fr)
            for s in range(sets):
                if not complete[s] or count[s, 1] < 2:
                    out[p, k, s] = np.nan
                    continue
                peak = -np.inf
                inner = 0.0
                first = value[members[s, 1, 0]]
                for m in members[s, 0, : count[s, 0]]:
                    inner += value[m]
                    peak = max(peak, value[m])
                # Squares about the first value: about zero, the difference of two large sums would
                # be left of a flat region.
                gaps = 0.0
                squares = 0.0
                for m in members[s, 1, : count[s, 1]]:
                    gap = value[m] - first
                    gaps += gap
                    squares += gap * gap
                mean = gaps / count[s, 1]
                out[p, k, s, PEAK] = peak
                out[p, k, s, MEAN] = inner / count[s, 0]
                out[p, k, s, OUTER_MEAN] = first + mean
                out[p, k, s, OUTER_STD] = np.sqrt(max(squares / count[s, 1] - mean * mean, 0.0))
