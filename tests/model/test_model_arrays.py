"""Names for the types of arrays."""

from typing import get_args

import numpy as np

from flgpr.types import Complex128Array, FloatArray


def test_the_names_are_double_precision():
    for name, kind in ((FloatArray, np.float64), (Complex128Array, np.complex128)):
        _, dtype = get_args(name)
        assert get_args(dtype) == (kind,)
