"""Commands that read other formats and write them."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer
from typer import Argument, Option

from flgpr import tasks
from flgpr.cli.common import Output, Quiet, plain_errors, progress, tell_written

FORMATS = ("geojson", "gpkg", "kml", "gpx", "csv", "geotiff", "qgis", "cphd")

import_app = typer.Typer(name="import", help="Read other formats into a run.", no_args_is_help=True)

Point = tuple[float, float, float]
FromTrack = Annotated[
    bool,
    Option(
        "--anchor-from-track",
        help="Without an anchor: the first fix is the origin, the course is +y.",
    ),
]
Anchor = Annotated[Path | None, Option(help="TOML that ties the lane to the Earth.")]


@import_app.command("fullwave")
def import_fullwave(
    archive: Annotated[Path, Argument(help="NumPy archive (.npz) of a full-wave lane.")],
    output: Output,
    quiet: Quiet = False,
) -> None:
    """Import a full-wave lane; truth and objects are written beside the run if the archive tells."""
    with plain_errors(quiet):
        written = tasks.import_fullwave_lane(archive, output)
    tell_written(quiet, *written)


@import_app.command("gprmax")
def import_gprmax(
    source: Annotated[
        list[Path],
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
    quiet: Quiet = False,
) -> None:
    """Import gprMax results: a folder of decks that flgpr wrote, or anybody's files, one per scan."""
    with plain_errors(quiet), progress(quiet) as track:
        if len(source) == 1 and source[0].is_dir():
            written = tasks.import_gprmax_results(source[0], output, keep_direct, track)
        else:
            missing = next((one for one in source if not one.exists()), None)
            if missing is not None:
                raise FileNotFoundError(f"file not found: {missing}")
            if band is None or transmit is None or ground is None:
                raise ValueError(
                    "result files need --band, --transmit and --ground, which they do not tell"
                )
            if (waveform is None) != (centre is None):
                raise ValueError("--waveform and --centre go together")
            pulse = None if waveform is None or centre is None else (waveform, centre)
            written = tasks.import_gprmax_models(
                source, output, band, transmit, ground, horizontal, vertical, pulse
            )
    tell_written(quiet, *written)


@import_app.command("mapped")
def import_mapped(
    mapping: Annotated[
        Path, Argument(help="Mapping (TOML): which variable is what, in which unit.")
    ],
    output: Output,
    data: Annotated[
        list[Path] | None, Option(help="Data file in place of the mapping's own; may repeat.")
    ] = None,
    survey: Annotated[Path | None, Option(help="CSV of surveyed poses, a line per scan.")] = None,
    track: Annotated[Path | None, Option(help="CSV track, take of Motive, or NMEA log.")] = None,
    anchor: Anchor = None,
    anchor_from_track: FromTrack = False,
    clock_offset: Annotated[float, Option(help="The track's clock less the radar's, s.")] = 0.0,
    lever_arm: Annotated[
        Point, Option(help="Positioning antenna in the vehicle frame, m: x y z.")
    ] = (0.0, 0.0, 0.0),
    latency: Annotated[float, Option(help="How late the track's time stamps are, s.")] = 0.0,
    max_memory: Annotated[str, Option(help="Largest array that is read.")] = "2GB",
    body: Annotated[
        str | None, Option(help="Rigid body, if the track is a take of OptiTrack Motive.")
    ] = None,
    axes: Annotated[
        str | None, Option(help="Which of Motive's axes are x, y, z of the lane, such as x,-z,y.")
    ] = None,
    max_gap: Annotated[
        float, Option(help="Longest time that a track's missing fixes may take, s.")
    ] = 1.0,
    quiet: Quiet = False,
) -> None:
    """Import HDF5, MATLAB, NumPy, MCAP, CSV or Touchstone files by a mapping; `flgpr info FILE` drafts one."""
    with plain_errors(quiet):
        axis = None if axes is None else axes.split(",")
        own = anchor_from_track and track is not None and track.suffix.lower() != ".csv"
        way = track if track is None or own else tasks.track_of(track, anchor, body, axis, max_gap)
        positions = (survey, way, anchor, clock_offset, lever_arm, latency)
        memory = tasks.parse_size(max_memory)
        files: list[str | Path] = list(data or ())
        arrived = tasks.import_with_mapping(
            mapping, output, files, *positions, memory, anchor_from_track
        )
    for note in () if quiet else arrived.notes:
        typer.echo(note)
    tell_written(quiet, output)


