"""``flgpr import``: read other formats into a run."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from typer import Argument, Option

from flgpr.commands.options import (
    AnchorOption,
    Output,
    PathLike,
    Paths,
    Point,
    Progress,
    anchor_option,
    one_or_more,
    size_in_bytes,
)
from flgpr.commands.shell import Arguments, command

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

    from flgpr.formats.mapped import Imported

FromTrack = Annotated[
    bool,
    Option(
        "--anchor-from-track",
        help="Without an anchor: the first fix is the origin, the course is +y.",
    ),
]


def _written_lines(written: list[Path], _: Arguments) -> Iterator[Path]:
    """Yield the files that were written."""
    yield from written


@command(lines=_written_lines)
def import_fullwave(
    archive: Annotated[PathLike, Argument(help="NumPy archive (.npz) of a full-wave lane.")],
    output: Output,
) -> list[Path]:
    """Import a full-wave lane; its truth and objects, if known, are written beside the run.

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


@command(
    lines=_written_lines,
    panels={
        "Result files": (
            "band",
            "transmit",
            "ground",
            "horizontal",
            "vertical",
            "waveform",
            "centre",
        ),
    },
    resumes=True,
)
def import_gprmax(
    source: Annotated[
        Paths,
        Argument(help="Folder of decks that flgpr wrote, with all results, or result files."),
    ],
    output: Output,
    keep_direct: Annotated[
        bool, Option("--keep-direct", help="Folder: leave the direct wave in the data.")
    ] = False,
    band: Annotated[
        tuple[float, float] | None, Option(help="Files: first and last tone, Hz.")
    ] = None,
    transmit: Annotated[
        str | None, Option(help="Files: polarization of the source, H or V.")
    ] = None,
    ground: Annotated[
        float | None, Option(help="Files: height of the ground in the model, m.")
    ] = None,
    horizontal: Annotated[
        str, Option("--h", help="Files: component of the field that is H.")
    ] = "x",
    vertical: Annotated[str, Option("--v", help="Files: component of the field that is V.")] = "z",
    waveform: Annotated[
        str | None, Option(help="Files of gprMax 3: the waveform, such as gaussiandotnorm.")
    ] = None,
    centre: Annotated[
        float | None, Option(help="Files of gprMax 3: the waveform's frequency, Hz.")
    ] = None,
    *,
    track: Progress = None,
) -> list[Path]:
    """Import gprMax results: a folder of decks that flgpr wrote, or other files, one per scan.

    Returns
    -------
    list of pathlib.Path
        What was written: the store, and for a folder truth, objects and lane beside it.

    Raises
    ------
    ValueError
        If a result is missing or does not fit, or options do not go together.
    FileExistsError
        If another run is at the output.
    """
    from flgpr.commands.importing import import_gprmax_decks
    from flgpr.formats.gprmax_files import GprmaxSetup, import_gprmax_files
    from flgpr.progress import silent
    from flgpr.store import save_run
    from flgpr.store.notes import log_note

    sources = [Path(path) for path in one_or_more(source)]
    if len(sources) == 1 and sources[0].is_dir():
        return import_gprmax_decks(sources[0], output, keep_direct, track or silent)
    for path in sources:
        if not path.exists():
            raise FileNotFoundError(f"file not found: {path}")
    if band is None or transmit is None or ground is None:
        raise ValueError(
            "result files need --band, --transmit and --ground, which they do not hold"
        )
    if (waveform is None) != (centre is None):
        raise ValueError("--waveform and --centre go together")
    pulse = None if waveform is None or centre is None else (waveform, centre)
    stated = GprmaxSetup(band, transmit, ground, horizontal, vertical, pulse)
    run = import_gprmax_files(sources, stated)
    for import_note in run.attrs["import_notes"]:
        log_note(import_note)
    return [save_run(run, output, resume=True)]


def _mapped_lines(imported: Imported, call: Arguments) -> Iterator[str | Path]:
    """Yield the notes of the import, and the store."""
    yield from imported.notes
    yield call.output


