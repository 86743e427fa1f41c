"""The phase of a path."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flgpr.model.constants import SPEED_OF_LIGHT


def path_phase(frequency: ArrayLike, path: ArrayLike) -> NDArray[np.complex128]:
    """Field of a unit scatterer at a total path: ``exp(-j2πf·path/c)``.

    Parameters
    ----------
    frequency : (frequency,) array_like
        Tones, Hz.
    path : (...) array_like
        Total path, m.

    Returns
    -------
    (..., frequency) ndarray of complex128
        The phase factor; whole turns are taken off first, so long paths lose no precision.
    """
    turns = np.asarray(path, dtype=np.float64)[..., None] * np.asarray(frequency, dtype=np.float64) / SPEED_OF_LIGHT
    return np.asarray(np.exp(-2j * np.pi * (turns - np.floor(turns))), dtype=np.complex128)


def lengthen(signal: ArrayLike, frequency: ArrayLike, path: ArrayLike) -> NDArray[Any]:
    """Make the paths of a signal longer.

    Parameters
    ----------
    signal : (..., frequency) array_like of complex
        Field.
    frequency : (frequency,) array_like
        Tones, Hz.
    path : (...) array_like
        Length to add, m; broadcasts against the leading axes of the signal.

    Returns
    -------
    (..., frequency) ndarray
        The field, of the signal's type.
    """
    values = np.asarray(signal)
    dtype = values.dtype if np.iscomplexobj(values) else np.dtype(np.complex128)
    return (values * path_phase(frequency, path)).astype(dtype, copy=False)
