"""Export of alarms, truth, run-views and runs, on the Earth, for other programs."""

from __future__ import annotations

import tempfile
import zipfile
from collections.abc import Iterator
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from flgpr.commands.importing import check_parent_folder
from flgpr.commands.positions import needed_anchor
from flgpr.door import read_named
from flgpr.formats.cphd import write_cphd
from flgpr.formats.sigmf_writer import write_sigmf
from flgpr.geo import export as georeferenced
from flgpr.geo import qgis
from flgpr.geo.anchor import Anchor
from flgpr.geo.geodesy import transform_lonlat
from flgpr.geo.imsma import imsma_table
from flgpr.method.detection import Detection
from flgpr.results.result import Result, read_result
from flgpr.results.score import read_scored_truth
from flgpr.store import open_run, sha256
from flgpr.store.dialects import TableReading, parse_columns_option
from flgpr.store.files import existing
from flgpr.store.outputs import atomic_output
from flgpr.store.tables import json_value, parse_table, write_table

if TYPE_CHECKING:
    from xml.etree import ElementTree

PathLike = str | Path
TABLE_FORMATS = ("geojson", "gpkg", "kml", "gpx", "csv")
_MARGIN = 5.0  # m of ground around the lane
_POINT_COLOURS = {"truth": "#d7263d", "objects": "#707070"}
_SHADED_QUANTILES = (0.5, 0.998)


def export_run(run: PathLike, output: PathLike, anchor: PathLike | None = None) -> Path:
    """Export a stored run as CPHD.

    Parameters
    ----------
    run : path
        Run store.
    output : path
        File to write.
    anchor : path, optional
        TOML that ties the lane to the Earth, by default the georeference of the run.

    Returns
    -------
    pathlib.Path
        The file.

    Raises
    ------
    ValueError
        If the run is not valid, or there is no georeference.
    FileExistsError
        If another file is at the output.
    """
    target = check_parent_folder(output)
    dataset = open_run(run)
    lane_anchor = needed_anchor(anchor, dataset.attrs.get("georeference"), run)
    with atomic_output(target) as partial:
        write_cphd(dataset, partial, lane_anchor)
    return target


def export_sigmf(
    run: PathLike, output: PathLike, anchor: PathLike | None = None, time: str | None = None
) -> Path:
    """Export a stored run as a SigMF recording, with a mapping that takes it back.

    Parameters
    ----------
    run : path
        Run store.
    output : path
        Folder to make.
    anchor : path, optional
        TOML that ties the lane to the Earth, by default the georeference of the run; without
        either the recording has no places.
    time : str, optional
        When the first scan was recorded, ISO 8601 with a time zone; without it the recording has
        no dates.

    Returns
    -------
    pathlib.Path
        The folder.

    Raises
    ------
    ValueError
        If the run or the time is not valid.
    FileExistsError
        If something else is at the output.
    """
    target = check_parent_folder(output)
    begin = None if time is None else _moment(time)
    dataset = open_run(run)
    reference = dataset.attrs.get("georeference")
    lane_anchor = None
    if anchor is not None or reference is not None:
        lane_anchor = needed_anchor(anchor, reference, run)
    return write_sigmf(dataset, target, lane_anchor, begin)


def _moment(time: str) -> datetime:
    """Return a time of ISO 8601 with a time zone."""
    rule = f"time must be ISO 8601 with a time zone, got {time!r}"
    try:
        moment = datetime.fromisoformat(time)
    except ValueError:
        raise ValueError(rule) from None
    if moment.tzinfo is None:
        raise ValueError(rule)
    return moment


def export_table(
    table: PathLike,
    output: PathLike,
    to: str,
    anchor: PathLike | None,
    kind: str = "truth",
    time: str | None = None,
    columns: str | None = None,
) -> Path:
    """Export a table to the Earth.

    Parameters
    ----------
    table : path
        CSV.
    output : path
        File to write.
    to : str
        Format: "geojson", "gpkg", "kml", "gpx" or "csv".
    anchor : path
        TOML that ties the lane to the Earth.
    kind : str
        What the table holds: "alarms", "truth" or "objects".
    time : str, optional
        Time of the observation, ISO 8601 with a time zone.
    columns : str, optional
        Columns with other names, such as ``x=Rechts,y=Hoch``.

    Returns
    -------
    pathlib.Path
        The file.

    Raises
    ------
    ValueError
        If an input is not valid, or there is no anchor.
    FileExistsError
        If another file is at the output.
    """
    data = read_named(existing(table, f"{kind} file"))
    lane_anchor = needed_anchor(anchor, None, table)
    reading = None
    if columns is not None:
        reading = TableReading(parse_columns_option(columns), lane_anchor)
    rows = parse_table(data, kind, table, reading)
    # A table has no processing behind it that could be named: its own digest identifies it.
    identity = f"sha256:{sha256(data)}"
    return _write_points(rows, Path(output), to, lane_anchor, kind, identity, time)


