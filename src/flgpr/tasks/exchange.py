"""Import, export and tying lanes to the Earth as functions: files in, files out."""

from __future__ import annotations

import json
import math
import tempfile
import zipfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd
import xarray as xr

from flgpr.chain.lane_chain import Detection
from flgpr.io import (
    MAX_MEMORY,
    georeferenced,
    gpr_run,
    open_run,
    qgis,
    read_gpr,
    read_lane,
    read_table,
    save_run,
    sha256,
    write_table,
    write_whole,
)
from flgpr.io.anchor import Anchor, own_anchor, read_anchor, transform_lonlat
from flgpr.io.cphd import read_cphd, write_cphd
from flgpr.io.files import check_new, existing, partial_of
from flgpr.io.mapped import Imported, import_mapped
from flgpr.io.tables import json_value, read_text_table
from flgpr.io.tracks import read_nmea, read_survey, read_track
from flgpr.model import Lane
from flgpr.model.track import reference_track
from flgpr.results.result import Result, read_result
from flgpr.results.score import read_scored_truth

if TYPE_CHECKING:
    from xml.etree import ElementTree

PathLike = str | Path
TABLE_FORMATS = ("geojson", "gpkg", "kml", "gpx", "csv")
FORMATS = (*TABLE_FORMATS, "geotiff", "qgis", "cphd")
_MARGIN = 5.0  # m of ground about the lane


def import_with_mapping(
    mapping: PathLike,
    output: PathLike,
    data: list[PathLike] | None = None,
    survey: PathLike | None = None,
    track: PathLike | pd.DataFrame | None = None,
    anchor: PathLike | None = None,
    clock_offset: float = 0.0,
    lever_arm: tuple[float, float, float] = (0.0, 0.0, 0.0),
    latency: float = 0.0,
    max_memory: int = MAX_MEMORY,
) -> Imported:
    """Import data files by a mapping (TOML) and store the run; a stopped import goes on with the scan it was at.

    It gives run, track and notes; a track is also written beside the run as ``NAME-track.csv``. ``data`` stand in place
    of the mapping's files. Poses may come from ``survey``, CSV as :func:`flgpr.io.read_survey` takes it, or from
    ``track``, CSV or an NMEA log, which needs the ``anchor`` (TOML): then ``clock_offset`` is the track's clock less
    the radar's, s, ``latency`` how late its stamps are, s, and ``lever_arm`` the antenna's place in the vehicle frame,
    m. A take of motion capture is read before, by :func:`flgpr.io.read_track`. ``max_memory`` is the largest array that
    is read, bytes.
    """
    _fresh(Path(output))
    pose = read_survey(survey) if survey is not None else None
    moved = None
    if track is not None:
        way = track if isinstance(track, pd.DataFrame) else track_of(Path(track), anchor)
        moved = reference_track(way, lever_arm, latency)
    files = [Path(one) for one in data or ()]
    arrived = import_mapped(mapping, files, None, max_memory, pose, moved, clock_offset, _anchor(anchor))
    store, run = Path(output), _tied(arrived.run, anchor)
    if arrived.track is not None:  # before the run, whose presence says that all is there
        write_table(arrived.track, store.with_name(f"{store.stem}-track.csv"))
    save_run(run, store, resume=True)
    return arrived


def import_cphd(path: PathLike, output: PathLike, anchor: PathLike | None = None) -> xr.Dataset:
    """Import a CPHD file and store the run; files of other makers need the anchor. A store that exists is refused."""
    _fresh(Path(output))
    run = _tied(read_cphd(path, _anchor(anchor)), anchor)
    save_run(run, output, resume=True)
    return run


def import_gpr(
    path: PathLike,
    output: PathLike,
    channel: int = 0,
    anchor: PathLike | None = None,
    max_memory: int = MAX_MEMORY,
    **options: Any,
) -> xr.Dataset:
    """Import the recording of a commercial radar (:func:`flgpr.io.read_gpr`) and store the run.

    ``options`` are those of :func:`flgpr.io.gpr_run`: ``step``, ``time_zero``, ``window``, ``band``, ``separation``,
    ``across``, ``height``, ``polarization``. A store that exists is refused.
    """
    _fresh(Path(output))
    section = read_gpr(path, max_memory)
    run = _tied(gpr_run(section, channel, anchor=_anchor(anchor), max_memory=max_memory, **options), anchor)
    save_run(run, output, resume=True)
    return run


