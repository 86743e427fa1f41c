"""Which arrays of a file are the measured field, and which name its polarizations."""

from __future__ import annotations

import math
import re
from typing import NamedTuple

import numpy as np

from flgpr.formats.array_file import ArrayFile, ArrayInfo
from flgpr.formats.draft_units import small_values
from flgpr.model import POLARIZATIONS

_NO_FIELD = re.compile(r"covariance|orientation|rotation")
_COMPLEX = re.compile(r"complex|.*(\('r(eal)?'|\('re')", re.DOTALL)
_PHASE = re.compile(r"phase|(?<![a-z])ang(?:le)?(?![a-z])|(?<![a-z])arg(?![a-z])")
_MAGNITUDE = re.compile(r"mag|(?<![a-z])db|amp|(?<![a-z])abs")
_IMAGINARY = (("real", "imag"), ("re", "im"), ("_i", "_q"))
"""What names of real parts hold, and those of imaginary parts in its stead."""


def find_signal(opened: ArrayFile) -> Field | None:
    """Find the array that is most likely the measured field, and what its phase is in.

    Parameters
    ----------
    opened : ArrayFile
        The file.

    Returns
    -------
    Field or None
        The field; None if there is none.
    """
    if opened.signal:
        return Field(opened.arrays[opened.signal])
    arrays = [info for info in opened.arrays.values() if math.prod(info.shape) > 1]
    complex_arrays = [info for info in arrays if _COMPLEX.match(info.dtype)]
    if complex_arrays:
        return Field(max(complex_arrays, key=_count))
    for info in arrays:
        imaginary = _imaginary_of(info, opened)
        if imaginary is not None:
            return Field(info, imaginary)
    polar = _find_polar(opened)
    tables = [info for info in arrays if len(info.shape) >= 2 and info.shape[-1] > 3]
    fields = [info for info in tables if not _NO_FIELD.search(info.name)]
    if polar is None and fields:
        return Field(max(fields, key=_count))
    return polar


class Field(NamedTuple):
    """A measured field, as it lies in a file."""

    info: ArrayInfo  #: the array, or its real part, or its magnitude
    imaginary: str | None = None  #: the array of its imaginary part, if that is apart
    phase: str | None = None  #: the array of its phase, of a magnitude
    form: str = ""  #: of the magnitude: "dB" or "linear"
    unit: str = ""  #: of the phase: "deg" or "rad"

    @property
    def is_complex(self) -> bool:
        """Whether it has phases."""
        has_parts = self.imaginary is not None or self.phase is not None
        return has_parts or self.info.dtype.startswith("complex")


def _find_polar(opened: ArrayFile) -> Field | None:
    """Return the magnitude and the phase that network analysers export apart.

    They are the first of a file by their names whose shapes agree.
    """
    for phase in opened.arrays.values():
        beside = _PHASE.split(phase.name.lower(), maxsplit=1)
        if len(beside) != 2 or math.prod(phase.shape) < 2:
            continue
        for info in opened.arrays.values():
            name = info.name.lower()
            is_pair = info.shape == phase.shape and _MAGNITUDE.search(name)
            if is_pair and info is not phase and name.startswith(beside[0].rstrip(" _:")):
                form = "dB" if "db" in name or "log" in name else "linear"
                unit = "rad" if "rad" in phase.name.lower() else "deg"
                return Field(info, None, phase.name, form, unit)
    return None


def _count(info: ArrayInfo) -> int:
    """Return how many values an array has."""
    return math.prod(info.shape)


def _imaginary_of(info: ArrayInfo, opened: ArrayFile) -> str | None:
    """Return the array whose name and shape make it the imaginary part of another."""
    for real, imaginary in _IMAGINARY:
        expected = re.sub(real, imaginary, info.name, flags=re.IGNORECASE).lower()
        called = [name for name in opened.arrays if name.lower() == expected and name != info.name]
        if called and opened.arrays[called[0]].shape == info.shape:
            return called[0]
    return None


def labels_of(opened: ArrayFile, sizes: list[int]) -> list[str]:
    """Return the polarizations of a file if it names them, else a guess.

    Parameters
    ----------
    opened : ArrayFile
        The file.
    sizes : list of int
        Lengths of the signal's axes.

    Returns
    -------
    list of str
        The labels; "HH?" alone where the file names none.
    """
    for info in opened.arrays.values():
        values = small_values(opened, info) if _count(info) in sizes else None
        if values is None or values.dtype.kind not in "US":
            continue
        labels = np.char.decode(values) if values.dtype.kind == "S" else values
        if set(labels.ravel().tolist()) <= set(POLARIZATIONS) and labels.size:
            return list(labels.ravel().tolist())
    return ["HH?"]
