"""Results of gprMax, the open full-wave solver.

gprMax 3 ends its files in ``.out``, gprMax 4 in ``.h5``; both are HDF5 of one layout: the root's
attributes state version, time step and number of steps, ``rxs/rx1`` and so on hold the fields
``Ex`` to ``Hz`` in time with ``Name`` and ``Position`` as attributes, ``srcs/src1`` and so on
``Type`` and ``Position``.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import h5py
import numpy as np

from flgpr.formats.array_file import LIMIT
from flgpr.formats.arrays import check_dataset, open_arrays
from flgpr.formats.child import parts_elsewhere
from flgpr.model.printable import in_one_line
from flgpr.types import ArrayLike, Complex128Array, FloatArray, floats

_MERGED = (
    "this is a merged B-scan: give the scans' own results, "
    "or import it by a mapping that flgpr info drafts"
)
_FIELDS = ("Ex", "Ey", "Ez", "Hx", "Hy", "Hz", "Ix", "Iy", "Iz")
_DAMAGE = (TypeError, KeyError, OSError, RuntimeError, AttributeError, OverflowError)
"""What h5py raises on a damaged file, besides ValueError."""


@dataclass(frozen=True)
class GprmaxReceiver:
    """What was recorded at a node: ``fields`` by component ("Ex" and so on), V/m or A/m."""

    name: str
    position: FloatArray
    fields: dict[str, FloatArray]


class Excitation(NamedTuple):
    """What drove a source, as gprMax 4 stores it: current in A, and the dipole's length in m."""

    samples: FloatArray
    start: float
    length: float


@dataclass(frozen=True)
class GprmaxOutput:
    """A result file."""

    path: Path
    version: str  #: of gprMax
    title: str  #: of the model
    time_step: float  #: s; the electric field's first sample is at time 0
    steps: int
    cell: FloatArray  #: edges of a cell, m
    receivers: dict[str, GprmaxReceiver]  #: by name
    sources: list[tuple[str, FloatArray]]  #: type and position (m) of every source
    excitation: Excitation | None = None  #: of the first source, where the file holds it

    def current(self, waveform: str, centre: float, frequency: FloatArray) -> Complex128Array:
        """Compute the Fourier integral of a waveform of unit amplitude.

        Parameters
        ----------
        waveform : str
            Its type, see ``pulse``.
        centre : float
            Its frequency, Hz.
        frequency : (frequency,) ndarray
            Where the integral is taken, Hz.

        Returns
        -------
        (frequency,) ndarray of complex
            The integral, A per Hz, of samples at half steps as gprMax takes them.
        """
        start = 0.5 * self.time_step
        values = pulse(waveform, centre, start + self.time_step * np.arange(self.steps))
        return fourier_integral(values, self.time_step, frequency, start)

    def spectrum(self, receiver: str, component: str, frequency: FloatArray) -> Complex128Array:
        """Compute the Fourier integral of a receiver's electric field.

        Parameters
        ----------
        receiver : str
            Name of the receiver.
        component : str
            Component of the field, such as "Ez".
        frequency : (frequency,) ndarray
            Where the integral is taken, Hz.

        Returns
        -------
        (frequency,) ndarray of complex
            ``∫E(t)·exp(-j2πft)dt`` from time 0 on, V/m per Hz.

        Raises
        ------
        ValueError
            If the file does not hold that field.
        """
        if receiver not in self.receivers or component not in self.receivers[receiver].fields:
            raise ValueError(f"{self.path}: no {component} of a receiver named {receiver!r}")
        return fourier_integral(
            self.receivers[receiver].fields[component], self.time_step, frequency
        )


def read_gprmax(path: str | Path, limit: int = LIMIT) -> GprmaxOutput:
    """Read a result file of gprMax 3 or 4.

    Parameters
    ----------
    path : path
        The file.
    limit : int
        Bytes that the file and each array may take.

    Returns
    -------
    GprmaxOutput
        The result.

    Raises
    ------
    ValueError
        If the file is damaged, too large or of another kind.
    """
    path = Path(path)
    open_arrays(path, limit)  # reads the file in a child process first
    with faults_of_result(path):
        return _read(path, limit)


