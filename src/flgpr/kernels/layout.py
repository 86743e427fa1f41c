"""Sizes that kernels and their callers share, and aligned memory."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

BLOCK = 64
"""Pixels that are worked on together; pixel arrays are padded to a multiple."""
GATHER_PAIRS = 6
"""Pairs whose interpolation weights are held at a time when profiles are read."""
SPREAD_PAIRS = 9
"""Largest number of pairs that one task writes."""
CHANNELS = (4, 16)
"""Channels per lane row that kernels are compiled for."""


def aligned(size: int, dtype: Any) -> NDArray[Any]:
    """Uninitialised flat array that starts on a cache line, so that no vector straddles two."""
    bytes_ = size * np.dtype(dtype).itemsize
    raw = np.empty(bytes_ + 64, np.uint8)
    start = -raw.ctypes.data % 64
    return raw[start : start + bytes_].view(dtype)
