"""Export of alarms, truth, run-views and runs, on the Earth, for other programs."""

from __future__ import annotations

import itertools
import tempfile
import zipfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from flgpr.commands.exports import Wish
from flgpr.commands.importing import check_parent_folder
from flgpr.commands.positions import needed_anchor
from flgpr.door import read_named
from flgpr.geo.anchor import Anchor
from flgpr.geo.geodesy import transform_lonlat
from flgpr.geo.geotiff import write_geotiff
from flgpr.geo.points import STATEMENT, georeference, write_earth_csv, write_earth_geojson
from flgpr.method.detection import MAIN, Detection
from flgpr.model.run import polarizations_of
from flgpr.results.result import Result, read_result
from flgpr.results.score import read_scored_truth
from flgpr.store import open_run, sha256
from flgpr.store.dialects import TableReading, parse_columns_option
from flgpr.store.files import existing
from flgpr.store.outputs import atomic_output
from flgpr.store.tables import parse_table
from flgpr.store.text import zoned_time
from flgpr.store.writing import json_value, write_table
from flgpr.types import AnyArray
from flgpr_exchange.cphd.phase_history import write_cphd
from flgpr_exchange.maps import qgis
from flgpr_exchange.maps.imsma import imsma_table
from flgpr_exchange.maps.points import (
    corners,
    write_geopackage,
    write_gpx,
    write_kml,
    write_outline,
)
from flgpr_exchange.sigmf.writing import write_sigmf

_MARGIN = 5.0  # m of ground around the lane
_POINT_COLOURS = {"truth": "#d7263d", "objects": "#707070"}
_SHADED_QUANTILES = (0.5, 0.998)


_GOES_WITH = {
    "kind": "a table of points",
    "columns": "a table",
    "detection": "a result",
    "time": "points, maps and recordings",
    "score": "qgis",
    "organisation": "imsma",
}
"""What the options of an export that not every format takes go with."""


def output_of(wish: Wish, *taken: str) -> Path:
    """Return the path to write; options other than those that are taken are refused."""
    for name, place in _GOES_WITH.items():
        if getattr(wish, name) is not None and name not in taken:
            raise ValueError(f"{name} goes with {place}, got to {wish.to!r} of {wish.source}")
    return check_parent_folder(wish.output)


def _is_table(wish: Wish) -> bool:
    """Return whether a table, not a result, is exported."""
    return Path(wish.source).suffix.lower() == ".csv"


def export_run(wish: Wish) -> Path:
    """Export a stored run as CPHD; it must have a place on the Earth."""
    target = output_of(wish, "time")
    begin = None if wish.time is None else moment_of(wish.time)
    run = open_run(wish.source)
    anchor = needed_anchor(wish.anchor, run.attrs.get("georeference"), wish.source)
    with atomic_output(target) as partial:
        write_cphd(run, partial, anchor, begin=begin)
    return target


def export_sigmf(wish: Wish) -> Path:
    """Export a stored run as a folder of a SigMF recording, with a mapping that takes it back.

    Without an anchor, its own or another, the recording has no places, and without a time of the
    first scan it has no dates.
    """
    target = output_of(wish, "time")
    begin = None if wish.time is None else moment_of(wish.time)
    run = open_run(wish.source)
    reference = run.attrs.get("georeference")
    anchor = None
    if wish.anchor is not None or reference is not None:
        anchor = needed_anchor(wish.anchor, reference, wish.source)
    return write_sigmf(run, target, anchor, begin)


def moment_of(time: str, limits: str = "") -> datetime:
    """Return a time of ISO 8601 with a time zone; ``limits`` are what the error says besides."""
    moment = zoned_time(time)
    if moment is None:
        raise ValueError(f"time must be ISO 8601 with a time zone{limits}, got {time!r}")
    return moment


@dataclass(frozen=True)
class _Rows:
    """Rows of a table and where their lane lies."""

    table: pd.DataFrame
    kind: str  #: "alarms", "truth" or "objects"
    anchor: Anchor
    identity: str  #: of what they came from

    def points(self, time: str | None) -> pd.DataFrame:
        """Return them as points on the Earth."""
        return georeference(self.table, self.anchor, self.kind, self.identity, time)