@command(
    lines=_mapped_lines,
    panels={
        "Positions": (
            "survey",
            "track",
            "anchor",
            "anchor_from_track",
            "clock_offset",
            "lever_arm",
            "latency",
            "max_gap",
        ),
        "OptiTrack Motive": ("body", "axes"),
    },
    resumes=True,
)
def import_mapped(
    mapping: Annotated[
        PathLike, Argument(help="Mapping (TOML): which variable is what, in which unit.")
    ],
    output: Output,
    data: Annotated[
        Paths | None, Option(help="Data file in place of the mapping's own; may repeat.")
    ] = None,
    survey: Annotated[
        PathLike | None, Option(help="CSV of surveyed poses, a line per scan.")
    ] = None,
    track: Annotated[
        PathLike | None, Option(help="CSV track, take of Motive, or NMEA log.")
    ] = None,
    anchor: AnchorOption = None,
    anchor_from_track: FromTrack = False,
    clock_offset: Annotated[float, Option(help="The track's clock less the radar's, s.")] = 0.0,
    lever_arm: Annotated[
        Point, Option(help="Positioning antenna in the vehicle frame, m: x y z.")
    ] = (0.0, 0.0, 0.0),
    latency: Annotated[float, Option(help="Delay of the track's time stamps, s.")] = 0.0,
    max_memory: Annotated[str | int, Option(help="Largest array that is read.")] = "2GB",
    body: Annotated[
        str | None, Option(help="Rigid body, if the track is a take of OptiTrack Motive.")
    ] = None,
    axes: Annotated[
        str | None, Option(help="Motive's axes that are x, y, z of the lane, such as x,-z,y.")
    ] = None,
    max_gap: Annotated[float, Option(help="Longest gap in the fixes of a track, s.")] = 1.0,
) -> Imported:
    """Import HDF5, MATLAB, NumPy, MCAP, CSV, Touchstone or SigMF files by a mapping.

    `flgpr info FILE` drafts a mapping.

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
    from flgpr.commands.importing import MappedPositions, check_parent_folder, store_mapped
    from flgpr.formats.mapped import import_mapped as read_mapped
    from flgpr.formats.tracks import read_survey

    target = check_parent_folder(output)
    positions = MappedPositions(track, anchor, anchor_from_track, body, axes, max_gap)
    poses = None if survey is None else read_survey(survey)
    imported = read_mapped(
        mapping,
        [Path(path) for path in data or ()],
        None,
        size_in_bytes(max_memory),
        poses,
        positions.moved_track(lever_arm, latency),
        clock_offset,
        positions.anchor,
        anchor_from_track,
    )
    imported.notes.extend(positions.notes)
    if anchor_from_track and positions.anchor is None and imported.anchor is None:
        raise ValueError(
            "anchor-from-track needs fixes by longitude and latitude, the positions are none"
        )
    store_mapped(imported, target, imported.anchor or positions.anchor)
    return imported


def _table_lines(rows: pd.DataFrame, call: Arguments) -> Iterator[str | Path]:
    """Yield the number of rows and the file."""
    yield f"{len(rows)} rows"
    yield call.output


@command(lines=_table_lines)
def import_table(
    file: Annotated[PathLike, Argument(help="CSV of alarms, truth or objects, in any dialect.")],
    output: Output,
    kind: Annotated[str, Option(help="What it holds: alarms, truth or objects.")] = "alarms",
    columns: Annotated[
        str | None, Option(help="Columns that have other names: x=Rechts,y=Hoch,confidence=Wert.")
    ] = None,
    anchor: Annotated[
        PathLike | None,
        anchor_option("for longitude and latitude"),
    ] = None,
) -> pd.DataFrame:
    """Read a table of alarms, truth or objects in any dialect, and write it as flgpr does.

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
    from flgpr.store.tables import csv_text, read_table

    if kind not in ("alarms", "truth", "objects"):
        raise ValueError(f"kind must be alarms, truth or objects, got {kind!r}")
    target = check_parent_folder(output)
    rows = read_table(file, kind, table_reading(columns, anchor) or TableReading())
    write_new(target, csv_text(rows))
    return rows


def _run_lines(run: xr.Dataset, call: Arguments) -> Iterator[str | Path]:
    """Yield what was assumed, replaced or left out, and the store."""
    for import_note in run.attrs.get("import_notes", []):
        yield f"note: {import_note}"
    yield call.output


@command(lines=_run_lines)
def import_cphd(
    file: Annotated[PathLike, Argument(help="CPHD file.")],
    output: Output,
    anchor: AnchorOption = None,
) -> xr.Dataset:
    """Import a CPHD file.

    Returns
    -------
    xarray.Dataset
        The run that was stored.

    Raises
    ------
    ValueError
        If the file cannot be read, or was not written by flgpr and no anchor is given.
    FileExistsError
        If another run is at the output.
    """
    from flgpr.commands.importing import check_parent_folder, with_doubts
    from flgpr.commands.positions import read_optional_anchor, tied_run
    from flgpr.formats.cphd import read_cphd
    from flgpr.store import save_run

    target = check_parent_folder(output)
    lane_anchor = read_optional_anchor(anchor)
    run = tied_run(with_doubts(read_cphd(file, lane_anchor)), lane_anchor)
    save_run(run, target, resume=True)
    return run


