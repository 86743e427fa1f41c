"""The ground a false alarm can stand on: lane area less the exact area of the union of halos."""

from __future__ import annotations

import math

import numpy as np
from scipy.spatial import cKDTree

from flgpr.model import Lane
from flgpr.types import ArrayLike, FloatArray, IntArray, floats

Intervals = tuple[IntArray, FloatArray, FloatArray]
_TURN = 2 * math.pi


def union_area(centre: ArrayLike, radius: float, lane: Lane) -> float:
    """Compute the area of the part of a lane that equal discs cover.

    The border of the covered region consists of circle arcs that no other disc covers and of
    stretches of the lane's border inside a disc. Both are found in closed form as complements and
    unions of intervals (angles on a circle, lengths on a border), and Green's theorem, A = ½∮(x dy
    - y dx), sums them. Nothing is sampled.

    Parameters
    ----------
    centre : (disc, 2) array_like
        Centres of the discs, m; there may be none.
    radius : float
        Radius of the discs, m.
    lane : Lane
        The lane.

    Returns
    -------
    float
        The covered area, m².

    Raises
    ------
    ValueError
        If the radius is not positive, or the centres are not finite or of another shape.

    Examples
    --------
    Two halos of 1 m that overlap, and one at the border, half outside:

    >>> from flgpr.model import Lane
    >>> from flgpr.scoring import union_area
    >>> lane = Lane(-2.0, 2.0, 0.0, 60.0)
    >>> round(union_area([[0, 10], [0, 11]], 1.0, lane), 3)
    5.055
    >>> round(union_area([[2, 30]], 1.0, lane), 3)
    1.571
    """
    points = floats(centre)
    if points.size == 0:
        points = points.reshape(-1, 2)
    if points.ndim != 2 or points.shape[1] != 2 or not np.isfinite(points).all():
        raise ValueError(
            f"centre must be finite positions of shape (disc, 2), got shape {points.shape}"
        )
    if not (math.isfinite(radius) and radius > 0):
        raise ValueError(f"radius must be positive and finite, got {radius}")
    origin = np.array([(lane.x_min + lane.x_max) / 2, (lane.y_min + lane.y_max) / 2])
    half = np.array([lane.x_max - lane.x_min, lane.y_max - lane.y_min]) / 2
    points = np.unique(points - origin, axis=0)
    points = points[(np.abs(points) < half + radius).all(axis=1)]
    if len(points) == 0:
        return 0.0
    covered = _arc_sum(points, radius, half) + _border_sum(points, radius, half)
    return float(np.clip(covered, 0.0, lane.area))


def _arc_sum(points: FloatArray, radius: float, half: FloatArray) -> float:
    """Sum Green's integral over the arcs that lie in the lane and in no other disc."""
    circle, start, end = _hidden_angles(points, radius, half)
    before_zero = start < 0
    past_turn = end > _TURN
    full_turn = np.full(before_zero.sum(), _TURN)
    no_turn = np.zeros(past_turn.sum())
    every_circle = np.arange(len(points))
    zeros = np.zeros(len(points))
    turns = np.full(len(points), _TURN)
    # An interval across the angle 0 is cut in two. Empty intervals at 0 and at a full turn close
    # the gap before the first hidden interval of a circle and after its last.
    intervals = [
        (circle, np.maximum(start, 0), np.minimum(end, _TURN)),
        (circle[before_zero], start[before_zero] + _TURN, full_turn),
        (circle[past_turn], no_turn, end[past_turn] - _TURN),
        (every_circle, zeros, zeros),
        (every_circle, turns, turns),
    ]
    circles, starts, ends = (np.concatenate(column) for column in zip(*intervals, strict=True))
    visible, first, last = _gaps(circles, starts, ends)

    # On a circle x = a + r·cos φ and y = b + r·sin φ:
    # x dy - y dx = r·(r + a·cos φ + b·sin φ) dφ
    x, y = points[visible].T
    arcs = (
        radius * (last - first)
        + x * (np.sin(last) - np.sin(first))
        - y * (np.cos(last) - np.cos(first))
    )
    return float(0.5 * radius * arcs.sum())


def _hidden_angles(points: FloatArray, radius: float, half: FloatArray) -> Intervals:
    """Find the intervals of angles of each circle that lie in another disc or outside the lane.

    Their middles lie in [0, 2π).
    """
    # Another disc at the distance d hides angles up to arccos(d/2r) from its direction.
    pairs = cKDTree(points).query_pairs(2 * radius, output_type="ndarray")
    pairs = np.concatenate([pairs, pairs[:, ::-1]])
    step = points[pairs[:, 1]] - points[pairs[:, 0]]
    cosine = np.hypot(*step.T) / (2 * radius)
    middle = [np.arctan2(step[:, 1], step[:, 0])]
    width = [np.arccos(np.clip(cosine, 0, 1))]
    circle = [pairs[:, 0]]

    # The four borders of the lane: axis, side, and the angle of their outward normal.
    borders = (
        (0, 1, 0.0),
        (1, 1, math.pi / 2),
        (0, -1, math.pi),
        (1, -1, 3 * math.pi / 2),
    )
    for axis, sign, angle in borders:
        reach = (half[axis] - sign * points[:, axis]) / radius
        cut = np.flatnonzero(reach < 1)
        circle.append(cut)
        middle.append(np.full(len(cut), angle))
        width.append(np.arccos(np.clip(reach[cut], -1, 1)))
    centre = np.mod(np.concatenate(middle), _TURN)
    half_width = np.concatenate(width)
    return np.concatenate(circle), centre - half_width, centre + half_width


def _gaps(group: IntArray, start: FloatArray, end: FloatArray) -> Intervals:
    """Find what no interval of a group covers between the group's first start and last end."""
    order = np.lexsort((start, group))
    group = group[order]
    start = start[order]
    end = end[order]
    # The running maximum of each group by ranks, which those of another group cannot reach.
    ends, rank = np.unique(end, return_inverse=True)
    reach = ends[np.maximum.accumulate(group * len(end) + rank) - group * len(end)]
    before_gap = np.flatnonzero((group[1:] == group[:-1]) & (start[1:] > reach[:-1]))
    return group[before_gap], reach[before_gap], start[before_gap + 1]


def _border_sum(points: FloatArray, radius: float, half: FloatArray) -> float:
    """Sum Green's integral over the stretches of the lane's border that lie in a disc."""
    total = 0.0
    for axis in (0, 1):
        for sign in (-1, 1):
            off = sign * half[axis] - points[:, axis]  # from the centres to this border
            is_cut = np.abs(off) < radius
            chord = np.sqrt(radius**2 - off[is_cut] ** 2)
            along = points[is_cut, 1 - axis]
            low = np.maximum(along - chord, -half[1 - axis])
            high = np.minimum(along + chord, half[1 - axis])
            in_lane = high > low
            total += 0.5 * half[axis] * _union_length(low[in_lane], high[in_lane])
    return total


def _union_length(low: FloatArray, high: FloatArray) -> float:
    """Compute the length of the union of intervals."""
    if len(low) == 0:
        return 0.0
    group = np.zeros(len(low), dtype=np.int64)
    _, first, last = _gaps(group, low, high)
    return float(high.max() - low.min() - (last - first).sum())
