"""Motion capture: takes that OptiTrack Motive exports as CSV, formats 1.2 to 1.25."""

from __future__ import annotations

import csv
import warnings
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

_UNITS = {"meters": "m", "centimeters": "cm", "millimeters": "mm", "inches": "in", "feet": "ft"}
_KINDS = ("Rigid Body", "Marker", "Rigid Body Marker", "Bone")
_HEAD = 20  # lines among which the columns must be named


def is_motive(path: Path) -> bool:
    """Whether a file begins as a take does."""
    with path.open("rb") as file:
        return (
            file.read(64).removeprefix(b"\xef\xbb\xbf").lstrip(b'"').startswith(b"Format Version")
        )


def read_motive(path: Path) -> tuple[dict[str, NDArray[Any]], dict[str, str], list[str]]:
    """Read a take as named arrays, their units and what its header tells in words.

    There are ``frame`` and ``time``, and for every rigid body, marker or bone ``NAME/position`` (frame, 3) and
    ``NAME/rotation``: quaternions (frame, 4) x, y, z, w or Euler angles (frame, 3), deg, in the order that the header
    names. Where the body was not seen they are NaN.
    """
    import pandas as pd

    with path.open(encoding="utf-8-sig", errors="replace", newline="") as file:
        head = list(csv.reader(islice(file, _HEAD)))
    about = dict(zip(head[0][::2], head[0][1::2], strict=False))
    start = next((k for k, row in enumerate(head) if row[:1] == ["Frame"] and len(row) > 2), None)
    if start is None or start < 3:
        raise ValueError(
            "a take must name its columns, Frame, Time (Seconds), X, ..., in its first lines"
        )
    names = {row[1].strip(): row for row in head[1:start] if len(row) > 2}
    if "Type" not in names or "Name" not in names:
        raise ValueError("a take must have lines of Type and Name over its columns")
    unit = _UNITS.get(about.get("Length Units", "").strip().lower(), "")
    spin = about.get("Rotation Type", "").strip()
    columns = _columns(names["Type"], names["Name"], head[start - 1], head[start], spin.lower())
    with path.open("rb") as file, warnings.catch_warnings():
        warnings.simplefilter("error")  # of lines longer than the first, which it would shorten
        table = pd.read_csv(
            file, header=None, skiprows=start + 1, names=list(map(str, range(len(head[start])))), index_col=False,
            dtype=np.float64,
        )  # fmt: skip
    values = table.to_numpy()
    if not len(values):
        raise ValueError("a take must hold frames, got none")
    arrays: dict[str, NDArray[Any]] = {"frame": values[:, 0], "time": values[:, 1]}
    units = {"time": "s"}
    for name, order in columns.items():
        arrays[name] = values[:, order]
        units[name] = unit if name.endswith("/position") else "deg" if len(order) == 3 else ""
    rate = about.get("Export Frame Rate", "?")
    told = (
        f"{len(values)} frames at {rate} Hz, rotations as {spin or '?'}, lengths in {unit or '?'}"
    )
    return arrays, units, [told]


def _columns(
    types: list[str], bodies: list[str], groups: list[str], axes: list[str], euler: str
) -> dict[str, list[int]]:
    """Columns of every body's position and rotation, in the order x, y, z and w or of the Euler angles."""
    found: dict[str, dict[str, int]] = {}
    width = min(map(len, (types, bodies, groups, axes)))
    for kind in _KINDS:  # a rigid body goes before a marker of its name
        for k in range(2, width):
            group = groups[k].strip().lower()
            if types[k].strip() == kind and group in ("position", "rotation"):
                found.setdefault(f"{bodies[k].strip()}/{group}", {}).setdefault(
                    axes[k].strip().lower(), k
                )
    whole = {}
    for name, order in found.items():
        turned = "xyzw" if "w" in order else euler
        wanted = turned if name.endswith("/rotation") else "xyz"
        if wanted and all(axis in order for axis in wanted):
            whole[name] = [order[axis] for axis in wanted]
    if not whole:
        raise ValueError("a take must hold positions of rigid bodies or markers, got none")
    return whole
