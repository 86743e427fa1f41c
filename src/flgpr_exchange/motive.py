"""Motion capture: takes that OptiTrack Motive exports as CSV, formats 1.2 to 1.25."""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from itertools import islice
from pathlib import Path

import numpy as np

from flgpr.door import read_named
from flgpr.formats.array_file import ArrayFile, from_memory
from flgpr.formats.arrays import open_arrays
from flgpr.formats.axes import attitude_of, axes_matrix
from flgpr.formats.explain import array_lines
from flgpr.formats.mapping import factor
from flgpr.formats.reader import Explanation, Reader
from flgpr.store.store_layout import MAX_MEMORY
from flgpr.types import Arrays, FloatArray

_UNITS = {"meters": "m", "centimeters": "cm", "millimeters": "mm", "inches": "in", "feet": "ft"}
_KINDS = ("Rigid Body", "Marker", "Rigid Body Marker", "Bone")
_HEAD = 20  # lines among which the columns must be named


def read_motive(path: Path) -> tuple[Arrays, dict[str, str], list[str]]:
    """Read a take as named arrays.

    There are ``frame`` and ``time``, and for every rigid body, marker or bone ``NAME/position``
    (frame, 3) and ``NAME/rotation``: quaternions (frame, 4) x, y, z, w or Euler angles (frame, 3),
    deg, in the order that the header names. They are NaN where the body was not seen.

    Parameters
    ----------
    path : Path
        The take.

    Returns
    -------
    arrays : dict of str to ndarray
        The arrays by name.
    units : dict of str to str
        Their units.
    about : list of str
        What the header states, a line each.

    Raises
    ------
    ValueError
        If the header names no columns, or there are no frames or no positions.
    """
    text = read_named(path, MAX_MEMORY).decode("utf-8-sig", errors="replace")
    head = _head_of(text)
    if not head:
        raise ValueError("a take must have a header, got an empty file")
    first = head[0]  # names and values in turn
    properties = dict(zip(first[::2], first[1::2], strict=False))
    named = [number for number, row in enumerate(head) if row[:1] == ["Frame"] and len(row) > 2]
    if not named or named[0] < 3:
        raise ValueError(
            "a take must name its columns, Frame, Time (Seconds), X, ..., in its first lines"
        )
    start = named[0]
    labels = {row[1].strip(): row for row in head[1:start] if len(row) > 2}
    if "Type" not in labels or "Name" not in labels:
        raise ValueError("a take must have lines of Type and Name over its columns")
    length_unit = _UNITS.get(properties.get("Length Units", "").strip().lower(), "")
    rotation_type = properties.get("Rotation Type", "").strip()
    rows = [labels["Type"], labels["Name"], head[start - 1], head[start]]
    columns = _columns(rows, rotation_type.lower())

    values = _read_values(text, start + 1, len(head[start]))
    arrays: Arrays = {"frame": values[:, 0], "time": values[:, 1]}
    units = {"time": "s"}
    for name, order in columns.items():
        arrays[name] = values[:, order]
        angle = "deg" if len(order) == 3 else ""
        units[name] = length_unit if name.endswith("/position") else angle
    rate = properties.get("Export Frame Rate", "?")
    about = (
        f"{len(values)} frames at {rate} Hz, rotations as {rotation_type or '?'}, "
        f"lengths in {length_unit or '?'}"
    )
    return arrays, units, [about]


def _head_of(text: str) -> list[list[str]]:
    """Return the cells of the first lines of a take."""
    from flgpr.store.tables import MOST_COLUMNS

    lines = list(islice(io.StringIO(text, newline=""), _HEAD))
    most = max((line.count(",") for line in lines), default=0) + 1
    if most > MOST_COLUMNS:
        raise ValueError(f"a take must have at most {MOST_COLUMNS} columns, got {most}")
    try:
        return list(csv.reader(lines))
    except csv.Error as error:
        raise ValueError(f"a take must begin with lines of cells: {error}") from None


