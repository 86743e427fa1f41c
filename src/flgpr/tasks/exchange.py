"""Import and export as functions: files in, files out."""

from __future__ import annotations

import tempfile
import zipfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd
import xarray as xr

from flgpr.chain.detection import Detection
from flgpr.door import read_named
from flgpr.formats import GprSection, gpr_run, nmea_places, read_gpr
from flgpr.formats.cphd import read_cphd, write_cphd
from flgpr.formats.mapped import Imported, import_mapped
from flgpr.formats.tracks import read_nmea, read_survey, read_track
from flgpr.geo import anchor_from_fixes, qgis
from flgpr.geo import export as georeferenced
from flgpr.geo.anchor import Anchor, own_anchor, read_anchor, transform_lonlat
from flgpr.model.motion import judge_run
from flgpr.model.track import reference_track
from flgpr.results.result import Result, read_result
from flgpr.results.score import read_scored_truth
from flgpr.store import MAX_MEMORY, open_run, save_run, sha256, write_table
from flgpr.store.dialects import TableReading, parse_columns_option
from flgpr.store.files import existing
from flgpr.store.outputs import whole_output, write_new
from flgpr.store.run_store import is_stored
from flgpr.store.tables import json_value, parse_table, read_table, table_text

if TYPE_CHECKING:
    from xml.etree import ElementTree

PathLike = str | Path
TABLE_FORMATS = ("geojson", "gpkg", "kml", "gpx", "csv")
FORMATS = (*TABLE_FORMATS, "geotiff", "qgis", "cphd")
_MARGIN = 5.0  # m of ground about the lane


def table_reading(
    columns: str | None = None, anchor: PathLike | None = None
) -> TableReading | None:
    """Make what a user says of a table: columns as ``x=Rechts,y=Hoch``, and the anchor (TOML) of its places."""
    if columns is None and anchor is None:
        return None
    return TableReading({} if columns is None else parse_columns_option(columns), _anchor(anchor))


def write_draft(mapping: str, output: PathLike) -> Path:
    """Write the draft of a mapping (TOML); another file there is refused."""
    target = Path(output)
    _check_home(target)
    write_new(target, mapping)
    return target


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
    anchor_from_track: bool = False,
) -> Imported:
    """Import data files by a mapping (TOML) and store the run; a stopped import goes on with the scan it was at.

    It gives run, track and notes; a track is also written beside the run as ``NAME-track.csv``. ``data`` stand in place
    of the mapping's files. Poses may come from ``survey``, CSV as :func:`flgpr.formats.read_survey` takes it, or from
    ``track``, CSV or an NMEA log, which needs the ``anchor`` (TOML): then ``clock_offset`` is the track's clock less
    the radar's, s, ``latency`` how late its stamps are, s, and ``lever_arm`` the antenna's place in the vehicle frame,
    m. A take of motion capture is read before, by :func:`flgpr.formats.read_track`. ``max_memory``
    is the largest array that is read, bytes. With ``anchor_from_track`` fixes by longitude and
    latitude need no ``anchor``: they make their own (:func:`flgpr.geo.anchor_from_fixes`),
    which the run knows as its place.
    """
    _check_home(Path(output))
    tie: PathLike | Anchor | None = anchor
    made_of: list[str] = []
    if anchor_from_track:
        _refuse_two_anchors(anchor)
        if (
            track is not None
            and not isinstance(track, pd.DataFrame)
            and Path(track).suffix.lower() != ".csv"
        ):
            tie, made_of = anchor_from_fixes(nmea_places(track))
    pose = read_survey(survey) if survey is not None else None
    moved = None
    if track is not None:
        way = track if isinstance(track, pd.DataFrame) else track_of(Path(track), tie)
        moved = reference_track(way, lever_arm, latency)
    files = [Path(one) for one in data or ()]
    arrived = import_mapped(
        mapping, files, None, max_memory, pose, moved, clock_offset, _anchor(tie), anchor_from_track
    )
    arrived.notes.extend(made_of)
    if anchor_from_track and tie is None and arrived.anchor is None:
        raise ValueError(
            "anchor-from-track needs fixes by longitude and latitude, the positions are none"
        )
    store = Path(output)
    run = _tied(_with_doubts(arrived.run), arrived.anchor or tie)
    if arrived.track is not None and not is_stored(
        run, store
    ):  # before the run, whose presence says that all is there
        write_table(arrived.track, store.with_name(f"{store.stem}-track.csv"))
    save_run(run, store, resume=True)
    return arrived


def import_cphd(path: PathLike, output: PathLike, anchor: PathLike | None = None) -> xr.Dataset:
    """Import a CPHD file and store the run; files of other makers need the anchor. Another store there is refused."""
    _check_home(Path(output))
    run = _tied(_with_doubts(read_cphd(path, _anchor(anchor))), anchor)
    save_run(run, output, resume=True)
    return run


