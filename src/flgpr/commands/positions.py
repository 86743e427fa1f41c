"""Anchors, tracks, columns of tables and recordings, read as options name them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pandas as pd
import xarray as xr

from flgpr.geo.anchor import Anchor, own_anchor, read_anchor
from flgpr.store.dialects import TableReading, parse_columns_option
from flgpr.store.files import existing
from flgpr.store.notes import log_note
from flgpr.types import PathLike


def read_optional_anchor(anchor: PathLike | Anchor | None) -> Anchor | None:
    """Read the file of an anchor; an anchor, or none, is returned as it is."""
    if anchor is None or isinstance(anchor, Anchor):
        return anchor
    return read_anchor(anchor)


def needed_anchor(
    anchor: PathLike | None, reference: Mapping[str, Any] | None, source: PathLike
) -> Anchor:
    """Read an anchor, or make one from the georeference of a run.

    Parameters
    ----------
    anchor : path or None
        TOML that ties the lane to the Earth.
    reference : mapping or None
        Attribute ``georeference`` of the run.
    source : path
        The run or result, for the error.

    Returns
    -------
    Anchor
        The anchor.

    Raises
    ------
    ValueError
        If there is neither.
    """
    if anchor is not None:
        return read_anchor(anchor)
    if reference is None:
        raise ValueError(f"{source}: nothing tells where its lane lies; give an `anchor`")
    return own_anchor(reference)


def tied_run(run: xr.Dataset, anchor: Anchor | None) -> xr.Dataset:
    """Return a run with the georeference of an anchor, for its results and the viewer."""
    return run if anchor is None else run.assign_attrs(georeference=anchor.georeference())


def table_reading(
    columns: str | None = None, anchor: PathLike | None = None, unranked: bool = False
) -> TableReading | None:
    """Return how a table is read; None where no option says anything of it.

    Parameters
    ----------
    columns : str, optional
        Columns with other names, such as ``x=Rechts,y=Hoch``.
    anchor : path, optional
        TOML that ties geographic positions to the lane.
    unranked : bool
        Whether alarms may lack confidences.

    Returns
    -------
    TableReading or None
        How it is read.
    """
    if columns is None and anchor is None and not unranked:
        return None
    names = {} if columns is None else parse_columns_option(columns)
    return TableReading(names, read_optional_anchor(anchor), unranked)


@dataclass(frozen=True)
class TrackReading:
    """How a user says a track is to be read."""

    body: str | None = None  #: of a take of OptiTrack Motive
    axes: str | None = None  #: of the take that are those of the lane, parted by commas
    max_gap: float = 1.0  #: longest gap of a take that is bridged, s
    #: height of the antenna of an NMEA log above the ground, m, in place of the log's
    above_ground: float | None = None


def track_of(
    path: Path, anchor: PathLike | Anchor | None, reading: TrackReading = TrackReading()
) -> pd.DataFrame:
    """Read a track from CSV (:func:`flgpr.formats.read_track`), or from an NMEA log.

    Parameters
    ----------
    path : Path
        The file.
    anchor : path, Anchor or None
        Ties positions on the Earth to the lane; an NMEA log needs it.
    reading : TrackReading
        What the user says of it.

    Returns
    -------
    pandas.DataFrame
        The track (:func:`flgpr.model.track.make_track`).

    Raises
    ------
    ValueError
        If the file is not valid, or an NMEA log has no anchor.
    """
    from flgpr.formats.tracks import read_nmea, read_track  # the readers of array files are slow

    height = reading.above_ground
    is_table = existing(path, "track").suffix.lower() == ".csv"
    if height is not None and (is_table or not height > 0):
        raise ValueError(
            f"above-ground must be the positive height of an NMEA log's antenna, m, got "
            f"{height:g} for {path}"
        )
    if is_table:
        axes = None if reading.axes is None else reading.axes.split(",")
        return read_track(path, "column", reading.body, axes, reading.max_gap)
    if reading.body is not None or reading.axes is not None:
        raise ValueError(f"{path}: body and axes are of takes of OptiTrack Motive, this is none")
    lane_anchor = read_optional_anchor(anchor)
    if lane_anchor is None:
        raise ValueError(
            f"{path}: a track of a satellite receiver needs an anchor to lie in the lane"
        )
    return read_nmea(path, lane_anchor, height=height)


def read_recorded(path: PathLike, anchor: PathLike | None = None) -> xr.Dataset:
    """Read the run of a recording that is named in place of a folder of scans.

    Parameters
    ----------
    path : path
        MCAP file with its mapping beside it, ``NAME.toml`` for ``NAME.mcap``; or the mapping of
        any recording.
    anchor : path, optional
        TOML that ties the lane to the Earth, for recordings with longitude and latitude.

    Returns
    -------
    Dataset
        The run.

    Raises
    ------
    ValueError
        If the file is neither, there is no mapping, or the recording does not fit it.
    """
    from flgpr.formats.mapped import import_mapped  # the readers of array files are slow

    file = Path(path)
    lane_anchor = read_optional_anchor(anchor)
    if file.suffix == ".toml":
        imported = import_mapped(file, anchor=lane_anchor)
    elif file.suffix == ".mcap":
        mapping = file.with_suffix(".toml")
        if not mapping.is_file():
            raise ValueError(
                f"{file}: a recording is read by a mapping, {mapping}, which does not exist: "
                f"flgpr info {file} drafts one"
            )
        imported = import_mapped(mapping, file, anchor=lane_anchor)
    else:
        raise ValueError(
            "incoming must be a folder that a radar writes into, a recording (.mcap) or a mapping "
            f"of one (.toml), got {file}"
        )
    for note in imported.notes:
        log_note(note)
    return imported.run