def export_run(run: PathLike, output: PathLike, anchor: PathLike | None = None) -> Path:
    """Export a stored run as CPHD; a file that exists is refused.

    ``anchor`` (TOML) ties the lane to the Earth, else what the run tells of its place.
    """
    _fresh(Path(output))
    held = open_run(run)
    return write_cphd(held, output, _tie(anchor, held.attrs.get("georeference"), run))


def export_table(
    table: PathLike,
    output: PathLike,
    to: str,
    anchor: PathLike | None,
    kind: str = "truth",
    time: str | None = None,
) -> Path:
    """Export a CSV of alarms, truth or objects (``kind``) to the Earth as "geojson", "gpkg", "kml", "gpx" or "csv".

    ``time`` is when, ISO 8601 with a time zone.
    """
    rows = read_table(table, kind)
    digest = sha256(Path(table).read_bytes())
    return _write_points(rows, Path(output), to, _tie(anchor, None, table), kind, f"sha256:{digest}", time)


def export_result(
    result: PathLike,
    output: PathLike,
    to: str,
    anchor: PathLike | None = None,
    detection: str = "main",
    time: str | None = None,
) -> Path:
    """Export a result's alarms as evidence points ("geojson", "gpkg", "kml", "gpx", "csv") or its run-view ("geotiff").

    ``anchor`` (TOML) ties the lane to the Earth, else what the run told of its place. ``detection`` is "main" or the
    name of a variant, ``time`` when the data were taken, ISO 8601 with a time zone.
    """
    if to not in (*TABLE_FORMATS, "geotiff"):
        raise ValueError(f"to must be one of {', '.join((*TABLE_FORMATS, 'geotiff'))}, got {to!r}")
    held, chosen, identity = _chosen(result, detection)
    target, tie = Path(output), _tie(anchor, held.manifest["run"].get("georeference"), result)
    if to == "geotiff":
        _fresh(target)
        georeferenced.write_geotiff(chosen.view, target, tie, identity)
        return target
    return _write_points(chosen.alarms, target, to, tie, "alarms", identity, time)


def export_qgis(
    result: PathLike,
    output: PathLike,
    anchor: PathLike | None = None,
    detection: str = "main",
    time: str | None = None,
    score: PathLike | None = None,
) -> Path:
    """Export a result as a zip that holds a project of QGIS and its layers, all that a map on another machine needs.

    The layers are the alarms, styled by confidence, the truth and objects if the result, or ``score``, its score's
    folder, was scored with them, the lane's outline, and the run-view. ``anchor`` (TOML) ties the lane to the Earth,
    else what the run told of its place; a ValueError where it told nothing.
    """
    target = Path(output)
    if target.suffix != ".zip":
        raise ValueError(f"output must end in .zip, got {output}")
    _fresh(target)
    held, chosen, identity = _chosen(result, detection)
    tie = _tie(anchor, held.manifest["run"].get("georeference"), result)
    scored = read_scored_truth(held, None if score is None else Path(score))
    truth, objects = (None, None) if scored is None else scored
    with tempfile.TemporaryDirectory() as folder:
        home, layers = Path(folder), []
        for kind, rows, colour in (
            ("truth", truth, "#d7263d"),
            ("alarms", chosen.alarms, ""),
            ("objects", objects, "#707070"),
        ):
            if rows is None or not len(rows):
                continue
            style = qgis.by_kind(rows["kind"], colour) if colour else qgis.graduated("confidence", rows["confidence"])
            points = georeferenced.georeference(rows, tie, kind, identity, time)
            georeferenced.write_geopackage(points, home / f"{kind}.gpkg", kind)
            layers.append(qgis.Layer(kind, f"{kind}.gpkg", "EPSG:4326", "Point", style))
        georeferenced.write_outline(held.lane, home / "lane.gpkg", tie)
        layers.append(qgis.Layer("lane", "lane.gpkg", "EPSG:4326", "Polygon", qgis.outline()))
        georeferenced.write_geotiff(chosen.view, home / "run-view.tif", tie, identity)
        layers.append(qgis.Layer("run-view", "run-view.tif", tie.utm(), "", _shaded(held, chosen)))
        places = transform_lonlat(tie.to_geodetic(georeferenced.corners(held.lane))[:, :2], tie.utm())
        extent = (*(places.min(axis=0) - _MARGIN), *(places.max(axis=0) + _MARGIN))
        title = f"{held.manifest['run'].get('title', held.folder.name)}: {chosen.title}"
        about = f"{georeferenced.STATEMENT} Processing {identity}."
        (home / "lane.qgs").write_bytes(qgis.project(title, about, tie.utm(), extent, layers))
        with partial_of(target) as partial, zipfile.ZipFile(partial, "w", zipfile.ZIP_DEFLATED) as bundle:
            for path in sorted(home.iterdir()):
                bundle.write(path, f"{target.stem}/{path.name}")
    return target