def import_gpr(
    path: PathLike,
    output: PathLike,
    channel: int = 0,
    anchor: PathLike | None = None,
    max_memory: int = MAX_MEMORY,
    anchor_from_track: bool = False,
    **options: Any,
) -> xr.Dataset:
    """Import the recording of a commercial radar (:func:`flgpr.formats.read_gpr`) and store the run.

    ``options`` are those of :func:`flgpr.formats.gpr_run`: ``step``, ``time_zero``, ``window``,
    ``band``, ``separation``, ``across``, ``height``, ``polarization``. With
    ``anchor_from_track`` the receiver's fixes of the line put its traces in a lane of their own
    (:func:`flgpr.geo.anchor_from_fixes`). A store that holds another run is refused.
    """
    _check_home(Path(output))
    section = read_gpr(path, max_memory)
    tie: Anchor | None
    made_of: list[str] = []
    if anchor_from_track:
        _refuse_two_anchors(anchor)
        tie, made_of = anchor_of_line(section)
    else:
        tie = _anchor(anchor)
    made = gpr_run(section, channel, anchor=tie, **options)
    made.attrs["import_notes"] = [*made.attrs["import_notes"], *made_of]
    run = _tied(_with_doubts(made), tie)
    save_run(run, output, resume=True)
    return run


def anchor_of_line(section: GprSection) -> tuple[Anchor, list[str]]:
    """Make the anchor of a line's own fixes, with notes; a line without two of them is a ValueError."""
    try:
        return anchor_from_fixes(section.fixes[:, 1:], section.fixes[:, 0])
    except ValueError as error:
        raise ValueError(f"{section.path}: {error}") from None


def _refuse_two_anchors(anchor: PathLike | Anchor | None) -> None:
    if anchor is not None:
        raise ValueError("anchor and anchor-from-track both say where the lane lies: give one")


def _with_doubts(run: xr.Dataset) -> xr.Dataset:
    """Note in ``import_notes`` what positions no vehicle reaches; all of them are kept."""
    doubts = judge_run(run).notes()
    if doubts:
        run.attrs.setdefault("import_notes", []).extend(doubts)
    return run


def export_run(run: PathLike, output: PathLike, anchor: PathLike | None = None) -> Path:
    """Export a stored run as CPHD; another file there is refused.

    ``anchor`` (TOML) ties the lane to the Earth, else what the run tells of its place.
    """
    _check_home(Path(output))
    held = open_run(run)
    with whole_output(Path(output)) as made:
        write_cphd(held, made, _tie(anchor, held.attrs.get("georeference"), run))
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
    tie = _tie(anchor, None, table)
    reading = None if columns is None else TableReading(parse_columns_option(columns), tie)
    rows = parse_table(data, kind, table, reading)
    digest = sha256(data)
    return _write_points(rows, Path(output), to, tie, kind, f"sha256:{digest}", time)


def import_table(
    table: PathLike,
    output: PathLike,
    kind: str,
    columns: str | None = None,
    anchor: PathLike | None = None,
) -> pd.DataFrame:
    """Read alarms, truth or objects (``kind``) as others write them, and write the CSV that flgpr reads.

    Another file at the output's place is refused. The table's ``attrs["notes"]`` say what was read otherwise than it
    stands.
    """
    if kind not in ("alarms", "truth", "objects"):
        raise ValueError(f"kind must be alarms, truth or objects, got {kind!r}")
    _check_home(Path(output))
    rows = read_table(table, kind, table_reading(columns, anchor) or TableReading())
    write_new(Path(output), table_text(rows))
    return rows


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
    tie = _tie(anchor, held.manifest["run"].get("georeference"), result)
    if to == "geotiff":
        _check_home(target)
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
    _check_home(target)
    held, chosen, identity = _chosen(result, detection)
    tie = _tie(anchor, held.manifest["run"].get("georeference"), result)
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
    _check_home(output)
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


def track_of(
    path: Path,
    anchor: PathLike | Anchor | None,
    body: str | None = None,
    axes: Sequence[str] | None = None,
    max_gap: float = 1.0,
) -> pd.DataFrame:
    """Return a track from CSV (:func:`flgpr.formats.read_track`) or from an NMEA log and its anchor."""
    if existing(path, "track").suffix.lower() == ".csv":
        return read_track(path, "column", body, axes, max_gap)
    tie = _anchor(anchor)
    if tie is None:
        raise ValueError(
            f"{path}: a track of a satellite receiver needs an anchor to lie in the lane"
        )
    return read_nmea(path, tie)


def _tied(run: xr.Dataset, anchor: PathLike | Anchor | None) -> xr.Dataset:
    """Let a run remember where its lane lies, so that results and the viewer know it too."""
    tie = _anchor(anchor)
    return run if tie is None else run.assign_attrs(georeference=tie.georeference())


def _anchor(anchor: PathLike | Anchor | None) -> Anchor | None:
    """Read an anchor's file; one that is made already is taken as it is."""
    return anchor if anchor is None or isinstance(anchor, Anchor) else read_anchor(anchor)


def _tie(anchor: PathLike | None, reference: Mapping[str, Any] | None, source: PathLike) -> Anchor:
    """Read an anchor, or make it of what a run told of its place."""
    if anchor is not None:
        return read_anchor(anchor)
    if reference is None:
        raise ValueError(f"{source}: it does not tell where its lane lies; an anchor is needed")
    return own_anchor(reference)


def _check_home(path: Path) -> None:
    if not path.parent.is_dir():
        raise FileNotFoundError(f"the folder of the output must exist, got {path.parent}")
