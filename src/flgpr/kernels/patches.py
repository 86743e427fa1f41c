"""Sampling of image patches about points and statistics of their regions, all channels at once."""

from __future__ import annotations

import numpy as np

from flgpr.kernels.threads import shared

INNER, OUTER = 1, 2
PEAK, MEAN, OUTER_MEAN, OUTER_STD = range(4)


@shared(cache=True)
def region_statistics(images, row, column, offset, regions, out, begin, end):  # type: ignore[no-untyped-def]
    """Statistics of patches of ``images`` (channel, y, x) about fractional pixels ``row``, ``column`` (patch).

    ``offset`` (pixel,) is where a patch's pixels lie along either axis, in image pixels. ``regions`` (set, pixel,
    pixel) says ``INNER``, ``OUTER`` or neither. ``out`` (patch, channel, set, statistic) takes the largest and the mean
    value of the inner region and mean and standard deviation of the outer one, whose pixels beyond the image's border
    do not count; NaN where part of the inner region lies beyond it or the outer one has less than two pixels.
    """
    channels, ny, nx = images.shape
    size, sets = offset.size, regions.shape[0]
    whole, count = np.empty(sets, np.bool_), np.empty((sets, 2), np.int64)
    sums = np.empty((channels, sets, 5))  # inner sum, outer sum and squares about the first value, that value, peak
    for p in range(begin, end):
        whole[:], count[:], sums[:], sums[:, :, 4] = True, 0, 0.0, -np.inf
        for i in range(size):
            r = row[p] + offset[i]
            for j in range(size):
                c = column[p] + offset[j]
                inside = -1e-9 <= r <= ny - 1 + 1e-9 and -1e-9 <= c <= nx - 1 + 1e-9
                y = min(max(int(r), 0), ny - 2)
                x = min(max(int(c), 0), nx - 2)
                fr, fc = np.float32(min(max(r - y, 0.0), 1.0)), np.float32(min(max(c - x, 0.0), 1.0))
                for s in range(sets):
                    kind = regions[s, i, j]
                    if kind == INNER:
                        whole[s] = whole[s] and inside
                        count[s, 0] += 1
                    elif kind == OUTER and inside:
                        count[s, 1] += 1
                if not inside:
                    continue
                for k in range(channels):
                    top = images[k, y, x] * (np.float32(1) - fc) + images[k, y, x + 1] * fc
                    bottom = images[k, y + 1, x] * (np.float32(1) - fc) + images[k, y + 1, x + 1] * fc
                    value = np.float64(top * (np.float32(1) - fr) + bottom * fr)
                    for s in range(sets):
                        kind = regions[s, i, j]
                        if kind == INNER:
                            sums[k, s, 0] += value
                            sums[k, s, 4] = max(sums[k, s, 4], value)
                        elif kind == OUTER:
                            if count[s, 1] == 1:
                                sums[k, s, 3] = value
                            gap = value - sums[k, s, 3]
                            sums[k, s, 1] += gap
                            sums[k, s, 2] += gap * gap
        for k in range(channels):
            for s in range(sets):
                if whole[s] and count[s, 1] > 1:
                    mean = sums[k, s, 1] / count[s, 1]
                    out[p, k, s, PEAK] = sums[k, s, 4]
                    out[p, k, s, MEAN] = sums[k, s, 0] / count[s, 0]
                    out[p, k, s, OUTER_MEAN] = sums[k, s, 3] + mean
                    out[p, k, s, OUTER_STD] = np.sqrt(max(sums[k, s, 2] / count[s, 1] - mean * mean, 0.0))
                else:
                    out[p, k, s] = np.nan
