"""Sizes that kernels and their callers share, and aligned memory."""

from __future__ import annotations

from typing import Any

import numpy as np

from flgpr.jit.compiled import njit
from flgpr.types import AnyArray

BLOCK = 64
"""Pixels that are worked on together; pixel arrays are padded to a multiple."""
GATHER_PAIRS = 6
"""Pairs whose interpolation weights are held at a time when profiles are read."""
SPREAD_PAIRS = 9
"""Largest number of pairs that one task writes."""
CHANNELS = (1, 4, 16)
"""Channels per lane row that kernels are compiled for."""
KEPT_BYTES = 1 << 26
"""Largest tables of delays and phasors that an operator keeps."""


@njit(cache=True)
def padded(taps: int) -> int:
    """Return the number of taps padded to full vectors: 4, 8 or 16."""
    return 4 if taps <= 4 else 8 if taps <= 8 else 16


@njit(cache=True)
def row_size(taps: int, channels: int) -> int:
    """Return the numbers in a table row: both parts of all channels, or of a single one's taps."""
    return 2 * (padded(taps) if channels == 1 else channels)


def aligned(size: int, dtype: Any) -> AnyArray:
    """Return an uninitialised flat array that starts on a cache line: no vector spans two."""
    bytes_ = size * np.dtype(dtype).itemsize
    raw = np.empty(bytes_ + 64, np.uint8)
    start = -raw.ctypes.data % 64
    return raw[start : start + bytes_].view(dtype)
