"""``flgpr import gprmax``, ``import cphd`` and ``import gpr``."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from typer import Option

from flgpr.commands.imports import FromTrack
from flgpr.commands.options import (
    AnchorOption,
    Limits,
    Output,
    PathLike,
    Paths,
    Progress,
    one_or_more,
    size_in_bytes,
)
from flgpr.commands.shell import Arguments, Offer, command

if TYPE_CHECKING:
    import xarray as xr


@command(resumes=True)
def import_gprmax(
    source: Paths,
    output: Output,
    keep_direct: bool = False,
    band: Limits | None = None,
    transmit: str | None = None,
    ground: float | None = None,
    horizontal: Annotated[str, Option("--h")] = "x",
    vertical: Annotated[str, Option("--v")] = "z",
    waveform: str | None = None,
    centre: float | None = None,
    *,
    track: Progress = None,
) -> list[Path]:
    """Import gprMax results: a folder of decks that flgpr wrote, or other files, one per scan.

    Parameters
    ----------
    source
        Folder of decks that flgpr wrote, with all results, or result files.
    keep_direct
        Folder: leave the direct wave in the data.

    Result files
    ------------
    band
        Files: first and last tone, Hz.
    transmit
        Files: polarization of the source, H or V.
    ground
        Files: height of the ground in the model, m.
    horizontal
        Files: component of the field that is H.
    vertical
        Files: component of the field that is V.
    waveform
        Files of gprMax 3: the waveform, such as gaussiandotnorm.
    centre
        Files of gprMax 3: the waveform's frequency, Hz.

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
    from flgpr.progress import silent
    from flgpr.store import save_run
    from flgpr.store.notes import log_note
    from flgpr_exchange.commands.importing import import_gprmax_decks
    from flgpr_exchange.gprmax.files import GprmaxSetup, import_gprmax_files

    sources = [Path(path) for path in one_or_more(source)]
    if len(sources) == 1 and sources[0].is_dir():
        return import_gprmax_decks(sources[0], output, keep_direct, track or silent)
    for path in sources:
        if not path.exists():
            raise FileNotFoundError(f"file not found: {path}")
    if band is None or transmit is None or ground is None:
        raise ValueError(
            "result files need `band`, `transmit` and `ground`, which they do not hold"
        )
    if (waveform is None) != (centre is None):
        raise ValueError("`waveform` and `centre` go together")
    pulse = None if waveform is None or centre is None else (waveform, centre)
    stated = GprmaxSetup(band, transmit, ground, horizontal, vertical, pulse)
    run = import_gprmax_files(sources, stated)
    for import_note in run.attrs["import_notes"]:
        log_note(import_note)
    return [save_run(run, output, resume=True, share_files=True)]


def _run_lines(run: xr.Dataset, call: Arguments) -> Iterator[str | Path]:
    """Yield what was assumed, replaced or left out, and the store."""
    for import_note in run.attrs.get("import_notes", []):
        yield f"note: {import_note}"
    yield call.output


@command(lines=_run_lines)
def import_cphd(file: PathLike, output: Output, anchor: AnchorOption = None) -> xr.Dataset:
    """Import a CPHD file.

    Parameters
    ----------
    file
        CPHD file.

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
    from flgpr.commands.importing import check_parent_folder, finished_run
    from flgpr.commands.positions import read_optional_anchor
    from flgpr.store import save_run
    from flgpr_exchange.cphd.phase_history import read_cphd

    target = check_parent_folder(output)
    lane_anchor = read_optional_anchor(anchor)
    run = finished_run(read_cphd(file, lane_anchor), lane_anchor)
    save_run(run, target, resume=True, share_files=True)
    return run


@command(lines=_run_lines)
def import_gpr(
    file: Paths,
    output: Output,
    channel: Annotated[int | None, Option(min=0)] = None,
    step: float | None = None,
    time_zero: float | None = None,
    window: float | None = None,
    band: Limits | None = None,
    separation: float | None = None,
    across: bool = False,
    height: float = 0.0,
    polarization: str = "HH",
    anchor: AnchorOption = None,
    anchor_from_track: FromTrack = False,
    topography: bool = False,
    all_channels: bool = False,
    channel_x: Sequence[float] | None = None,
    mark_spacing: float | None = None,
    line_spacing: float | None = None,
    zigzag: bool = False,
    lines: PathLike | None = None,
    max_memory: str | int = "2GB",
) -> xr.Dataset:
    """Import a line that a commercial radar recorded, or several as a survey.

    `flgpr info FILE` shows what a recording holds.

    Parameters
    ----------
    file
        Recording: .dt1, .dzt, .rd3, .rd7, .iprb, .dt, .sgy, .segy, .seg, .su or .ogpr; several
        make a survey.
    max_memory
        Largest array that is read.

    Header
    ------
    channel
        Channel of a file that has several, from 0; by default all that the header places,
        else the first.
    step
        Trace spacing, m, in place of the header's.
    time_zero
        Time zero, ns after the first sample.
    window
        Time window, ns, in place of the header's.
    band
        First and last frequency to keep, Hz.

    Antennas
    --------
    separation
        Between transmitter and receiver, m.
    across
        The antennas lie side by side, not along the line.
    height
        Antennas over the ground, m; 0 is coupled to the ground.
    polarization
        HH (dipoles across the line), HV, VH or VV.

    Positions
    ---------
    anchor
    anchor_from_track
    topography
        With an anchor: put the line on the receiver's heights.
    mark_spacing
        Spacing of the marks, m, from which distances are computed.

    Several lines or channels
    -------------------------
    all_channels
        All channels in one run, a pair each.
    channel_x
        Position of a channel's antennas across the line, m; once per channel.
    line_spacing
        Several lines: parallel, at this distance, m.
    zigzag
        Several lines: every other line runs back.
    lines
        Several lines: CSV of the ends of each line.

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
    from flgpr_exchange.commands.importing import LinePositions, import_lines

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
    positions = LinePositions(anchor, anchor_from_track, mark_spacing, line_spacing, zigzag, lines)
    is_survey = len(files) > 1 or all_channels or mark_spacing is not None
    if is_survey:
        if channel is not None:
            raise ValueError("channel is of a single line; a survey takes all channels")
        headers["channel_x"] = channel_x or None
    elif line_spacing is not None or zigzag or lines is not None or channel_x:
        raise ValueError(
            "line_spacing, zigzag and lines are of several lines, channel_x of all_channels"
        )
    memory = size_in_bytes(max_memory)
    return import_lines(files, output, positions, memory, headers, is_survey, channel)


OFFER = Offer(
    {"import gprmax": import_gprmax, "import cphd": import_cphd, "import gpr": import_gpr}
)
"""The commands of this package, by their words."""
