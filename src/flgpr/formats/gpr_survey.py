"""Many lines of a commercial radar as one survey: one run that knows where every line lies."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from flgpr.formats.gpr_channels import channels_run, common_band
from flgpr.formats.gpr_files import GprSection
from flgpr.formats.gpr_import import ReasonedBand, gpr_run
from flgpr.geo.anchor import Anchor
from flgpr.model import LINE_STARTS
from flgpr.store.tables import read_columns

FloatArray = NDArray[np.float64]
_CLOSE = 0.02  # of a line's length, that its ends may lie apart more or less than it measured


@dataclass(frozen=True)
class LineLayout:
    """Where lines lie that no satellite receiver placed: parallel along +y, or from point to point."""

    spacing: float | None = None  #: between parallel lines, m along x; the first lies at x = 0
    zigzag: bool = False  #: whether every other line runs back, from where the one before ended
    #: (line, 4) x and y of the start and of the end of each line, m, in place of both
    ends: FloatArray | None = None


def read_line_ends(path: str | Path, names: Sequence[str]) -> FloatArray:
    """Read where lines begin and end, (line, 4) m, from CSV in the order of ``names``.

    Columns are ``line`` (the file's name), ``x_start_m``, ``y_start_m``, ``x_end_m`` and ``y_end_m``. A line that is
    missing or stands there twice is a ValueError.
    """
    table = read_columns(Path(path), "line")
    columns = ["x_start_m", "y_start_m", "x_end_m", "y_end_m"]
    missing = [name for name in ("line", *columns) if name not in table.columns]
    if missing:
        raise ValueError(
            f"{path}: must have the columns line, {', '.join(columns)}; missing: {', '.join(missing)}"
        )
    rows = []
    for name in names:
        own = table[table["line"] == name]
        if len(own) != 1:
            raise ValueError(f"{path}: must have one row for the line {name}, got {len(own)}")
        rows.append(own[columns].to_numpy(dtype=np.float64)[0])
    ends = np.array(rows)
    if not np.isfinite(ends).all():
        raise ValueError(f"{path}: places of lines must be finite")
    return ends


def place_by_marks(section: GprSection, spacing: float) -> GprSection:
    """Put the traces of a line at distances by its marks, which stand every ``spacing`` m.

    Traces between marks are at equal steps; those before the first and after the last go on at the steps beside them.
    Fewer than two marks, or a spacing that is not positive, are a ValueError.
    """
    marks = np.unique(np.asarray(section.marks, dtype=np.float64))
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
    distance[before] = (number[before] - marks[0]) * spacing / (marks[1] - marks[0])
    distance[after] = along[-1] + (number[after] - marks[-1]) * spacing / (marks[-1] - marks[-2])
    note = f"distances are from {marks.size} marks every {spacing:g} m"
    if section.distance is not None:
        note += ", in place of those that the file tells"
    outside = int(np.count_nonzero(before | after))
    if outside:
        note += f"; {outside} traces before the first and after the last mark go on at the steps beside them"
    # The marks are used up: nothing of them is left to be kept.
    return replace(
        section, distance=distance - distance[0], marks=(), history=(*section.history, note)
    )


def survey_run(
    sections: Sequence[GprSection],
    layout: LineLayout = LineLayout(),
    anchor: Anchor | None = None,
    **options: Any,
) -> xr.Dataset:
    """Make one run of several lines, one after the other, on the same tones, all channels a pair each.

    Parameters
    ----------
    sections : sequence of GprSection
        The lines, of :func:`flgpr.formats.read_gpr`; all with the same channels and time window.
    layout : LineLayout
        Where they lie, unless an anchor and their own fixes tell.
    anchor : Anchor, optional
        Takes the lines' fixes to the lane.
    **options
        Those of :func:`flgpr.formats.gpr_run` but ``channel``.

    Returns
    -------
    xarray.Dataset
        The run; its attribute ``line_starts`` tells the first scan of each line.

    Raises
    ------
    ValueError
        If lines have other tones or channels than the first, or nothing tells where they lie.
    """
    if not sections:
        raise ValueError("a survey must have at least one line, got none")
    if options.get("band") is None:
        bands = [common_band(section) for section in sections]
        lowest = max(band.lowest for band in bands)
        highest = min(band.highest for band in bands)
        options["band"] = ReasonedBand(lowest, highest, "common to all lines and their antennas")
    if anchor is None and layout.spacing is None and layout.ends is None and len(sections) > 1:
        raise ValueError(
            "lines of a survey need an anchor, line-spacing or a table of lines, which tell where they lie"
        )
    runs = [_line_run(section, anchor, options) for section in sections]
    for section, run in zip(sections, runs, strict=True):
        for axis in ("frequency", "pair"):
            same = run.sizes[axis] == runs[0].sizes[axis]
            if axis == "frequency":
                same = same and np.array_equal(run["frequency"].values, runs[0]["frequency"].values)
            if not same:
                raise ValueError(
                    f"{section.path}: lines of a survey must have the same time window and channels, this one has "
                    f"another {axis} than {sections[0].path.name}"
                )
    notes: list[str] = []
    if anchor is None:
        notes += _lay_out(runs, [section.path.name for section in sections], layout)
    notes += _without_clocks(runs)
    starts = np.cumsum([0, *(run.sizes["scan"] for run in runs[:-1])]).tolist()
    for section, run in zip(sections, runs, strict=True):
        notes += [f"{section.path.name}: {note}" for note in run.attrs["import_notes"]]
    merged = xr.concat(
        runs, dim="scan", data_vars="minimal", coords="minimal", compat="equals", join="exact"
    )
    attrs = runs[0].attrs | {
        "title": f"{len(runs)} lines",
        "source": f"{sections[0].format}, {', '.join(section.path.name for section in sections)}",
        "import_notes": notes,
        LINE_STARTS: starts,
    }
    return merged.assign_attrs(attrs)


def _without_clocks(runs: list[xr.Dataset]) -> list[str]:
    """Take times away where they do not go on from line to line; a note tells."""
    time = np.concatenate([run["time"].values for run in runs])
    known = time[np.isfinite(time)]
    if not known.size or (np.diff(known) >= 0).all():
        return []
    for number, run in enumerate(runs):
        runs[number] = run.assign_coords(time=("scan", np.full(run.sizes["scan"], np.nan)))
    return [
        f"the clocks of {len(runs)} lines do not go on from one to the next: {known.size} times are not kept"
    ]


def _line_run(section: GprSection, anchor: Anchor | None, options: dict[str, Any]) -> xr.Dataset:
    if section.traces.shape[1] == 1:
        options = {name: value for name, value in options.items() if name != "channel_x"}
        return gpr_run(section, 0, anchor=anchor, **options)
    return channels_run(section, anchor=anchor, **options)


def _lay_out(runs: Sequence[xr.Dataset], names: Sequence[str], layout: LineLayout) -> list[str]:
    """Move the poses of lines, each along +y from the origin, to where they lie."""
    notes: list[str] = []
    if layout.ends is not None:
        for run, name, (x0, y0, x1, y1) in zip(runs, names, layout.ends, strict=True):
            length = math.hypot(x1 - x0, y1 - y0)
            measured = float(np.ptp(run["pose"].values[:, 1]))
            if length == 0:
                raise ValueError(
                    f"{name}: a line must end elsewhere than it begins, got ({x0:g}, {y0:g}) m twice"
                )
            if abs(length - measured) > _CLOSE * length:
                notes.append(
                    f"{name}: its ends lie {length:.4g} m apart, its own distance is {measured:.4g} m, which is kept"
                )
            _move(run, x0, y0, math.atan2(x1 - x0, y1 - y0))
        return notes
    spacing = layout.spacing or 0.0
    far = 0.0
    for number, run in enumerate(runs):
        back = layout.zigzag and number % 2 == 1
        length = float(np.ptp(run["pose"].values[:, 1]))
        _move(run, number * spacing, far if back else 0.0, math.pi if back else 0.0)
        far = length if not back else 0.0
    way = (
        "every other line runs back from where the one before ended"
        if layout.zigzag
        else "all begin at y = 0"
    )
    notes.append(f"{len(runs)} lines are put {spacing:g} m apart along x as given; {way}")
    return notes


def _move(run: xr.Dataset, x: float, y: float, heading: float) -> None:
    """Turn a line that runs along +y from the origin, and put its origin at (x, y)."""
    pose = run["pose"].values
    along = pose[:, 1] - pose[0, 1]
    pose[:, 0] = x + along * math.sin(heading)
    pose[:, 1] = y + along * math.cos(heading)
    pose[:, 3] = heading