def map_bytes(result: Path, anchor: Path | None, score: Path | None) -> bytes:
    """Give what :func:`export_qgis` writes, for the viewer."""
    with tempfile.TemporaryDirectory() as folder:
        return export_qgis(result, Path(folder) / f"{result.name}-map.zip", anchor, score=score).read_bytes()


def _shaded(result: Result, detection: Detection) -> ElementTree.Element:
    """Draw the channel that raised the alarms, from the median to what only one pixel in 500 exceeds."""
    view = detection.view
    names = [(str(a), str(b)) for a in view["polarization"].values for b in view["subband"].values]
    channel = tuple(json.loads((result.folder / "view" / "index.json").read_bytes())["channel"])
    band = names.index(channel) if channel in names else 0
    values = view.values.reshape(len(names), -1)[band]
    seen = values[np.isfinite(values)]
    low, high = np.quantile(seen, (0.5, 0.998)) if seen.size else (0.0, 1.0)
    return qgis.shaded(band + 1, float(low), float(high))


def _chosen(result: PathLike, detection: str) -> tuple[Result, Detection, str]:
    """Read a result; give it, its detection of that name, and the id of the processing."""
    held = read_result(result)
    chosen = [one for one in held.detections if one.name == detection]
    if not chosen:
        known = ", ".join(one.name for one in held.detections)
        raise ValueError(f"detection must be one of {known}, got {detection!r}")
    return held, chosen[0], f"{held.manifest['recipe_sha256'][:16]}-{held.manifest['identity'][:16]}"


def _write_points(
    rows: pd.DataFrame, output: Path, to: str, anchor: Anchor, kind: str, identity: str, time: str | None
) -> Path:
    if to not in TABLE_FORMATS:
        raise ValueError(f"to must be one of {', '.join(TABLE_FORMATS)}, got {to!r}")
    _fresh(output)
    points = georeferenced.georeference(rows, anchor, kind, identity, time)
    if to == "geojson":
        sigma = json_value(anchor.sigma)
        about = {"kind": kind, "anchor_crs": anchor.crs, "anchor_sigma_m": sigma, "processing_id": identity}
        georeferenced.write_earth_geojson(points, output, about)
    elif to == "gpkg":
        georeferenced.write_geopackage(points, output, kind)
    elif to == "kml":
        georeferenced.write_kml(points, output, f"{kind} {identity}")
    elif to == "gpx":
        georeferenced.write_gpx(points, output)
    else:
        georeferenced.write_earth_csv(points, output)
    return output


def track_of(
    path: Path,
    anchor: PathLike | None,
    body: str | None = None,
    axes: Sequence[str] | None = None,
    max_gap: float = 1.0,
) -> pd.DataFrame:
    """Read a track from CSV, as :func:`flgpr.io.read_track` does, or from an NMEA log with the anchor that it needs."""
    if existing(path, "track").suffix.lower() == ".csv":
        return read_track(path, "column", body, axes, max_gap)
    tie = _anchor(anchor)
    if tie is None:
        raise ValueError(f"{path}: a track of a satellite receiver needs an anchor to lie in the lane")
    return read_nmea(path, tie)


def _tied(run: xr.Dataset, anchor: PathLike | None) -> xr.Dataset:
    """Let a run remember where its lane lies, so that results and the viewer know it too."""
    tie = _anchor(anchor)
    return run if tie is None else run.assign_attrs(georeference=tie.georeference())


def _anchor(anchor: PathLike | None) -> Anchor | None:
    return None if anchor is None else read_anchor(anchor)