def export_points(wish: Wish) -> Path:
    """Export the alarms of a result, or a table, as points on the Earth."""
    target = output_of(wish, "time", *(("kind", "columns") if _is_table(wish) else ("detection",)))
    rows = _rows_of(wish, wish.kind or "truth")
    points = rows.points(wish.time)
    about = {
        "kind": rows.kind,
        "anchor_crs": rows.anchor.crs,
        "anchor_sigma_m": json_value(rows.anchor.sigma),
        "processing_id": rows.identity,
    }
    writers: dict[str, Callable[[Path], None]] = {
        "geojson": lambda path: write_earth_geojson(points, path, about),
        "gpkg": lambda path: write_geopackage(points, path, rows.kind),
        "kml": lambda path: write_kml(points, path, f"{rows.kind} {rows.identity}"),
        "gpx": lambda path: write_gpx(points, path),
        "csv": lambda path: write_earth_csv(points, path),
    }
    with atomic_output(target) as partial:
        writers[wish.to](partial)
    return target


def export_imsma(wish: Wish) -> Path:
    """Export alarms as a table of points for IMSMA, the information system of mine action."""
    of_source = "columns" if _is_table(wish) else "detection"
    target = output_of(wish, "organisation", "time", of_source)
    if wish.time is None:
        raise ValueError(
            "imsma needs the time of the survey, which its minimum data hold: "
            "`time` 2026-05-04T09:30:00Z"
        )
    points = _rows_of(wish, "alarms").points(wish.time)
    with atomic_output(target) as partial:
        write_table(imsma_table(points, wish.organisation or ""), partial)
    return target


def _parsed(
    data: bytes, kind: str, source: str | Path, reading: TableReading | None
) -> pd.DataFrame:
    """Parse a table of a kind; the error of one that is of another kind names the option."""
    try:
        return parse_table(data, kind, source, reading)
    except ValueError as error:
        message = str(error).replace("`truth_columns`", "`columns`")  # that of a score
        for other in ("alarms", "truth", "objects"):
            try:
                parse_table(data, other, source, reading)
            except ValueError:
                continue
            message += f": it reads as {other}, give `kind` {other}"
            break
        raise ValueError(message) from None


def _rows_of(wish: Wish, kind: str) -> _Rows:
    """Return the rows of a table (CSV) of a kind, or the alarms of a result."""
    if not _is_table(wish):
        loaded, chosen, anchor = _result_of(wish)
        return _Rows(chosen.alarms, "alarms", anchor, _processing_id(loaded))
    data = read_named(existing(wish.source, f"{kind} file"))
    anchor = _anchor_of(wish, None)
    reading = None
    if wish.columns is not None:
        reading = TableReading(parse_columns_option(wish.columns), anchor)
    rows = _parsed(data, kind, wish.source, reading)
    # A table has no processing behind it that could be named: its own digest identifies it.
    return _Rows(rows, kind, anchor, f"sha256:{sha256(data)}")


def _result_of(wish: Wish) -> tuple[Result, Detection, Anchor]:
    """Return a result, the detection of it that is asked for, and the anchor of its lane."""
    loaded = read_result(wish.source)
    chosen = named_detection(loaded, wish.detection or MAIN)
    return loaded, chosen, _anchor_of(wish, loaded.manifest["run"].get("georeference"))


def _anchor_of(wish: Wish, reference: Any) -> Anchor:
    """Return the anchor of a lane; without one points on the Earth cannot be made."""
    if wish.to == "imsma" and wish.anchor is None and reference is None:
        raise ValueError(
            f"{wish.source}: imsma needs latitude and longitude, and nothing tells where this lane "
            "lies: give `anchor` (`flgpr anchor` makes one from surveyed points)"
        )
    return needed_anchor(wish.anchor, reference, wish.source)


def export_view(wish: Wish) -> Path:
    """Export the run-view of a result as GeoTIFF."""
    target = output_of(wish, "detection")
    if _is_table(wish):
        raise ValueError(f"to must be one of geojson, gpkg, kml, gpx, csv, got {wish.to!r}")
    loaded, chosen, anchor = _result_of(wish)
    with atomic_output(target) as partial:
        _write_view(loaded, chosen, partial, anchor)
    return target