def export_result(
    result: PathLike,
    output: PathLike,
    to: str,
    anchor: PathLike | None = None,
    detection: str = "main",
    time: str | None = None,
) -> Path:
    """Export the alarms of a result as points, or its run-view.

    Parameters
    ----------
    result : path
        Result folder.
    output : path
        File to write.
    to : str
        Format of points: "geojson", "gpkg", "kml", "gpx" or "csv"; of the run-view "geotiff".
    anchor : path, optional
        TOML that ties the lane to the Earth, by default the georeference of the run.
    detection : str
        "main" or the name of a variant.
    time : str, optional
        Time when the data were taken, ISO 8601 with a time zone.

    Returns
    -------
    pathlib.Path
        The file.

    Raises
    ------
    ValueError
        If the format or the detection is not known, or there is no georeference.
    FileExistsError
        If another file is at the output.
    """
    if to not in (*TABLE_FORMATS, "geotiff"):
        raise ValueError(f"to must be one of {', '.join((*TABLE_FORMATS, 'geotiff'))}, got {to!r}")
    loaded = read_result(result)
    chosen = named_detection(loaded, detection)
    identity = _processing_id(loaded)
    lane_anchor = needed_anchor(anchor, loaded.manifest["run"].get("georeference"), result)
    if to != "geotiff":
        target = Path(output)
        return _write_points(chosen.alarms, target, to, lane_anchor, "alarms", identity, time)
    target = check_parent_folder(output)
    with atomic_output(target) as partial:
        _write_view(loaded, chosen, partial, lane_anchor)
    return target


def export_imsma(
    source: PathLike,
    output: PathLike,
    anchor: PathLike | None,
    time: str | None,
    organisation: str | None = None,
    detection: str = "main",
    columns: str | None = None,
) -> Path:
    """Export alarms as a table of points for IMSMA, the information system of mine action.

    Parameters
    ----------
    source : path
        Result folder, or alarm list (CSV).
    output : path
        CSV to write.
    anchor : path, optional
        TOML that ties the lane to the Earth, by default the georeference of a result's run.
    time : str
        When the data were taken, ISO 8601 with a time zone.
    organisation : str, optional
        Who made the survey.
    detection : str
        "main" or the name of a variant of a result.
    columns : str, optional
        Columns of an alarm list with other names, such as ``x=Rechts,y=Hoch``.

    Returns
    -------
    pathlib.Path
        The file.

    Raises
    ------
    ValueError
        If an input is not valid, or there is no anchor or no time.
    FileExistsError
        If another file is at the output.
    """
    if time is None:
        raise ValueError(
            "imsma needs the time of the survey, which its minimum data hold: "
            "--time 2026-05-04T09:30:00Z"
        )
    rows, lane_anchor, identity = _alarms_on_earth(source, anchor, detection, columns)
    check_parent_folder(output)
    points = georeferenced.georeference(rows, lane_anchor, "alarms", identity, time)
    target = Path(output)
    with atomic_output(target) as partial:
        write_table(imsma_table(points, organisation or ""), partial)
    return target


def _alarms_on_earth(
    source: PathLike, anchor: PathLike | None, detection: str, columns: str | None
) -> tuple[pd.DataFrame, Anchor, str]:
    """Return alarms of a list or a result, the anchor of their lane, and what identifies them."""
    if Path(source).suffix == ".csv":
        data = read_named(existing(source, "alarms file"))
        lane_anchor = _imsma_anchor(anchor, None, source)
        reading = None
        if columns is not None:
            reading = TableReading(parse_columns_option(columns), lane_anchor)
        return parse_table(data, "alarms", source, reading), lane_anchor, f"sha256:{sha256(data)}"
    if columns is not None:
        raise ValueError("columns are of alarm lists: a result's list has its own")
    loaded = read_result(source)
    reference = loaded.manifest["run"].get("georeference")
    lane_anchor = _imsma_anchor(anchor, reference, source)
    return named_detection(loaded, detection).alarms, lane_anchor, _processing_id(loaded)


