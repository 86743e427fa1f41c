"""Registration of images to the survey by fiducials beside the lane (flsar2004, par. 13)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flgpr.model import Grid

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class Registration:
    """How far an image lies off the survey."""

    shift: tuple[
        float, float
    ]  #: what is added to a surveyed place to find it in the image, x and y, m
    residual: float  #: rms distance of the fiducials from their shifted survey, m
    used: int


def register_fiducials(
    image: ArrayLike, grid: Grid, surveyed: ArrayLike, reach: float = 0.6
) -> Registration:
    """Find the fiducials in an image and the shift that brings the survey onto them.

    Each fiducial is the brightest pixel within ``reach``, refined by the centroid of the power
    around it; the shift is the median over the fiducials, which a single false one does not move.

    Parameters
    ----------
    image : (y, x) array_like
        Magnitude on the grid.
    grid : Grid
        Pixels.
    surveyed : (n, 2) array_like
        x, y of the fiducials, m.
    reach : float
        Farthest they may lie off, m.

    Raises
    ------
    ValueError
        If no fiducial lies in the image.
    """
    power = np.nan_to_num(np.asarray(image, dtype=np.float64)) ** 2
    found = []
    known = []
    for u, v in np.reshape(np.asarray(surveyed, dtype=np.float64), (-1, 2)):
        near = (np.abs(grid.y[:, None] - v) <= reach) & (np.abs(grid.x[None, :] - u) <= reach)
        if not near.any() or not power[near].max() > 0:
            continue
        row, column = np.unravel_index(np.where(near, power, -1).argmax(), power.shape)
        rows = slice(max(row - 2, 0), row + 3)
        columns = slice(max(column - 2, 0), column + 3)
        part = power[rows, columns]
        found.append(
            (
                (part * grid.x[None, columns]).sum() / part.sum(),
                (part * grid.y[rows, None]).sum() / part.sum(),
            )
        )
        known.append((u, v))
    if not found:
        raise ValueError(
            f"surveyed must hold a fiducial inside the image, got none of {len(np.atleast_2d(surveyed))}"
        )
    offset = np.asarray(found) - np.asarray(known)
    shift = np.median(offset, axis=0)
    residual = float(np.sqrt(((offset - shift) ** 2).sum(axis=1).mean()))
    return Registration((float(shift[0]), float(shift[1])), residual, len(found))
