"""Types of arrays, and of what names a file: the one place where they are named.

A name says what an array holds; shapes stand in docstrings.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike as ArrayLike
from numpy.typing import NDArray

AnyArray = NDArray[Any]
BoolArray = NDArray[np.bool_]
IntArray = NDArray[np.int64]
IndexArray = NDArray[np.intp]
Float32Array = NDArray[np.float32]
FloatArray = NDArray[np.float64]
ComplexArray = NDArray[np.complex64]
"""Signals and images, which are single precision throughout."""
Complex128Array = NDArray[np.complex128]
Arrays = dict[str, AnyArray]
"""Arrays by their names."""
PathLike = str | Path


def floats(values: Any) -> FloatArray:
    """Return values as an array of float64; one that is such an array is not copied."""
    return np.asarray(values, dtype=np.float64)
