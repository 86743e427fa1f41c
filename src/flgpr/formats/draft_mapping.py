"""The mapping (TOML) of a measurement's files, from what their arrays are.

Files of one measurement get one draft: each adds what the others do not hold. The list of antennas
shows which axis has the antennas, the list of tones which has the tones, and the list of positions
how many scans there are.
"""

from __future__ import annotations

import os
import re
from pathlib import Path
from typing import Any

import numpy as np

from flgpr.formats.array_file import ArrayFile
from flgpr.formats.draft_arrays import TIME, ArraySource, FileGroup, Places, find_signal
from flgpr.formats.draft_roles import Roles
from flgpr.model.printable import printable
from flgpr.model.units import UNITS
from flgpr.toml_text import InlineTable, toml_lines
from flgpr.types import Entries

_CHECK = "What ends in a question mark is a guess: check it and take the mark away."
_IN_LANE = "the vehicle in the lane frame; heading is clockwise from +y seen from above"
_IN_VEHICLE = "in the vehicle frame: x right, y forward, z up"
_ORIENTATION = "of x forward, y left, z up"
_COMMENTS = {
    "signal.magnitude": "dB (decibels) or linear",
    "samples.meaning": "delay, range (one way) or path (there and back)",
    "samples.band": "first and last frequency to keep",
    "frequency.span": "first and last tone",
    "time.span": "of the first and the last scan, on the clock of the fixes",
    "track.clock_offset": "the track's clock less the radar's, s; flgpr.calibrate finds it",
    "pose.orientation": _ORIENTATION,
    "track.orientation": _ORIENTATION,
}
"""What stands beside an entry wherever a draft has it."""


def draft_of_file(opened: ArrayFile) -> str:
    """Draft the mapping of one file.

    Parameters
    ----------
    opened : ArrayFile
        The file.

    Returns
    -------
    str
        The mapping, TOML; empty if no array of the file can be the signal.
    """
    if find_signal(opened) is None:
        return ""
    roles = Roles([FileGroup("data", [opened.path], opened)])
    return MappingDraft(roles, opened.path.parent).text()


