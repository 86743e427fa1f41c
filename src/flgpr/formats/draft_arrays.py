"""Which arrays of a file are the measured field, and which name its polarizations."""

from __future__ import annotations

import math
import re
from typing import NamedTuple

from flgpr.formats.array_file import ArrayFile, ArrayInfo
from flgpr.formats.draft_units import small_values
from flgpr.model import POLARIZATIONS

_NO_FIELD = re.compile(r"covariance|orientation|rotation")
_COMPLEX = re.compile(r"complex|.*(\('r(eal)?'|\('re')", re.DOTALL)
_PHASE = re.compile(r"phase|(?<![a-z])ang(?:le)?(?![a-z])|(?<![a-z])arg(?![a-z])")
_MAGNITUDE = re.compile(r"mag|(?<![a-z])db|amp|(?<![a-z])abs")
_IMAGINARY = (("real", "imag"), ("re", "im"), ("_i", "_q"))
"""What names of real parts hold, and those of imaginary parts in its stead."""


def find_signal(opened: ArrayFile) -> tuple[ArrayInfo | None, str | None]:
    """Find the array that is most likely the measured field.

    Parameters
    ----------
    opened : ArrayFile
        The file.

    Returns
    -------
    signal : ArrayInfo or None
        The array; None if there is none.
    imaginary : str or None
        The array of its imaginary part, if that is apart.
    """
    if opened.signal:
        return opened.arrays[opened.signal], None
    arrays = [info for info in opened.arrays.values() if math.prod(info.shape) > 1]
    complex_arrays = [info for info in arrays if _COMPLEX.match(info.dtype)]
    if complex_arrays:
        return _largest(complex_arrays), None
    for info in arrays:
        imaginary = _imaginary_of(info, opened)
        if imaginary is not None:
            return info, imaginary
    large = []
    for info in arrays:
        is_table = len(info.shape) >= 2 and info.shape[-1] > 3
        if is_table and not _NO_FIELD.search(info.name):
            large.append(info)
    return (_largest(large) if large else None), None


class PolarSignal(NamedTuple):
    """A measured field as network analysers export it: magnitude and phase apart."""

    magnitude: ArrayInfo
    phase: ArrayInfo
    form: str  #: of the magnitude: "dB" or "linear"
    unit: str  #: of the phase: "deg" or "rad"


def find_polar(opened: ArrayFile) -> PolarSignal | None:
    """Find a magnitude and a phase by their names: the first of a file whose shapes agree.

    Parameters
    ----------
    opened : ArrayFile
        The file.

    Returns
    -------
    PolarSignal or None
        The arrays; None if there is no such pair.
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
                return PolarSignal(info, phase, form, unit)
    return None


def _largest(infos: list[ArrayInfo]) -> ArrayInfo:
    """Return the array of most values."""
    return max(infos, key=lambda info: math.prod(info.shape))


def _imaginary_of(info: ArrayInfo, opened: ArrayFile) -> str | None:
    """Return the array whose name and shape make it the imaginary part of another."""
    for real, imaginary in _IMAGINARY:
        expected = re.sub(real, imaginary, info.name, flags=re.IGNORECASE).lower()
        for name, other in opened.arrays.items():
            if name.lower() == expected and name != info.name:
                if other.shape == info.shape:
                    return name
                break
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
        if math.prod(info.shape) not in sizes:
            continue
        values = small_values(opened, info)
        if values is None or values.dtype.kind not in "US":
            continue
        labels = []
        for value in values.ravel():
            labels.append(value.decode() if isinstance(value, bytes) else str(value))
        if labels and set(labels) <= set(POLARIZATIONS):
            return labels
    return ["HH?"]
