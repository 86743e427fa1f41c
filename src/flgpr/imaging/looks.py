"""Number of scans that see a point: a module apart from the imaging, which is slow to load."""

from __future__ import annotations

import math

import numpy as np

from flgpr.model import Grid, lane_to_scan
from flgpr.types import ArrayLike, FloatArray, IntArray


def count_looks(
    poses: FloatArray, grid: Grid, points: ArrayLike, farthest: float = math.inf
) -> IntArray:
    """Count the scans whose image holds each point.

    Parameters
    ----------
    poses : (scan, 6) ndarray
        Poses of the scans, m and rad.
    grid : Grid
        Pixels of the scan images.
    points : (..., 3) array_like
        Points of the lane frame, m.
    farthest : float
        Distance ahead beyond which an image does not count, m.

    Returns
    -------
    (...) ndarray of int
        Number of scans.
    """
    count = np.zeros(np.shape(points)[:-1], dtype=np.int64)
    x_min, x_max, y_min, y_max = grid.extent()
    y_max = min(y_max, farthest)
    for pose in poses:
        local = lane_to_scan(points, pose)
        inside_x = (local[..., 0] >= x_min) & (local[..., 0] <= x_max)
        inside_y = (local[..., 1] >= y_min) & (local[..., 1] <= y_max)
        count += inside_x & inside_y
    return count
