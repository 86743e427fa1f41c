"""Results of gprMax, the open full-wave solver, and runs put together from a folder of decks.

gprMax 3 ends its files in ``.out``, gprMax 4 in ``.h5``; both are HDF5 of one layout: the root's
attributes state version, time step and number of steps, ``rxs/rx1`` and so on hold the fields
``Ex`` to ``Hz`` in time with ``Name`` and ``Position`` as attributes, ``srcs/src1`` and so on
``Type`` and ``Position``.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import ArrayLike, NDArray

from flgpr.door import MOST_CHECKED, MOST_JSON, Folder, parse_json
from flgpr.formats.arrays import LIMIT, open_arrays
from flgpr.formats.child import parts_elsewhere
from flgpr.model import SPEED_OF_LIGHT
from flgpr.store.files import canonical_json

FloatArray = NDArray[np.float64]
FORMAT = "flgpr-gprmax-1"
MANIFEST = "manifest.json"
ENDINGS = (".h5", ".out")
_MERGED = (
    "this is a merged B-scan: give the scans' own results, "
    "or import it by a mapping that flgpr info drafts"
)
_FIELDS = ("Ex", "Ey", "Ez", "Hx", "Hy", "Hz", "Ix", "Iy", "Iz")
_MOST_RECEIVERS = 8  # that are described in words
_CELLS_PER_WAVELENGTH = 10  # below which gprMax disperses
_DAMAGE = (TypeError, KeyError, OSError, RuntimeError, AttributeError, OverflowError)
"""What h5py raises on a damaged file, besides ValueError."""
_NEEDED = (
    "title",
    "polarization",
    "tones",
    "tx_position",
    "rx_position",
    "pose",
    "time",
    "waveform",
    "grid",
    "runs",
)
"""Entries of a manifest."""


@dataclass(frozen=True)
class GprmaxReceiver:
    """What was recorded at a node: ``fields`` by component ("Ex" and so on), V/m or A/m."""

    name: str
    position: NDArray[np.float64]
    fields: dict[str, NDArray[np.float64]]


@dataclass(frozen=True)
class Excitation:
    """What drove a source, as gprMax 4 stores it: current in A, and the dipole's length in m."""

    samples: NDArray[np.float64]
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
    cell: NDArray[np.float64]  #: edges of a cell, m
    receivers: dict[str, GprmaxReceiver]  #: by name
    sources: list[tuple[str, NDArray[np.float64]]]  #: type and position (m) of every source
    excitation: Excitation | None = None  #: of the first source, where the file holds it

    def current(
        self, waveform: str, centre: float, frequency: NDArray[np.float64]
    ) -> NDArray[np.complex128]:
        """Compute the Fourier integral of a waveform of unit amplitude.

        Parameters
        ----------
        waveform : str
            Its type, see :func:`pulse`.
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
        return fourier(values, self.time_step, frequency, start)

    def spectrum(
        self, receiver: str, component: str, frequency: NDArray[np.float64]
    ) -> NDArray[np.complex128]:
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
        return fourier(self.receivers[receiver].fields[component], self.time_step, frequency)


def is_gprmax(path: str | Path) -> bool:
    """Return whether an HDF5 file that is known to be sound comes from gprMax."""
    with _faults_of_result(Path(path)), h5py.File(path, "r") as file:
        return "gprMax" in file.attrs


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
    with _faults_of_result(path):
        return _read(path)


@contextmanager
def _faults_of_result(path: Path) -> Iterator[None]:
    """Turn whatever h5py raises on a damaged result into one ValueError that names the file."""
    try:
        yield
    except _DAMAGE as error:
        words = " ".join(str(error).split())[:200]
        raise ValueError(
            f"{path}: cannot be read as a result of gprMax: it is damaged ({words})"
        ) from None
    except ValueError as error:  # of h5py, too: for numbers of a type that NumPy has not
        words = " ".join(str(error).split())
        raise ValueError(words if words.startswith(str(path)) else f"{path}: {words}") from None


def _read(path: Path) -> GprmaxOutput:
    """Read a result file that is known to be sound."""
    with h5py.File(path, "r") as file:
        if "gprMax" not in file.attrs:
            raise ValueError(
                f"{path}: the root must have the attribute gprMax, "
                f"got {', '.join(file.attrs) or 'none'}"
            )
        _refuse_parts_elsewhere(file)
        if merged_fields(file):
            raise ValueError(f"{path}: {_MERGED}")
        version = _attribute(file, "gprMax", path)
        steps = int(_attribute(file, "Iterations", path))
        cell = _attribute(file, "dx_dy_dz", path)
        time_step = float(_attribute(file, "dt", path))
        if not (np.isfinite(time_step) and time_step > 0 and steps > 0):
            raise ValueError(
                f"{path}: dt and Iterations must be greater than 0, got {time_step:g} s and {steps}"
            )
        receivers = {}
        for group in _numbered(file, "rxs"):
            receiver = _receiver(group, steps, path)
            name = receiver.name
            if name in receivers:  # names are the model's author's, and may be the same
                name = f"{name} ({group.name.rpartition('/')[2]})"
            receivers[name] = receiver
        sources = []
        for group in _numbered(file, "srcs"):
            position = np.asarray(_attribute(group, "Position", path), dtype=np.float64)
            sources.append((_text(group.attrs.get("Type", "")), position))
        return GprmaxOutput(
            path,
            _text(version),
            _text(file.attrs.get("Title", "")),
            time_step,
            steps,
            np.asarray(cell, dtype=np.float64),
            receivers,
            sources,
            _excitation(file),
        )


def _refuse_parts_elsewhere(file: Any) -> None:
    """Refuse a file that leads to others: groups are read by name, and links would be followed."""
    for name, reason in parts_elsewhere(file).items():
        raise ValueError(f"{file.filename}: {name} must lie in this file, {reason}")


def _numbered(file: Any, name: str) -> list[Any]:
    """Return the groups in a group in the order of their numbers."""
    group = file.get(name)
    if not isinstance(group, h5py.Group):
        return []
    members = [group[key] for key in sorted(group, key=lambda key: (len(key), key))]
    return [member for member in members if isinstance(member, h5py.Group)]


def _attribute(item: Any, name: str, path: Path) -> Any:
    """Return an attribute that must be there."""
    if name not in item.attrs:
        raise ValueError(
            f"{path}: {item.name} must have the attribute {name}, "
            f"got {', '.join(item.attrs) or 'none'}"
        )
    return item.attrs[name]


def _text(value: Any) -> str:
    """Return an attribute as text."""
    return value.decode(errors="replace") if isinstance(value, bytes) else str(value)


def _excitation(file: Any) -> Excitation | None:
    """Return what drove the first source, where the file holds its current."""
    group = file.get("srcs/src1/excitation")
    if not isinstance(group, h5py.Group) or "samples" not in group:
        return None
    if group.attrs.get("Units") != "A":
        return None
    samples = np.asarray(group["samples"][()], dtype=np.float64)
    length = group.attrs.get("SpatialScale", 1.0)
    return Excitation(samples, float(group.attrs.get("TimeSampleOffset", 0.0)), float(length))


def _receiver(group: Any, steps: int, path: Path) -> GprmaxReceiver:
    """Return what a receiver recorded."""
    fields = {}
    for name in _FIELDS:
        if name not in group:
            continue
        values = np.asarray(group[name][()], dtype=np.float64)
        if values.shape != (steps,):
            raise ValueError(
                f"{path}: {group.name}/{name} must hold {steps} values, "
                f"got the shape {values.shape}"
            )
        fields[name] = values
    position = np.asarray(_attribute(group, "Position", path), dtype=np.float64)
    return GprmaxReceiver(_text(group.attrs.get("Name", group.name)), position, fields)


def fourier(
    values: NDArray[np.float64],
    time_step: float,
    frequency: NDArray[np.float64],
    start: float = 0.0,
) -> NDArray[np.complex128]:
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


def pulse(kind: str, frequency: float, time: ArrayLike) -> NDArray[np.float64]:
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
    t = np.asarray(time, dtype=np.float64)
    if kind == "ricker":
        width = (np.pi * frequency) ** 2
        late = t - np.sqrt(2) / frequency
        return np.asarray((1 - 2 * width * late**2) * np.exp(-width * late**2))
    width = 2 * (np.pi * frequency) ** 2
    late = t - 1 / frequency
    bell = np.exp(-width * late**2)
    if kind == "gaussian":
        return np.asarray(bell)
    if kind == "gaussiandot":
        return np.asarray(-2 * width * late * bell)
    if kind == "gaussiandotnorm":
        return np.asarray(-np.sqrt(2 * width * np.exp(1.0)) * late * bell)
    raise ValueError(
        f"the waveform must be gaussian, gaussiandot, gaussiandotnorm or ricker, got {kind!r}"
    )


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
            item = group.get(name)
            if isinstance(item, h5py.Dataset) and len(item.shape) == 2:
                steps, traces = item.shape
                shapes[f"{group.name.lstrip('/')}/{name}"] = (int(steps), int(traces))
    return shapes


def explain_merged(path: Path) -> tuple[list[str], str]:
    """Return in lines what a merged B-scan holds, and a draft of the mapping that imports it.

    Parameters
    ----------
    path : Path
        A result of gprMax.

    Returns
    -------
    lines : list of str
        What it holds; none if it is no merged B-scan.
    mapping : str
        The draft, TOML.

    Raises
    ------
    ValueError
        If the file is damaged.
    """
    with _faults_of_result(path), h5py.File(path, "r") as file:
        _refuse_parts_elsewhere(file)
        fields = merged_fields(file)
        if not fields:
            return [], ""
        version = _text(file.attrs["gprMax"])
        title = _text(file.attrs.get("Title", ""))
        interval = float(np.asarray(file.attrs.get("dt", np.nan)))
    if not (np.isfinite(interval) and interval > 0):
        raise ValueError(f"{path}: dt must be greater than 0, got {interval:g} s")
    # The field of a source along the same axis is the strongest, mostly Ez.
    chosen = next((name for name in fields if name.endswith("/Ez")), next(iter(fields)))
    steps, traces = fields[chosen]
    lines = [
        f"result of gprMax {version}: {title or 'no title'}",
        f"merged B-scan of {traces} traces x {steps} steps of {1e9 * interval:.4g} ns",
    ]
    lines += [f"{name}: {shape[0]} x {shape[1]}" for name, shape in fields.items()]
    lines.append(
        "a merged file tells neither cells nor places: "
        "where the scans were is for the mapping to say"
    )
    draft = [
        f"# Draft for {path.name}. "
        "What ends in a question mark is a guess: check it and take the mark away.",
        f"title = {json.dumps(title or path.stem)}",
        'polarization = ["HH?"]',
        "",
        "[files]",
        f"data = {json.dumps(path.name)}",
        "",
        "[signal]",
        f"variable = {json.dumps(chosen)}",
        f'dims = ["sample", "scan"]  # of {steps} x {traces}',
        "",
        "[samples]",
        f"span = [0.0, {interval * (steps - 1):.9g}]"
        "  # of gprMax's own clock: the pulse leaves later",
        'unit = "s"',
        'meaning = "delay?"  # delay, range (one way) or path (there and back)',
        "band = []  # first and last frequency to keep",
        'band_unit = "GHz"',
        "",
        "[antenna_position]  # in the vehicle frame",
        'x = "0?"',
        'y = "0?"',
        'z = "0?"',
        'unit = "m"',
        "",
        "[pose]  # of every scan: of a file beside this one, or by flgpr import mapped --survey",
        'x = "?"',
        'y = "?"',
        'z = "?"',
        'unit = "m?"',
        'heading = "0?"',
        'pitch = "0?"',
        'roll = "0?"',
        'angle_unit = "deg"',
    ]
    return lines, "\n".join(draft) + "\n"


def explain_gprmax(path: Path) -> list[str]:
    """Return what a result file holds, a line per fact.

    Parameters
    ----------
    path : Path
        A result of gprMax.

    Returns
    -------
    list of str
        The lines.

    Raises
    ------
    ValueError
        If the file is damaged.
    """
    output = read_gprmax(path)
    nanoseconds = 1e9 * output.steps * output.time_step
    highest = SPEED_OF_LIGHT / (_CELLS_PER_WAVELENGTH * output.cell.max())
    edges = " x ".join(f"{1000 * edge:g}" for edge in output.cell)
    lines = [
        f"result of gprMax {output.version}: {output.title or 'no title'}",
        f"{output.steps} time steps of {1e12 * output.time_step:.4g} ps, {nanoseconds:.4g} ns",
        f"cells of {edges} mm, ten per wavelength in air up to {highest / 1e9:.3g} GHz",
    ]
    for kind, position in output.sources:
        lines.append(f"source {kind or 'of unknown type'} at {_coordinates(position)}")
    receivers = list(output.receivers.values())
    lines += [_receiver_line(receiver) for receiver in receivers[:_MOST_RECEIVERS]]
    if len(receivers) > _MOST_RECEIVERS:
        lines.append(f"and {len(receivers) - _MOST_RECEIVERS} more receivers")
    manifest = path.with_name(MANIFEST)
    if manifest.is_file():
        lines.append(
            f"{manifest.name} beside it: the folder is read by flgpr import gprmax {path.parent}"
        )
    else:
        lines.append(
            "flgpr import gprmax reads it when told band, transmit and ground, one file per scan"
        )
    return lines


def _receiver_line(receiver: GprmaxReceiver) -> str:
    """Return in words what a receiver recorded."""
    bad = sum(int(np.count_nonzero(~np.isfinite(values))) for values in receiver.fields.values())
    line = (
        f"receiver {receiver.name} at {_coordinates(receiver.position)}: "
        f"{', '.join(receiver.fields)}"
    )
    return line + (f", {bad} values not finite" if bad else "")


def _coordinates(position: NDArray[np.float64]) -> str:
    """Return a position in words."""
    return "(" + ", ".join(f"{coordinate:.3f}" for coordinate in position) + ") m"


def read_manifest_of_decks(folder: str | Path) -> dict[str, Any]:
    """Read the manifest of a folder of gprMax decks.

    Parameters
    ----------
    folder : path
        The folder.

    Returns
    -------
    dict of str to Any
        The manifest, as :class:`flgpr.simulate.Decks` describes it.

    Raises
    ------
    FileNotFoundError
        If there is no such folder.
    ValueError
        If the manifest is missing, damaged or of another version.
    """
    folder = Path(folder)
    if not folder.is_dir():
        raise FileNotFoundError(f"folder of gprMax results not found: {folder}")
    path = folder / MANIFEST
    try:
        manifest: dict[str, Any] = parse_json(Folder(folder).read(MANIFEST, MOST_JSON))
        if manifest["format"] != FORMAT:
            raise ValueError(f"format must be {FORMAT}, got {manifest['format']!r}")
        missing = [name for name in _NEEDED if name not in manifest]
        if missing:
            raise ValueError(f"missing: {', '.join(missing)}")
    except FileNotFoundError:
        raise ValueError(
            f"{folder}: must hold the {MANIFEST} that flgpr simulate --engine gprmax wrote, "
            "it does not"
        ) from None
    except (ValueError, KeyError, TypeError) as error:
        raise ValueError(
            f"{path}: the manifest is damaged or of another version ({error})"
        ) from None
    return manifest


class GprmaxRun:
    """The results of a folder of decks, ``manifest.json`` and all results, as the scans of a run.

    A scan is a pair's field over the transmitter's current moment, V/m per A·m, its direct wave
    (from the run of air alone) taken off unless ``keep_direct``, times j, so that a scatterer at
    path L gives ``exp(-j2πfL/c)`` as everywhere in flgpr.

    Parameters
    ----------
    folder : path
        The folder.
    keep_direct : bool
        Whether the direct wave stays.

    Raises
    ------
    ValueError
        If the manifest is damaged, or results are missing.
    """

    def __init__(self, folder: str | Path, keep_direct: bool = False) -> None:
        self.folder = Path(folder)
        self.keep_direct = keep_direct
        self.manifest = read_manifest_of_decks(folder)
        tones = self.manifest["tones"]
        numbers = np.arange(tones["count"], dtype=np.float64)
        self.frequency = tones["start"] + tones["step"] * numbers
        needed = {run["file"] for run in self.manifest["runs"]}
        if not keep_direct:
            needed |= {run["free"] for run in self.manifest["runs"]}
        self._needed = sorted(needed)
        missing = [name for name in self._needed if self._result(name) is None]
        if missing:
            raise ValueError(
                f"{folder}: {len(missing)} of {len(needed)} results are missing, "
                f"{missing[0]}{ENDINGS[0]} (or {ENDINGS[1]}) among them: "
                f"run gprMax on {missing[0]}.in"
            )
        # Of the scan before, which is often that of the next.
        self._air: dict[str, GprmaxOutput] = {}

    def __len__(self) -> int:
        return len(self.manifest["pose"])

    def scan(self, index: int) -> NDArray[np.complex64]:
        """Put a scan together.

        Parameters
        ----------
        index : int
            Its number, from 0.

        Returns
        -------
        (polarization, pair, frequency) ndarray of complex
            Field over current moment, NaN where not finite.

        Raises
        ------
        ValueError
            If a result is damaged or does not fit the manifest.
        """
        labels = self.manifest["polarization"]
        pairs = len(self.manifest["tx_position"])
        signal = np.full((len(labels), pairs, self.frequency.size), np.nan, dtype=np.complex128)
        runs = [run for run in self.manifest["runs"] if run["scan"] == index]
        free = {run["free"] for run in runs}
        self._air = {name: air for name, air in self._air.items() if name in free}
        for run in runs:
            scene = read_gprmax(self._result(run["file"]) or "")
            air = None if self.keep_direct else self._read_air(run["free"])
            self._check(scene)
            moment = self._moment(scene)
            for pair, receiver in zip(run["pairs"], run["receivers"], strict=True):
                for row, label in enumerate(labels):
                    if label[0] != run["transmit"]:
                        continue
                    field = self._field(scene, receiver[label[1]])
                    if air is not None:
                        field = field - self._field(air, receiver[label[1]])
                    signal[row, pair] = 1j * field / moment
        return signal.astype(np.complex64)

    def digest(self) -> str:
        """Return the SHA-256 of the manifest and all results that the scans are made of."""
        digest = hashlib.sha256(canonical_json(self.manifest))
        for name in self._needed:
            with Folder(self.folder).open(self._file(name) or name, MOST_CHECKED) as file:
                digest.update(hashlib.file_digest(file, "sha256").digest())
        return digest.hexdigest()

    def _result(self, name: str) -> Path | None:
        """Return a result that the manifest names.

        It must be a regular file in the folder; a link, or one outside, is refused.
        """
        file = self._file(name)
        if file is None:
            return None
        Folder(self.folder).check_size(file)
        return self.folder / file

    def _file(self, name: str) -> str | None:
        """Return the name of the file of a result, with its ending."""
        for ending in ENDINGS:
            if Folder(self.folder).has(f"{name}{ending}"):
                return f"{name}{ending}"
        return None

    def _read_air(self, name: str) -> GprmaxOutput:
        """Read the result of air alone, unless the scan before had the same."""
        if name not in self._air:
            self._air[name] = read_gprmax(self._result(name) or "")
        return self._air[name]

    def _check(self, output: GprmaxOutput) -> None:
        """Refuse a result whose cells or duration are not those of the manifest."""
        grid = self.manifest["grid"]
        if np.abs(output.cell - grid["cell"]).max() > 1e-6 * grid["cell"]:
            raise ValueError(
                f"{output.path}: cells must be {grid['cell']:g} m as in the manifest, "
                f"got {output.cell}"
            )
        duration = output.steps * output.time_step
        if duration < 0.99 * grid["time_window"]:
            raise ValueError(
                f"{output.path}: must last {grid['time_window']:g} s, got {duration:g} s"
            )

    def _field(self, output: GprmaxOutput, terms: list[Any]) -> NDArray[np.complex128]:
        """Return the weighted sum (frequency,) of components of the field at receivers."""
        total = np.zeros(self.frequency.size, dtype=np.complex128)
        for name, component, weight in terms:
            total += weight * output.spectrum(name, f"E{component}", self.frequency)
        return total

    def _moment(self, output: GprmaxOutput) -> NDArray[np.complex128]:
        """Return the spectrum of the dipole's current moment, A·m per Hz.

        It is the current, at half steps, times a cell's edge.
        """
        waveform = self.manifest["waveform"]
        kind = str(waveform["type"])
        current = output.current(kind, float(waveform["frequency"]), self.frequency)
        return current * float(output.cell[0])
