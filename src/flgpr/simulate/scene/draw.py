"""Random numbers by name and place: the same seed gives the same world, in any order of calls."""

from __future__ import annotations

import zlib

import numpy as np

_MASK = (1 << 64) - 1


def stream(seed: int, name: str, first: int = 0, second: int = 0) -> np.random.Generator:
    """Return the random stream of one purpose and place.

    The generator is counter-based (Philox), so that no stream depends on how many numbers another
    one has given, nor on the order in which they are asked for.

    Parameters
    ----------
    seed : int
        Seed of the world.
    name : str
        Purpose, as ``"rocks"``.
    first, second : int
        Place: indices of a tile, or the number of a scan.

    Returns
    -------
    numpy.random.Generator
        The same numbers for the same arguments.
    """
    key = np.array([seed & _MASK, zlib.crc32(name.encode())], dtype=np.uint64)
    counter = np.array([0, 0, first & _MASK, second & _MASK], dtype=np.uint64)
    return np.random.Generator(np.random.Philox(key=key, counter=counter))
