"""What imports share: how positions place a run, and how runs and the tables beside them are stored."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pandas as pd
import xarray as xr

from flgpr import __version__
from flgpr.chain.progress import Track, silent
from flgpr.commands.positions import PathLike, read_optional_anchor, tied_run, track_of
from flgpr.door import Folder
from flgpr.formats import (
    GprmaxRun,
    GprSection,
    LineLayout,
    gpr_run,
    nmea_places,
    place_by_marks,
    read_gpr,
    read_line_ends,
    survey_run,
)
from flgpr.formats.mapped import Imported
from flgpr.geo import anchor_from_fixes
from flgpr.geo.anchor import Anchor
from flgpr.model.motion import judge_run
from flgpr.model.track import reference_track
from flgpr.store import RunWriter, save_run, write_geojson, write_table, write_whole
from flgpr.store.outputs import tell_finished
from flgpr.store.run_store import RunExistsError, is_stored

_TABLES_OF_DECKS = ("truth.csv", "truth.json", "objects.csv", "objects.json", "lane.toml")


def check_parent_folder(output: PathLike) -> Path:
    """Return the path of an output whose folder exists; else raise a FileNotFoundError."""
    path = Path(output)
    if not path.parent.is_dir():
        raise FileNotFoundError(f"the folder of the output must exist, got {path.parent}")
    return path


def refuse_two_anchors(anchor: PathLike | None) -> None:
    """Refuse an anchor beside anchor-from-track."""
    if anchor is not None:
        raise ValueError("anchor and anchor-from-track both say where the lane lies: give one")


def with_doubts(run: xr.Dataset) -> xr.Dataset:
    """Note in ``import_notes`` what positions no vehicle reaches; all of them are kept."""
    doubts = judge_run(run).notes()
    if doubts:
        run.attrs.setdefault("import_notes", []).extend(doubts)
    return run


def store_with_tables(
    run: xr.Dataset, store: Path, tables: Mapping[str, pd.DataFrame | None]
) -> list[Path]:
    """Store a run with tables beside it, ``NAME-truth.csv`` and so on; return what was written."""
    written = [store]
    # The tables come before the run, whose presence says that all is there.
    if not is_stored(run, store):
        store.parent.mkdir(parents=True, exist_ok=True)
        for name, table in tables.items():
            if table is not None:
                path = store.with_name(f"{store.stem}-{name}.csv")
                write_table(table, path)
                write_geojson(table, path.with_suffix(".json"))
                written.append(path)
    save_run(run, store, resume=True)  # takes away what a killed writer left in a whole store
    return written


class Placing:
    """Where the scans of an import by mapping lie: the track and the anchor of the options."""

    def __init__(
        self,
        track: PathLike | None,
        anchor: PathLike | None,
        anchor_from_track: bool,
        body: str | None,
        axes: str | None,
        max_gap: float,
    ) -> None:
        if anchor_from_track:
            refuse_two_anchors(anchor)
        self.notes: list[str] = []
        self.tie = read_optional_anchor(anchor)
        self._track: pd.DataFrame | None = None
        if track is None:
            return
        path = Path(track)
        if anchor_from_track and path.suffix.lower() != ".csv":
            self.tie, self.notes = anchor_from_fixes(nmea_places(path))
        names = None if axes is None else axes.split(",")
        self._track = track_of(path, self.tie, body, names, max_gap)

    def moved_track(
        self, lever_arm: tuple[float, float, float], latency: float
    ) -> pd.DataFrame | None:
        """Return the track of the array's reference point; none without a track.

        ``lever_arm`` is the antenna's place in the vehicle frame, m, ``latency`` how late its time
        stamps are, s.
        """
        if self._track is None:
            return None
        return reference_track(self._track, lever_arm, latency)


def store_mapped(arrived: Imported, store: Path, tie: Anchor | None) -> None:
    """Store a run that was imported by a mapping, and its track beside it."""
    run = tied_run(with_doubts(arrived.run), tie)
    # The track comes before the run, whose presence says that all is there.
    if arrived.track is not None and not is_stored(run, store):
        write_table(arrived.track, store.with_name(f"{store.stem}-track.csv"))
    save_run(run, store, resume=True)


@dataclass(frozen=True)
class LinePlacing:
    """Where lines of a commercial radar lie, as options say it."""

    anchor: PathLike | None = None  #: TOML that ties the lane to the Earth
    anchor_from_track: bool = False  #: whether the first line's own fixes make the anchor
    mark_spacing: float | None = None  #: distance of the marks, m
    line_spacing: float | None = None  #: distance of parallel lines, m
    zigzag: bool = False  #: whether every other line runs back
    lines: PathLike | None = None  #: CSV of where each line begins and ends


def import_line(
    path: PathLike,
    output: PathLike,
    channel: int,
    placing: LinePlacing,
    max_memory: int,
    headers: Mapping[str, Any],
) -> xr.Dataset:
    """Import a channel of one line and store the run; ``headers`` are those of :func:`flgpr.formats.gpr_run`."""
    target = check_parent_folder(output)
    section = read_gpr(path, max_memory)
    notes: list[str] = []
    if placing.anchor_from_track:
        refuse_two_anchors(placing.anchor)
        tie, notes = anchor_of_line(section)
    else:
        tie = read_optional_anchor(placing.anchor)
    run = gpr_run(section, channel, anchor=tie, **headers)
    run.attrs["import_notes"] = [*run.attrs["import_notes"], *notes]
    run = tied_run(with_doubts(run), tie)
    save_run(run, target, resume=True)
    return run


def anchor_of_line(section: GprSection) -> tuple[Anchor | None, list[str]]:
    """Return the anchor of a line's own fixes, with notes; a line without two of them is a ValueError."""
    try:
        return anchor_from_fixes(section.fixes[:, 1:], section.fixes[:, 0])
    except ValueError as error:
        raise ValueError(f"{section.path}: {error}") from None


