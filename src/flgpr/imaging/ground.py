"""The ground that an array looks at."""

from __future__ import annotations

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from flgpr.model import Grid, Lane, scan_to_lane

# Height, m, for ground that is looked at by antennas whose poses do not put them above it.
_LEAST_HEIGHT = 0.5


def seen_ground(run: xr.Dataset, poses: NDArray[np.float64]) -> Lane:
    """Return the bounds of the ground that an array of a run looks at from poses (scan, 6), m.

    It reaches from 1 to 5 heights ahead, and 1.2 heights to each side.
    """
    return covered_ground(grid_ahead(run, poses), poses)


def grid_ahead(run: xr.Dataset, poses: NDArray[np.float64]) -> Grid:
    """Return a coarse grid of the scan frame.

    It reaches from 1 to 5 heights ahead of the array, and 1.2 heights to each side.
    """
    antennas = np.concatenate([run["tx_position"].values, run["rx_position"].values])
    height = float(poses[:, 2].mean() + antennas[:, 2].mean())
    scale = height if height > 0 else max(float(np.ptp(antennas, axis=0).max()), _LEAST_HEIGHT)
    return Grid.spanning((-1.2 * scale, 1.2 * scale), (scale, 5 * scale), scale / 20)


def covered_ground(grid: Grid, poses: NDArray[np.float64]) -> Lane:
    """Return the bounds of what images on a grid of the scan frame cover at poses (scan, 6), m.

    They hold whichever way the vehicle heads.
    """
    corners = np.concatenate([scan_to_lane(grid.corners(), pose)[:, :2] for pose in poses])
    x_min, y_min = corners.min(axis=0)
    x_max, y_max = corners.max(axis=0)
    return Lane(float(x_min), float(x_max), float(y_min), float(y_max))
