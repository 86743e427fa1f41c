"""Several lines, or all channels of one, into one run: files in, a store out."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import xarray as xr

from flgpr.formats import LineLayout, place_by_marks, read_gpr, read_line_ends, survey_run
from flgpr.geo import anchor_from_fixes
from flgpr.geo.anchor import Anchor, read_anchor
from flgpr.model.motion import judge_run
from flgpr.store import MAX_MEMORY, save_run

PathLike = str | Path


def import_lines(
    paths: Sequence[PathLike],
    output: PathLike,
    anchor: PathLike | None = None,
    max_memory: int = MAX_MEMORY,
    *,
    anchor_from_track: bool = False,
    mark_spacing: float | None = None,
    line_spacing: float | None = None,
    zigzag: bool = False,
    lines: PathLike | None = None,
    **options: Any,
) -> xr.Dataset:
    """Import lines of commercial radars as one run, all channels of each, and store it.

    :func:`flgpr.formats.read_gpr` reads the lines.

    Where they lie is told by the receiver's fixes with an ``anchor`` (TOML) or ``anchor_from_track`` (of the first
    line), by ``line_spacing``, m, of parallel lines, perhaps in ``zigzag``, or by a table ``lines`` (CSV,
    :func:`flgpr.formats.read_line_ends`). With ``mark_spacing``, m, distances come from the marks.
    ``options`` are those of :func:`flgpr.formats.survey_run`. A store that holds another run is refused.
    """
    target = Path(output)
    if not target.parent.is_dir():
        raise FileNotFoundError(f"the folder of the output must exist, got {target.parent}")
    if zigzag and line_spacing is None:
        raise ValueError("zigzag goes with line-spacing, got none")
    placed = [anchor is not None, anchor_from_track, line_spacing is not None, lines is not None]
    if sum(placed) > 1:
        raise ValueError(
            "anchor, anchor-from-track, line-spacing and lines all tell where lines lie: give one"
        )
    sections = [read_gpr(path, max_memory) for path in paths]
    if mark_spacing is not None:
        sections = [place_by_marks(section, mark_spacing) for section in sections]
    tie: Anchor | None = None if anchor is None else read_anchor(anchor)
    notes: list[str] = []
    if anchor_from_track:
        tie, notes = anchor_from_fixes(sections[0].fixes[:, 1:], sections[0].fixes[:, 0])
    ends = (
        None
        if lines is None
        else read_line_ends(lines, [section.path.name for section in sections])
    )
    layout = LineLayout(line_spacing, zigzag, ends)
    run = survey_run(sections, layout, tie, **options)
    if tie is not None:
        run = run.assign_attrs(georeference=tie.georeference())
    doubts = judge_run(run).notes() if len(sections) == 1 else []  # from line to line nobody drives
    run.attrs["import_notes"] = [*notes, *run.attrs["import_notes"], *doubts]
    save_run(run, target, resume=True)
    return run
