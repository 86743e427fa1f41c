"""Scans that see a point are counted by their poses."""

import numpy as np

from flgpr.imaging import count_looks
from flgpr.model import Grid


def test_a_point_is_seen_where_the_grid_of_a_scan_holds_it():
    grid = Grid.spanning((-1.0, 1.0), (2.0, 4.0), 0.5)  # pixels reach to ±1.25 and 1.75 to 4.25
    poses = np.zeros((3, 6))
    poses[:, 1] = [0.0, 1.0, 2.0]
    points = np.array([[0.0, 3.0, 0.0], [0.0, 4.2, 0.0], [1.3, 3.0, 0.0], [0.0, 9.0, 0.0]])
    assert count_looks(poses, grid, points).tolist() == [2, 3, 0, 0]
    assert count_looks(poses, grid, points, farthest=2.5).tolist() == [1, 1, 0, 0]
    assert count_looks(poses, grid, points, farthest=9.0).tolist() == [2, 3, 0, 0]