def export_qgis(wish: Wish) -> Path:
    """Export a result as a zip with a project of QGIS and all its layers.

    The layers are the alarms, styled by confidence, the truth and objects if the result was scored
    with them, the lane's outline, and the run-view.
    """
    target = output_of(wish, "score", "time", "detection")
    if target.suffix != ".zip":
        raise ValueError(f"output must end in .zip, got {wish.output}")

    loaded, chosen, anchor = _result_of(wish)
    identity = _processing_id(loaded)
    scored = read_scored_truth(loaded, None if wish.score is None else Path(wish.score))
    truth, objects = (None, None) if scored is None else scored
    tables = {"truth": truth, "alarms": chosen.alarms, "objects": objects}

    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        layers = []
        for kind, table in tables.items():
            if table is None or not len(table):
                continue
            points = _Rows(table, kind, anchor, identity).points(wish.time)
            write_geopackage(points, folder / f"{kind}.gpkg", kind)
            style: qgis.ByKind | qgis.Graduated
            if kind in _POINT_COLOURS:
                style = qgis.by_kind(table["kind"], _POINT_COLOURS[kind])
            else:
                style = qgis.graduated("confidence", table["confidence"])
            layers.append(qgis.MapLayer(kind, f"{kind}.gpkg", "EPSG:4326", "Point", style))
        layers += _lane_layers(loaded, chosen, folder, anchor)
        project = _project(loaded, chosen, anchor, identity, layers)
        (folder / "lane.qgs").write_bytes(project)
        with atomic_output(target) as partial:
            _pack(folder, partial, target.stem)
    return target


def _pack(folder: Path, path: Path, name: str) -> None:
    """Write the files of a folder as a zip; the same files give the same bytes."""
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as bundle:
        for file in sorted(folder.iterdir()):
            entry = zipfile.ZipInfo(f"{name}/{file.name}")  # without a time
            entry.external_attr = 0o644 << 16
            bundle.writestr(entry, file.read_bytes(), zipfile.ZIP_DEFLATED)


def _lane_layers(
    result: Result, detection: Detection, folder: Path, anchor: Anchor
) -> Iterator[qgis.MapLayer]:
    """Write the outline of the lane and the run-view, and yield their layers."""
    write_outline(result.lane, folder / "lane.gpkg", anchor)
    yield qgis.MapLayer("lane", "lane.gpkg", "EPSG:4326", "Polygon", qgis.Outline())
    _write_view(result, detection, folder / "run-view.tif", anchor)
    # The channel that raised the alarms, from the median to what one pixel in 500 exceeds.
    band = alarm_channel(result, detection)
    levels = channel_levels(detection, band)
    finite = levels[np.isfinite(levels)]
    low, high = np.quantile(finite, _SHADED_QUANTILES) if finite.size else (0.0, 1.0)
    style = qgis.Shaded(band + 1, float(low), float(high))
    yield qgis.MapLayer("run-view", "run-view.tif", anchor.utm(), "", style)


def _project(
    result: Result, detection: Detection, anchor: Anchor, identity: str, layers: list[qgis.MapLayer]
) -> bytes:
    """Return the project of QGIS, which shows the lane and some ground around it."""
    on_earth = anchor.to_geodetic(corners(result.lane))[:, :2]
    positions = transform_lonlat(on_earth, anchor.utm())
    lowest = positions.min(axis=0) - _MARGIN
    highest = positions.max(axis=0) + _MARGIN
    run_title = result.manifest["run"].get("title", result.folder.name)
    about = f"{STATEMENT} Processing {identity}."
    return qgis.project(
        f"{run_title}: {detection.title}", about, anchor.utm(), (*lowest, *highest), layers
    )


def channel_levels(detection: Detection, number: int) -> AnyArray:
    """Return the run-view (y, x) of a channel, by its number in the order of the run-view."""
    return detection.view.values.reshape(-1, *detection.view.shape[2:])[number]


def alarm_channel(result: Result, detection: Detection) -> int:
    """Return the number of the channel, in the order of the run-view, that raised the alarms.

    The first one where the result does not say.
    """
    subbands = detection.view["subband"].values.astype(str)
    channels = itertools.product(polarizations_of(detection.view), subbands)
    raised = tuple(result.files().json("view/index.json")["channel"])
    return next((number for number, one in enumerate(channels) if one == raised), 0)


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
    write_geotiff(detection.view, path, anchor, _processing_id(result), tags=tags)