def _imsma_anchor(anchor: PathLike | None, reference: Any, source: PathLike) -> Anchor:
    """Return the anchor of a lane; without one a table for IMSMA cannot be made."""
    if anchor is None and reference is None:
        raise ValueError(
            f"{source}: imsma needs latitude and longitude, and nothing tells where this lane "
            "lies: give --anchor (flgpr anchor makes one from surveyed points)"
        )
    return needed_anchor(anchor, reference, source)


def export_qgis(
    result: PathLike,
    output: PathLike,
    anchor: PathLike | None = None,
    detection: str = "main",
    time: str | None = None,
    score: PathLike | None = None,
) -> Path:
    """Export a result as a zip with a project of QGIS and all its layers.

    The layers are the alarms, styled by confidence, the truth and objects if the result was scored
    with them, the lane's outline, and the run-view.

    Parameters
    ----------
    result : path
        Result folder.
    output : path
        Zip to write.
    anchor, detection, time
        As for :func:`export_result`.
    score : path, optional
        Folder of the result's score, if that is not the result itself.

    Returns
    -------
    pathlib.Path
        The file.

    Raises
    ------
    ValueError
        If the output does not end in .zip, or there is no georeference.
    FileExistsError
        If another file is at the output.
    """
    if Path(output).suffix != ".zip":
        raise ValueError(f"output must end in .zip, got {output}")
    target = check_parent_folder(output)

    loaded = read_result(result)
    chosen = named_detection(loaded, detection)
    identity = _processing_id(loaded)
    lane_anchor = needed_anchor(anchor, loaded.manifest["run"].get("georeference"), result)
    scored = read_scored_truth(loaded, None if score is None else Path(score))
    truth, objects = (None, None) if scored is None else scored
    tables = {"truth": truth, "alarms": chosen.alarms, "objects": objects}

    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        layers = []
        for kind, rows in tables.items():
            if rows is not None and len(rows):
                layers.append(_point_layer(rows, kind, folder, lane_anchor, identity, time))
        layers += _lane_layers(loaded, chosen, folder, lane_anchor)
        project = _project(loaded, chosen, lane_anchor, identity, layers)
        (folder / "lane.qgs").write_bytes(project)
        with (
            atomic_output(target) as partial,
            zipfile.ZipFile(partial, "w", zipfile.ZIP_DEFLATED) as bundle,
        ):
            for path in sorted(folder.iterdir()):
                # An entry without a time: the same map gives the same bytes.
                entry = zipfile.ZipInfo(f"{target.stem}/{path.name}")
                entry.external_attr = 0o644 << 16
                bundle.writestr(entry, path.read_bytes(), zipfile.ZIP_DEFLATED)
    return target


def _point_layer(
    rows: pd.DataFrame, kind: str, folder: Path, anchor: Anchor, identity: str, time: str | None
) -> qgis.MapLayer:
    """Write a table of points as GeoPackage and return its layer."""
    if kind in _POINT_COLOURS:
        style = qgis.by_kind(rows["kind"], _POINT_COLOURS[kind])
    else:
        style = qgis.graduated("confidence", rows["confidence"])
    points = georeferenced.georeference(rows, anchor, kind, identity, time)
    georeferenced.write_geopackage(points, folder / f"{kind}.gpkg", kind)
    return qgis.MapLayer(kind, f"{kind}.gpkg", "EPSG:4326", "Point", style)


def _lane_layers(
    result: Result, detection: Detection, folder: Path, anchor: Anchor
) -> Iterator[qgis.MapLayer]:
    """Write the outline of the lane and the run-view, and yield their layers."""
    georeferenced.write_outline(result.lane, folder / "lane.gpkg", anchor)
    yield qgis.MapLayer("lane", "lane.gpkg", "EPSG:4326", "Polygon", qgis.outline())
    _write_view(result, detection, folder / "run-view.tif", anchor)
    style = _shading(result, detection)
    yield qgis.MapLayer("run-view", "run-view.tif", anchor.utm(), "", style)


