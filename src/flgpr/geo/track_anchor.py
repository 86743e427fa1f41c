"""An anchor without surveyed points: the lane begins at a track's first fix and runs along the track."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flgpr.geo.anchor import GEODETIC, Anchor
from flgpr.model.bounds import LARGEST
from flgpr.model.motion import judge_poses
from flgpr.model.plausible import MotionLimits

FloatArray = NDArray[np.float64]
_LEAST = 0.5  # m that a track must reach from its first fix, to have a direction


def anchor_from_fixes(
    fixes: ArrayLike, number: ArrayLike | None = None
) -> tuple[Anchor, list[str]]:
    """Tie a lane to a satellite receiver's own track.

    The lane's origin is the first plausible fix, its +y points to the fix that is farthest from it,
    along the course of a straight line or drive. How well that ties the lane is not known: the
    receiver's fixes are all there is.

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
        The anchor, whose uncertainty is NaN, and what it was made of, in words.

    Raises
    ------
    ValueError
        If fewer than two fixes are plausible, or none lies half a metre from the first.
    """
    points = np.asarray(fixes, dtype=np.float64).reshape(-1, 3)
    finite = np.isfinite(points).all(axis=1) & (np.abs(points[:, 1]) < 89.9)
    known = points[finite]
    if len(known) < 2:
        raise ValueError(
            f"an anchor from the track needs two finite fixes or more, got {len(known)} of {len(points)}"
        )
    numbers = (
        np.arange(len(points)) if number is None else np.round(np.asarray(number, dtype=np.float64))
    )
    middle = _anchor_at(_middle(known), 0.0)
    local = middle.from_geodetic(known)
    pose = np.concatenate([local, np.zeros_like(local)], axis=1)
    limits = MotionLimits(scans=int(LARGEST))  # fixes may be as many traces apart as they like
    motion = judge_poses(pose, None, limits, numbers[finite])
    trusted = local[motion.plausible]
    away = np.hypot(*(trusted - trusted[0])[:, :2].T)
    farthest = int(away.argmax())
    if away[farthest] < _LEAST:
        raise ValueError(
            f"an anchor from the track needs one that goes {_LEAST:g} m away from its first fix, got {away.max():.3g} m"
        )
    origin = known[motion.plausible][0]
    start = _anchor_at((float(origin[0]), float(origin[1]), float(origin[2])), 0.0)
    east, north, _ = start.from_geodetic(known[motion.plausible][farthest])
    azimuth = math.atan2(east, north)
    degrees = round(math.degrees(azimuth), 2) % 360.0
    left_out = len(points) - len(trusted)
    notes = [
        f"the lane follows from the track: its origin is the first fix, {origin[1]:.7f} N {origin[0]:.7f} E, its +y "
        f"points {degrees:.2f}° from north to the fix farthest from it, {away[farthest]:.4g} m "
        "away; how well that is known the track does not tell"
    ]
    if left_out:
        notes.append(
            f"{left_out} of {len(points)} fixes are not plausible and do not enter the lane's place"
        )
    return _anchor_at(start.origin, azimuth), notes


def _middle(points: FloatArray) -> tuple[float, float, float]:
    """Return the median place; longitudes are taken around the first so that the date line does no harm."""
    around = points[0, 0] + (points[:, 0] - points[0, 0] + 180.0) % 360.0 - 180.0
    return float(np.median(around)), float(np.median(points[:, 1])), float(np.median(points[:, 2]))


def _anchor_at(origin: tuple[float, float, float], azimuth: float) -> Anchor:
    return Anchor(
        origin=origin,
        azimuth=azimuth,
        shift=(0.0, 0.0, 0.0),
        center=(0.0, 0.0),
        sigma=math.nan,
        count=1,
        spread=math.inf,
        sigma_azimuth=math.nan,
        residuals=(),
        crs=GEODETIC,
        crs_accuracy=math.nan,
        heights_known=True,
    )
