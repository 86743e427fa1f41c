"""Where the vehicle was, as a mapping describes it: poses per scan, or a track on another clock."""

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
    """Read the poses that the table ``pose`` of a mapping stands for.

    Parameters
    ----------
    sources : Sources
        The files of the mapping.
    spec : Poses
        The table.
    scans : int
        Number of scans.
    anchor : Anchor or None
        Takes longitude and latitude to the lane.

    Returns
    -------
    (scan, 6) ndarray
        Poses, m and rad.

    Raises
    ------
    ValueError
        If a pose is not finite, or an entry does not fit the files or the scans.
    """
    position = spec.position
    if position is None and spec.geodetic is None:
        position = Positions(
            file=spec.file,
            x=spec.x,
            y=spec.y,
            z=spec.z,
            unit=str(spec.unit),
        )
    pose = _poses_in_files(sources, spec, position, "pose", scans, "scan", anchor)
    with sources.entry("pose", _file_of(position, spec.geodetic)):
        bad = np.argwhere(~np.isfinite(pose))
        if len(bad):
            scan, column = bad[0]
            raise ValueError(
                f"pose.{POSE_COMPONENTS[column]} must be finite, "
                f"got {pose[scan, column]} for scan {scan}"
            )
        if spec.heading == "course":
            pose[:, 3] = course(pose[:, :3])
    return pose


def read_track_table(sources: Sources, spec: TrackTable, anchor: Anchor | None) -> pd.DataFrame:
    """Read the track that the table ``track`` of a mapping stands for.

    Parameters
    ----------
    sources : Sources
        The files of the mapping; fixes left out because they are not finite are counted in its
        notes.
    spec : TrackTable
        The table.
    anchor : Anchor or None
        Takes longitude and latitude to the lane.

    Returns
    -------
    pandas.DataFrame
        The track of the array's reference point (:func:`flgpr.model.track.make_track`).

    Raises
    ------
    ValueError
        If an entry does not fit the files, or times do not increase.
    """
    time = sources.vector(spec.time, "time", "track.time", "fix")
    pose = _poses_in_files(sources, spec, spec.position, "track", time.size, "fix", anchor)
    with sources.entry("track", _file_of(spec.position, spec.geodetic)):
        keep, notes = bridged(time, pose)
        sources.notes += notes
        time = time[keep]
        pose = pose[keep]
        if spec.heading == "course":
            pose[:, 3] = course(pose[:, :3])
        antenna = make_track(time, pose[:, :3], *pose[:, 3:].T)
        return reference_track(antenna, spec.lever_arm, spec.latency)


def _file_of(position: Positions | None, geodetic: Geodetic | None) -> str | None:
    """Return the name of the file that holds the positions."""
    if position is not None:
        return position.file
    return geodetic.file if geodetic is not None else None


def _poses_in_files(
    sources: Sources,
    spec: Poses | TrackTable,
    position: Positions | None,
    where: str,
    count: int,
    along: str,
    anchor: Anchor | None,
) -> FloatArray:
    """Return poses (count, 6) as they stand in the files, in lane axes.

    A heading by the course is left zero.
    """
    pose = np.zeros((count, 6))
    turn = axes_matrix(spec.axes, f"{where}.axes")
    if position is not None:
        points = _points(sources, spec, position, where, count, along)
        pose[:, :3] = points[:, :3] @ turn.T
        if points.shape[1] == 6:
            pose[:, 3:] = points[:, 3:] * factor(spec.angle_unit, "angle", f"{where}.angle_unit")

    if spec.orientation is not None:
        pose[:, 3:] = _attitude(
            sources, spec.orientation, spec.axes, f"{where}.orientation", count, along
        )
    _read_angles(sources, spec, position, where, along, pose)

    if spec.geodetic is not None:
        entry = f"{where}.geodetic"
        if anchor is None and not sources.anchor_from_track:
            raise ValueError(
                f"{entry} needs an anchor, which tells where the lane lies on the Earth"
            )
        fixes = _geodetic(sources, spec.geodetic, entry, count, along)
        if anchor is None:
            with sources.entry(entry, spec.geodetic.file):
                anchor, notes = anchor_from_fixes(fixes)
            sources.anchor = anchor
            sources.notes += notes
        pose[:, :3] = _in_the_lane(fixes, spec.geodetic, entry, anchor)
        # Headings of a geodetic table are clockwise from true north.
        heading_in_lane = pose[:, 3] - anchor.azimuth
        pose[:, 3] = np.angle(np.exp(1j * heading_in_lane))
    return pose


