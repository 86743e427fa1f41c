"""Where echoes appear again, for tones that repeat a path: what tests of that compare with."""

import math

import numpy as np


def alias_paths(path, unambiguous, nearest, farthest):
    """Return the rising paths (n,), m, at which an echo appears besides its own.

    They lie from ``nearest`` to ``farthest``.
    """
    if not math.isfinite(unambiguous):
        return np.empty(0)
    first = math.ceil((nearest - path) / unambiguous)
    last = math.floor((farthest - path) / unambiguous)
    times = np.arange(first, last + 1)
    return path + unambiguous * times[times != 0]
