"""Random numbers by name and place: the same seed gives the same world, whatever is asked for first."""

from __future__ import annotations

import zlib

import numpy as np

_MASK = (1 << 64) - 1


def stream(seed: int, name: str, first: int = 0, second: int = 0) -> np.random.Generator:
    """Open the random stream of one purpose and place (tile or scan): counter-based, so that no order matters."""
    key = np.array([seed & _MASK, zlib.crc32(name.encode())], dtype=np.uint64)
    counter = np.array([0, 0, first & _MASK, second & _MASK], dtype=np.uint64)
    return np.random.Generator(np.random.Philox(key=key, counter=counter))
