"""The terrain: slope, undulation and ruts under everything that scatters, and the vehicle on it.

The lane's plane z = 0 is the mean ground between the ruts over the lane. Depth counts from the
ground above a body.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from flgpr.jit.compiled import njit
from flgpr.model import Lane, heading_matrix
from flgpr.simulate.scene import scene_tables as tables
from flgpr.simulate.scene.draw import Wander, stream
from flgpr.types import ArrayLike, FloatArray, floats

_MODES = 96
# Nodes of the lattice per length of the undulation: linear interpolation errs by 0.3 % of s, rms.
_NODES_PER_LENGTH = 12
_RUT_NODES = 200  # of the ruts' middle line, per length of its wandering


class TerrainHeights:
    """Height and slope of the ground at every point of the plane, without storage.

    The slope is a plane, the undulation a sum of plane waves whose wavenumbers follow the Gaussian
    spectrum, and each rut a Gaussian trough along a slowly wandering line. Slopes cross zero, and
    ruts run, in the middle of the lane.

    Parameters
    ----------
    table : Terrain
        The scene's table.
    lane : Lane
        The lane.
    seed : int
        Seed of the world.
    """

    def __init__(self, table: tables.Terrain, lane: Lane, seed: int) -> None:
        self.table = table
        self.flat = table.flat
        self._middle = np.array([(lane.x_min + lane.x_max) / 2, (lane.y_min + lane.y_max) / 2])
        self._plane = np.tan([table.slope_across, table.slope_along])
        rng = stream(seed, "undulation")
        self._waves = rng.normal(0, math.sqrt(2) / table.undulation_length, (2, _MODES))
        self._phase = rng.uniform(0, 2 * np.pi, _MODES)
        self._ruts = Wander(stream(seed, "ruts"), table.rut_wander, table.rut_wander_length)

    def __call__(self, x: ArrayLike, y: ArrayLike) -> FloatArray:
        """Return the height of the ground at points of the lane frame.

        Parameters
        ----------
        x, y : array_like
            Positions in the lane frame, m, broadcast against each other.

        Returns
        -------
        ndarray
            Heights, m, in the broadcast shape.
        """
        x, y = np.broadcast_arrays(floats(x), floats(y))
        positions = np.stack([x.ravel(), y.ravel()], axis=1)
        height = self.relief(positions)[:, 0]
        return height.reshape(x.shape)

    def height(self, x: float, y: float) -> float:
        """Return the height of the ground at a place, m."""
        return float(self(x, y).item())

    def relief(self, xy: FloatArray) -> FloatArray:
        """Return height (m) and slopes of the ground.

        Parameters
        ----------
        xy : ndarray (point, 2)
            Positions in the lane frame, m.

        Returns
        -------
        ndarray (point, 3)
            Height, m, dz/dx and dz/dy.
        """
        out = np.zeros((len(xy), 3))
        if self.flat or not len(xy):
            return out
        offset = xy - self._middle
        out[:, 0] = offset @ self._plane
        out[:, 1:] = self._plane
        if self.table.undulation > 0:
            origin, step, nodes = self._undulation(xy)
            _add_undulation(xy, origin, step, nodes, out)
        if self.table.rut_depth > 0:
            start, step, line = self._rut_line(xy[:, 1])
            line = line + [self._middle[0], 0.0]
            depth = self.table.rut_depth
            width = self.table.rut_width
            _add_ruts(xy, start, step, line, depth, width, self.table.rut_spacing, out)
        return out

    def _undulation(self, xy: FloatArray) -> tuple[FloatArray, float, FloatArray]:
        """Return the undulation on a lattice around positions (point, 2).

        These are the lattice's first node, m, its step, m, and heights and slopes (y, x, 3).
        """
        step = self.table.undulation_length / _NODES_PER_LENGTH
        first = np.floor(xy.min(axis=0) / step)
        # One node more than needed, for rounding.
        last = np.floor(xy.max(axis=0) / step) + 3
        x = np.arange(first[0], last[0]) * step
        y = np.arange(first[1], last[1]) * step

        # A plane wave exp(j(kx·x + ky·y + φ)) is a product over the axes, so that the sum over all
        # waves at all nodes is a product of matrices. A slope is the sum of j·k times the waves.
        wave_x, wave_y = self._waves
        along_x = np.exp(1j * (x[:, None] * wave_x + self._phase))
        along_y = np.exp(1j * y[:, None] * wave_y)
        height = along_y @ along_x.T
        slope_x = (along_y * (1j * wave_x)) @ along_x.T
        slope_y = (along_y * (1j * wave_y)) @ along_x.T
        sums = np.stack([height, slope_x, slope_y], axis=-1).real

        # A wave of amplitude sqrt(2/N) has the variance 1/N.
        scale = self.table.undulation * math.sqrt(2 / _MODES)
        return first * step, step, sums * scale

    def _rut_line(self, y: FloatArray) -> tuple[float, float, FloatArray]:
        """Return the line midway between the ruts on nodes along the lane.

        These are the first node, m, the step, m, and the line's position across, m, and slope
        (node, 2). The line is a sum of three sines.
        """
        step = self.table.rut_wander_length / _RUT_NODES
        first = math.floor(y.min() / step)
        # One node more than needed, for rounding.
        last = math.floor(y.max() / step) + 3
        across_and_slope = self._ruts(np.arange(first, last) * step)
        return first * step, step, np.stack(across_and_slope, axis=1)

    def local_sine(self, points: FloatArray, centre: FloatArray) -> FloatArray:
        """Return the sines of the angles of incidence on the ground under points.

        Parameters
        ----------
        points : ndarray (point, 3)
            Points of the lane frame, m; only x and y count.
        centre : ndarray (3,)
            Origin of the rays, m.

        Returns
        -------
        ndarray (point,)
            1 where the ground faces away.
        """
        z, slope_x, slope_y = self.relief(points[:, :2]).T
        ray = centre - points
        ray[:, 2] = centre[2] - z
        # The normal of the ground is (-dz/dx, -dz/dy, 1).
        normal_length = np.sqrt(1 + slope_x**2 + slope_y**2)
        along_normal = ray[:, 2] - slope_x * ray[:, 0] - slope_y * ray[:, 1]
        cosine = along_normal / (normal_length * np.linalg.norm(ray, axis=1))
        return np.sqrt(1 - np.clip(cosine, 0, 1) ** 2)

    def follow(self, pose: FloatArray) -> FloatArray:
        """Return the poses of a vehicle whose four wheels stand on the ground.

        The axles are half a wheelbase before and behind the position of the pose. Four wheels do
        not touch uneven ground at once: the pose is that of the plane that fits their heights.

        Parameters
        ----------
        pose : ndarray (scan, 6)
            Poses on level ground, m and rad.

        Returns
        -------
        ndarray (scan, 6)
            Poses with height, pitch and roll.
        """
        if self.flat or not self.table.follow:
            return pose
        base = self.table.wheelbase
        gauge = self.table.rut_spacing
        # Left and right front wheel, left and right rear wheel.
        wheels = 0.5 * np.array([[-gauge, base], [gauge, base], [-gauge, -base], [gauge, -base]])
        lifted = pose.copy()
        for row in lifted:
            turn = heading_matrix(row[3])[:2, :2]
            z = self.relief(wheels @ turn.T + row[:2])[:, 0]
            front_over_rear = z[0] + z[1] - z[2] - z[3]
            left_over_right = z[0] + z[2] - z[1] - z[3]
            row[2] += z.mean()
            row[4] += math.atan(front_over_rear / (2 * base))
            row[5] += math.atan(left_over_right / (2 * gauge))
        return lifted


@njit(cache=True, error_model="numpy")
def _add_undulation(xy: Any, origin: Any, step: Any, nodes: Any, out: Any) -> None:
    """Add heights and slopes, linear between a lattice's nodes, to ``out`` (point, 3)."""
    for i in range(xy.shape[0]):
        fx = (xy[i, 0] - origin[0]) / step
        fy = (xy[i, 1] - origin[1]) / step
        cx = int(fx)
        cy = int(fy)
        fx = fx - cx
        fy = fy - cy
        for k in range(3):
            low = nodes[cy, cx, k] * (1 - fx) + nodes[cy, cx + 1, k] * fx
            high = nodes[cy + 1, cx, k] * (1 - fx) + nodes[cy + 1, cx + 1, k] * fx
            out[i, k] += low * (1 - fy) + high * fy


@njit(cache=True, error_model="numpy")
def _add_ruts(
    xy: Any, origin: Any, step: Any, line: Any, depth: Any, width: Any, spacing: Any, out: Any
) -> None:
    """Add the heights and slopes of both ruts to ``out`` (point, 3).

    A rut is ``-depth·exp(-4·ln 2·(a/width)²)`` at the distance a from its line, so that ``width``
    is its full width at half depth.
    """
    sharp = 4 * math.log(2.0) / width**2
    for i in range(xy.shape[0]):
        fraction = (xy[i, 1] - origin) / step
        cell = int(fraction)
        fraction -= cell
        middle = line[cell, 0] * (1 - fraction) + line[cell + 1, 0] * fraction
        lean = line[cell, 1] * (1 - fraction) + line[cell + 1, 1] * fraction
        for side in (-0.5, 0.5):
            across = xy[i, 0] - middle - side * spacing
            if abs(across) < 4 * width:  # beyond, the trough is nothing
                trough = depth * math.exp(-sharp * across * across)
                out[i, 0] -= trough
                out[i, 1] += 2 * sharp * across * trough
                out[i, 2] -= 2 * sharp * across * trough * lean
