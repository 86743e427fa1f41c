"""Results of gprMax, the open full-wave solver: its HDF5 files, and runs put together from those of a folder of decks.

gprMax 3 ends its files in ``.out``, gprMax 4 in ``.h5``; the layout is the same: the root's attributes tell version,
time step and number of steps, ``rxs/rx1`` and so on hold the fields ``Ex`` to ``Hz`` in time with ``Name`` and
``Position`` as attributes, ``srcs/src1`` and so on ``Type`` and ``Position``.
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

from flgpr.door import MOST_CHECKED, MOST_JSON, Folder, check_expansion, parse_json
from flgpr.formats.arrays import LIMIT, open_arrays
from flgpr.formats.child import parts_elsewhere
from flgpr.store.files import canonical_json

FloatArray = NDArray[np.float64]
FORMAT = "flgpr-gprmax-1"
MANIFEST = "manifest.json"
ENDINGS = (".h5", ".out")
_MERGED = "this is a merged B-scan: give the scans' own results, or import it by a mapping that flgpr info drafts"
_FIELDS = ("Ex", "Ey", "Ez", "Hx", "Hy", "Hz", "Ix", "Iy", "Iz")


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
        """Fourier integral of a waveform of unit amplitude, at half steps as gprMax takes it."""
        start = 0.5 * self.time_step
        values = pulse(waveform, centre, start + self.time_step * np.arange(self.steps))
        return fourier(values, self.time_step, frequency, start)

    def spectrum(
        self, receiver: str, component: str, frequency: NDArray[np.float64]
    ) -> NDArray[np.complex128]:
        """Fourier integral ``∫E(t)·exp(-j2πft)dt`` of a receiver's electric field from time 0 on, V/m per Hz."""
        if receiver not in self.receivers or component not in self.receivers[receiver].fields:
            raise ValueError(f"{self.path}: no {component} of a receiver named {receiver!r}")
        return fourier(self.receivers[receiver].fields[component], self.time_step, frequency)


def is_gprmax(path: str | Path) -> bool:
    """Tell whether an HDF5 file that is known to be sound comes from gprMax."""
    with _faults_of_result(Path(path)), h5py.File(path, "r") as file:
        return "gprMax" in file.attrs


def read_gprmax(path: str | Path, limit: int = LIMIT) -> GprmaxOutput:
    """Read a result file of gprMax 3 or 4, at most ``limit`` bytes; a damaged or other file is a ValueError."""
    path = Path(path)
    open_arrays(path, limit)  # looks at the file in a child process first
    with _faults_of_result(path):
        return _read(path, limit)


@contextmanager
def _faults_of_result(path: Path) -> Iterator[None]:
    """Turn whatever h5py raises on a damaged result into one ValueError that names the file."""
    try:
        yield
    except (TypeError, KeyError, OSError, RuntimeError, AttributeError, OverflowError) as error:
        words = " ".join(str(error).split())[:200]
        raise ValueError(
            f"{path}: cannot be read as a result of gprMax: it is damaged ({words})"
        ) from None
    except ValueError as error:  # of h5py, too: for numbers of a type that NumPy has not
        told = " ".join(str(error).split())
        raise ValueError(told if told.startswith(str(path)) else f"{path}: {told}") from None


def _read(path: Path, limit: int) -> GprmaxOutput:
    with h5py.File(path, "r") as file:
        if "gprMax" not in file.attrs:
            raise ValueError(
                f"{path}: the root must have the attribute gprMax, got {', '.join(file.attrs) or 'none'}"
            )
        _refuse_parts_elsewhere(file)
        if merged_fields(file):
            raise ValueError(f"{path}: {_MERGED}")
        told = {
            name: _attribute(file, name, path)
            for name in ("gprMax", "Iterations", "dx_dy_dz", "dt")
        }
        step = float(told["dt"])
        steps = int(told["Iterations"])
        if not (np.isfinite(step) and step > 0 and steps > 0):
            raise ValueError(
                f"{path}: dt and Iterations must be greater than 0, got {step:g} s and {steps}"
            )
        receivers = {}
        for group in _numbered(file, "rxs"):
            receiver = _receiver(group, steps, path, limit)
            name = receiver.name
            if name in receivers:  # names are the model's author's, and may be the same
                name = f"{name} ({group.name.rpartition('/')[2]})"
            receivers[name] = receiver
        sources = [
            (
                _text(group.attrs.get("Type", "")),
                np.asarray(_attribute(group, "Position", path), dtype=np.float64),
            )
            for group in _numbered(file, "srcs")
        ]
        return GprmaxOutput(
            path, _text(told["gprMax"]), _text(file.attrs.get("Title", "")), step, steps,
            np.asarray(told["dx_dy_dz"], dtype=np.float64), receivers, sources,
            _excitation(file, limit),
        )  # fmt: skip


