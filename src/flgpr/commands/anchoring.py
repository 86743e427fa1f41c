"""Tying lanes to the Earth: survey points in, an anchor, a tied run and a lane's outline out."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np

from flgpr.geo.anchor import Anchor, read_anchor
from flgpr.model import Lane
from flgpr.store import open_run, read_lane, save_run, write_whole
from flgpr.store.files import existing, faults_of
from flgpr.store.outputs import whole_output, write_new
from flgpr.store.text_tables import read_text_table

PathLike = str | Path
_PLANE = ("easting_m", "northing_m")
_GLOBE = ("longitude_deg", "latitude_deg")


def anchor_from_points(points: PathLike, crs: str, accuracy: float) -> str:
    """Write an anchor, TOML as :func:`flgpr.geo.read_anchor` takes it, from a CSV of surveyed points.

    Columns are ``lane_x_m``, ``lane_y_m``, either ``easting_m`` and ``northing_m`` or ``longitude_deg`` and
    ``latitude_deg`` in the system ``crs``, and perhaps ``height_m``, ellipsoidal. ``accuracy`` is the standard
    deviation of one surveyed coordinate, m.
    """
    path = existing(points, "file of surveyed points")
    with faults_of(path):
        columns = read_text_table(path)
    kinds = [kind for kind in (_PLANE, _GLOBE) if set(kind) <= set(columns)]
    missing = [name for name in ("lane_x_m", "lane_y_m") if name not in columns]
    if missing or len(kinds) != 1:
        raise ValueError(
            f"{path}: must have lane_x_m and lane_y_m, and either {' and '.join(_PLANE)} or {' and '.join(_GLOBE)}; it "
            f"has {', '.join(name for name in columns if name != 'table')}"
        )
    names = ("lane_x_m", "lane_y_m", *kinds[0], *(["height_m"] if "height_m" in columns else []))
    rows = np.stack([np.asarray(columns[name], dtype=np.float64) for name in names], axis=1)
    if not np.isfinite(rows).all():
        raise ValueError(
            f"{path}: every value must be finite, got {rows[~np.isfinite(rows).all(axis=1)][0].tolist()}"
        )
    lines = [f"crs = {json.dumps(crs)}", f"accuracy = {accuracy!r}"]
    for row in rows.tolist():
        lines += ["", "[[point]]", f"lane = [{row[0]!r}, {row[1]!r}]"]
        lines += [
            f"{name.rsplit('_', 1)[0]} = {value!r}"
            for name, value in zip(names[2:], row[2:], strict=True)
        ]
    return "\n".join(lines) + "\n"


def write_anchor(text: str, path: PathLike) -> Path:
    """Write an anchor, TOML, once it is seen to fit (else a ValueError); another file there is refused."""
    target = Path(path)
    with whole_output(target) as trial:
        write_whole(trial, text)
        try:
            read_anchor(trial)
        except ValueError as error:
            raise ValueError(str(error).replace(str(trial), str(target))) from None
    return target


def tie_lane(
    anchor: PathLike,
    lane: PathLike | None = None,
    outline: PathLike | None = None,
    run: PathLike | None = None,
    output: PathLike | None = None,
) -> dict[str, Any]:
    """Tell how an anchor (TOML) fits, and tie a lane (TOML) and a run to it.

    It tells place and direction, misfit of every point, and the uncertainty at the points' mean and at the lane's
    corners. The lane's ``outline`` may be written as GeoJSON, and ``output`` as a store of the run that knows where its
    lane lies.
    """
    tie = read_anchor(anchor)
    fit: dict[str, Any] = {
        **tie.georeference(),
        "crs": tie.crs,
        "points": tie.count,
        "residuals_m": list(tie.residuals),
        "sigma_m": tie.sigma,
        "sigma_at_points_m": float(tie.uncertainty(*tie.center)),
        "crs_accuracy_m": None if math.isnan(tie.crs_accuracy) else tie.crs_accuracy,
        "heights_known": tie.heights_known,
    }
    if lane is not None:
        fit["corners"] = _corners(read_lane(lane), tie)
    if outline is not None:
        write_new(Path(outline), json.dumps(_outline(fit["corners"], tie), indent=1) + "\n")
    if run is not None and output is not None:
        held = open_run(run)
        save_run(held.assign_attrs(georeference=tie.georeference()), output, resume=True)
    return fit


def _corners(lane: Lane, tie: Anchor) -> list[dict[str, float]]:
    x, y = (lane.x_min, lane.x_max), (lane.y_min, lane.y_max)
    corners = [(x[0], y[0]), (x[1], y[0]), (x[1], y[1]), (x[0], y[1])]
    earth = tie.to_geodetic([(*corner, 0.0) for corner in corners])
    return [
        {
            "x": x,
            "y": y,
            "longitude": float(e[0]),
            "latitude": float(e[1]),
            "sigma_m": float(tie.uncertainty(x, y)),
        }
        for (x, y), e in zip(corners, earth, strict=True)
    ]


def _outline(corners: list[dict[str, float]], tie: Anchor) -> dict[str, Any]:
    ring = [[round(c["longitude"], 9), round(c["latitude"], 9)] for c in [*corners, corners[0]]]
    line = {
        "type": "Feature",
        "geometry": {"type": "LineString", "coordinates": ring},
        "properties": {
            "nature": "outline of the surveyed lane",
            "anchor_sigma": max(c["sigma_m"] for c in corners),
        },
    }
    points = [
        {
            "type": "Feature",
            "geometry": {"type": "Point", "coordinates": position},
            "properties": {
                "nature": "corner",
                "lane_x": c["x"],
                "lane_y": c["y"],
                "anchor_sigma": c["sigma_m"],
            },
        }
        for position, c in zip(ring, corners, strict=False)
    ]
    about = {"anchor_crs": tie.crs, "anchor_sigma_m": tie.sigma}
    return {"type": "FeatureCollection", "flgpr": about, "features": [line, *points]}
