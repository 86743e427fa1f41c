"""Intake of a vendor's alarm list: which rows are used, and what is doubtful, before any truth is opened."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from operator import attrgetter
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from flgpr.commands.reach import are_near, table_doubts
from flgpr.model import Lane
from flgpr.model.printable import printable
from flgpr.model.units import UNITS
from flgpr.scoring.matching import lane_of_rows
from flgpr.store.dialects import TableReading
from flgpr.store.tables import parse_table, split_alarm_rows
from flgpr_trials.ledger import content_hash

_UNITS = {"ft": "feet", "in": "inches", "cm": "centimetres", "mm": "millimetres"}
"""Units that a list may be in, the largest first: in a smaller one all places lie at the lane's begin."""
_MOSTLY = 0.5  # of the rows lie in the lane or its halo, in the unit that is meant
_FARTHEST = 1e4  # m; beyond it coordinates are those of a map
_OUTSIDE = "outside the lane"
_UNREADABLE = "unreadable"
_OTHER_LANE = "of no lane of this test"


@dataclass(frozen=True)
class DroppedRow:
    """A row of a list that is not scored."""

    line: int  #: in the file
    kind: str  #: why, in a word that several rows share
    reason: str  #: why, with its values


@dataclass(frozen=True)
class ReadList:
    """A vendor's alarm list as it was read."""

    vendor: str
    file: str  #: name of the list's file
    #: rows that can be read, in the lane frame, with their ``line`` in the file and whether each is ``used``
    rows: pd.DataFrame
    dropped: list[DroppedRow]  #: in the order of the file
    doubts: list[str]  #: what is doubtful, the gravest first
    notes: list[str]  #: what was renamed or converted
    unit: str  #: unit that places seem to be in, or "UTM"; "" for metres

    @property
    def used(self) -> pd.DataFrame:
        """The rows that are scored."""
        columns = [name for name in ("lane", "x", "y", "confidence") if name in self.rows]
        return self.rows.loc[self.rows["used"], columns].reset_index(drop=True)

    @property
    def count(self) -> int:
        """Number of rows of the list."""
        return len(self.used) + len(self.dropped)

    def in_words(self) -> str:
        """Return a sentence on how many rows are used, and why the others are not."""
        n_used = len(self.used)
        if not self.count:
            return f"{self.vendor}'s list has no row"
        if not self.dropped:
            if self.count == 1:
                return f"The only row of {self.vendor}'s list is used"
            return f"All {self.count} rows of {self.vendor}'s list are used"
        number = str(n_used) if n_used else "None"
        verb = "is" if n_used == 1 else "are"
        reasons = []
        for kind, count in Counter(row.kind for row in self.dropped).items():
            one, several = ("lies", "lie") if kind == _OUTSIDE else ("is", "are")
            reasons.append(f"{count} {one if count == 1 else several} {kind}")
        return (
            f"{number} of {self.count} rows of {self.vendor}'s list {verb} used: "
            f"{' and '.join(reasons)}"
        )

    def require_clear(self) -> None:
        """Refuse to sign a list of which no row is used, or that seems to be in another unit."""
        if self.unit:
            raise ValueError(
                f"a list must be in metres of the lane to be signed: {self.in_words()}; "
                f"{self.doubts[0]}"
            )
        if not len(self.used):
            told = "; ".join([self.in_words(), *self.doubts[:1]])
            raise ValueError(f"a list must have a row that is used to be signed: {told}")

    def facts(self, lanes: Mapping[str, Lane], data: bytes) -> dict[str, str]:
        """Return what the page states of the file, whose content is given."""
        facts = {
            "vendor": self.vendor,
            "file": f"{self.file}, {len(data)} bytes",
            "SHA-256": content_hash(data),
            "rows": f"{self.count}, {len(self.used)} used, {len(self.dropped)} not",
        }
        if len(self.rows):
            for axis, unit in (("x", " m"), ("y", " m"), ("confidence", "")):
                values = self.rows[axis]
                facts[axis] = f"{values.min():.6g} to {values.max():.6g}{unit}"
        area = sum(lane.area for lane in lanes.values())
        facts["density"] = f"{len(self.used) / area:.3g} alarms per m² of {area:g} m² of lane"
        return facts


@dataclass(frozen=True)
class Intake:
    """A list that was taken in."""

    read: ReadList
    page: Path
    line: dict[str, Any] | None  #: of the register; None where nobody signed
    #: of the register, of the signed list whose place it takes; None where there is none
    replaced: dict[str, Any] | None


