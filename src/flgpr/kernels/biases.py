"""Coherent sums over an aperture for all range biases at once."""

from __future__ import annotations

import numpy as np

from flgpr.jit.threads import shared


@shared(cache=True)
def sum_over_biases(table, tx, rx, share, points, step, turns, first, total, begin, end):  # type: ignore[no-untyped-def]
    """Add the values of range profiles (polarization, sweep, bin) at points to ``total``.

    ``total`` is (point, polarization, bias). ``share`` weights the sweeps, whose antennas stand at
    ``tx`` and ``rx`` (sweep, 3), m. Bins are ``step`` apart, m, and the last ones repeat the first,
    as far as a window of biases reaches over the end; ``turns`` the phase per metre, of which
    profiles are rid. The least bias lies ``first`` bins from none.
    """
    biases = total.shape[2]
    size = table.shape[2] - biases - 1
    for k in range(begin, end):
        x, y, z = points[k]
        for s in range(table.shape[1]):
            path = np.sqrt((tx[s, 0] - x) ** 2 + (tx[s, 1] - y) ** 2 + (tx[s, 2] - z) ** 2)
            path += np.sqrt((rx[s, 0] - x) ** 2 + (rx[s, 1] - y) ** 2 + (rx[s, 2] - z) ** 2)
            cell = np.floor(path / step)
            at = (np.int64(cell) + first) % size
            high = np.float32(path / step - cell)
            angle = 2 * np.pi * (turns * path - np.floor(turns * path))
            turned = np.complex64(share[s] * complex(np.cos(angle), np.sin(angle)))
            for p in range(table.shape[0]):
                window = table[p, s, at : at + biases + 1]
                out = total[k, p]
                for b in range(biases):
                    out[b] += turned * (window[b] + high * (window[b + 1] - window[b]))
