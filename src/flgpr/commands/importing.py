"""What imports share: positions of runs, and storing of runs and the tables beside them."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import pandas as pd
import xarray as xr

from flgpr.commands.positions import TrackReading, read_optional_anchor, tied_run, track_of
from flgpr.formats import Imported, nmea_places
from flgpr.geo import Anchor, anchor_from_fixes
from flgpr.model.motion import judge_run
from flgpr.store import save_run, write_table
from flgpr.store.run_writer import is_stored
from flgpr.store.writing import write_table_pair
from flgpr.types import PathLike


def check_parent_folder(output: PathLike) -> Path:
    """Return the path of an output whose folder exists; else raise a FileNotFoundError."""
    path = Path(output)
    if not path.parent.is_dir():
        raise FileNotFoundError(f"the folder of the output must exist, got {path.parent}")
    return path


def finished_run(run: xr.Dataset, anchor: Anchor | None) -> xr.Dataset:
    """Return an imported run with its georeference, where an anchor states it, and with doubts.

    Positions that no vehicle reaches are told in ``import_notes``; all positions stay.
    """
    doubts = judge_run(run).notes()
    if doubts:
        run.attrs.setdefault("import_notes", []).extend(doubts)
    return tied_run(run, anchor)


def store_with_tables(
    run: xr.Dataset, store: Path, tables: Mapping[str, pd.DataFrame | None]
) -> list[Path]:
    """Store a run with tables beside it, such as ``NAME-truth.csv``.

    Parameters
    ----------
    run : xarray.Dataset
        The run.
    store : Path
        Run store to write.
    tables : mapping of str to pandas.DataFrame or None
        Tables by the end of their file names; None is not written.

    Returns
    -------
    list of Path
        What was written.
    """
    written = [store]
    # The tables come before the run, whose presence says that all is there.
    if not is_stored(run, store):
        store.parent.mkdir(parents=True, exist_ok=True)
        for name, table in tables.items():
            if table is not None:
                path = store.with_name(f"{store.stem}-{name}.csv")
                written.append(write_table_pair(table, path))
    # ``resume`` takes away what a killed writer left in a whole store.
    save_run(run, store, resume=True, share_files=True)
    return written


def track_and_anchor(
    track: PathLike | None,
    anchor: PathLike | None,
    anchor_from_track: bool,
    reading: TrackReading,
) -> tuple[pd.DataFrame | None, Anchor | None, list[str]]:
    """Read track and anchor of an import by mapping, as options name them.

    Parameters
    ----------
    track : path or None
        CSV, take of OptiTrack Motive or NMEA log.
    anchor : path or None
        TOML that ties the lane to the Earth.
    anchor_from_track : bool
        Whether the fixes of a log make their own anchor.
    reading : TrackReading
        What else the options say of the track.

    Returns
    -------
    track, anchor, notes
        What was read, and what was assumed of the anchor.
    """
    if anchor_from_track and anchor is not None:
        raise ValueError("anchor and anchor-from-track both say where the lane lies: give one")
    lane_anchor = read_optional_anchor(anchor)
    if track is None:
        return None, lane_anchor, []
    path = Path(track)
    notes: list[str] = []
    if anchor_from_track and path.suffix.lower() != ".csv":
        lane_anchor, notes = anchor_from_fixes(nmea_places(path))
    return track_of(path, lane_anchor, reading), lane_anchor, notes


def store_mapped(imported: Imported, store: Path, anchor: Anchor | None) -> None:
    """Store a run that was imported by a mapping, and its track beside it, if it has one."""
    run = finished_run(imported.run, anchor)
    # The track is written before the run, which marks a complete import.
    if imported.track is not None and not is_stored(run, store):
        write_table(imported.track, store.with_name(f"{store.stem}-track.csv"))
    save_run(run, store, resume=True, share_files=True)
