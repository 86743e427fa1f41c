"""Many lines of a commercial radar as one survey: one run that knows where every line lies."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from flgpr.formats.section import GprSection
from flgpr.geo.anchor import Anchor
from flgpr.model import LINE_STARTS
from flgpr.store.tables import read_columns
from flgpr.types import FloatArray, Notes, floats
from flgpr_exchange.gpr.line_run import ReasonedBand, channels_run, common_band, share_tones

_CLOSE = 0.02  # of a line's length, by which the distance of its ends may differ from it


@dataclass(frozen=True)
class LineLayout:
    """Where lines lie that no satellite receiver placed.

    They are parallel along +y, or go from point to point.
    """

    spacing: float | None = None  #: between parallel lines, m along x; the first lies at x = 0
    zigzag: bool = False  #: whether every other line runs back, from where the one before ended
    #: (line, 4) x and y of the start and of the end of each line, m, in place of both
    ends: FloatArray | None = None


def read_line_ends(path: str | Path, names: Sequence[str]) -> FloatArray:
    """Read where lines begin and end from CSV.

    Columns are ``line`` (the file's name), ``x_start_m``, ``y_start_m``, ``x_end_m`` and
    ``y_end_m``.

    Parameters
    ----------
    path : path
        The table.
    names : sequence of str
        Names of the lines' files.

    Returns
    -------
    (line, 4) ndarray
        x and y of start and end, m, in the order of ``names``.

    Raises
    ------
    ValueError
        If a column is missing, or a line is missing, not finite or there twice.
    """
    table = read_columns(Path(path), "line")
    columns = ["x_start_m", "y_start_m", "x_end_m", "y_end_m"]
    missing = [name for name in ("line", *columns) if name not in table.columns]
    if missing:
        raise ValueError(
            f"{path}: must have the columns line, {', '.join(columns)}; "
            f"missing: {', '.join(missing)}"
        )
    rows = []
    for name in names:
        matching = table[table["line"] == name]
        if len(matching) != 1:
            raise ValueError(f"{path}: must have one row for the line {name}, got {len(matching)}")
        rows.append(matching[columns].to_numpy(dtype=np.float64)[0])
    ends = np.array(rows)
    if not np.isfinite(ends).all():
        raise ValueError(f"{path}: places of lines must be finite")
    return ends


def place_by_marks(section: GprSection, spacing: float) -> GprSection:
    """Put the traces of a line at distances by its marks.

    Traces between marks are at equal steps; those before the first and after the last go on at the
    steps next to them.

    Parameters
    ----------
    section : GprSection
        The line.
    spacing : float
        Distance from mark to mark, m.

    Returns
    -------
    GprSection
        The line with these distances, and without its marks.

    Raises
    ------
    ValueError
        If there are fewer than two marks, or the spacing is not positive.
    """
    marks = np.unique(floats(section.marks))
    if marks.size < 2:
        raise ValueError(
            f"{section.path}: distances from marks need two marks or more, got {marks.size}"
        )
    if not (math.isfinite(spacing) and spacing > 0):
        raise ValueError(f"mark-spacing must be a positive distance, got {spacing:g} m")

    number = np.arange(len(section.traces), dtype=np.float64)
    along = spacing * np.arange(marks.size)
    distance = np.interp(number, marks, along)
    before = number < marks[0]
    after = number > marks[-1]
    first_gap, last_gap = np.diff(marks)[[0, -1]]  # traces from mark to mark
    distance[before] = (number[before] - marks[0]) * spacing / first_gap
    distance[after] = along[-1] + (number[after] - marks[-1]) * spacing / last_gap

    note = f"distances are from {marks.size} marks every {spacing:g} m"
    if section.distance is not None:
        note += ", in place of those that the file tells"
    outside = int(np.count_nonzero(before | after))
    if outside:
        note += (
            f"; {outside} traces before the first and after the last mark go on at the steps "
            "beside them"
        )
    # The distances replace the marks.
    return replace(
        section, distance=distance - distance[0], marks=(), history=(*section.history, note)
    )


def survey_run(
    sections: Sequence[GprSection],
    layout: LineLayout = LineLayout(),
    anchor: Anchor | None = None,
    **options: Any,
) -> xr.Dataset:
    """Make one run of several lines, one after the other, on the same tones.

    All channels are a pair each.

    Parameters
    ----------
    sections : sequence of GprSection
        The lines, of :func:`flgpr.formats.read_gpr`; all with the same channels and time window.
    layout : LineLayout
        Where they lie, unless an anchor and their own fixes place them.
    anchor : Anchor, optional
        Takes the lines' fixes to the lane.
    **options
        Those of :func:`flgpr.formats.gpr_run` but ``channel``.

    Returns
    -------
    xarray.Dataset
        The run; its attribute ``line_starts`` holds the first scan of each line.

    Raises
    ------
    ValueError
        If lines have other tones or channels than the first, or nothing states where they lie.
    """
    if not sections:
        raise ValueError("a survey must have at least one line, got none")
    if options.get("band") is None:
        lows, highs, _ = zip(*map(common_band, sections), strict=True)
        reason = "common to all lines and their antennas"
        options["band"] = ReasonedBand(max(lows), min(highs), reason)
    is_placed = anchor is not None or layout.spacing is not None or layout.ends is not None
    if not is_placed and len(sections) > 1:
        # Unless they are channels of one line, a file each, whose headers place them across.
        places = {tuple(one.offsets.ravel()) for one in sections if one.offsets is not None}
        if len(places) < len(sections) or any(one.traces.shape[1] > 1 for one in sections):
            raise ValueError(
                "lines of a survey need an anchor, line-spacing or a table of lines, "
                "which tell where they lie"
            )

    runs = [channels_run(section, anchor=anchor, **options) for section in sections]
    first = runs[0]
    for number, section in enumerate(sections):
        differing = None
        if not share_tones(runs, number):
            differing = "frequency"
        elif runs[number].sizes["pair"] != first.sizes["pair"]:
            differing = "pair"
        if differing is not None:
            raise ValueError(
                f"{section.path}: lines of a survey must have the same time window and channels, "
                f"this one has another {differing} than {sections[0].path.name}"
            )

    names = [section.path.name for section in sections]
    notes = _place_lines(runs, names, layout) if anchor is None else []
    for section, run in zip(sections, runs, strict=True):
        notes += _carry_offset(section, run, layout)
    _check_antennas(sections, runs)
    notes += _without_clocks(runs)
    starts = np.cumsum([0, *(run.sizes["scan"] for run in runs[:-1])]).tolist()
    for name, run in zip(names, runs, strict=True):
        notes += [f"{name}: {note}" for note in run.attrs["import_notes"]]

    merged = xr.concat(
        runs, dim="scan", data_vars="minimal", coords="minimal", compat="equals", join="exact"
    )
    attrs = first.attrs | {
        "title": f"{len(runs)} lines",
        "source": f"{sections[0].format}, {', '.join(names)}",
        "import_notes": notes,
        LINE_STARTS: starts,
    }
    return merged.assign_attrs(attrs)


def _check_antennas(sections: Sequence[GprSection], runs: Sequence[xr.Dataset]) -> None:
    """Refuse lines whose antennas are not those of the first: a survey is one run."""
    for section, run in zip(sections, runs, strict=True):
        for name in ("tx_position", "rx_position"):
            if not np.allclose(run[name].values, runs[0][name].values, rtol=0, atol=1e-9):
                own, others = (np.round(one[name].values, 6).tolist() for one in (run, runs[0]))
                raise ValueError(
                    f"{section.path}: lines of a survey must have the same antennas, its "
                    f"{name} is {own} m, that of {sections[0].path.name} {others} m: give one "
                    "separation, or import them apart"
                )
            run[name].values[:] = runs[0][name].values


def _carry_offset(section: GprSection, run: xr.Dataset, layout: LineLayout) -> list[str]:
    """Move the poses of a line of one channel by its antennas' offset, which becomes zero.

    Lines of a survey share the positions of their antennas in the vehicle. Returned is a note where
    the line had a place already.
    """
    if section.offsets is None or section.traces.shape[1] > 1:
        return []
    across, along = section.offsets[0]
    pose = run["pose"].values
    heading = pose[:, 3]
    pose[:, 0] += across * np.cos(heading) + along * np.sin(heading)
    pose[:, 1] += along * np.cos(heading) - across * np.sin(heading)
    for name in ("tx_position", "rx_position"):
        run[name].values[:, :2] -= section.offsets[0]
    if layout.spacing is None and layout.ends is None:
        return []
    return [
        f"{section.path.name}: it lies {across:g} m across and {along:g} m along from there, where "
        "the header puts its antennas"
    ]


def _without_clocks(runs: list[xr.Dataset]) -> list[str]:
    """Take times away where they do not go on from line to line, and return a note of it."""
    time = np.concatenate([run["time"].values for run in runs])
    known = time[np.isfinite(time)]
    if not known.size or (np.diff(known) >= 0).all():
        return []
    for number, run in enumerate(runs):
        unknown = np.full(run.sizes["scan"], np.nan)
        runs[number] = run.assign_coords(time=("scan", unknown))
    return [
        f"the clocks of {len(runs)} lines do not go on from one to the next: "
        f"{known.size} times are not kept"
    ]


def _place_lines(runs: Sequence[xr.Dataset], names: Sequence[str], layout: LineLayout) -> list[str]:
    """Move the poses of lines, each along +y from the origin, to where they lie; return notes."""
    spacing = layout.spacing or 0.0
    notes: Notes = []
    end = 0.0  # of the line before, m along y
    for number, (run, name) in enumerate(zip(runs, names, strict=True)):
        pose = run["pose"].values
        measured = float(np.ptp(pose[:, 1]))
        x, y, heading = number * spacing, 0.0, 0.0
        if layout.ends is not None:
            x, y, x1, y1 = layout.ends[number]
            length = math.hypot(x1 - x, y1 - y)
            if length == 0:
                raise ValueError(
                    f"{name}: a line must end elsewhere than it begins, got ({x:g}, {y:g}) m twice"
                )
            if abs(length - measured) > _CLOSE * length:
                notes.append(
                    f"{name}: its ends lie {length:.4g} m apart, its own distance is "
                    f"{measured:.4g} m, which is kept"
                )
            heading = math.atan2(x1 - x, y1 - y)
        elif layout.zigzag and number % 2 == 1:
            y, heading = end, math.pi
        end = measured
        along = pose[:, 1] - pose[0, 1]
        pose[:, 0] = x + along * math.sin(heading)
        pose[:, 1] = y + along * math.cos(heading)
        pose[:, 3] = heading
    if layout.ends is not None:
        return notes
    if layout.spacing is None and len(runs) > 1:
        return [f"{len(runs)} lines are put side by side, by the offsets of their headers"]
    manner = "all begin at y = 0"
    if layout.zigzag:
        manner = "every other line runs back from where the one before ended"
    return [f"{len(runs)} lines are put {spacing:g} m apart along x as given; {manner}"]