def _read_values(text: str, head_lines: int, columns: int) -> FloatArray:
    """Read the numbers (frame, column) below the head of a take."""
    from flgpr.store.tables import parse_csv

    below = io.StringIO(text, newline="")
    for _ in range(head_lines):
        next(below)
    table = parse_csv(
        below.read(),
        width=columns,
        first=head_lines + 1,
        header=None,
        names=list(map(str, range(columns))),
        dtype=np.float64,
    )
    if table.empty:
        raise ValueError("a take must hold frames, got none")
    return table.to_numpy()


def _columns(rows: list[list[str]], euler: str) -> dict[str, list[int]]:
    """Return the columns of every body's position and rotation.

    They are in the order x, y, z and w, or in that of the Euler angles. Rows are the types of the
    bodies, their names, the groups and the axes over each column.
    """
    columns_of: dict[str, dict[str, int]] = {}
    for wanted in _KINDS:  # a rigid body goes before a marker of its name
        for column, cells in enumerate(zip(*rows, strict=False)):
            kind, body, group, axis = (cell.strip() for cell in cells)
            if column >= 2 and kind == wanted and group.lower() in ("position", "rotation"):
                axes = columns_of.setdefault(f"{body}/{group.lower()}", {})
                axes.setdefault(axis.lower(), column)

    complete = {}
    for name, column_of in columns_of.items():
        order = "xyz"
        if name.endswith("/rotation"):
            order = "xyzw" if "w" in column_of else euler
        if order and set(order) <= set(column_of):
            complete[name] = [column_of[axis] for axis in order]
    if not complete:
        raise ValueError("a take must hold positions of rigid bodies or markers, got none")
    return complete


class MotiveReader(Reader):
    """Takes of motion capture by OptiTrack Motive."""

    kind = "take of OptiTrack Motive"
    reads = frozenset({"arrays", "poses"})

    def owns(self, path: Path, head: bytes) -> bool:  # noqa: ARG002
        """Return whether the file begins as a take does."""
        return head.removeprefix(b"\xef\xbb\xbf").lstrip(b'"').startswith(b"Format Version")

    def open_arrays(self, path: Path, limit: int) -> ArrayFile:
        """Open positions and rotations of all bodies."""
        arrays, units, about = read_motive(path)
        return ArrayFile(path, self.kind, *from_memory(arrays, units), limit, about)

    def explain(self, path: Path, limit: int) -> Explanation:
        """Return what the bodies are, and how the take is read as a track."""
        lines = array_lines(open_arrays(path, limit))
        lines.append("read as a track: --track FILE --body NAME --axes x,-z,y")
        return Explanation(path, self.kind, lines, needs_mapping=False)

    def read_poses(
        self, path: Path, body: str | None, axes: Sequence[str] | None
    ) -> tuple[FloatArray, FloatArray]:
        """Return times and poses of a rigid body."""
        opened = open_arrays(path)
        names = [name.removesuffix("/rotation") for name in opened.arrays]
        bodies = [
            name for name in names if {f"{name}/rotation", f"{name}/position"} <= set(opened.arrays)
        ]
        is_known = len(bodies) == 1 if body is None else body in bodies
        if not is_known:
            raise ValueError(f"body must be one of {', '.join(bodies) or 'none'}, got {body!r}")
        if axes is None:
            raise ValueError(
                "axes must say which of Motive's axes are the lane's x, y and z, "
                "such as x,-z,y where Motive has y up"
            )

        name = body or bodies[0]
        position, quaternions = (opened.read(f"{name}/{what}") for what in ("position", "rotation"))
        if quaternions.shape[1] != 4:
            raise ValueError(
                "a take with Euler angles needs a mapping that tells their order: "
                "export quaternions instead"
            )
        unit = opened.arrays[f"{name}/position"].unit
        in_lane = (
            factor(unit, "length", "the header's Length Units") * position @ axes_matrix(axes).T
        )
        pose = np.concatenate([in_lane, attitude_of(quaternions, axes, axes)], axis=1)
        return opened.read("time"), pose


READER = MotiveReader()