def _refuse_parts_elsewhere(file: Any) -> None:
    """Refuse a file that leads to others: groups are found by their names, and links would be followed."""
    for name, reason in parts_elsewhere(file).items():
        raise ValueError(f"{file.filename}: {name} must lie in this file, {reason}")


def _numbered(file: Any, name: str) -> list[Any]:
    groups = file.get(name)
    if not isinstance(groups, h5py.Group):
        return []
    members = [groups[key] for key in sorted(groups, key=lambda key: (len(key), key))]
    return [one for one in members if isinstance(one, h5py.Group)]


def _attribute(item: Any, name: str, path: Path) -> Any:
    if name not in item.attrs:
        raise ValueError(
            f"{path}: {item.name} must have the attribute {name}, got {', '.join(item.attrs) or 'none'}"
        )
    return item.attrs[name]


def _text(value: Any) -> str:
    return value.decode(errors="replace") if isinstance(value, bytes) else str(value)


def _numbers(item: Any, limit: int) -> FloatArray:
    """Return the numbers of an array of a file, whose size is checked before it is read."""
    if item.nbytes > limit:
        raise ValueError(
            f"{item.name} must hold at most {limit / 1e9:g} GB, got shape {item.shape} of {item.dtype}"
        )
    check_expansion(item.name, item.nbytes, item.id.get_storage_size())
    return np.asarray(item[()], dtype=np.float64)


def _excitation(file: Any, limit: int) -> Excitation | None:
    group = file.get("srcs/src1/excitation")
    if (
        not isinstance(group, h5py.Group)
        or "samples" not in group
        or group.attrs.get("Units") != "A"
    ):
        return None
    samples = _numbers(group["samples"], limit)
    length = group.attrs.get("SpatialScale", 1.0)
    return Excitation(samples, float(group.attrs.get("TimeSampleOffset", 0.0)), float(length))


def _receiver(group: Any, steps: int, path: Path, limit: int) -> GprmaxReceiver:
    fields = {}
    for name in _FIELDS:
        if name in group:
            shape = getattr(group[name], "shape", None)
            if shape != (steps,):
                raise ValueError(
                    f"{path}: {group.name}/{name} must hold {steps} values, got the shape {shape}"
                )
            fields[name] = _numbers(group[name], limit)
    position = np.asarray(_attribute(group, "Position", path), dtype=np.float64)
    return GprmaxReceiver(_text(group.attrs.get("Name", group.name)), position, fields)


def fourier(
    values: NDArray[np.float64],
    time_step: float,
    frequency: NDArray[np.float64],
    start: float = 0.0,
) -> NDArray[np.complex128]:
    """Fourier integral of samples from ``start`` on: ``Σ values·exp(-j2πft)·Δt``."""
    time = start + time_step * np.arange(values.size)
    out = [np.exp(-2j * np.pi * f * time) @ values for f in frequency]
    return np.asarray(out, dtype=np.complex128) * time_step


def pulse(kind: str, frequency: float, time: ArrayLike) -> NDArray[np.float64]:
    """Evaluate a waveform of unit amplitude as gprMax defines it."""
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
    """Return the fields of a merged B-scan by their names in the file: their (step, trace) shapes; none if it is none.

    gprMax's tools/outputfiles_merge.py copies the root's attributes but those of the grid, and makes every receiver's
    fields two-dimensional.
    """
    found = {}
    for group in _numbered(file, "rxs"):
        for name in _FIELDS:
            item = group.get(name)
            if isinstance(item, h5py.Dataset) and len(item.shape) == 2:
                found[f"{group.name.lstrip('/')}/{name}"] = (int(item.shape[0]), int(item.shape[1]))
    return found