@import_app.command("table")
def import_table(
    file: Annotated[Path, Argument(help="CSV of alarms, truth or objects, in any dialect.")],
    output: Output,
    kind: Annotated[str, Option(help="What it holds: alarms, truth or objects.")] = "alarms",
    columns: Annotated[
        str | None, Option(help="Columns that have other names: x=Rechts,y=Hoch,confidence=Wert.")
    ] = None,
    anchor: Annotated[
        Path | None,
        Option(help="TOML that ties the lane to the Earth, for longitude and latitude."),
    ] = None,
    quiet: Quiet = False,
) -> None:
    """Read a table of alarms, truth or objects as others write it, and write it as flgpr does."""
    with plain_errors(quiet):
        rows = tasks.import_table(file, output, kind, columns, anchor)
    if not quiet:
        typer.echo(f"{len(rows)} rows")
    tell_written(quiet, output)


@import_app.command("cphd")
def import_cphd(
    file: Annotated[Path, Argument(help="CPHD file.")],
    output: Output,
    anchor: Anchor = None,
    quiet: Quiet = False,
) -> None:
    """Import a CPHD file."""
    with plain_errors(quiet):
        run = tasks.import_cphd(file, output, anchor)
    for note in () if quiet else run.attrs.get("import_notes", []):
        typer.echo(f"note: {note}")
    tell_written(quiet, output)


@import_app.command("gpr")
def import_gpr(
    file: Annotated[
        list[Path],
        Argument(
            help="Recording: .dt1, .dzt, .rd3, .rd7, .iprb, .sgy, .segy, .su or .ogpr; several make a survey."
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
    anchor: Anchor = None,
    anchor_from_track: FromTrack = False,
    topography: Annotated[
        bool, Option("--topography", help="With an anchor: put the line on the receiver's heights.")
    ] = False,
    all_channels: Annotated[
        bool, Option("--all-channels", help="All channels in one run, a pair each.")
    ] = False,
    channel_x: Annotated[
        list[float] | None,
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
        Path | None, Option(help="Several lines: CSV of where each begins and ends.")
    ] = None,
    max_memory: Annotated[str, Option(help="Largest array that is read.")] = "2GB",
    quiet: Quiet = False,
) -> None:
    """Import a line that a commercial radar recorded, or several as a survey; `flgpr info FILE` tells what it holds."""
    with plain_errors(quiet):
        memory = tasks.parse_size(max_memory)
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
        together = len(file) > 1 or all_channels or mark_spacing is not None
        if together and channel:
            raise ValueError("channel is of a single line; a survey takes all channels")
        if not together and (line_spacing is not None or zigzag or lines is not None or channel_x):
            raise ValueError(
                "line-spacing, zigzag and lines are of several lines, channel-x of --all-channels"
            )
        if together:
            run = tasks.import_lines(
                file, output, anchor, memory, anchor_from_track=anchor_from_track, mark_spacing=mark_spacing,
                line_spacing=line_spacing, zigzag=zigzag, lines=lines, channel_x=channel_x or None, **headers,
            )  # fmt: skip
        else:
            run = tasks.import_gpr(
                file[0], output, channel, anchor, memory, anchor_from_track, **headers
            )
    if not quiet:
        for note in run.attrs["import_notes"]:
            typer.echo(f"note: {note}")
    tell_written(quiet, output)


def export(
    source: Annotated[
        Path, Argument(help="Result folder, truth or alarm table (CSV), or run store (for cphd).")
    ],
    output: Output,
    to: Annotated[str, Option(help=f"One of {', '.join(FORMATS)}.")],
    anchor: Annotated[
        Path | None,
        Option(
            help="TOML that ties the lane to the Earth; needed where the data do not tell their place."
        ),
    ] = None,
    kind: Annotated[str, Option(help="What a table holds: alarms, truth or objects.")] = "truth",
    time: Annotated[
        str | None, Option(help="Time of the observation (ISO 8601), kept with every point.")
    ] = None,
    detection: Annotated[
        str, Option(help="Detection of a result: main or that of a recipe beside it.")
    ] = "main",
    score: Annotated[
        Path | None, Option(help="Folder of the result's score, whose truth goes on qgis's map.")
    ] = None,
    columns: Annotated[
        str | None, Option(help="Columns of a table that have other names: x=Rechts,y=Hoch.")
    ] = None,
    quiet: Quiet = False,
) -> None:
    """Write alarms, truth, run-views or runs for other programs, on the Earth."""
    with plain_errors(quiet):
        if score is not None and to != "qgis":
            raise ValueError(f"score goes with qgis, got to {to!r}")
        if to == "cphd":
            tasks.export_run(source, output, anchor)
        elif to == "qgis":
            tasks.export_qgis(source, output, anchor, detection, time, score)
        elif source.suffix == ".csv":
            tasks.export_table(source, output, to, anchor, kind, time, columns)
        else:
            tasks.export_result(source, output, to, anchor, detection, time)
    tell_written(quiet, output)
