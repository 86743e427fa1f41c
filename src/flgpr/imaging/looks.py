"""How often a place on the ground is seen: apart from the imaging itself, which is slow to load."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flgpr.model import Grid, lane_to_scan


def count_looks(poses: NDArray[np.float64], grid: Grid, points: ArrayLike) -> NDArray[np.int64]:
    """Count the scans, by their poses, whose image of ``grid`` holds each point (..., 3) of the lane frame."""
    count = np.zeros(np.shape(points)[:-1], dtype=np.int64)
    x_min, x_max, y_min, y_max = grid.extent()
    for pose in poses:
        local = lane_to_scan(points, pose)
        count += (
            (local[..., 0] >= x_min)
            & (local[..., 0] <= x_max)
            & (local[..., 1] >= y_min)
            & (local[..., 1] <= y_max)
        )
    return count
