"""Coherent sums over an aperture for all range biases at once."""

from __future__ import annotations

import numpy as np

from flgpr.jit.threads import shared


@shared(cache=True)
def sum_over_biases(table, tx, rx, share, points, step, turns, first, total, begin, end):  # type: ignore[no-untyped-def]
    """Add the values of range profiles at points to ``total``, for all range biases at once.

    A bias shifts the bin of every path alike, so that the values at all biases are a window of
    neighbouring bins, read in one go.

    Parameters
    ----------
    table : (polarization, sweep, bin) ndarray of complex64
        Range profiles without their carrier. The last bins repeat the first ones, as far as a
        window of biases reaches over the end.
    tx, rx : (sweep, 3) ndarray
        Positions of the sweeps' antennas, m.
    share : (sweep,) ndarray
        Weights of the sweeps.
    points : (point, 3) ndarray
        Points, m, in the frame of the antennas.
    step : float
        Distance of the bins, m of path.
    turns : float
        Turns of the carrier per metre of path, by which the profiles' phase was reduced.
    first : int
        Number of the least bias, in bins from no bias.
    total : (point, polarization, bias) ndarray of complex64
        Sums that are added to.
    begin, end : int
        Points of this call.
    """
    biases = total.shape[2]
    size = table.shape[2] - biases - 1
    for k in range(begin, end):
        x, y, z = points[k]
        for s in range(table.shape[1]):
            path = np.sqrt((tx[s, 0] - x) ** 2 + (tx[s, 1] - y) ** 2 + (tx[s, 2] - z) ** 2)
            path += np.sqrt((rx[s, 0] - x) ** 2 + (rx[s, 1] - y) ** 2 + (rx[s, 2] - z) ** 2)
            # A bin and the fraction of the way to the next one: linear interpolation below.
            cell = np.floor(path / step)
            at = (np.int64(cell) + first) % size
            high = np.float32(path / step - cell)
            # Whole turns are taken off first: the argument of cosine and sine stays small.
            angle = 2 * np.pi * (turns * path - np.floor(turns * path))
            turned = np.complex64(share[s] * complex(np.cos(angle), np.sin(angle)))
            for p in range(table.shape[0]):
                window = table[p, s, at : at + biases + 1]
                out = total[k, p]
                for b in range(biases):
                    out[b] += turned * (window[b] + high * (window[b + 1] - window[b]))
