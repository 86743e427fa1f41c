"""Archives of NumPy, read as a whole and closed."""

import numpy as np


def read_archive(path):
    """All arrays of a file, by name."""
    with np.load(path) as archive:
        return dict(archive)
