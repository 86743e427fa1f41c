"""Point targets seen by arrays, written out from the sign convention."""

import numpy as np

C = 299_792_458.0


def echo(tx, rx, targets, frequency, amplitude=None):
    """Sum of exp(-j2πfL/c) over targets, (pair, frequency)."""
    total = 0
    for k, target in enumerate(np.atleast_2d(targets)):
        path = np.linalg.norm(tx - target, axis=-1) + np.linalg.norm(rx - target, axis=-1)
        total = total + (1 if amplitude is None else amplitude[k]) * np.exp(
            -2j * np.pi * path[..., None] * frequency / C
        )
    return total
