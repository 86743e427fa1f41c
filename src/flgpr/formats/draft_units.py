"""Units of arrays by what a file states, by names, and by sizes.

Those that are guessed end in a question mark.
"""

from __future__ import annotations

import math
import re
from typing import Any

import numpy as np

from flgpr.formats.array_file import ArrayFile, ArrayInfo
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
    """Read a small array.

    An array that cannot be read keeps no other from being explained.

    Parameters
    ----------
    opened : ArrayFile
        The file.
    info : ArrayInfo
        The array.

    Returns
    -------
    (...) ndarray or None
        Its values; None if it is large or cannot be read.
    """
    if math.prod(info.shape) > SMALL:
        return None
    try:
        return opened.read(info.name)
    except ValueError:
        return None


def largest(opened: ArrayFile, info: ArrayInfo) -> float:
    """Return the largest finite magnitude in a small array; 0 if it is another, or of no numbers."""
    values = small_values(opened, info)
    if values is None or values.dtype.kind not in "biufc":
        return 0.0
    magnitudes = np.abs(values[np.isfinite(values)])
    return float(magnitudes.max(initial=0.0))


def unit_suffix(info: ArrayInfo) -> str:
    """Return the unit that ends an array's name, such as ns of t_ns; empty if there is none."""
    name = info.name.lower()
    last = re.split(r"[_\W]", name)[-1]
    units = (unit for units in UNITS.values() for unit in units if unit.lower() == last)
    return next((unit for unit in units if last != name and unit not in _NO_SUFFIX), "")


def unit_of(opened: ArrayFile, info: ArrayInfo, usual: str) -> str:
    """Return the unit of an array.

    Parameters
    ----------
    opened : ArrayFile
        The file.
    info : ArrayInfo
        The array.
    usual : str
        The usual unit of its kind, such as "m".

    Returns
    -------
    str
        The unit that the file states, by an attribute or at the end of the name, else one guessed
        by size, with a question mark.
    """
    kind = next(units for units in UNITS.values() if usual in units)
    stated = info.unit
    if len(stated) > 2:
        stated = _LONG_UNITS.get(stated.strip().lower().rstrip("s"), stated)
    for unit in (stated, unit_suffix(info)):
        if unit in kind:
            return unit
    top = largest(opened, info) if usual in ("Hz", "ns") else 0.0
    if usual == "Hz" and top < 1e6:
        return "MHz?" if top >= 100 else "GHz?"
    return "s?" if usual == "ns" and 0 < top < SHORTEST_SCANS else f"{usual}?"


def is_fast_time(opened: ArrayFile, info: ArrayInfo) -> bool:
    """Return whether times can only be those of samples: by their unit, or by their size.

    Parameters
    ----------
    opened : ArrayFile
        The file.
    info : ArrayInfo
        The array of times.

    Returns
    -------
    bool
        Whether they can be nothing else.
    """
    has_short_unit = unit_suffix(info) in ("ns", "ps", "us")
    return has_short_unit or 0 < largest(opened, info) < SHORTEST_SCANS
