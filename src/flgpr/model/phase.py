"""The phase of a path."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flgpr.model.constants import SPEED_OF_LIGHT


def path_phase(frequency: ArrayLike, path: ArrayLike) -> NDArray[np.complex128]:
    """Compute the field (..., frequency) of a unit scatterer at a total path (...), m.

    It is ``exp(-j2πf·path/c)``, exact for long paths.
    """
    lengths = np.asarray(path, dtype=np.float64)[..., None]
    turns = lengths * np.asarray(frequency, dtype=np.float64) / SPEED_OF_LIGHT
    return np.asarray(np.exp(-2j * np.pi * (turns - np.floor(turns))), dtype=np.complex128)


def lengthen(signal: ArrayLike, frequency: ArrayLike, path: ArrayLike) -> NDArray[Any]:
    """Lengthen the paths of a signal (..., frequency) by ``path`` (m), of its leading axes."""
    values = np.asarray(signal)
    dtype = values.dtype if np.iscomplexobj(values) else np.dtype(np.complex128)
    return (values * path_phase(frequency, path)).astype(dtype, copy=False)