@contextmanager
def faults_of_result(path: Path) -> Iterator[None]:
    """Turn whatever h5py raises on a damaged result into one ValueError that names the file."""
    try:
        yield
    except _DAMAGE as error:
        raise ValueError(
            f"{path}: cannot be read as a result of gprMax: it is damaged "
            f"({in_one_line(error, 200)})"
        ) from None
    except ValueError as error:  # of h5py, too: for numbers of a type that NumPy has not
        message = in_one_line(error)
        raise ValueError(
            message if message.startswith(str(path)) else f"{path}: {message}"
        ) from None


def _read(path: Path, limit: int) -> GprmaxOutput:
    """Read a result file that is known to be sound."""
    with h5py.File(path, "r") as file:
        if "gprMax" not in file.attrs:
            raise ValueError(
                f"{path}: the root must have the attribute gprMax, "
                f"got {', '.join(file.attrs) or 'none'}"
            )
        refuse_parts_elsewhere(file)
        if merged_fields(file):
            raise ValueError(f"{path}: {_MERGED}")
        steps = int(_attribute(file, "Iterations", path))
        cell = floats(_attribute(file, "dx_dy_dz", path))
        time_step = float(_attribute(file, "dt", path))
        if not (0 < time_step < np.inf and steps > 0):
            raise ValueError(
                f"{path}: dt and Iterations must be greater than 0, got {time_step:g} s and {steps}"
            )
        receivers = {}
        for group in _numbered(file, "rxs"):
            receiver = _receiver(group, steps, path, limit)
            name = receiver.name
            if name in receivers:  # names are the model's author's, and may be the same
                name = f"{name} ({group.name.rpartition('/')[2]})"
            receivers[name] = receiver
        sources = [
            (attribute_text(group, "Type"), floats(_attribute(group, "Position", path)))
            for group in _numbered(file, "srcs")
        ]
        version, title = (attribute_text(file, name) for name in ("gprMax", "Title"))
        excitation = _excitation(file, limit)
        return GprmaxOutput(
            path, version, title, time_step, steps, cell, receivers, sources, excitation
        )


def refuse_parts_elsewhere(file: Any) -> None:
    """Refuse a file that leads to others: groups are read by name, and links would be followed."""
    for name, reason in parts_elsewhere(file).items():
        raise ValueError(f"{file.filename}: {name} must lie in this file, {reason}")


def _numbered(file: Any, name: str) -> list[Any]:
    """Return the groups in a group in the order of their numbers."""
    group = file.get(name)
    members = sorted(group, key=lambda key: (len(key), key)) if _is_group(group) else []
    return [group[key] for key in members if _is_group(group[key])]


def _is_group(item: Any) -> bool:
    """Return whether a part of a file is a group."""
    return isinstance(item, h5py.Group)


def _attribute(item: Any, name: str, path: Path) -> Any:
    """Return an attribute that must be there."""
    if name not in item.attrs:
        raise ValueError(
            f"{path}: {item.name} must have the attribute {name}, "
            f"got {', '.join(item.attrs) or 'none'}"
        )
    return item.attrs[name]


def attribute_text(item: Any, name: str, missing: str = "") -> str:
    """Return an attribute as text, or what stands for one that is missing."""
    value = item.attrs.get(name, missing)
    return value.decode(errors="replace") if isinstance(value, bytes) else str(value)


def _numbers(item: Any, limit: int) -> FloatArray:
    """Return the numbers of an array of a file, whose size is checked before it is read."""
    if item.nbytes > limit:
        raise ValueError(
            f"{item.name} must hold at most {limit / 1e9:g} GB, "
            f"got shape {item.shape} of {item.dtype}"
        )
    check_dataset(item.name, item)
    return floats(item[()])


