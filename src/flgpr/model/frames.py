"""Lane, vehicle and scan frames, and the pixel grids that lie in them.

- Lane frame: x cross-track (right positive), y down-track (forward positive), z up, mean ground at
  z = 0.
- Vehicle frame: the same axes at the array's reference point.
- Scan frame: the vehicle frame levelled and dropped to the ground, that is lane axes turned by the
  heading only, origin on the mean ground below the array's reference point. Scan images live in it,
  because whatever moves with the vehicle (the self-signature) stays in place there.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from flgpr.types import ArrayLike, FloatArray, floats

if TYPE_CHECKING:
    import pandas as pd


def attitude_matrix(pitch: ArrayLike, roll: ArrayLike) -> FloatArray:
    """Return rotations Rx(pitch)·Ry(roll) from the vehicle frame to level axes.

    Parameters
    ----------
    pitch, roll : (...) array_like
        Angles, rad.

    Returns
    -------
    (..., 3, 3) ndarray
        Rotations.
    """
    cp, sp = _cos_sin(pitch)
    cr, sr = _cos_sin(roll)
    m = np.zeros((*cp.shape, 3, 3))
    m[..., 0, 0] = cr
    m[..., 0, 2] = sr
    m[..., 1, 0] = sp * sr
    m[..., 1, 1] = cp
    m[..., 1, 2] = -sp * cr
    m[..., 2, 0] = -cp * sr
    m[..., 2, 1] = sp
    m[..., 2, 2] = cp * cr
    return m


def heading_matrix(heading: ArrayLike) -> FloatArray:
    """Return rotations Rz(-heading), (..., 3, 3), from level axes along the vehicle to lane axes.

    The heading is clockwise from +y.
    """
    c, s = _cos_sin(heading)
    m = np.zeros((*c.shape, 3, 3))
    m[..., 0, 0] = m[..., 1, 1] = c
    m[..., 0, 1] = s
    m[..., 1, 0] = -s
    m[..., 2, 2] = 1.0
    return m


def pose_matrix(pose: ArrayLike) -> FloatArray:
    """Return rotations Rz(-heading)·Rx(pitch)·Ry(roll), (..., 3, 3), of poses (..., 6).

    They turn the vehicle frame to lane axes.
    """
    p = floats(pose)
    return heading_matrix(p[..., 3]) @ attitude_matrix(p[..., 4], p[..., 5])


def _cos_sin(angle: ArrayLike) -> tuple[FloatArray, FloatArray]:
    """Compute cosine and sine by the mathematical library.

    NumPy's differ between processors in the last bit.
    """
    angles = floats(angle)
    numbers = angles.ravel().tolist()
    cosine = np.reshape([math.cos(number) for number in numbers], angles.shape)
    sine = np.reshape([math.sin(number) for number in numbers], angles.shape)
    return cosine, sine


def _shift(pose: FloatArray, components: list[int]) -> FloatArray:
    """Return some components of the position, the others zero.

    The shape is (3,) for one pose and (..., 1, 3) for several.
    """
    shift = np.zeros((*pose.shape[:-1], 3))
    shift[..., components] = pose[..., components]
    return shift if pose.ndim == 1 else shift[..., None, :]


def attitude_angles(rotation: ArrayLike) -> FloatArray:
    """Return heading, pitch and roll (..., 3), rad, of rotations (..., 3, 3) to lane axes.

    This is the inverse of ``Rz(-heading)·Rx(pitch)·Ry(roll)``, with the pitch within ±π/2.
    """
    m = floats(rotation)
    heading = np.arctan2(m[..., 0, 1], m[..., 1, 1])
    sine_of_pitch = np.clip(m[..., 2, 1], -1.0, 1.0)  # rounding may leave it beyond one
    roll = np.arctan2(-m[..., 2, 0], m[..., 2, 2])
    return np.stack([heading, np.arcsin(sine_of_pitch), roll], axis=-1)


def wrapped(angle: ArrayLike) -> FloatArray:
    """Return angles, rad, within half a turn to either side of zero."""
    return floats(np.angle(np.exp(1j * floats(angle))))


def steps_of(places: FloatArray) -> FloatArray:
    """Return how far each of some places (place, 2 or more) is from the one before, in x and y."""
    return floats(np.hypot(*np.diff(places[:, :2], axis=0).T))


def ground_points(table: pd.DataFrame) -> FloatArray:
    """Return the points (n, 3) on the mean ground, m, of a table with ``x`` and ``y``."""
    points = np.zeros((len(table), 3))
    points[:, 0] = table["x"]
    points[:, 1] = table["y"]
    return points


def vehicle_to_scan(position: ArrayLike, pose: ArrayLike) -> FloatArray:
    """Convert points (..., 3), m, from the vehicle frame to the scan frame of a pose (6,).

    This and the functions below also convert points (..., point, 3) for poses (..., 6), whose
    leading axes broadcast.
    """
    p = floats(pose)
    rotation = attitude_matrix(p[..., 4], p[..., 5])
    level = floats(position) @ rotation.swapaxes(-1, -2)
    return level + _shift(p, [2])


def scan_to_lane(position: ArrayLike, pose: ArrayLike) -> FloatArray:
    """Convert points (..., 3), m, from the scan frame of a pose (6,) to the lane frame."""
    p = floats(pose)
    rotation = heading_matrix(p[..., 3])
    turned = floats(position) @ rotation.swapaxes(-1, -2)
    return turned + _shift(p, [0, 1])


def lane_to_scan(position: ArrayLike, pose: ArrayLike) -> FloatArray:
    """Convert points (..., 3), m, from the lane frame to the scan frame of a pose (6,)."""
    p = floats(pose)
    offset = floats(position) - _shift(p, [0, 1])
    return offset @ heading_matrix(p[..., 3])  # of rows: the inverse rotation


def vehicle_to_lane(position: ArrayLike, pose: ArrayLike) -> FloatArray:
    """Convert points (..., 3), m, from the vehicle frame to the lane frame.

    A point p becomes ``t + Rz(-heading)·Rx(pitch)·Ry(roll)·p``.
    """
    return scan_to_lane(vehicle_to_scan(position, pose), pose)


def rigid_array(tx: FloatArray, rx: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray, float]:
    """Take an array of antennas that keeps its form and heading from the lane to the vehicle frame.

    Parameters
    ----------
    tx, rx : (scan, antenna, 3) ndarray
        Positions of transmitters and receivers in the lane frame, m.

    Returns
    -------
    tx, rx : (antenna, 3) ndarray
        Positions about the mean of the transmitters, in the lane's axes, by the first scan, m.
    pose : (scan, 6) ndarray
        Poses of that mean, without angles, m and rad.
    moved : float
        How far an antenna moves against the others at most, m; NaN where a position is none.
    """
    origin = tx.mean(axis=1)
    local_tx, local_rx = (points - origin[:, None] for points in (tx, rx))
    moved = max(float(np.abs(points - points[0]).max()) for points in (local_tx, local_rx))
    pose = np.zeros((len(tx), 6))
    pose[:, :3] = origin
    return local_tx[0], local_rx[0], pose, moved


@dataclass(frozen=True)
class Grid:
    """A rectangular grid of pixel centres on the plane z = 0.

    Examples
    --------
    >>> from flgpr.model import Grid
    >>> grid = Grid.spanning((-1.0, 1.0), (7.0, 8.0), 0.5)
    >>> grid.shape, grid.extent()
    ((3, 5), (-1.25, 1.25, 6.75, 8.25))
    >>> grid.points()[0, -1]
    array([1., 7., 0.])
    """

    x_min: float  #: centre of the first pixel, m
    y_min: float  #: centre of the first pixel, m
    nx: int  #: number of pixels cross-track
    ny: int  #: number of pixels down-track
    dx: float  #: pixel spacing, m
    dy: float  #: pixel spacing, m

    def __post_init__(self) -> None:
        if self.nx < 1 or self.ny < 1:
            raise ValueError(
                f"grid must have at least one pixel each way, got nx = {self.nx}, ny = {self.ny}"
            )
        if not (self.dx > 0 and self.dy > 0):
            raise ValueError(f"grid spacing must be positive, got dx = {self.dx}, dy = {self.dy}")

    @classmethod
    def spanning(cls, x: tuple[float, float], y: tuple[float, float], spacing: float) -> Grid:
        """Return the grid with pixel centres on the limits, the last rounded to the spacing."""
        if not spacing > 0:
            raise ValueError(f"spacing must be positive, got {spacing}")
        if not (x[1] > x[0] and y[1] > y[0]):
            raise ValueError(f"grid limits must increase, got x = {x}, y = {y}")
        nx = round((x[1] - x[0]) / spacing) + 1
        ny = round((y[1] - y[0]) / spacing) + 1
        return cls(x[0], y[0], nx, ny, spacing, spacing)

    @property
    def shape(self) -> tuple[int, int]:
        """Shape (y, x) of an image on the grid."""
        return (self.ny, self.nx)

    @property
    def x(self) -> FloatArray:
        """Pixel centres cross-track, m, shape (nx,)."""
        return _centres(self.x_min, self.dx, self.nx)

    @property
    def y(self) -> FloatArray:
        """Pixel centres down-track, m, shape (ny,)."""
        return _centres(self.y_min, self.dy, self.ny)

    def points(self) -> FloatArray:
        """Pixel centres as points (ny, nx, 3), z = 0."""
        points = np.zeros((*self.shape, 3))
        points[..., 0] = self.x[None, :]
        points[..., 1] = self.y[:, None]
        return points

    def extent(self) -> tuple[float, float, float, float]:
        """Outer edges of the pixels: x_min, x_max, y_min, y_max, as matplotlib's ``extent``."""
        return (
            self.x_min - self.dx / 2,
            self.x_min + (self.nx - 0.5) * self.dx,
            self.y_min - self.dy / 2,
            self.y_min + (self.ny - 0.5) * self.dy,
        )

    def corners(self, y_max: float = math.inf) -> FloatArray:
        """Corners (4, 3) of the outer edges, no farther than ``y_max``, z = 0."""
        left, right, bottom, top = self.extent()
        end = min(top, y_max)
        return np.array(
            [
                (left, bottom, 0.0),
                (left, end, 0.0),
                (right, bottom, 0.0),
                (right, end, 0.0),
            ]
        )


def _centres(first: float, spacing: float, count: int) -> FloatArray:
    """Return pixel centres, rounded to a nanometre so that tables do not end in 0000000000002."""
    return floats(np.round(first + spacing * np.arange(count), 9))