def _project(
    result: Result, detection: Detection, anchor: Anchor, identity: str, layers: list[qgis.MapLayer]
) -> bytes:
    """Return the project of QGIS, which shows the lane and some ground around it."""
    corners = anchor.to_geodetic(georeferenced.corners(result.lane))[:, :2]
    positions = transform_lonlat(corners, anchor.utm())
    lowest = positions.min(axis=0) - _MARGIN
    highest = positions.max(axis=0) + _MARGIN
    run_title = result.manifest["run"].get("title", result.folder.name)
    about = f"{georeferenced.STATEMENT} Processing {identity}."
    return qgis.project(
        f"{run_title}: {detection.title}", about, anchor.utm(), (*lowest, *highest), layers
    )


def map_bytes(result: Path, anchor: Path | None, score: Path | None) -> bytes:
    """Return the zip of :func:`export_qgis`, for the viewer.

    Parameters
    ----------
    result : Path
        Result folder.
    anchor : Path or None
        TOML that ties the lane to the Earth.
    score : Path or None
        Folder of the result's score.

    Returns
    -------
    bytes
        Content of the zip.
    """
    with tempfile.TemporaryDirectory() as folder:
        target = Path(folder) / f"{result.name}-map.zip"
        return export_qgis(result, target, anchor, score=score).read_bytes()


def _shading(result: Result, detection: Detection) -> ElementTree.Element:
    """Return the style of a run-view: the channel that raised the alarms, in shades of grey.

    They go from the median to the level that one pixel in 500 exceeds.
    """
    band = alarm_channel(result, detection)
    rows, columns = detection.view.shape[2:]
    values = detection.view.values.reshape(-1, rows, columns)[band]

    finite = values[np.isfinite(values)]
    low, high = np.quantile(finite, _SHADED_QUANTILES) if finite.size else (0.0, 1.0)
    return qgis.shaded(band + 1, float(low), float(high))


def alarm_channel(result: Result, detection: Detection) -> int:
    """Return the number of the channel, in the order of the run-view, that raised the alarms.

    The first one where the result does not say.
    """
    names = []
    for polarization in detection.view["polarization"].values:
        for subband in detection.view["subband"].values:
            names.append((str(polarization), str(subband)))
    channel = tuple(result.files().json("view/index.json")["channel"])
    return names.index(channel) if channel in names else 0


def named_detection(result: Result, name: str) -> Detection:
    """Return a detection of a result by its name."""
    for detection in result.detections:
        if detection.name == name:
            return detection
    known = ", ".join(detection.name for detection in result.detections)
    raise ValueError(f"detection must be one of {known}, got {name!r}")


def _processing_id(result: Result) -> str:
    """Return the id of the processing that every exported point has."""
    return f"{result.manifest['recipe_sha256'][:16]}-{result.manifest['identity'][:16]}"


def _write_view(result: Result, detection: Detection, path: Path, anchor: Anchor) -> None:
    """Write the run-view of a detection as GeoTIFF, with the digests of what it came from."""
    tags = {
        "flgpr_detection": detection.name,
        "flgpr_recipe_sha256": result.manifest["recipe_sha256"],
        "flgpr_result_identity": result.manifest["identity"],
    }
    georeferenced.write_geotiff(detection.view, path, anchor, _processing_id(result), tags=tags)


def _write_points(
    rows: pd.DataFrame,
    output: Path,
    to: str,
    anchor: Anchor,
    kind: str,
    identity: str,
    time: str | None,
) -> Path:
    """Write a table as points on the Earth, in a format."""
    if to not in TABLE_FORMATS:
        raise ValueError(f"to must be one of {', '.join(TABLE_FORMATS)}, got {to!r}")
    check_parent_folder(output)
    points = georeferenced.georeference(rows, anchor, kind, identity, time)
    with atomic_output(output) as partial:
        if to == "geojson":
            about = {
                "kind": kind,
                "anchor_crs": anchor.crs,
                "anchor_sigma_m": json_value(anchor.sigma),
                "processing_id": identity,
            }
            georeferenced.write_earth_geojson(points, partial, about)
        elif to == "gpkg":
            georeferenced.write_geopackage(points, partial, kind)
        elif to == "kml":
            georeferenced.write_kml(points, partial, f"{kind} {identity}")
        elif to == "gpx":
            georeferenced.write_gpx(points, partial)
        else:
            georeferenced.write_earth_csv(points, partial)
    return output
