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
    yield from written


@command(lines=_written_lines)
def import_fullwave(
    archive: Annotated[PathLike, Argument(help="NumPy archive (.npz) of a full-wave lane.")],
    output: Output,
) -> list[Path]:
    """Import a full-wave lane; truth and objects are written beside the run if the archive tells.

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


@command(lines=_written_lines)
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
    """Import gprMax results: a folder of decks that flgpr wrote, or anybody's files, one per scan.

    Returns
    -------
    list of pathlib.Path
        What was written: the store, and of a folder truth, objects and lane beside it.

    Raises
    ------
    ValueError
        If a result is missing or does not fit, or options do not go together.
    FileExistsError
        If another run is at the output.
    """
    from flgpr.chain.progress import silent
    from flgpr.commands.importing import import_gprmax_decks
    from flgpr.formats.gprmax_files import GprmaxSetup, import_gprmax_files
    from flgpr.store import save_run
    from flgpr.store.notes import tell_note

    sources = [Path(path) for path in one_or_more(source)]
    if len(sources) == 1 and sources[0].is_dir():
        return import_gprmax_decks(sources[0], output, keep_direct, track or silent)
    for path in sources:
        if not path.exists():
            raise FileNotFoundError(f"file not found: {path}")
    if band is None or transmit is None or ground is None:
        raise ValueError(
            "result files need --band, --transmit and --ground, which they do not tell"
        )
    if (waveform is None) != (centre is None):
        raise ValueError("--waveform and --centre go together")
    pulse = None if waveform is None or centre is None else (waveform, centre)
    known = GprmaxSetup(band, transmit, ground, horizontal, vertical, pulse)
    run = import_gprmax_files(sources, known)
    for note in run.attrs["import_notes"]:
        tell_note(note)
    return [save_run(run, output, resume=True)]


def _mapped_lines(arrived: Imported, call: Arguments) -> Iterator[str | Path]:
    yield from arrived.notes
    yield call.output


@command(lines=_mapped_lines)
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
    latency: Annotated[float, Option(help="How late the track's time stamps are, s.")] = 0.0,
    max_memory: Annotated[str | int, Option(help="Largest array that is read.")] = "2GB",
    body: Annotated[
        str | None, Option(help="Rigid body, if the track is a take of OptiTrack Motive.")
    ] = None,
    axes: Annotated[
        str | None, Option(help="Which of Motive's axes are x, y, z of the lane, such as x,-z,y.")
    ] = None,
    max_gap: Annotated[
        float, Option(help="Longest time that a track's missing fixes may take, s.")
    ] = 1.0,
) -> Imported:
    """Import HDF5, MATLAB, NumPy, MCAP, CSV or Touchstone files by a mapping; `flgpr info FILE` drafts one.

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
    A stopped import resumes with the scan it was at.
    """
    from flgpr.commands.importing import Placing, check_parent_folder, store_mapped
    from flgpr.formats.mapped import import_mapped as read_mapped
    from flgpr.formats.tracks import read_survey

    target = check_parent_folder(output)
    placing = Placing(track, anchor, anchor_from_track, body, axes, max_gap)
    pose = None if survey is None else read_survey(survey)
    moved = placing.moved_track(lever_arm, latency)
    arrived = read_mapped(
        mapping,
        [Path(path) for path in data or ()],
        None,
        size_in_bytes(max_memory),
        pose,
        moved,
        clock_offset,
        placing.tie,
        anchor_from_track,
    )
    arrived.notes.extend(placing.notes)
    if anchor_from_track and placing.tie is None and arrived.anchor is None:
        raise ValueError(
            "anchor-from-track needs fixes by longitude and latitude, the positions are none"
        )
    store_mapped(arrived, target, arrived.anchor or placing.tie)
    return arrived


def _table_lines(rows: pd.DataFrame, call: Arguments) -> Iterator[str | Path]:
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
        Option(help="TOML that ties the lane to the Earth, for longitude and latitude."),
    ] = None,
) -> pd.DataFrame:
    """Read a table of alarms, truth or objects as others write it, and write it as flgpr does.

    Returns
    -------
    pandas.DataFrame
        The table; ``attrs["notes"]`` say what was read otherwise than it stands.

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
    from flgpr.store.tables import read_table, table_text

    if kind not in ("alarms", "truth", "objects"):
        raise ValueError(f"kind must be alarms, truth or objects, got {kind!r}")
    target = check_parent_folder(output)
    rows = read_table(file, kind, table_reading(columns, anchor) or TableReading())
    write_new(target, table_text(rows))
    return rows


