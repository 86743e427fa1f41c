"""``flgpr import``: read other formats into a run."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from typer import Option

from flgpr.commands.options import AnchorOption, Output, PathLike, Paths, Point, size_in_bytes
from flgpr.commands.shell import Arguments, command, options_given

if TYPE_CHECKING:
    import pandas as pd

    from flgpr.formats.mapped import Imported

FromTrack = Annotated[
    bool,
    Option(
        "--anchor-from-track",
        help="Without an anchor: the first fix is the origin, the course is +y.",
    ),
]


@command()
def import_fullwave(
    archive: PathLike,
    output: Output,
) -> list[Path]:
    """Import a full-wave lane; its truth and objects, if known, are written beside the run.

    Parameters
    ----------
    archive
        NumPy archive (.npz) of a full-wave lane.

    Returns
    -------
    list of pathlib.Path
        What was written: the store, ``NAME-truth.csv`` and ``NAME-objects.csv``.

    Raises
    ------
    ValueError
        If the archive is not one of :func:`flgpr.formats.import_fullwave`.
    FileExistsError
        If another run is at the output.
    """
    from flgpr import formats
    from flgpr.commands.importing import store_with_tables

    lane = formats.import_fullwave(archive)
    return store_with_tables(lane.run, Path(output), {"truth": lane.truth, "objects": lane.objects})


_OF_TRACKS = (
    "clock_offset",
    "lever_arm",
    "latency",
    "max_gap",
    "above_ground",
    "body",
    "axes",
)


def _mapped_lines(imported: Imported, call: Arguments) -> Iterator[str | Path]:
    """Yield the notes of the import, and the store."""
    yield from imported.notes
    yield call.output


@command(
    lines=_mapped_lines,
    resumes=True,
)
def import_mapped(
    mapping: PathLike,
    output: Output,
    data: Paths | None = None,
    survey: PathLike | None = None,
    track: PathLike | None = None,
    anchor: AnchorOption = None,
    anchor_from_track: FromTrack = False,
    clock_offset: float = 0.0,
    lever_arm: Point = (
        0.0,
        0.0,
        0.0,
    ),
    latency: float = 0.0,
    max_memory: str | int = "2GB",
    body: str | None = None,
    axes: str | None = None,
    max_gap: float = 1.0,
    above_ground: float | None = None,
) -> Imported:
    """Import HDF5, MATLAB, NumPy, MCAP, CSV, Touchstone or SigMF files by a mapping.

    `flgpr info FILE` drafts a mapping.

    Parameters
    ----------
    mapping
        Mapping (TOML): which variable is what, in which unit.
    data
        Data file in place of the mapping's own; may repeat.
    max_memory
        Largest array that is read.

    Positions
    ---------
    survey
        CSV of surveyed poses, a line per scan.
    track
        CSV track, take of Motive, or NMEA log.
    anchor
    anchor_from_track
    clock_offset
        The track's clock less the radar's, s.
    lever_arm
        Positioning antenna in the vehicle frame, m: x y z.
    latency
        Delay of the track's time stamps, s.
    max_gap
        Longest gap in the fixes of a track that a scan may lie in, s.
    above_ground
        Height of an NMEA log's antenna above the ground, m, in place of the log's.

    OptiTrack Motive
    ----------------
    body
        Rigid body, if the track is a take of OptiTrack Motive.
    axes
        Motive's axes that are x, y, z of the lane, such as x,-z,y.

    Returns
    -------
    Imported
        Run, track and notes. A track is also written beside the run as ``NAME-track.csv``.

    Raises
    ------
    ValueError
        If mapping, data or positions break a rule.
    FileExistsError
        If another run is at the output.

    Notes
    -----
    An interrupted import resumes with the next scan.
    """
    asked = locals()
    from flgpr.commands.importing import check_parent_folder, store_mapped, track_and_anchor
    from flgpr.commands.positions import TrackReading
    from flgpr.formats.mapped import import_mapped as read_mapped
    from flgpr.formats.tracks import read_survey
    from flgpr.model.track import reference_track

    dropped = [name for name in options_given(import_mapped, asked) if name in _OF_TRACKS]
    if track is None and dropped:
        raise ValueError(
            f"{', '.join(dropped)}: these are of `track`, got none; those of the mapping's own "
            "track stand in its table"
        )
    target = check_parent_folder(output)
    fixes, lane_anchor, notes = track_and_anchor(
        track, anchor, anchor_from_track, TrackReading(body, axes, max_gap, above_ground)
    )
    poses = None if survey is None else read_survey(survey)
    imported = read_mapped(
        mapping,
        [Path(path) for path in data or ()],
        None,
        size_in_bytes(max_memory),
        poses,
        None if fixes is None else reference_track(fixes, lever_arm, latency),
        clock_offset,
        lane_anchor,
        anchor_from_track,
        max_gap,
    )
    imported.notes.extend(notes)
    if anchor_from_track and lane_anchor is None and imported.anchor is None:
        raise ValueError(
            "anchor-from-track needs fixes by longitude and latitude, the positions are none"
        )
    store_mapped(imported, target, imported.anchor or lane_anchor)
    return imported


def _table_lines(rows: pd.DataFrame, call: Arguments) -> Iterator[str | Path]:
    """Yield the number of rows and the file."""
    yield f"{len(rows)} rows"
    yield call.output


@command(lines=_table_lines)
def import_table(
    file: PathLike,
    output: Output,
    kind: str = "alarms",
    columns: str | None = None,
    anchor: AnchorOption = None,
) -> pd.DataFrame:
    """Read a table of alarms, truth or objects in any dialect, and write it as flgpr does.

    Parameters
    ----------
    file
        CSV of alarms, truth or objects, in any dialect.
    kind
        What it holds: alarms, truth or objects.
    columns
        Columns that have other names: x=Rechts,y=Hoch,confidence=Wert.
    anchor
        for longitude and latitude

    Returns
    -------
    pandas.DataFrame
        The table; ``attrs["notes"]`` state what the reader assumed or converted.

    Raises
    ------
    ValueError
        If the table breaks a rule.
    FileExistsError
        If another file is at the output.
    """
    from flgpr.commands.importing import check_parent_folder
    from flgpr.commands.positions import table_reading
    from flgpr.store.dialects import TableReading
    from flgpr.store.outputs import write_new
    from flgpr.store.tables import read_table
    from flgpr.store.writing import csv_text

    if kind not in ("alarms", "truth", "objects"):
        raise ValueError(f"kind must be alarms, truth or objects, got {kind!r}")
    target = check_parent_folder(output)
    rows = read_table(file, kind, table_reading(columns, anchor) or TableReading())
    write_new(target, csv_text(rows))
    return rows
