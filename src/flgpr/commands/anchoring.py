"""Tying lanes to the Earth: from surveyed points to an anchor, a tied run and an outline."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from flgpr.geo.anchor import Anchor, read_anchor
from flgpr.model import Lane
from flgpr.model.faults import faults_of
from flgpr.store import open_run, read_lane, save_run, write_whole
from flgpr.store.files import existing
from flgpr.store.outputs import atomic_output, write_new
from flgpr.store.text_tables import read_text_table
from flgpr.types import Entries, PathLike, floats

_PROJECTED = ("easting_m", "northing_m")
_GEOGRAPHIC = ("longitude_deg", "latitude_deg")


def write_anchor(points: PathLike, crs: str, accuracy: float, output: PathLike) -> Path:
    """Write the anchor of surveyed points, the TOML that :func:`flgpr.geo.read_anchor` reads.

    Parameters
    ----------
    points : path
        CSV with ``lane_x_m``, ``lane_y_m``, either ``easting_m`` and ``northing_m`` or
        ``longitude_deg`` and ``latitude_deg``, and optionally ``height_m``, ellipsoidal.
    crs : str
        Reference system of the points.
    accuracy : float
        Standard deviation of a surveyed coordinate, m.
    output : path
        File to write.

    Returns
    -------
    Path
        The file.

    Raises
    ------
    FileExistsError
        If another file is there.
    ValueError
        If columns are missing, a value is not finite, or the points do not fit one another.
    """
    path = existing(points, "file of surveyed points")
    with faults_of(path):
        columns = read_text_table(path)
    names = _point_columns(columns, path)
    rows = np.stack([floats(columns[name]) for name in names], axis=1)
    is_finite = np.isfinite(rows).all(axis=1)
    if not is_finite.all():
        raise ValueError(f"{path}: every value must be finite, got {rows[~is_finite][0].tolist()}")

    lines = [f"crs = {json.dumps(crs)}", f"accuracy = {accuracy!r}"]
    for x, y, *coordinates in rows.tolist():
        lines += ["", "[[point]]", f"lane = [{x!r}, {y!r}]"]
        for name, value in zip(names[2:], coordinates, strict=True):
            entry = name.rsplit("_", 1)[0]  # without the unit
            lines.append(f"{entry} = {value!r}")
    target = Path(output)
    # The reader checks the fit; only what it accepts gets the name of the output.
    with atomic_output(target) as trial:
        write_whole(trial, "\n".join(lines) + "\n")
        try:
            read_anchor(trial)
        except ValueError as error:
            raise ValueError(str(error).replace(str(trial), str(path))) from None
    return target


def _point_columns(columns: Mapping[str, Any], path: Path) -> list[str]:
    """Return the names of the columns that make up points: lane, Earth, and height if there."""
    kinds = [kind for kind in (_PROJECTED, _GEOGRAPHIC) if set(kind) <= set(columns)]
    has_lane = "lane_x_m" in columns and "lane_y_m" in columns
    if not has_lane or len(kinds) != 1:
        listed = ", ".join(name for name in columns if name != "table")
        raise ValueError(
            f"{path}: must have lane_x_m and lane_y_m, and either {' and '.join(_PROJECTED)} "
            f"or {' and '.join(_GEOGRAPHIC)}; it has {listed}"
        )
    names = ["lane_x_m", "lane_y_m", *kinds[0]]
    if "height_m" in columns:
        names.append("height_m")
    return names


def tie_lane(
    anchor: PathLike,
    lane: PathLike | None = None,
    outline: PathLike | None = None,
    run: PathLike | None = None,
    output: PathLike | None = None,
) -> Entries:
    """Return how an anchor fits, and tie a lane and a run to it.

    Parameters
    ----------
    anchor : path
        Anchor (TOML).
    lane : path, optional
        Lane (TOML) whose corners are computed.
    outline : path, optional
        GeoJSON of the lane's outline to write.
    run : path, optional
        Run store.
    output : path, optional
        Store to make of the run with its georeference.

    Returns
    -------
    dict
        Position and direction, the misfit of every point, and the uncertainty at the points' mean
        and at the lane's corners; m, degrees.
    """
    lane_anchor = read_anchor(anchor)
    crs_accuracy = lane_anchor.crs_accuracy
    fit: Entries = {
        **lane_anchor.georeference(),
        "crs": lane_anchor.crs,
        "points": lane_anchor.count,
        "residuals_m": list(lane_anchor.residuals),
        "sigma_m": lane_anchor.sigma,
        "sigma_at_points_m": float(lane_anchor.uncertainty(*lane_anchor.center)),
        "crs_accuracy_m": None if math.isnan(crs_accuracy) else crs_accuracy,
        "heights_known": lane_anchor.heights_known,
    }

    if lane is not None:
        fit["corners"] = _corners(read_lane(lane), lane_anchor)
    if outline is not None:
        geojson = _outline(fit["corners"], lane_anchor)
        write_new(Path(outline), json.dumps(geojson, indent=1) + "\n")
    if run is not None and output is not None:
        tied = open_run(run).assign_attrs(georeference=lane_anchor.georeference())
        save_run(tied, output, resume=True, share_files=True)
    return fit


def _corners(lane: Lane, anchor: Anchor) -> list[dict[str, float]]:
    """Return the corners of a lane, in turn: lane (m), Earth (degrees) and uncertainty (m)."""
    positions = [
        (lane.x_min, lane.y_min),
        (lane.x_max, lane.y_min),
        (lane.x_max, lane.y_max),
        (lane.x_min, lane.y_max),
    ]
    # The lane is level: its ground is z = 0.
    geodetic = anchor.to_geodetic([(x, y, 0.0) for x, y in positions])
    corners = []
    for (x, y), (longitude, latitude, *_) in zip(positions, geodetic, strict=True):
        corners.append(
            {
                "x": x,
                "y": y,
                "longitude": float(longitude),
                "latitude": float(latitude),
                "sigma_m": float(anchor.uncertainty(x, y)),
            }
        )
    return corners


def _outline(corners: list[dict[str, float]], anchor: Anchor) -> Entries:
    """Return the outline of a lane as GeoJSON: a closed line and its corners."""
    positions = []
    points = []
    for corner in corners:
        position = [round(corner["longitude"], 9), round(corner["latitude"], 9)]
        positions.append(position)
        properties = {
            "nature": "corner",
            "lane_x": corner["x"],
            "lane_y": corner["y"],
            "anchor_sigma": corner["sigma_m"],
        }
        points.append(_feature("Point", position, properties))
    properties = {
        "nature": "outline of the surveyed lane",
        "anchor_sigma": max(corner["sigma_m"] for corner in corners),
    }
    line = _feature("LineString", [*positions, positions[0]], properties)
    about = {"anchor_crs": anchor.crs, "anchor_sigma_m": anchor.sigma}
    return {"type": "FeatureCollection", "flgpr": about, "features": [line, *points]}


def _feature(kind: str, coordinates: list[Any], properties: Entries) -> Entries:
    """Return a feature of GeoJSON."""
    geometry = {"type": kind, "coordinates": coordinates}
    return {"type": "Feature", "geometry": geometry, "properties": properties}
