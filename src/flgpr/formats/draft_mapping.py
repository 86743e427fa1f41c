"""The mapping (TOML) of a measurement's files, from what their arrays are."""

from __future__ import annotations

import json
import os
import re
from pathlib import Path

from flgpr.formats.draft_groups import ArraySource, FileGroup
from flgpr.formats.draft_roles import TIME_NAMES, Roles
from flgpr.formats.draft_units import unit_of
from flgpr.model.units import UNITS

_NO_POSE = [
    "[pose]  # no file tells where the vehicle was",
    'x = "?"',
    'y = "?"',
    'z = "?"',
    'unit = "m"',
    'heading = "?"',
    'pitch = "0?"',
    'roll = "0?"',
    'angle_unit = "deg"',
]
_NO_ANTENNAS = [
    "[antenna_position]  # in the vehicle frame; "
    "no file holds as many places as there are antennas",
    'values = [["?", "?", "?"]]',
    'unit = "m"',
    "",
]
_NO_TONES = [
    "[frequency]  # no file holds values that increase along an axis of the signal",
    'span = ["?", "?"]  # first and last tone',
    'unit = "GHz"',
    "",
]
_WITHOUT = {"heading": '"course?"  # along the way', "pitch": "0.0", "roll": "0.0"}
"""Values of angles that no column holds."""