def _points(
    sources: Sources,
    spec: Poses | TrackTable,
    position: Positions,
    where: str,
    count: int,
    along: str,
) -> FloatArray:
    """Return positions (count, 3), m, or with angles in the unit of the file (count, 6)."""
    in_own_columns = isinstance(spec, Poses) and spec.position is None
    entry = where if in_own_columns else f"{where}.position"
    points = sources.points(position, entry, along, count)
    has_angles = points.shape[1] == 6
    needs_angles = spec.orientation is None and spec.heading is None
    with sources.entry(f"{where}.position", position.file):
        if has_angles != needs_angles:
            raise ValueError(
                f"{where}.position must have six columns if heading, pitch and roll are not given "
                f"beside it, and three if they are, got {points.shape[1]}"
            )
    return points


def _read_angles(
    sources: Sources,
    spec: Poses | TrackTable,
    position: Positions | None,
    where: str,
    along: str,
    pose: FloatArray,
) -> None:
    """Write the entries heading, pitch and roll into poses (count, 6), rad."""
    if isinstance(spec, Poses):
        file = spec.file
    elif position is not None:
        file = position.file
    else:
        file = "data"
    for column, name in enumerate(("heading", "pitch", "roll"), start=3):
        entry = getattr(spec, name)
        if entry is None or entry == "course":
            continue
        scale = factor(spec.angle_unit, "angle", f"{where}.angle_unit")
        angle = sources.component(entry, file, f"{where}.{name}", len(pose), along)
        pose[:, column] = scale * angle


def _attitude(
    sources: Sources,
    spec: Orientation,
    axes: tuple[str, str, str],
    where: str,
    count: int,
    along: str,
) -> FloatArray:
    """Return heading, pitch and roll (count, 3), rad, of the rotations in the files."""
    with sources.entry(where, spec.file):
        if spec.variable is not None:
            blocks = sources.arrays(spec.file, spec.variable, where)
            rotations = real(sources.assembled(blocks, along, where), where)
            if rotations.ndim > 1:
                rotations = rotations.reshape(-1, rotations.shape[-1])
            else:
                rotations = rotations[None]
        else:
            components = []
            for name in "xyzw":
                entry = getattr(spec, name)
                components.append(
                    sources.component(entry, spec.file, f"{where}.{name}", count, along)
                )
            rotations = np.stack(components, axis=1)
        if len(rotations) != count:
            raise ValueError(f"{where} must have {count} rotations, got {len(rotations)}")
        if spec.euler is not None:
            rotations = rotations * factor(spec.unit, "angle", f"{where}.unit")
        return attitude_of(rotations, axes, spec.body, spec.euler, where)


def _geodetic(sources: Sources, spec: Geodetic, where: str, count: int, along: str) -> FloatArray:
    """Return longitude and latitude, degrees, and height, m, (count, 3), as in the files."""
    degrees = np.degrees(factor(spec.angle_unit, "angle", f"{where}.angle_unit"))
    scale = factor(spec.unit, "length", f"{where}.unit")
    columns = []
    for name in ("longitude", "latitude", "height"):
        entry = getattr(spec, name)
        columns.append(sources.component(entry, spec.file, f"{where}.{name}", count, along))
    longitude, latitude, height = columns
    with sources.entry(where, spec.file):
        known = np.isfinite(longitude) & np.isfinite(latitude)
        longitude = longitude * degrees
        latitude = latitude * degrees
        too_far_north = (np.abs(latitude[known]) > 90).any()
        too_far_east = (np.abs(longitude[known]) > 360).any()
        if too_far_north or too_far_east:
            raise ValueError(
                f"{where} must have latitudes within 90 and longitudes within 360 degrees"
            )
    return np.stack([longitude, latitude, height * scale], axis=1)


def _in_the_lane(fixes: FloatArray, spec: Geodetic, where: str, anchor: Anchor) -> FloatArray:
    """Return fixes (count, 3) in the lane.

    Where the anchor has no heights, a height is a number, and one over the ground.
    """
    if not anchor.heights_known and not isinstance(spec.height, float):
        raise ValueError(
            f"{where}.height must be a number, the height over the ground: "
            "the anchor's points have none"
        )
    known = np.isfinite(fixes[:, :2]).all(axis=1)
    position = np.full(fixes.shape, np.nan)
    if known.any():
        position[known] = anchor.from_geodetic(fixes[known])
    if not anchor.heights_known:
        position[:, 2] = fixes[:, 2]
    return position