class MappingDraft:
    """Writes the mapping of files whose ``roles`` are known.

    Names of files are relative to ``folder``.
    """

    def __init__(self, roles: Roles, folder: Path) -> None:
        self.roles = roles
        self.folder = folder
        self.tables: Entries = {}
        self.comments = dict(_COMMENTS)
        self.named = {roles.data.key}  # groups of which the mapping names an array

    def text(self) -> str:
        """Return the mapping."""
        roles = self.roles
        paths = [path for group in roles.groups for path in group.paths]
        if len(paths) == 1:
            head = [f"# Draft for {printable(paths[0].name)}. {_CHECK}"]
            title = printable(paths[0].stem)
        else:
            head = [f"# Draft for {len(paths)} files together.", f"# {_CHECK}"]
            title = roles.data.paths[0].parent.resolve().name or "own array"
        dims = roles.dims()
        self.tables |= {"title": title, "polarization": roles.labels}
        self._add_join(dims)
        files: Entries = {}
        self.tables["files"] = files  # filled at the end: whose arrays are named
        self._add_signal(dims)
        self._add_axis()
        self._add_antennas(dims)
        if roles.stamp is not None:
            self._add_table("time", "", **self._variable(roles.stamp, "s"))
        self._add_places(roles.scan_count(dims))
        for group in roles.groups:
            if group.key in self.named:
                files[group.key] = self._file_names(group)
        return "\n".join([*head, *toml_lines(self.tables, self.comments)]) + "\n"

    def _add_table(self, name: str, comment: str, reason: str = "", **entries: Any) -> None:
        """Add a table, with a comment on it and the reason of its unit."""
        self.tables[name] = entries
        self.comments |= {name: comment, f"{name}.unit": reason}

    def _add_join(self, dims: list[str]) -> None:
        """Add how several files of data go together."""
        roles = self.roles
        count = len(roles.data.paths)
        if count == 1:
            return
        join = "new scan"
        meaning = "each file is a scan"
        if any(name.startswith("scan") for name in dims):
            join = "scan"
            meaning = "each file continues the scans of the one before"
        elif any(antennas.sides for antennas in roles.antennas.values()):
            join = "pair?"
            meaning = "each file has places of its own"
        elif roles.places and roles.places.count != count and not roles.places.holds("time"):
            join = f"{join}?"
        self.tables["join"] = join
        self.comments["join"] = f"{count} files: {meaning}"

    def _file_names(self, group: FileGroup) -> str | list[str]:
        """Return the files of a group as the mapping names them: a name, a pattern or a list."""
        start = self.folder or "."
        names = [os.path.relpath(path, start) for path in group.paths]
        if len(names) == 1:
            return names[0]
        folder = group.paths[0].parent
        pattern = re.sub(r"\d+", "*", group.paths[0].name)
        if set(folder.glob(pattern)) == set(group.paths):
            return os.path.relpath(folder / pattern, start)
        return names

    def _add_signal(self, dims: list[str]) -> None:
        """Add the table of the signal."""
        roles = self.roles
        field = roles.field
        entries: Entries = {"variable": roles.signal.name}
        if field.imaginary:
            entries["imaginary"] = field.imaginary
        if field.phase:
            phase = {"phase": field.phase, "phase_unit": f"{field.unit}?"}
            entries |= {"magnitude": f"{field.form}?", **phase}
        self._add_table("signal", "", **entries, dims=dims)
        comment = f"of {' x '.join(map(str, roles.sizes))}"
        if roles.axis is None and not field.is_complex:
            comment += "; interleaved = true if real and imaginary parts alternate"
            comment += ", shape = [-1, 1] of a flat record"
        self.comments["signal.dims"] = comment

    def _file(self, group: FileGroup) -> dict[str, str]:
        """Return the entry that names a group, unless it is that of the data."""
        self.named.add(group.key)
        return {} if group is self.roles.data else {"file": group.key}

    def _variable(self, source: ArraySource, usual: str = "") -> Entries:
        """Return the entries that name an array, and its unit, which is asked for by its usual."""
        entries = {**self._file(source.group), "variable": source.info.name}
        return entries | ({"unit": source.unit(usual)} if usual else {})

    def _add_axis(self) -> None:
        """Add the table of the tones or of the samples."""
        roles = self.roles
        if roles.frequency is not None:
            unit, reason = roles.frequency_unit()
            entries = self._variable(roles.frequency, "Hz") | {"unit": unit}
            self._add_table("frequency", "", reason, **entries)
        elif roles.samples is not None:
            entries = self._variable(roles.samples, "m" if "range" in roles.samples.label else "ns")
            if not roles.are_samples:
                entries["variable"] += "?"
            is_length = entries["unit"].rstrip("?") in UNITS["length"]
            entries["meaning"] = "range?" if is_length else "delay?"
            self._add_table("samples", "", **entries, band=[], band_unit="GHz")
        else:
            comment = "no array looks like the tones; variable = NAME does as well"
            self._add_table("frequency", comment, span=["?", "?"], unit="GHz")

    def _add_antennas(self, dims: list[str]) -> None:
        """Add the tables of the antennas' positions."""
        antennas = self.roles.antennas
        if {"tx", "rx"} <= set(antennas):
            antennas = {side: antennas[side] for side in ("tx", "rx")}
        for side, found in list(antennas.items())[:2]:
            entries: Entries
            if found.values is not None:
                entries = {"values": found.values.tolist()}
            elif found.sides:
                entries = dict(zip("xyz", (one.info.name for one in found.sides), strict=True))
            else:
                entries = self._variable(found.source)
            is_in_lane = found.scans is not None
            frame = {"frame": "lane?"} if is_in_lane else {}
            comment = "" if is_in_lane else _IN_VEHICLE
            name = f"{side}_position"
            self._add_table(name, comment, found.reason, **entries, unit=found.unit, **frame)
        if antennas:
            return
        if {"pair", "tx", "rx"} & {name.rstrip("?") for name in dims}:
            comment = f"{_IN_VEHICLE}; no array holds as many places as there are antennas"
            self._add_table("antenna_position", comment, values=[["?", "?", "?"]], unit="m")
        else:
            self._add_table("antenna_position", _IN_VEHICLE, x="0?", y="0?", z="0?", unit="m")

    def _add_places(self, scans: int | None) -> None:
        """Add the tables that state where the vehicle was."""
        roles = self.roles
        places = roles.places
        if places is None:
            is_pose = True
        elif places.group is roles.data:
            is_pose = any(source.rows in roles.scan_sizes for source in places.columns.values())
        else:
            is_pose = places.count == scans
        if is_pose and any(antennas.scans for antennas in roles.antennas.values()):
            return  # positions per scan are in the lane frame, and poses follow from them
        if places is None:
            unknown: Entries = {"x": "?", "y": "?", "z": "?", "unit": "m"}
            angles = {"heading": "?", "pitch": "0?", "roll": "0?", "angle_unit": "deg"}
            comment = f"{_IN_LANE}; no array tells where it was"
            self._add_table("pose", comment, **unknown, **angles)
            return

        file = self._file(places.group)
        form, position, comment = self._position(places)
        if is_pose:
            table = "pose"
            entries = file | ({form: InlineTable(file | position)} if form else position)
            self.comments |= {"pose": _IN_LANE, f"pose.{form or 'unit'}": comment}
        else:
            table = "track"
            form = form or "position"
            entries = {"time": self._fix_time(places), form: InlineTable(file | position)}
            fixes = f"{places.count} fixes of {scans or 'an unknown number of'} scans"
            self.comments |= {
                "track": f"{fixes}: a track on its own clock",
                f"track.{form}": comment,
            }
        self.tables[table] = entries | self._attitude(places, table)
        if not is_pose:
            self.tables[table]["clock_offset"] = 0.0

    def _fix_time(self, places: Places) -> InlineTable:
        """Return the entry of the times of fixes, and add the scans' times if they are missing."""
        roles = self.roles
        if roles.stamp is None:
            stamp = roles.find_axis(TIME, roles.sizes)
            unknown = {"span": ["?", "?"], "unit": "s"}
            entries = unknown if stamp is None else self._variable(stamp, "s")
            self._add_table("time", "the radar's time of every scan", **entries)
        if places.holds("time"):
            return InlineTable(self._variable(places.columns["time"], "s"))
        self.comments["track.time"] = "no column of times"
        return InlineTable(values=["?"], unit="s")

    def _position(self, places: Places) -> tuple[str, Entries, str]:
        """Return the name of the entry of positions, empty for x, y and z apart; it; a comment."""
        columns = places.columns
        if places.are_geodetic:
            unit = columns["z"].unit("m") if places.holds("z") else "m?"
            entry = {
                **{name: columns[name].info.name for name in places.form},
                "height": columns["z"].info.name if places.holds("z") else _component(places, "z"),
                "above_ground": "?",
                "angle_unit": _degrees(columns["longitude"], columns["latitude"]),
                # As receivers tell heights.
                "unit": unit.replace("m?", "m") if places.is_table else unit,
            }
            comment = "above_ground: height of the positioning antenna, in place of the receiver's"
            return "geodetic", entry, f"{comment}; needs --anchor, or --anchor-from-track"
        if places.holds("position"):
            entry = {"variable": columns["position"].info.name}
            if columns["position"].info.shape[1] == 2:
                entry["z"] = _component(places, "z")
            return "position", entry | {"unit": columns["position"].unit("m")}, ""
        if not set("xyz") & set(columns):
            return "", {"x": "?", "y": "?", "z": "?", "unit": "m"}, ""
        unit, reason = self.roles.position_unit()
        return "", {**{axis: _component(places, axis) for axis in "xyz"}, "unit": unit}, reason

    def _attitude(self, places: Places, table: str) -> Entries:
        """Return the entries of heading, pitch and roll, or of a rotation."""
        columns = places.columns
        if places.holds("position") and columns["position"].info.shape[1] == 6:
            return {"angle_unit": "rad?"}
        if places.holds("orientation"):
            rotation = self._variable(columns["orientation"])
            return {"orientation": InlineTable(rotation, body=["-y?", "x?", "z?"])}
        entries = {name: _component(places, name) for name in ("heading", "pitch", "roll")}
        found = [columns[name] for name in entries if name in columns]
        if "heading" not in columns and (places.form or places.holds("y")):
            entries["heading"] = "course?"
            self.comments[f"{table}.heading"] = "along the way"
        if table == "track" and places.are_geodetic and places.is_table:
            for name in set(entries) & set(columns):
                entries[name] = InlineTable(self._file(places.group), variable=entries[name])
        # Angles without a unit are in degrees, where radians do not reach as far.
        units = {
            one.unit("deg" if places.is_table or one.largest() > 2 * np.pi else "rad")
            for one in found
        }
        unit = units.pop() if len(units) == 1 else "?" if units else "deg"
        return {**entries, "angle_unit": unit}


def _component(places: Places, name: str) -> Any:
    """Return what a component is: an array, or zero where none holds it.

    In a table of fixes the words of a receiver are certain, and so is that it measured no more.
    Beside the signal a name is a guess unless it is called just that.
    """
    if name not in places.columns:
        return 0.0 if places.is_table else "0?"
    variable = places.columns[name].info.name
    last_word = re.split(r"[/.]", variable.lower())[-1].split("_")[0]
    return variable if places.is_table or last_word == name else f"{variable}?"


def _degrees(longitude: ArraySource, latitude: ArraySource) -> str:
    """Return the unit of longitudes and latitudes: degrees where radians do not reach as far."""
    unit = latitude.unit("deg")
    if unit != "deg?":
        return unit
    is_beyond = latitude.largest() > np.pi / 2 or longitude.largest() > np.pi
    return "deg" if is_beyond else unit
