"""Lines of commercial radars and results of gprMax as stored runs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import xarray as xr

from flgpr import __version__
from flgpr.commands.importing import check_parent_folder
from flgpr.commands.positions import read_optional_anchor, tied_run
from flgpr.door import Folder
from flgpr.geo import anchor_from_fixes
from flgpr.model.faults import faults_of
from flgpr.model.motion import judge_run
from flgpr.progress import Track, silent
from flgpr.store import RunWriter, save_run, write_whole
from flgpr.store.outputs import log_finished
from flgpr.store.run_writer import RunExistsError
from flgpr.types import Entries, Notes, PathLike
from flgpr_exchange.gpr.files import read_gpr
from flgpr_exchange.gpr.line_run import channels_run, gpr_run
from flgpr_exchange.gpr.survey import LineLayout, place_by_marks, read_line_ends, survey_run
from flgpr_exchange.gprmax.deck_results import GprmaxRun

_TABLES_OF_DECKS = ("truth.csv", "truth.json", "objects.csv", "objects.json", "lane.toml")


@dataclass(frozen=True)
class LinePositions:
    """Positions of lines of a commercial radar, as options state them."""

    anchor: PathLike | None = None  #: TOML that ties the lane to the Earth
    anchor_from_track: bool = False  #: whether the first line's own fixes make the anchor
    mark_spacing: float | None = None  #: distance of the marks, m
    line_spacing: float | None = None  #: distance of parallel lines, m
    zigzag: bool = False  #: whether every other line runs back
    lines: PathLike | None = None  #: CSV of the ends of each line


def import_lines(
    paths: Sequence[PathLike],
    output: PathLike,
    positions: LinePositions,
    max_memory: int,
    headers: Mapping[str, Any],
    as_survey: bool = True,
    channel: int | None = None,
) -> xr.Dataset:
    """Import lines as one run and store it.

    Parameters
    ----------
    paths : sequence of path
        The recordings.
    output : path
        Run store to write.
    positions : LinePositions
        Where the lines lie.
    max_memory : int
        Bytes of memory to use.
    headers : mapping
        Options of :func:`flgpr.formats.survey_run` in place of the files' headers.
    as_survey : bool
        Whether all channels of each line are taken; else it is one line.
    channel : int, optional
        Of one line: the channel; by default all whose antennas the header places, else the first.

    Returns
    -------
    xarray.Dataset
        The run.

    Raises
    ------
    ValueError
        If something is neither in the headers nor given, or does not fit.
    """
    target = check_parent_folder(output)
    if positions.zigzag and positions.line_spacing is None:
        raise ValueError("zigzag goes with line-spacing, got none")
    sources = (positions.anchor, positions.line_spacing, positions.lines)
    if sum(source is not None for source in sources) + positions.anchor_from_track > 1:
        raise ValueError(
            "anchor, anchor-from-track, line-spacing and lines all tell where lines lie: give one"
        )
    if len(paths) == 1 and positions.line_spacing is not None:
        raise ValueError("line-spacing and zigzag are of several lines, got one")

    has_anchor = positions.anchor is not None or positions.anchor_from_track
    if positions.mark_spacing is not None and (has_anchor or headers.get("step") is not None):
        other = "an anchor puts the traces" if has_anchor else "step puts the traces, too"
        raise ValueError(
            f"mark-spacing puts the traces along the line by its marks, {other}: give one"
        )

    sections = [read_gpr(path, max_memory) for path in paths]
    first = sections[0]
    if positions.mark_spacing is not None:
        sections = [place_by_marks(section, positions.mark_spacing) for section in sections]
    anchor = read_optional_anchor(positions.anchor)
    anchor_notes: Notes = []
    if positions.anchor_from_track:
        with faults_of(first.path):
            anchor, anchor_notes = anchor_from_fixes(first.fixes[:, 1:], first.fixes[:, 0])

    if as_survey:
        ends = None
        if positions.lines is not None:
            ends = read_line_ends(positions.lines, [section.path.name for section in sections])
        layout = LineLayout(positions.line_spacing, positions.zigzag, ends)
        run = survey_run(sections, layout, anchor, **headers)
        notes = [*anchor_notes, *run.attrs["import_notes"]]
    else:
        if channel is None and first.offsets is not None:
            run = channels_run(first, anchor=anchor, **headers)
        else:
            run = gpr_run(first, channel or 0, anchor=anchor, **headers)
        notes = [*run.attrs["import_notes"], *anchor_notes]
    # Nothing is measured from the end of a line to the beginning of the next: a jump is expected.
    doubts = judge_run(run).notes() if len(sections) == 1 else []
    run.attrs["import_notes"] = notes + doubts
    run = tied_run(run, anchor)
    save_run(run, target, resume=True, share_files=True)
    return run


def import_gprmax_decks(
    folder: PathLike, output: PathLike, keep_direct: bool = False, track: Track = silent
) -> list[Path]:
    """Read the results of a folder of gprMax decks into a new run.

    An interrupted import resumes with the next scan, unless a result has changed.

    Parameters
    ----------
    folder : path
        Folder that :func:`flgpr_exchange.gprmax.deck_folder.write_gprmax_decks` made; every input file must
        have its result.
    output : path
        Run store to make. Truth, objects and lane are written beside it.
    keep_direct : bool
        Whether the direct wave stays in the data.
    track : Track
        Shows progress.

    Returns
    -------
    list of pathlib.Path
        What was written, the store first.

    Raises
    ------
    ValueError
        If a result is missing or does not fit.
    FileExistsError
        If another run is at the output.
    """
    results = GprmaxRun(folder, keep_direct)
    store = Path(output)
    manifest = results.manifest
    try:
        begun = RunWriter.resumed(
            store,
            results.frequency,
            manifest["polarization"],
            manifest["tx_position"],
            manifest["rx_position"],
            attributes_of_decks(manifest, keep_direct),
            inputs={"results": results.digest(), "flgpr": __version__},
        )
    except RunExistsError as error:
        # The same run is complete already; any other one is refused.
        if not error.same:
            raise
        log_finished(store)
        return [store]

    written = [store]
    with begun as writer:
        done = len(writer)
        total = len(results)
        label = f"reading results, {done} scans were there" if done else "reading results"
        for scan in track(range(done, total), label, total - done):
            writer.append(results.scan(scan), manifest["pose"][scan], manifest["time"][scan])
        # The tables are written before the run, which marks a complete import.
        for name in _TABLES_OF_DECKS:
            data = Folder(folder).read_if_listed(name)
            if data is not None:
                target = store.with_name(f"{store.stem}-{name}")
                write_whole(target, data)
                written.append(target)
    return written


def attributes_of_decks(manifest: Mapping[str, Any], keep_direct: bool) -> Entries:
    """Return the attributes of a run that is made of decks."""
    described = ("seed", "sensor", "grid", "soil", "surface", "omissions")
    return {
        "source": "gprMax, decks by flgpr",
        "title": manifest["title"],
        "direct_wave": "kept" if keep_direct else "taken off",
        "fullwave": {name: manifest.get(name) for name in described},
    }
