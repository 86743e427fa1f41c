"""Where the vehicle was, as a mapping tells: poses per scan, or a track on a clock of its own."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from flgpr.formats.axes import attitude_of, axes_matrix
from flgpr.formats.mapping import Geodetic, Orientation, Poses, Positions, TrackTable, factor
from flgpr.formats.sources import FloatArray, Sources, real
from flgpr.geo.track_anchor import anchor_from_fixes
from flgpr.model import POSE_COMPONENTS
from flgpr.model.track import bridged, course, make_track, reference_track

if TYPE_CHECKING:
    from flgpr.geo.anchor import Anchor


def read_poses(sources: Sources, spec: Poses, scans: int, anchor: Anchor | None) -> FloatArray:
    """Poses (scan, 6) that the table ``pose`` stands for, m and rad; each must be finite."""
    place = spec.position
    if place is None and spec.geodetic is None:
        place = Positions(file=spec.file, x=spec.x, y=spec.y, z=spec.z, unit=str(spec.unit))
    pose = _way(sources, spec, place, "pose", scans, "scan", anchor)
    file = (
        place.file
        if place is not None
        else spec.geodetic.file
        if spec.geodetic is not None
        else None
    )
    with sources.entry("pose", file):
        bad = np.argwhere(~np.isfinite(pose))
        if len(bad):
            scan, column = bad[0]
            raise ValueError(
                f"pose.{POSE_COMPONENTS[column]} must be finite, got {pose[scan, column]} for scan {scan}"
            )
        if spec.heading == "course":
            pose[:, 3] = course(pose[:, :3])
    return pose


def read_way(sources: Sources, spec: TrackTable, anchor: Anchor | None) -> pd.DataFrame:
    """Track that the table ``track`` stands for, of the array's reference point; fixes not finite are left out."""
    time = sources.vector(spec.time, "time", "track.time", "fix")
    pose = _way(sources, spec, spec.position, "track", time.size, "fix", anchor)
    file = (
        spec.position.file
        if spec.position is not None
        else spec.geodetic.file
        if spec.geodetic
        else None
    )
    with sources.entry("track", file):
        keep, notes = bridged(time, pose)
        sources.notes += notes
        time = time[keep]
        pose = pose[keep]
        if spec.heading == "course":
            pose[:, 3] = course(pose[:, :3])
        return reference_track(
            make_track(time, pose[:, :3], *pose[:, 3:].T), spec.lever_arm, spec.latency
        )


def _way(
    sources: Sources, spec: Poses | TrackTable, place: Positions | None, where: str, count: int, along: str,
    anchor: Anchor | None,
) -> FloatArray:  # fmt: skip
    """Poses (count, 6) as they stand in the files, in lane axes; a heading along the way is left zero."""
    turn = axes_matrix(spec.axes, f"{where}.axes")
    pose = np.zeros((count, 6))
    angles = pose[:, 3:]
    if place is not None:
        points = sources.points(place, where if isinstance(spec, Poses) and spec.position is None else
                                f"{where}.position", along, count)  # fmt: skip
        pose[:, :3] = points[:, :3] @ turn.T
        six = points.shape[1] == 6
        with sources.entry(f"{where}.position", place.file):
            if six != (spec.orientation is None and spec.heading is None):
                raise ValueError(
                    f"{where}.position must have six columns if heading, pitch and roll are not given beside it, and "
                    f"three if they are, got {points.shape[1]}"
                )
        if six:
            angles[:] = points[:, 3:] * factor(spec.angle_unit, "angle", f"{where}.angle_unit")
    if spec.orientation is not None:
        angles[:] = _attitude(
            sources, spec.orientation, spec.axes, f"{where}.orientation", count, along
        )
    for column, name in enumerate(("heading", "pitch", "roll")):
        entry = getattr(spec, name)
        if entry is not None and entry != "course":
            file = (
                spec.file
                if isinstance(spec, Poses)
                else place.file
                if place is not None
                else "data"
            )
            scale = factor(spec.angle_unit, "angle", f"{where}.angle_unit")
            angles[:, column] = scale * sources.component(
                entry, file, f"{where}.{name}", count, along
            )
    if spec.geodetic is not None:
        if anchor is None and not sources.anchor_from_track:
            raise ValueError(
                f"{where}.geodetic needs an anchor, which tells where the lane lies on the Earth"
            )
        fixes = _geodetic(sources, spec.geodetic, f"{where}.geodetic", count, along)
        if anchor is None:
            with sources.entry(f"{where}.geodetic", spec.geodetic.file):
                anchor, notes = anchor_from_fixes(fixes)
            sources.anchor = anchor
            sources.notes += notes
        pose[:, :3] = _in_the_lane(fixes, spec.geodetic, f"{where}.geodetic", anchor)
        pose[:, 3] = np.angle(np.exp(1j * (pose[:, 3] - anchor.azimuth)))
    return pose


def _attitude(
    sources: Sources,
    spec: Orientation,
    axes: tuple[str, str, str],
    where: str,
    count: int,
    along: str,
) -> FloatArray:
    with sources.entry(where, spec.file):
        if spec.variable is not None:
            parts = real(
                sources.assembled(sources.arrays(spec.file, spec.variable, where), along, where),
                where,
            )
            parts = parts.reshape(-1, parts.shape[-1]) if parts.ndim > 1 else parts[None]
        else:
            names = [(name, getattr(spec, name)) for name in "xyzw"]
            parts = np.stack(
                [
                    sources.component(part, spec.file, f"{where}.{name}", count, along)
                    for name, part in names
                ],
                axis=1,
            )
        if len(parts) != count:
            raise ValueError(f"{where} must have {count} rotations, got {len(parts)}")
        if spec.euler is not None:
            parts = parts * factor(spec.unit, "angle", f"{where}.unit")
        return attitude_of(parts, axes, spec.body, spec.euler, where)


def _geodetic(sources: Sources, spec: Geodetic, where: str, count: int, along: str) -> FloatArray:
    """Return longitude and latitude, degrees, and height, m, (count, 3), as they stand in the files."""
    degrees = np.degrees(factor(spec.angle_unit, "angle", f"{where}.angle_unit"))
    scale = factor(spec.unit, "length", f"{where}.unit")
    longitude, latitude, height = (
        sources.component(getattr(spec, name), spec.file, f"{where}.{name}", count, along)
        for name in ("longitude", "latitude", "height")
    )
    with sources.entry(where, spec.file):
        known = np.isfinite(longitude) & np.isfinite(latitude)
        if (np.abs(latitude[known] * degrees) > 90).any() or (
            np.abs(longitude[known] * degrees) > 360
        ).any():
            raise ValueError(
                f"{where} must have latitudes within 90 and longitudes within 360 degrees"
            )
    return np.stack([longitude * degrees, latitude * degrees, height * scale], axis=1)


def _in_the_lane(fixes: FloatArray, spec: Geodetic, where: str, anchor: Anchor) -> FloatArray:
    """Take fixes (count, 3) to the lane; a height alone is one over the ground where the anchor has no heights."""
    if not anchor.heights_known and not isinstance(spec.height, float):
        raise ValueError(
            f"{where}.height must be a number, the height over the ground: the anchor's points have none"
        )
    known = np.isfinite(fixes[:, :2]).all(axis=1)
    place = np.full(fixes.shape, np.nan)
    if known.any():
        place[known] = anchor.from_geodetic(fixes[known])
    if not anchor.heights_known:
        place[:, 2] = fixes[:, 2]
    return place
