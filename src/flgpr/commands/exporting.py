"""Alarms, truth and run-views for other programs, on the Earth."""

from __future__ import annotations

import tempfile
import zipfile
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from flgpr.chain.detection import Detection
from flgpr.commands.importing import check_parent_folder
from flgpr.commands.positions import needed_anchor
from flgpr.door import read_named
from flgpr.formats.cphd import write_cphd
from flgpr.geo import export as georeferenced
from flgpr.geo import qgis
from flgpr.geo.anchor import Anchor, transform_lonlat
from flgpr.results.result import Result, read_result
from flgpr.results.score import read_scored_truth
from flgpr.store import open_run, sha256
from flgpr.store.dialects import TableReading, parse_columns_option
from flgpr.store.files import existing
from flgpr.store.outputs import whole_output
from flgpr.store.tables import json_value, parse_table

if TYPE_CHECKING:
    from xml.etree import ElementTree

PathLike = str | Path
TABLE_FORMATS = ("geojson", "gpkg", "kml", "gpx", "csv")
_MARGIN = 5.0  # m of ground about the lane


def export_run(run: PathLike, output: PathLike, anchor: PathLike | None = None) -> Path:
    """Export a stored run as CPHD; another file there is refused.

    ``anchor`` (TOML) ties the lane to the Earth, else what the run tells of its place.
    """
    check_parent_folder(Path(output))
    held = open_run(run)
    with whole_output(Path(output)) as made:
        write_cphd(held, made, needed_anchor(anchor, held.attrs.get("georeference"), run))
    return Path(output)


def export_table(
    table: PathLike,
    output: PathLike,
    to: str,
    anchor: PathLike | None,
    kind: str = "truth",
    time: str | None = None,
    columns: str | None = None,
) -> Path:
    """Export a CSV of alarms, truth or objects (``kind``) to the Earth as "geojson", "gpkg", "kml", "gpx" or "csv".

    ``time`` is when, ISO 8601 with a time zone; ``columns`` are such as ``x=Rechts,y=Hoch``.
    """
    data = read_named(existing(table, f"{kind} file"))
    tie = needed_anchor(anchor, None, table)
    reading = None if columns is None else TableReading(parse_columns_option(columns), tie)
    rows = parse_table(data, kind, table, reading)
    digest = sha256(data)
    return _write_points(rows, Path(output), to, tie, kind, f"sha256:{digest}", time)


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
    target = Path(output)
    tie = needed_anchor(anchor, held.manifest["run"].get("georeference"), result)
    if to == "geotiff":
        check_parent_folder(target)
        with whole_output(target) as made:
            georeferenced.write_geotiff(chosen.view, made, tie, identity)
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
    check_parent_folder(target)
    held, chosen, identity = _chosen(result, detection)
    tie = needed_anchor(anchor, held.manifest["run"].get("georeference"), result)
    scored = read_scored_truth(held, None if score is None else Path(score))
    truth, objects = (None, None) if scored is None else scored
    with tempfile.TemporaryDirectory() as folder:
        home = Path(folder)
        layers = []
        for kind, rows, colour in (
            ("truth", truth, "#d7263d"),
            ("alarms", chosen.alarms, ""),
            ("objects", objects, "#707070"),
        ):
            if rows is None or not len(rows):
                continue
            style = (
                qgis.by_kind(rows["kind"], colour)
                if colour
                else qgis.graduated("confidence", rows["confidence"])
            )
            points = georeferenced.georeference(rows, tie, kind, identity, time)
            georeferenced.write_geopackage(points, home / f"{kind}.gpkg", kind)
            layers.append(qgis.Layer(kind, f"{kind}.gpkg", "EPSG:4326", "Point", style))
        georeferenced.write_outline(held.lane, home / "lane.gpkg", tie)
        layers.append(qgis.Layer("lane", "lane.gpkg", "EPSG:4326", "Polygon", qgis.outline()))
        georeferenced.write_geotiff(chosen.view, home / "run-view.tif", tie, identity)
        layers.append(qgis.Layer("run-view", "run-view.tif", tie.utm(), "", _shaded(held, chosen)))
        places = transform_lonlat(
            tie.to_geodetic(georeferenced.corners(held.lane))[:, :2], tie.utm()
        )
        extent = (*(places.min(axis=0) - _MARGIN), *(places.max(axis=0) + _MARGIN))
        title = f"{held.manifest['run'].get('title', held.folder.name)}: {chosen.title}"
        about = f"{georeferenced.STATEMENT} Processing {identity}."
        (home / "lane.qgs").write_bytes(qgis.project(title, about, tie.utm(), extent, layers))
        with (
            whole_output(target) as made,
            zipfile.ZipFile(made, "w", zipfile.ZIP_DEFLATED) as bundle,
        ):
            for path in sorted(home.iterdir()):
                entry = zipfile.ZipInfo(
                    f"{target.stem}/{path.name}"
                )  # tells no time: the same map, the same bytes
                entry.external_attr = 0o644 << 16
                bundle.writestr(entry, path.read_bytes(), zipfile.ZIP_DEFLATED)
    return target


def map_bytes(result: Path, anchor: Path | None, score: Path | None) -> bytes:
    """Give what :func:`export_qgis` writes, for the viewer."""
    with tempfile.TemporaryDirectory() as folder:
        return export_qgis(
            result, Path(folder) / f"{result.name}-map.zip", anchor, score=score
        ).read_bytes()


def _shaded(result: Result, detection: Detection) -> ElementTree.Element:
    """Draw the channel that raised the alarms, from the median to what only one pixel in 500 exceeds."""
    view = detection.view
    names = [(str(a), str(b)) for a in view["polarization"].values for b in view["subband"].values]
    channel = tuple(result.files().json("view/index.json")["channel"])
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
    return (
        held,
        chosen[0],
        f"{held.manifest['recipe_sha256'][:16]}-{held.manifest['identity'][:16]}",
    )


def _write_points(
    rows: pd.DataFrame,
    output: Path,
    to: str,
    anchor: Anchor,
    kind: str,
    identity: str,
    time: str | None,
) -> Path:
    if to not in TABLE_FORMATS:
        raise ValueError(f"to must be one of {', '.join(TABLE_FORMATS)}, got {to!r}")
    check_parent_folder(output)
    points = georeferenced.georeference(rows, anchor, kind, identity, time)
    with whole_output(output) as made:
        if to == "geojson":
            sigma = json_value(anchor.sigma)
            about = {
                "kind": kind,
                "anchor_crs": anchor.crs,
                "anchor_sigma_m": sigma,
                "processing_id": identity,
            }
            georeferenced.write_earth_geojson(points, made, about)
        elif to == "gpkg":
            georeferenced.write_geopackage(points, made, kind)
        elif to == "kml":
            georeferenced.write_kml(points, made, f"{kind} {identity}")
        elif to == "gpx":
            georeferenced.write_gpx(points, made)
        else:
            georeferenced.write_earth_csv(points, made)
    return output