def _excitation(file: Any, limit: int) -> Excitation | None:
    """Return what drove the first source, where the file holds its current."""
    group = file.get("srcs/src1/excitation")
    if not _is_group(group) or "samples" not in group or group.attrs.get("Units") != "A":
        return None
    start, length = group.attrs.get("TimeSampleOffset", 0.0), group.attrs.get("SpatialScale", 1.0)
    return Excitation(_numbers(group["samples"], limit), float(start), float(length))


def _receiver(group: Any, steps: int, path: Path, limit: int) -> GprmaxReceiver:
    """Return what a receiver recorded."""
    fields = {}
    for name in _FIELDS:
        if name not in group:
            continue
        shape = getattr(group[name], "shape", None)
        if shape != (steps,):
            raise ValueError(
                f"{path}: {group.name}/{name} must hold {steps} values, got the shape {shape}"
            )
        fields[name] = _numbers(group[name], limit)
    position = floats(_attribute(group, "Position", path))
    return GprmaxReceiver(attribute_text(group, "Name", group.name), position, fields)


def fourier_integral(
    values: FloatArray,
    time_step: float,
    frequency: FloatArray,
    start: float = 0.0,
) -> Complex128Array:
    """Compute the Fourier integral of samples.

    Parameters
    ----------
    values : (n,) ndarray
        The samples.
    time_step : float
        Time from sample to sample, s.
    frequency : (frequency,) ndarray
        Where the integral is taken, Hz.
    start : float
        Time of the first sample, s.

    Returns
    -------
    (frequency,) ndarray of complex
        ``Σ values·exp(-j2πft)·Δt``.
    """
    time = start + time_step * np.arange(values.size)
    out = [np.exp(-2j * np.pi * f * time) @ values for f in frequency]
    return np.asarray(out, dtype=np.complex128) * time_step


def pulse(kind: str, frequency: float, time: ArrayLike) -> FloatArray:
    """Evaluate a waveform of unit amplitude as gprMax defines it.

    Parameters
    ----------
    kind : {"gaussian", "gaussiandot", "gaussiandotnorm", "ricker"}
        Type of the waveform.
    frequency : float
        Its frequency, Hz.
    time : (n,) array_like
        Times, s.

    Returns
    -------
    (n,) ndarray
        Its values.

    Raises
    ------
    ValueError
        If the type is unknown, or the frequency not positive.
    """
    if not frequency > 0:
        raise ValueError(f"the waveform's frequency must be positive, got {frequency:g}")
    t = floats(time)
    if kind == "ricker":
        width = (np.pi * frequency) ** 2
        late = t - np.sqrt(2) / frequency
        return floats((1 - 2 * width * late**2) * np.exp(-width * late**2))
    width = 2 * (np.pi * frequency) ** 2
    late = t - 1 / frequency
    bell = np.exp(-width * late**2)
    factors = {
        "gaussian": 1.0,
        "gaussiandot": -2 * width * late,
        "gaussiandotnorm": -np.sqrt(2 * width * np.exp(1.0)) * late,
    }
    if kind not in factors:
        raise ValueError(
            f"the waveform must be gaussian, gaussiandot, gaussiandotnorm or ricker, got {kind!r}"
        )
    return floats(factors[kind] * bell)


def merged_fields(file: Any) -> dict[str, tuple[int, int]]:
    """Return the (step, trace) shapes of the fields of a merged B-scan by their names in the file.

    gprMax's tools/outputfiles_merge.py copies the root's attributes but those of the grid, and
    makes every receiver's fields two-dimensional.

    Parameters
    ----------
    file : h5py.File
        A result of gprMax.

    Returns
    -------
    dict of str to tuple of int
        The shapes; none if it is no merged B-scan.
    """
    shapes = {}
    for group in _numbered(file, "rxs"):
        for name in _FIELDS:
            shape = getattr(group.get(name), "shape", ())
            if len(shape) == 2:
                steps, traces = map(int, shape)
                shapes[f"{group.name.lstrip('/')}/{name}"] = (steps, traces)
    return shapes
