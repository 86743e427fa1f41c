"""Types of arrays and of what goes with them: the one place where they are named.

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
Entries = dict[str, Any]
"""Values by their names: an object of JSON, a table of TOML, what a header states."""
Notes = list[str]
"""What was assumed, replaced or left out while a file was read or written, a line each."""
PathLike = str | Path


def floats(values: Any) -> FloatArray:
    """Return values as an array of float64; one that is such an array is not copied."""
    return np.asarray(values, dtype=np.float64)