def _tie(anchor: PathLike | None, reference: Mapping[str, Any] | None, source: PathLike) -> Anchor:
    """Read an anchor, or make it of what a run told of its place."""
    if anchor is not None:
        return read_anchor(anchor)
    if reference is None:
        raise ValueError(f"{source}: it does not tell where its lane lies; an anchor is needed")
    return own_anchor(reference)


def _fresh(path: Path) -> None:
    check_new(path)
    if not path.parent.is_dir():
        raise FileNotFoundError(f"the folder of the output must exist, got {path.parent}")


_PLANE, _GLOBE = ("easting_m", "northing_m"), ("longitude_deg", "latitude_deg")


def anchor_from_points(points: PathLike, crs: str, accuracy: float) -> str:
    """Write an anchor, TOML as :func:`flgpr.io.read_anchor` takes it, from a CSV of surveyed points.

    Columns are ``lane_x_m``, ``lane_y_m``, either ``easting_m`` and ``northing_m`` or ``longitude_deg`` and
    ``latitude_deg`` in the system ``crs``, and perhaps ``height_m``, ellipsoidal. ``accuracy`` is the standard
    deviation of one surveyed coordinate, m.
    """
    path = existing(points, "file of surveyed points")
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
        raise ValueError(f"{path}: every value must be finite, got {rows[~np.isfinite(rows).all(axis=1)][0].tolist()}")
    lines = [f"crs = {json.dumps(crs)}", f"accuracy = {accuracy!r}"]
    for row in rows.tolist():
        lines += ["", "[[point]]", f"lane = [{row[0]!r}, {row[1]!r}]"]
        lines += [f"{name.rsplit('_', 1)[0]} = {value!r}" for name, value in zip(names[2:], row[2:], strict=True)]
    return "\n".join(lines) + "\n"


def write_anchor(text: str, path: PathLike) -> Path:
    """Write an anchor, TOML, once it is seen to fit (else a ValueError); a file that exists is refused."""
    target = Path(path)
    check_new(target)
    trial = target.with_name(target.name + ".trial")
    try:
        write_whole(trial, text)
        read_anchor(trial)
        trial.rename(target)
    except ValueError as error:
        raise ValueError(str(error).replace(str(trial), str(target))) from None
    finally:
        trial.unlink(missing_ok=True)
    return target


def check_request(
    lane: PathLike | None, outline: PathLike | None, run: PathLike | None, output: PathLike | None
) -> None:
    """Check what :func:`tie_lane` is asked for before anything is written; what exists is refused."""
    if (outline is not None and lane is None) or (output is None) != (run is None):
        raise ValueError("an outline needs a lane, and a run and its output go together")
    for path in (outline, output):
        check_new(path)


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
    check_request(lane, outline, run, output)
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
        write_whole(Path(outline), json.dumps(_outline(fit["corners"], tie), indent=1) + "\n")
    if run is not None and output is not None:
        held = open_run(run)
        save_run(held.assign_attrs(georeference=tie.georeference()), output, resume=True)
    return fit


def _corners(lane: Lane, tie: Anchor) -> list[dict[str, float]]:
    corners = georeferenced.corners(lane)
    earth = tie.to_geodetic(corners)
    return [
        {"x": x, "y": y, "longitude": float(e[0]), "latitude": float(e[1]), "sigma_m": float(tie.uncertainty(x, y))}
        for (x, y, _), e in zip(corners.tolist(), earth, strict=True)
    ]


def _outline(corners: list[dict[str, float]], tie: Anchor) -> dict[str, Any]:
    ring = [[round(c["longitude"], 9), round(c["latitude"], 9)] for c in [*corners, corners[0]]]
    line = {
        "type": "Feature",
        "geometry": {"type": "LineString", "coordinates": ring},
        "properties": {"nature": "outline of the surveyed lane", "anchor_sigma": max(c["sigma_m"] for c in corners)},
    }
    points = [
        {
            "type": "Feature",
            "geometry": {"type": "Point", "coordinates": position},
            "properties": {"nature": "corner", "lane_x": c["x"], "lane_y": c["y"], "anchor_sigma": c["sigma_m"]},
        }
        for position, c in zip(ring, corners, strict=False)
    ]
    about = {"anchor_crs": tie.crs, "anchor_sigma_m": tie.sigma}
    return {"type": "FeatureCollection", "flgpr": about, "features": [line, *points]}