def explain_merged(path: Path) -> tuple[list[str], str]:
    """Tell in lines what a merged B-scan holds, and draft the mapping that imports it; no lines if it is none."""
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
        *(f"{name}: {shape[0]} x {shape[1]}" for name, shape in fields.items()),
        "a merged file tells neither cells nor places: where the scans were is for the mapping to say",
    ]
    mapping = [
        f"# Draft for {path.name}. What ends in a question mark is a guess: check it and take the mark away.",
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
        f"span = [0.0, {interval * (steps - 1):.9g}]  # of gprMax's own clock: the pulse leaves later",
        'unit = "s"',
        'meaning = "delay?"  # delay, range (one way) or path (there and back)',
        "band = []  # first and last frequency to keep",
        'band_unit = "GHz"',
        "",
        "[antenna_position]  # in the vehicle frame",
        *(f'{axis} = "0?"' for axis in "xyz"),
        'unit = "m"',
        "",
        "[pose]  # of every scan: of a file beside this one, or by flgpr import mapped --survey",
        *(f'{axis} = "?"' for axis in "xyz"),
        'unit = "m?"',
        'heading = "0?"',
        'pitch = "0?"',
        'roll = "0?"',
        'angle_unit = "deg"',
    ]
    return lines, "\n".join(mapping) + "\n"


def explain_gprmax(path: Path) -> list[str]:
    """Tell what a result file holds, a line per fact."""
    output = read_gprmax(path)
    nanoseconds = 1e9 * output.steps * output.time_step
    highest = 299_792_458.0 / (10 * output.cell.max())
    lines = [
        f"result of gprMax {output.version}: {output.title or 'no title'}",
        f"{output.steps} time steps of {1e12 * output.time_step:.4g} ps, {nanoseconds:.4g} ns",
        f"cells of {' x '.join(f'{1000 * c:g}' for c in output.cell)} mm, ten per wavelength in air up to "
        f"{highest / 1e9:.3g} GHz",
        *(
            f"source {kind or 'of unknown type'} at {_place(position)}"
            for kind, position in output.sources
        ),
    ]
    for one in list(output.receivers.values())[:8]:
        bad = sum(int(np.count_nonzero(~np.isfinite(v))) for v in one.fields.values())
        lines.append(
            f"receiver {one.name} at {_place(one.position)}: {', '.join(one.fields)}"
            + (f", {bad} values not finite" if bad else "")
        )
    if len(output.receivers) > 8:
        lines.append(f"and {len(output.receivers) - 8} more receivers")
    beside = path.with_name(MANIFEST)
    if beside.is_file():
        lines.append(
            f"{beside.name} beside it: the folder is read by flgpr import gprmax {path.parent}"
        )
    else:
        lines.append(
            "flgpr import gprmax reads it when told band, transmit and ground, one file per scan"
        )
    return lines


def _place(position: NDArray[np.float64]) -> str:
    return "(" + ", ".join(f"{v:.3f}" for v in position) + ") m"


def read_manifest_of_decks(folder: str | Path) -> dict[str, Any]:
    """Read the manifest, as :class:`flgpr.simulate.Decks` describes it, of a folder of gprMax decks."""
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
            f"{folder}: must hold the {MANIFEST} that flgpr simulate --engine gprmax wrote, it does not"
        ) from None
    except (ValueError, KeyError, TypeError) as error:
        raise ValueError(
            f"{path}: the manifest is damaged or of another version ({error})"
        ) from None
    return manifest


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


