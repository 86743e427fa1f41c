"""The terrain: slope, undulation and ruts under everything that scatters, and the vehicle that follows it.

The lane's plane z = 0 is the mean ground between the ruts over the lane. Depth counts from the ground above a body.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from flgpr.kernels.compiled import njit
from flgpr.model import Lane, heading_matrix
from flgpr.model.arrays import FloatArray
from flgpr.simulate.scene import scene_tables as tables
from flgpr.simulate.scene.draw import stream

_MODES = 96
# nodes of the lattice per length of the undulation: linear interpolation errs by 0.3 % of s, rms
_FINE = 12


class Terrain:
    """Height and slope of the ground at every point of the plane, without storage.

    Slope is a plane, undulation a sum of plane waves whose wavenumbers follow the Gaussian spectrum, and each rut a
    Gaussian trough along a slowly wandering line. In the lane's middle slopes cross zero and ruts run.
    """

    def __init__(self, table: tables.Terrain, lane: Lane, seed: int) -> None:
        self.table = table
        self.flat = table.flat
        self._middle = np.array([(lane.x_min + lane.x_max) / 2, (lane.y_min + lane.y_max) / 2])
        self._plane = np.tan([table.slope_across, table.slope_along])
        rng = stream(seed, "undulation")
        self._waves = rng.normal(0, math.sqrt(2) / table.undulation_length, (2, _MODES))
        self._phase = rng.uniform(0, 2 * np.pi, _MODES)
        rng = stream(seed, "ruts")
        self._wander = (
            2 * np.pi / table.rut_wander_length * rng.uniform(0.5, 1.5, 3),
            rng.uniform(0, 2 * np.pi, 3),
        )

    def __call__(self, x: ArrayLike, y: ArrayLike) -> FloatArray:
        """Height of the ground at points of the lane frame, m, in the shape of ``x`` and ``y``."""
        x, y = np.broadcast_arrays(np.asarray(x, dtype=float), np.asarray(y, dtype=float))
        return np.asarray(
            self.relief(np.stack([x.ravel(), y.ravel()], axis=1))[:, 0].reshape(x.shape)
        )

    def relief(self, xy: FloatArray) -> FloatArray:
        """Height (m) and slopes dz/dx and dz/dy at places (point, 2): (point, 3)."""
        out = np.zeros((len(xy), 3))
        if self.flat or not len(xy):
            return out
        offset = xy - self._middle
        out[:, 0] = offset @ self._plane
        out[:, 1:] = self._plane
        if self.table.undulation > 0:
            _add_undulation(xy, *self._undulation(xy), out)
        if self.table.rut_depth > 0:
            start, pitch, line = self._rut_line(xy[:, 1])
            width = self.table.rut_width
            spacing = self.table.rut_spacing
            _add_ruts(
                xy,
                start,
                pitch,
                line + [self._middle[0], 0.0],
                self.table.rut_depth,
                width,
                spacing,
                out,
            )
        return out

    def _undulation(self, xy: FloatArray) -> tuple[FloatArray, float, FloatArray]:
        """Heights and slopes (y, x, 3) on the lattice around places (point, 2), its first node and its step, m."""
        step = self.table.undulation_length / _FINE
        # one to spare for rounding
        first = np.floor(xy.min(axis=0) / step)
        last = np.floor(xy.max(axis=0) / step) + 3
        x, y = (np.arange(a, b) * step for a, b in zip(first, last, strict=True))
        along_x = np.exp(1j * (x[:, None] * self._waves[0] + self._phase))
        along_y = np.exp(1j * y[:, None] * self._waves[1])
        sums = [
            (along_y * factor) @ along_x.T
            for factor in (1.0, 1j * self._waves[0], 1j * self._waves[1])
        ]
        return (
            first * step,
            step,
            np.stack(sums, axis=-1).real * (self.table.undulation * math.sqrt(2 / _MODES)),
        )

    def _rut_line(self, y: FloatArray) -> tuple[float, float, FloatArray]:
        """Place across and its slope (node, 2) of the middle between the ruts, its first node and its step, m."""
        step = self.table.rut_wander_length / 200
        # one to spare for rounding
        first = math.floor(y.min() / step)
        last = math.floor(y.max() / step) + 3
        (waves, start), size = self._wander, self.table.rut_wander * math.sqrt(2 / 3)
        turns = np.arange(first, last)[:, None] * step * waves + start
        return (
            first * step,
            step,
            size * np.stack([np.sin(turns).sum(1), (waves * np.cos(turns)).sum(1)], axis=1),
        )

    def local_sine(self, points: FloatArray, centre: FloatArray) -> FloatArray:
        """Sine of incidence from ``centre`` on the ground under points (point, 3); 1 where it faces away."""
        z, along_x, along_y = self.relief(points[:, :2]).T
        ray = centre - points
        ray[:, 2] = centre[2] - z
        normal = np.sqrt(1 + along_x**2 + along_y**2)
        cosine = (ray[:, 2] - along_x * ray[:, 0] - along_y * ray[:, 1]) / (
            normal * np.linalg.norm(ray, axis=1)
        )
        return np.asarray(np.sqrt(1 - np.clip(cosine, 0, 1) ** 2))

    def follow(self, pose: FloatArray) -> FloatArray:
        """Poses (scan, 6) of a vehicle with four wheels on the ground, half a wheelbase before and behind it."""
        if self.flat or not self.table.follow:
            return pose
        base = self.table.wheelbase
        gauge = self.table.rut_spacing
        lifted = pose.copy()
        for row in lifted:
            turn = heading_matrix(row[3])[:2, :2]
            wheels = 0.5 * np.array(
                [[-gauge, base], [gauge, base], [-gauge, -base], [gauge, -base]]
            )
            z = self.relief(wheels @ turn.T + row[:2])[:, 0]
            row[2] += z.mean()
            row[4] += math.atan((z[0] + z[1] - z[2] - z[3]) / (2 * base))
            row[5] += math.atan((z[0] + z[2] - z[1] - z[3]) / (2 * gauge))
        return lifted


@njit(cache=True, error_model="numpy")
def _add_undulation(xy: Any, origin: Any, step: Any, nodes: Any, out: Any) -> None:
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
    sharp = 4 * math.log(2.0) / width**2
    for i in range(xy.shape[0]):
        part = (xy[i, 1] - origin) / step
        cell = int(part)
        part -= cell
        middle = line[cell, 0] * (1 - part) + line[cell + 1, 0] * part
        lean = line[cell, 1] * (1 - part) + line[cell + 1, 1] * part
        for side in (-0.5, 0.5):
            across = xy[i, 0] - middle - side * spacing
            if abs(across) < 4 * width:  # beyond, the trough is nothing
                trough = depth * math.exp(-sharp * across * across)
                out[i, 0] -= trough
                out[i, 1] += 2 * sharp * across * trough
                out[i, 2] -= 2 * sharp * across * trough * lean
