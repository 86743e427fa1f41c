"""Random numbers by name and place: the same seed gives the same world, in any order of calls."""

from __future__ import annotations

import math
import zlib

import numpy as np

from flgpr.types import FloatArray

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


class Wander:
    """Slow wandering across the lane: three waves of random length and phase.

    Parameters
    ----------
    rng : numpy.random.Generator
        Draws the waves.
    rms : float
        Root mean square of the way across, m.
    length : float
        Middle of the waves' lengths, m.
    """

    def __init__(self, rng: np.random.Generator, rms: float, length: float) -> None:
        self._amplitude = rms * math.sqrt(2 / 3)
        self._waves = 2 * np.pi / length * rng.uniform(0.5, 1.5, 3)
        self._phase = rng.uniform(0, 2 * np.pi, 3)

    def __call__(self, y: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the way across at places along the lane, m, and its slope there."""
        angle = np.outer(y, self._waves) + self._phase
        across = self._amplitude * np.sin(angle).sum(axis=1)
        return across, self._amplitude * (self._waves * np.cos(angle)).sum(axis=1)
