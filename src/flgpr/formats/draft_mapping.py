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


class MappingDraft:
    """Writes the mapping of files whose ``roles`` are known; names of files are relative to the folder ``home``."""

    def __init__(self, roles: Roles, home: Path) -> None:
        self.roles = roles
        self.home = home

    def text(self) -> str:
        """Return the mapping."""
        dims = self.roles.dims()
        several = len(self.roles.data.paths) > 1
        join = ""
        if several:
            join = "scan" if any(name.startswith("scan") for name in dims) else "new scan"
            rows = self.roles.fixes()
            certain = join == "scan" or rows is None or rows == len(self.roles.data.paths)
            join += "" if certain or self.roles.way.get("time") is not None else "?"
        lines = [
            f"# Draft for {sum(len(group.paths) for group in self.roles.groups)} files together.",
            "# What ends in a question mark is a guess: check it and take the mark away.",
            f"title = {json.dumps(self.roles.data.paths[0].parent.resolve().name or 'own array')}",
            f"polarization = {json.dumps(self.roles.labels)}",
        ]
        if join:
            what = (
                "each file is a scan"
                if join.startswith("new")
                else "each file continues the scans of the one before"
            )
            lines.append(f"join = {json.dumps(join)}  # {len(self.roles.data.paths)} files: {what}")
        lines += ["", "[files]"]
        lines += [
            f"{group.key} = {self._names(group)}"
            for group in self.roles.groups
            if self._needed(group)
        ]
        lines += [
            "",
            "[signal]",
            f"variable = {json.dumps(self.roles.signal.name)}",
            *([f"imaginary = {json.dumps(self.roles.imaginary)}"] if self.roles.imaginary else []),
            f"dims = {json.dumps(dims)}  # of {' x '.join(map(str, self.roles.sizes))}",
            "",
            *self._axis_lines(),
            *self._antenna_lines(),
            *self._way_lines(self.roles.scans(dims)),
        ]
        return "\n".join(lines).rstrip() + "\n"

    def _needed(self, group: FileGroup) -> bool:
        if group is self.roles.data:
            return True
        sources = [self.roles.frequency, self.roles.samples, *self.roles.way.values()]
        sources += [one.source for one in self.roles.antennas.values() if one.values is None]
        return any(source is not None and source.group is group for source in sources)

    def _names(self, group: FileGroup) -> str:
        names = [os.path.relpath(path, self.home or ".") for path in group.paths]
        if len(names) == 1:
            return json.dumps(names[0])
        folder = group.paths[0].parent
        pattern = re.sub(r"\d+", "*", group.paths[0].name)
        if {path.name for path in folder.glob(pattern)} == {path.name for path in group.paths}:
            return json.dumps(os.path.relpath(folder / pattern, self.home or "."))
        return json.dumps(names)

    def _axis_lines(self) -> list[str]:
        if self.roles.frequency is not None:
            unit, why = self.roles.frequency_unit()
            return ["[frequency]", *_where(self.roles.frequency), _unit_line(unit, why), ""]
        if self.roles.samples is not None:
            usual = "m" if "range" in self.roles.samples.info.name.lower() else "ns"
            unit = unit_of(self.roles.samples.group.opened, self.roles.samples.info, usual)
            meaning = "range?" if unit.rstrip("?") in UNITS["length"] else "delay?"
            return [
                "[samples]", *_where(self.roles.samples), _unit_line(unit),
                f'meaning = "{meaning}"  # delay, range (one way) or path (there and back)',
                'band = ["?", "?"]  # first and last frequency to keep', 'band_unit = "GHz"', "",
            ]  # fmt: skip
        return [
            "[frequency]  # no file holds values that increase along an axis of the signal",
            'span = ["?", "?"]  # first and last tone', 'unit = "GHz"', "",
        ]  # fmt: skip

    def _antenna_lines(self) -> list[str]:
        sides = ("tx", "rx") if {"tx", "rx"} <= set(self.roles.antennas) else ("antenna",)
        if not set(sides) <= set(self.roles.antennas):
            return ["[antenna_position]  # in the vehicle frame; no file holds as many places as there are antennas",
                    'values = [["?", "?", "?"]]', 'unit = "m"', ""]  # fmt: skip
        lines: list[str] = []
        for side in sides:
            one = self.roles.antennas[side]
            lines.append(f"[{side}_position]  # in the vehicle frame: x right, y forward, z up")
            if one.values is None:
                lines += _where(one.source)
            else:
                lines += [
                    "values = [",
                    *(f"    {json.dumps(row)}," for row in one.values.tolist()),
                    "]",
                ]
            lines += [_unit_line(one.unit, one.why), ""]
        return lines

    def _way_lines(self, scans: int | None) -> list[str]:
        way = self.roles.way
        if not way:
            return ["[pose]  # no file tells where the vehicle was", 'x = "?"', 'y = "?"', 'z = "?"', 'unit = "m"',
                    'heading = "?"', 'pitch = "0?"', 'roll = "0?"', 'angle_unit = "deg"']  # fmt: skip
        rows = next(iter(way.values())).count
        if rows == scans:
            return self._pose_lines()
        return self._track_lines(rows, scans)

    def _pose_lines(self) -> list[str]:
        way = self.roles.way
        lines = [
            "[pose]  # the vehicle in the lane frame, a row per scan; heading is clockwise from +y seen from above",
            f"file = {json.dumps(next(iter(way.values())).group.key)}",
        ]
        if {"longitude", "latitude"} <= set(way):
            lines.append(f"geodetic = {self._geodetic()}  # needs --anchor, or --anchor-from-track")
        else:
            unit, why = self.roles.way_unit()
            lines += [f"{axis} = {json.dumps(way[axis].info.name)}" for axis in "xy"]
            z = way.get("height")
            lines += [
                f"z = {json.dumps(z.info.name) if z else '0.0  # no column of heights'}",
                _unit_line(unit, why),
            ]
        return [*lines, *self._attitude_lines()]

    def _geodetic(self) -> str:
        way = self.roles.way
        parts = [f"file = {json.dumps(way['longitude'].group.key)}"]
        parts += [
            f"{name} = {json.dumps(way[name].info.name)}" for name in ("longitude", "latitude")
        ]
        height = way.get("height")
        parts.append(f"height = {json.dumps(height.info.name) if height else 0.0}")
        return "{" + ", ".join(parts) + ', angle_unit = "deg", unit = "m"}'

    def _attitude_lines(self) -> list[str]:
        way = self.roles.way
        lines: list[str] = []
        for name, without in (
            ("heading", '"course?"  # along the way'),
            ("pitch", "0.0"),
            ("roll", "0.0"),
        ):
            known = way.get(name)
            lines.append(f"{name} = {json.dumps(known.info.name) if known else without}")
        units = [unit_of(way[name].group.opened, way[name].info, "deg") for name in ("heading", "pitch", "roll")
                 if name in way]  # fmt: skip
        return [*lines, f'angle_unit = "{units[0] if units else "deg"}"']

    def _track_lines(self, rows: int, scans: int | None) -> list[str]:
        """Write a track on a clock of its own, where there are more or fewer fixes than scans."""
        way = self.roles.way
        stamp = self.roles.find_axis(TIME_NAMES)
        counts = (
            f"{rows} fixes of {scans or 'an unknown number of'} scans: a track on its own clock"
        )
        lines = ["[time]  # the radar's time of every scan"]
        if stamp is not None:
            lines += [*_where(stamp), _unit_line(unit_of(stamp.group.opened, stamp.info, "s")), ""]
        else:
            lines += [
                'span = ["?", "?"]  # of the first and the last scan, on the clock of the fixes',
                'unit = "s"',
                "",
            ]
        lines.append(f"[track]  # {counts}")
        clock = way.get("time")
        if clock is not None:
            lines.append(f"time = {clock.entry(unit_of(clock.group.opened, clock.info, 's'))}")
        else:
            lines.append('time = {values = ["?"], unit = "s"}  # no column of times')
        if {"longitude", "latitude"} <= set(way):
            lines.append(f"geodetic = {self._geodetic()}  # needs --anchor, or --anchor-from-track")
        else:
            unit, why = self.roles.way_unit()
            key = json.dumps(way["x"].group.key)
            sides = [f"{axis} = {json.dumps(way[axis].info.name)}" for axis in "xy"]
            height = way.get("height")
            sides.append(f"z = {json.dumps(height.info.name) if height else 0.0}")
            words = f"  # {why}" if why else ""
            lines.append(f'position = {{file = {key}, {", ".join(sides)}, unit = "{unit}"}}{words}')
        return [
            *lines,
            *self._attitude_lines(),
            "clock_offset = 0.0  # the track's clock less the radar's, s",
        ]


def _where(source: ArraySource) -> list[str]:
    lines = [] if source.group.key == "data" else [f"file = {json.dumps(source.group.key)}"]
    return [*lines, f"variable = {json.dumps(source.info.name)}"]


def _unit_line(unit: str, why: str = "") -> str:
    return f'unit = "{unit}"' + (f"  # {why}" if why else "")