def read_vendor_list(
    data: bytes,
    name: str,
    vendor: str,
    lanes: Mapping[str, Lane],
    halo: float,
    reading: TableReading,
    unit: str | None = None,
) -> ReadList:
    """Read a vendor's alarm list row by row; what cannot be used is dropped with its reason.

    A row farther outside its lane than the halo is dropped. One that is nearer can find a mine at
    the edge, and is no false alarm.

    Parameters
    ----------
    data : bytes
        Content of the file.
    name : str
        Its name, for errors.
    vendor : str
        Whose list it is.
    lanes : mapping of str to Lane
        Lanes of the test by name.
    halo : float
        Halo radius, m.
    reading : TableReading
        Columns of other names, anchor, and whether confidences may be missing.
    unit : str, optional
        Unit of ``x`` and ``y`` where the header states none; metres by default.

    Returns
    -------
    ReadList
        The rows, and what is doubtful.

    Raises
    ------
    ValueError
        If the header lacks a column, the table could be read in two ways, or the unit is unknown.
    """
    if unit is not None and unit not in UNITS["length"]:
        raise ValueError(f"unit must be one of {', '.join(UNITS['length'])}, got {unit!r}")
    readable, lines, faults = split_alarm_rows(data, reading)
    dropped = [DroppedRow(line, _UNREADABLE, reason) for line, reason in faults]
    rows = parse_table(readable, "alarms", name, reading)
    notes = rows.attrs.get("notes", [])
    if unit is not None:
        if rows.attrs.get("has_unit", False):
            raise ValueError(
                "unit must not be given where the header states one, or places come by an anchor, "
                f"got {unit!r}"
            )
        factor = UNITS["length"][unit]
        rows = rows.assign(x=rows["x"] * factor, y=rows["y"] * factor)
    if "lane" in rows:
        [only_lane] = lanes if len(lanes) == 1 else [""]
        rows["lane"] = rows["lane"].fillna("").astype(str).replace("", only_lane)
    rows = rows.assign(line=lines, used=are_near(rows, lanes, halo))
    lane_of_rows(rows[rows["used"]], lanes, "alarms")
    probable_unit = _probable_unit(rows, lanes, halo) if unit is None else ""
    doubts = _doubts(rows, lanes, probable_unit)
    if faults:
        line, reason = faults[0]
        doubts.append(f"The first unreadable row is in line {line}: {reason}")
    dropped += _not_in_lanes(rows, lanes)
    dropped.sort(key=attrgetter("line"))
    return ReadList(vendor, name, rows, dropped, doubts, notes, probable_unit)


def _not_in_lanes(rows: pd.DataFrame, lanes: Mapping[str, Lane]) -> list[DroppedRow]:
    """Return the rows that are too far from their lane, or name none of the test."""
    dropped = []
    for row in rows[~rows["used"]].to_dict("records"):
        lane = str(row.get("lane", ""))
        if list(lanes) != [""] and lane not in lanes:
            dropped.append(DroppedRow(row["line"], _OTHER_LANE, f'lane is "{printable(lane)}"'))
        else:
            place = f"x {row['x']:.2f} m, y {row['y']:.2f} m"
            dropped.append(DroppedRow(row["line"], _OUTSIDE, f"{_OUTSIDE}: {place}"))
    return dropped


def _probable_unit(rows: pd.DataFrame, lanes: Mapping[str, Lane], halo: float) -> str:
    """Return the unit in which most rows would lie in the lane or its halo; "" for metres."""
    swapped = rows.rename(columns={"x": "y", "y": "x"})
    in_metres = max(rows["used"].sum(), are_near(swapped, lanes, halo).sum())
    if in_metres >= _MOSTLY * len(rows):
        return ""
    for unit in _UNITS:
        factor = UNITS["length"][unit]
        scaled = rows.assign(x=factor * rows["x"], y=factor * rows["y"])
        if are_near(scaled, lanes, halo).mean() >= _MOSTLY:
            return unit
    return "UTM" if rows[["x", "y"]].abs().median().max() > _FARTHEST else ""


def _doubts(rows: pd.DataFrame, lanes: Mapping[str, Lane], probable_unit: str) -> list[str]:
    """Return what is doubtful about the rows of a list, the gravest first."""
    doubts = []
    if probable_unit == "UTM":
        doubts.append(
            "Places look like easting and northing of a map: give `--anchor anchor.toml`, and "
            "`--columns easting=x,northing=y` if the header calls them x and y"
        )
    elif probable_unit:
        doubts.append(
            f"Places look like {_UNITS[probable_unit]}, in which most would lie in the lane: "
            f"give `--unit {probable_unit}`, or `--unit m` if they are metres all the same"
        )
    outside = ~are_near(rows, lanes)
    near = int((outside & rows["used"]).sum())
    if near:
        doubts.append(
            f"Of the rows that are used {near} lie outside the lane by less than the halo: "
            "they can find a mine at its edge, and are no false alarms"
        )
    if not len(rows):
        return doubts
    for doubt in table_doubts(rows.drop(columns=["line", "used"]), "alarms", lanes):
        is_swapped = probable_unit == "" and "swapped" in doubt
        # The sentence of the page counts those outside.
        if "outside" not in doubt or is_swapped:
            remedy = " If so, give `--columns x=y,y=x`" if is_swapped else ""
            doubts.append(doubt[0].upper() + doubt[1:] + remedy)
    values = np.unique(rows["confidence"])
    if len(values) == 1 and len(rows) > 1:
        doubts.append(
            f"All confidences are equal ({values[0]:g}): the list has one operating point"
        )
    return doubts