class MappingDraft:
    """Writes the mapping of files whose ``roles`` are known.

    Names of files are relative to ``folder``.
    """

    def __init__(self, roles: Roles, folder: Path) -> None:
        self.roles = roles
        self.folder = folder

    def text(self) -> str:
        """Return the mapping."""
        roles = self.roles
        dims = roles.dims()
        files = sum(len(group.paths) for group in roles.groups)
        title = roles.data.paths[0].parent.resolve().name or "own array"
        lines = [
            f"# Draft for {files} files together.",
            "# What ends in a question mark is a guess: check it and take the mark away.",
            f"title = {json.dumps(title)}",
            f"polarization = {json.dumps(roles.labels)}",
            *self._join_lines(dims),
            "",
            "[files]",
        ]

        for group in roles.groups:
            if self._is_used(group):
                lines.append(f"{group.key} = {self._file_names(group)}")

        lines += ["", "[signal]", f"variable = {json.dumps(roles.signal.name)}"]
        if roles.imaginary:
            lines.append(f"imaginary = {json.dumps(roles.imaginary)}")
        sizes = " x ".join(map(str, roles.sizes))
        lines += [f"dims = {json.dumps(dims)}  # of {sizes}", ""]
        lines += self._axis_lines()
        lines += self._antenna_lines()
        lines += self._place_lines(roles.scan_count(dims))
        return "\n".join(lines).rstrip() + "\n"

    def _join_lines(self, dims: list[str]) -> list[str]:
        """Return the line that states how several files of data go together."""
        count = len(self.roles.data.paths)
        if count == 1:
            return []
        if any(name.startswith("scan") for name in dims):
            join = "scan"
            meaning = "each file continues the scans of the one before"
        else:
            join = "new scan"
            meaning = "each file is a scan"
            rows = self.roles.fix_count()
            certain = rows is None or rows == count or "time" in self.roles.pose_columns
            if not certain:
                join += "?"
        return [f"join = {json.dumps(join)}  # {count} files: {meaning}"]

    def _is_used(self, group: FileGroup) -> bool:
        """Return whether the mapping names an array of a group."""
        if group is self.roles.data:
            return True
        sources = [self.roles.frequency, self.roles.samples, *self.roles.pose_columns.values()]
        for antennas in self.roles.antennas.values():
            if antennas.values is None:
                sources.append(antennas.source)
        return any(source is not None and source.group is group for source in sources)

    def _file_names(self, group: FileGroup) -> str:
        """Return the files of a group as the mapping names them: a name, a pattern or a list."""
        start = self.folder or "."
        names = [os.path.relpath(path, start) for path in group.paths]
        if len(names) == 1:
            return json.dumps(names[0])
        folder = group.paths[0].parent
        pattern = re.sub(r"\d+", "*", group.paths[0].name)
        matching = {path.name for path in folder.glob(pattern)}
        if matching == {path.name for path in group.paths}:
            return json.dumps(os.path.relpath(folder / pattern, start))
        return json.dumps(names)

    def _axis_lines(self) -> list[str]:
        """Return the table of the tones or of the samples."""
        roles = self.roles
        if roles.frequency is not None:
            unit, reason = roles.frequency_unit()
            return [
                "[frequency]",
                *_variable_lines(roles.frequency),
                _unit_line(unit, reason),
                "",
            ]
        if roles.samples is None:
            return _NO_TONES
        usual = "m" if "range" in roles.samples.info.name.lower() else "ns"
        unit = _unit(roles.samples, usual)
        meaning = "range?" if unit.rstrip("?") in UNITS["length"] else "delay?"
        return [
            "[samples]",
            *_variable_lines(roles.samples),
            _unit_line(unit),
            f'meaning = "{meaning}"  # delay, range (one way) or path (there and back)',
            'band = ["?", "?"]  # first and last frequency to keep',
            'band_unit = "GHz"',
            "",
        ]

    def _antenna_lines(self) -> list[str]:
        """Return the tables of the antennas' positions."""
        antennas = self.roles.antennas
        sides = ("tx", "rx") if {"tx", "rx"} <= set(antennas) else ("antenna",)
        if not set(sides) <= set(antennas):
            return _NO_ANTENNAS
        lines: list[str] = []
        for side in sides:
            positions = antennas[side]
            lines.append(f"[{side}_position]  # in the vehicle frame: x right, y forward, z up")
            if positions.values is None:
                lines += _variable_lines(positions.source)
            else:
                lines.append("values = [")
                lines += [f"    {json.dumps(row)}," for row in positions.values.tolist()]
                lines.append("]")
            lines += [_unit_line(positions.unit, positions.reason), ""]
        return lines

    def _place_lines(self, scans: int | None) -> list[str]:
        """Return the tables that state where the vehicle was."""
        columns = self.roles.pose_columns
        if not columns:
            return _NO_POSE
        rows = next(iter(columns.values())).count
        if rows == scans:
            return self._pose_lines()
        return self._track_lines(rows, scans)

    def _pose_lines(self) -> list[str]:
        """Return the table of a pose for every scan."""
        columns = self.roles.pose_columns
        file = next(iter(columns.values())).group.key
        lines = [
            "[pose]  # the vehicle in the lane frame, a row per scan; "
            "heading is clockwise from +y seen from above",
            f"file = {json.dumps(file)}",
        ]
        if self._is_geodetic():
            lines.append(self._geodetic_line())
        else:
            unit, reason = self.roles.position_unit()
            lines += [f"{axis} = {json.dumps(columns[axis].info.name)}" for axis in "xy"]
            height = "0.0  # no column of heights"
            if "height" in columns:
                height = json.dumps(columns["height"].info.name)
            lines += [f"z = {height}", _unit_line(unit, reason)]
        return lines + self._attitude_lines()

    def _is_geodetic(self) -> bool:
        """Return whether positions are longitudes and latitudes."""
        return {"longitude", "latitude"} <= set(self.roles.pose_columns)

    def _geodetic_line(self) -> str:
        """Return the entry of positions by longitude and latitude."""
        columns = self.roles.pose_columns
        cells = [f"file = {json.dumps(columns['longitude'].group.key)}"]
        for name in ("longitude", "latitude"):
            cells.append(f"{name} = {json.dumps(columns[name].info.name)}")
        cells.append(f"height = {self._height()}")
        cells += ['angle_unit = "deg"', 'unit = "m"']
        return f"geodetic = {{{', '.join(cells)}}}  # needs --anchor, or --anchor-from-track"

    def _height(self) -> str:
        """Return the column of heights, or zero where there is none."""
        height = self.roles.pose_columns.get("height")
        return json.dumps(height.info.name if height else 0.0)

    def _attitude_lines(self) -> list[str]:
        """Return the entries of heading, pitch and roll."""
        columns = self.roles.pose_columns
        lines: list[str] = []
        unit = ""
        for name, without in _WITHOUT.items():
            column = columns.get(name)
            if column is None:
                lines.append(f"{name} = {without}")
            else:
                lines.append(f"{name} = {json.dumps(column.info.name)}")
                unit = unit or _unit(column, "deg")
        return [*lines, f'angle_unit = "{unit or "deg"}"']

    def _track_lines(self, rows: int, scans: int | None) -> list[str]:
        """Return the tables of a track, which has more or fewer fixes than there are scans."""
        lines = ["[time]  # the radar's time of every scan"]
        stamp = self.roles.find_axis(TIME_NAMES)
        if stamp is not None:
            lines += [*_variable_lines(stamp), _unit_line(_unit(stamp, "s")), ""]
        else:
            lines += [
                'span = ["?", "?"]  # of the first and the last scan, on the clock of the fixes',
                'unit = "s"',
                "",
            ]
        lines += [
            f"[track]  # {rows} fixes of {scans or 'an unknown number of'} scans: "
            "a track on its own clock",
            self._clock_line(),
            self._geodetic_line() if self._is_geodetic() else self._position_line(),
        ]
        lines += self._attitude_lines()
        return [*lines, "clock_offset = 0.0  # the track's clock less the radar's, s"]

    def _clock_line(self) -> str:
        """Return the entry of the times of fixes."""
        clock = self.roles.pose_columns.get("time")
        if clock is None:
            return 'time = {values = ["?"], unit = "s"}  # no column of times'
        return f"time = {clock.entry(_unit(clock, 's'))}"

    def _position_line(self) -> str:
        """Return the entry of positions in the lane."""
        columns = self.roles.pose_columns
        unit, reason = self.roles.position_unit()
        cells = [f"file = {json.dumps(columns['x'].group.key)}"]
        for axis in "xy":
            cells.append(f"{axis} = {json.dumps(columns[axis].info.name)}")
        cells += [f"z = {self._height()}", f'unit = "{unit}"']
        comment = f"  # {reason}" if reason else ""
        return f"position = {{{', '.join(cells)}}}{comment}"


def _unit(source: ArraySource, usual: str) -> str:
    """Return the unit of an array; a guess ends in a question mark."""
    return unit_of(source.group.opened, source.info, usual)


def _variable_lines(source: ArraySource) -> list[str]:
    """Return the entries that name an array."""
    variable = f"variable = {json.dumps(source.info.name)}"
    if source.group.key == "data":
        return [variable]
    return [f"file = {json.dumps(source.group.key)}", variable]


def _unit_line(unit: str, reason: str = "") -> str:
    """Return the entry of a unit, with why it is known as a comment."""
    comment = f"  # {reason}" if reason else ""
    return f'unit = "{unit}"{comment}'