def _noted_lines(run: xr.Dataset, call: Arguments) -> Iterator[str | Path]:
    for note in run.attrs.get("import_notes", []):
        yield f"note: {note}"
    yield call.output


@command(lines=_noted_lines)
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
        If the file cannot be read, or is another maker's and has no anchor.
    FileExistsError
        If another run is at the output.
    """
    from flgpr.commands.importing import check_parent_folder, with_doubts
    from flgpr.commands.positions import read_optional_anchor, tied_run
    from flgpr.formats.cphd import read_cphd
    from flgpr.store import save_run

    target = check_parent_folder(output)
    tie = read_optional_anchor(anchor)
    run = tied_run(with_doubts(read_cphd(file, tie)), tie)
    save_run(run, target, resume=True)
    return run


@command(lines=_noted_lines)
def import_gpr(
    file: Annotated[
        Paths,
        Argument(
            help="Recording: .dt1, .dzt, .rd3, .rd7, .iprb, .dt, .sgy, .segy, .su, .ogpr; several make a survey."
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
        bool, Option("--across", help="The antennas lie side by side, not along the way.")
    ] = False,
    height: Annotated[
        float, Option(help="Antennas over the ground, m; 0 is coupled to the ground.")
    ] = 0.0,
    polarization: Annotated[str, Option(help="HH (dipoles across the way), HV, VH or VV.")] = "HH",
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
        Option(help="Place of a channel's antennas across the way, m; once per channel."),
    ] = None,
    mark_spacing: Annotated[
        float | None, Option(help="Distances from the marks, which stand every so many m.")
    ] = None,
    line_spacing: Annotated[
        float | None, Option(help="Several lines: parallel, so many m apart.")
    ] = None,
    zigzag: Annotated[
        bool, Option("--zigzag", help="Several lines: every other one runs back.")
    ] = False,
    lines: Annotated[
        PathLike | None, Option(help="Several lines: CSV of where each begins and ends.")
    ] = None,
    max_memory: Annotated[str | int, Option(help="Largest array that is read.")] = "2GB",
) -> xr.Dataset:
    """Import a line that a commercial radar recorded, or several as a survey; `flgpr info FILE` tells what it holds.

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
    from flgpr.commands.importing import LinePlacing, import_line, import_lines

    files = one_or_more(file)
    headers: dict[str, Any] = {
        "step": step,
        "band": band,
        "separation": separation,
        "time_zero": None if time_zero is None else time_zero * 1e-9,
        "window": None if window is None else window * 1e-9,
        "across": across,
        "height": height,
        "polarization": polarization,
        "topography": topography,
    }
    memory = size_in_bytes(max_memory)
    placing = LinePlacing(anchor, anchor_from_track, mark_spacing, line_spacing, zigzag, lines)
    is_survey = len(files) > 1 or all_channels or mark_spacing is not None
    if not is_survey:
        if line_spacing is not None or zigzag or lines is not None or channel_x:
            raise ValueError(
                "line-spacing, zigzag and lines are of several lines, channel-x of --all-channels"
            )
        return import_line(files[0], output, channel, placing, memory, headers)
    if channel:
        raise ValueError("channel is of a single line; a survey takes all channels")
    headers["channel_x"] = channel_x or None
    return import_lines(files, output, placing, memory, headers)
