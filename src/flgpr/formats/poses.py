"""Where the vehicle was, as a mapping describes it: poses per scan, or a track on another clock."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from flgpr.formats.axes import attitude_of, axes_matrix
from flgpr.formats.mapping import (
    EntryValue,
    Geodetic,
    Orientation,
    Poses,
    Positions,
    TrackTable,
    factor,
)
from flgpr.formats.sources import Sources
from flgpr.geo.track_anchor import anchor_from_fixes
from flgpr.model import POSE_COMPONENTS
from flgpr.model.frames import wrapped
from flgpr.model.track import bridged, course, make_track, reference_track
from flgpr.types import FloatArray

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
        unit = str(spec.unit)
        position = Positions(file=spec.file, x=spec.x, y=spec.y, z=spec.z, unit=unit)
    reader = _PlaceReader(sources, spec, position, "pose", scans, "scan")
    pose = reader.poses(anchor)
    with sources.entry("pose", reader.file):
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
    reader = _PlaceReader(sources, spec, spec.position, "track", time.size, "fix")
    pose = reader.poses(anchor)
    with sources.entry("track", reader.file):
        keep, notes = bridged(time, pose)
        sources.notes += notes
        pose = pose[keep]
        if spec.heading == "course":
            pose[:, 3] = course(pose[:, :3])
        antenna = make_track(time[keep], pose[:, :3], *pose[:, 3:].T)
        return reference_track(antenna, spec.lever_arm, spec.latency)


@dataclass(frozen=True)
class _PlaceReader:
    """Reads where the vehicle was, as a table of a mapping tells it for every scan or fix."""

    sources: Sources
    spec: Poses | TrackTable
    position: Positions | None  # its entry, or what stands for it
    where: str  # name of the table in an error
    count: int  # of scans or fixes
    along: str  # "scan" or "fix"

    @property
    def file(self) -> str | None:
        """Name of the file that holds the positions."""
        holder = self.position or self.spec.geodetic
        return None if holder is None else holder.file

    def poses(self, anchor: Anchor | None) -> FloatArray:
        """Return poses (count, 6) as they stand in the files, in lane axes.

        A heading by the course is left zero.
        """
        spec = self.spec
        pose = np.zeros((self.count, 6))
        turn = axes_matrix(spec.axes, f"{self.where}.axes")
        if self.position is not None:
            points = self._points(self.position)
            pose[:, :3] = points[:, :3] @ turn.T
            if points.shape[1] == 6:
                pose[:, 3:] = points[:, 3:] * self._angle_scale()
        if spec.orientation is not None:
            pose[:, 3:] = self._attitude(spec.orientation)
        holder = spec if isinstance(spec, Poses) else self.position
        file = "data" if holder is None else holder.file
        for column, name in enumerate(POSE_COMPONENTS[3:], start=3):
            angle = getattr(spec, name)
            if angle is not None and angle != "course":
                values = self._component(angle, file, f"{self.where}.{name}")
                pose[:, column] = self._angle_scale() * values

        if spec.geodetic is not None:
            entry = f"{self.where}.geodetic"
            if anchor is None and not self.sources.anchor_from_track:
                raise ValueError(
                    f"{entry} needs an anchor, which tells where the lane lies on the Earth"
                )
            fixes = self._fixes(spec.geodetic, entry)
            if anchor is None:
                with self.sources.entry(entry, spec.geodetic.file):
                    anchor, notes = anchor_from_fixes(fixes)
                self.sources.anchor = anchor
                self.sources.notes += notes
            pose[:, :3] = _in_the_lane(fixes, spec.geodetic, entry, anchor)
            # Headings of a geodetic table are clockwise from true north.
            pose[:, 3] = wrapped(pose[:, 3] - anchor.azimuth)
        return pose

    def _component(self, entry: EntryValue, file: str, where: str) -> FloatArray:
        """Return the values (count,) of an entry."""
        return self.sources.component(entry, file, where, self.count, self.along)

    def _angle_scale(self) -> float:
        """Return the factor from the angles of the files to radians."""
        return factor(self.spec.angle_unit, "angle", f"{self.where}.angle_unit")

    def _points(self, position: Positions) -> FloatArray:
        """Return positions (count, 3), m, or with angles in the unit of the file (count, 6)."""
        spec = self.spec
        in_own_columns = isinstance(spec, Poses) and spec.position is None
        entry = self.where if in_own_columns else f"{self.where}.position"
        points = self.sources.points(position, entry, self.along, self.count)
        has_angles = points.shape[1] == 6
        needs_angles = spec.orientation is None and spec.heading is None
        with self.sources.entry(f"{self.where}.position", position.file):
            if has_angles != needs_angles:
                raise ValueError(
                    f"{self.where}.position must have six columns if heading, pitch and roll are "
                    f"not given beside it, and three if they are, got {points.shape[1]}"
                )
        return points

    def _attitude(self, spec: Orientation) -> FloatArray:
        """Return heading, pitch and roll (count, 3), rad, of the rotations in the files."""
        where = f"{self.where}.orientation"
        with self.sources.entry(where, spec.file):
            if spec.variable is not None:
                blocks = self.sources.arrays(spec.file, spec.variable, where)
                rotations = self.sources.assembled(blocks, self.along, where)
                rotations = rotations.reshape(-1, rotations.shape[-1])
            else:
                components = [
                    self._component(getattr(spec, name), spec.file, f"{where}.{name}")
                    for name in "xyzw"
                ]
                rotations = np.stack(components, axis=1)
            if len(rotations) != self.count:
                raise ValueError(f"{where} must have {self.count} rotations, got {len(rotations)}")
            if spec.euler is not None:
                rotations = rotations * factor(spec.unit, "angle", f"{where}.unit")
            return attitude_of(rotations, self.spec.axes, spec.body, spec.euler, where)

    def _fixes(self, spec: Geodetic, where: str) -> FloatArray:
        """Return longitude and latitude, degrees, and height, m, (count, 3), as in the files."""
        degrees = np.degrees(factor(spec.angle_unit, "angle", f"{where}.angle_unit"))
        scale = factor(spec.unit, "length", f"{where}.unit")
        columns = []
        for name in ("longitude", "latitude", "height"):
            entry = getattr(spec, name)
            entry = 0.0 if entry is None else entry  # above_ground is told in its place
            columns.append(self._component(entry, spec.file, f"{where}.{name}"))
        fixes = np.stack(columns, axis=1) * (degrees, degrees, scale)
        with self.sources.entry(where, spec.file):
            if (np.abs(fixes[np.isfinite(fixes[:, :2]).all(axis=1), :2]) > (360, 90)).any():
                raise ValueError(
                    f"{where} must have latitudes within 90 and longitudes within 360 degrees"
                )
        return fixes


def _in_the_lane(fixes: FloatArray, spec: Geodetic, where: str, anchor: Anchor) -> FloatArray:
    """Return fixes (count, 3) in the lane.

    Where the anchor has no heights, a height is a number, and one over the ground.
    """
    if spec.above_ground is not None:
        fixes = fixes.copy()
        fixes[:, 2] = spec.above_ground * factor(spec.unit, "length", f"{where}.unit")
    elif not anchor.heights_known and not isinstance(spec.height, float):
        raise ValueError(
            f"{where}.height must be a number, the height over the ground, or above_ground given: "
            "the anchor's points have none"
        )
    known = np.isfinite(fixes[:, :2]).all(axis=1)
    position = np.full(fixes.shape, np.nan)
    if known.any():
        position[known] = anchor.from_geodetic(fixes[known])
    if spec.above_ground is not None or not anchor.heights_known:
        position[:, 2] = fixes[:, 2]
    return position