@command(
    lines=_run_lines,
    panels={
        "Header": ("channel", "step", "time_zero", "window", "band"),
        "Antennas": ("separation", "across", "height", "polarization"),
        "Positions": ("anchor", "anchor_from_track", "topography", "mark_spacing"),
        "Several lines or channels": (
            "all_channels",
            "channel_x",
            "line_spacing",
            "zigzag",
            "lines",
        ),
    },
)
def import_gpr(
    file: Annotated[
        Paths,
        Argument(
            help="Recording: .dt1, .dzt, .rd3, .rd7, .iprb, .dt, .sgy, .segy, .su or .ogpr; "
            "several make a survey."
        ),
    ],
    output: Output,
    channel: Annotated[int, Option(help="Channel of a file that has several, from 0.")] = 0,
    step: Annotated[
        float | None, Option(help="Trace spacing, m, in place of the header's.")
    ] = None,
    time_zero: Annotated[float | None, Option(help="Time zero, ns after the first sample.")] = None,
    window: Annotated[
        float | None, Option(help="Time window, ns, in place of the header's.")
    ] = None,
    band: Annotated[
        tuple[float, float] | None, Option(help="First and last frequency to keep, Hz.")
    ] = None,
    separation: Annotated[float | None, Option(help="Between transmitter and receiver, m.")] = None,
    across: Annotated[
        bool, Option("--across", help="The antennas lie side by side, not along the line.")
    ] = False,
    height: Annotated[
        float, Option(help="Antennas over the ground, m; 0 is coupled to the ground.")
    ] = 0.0,
    polarization: Annotated[str, Option(help="HH (dipoles across the line), HV, VH or VV.")] = "HH",
    anchor: AnchorOption = None,
    anchor_from_track: FromTrack = False,
    topography: Annotated[
        bool, Option("--topography", help="With an anchor: put the line on the receiver's heights.")
    ] = False,
    all_channels: Annotated[
        bool, Option("--all-channels", help="All channels in one run, a pair each.")
    ] = False,
    channel_x: Annotated[
        Sequence[float] | None,
        Option(help="Position of a channel's antennas across the line, m; once per channel."),
    ] = None,
    mark_spacing: Annotated[
        float | None, Option(help="Spacing of the marks, m, from which distances are computed.")
    ] = None,
    line_spacing: Annotated[
        float | None, Option(help="Several lines: parallel, at this distance, m.")
    ] = None,
    zigzag: Annotated[
        bool, Option("--zigzag", help="Several lines: every other line runs back.")
    ] = False,
    lines: Annotated[
        PathLike | None, Option(help="Several lines: CSV of the ends of each line.")
    ] = None,
    max_memory: Annotated[str | int, Option(help="Largest array that is read.")] = "2GB",
) -> xr.Dataset:
    """Import a line that a commercial radar recorded, or several as a survey.

    `flgpr info FILE` shows what a recording holds.

    Returns
    -------
    xarray.Dataset
        The run that was stored, with ``import_notes`` of what was assumed, replaced or left out.

    Raises
    ------
    ValueError
        If a file cannot be read, or options do not go together.
    FileExistsError
        If another run is at the output.
    """
    from flgpr.commands.importing import LinePositions, import_line, import_lines

    files = one_or_more(file)
    headers: dict[str, Any] = {
        "step": step,
        "band": band,
        "separation": separation,
        "time_zero": _seconds(time_zero),
        "window": _seconds(window),
        "across": across,
        "height": height,
        "polarization": polarization,
        "topography": topography,
    }
    memory = size_in_bytes(max_memory)
    positions = LinePositions(anchor, anchor_from_track, mark_spacing, line_spacing, zigzag, lines)
    is_survey = len(files) > 1 or all_channels or mark_spacing is not None
    if not is_survey:
        if line_spacing is not None or zigzag or lines is not None or channel_x:
            raise ValueError(
                "line-spacing, zigzag and lines are of several lines, channel-x of --all-channels"
            )
        return import_line(files[0], output, channel, positions, memory, headers)
    if channel:
        raise ValueError("channel is of a single line; a survey takes all channels")
    headers["channel_x"] = channel_x or None
    return import_lines(files, output, positions, memory, headers)


def _seconds(nanoseconds: float | None) -> float | None:
    """Return a time in seconds, where it was given."""
    return None if nanoseconds is None else nanoseconds * 1e-9
