"""Units of arrays by what a file states, by names, and by sizes; those that are guessed end in a question mark."""

from __future__ import annotations

import math
import re
from typing import Any

import numpy as np

from flgpr.formats.arrays import ArrayFile, ArrayInfo
from flgpr.model.units import UNITS

SMALL = 2_000_000
"""Values of an array, at most, that is read to explain it."""
SHORTEST_SCANS = 1e-4
"""Times of scans reach it, s; two-way delays of samples do not."""
_NO_SUFFIX = ("in", "h", "min")  # units that are words in names
_LONG_UNITS = {
    "meter": "m",
    "metre": "m",
    "foot": "ft",
    "feet": "ft",
    "degree": "deg",
    "radian": "rad",
    "second": "s",
}


def small_values(opened: ArrayFile, info: ArrayInfo) -> Any:
    """Read a small array; None if it is large or cannot be read, which keeps no other from being explained."""
    if math.prod(info.shape) > SMALL:
        return None
    try:
        return opened.read(info.name)
    except ValueError:
        return None


def unit_suffix(info: ArrayInfo) -> str:
    """Return the unit that ends an array's name, such as ns of t_ns; empty if there is none."""
    last = re.split(r"[_\W]", info.name.lower())[-1]
    for units in UNITS.values():
        suffixes = {unit.lower(): unit for unit in units if unit not in _NO_SUFFIX}
        if last in suffixes and last != info.name.lower():
            return suffixes[last]
    return ""


def unit_of(opened: ArrayFile, info: ArrayInfo, usual: str) -> str:
    """Take the unit the file states, by attribute or at the end of the name, else guess by size and mark it so."""
    kind = next(units for units in UNITS.values() if usual in units)
    stated = info.unit.strip().lower().rstrip("s") if len(info.unit) > 2 else info.unit
    if _LONG_UNITS.get(stated, info.unit) in kind:
        return _LONG_UNITS.get(stated, info.unit)
    suffix = unit_suffix(info)
    if suffix in kind:
        return suffix
    if usual == "Hz":
        values = small_values(opened, info)
        top = float(np.max(values)) if values is not None else 0.0
        return "Hz?" if top >= 1e6 else "MHz?" if top >= 100 else "GHz?"
    if usual == "ns":
        values = small_values(opened, info)
        if values is not None and values.size and 0 < float(np.abs(values).max()) < SHORTEST_SCANS:
            return "s?"
    return f"{usual}?"
