"""The ground that an array looks at."""

from __future__ import annotations

import numpy as np
import xarray as xr

from flgpr.model import Grid, Lane, scan_to_lane
from flgpr.types import FloatArray

# Height, m, for ground that is looked at by antennas whose poses do not put them above it.
_LEAST_HEIGHT = 0.5


def seen_ground(run: xr.Dataset, poses: FloatArray) -> Lane:
    """Return the bounds of the ground that an array looks at.

    It reaches from 1 to 5 heights ahead, and 1.2 heights to each side.

    Parameters
    ----------
    run : xarray.Dataset
        A run, for the positions of its antennas.
    poses : (scan, 6) ndarray
        Poses, m and rad.

    Returns
    -------
    Lane
        Bounds in the lane frame, m.
    """
    return covered_ground(grid_ahead(run, poses), poses)


def grid_ahead(run: xr.Dataset, poses: FloatArray) -> Grid:
    """Return a coarse grid of the scan frame.

    It reaches from 1 to 5 heights ahead of the array, and 1.2 heights to each side. The parameters
    are those of :func:`seen_ground`.
    """
    antennas = np.concatenate([run["tx_position"].values, run["rx_position"].values])
    height = float(poses[:, 2].mean() + antennas[:, 2].mean())
    scale = height
    if not height > 0:
        # Poses without a height: the array's own size takes its place.
        scale = max(float(np.ptp(antennas, axis=0).max()), _LEAST_HEIGHT)
    return Grid.spanning((-1.2 * scale, 1.2 * scale), (scale, 5 * scale), scale / 20)


def covered_ground(grid: Grid, poses: FloatArray) -> Lane:
    """Return the bounds of the ground that images cover, whichever way the vehicle heads.

    Parameters
    ----------
    grid : Grid
        Pixels of the images in the scan frame.
    poses : (scan, 6) ndarray
        Poses, m and rad.

    Returns
    -------
    Lane
        Bounds in the lane frame, m.
    """
    corners = np.concatenate([scan_to_lane(grid.corners(), pose)[:, :2] for pose in poses])
    x_min, y_min = corners.min(axis=0)
    x_max, y_max = corners.max(axis=0)
    return Lane(float(x_min), float(x_max), float(y_min), float(y_max))