def import_lines(
    paths: Sequence[PathLike],
    output: PathLike,
    placing: LinePlacing,
    max_memory: int,
    headers: Mapping[str, Any],
) -> xr.Dataset:
    """Import lines as one run, all channels of each, and store it; see :func:`flgpr.formats.survey_run`."""
    target = check_parent_folder(output)
    if placing.zigzag and placing.line_spacing is None:
        raise ValueError("zigzag goes with line-spacing, got none")
    ways = [placing.anchor, placing.line_spacing, placing.lines]
    if sum(way is not None for way in ways) + placing.anchor_from_track > 1:
        raise ValueError(
            "anchor, anchor-from-track, line-spacing and lines all tell where lines lie: give one"
        )
    sections = [read_gpr(path, max_memory) for path in paths]
    if placing.mark_spacing is not None:
        sections = [place_by_marks(section, placing.mark_spacing) for section in sections]
    tie = read_optional_anchor(placing.anchor)
    notes: list[str] = []
    if placing.anchor_from_track:
        tie, notes = anchor_from_fixes(sections[0].fixes[:, 1:], sections[0].fixes[:, 0])
    ends = None
    if placing.lines is not None:
        ends = read_line_ends(placing.lines, [section.path.name for section in sections])
    layout = LineLayout(placing.line_spacing, placing.zigzag, ends)
    run = tied_run(survey_run(sections, layout, tie, **headers), tie)
    # From the end of a line to the begin of the next nobody measures: a jump there is no doubt.
    doubts = judge_run(run).notes() if len(sections) == 1 else []
    run.attrs["import_notes"] = [*notes, *run.attrs["import_notes"], *doubts]
    save_run(run, target, resume=True)
    return run


def import_gprmax_decks(
    folder: PathLike, output: PathLike, keep_direct: bool = False, track: Track = silent
) -> list[Path]:
    """Read the results of a folder of gprMax decks into a new run; return what was written.

    Every input file must have its result. Truth, objects and lane are written beside the run. A
    stopped import resumes with the scan it was at, unless a result has changed.
    """
    results = GprmaxRun(folder, keep_direct)
    store = Path(output)
    manifest = results.manifest
    described = ("seed", "sensor", "grid", "soil", "surface", "omissions")
    attrs = {
        "source": "gprMax, decks by flgpr",
        "title": manifest["title"],
        "direct_wave": "kept" if keep_direct else "taken off",
        "fullwave": {name: manifest.get(name) for name in described},
    }
    written = [store]
    try:
        begun = RunWriter.resumed(
            store,
            results.frequency,
            manifest["polarization"],
            manifest["tx_position"],
            manifest["rx_position"],
            attrs,
            inputs={"results": results.digest(), "flgpr": __version__},
        )
    except RunExistsError as error:
        if not error.same:
            raise
        tell_finished(store)
        return written
    with begun as writer:
        done = len(writer)
        total = len(results)
        label = f"reading results, {done} scans were there" if done else "reading results"
        for scan in track(range(done, total), label, total - done):
            writer.append(results.scan(scan), manifest["pose"][scan], manifest["time"][scan])
        # These come before the run, whose presence says that all is there.
        for name in _TABLES_OF_DECKS:
            data = Folder(folder).read_if_listed(name)
            if data is not None:
                target = store.with_name(f"{store.stem}-{name}")
                write_whole(target, data)
                written.append(target)
    return written