class GprmaxRun:
    """The results of a folder of decks, ``manifest.json`` and all results, as the scans of a run.

    A pair's field over the transmitter's current moment, V/m per A·m, its direct wave (from the run of air alone) taken
    off unless ``keep_direct``, times j, so that a scatterer at path L gives ``exp(-j2πfL/c)`` as everywhere in flgpr.
    """

    def __init__(self, folder: str | Path, keep_direct: bool = False) -> None:
        self.folder = Path(folder)
        self.keep_direct = keep_direct
        self.manifest = read_manifest_of_decks(folder)
        tones = self.manifest["tones"]
        self.frequency = tones["start"] + tones["step"] * np.arange(
            tones["count"], dtype=np.float64
        )
        wanted = {run["file"] for run in self.manifest["runs"]}
        if not keep_direct:
            wanted |= {run["free"] for run in self.manifest["runs"]}
        self._wanted = sorted(wanted)
        missing = [name for name in self._wanted if self._found(name) is None]
        if missing:
            raise ValueError(
                f"{folder}: {len(missing)} of {len(wanted)} results are missing, {missing[0]}{ENDINGS[0]} (or "
                f"{ENDINGS[1]}) among them: run gprMax on {missing[0]}.in"
            )
        self._air: dict[
            str, GprmaxOutput
        ] = {}  # of the scan before, which is often that of the next

    def __len__(self) -> int:
        return len(self.manifest["pose"])

    def scan(self, index: int) -> NDArray[np.complex64]:
        """Put a scan together: (polarization, pair, frequency) of field over current moment, NaN where not finite."""
        labels = self.manifest["polarization"]
        pairs = len(self.manifest["tx_position"])
        signal = np.full((len(labels), pairs, self.frequency.size), np.nan, dtype=np.complex128)
        runs = [run for run in self.manifest["runs"] if run["scan"] == index]
        self._air = {
            name: air for name, air in self._air.items() if name in {run["free"] for run in runs}
        }
        for run in runs:
            scene = read_gprmax(self._found(run["file"]) or "")
            air = None if self.keep_direct else self._read_air(run["free"])
            self._check(scene)
            moment = self._moment(scene)
            for pair, receiver in zip(run["pairs"], run["receivers"], strict=True):
                for row, label in enumerate(labels):
                    if label[0] == run["transmit"]:
                        field = self._field(scene, receiver[label[1]])
                        if air is not None:
                            field = field - self._field(air, receiver[label[1]])
                        signal[row, pair] = 1j * field / moment
        return signal.astype(np.complex64)

    def digest(self) -> str:
        """SHA-256 of the manifest and all results that the scans are made of."""
        whole = hashlib.sha256(canonical_json(self.manifest))
        for name in self._wanted:
            with Folder(self.folder).open(self._file(name) or name, MOST_CHECKED) as file:
                whole.update(hashlib.file_digest(file, "sha256").digest())
        return whole.hexdigest()

    def _found(self, name: str) -> Path | None:
        """Find a result that the manifest names: a regular file in the folder; a link, or one outside, is refused."""
        file = self._file(name)
        if file is None:
            return None
        Folder(self.folder).check_size(file)
        return self.folder / file

    def _file(self, name: str) -> str | None:
        names = (f"{name}{end}" for end in ENDINGS)
        return next((file for file in names if Folder(self.folder).has(file)), None)

    def _read_air(self, name: str) -> GprmaxOutput:
        if name not in self._air:
            self._air[name] = read_gprmax(self._found(name) or "")
        return self._air[name]

    def _check(self, output: GprmaxOutput) -> None:
        grid = self.manifest["grid"]
        if np.abs(output.cell - grid["cell"]).max() > 1e-6 * grid["cell"]:
            raise ValueError(
                f"{output.path}: cells must be {grid['cell']:g} m as in the manifest, got {output.cell}"
            )
        if output.steps * output.time_step < 0.99 * grid["time_window"]:
            raise ValueError(
                f"{output.path}: must last {grid['time_window']:g} s, got {output.steps * output.time_step:g} s"
            )

    def _field(self, output: GprmaxOutput, parts: list[Any]) -> NDArray[np.complex128]:
        total = np.zeros(self.frequency.size, dtype=np.complex128)
        for name, component, weight in parts:
            total += weight * output.spectrum(name, f"E{component}", self.frequency)
        return total

    def _moment(self, output: GprmaxOutput) -> NDArray[np.complex128]:
        """Spectrum of the whole dipole's current moment, A·m per Hz: current, at half steps, times a cell's edge."""
        waveform = self.manifest["waveform"]
        current = output.current(
            str(waveform["type"]), float(waveform["frequency"]), self.frequency
        )
        return current * float(output.cell[0])
