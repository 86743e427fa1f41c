"""Anchors without surveyed points: the lane begins at a track's first fix and runs along it."""

from __future__ import annotations

import math

import numpy as np

from flgpr.geo.anchor import Anchor, anchor_at
from flgpr.model.bounds import LARGEST
from flgpr.model.frames import steps_of
from flgpr.model.motion import judge_poses
from flgpr.model.plausible import MotionLimits
from flgpr.types import ArrayLike, BoolArray, FloatArray, floats

_LEAST_JUDGED = 5  # fixes, to tell one that lies astray
_ASIDE = 3  # times the usual step, and
_LEAST_ASIDE = 0.5  # m, by which a fix between others lies astray
_END_ASIDE = 20  # times the usual step, of the first and the last, which may follow a gap
_LEAST_REACH = 0.5  # distance that a track must reach from its first fix to have a direction, m


def anchor_from_fixes(
    fixes: ArrayLike, number: ArrayLike | None = None
) -> tuple[Anchor, list[str]]:
    """Tie a lane to a satellite receiver's own track.

    The lane's origin is the first plausible fix, its +y points to the fix that is farthest from it,
    along the course of a straight line or drive. The uncertainty is not known, because nothing but
    the receiver's fixes says where the lane lies.

    Parameters
    ----------
    fixes : (fix, 3) array_like
        Longitude and latitude (degrees, WGS 84) and ellipsoidal height (m); what is not finite is
        left out.
    number : (fix,) array_like, optional
        Numbers of the traces or scans that the fixes belong to, ascending; by default from 0 on.

    Returns
    -------
    anchor, notes
        The anchor, whose uncertainty is NaN, and sentences that say what it was made of.

    Raises
    ------
    ValueError
        If fewer than two fixes are plausible, or none lies half a metre from the first.
    """
    points = floats(fixes).reshape(-1, 3)
    is_finite = np.isfinite(points).all(axis=1) & (np.abs(points[:, 1]) < 89.9)
    finite = points[is_finite]
    if len(finite) < 2:
        raise ValueError(
            "an anchor from the track needs two finite fixes or more, "
            f"got {len(finite)} of {len(points)}"
        )
    numbers: FloatArray = np.arange(len(points), dtype=np.float64)
    if number is not None:
        numbers = floats(number).round()
    # The median, unlike the first fix, is not moved by a fix that is far off.
    plane = anchor_at(_median_position(finite), 0.0)
    local = plane.from_geodetic(finite)
    pose = np.concatenate([local, np.zeros_like(local)], axis=1)
    limits = MotionLimits(scans=int(LARGEST))  # any number of traces may lie between two fixes
    motion = judge_poses(pose, None, limits, numbers[is_finite])

    is_used = motion.plausible.copy()
    is_used[is_used] = ~is_astray(local[is_used])
    plausible = finite[is_used]
    plausible_local = local[is_used]
    offset = plausible_local - plausible_local[0]
    distance = np.hypot(offset[:, 0], offset[:, 1])
    farthest = int(distance.argmax())
    if distance[farthest] < _LEAST_REACH:
        raise ValueError(
            f"an anchor from the track needs one that goes {_LEAST_REACH:g} m away from its first "
            f"fix, got {distance.max():.3g} m"
        )
    origin = plausible[0]
    start = anchor_at((float(origin[0]), float(origin[1]), float(origin[2])), 0.0)
    east, north, _ = start.from_geodetic(plausible[farthest])
    azimuth = math.atan2(east, north)
    degrees = round(math.degrees(azimuth), 2) % 360.0
    notes = [
        f"the lane follows from the track: its origin is the first fix, {origin[1]:.7f} N "
        f"{origin[0]:.7f} E, its +y points {degrees:.2f}° from north to the fix farthest from it, "
        f"{distance[farthest]:.4g} m away; how well that is known the track does not tell"
    ]
    left_out = len(points) - len(plausible)
    if left_out:
        notes.append(
            f"{left_out} of {len(points)} fixes are not plausible and do not enter the lane's place"
        )
    return anchor_at(start.origin, azimuth), notes


def is_astray(position: FloatArray) -> BoolArray:
    """Return which positions lie aside of a way that goes on behind them.

    One digit that a disk or a line changed is within what a vehicle reaches; it is told by steps
    there and back that are far longer than the others, and than the way past it.

    Parameters
    ----------
    position : (fix, 3) ndarray
        Positions in their order, m.

    Returns
    -------
    (fix,) ndarray of bool
        Whether each lies astray.
    """
    place = position[:, :2]
    astray = np.zeros(len(place), bool)
    if len(place) < _LEAST_JUDGED:
        return astray
    step = steps_of(place)
    past = np.hypot(*(place[2:] - place[:-2]).T)
    usual = float(np.median(step))
    least = np.minimum(step[:-1], step[1:])
    astray[1:-1] = (least > _ASIDE * usual + _LEAST_ASIDE) & (least > 2 * past)
    ends = np.array([step[0], step[-1]])
    astray[[0, -1]] = (ends > _END_ASIDE * usual + _LEAST_ASIDE) & ~astray[[1, -2]]
    return astray


def _median_position(points: FloatArray) -> tuple[float, float, float]:
    """Return the median longitude, latitude and height.

    Longitudes are taken within half a turn of the first, so that the date line does no harm.
    """
    first = points[0, 0]
    longitude = first + (points[:, 0] - first + 180.0) % 360.0 - 180.0
    latitude = points[:, 1]
    height = points[:, 2]
    return float(np.median(longitude)), float(np.median(latitude)), float(np.median(height))
