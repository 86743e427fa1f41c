"""The phase of a path."""

from __future__ import annotations

import numpy as np

from flgpr.model.constants import SPEED_OF_LIGHT
from flgpr.types import AnyArray, ArrayLike, Complex128Array, floats


def path_phase(frequency: ArrayLike, path: ArrayLike) -> Complex128Array:
    """Compute the field of a unit scatterer at a total path, ``exp(-j2πf·path/c)``.

    Parameters
    ----------
    frequency : (frequency,) array_like
        Tones, Hz.
    path : (...) array_like
        Lengths of the paths out and back, m.

    Returns
    -------
    (..., frequency) ndarray of complex128
        Field.
    """
    lengths = floats(path)[..., None]
    turns = lengths * floats(frequency) / SPEED_OF_LIGHT
    # Whole turns are taken off first: the argument of the exponential stays small.
    fraction = turns - np.floor(turns)
    return np.asarray(np.exp(-2j * np.pi * fraction), dtype=np.complex128)


def lengthen(signal: ArrayLike, frequency: ArrayLike, path: ArrayLike) -> AnyArray:
    """Lengthen the paths of a signal.

    Parameters
    ----------
    signal : (..., frequency) array_like
        Signal.
    frequency : (frequency,) array_like
        Tones, Hz.
    path : (...) array_like
        By how much the paths of the leading axes get longer, m; it is broadcast.

    Returns
    -------
    (..., frequency) ndarray of complex
        Signal, in the precision of the input.
    """
    values = np.asarray(signal)
    dtype = values.dtype if np.iscomplexobj(values) else np.dtype(np.complex128)
    return (values * path_phase(frequency, path)).astype(dtype, copy=False)
