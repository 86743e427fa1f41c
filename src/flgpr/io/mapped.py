"""Import by a mapping: arrays of other people's files become a run."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr
from numpy.typing import ArrayLike, NDArray

from flgpr.io.arrays import LIMIT, ArrayFile, open_arrays
from flgpr.io.mapping import Index, Mapping, PathOffset, Positions, Quantity, Samples, factor, read_mapping
from flgpr.model import POSE_COMPONENTS, SPEED_OF_LIGHT, check_frequency, make_run
from flgpr.model.phase import lengthen
from flgpr.model.track import course, make_track, poses_at, reference_track

_ORDER = ("scan", "polarization", "pair", "frequency")
_LARGEST, _SMALLEST = 1e30, 1e-30
_HIGHEST_FREQUENCY = 1e12
FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class Imported:
    """What an import brought."""

    run: xr.Dataset
    #: the track the poses come from, on its own clock; None if the poses came otherwise
    track: pd.DataFrame | None = None
    notes: list[str] = field(default_factory=list)  #: what was done to the data on the way, in words


def import_mapped(
    mapping: str | Path | Mapping,
    data: str | Path | Sequence[str | Path] | None = None,
    folder: str | Path | None = None,
    limit: int = LIMIT,
    pose: ArrayLike | None = None,
    track: pd.DataFrame | None = None,
    clock_offset: float = 0.0,
) -> Imported:
    """Import measured data by a mapping, see ``docs/exchange.md``; what is missing, damaged or does not fit is named.

    ``data`` are data files in place of the mapping's entry ``files.data``. The mapping's file names are relative to
    ``folder`` (by default that of the first data file), else to its own. ``limit`` is the largest array to read, bytes.
    ``pose`` (scan, 6) or ``track``, of the reference point, stand in place of the mapping's, such as from
    :func:`flgpr.io.read_survey` or :func:`flgpr.io.read_nmea`; time on that track is the radar's plus ``clock_offset``,
    s.
    """
    table = mapping if isinstance(mapping, Mapping) else read_mapping(mapping)
    given = [Path(data)] if isinstance(data, (str, Path)) else [Path(one) for one in data or ()]
    homes = [Path(folder)] if folder is not None else [given[0].parent] if given else []
    homes.append(Path() if isinstance(mapping, Mapping) else Path(mapping).parent)
    files = _files(table, homes, given)
    if pose is not None and track is not None:
        raise ValueError("pose and track both tell where the vehicle was: give one")
    where = None if pose is None else np.asarray(pose, dtype=np.float64)
    return _Importer(table, files, limit, where, track, clock_offset).run()


def _files(mapping: Mapping, homes: list[Path], given: list[Path]) -> dict[str, list[Path]]:
    files: dict[str, list[Path]] = {}
    for name, entry in mapping.files.items():
        if name == "data" and given:
            continue
        paths: list[Path] = []
        for pattern in [entry] if isinstance(entry, str) else entry:
            plain = not any(mark in pattern for mark in "*?[")
            tries = ([home / pattern] if plain else sorted(home.glob(pattern)) for home in homes)
            hits = next((hit for hit in tries if any(path.is_file() for path in hit)), None)
            if hits is None:
                places = " or ".join(str(home) for home in dict.fromkeys(homes))
                raise FileNotFoundError(f"files.{name}: no file in {places} is called {pattern}")
            paths += hits
        files[name] = paths
    if given:
        files["data"] = given
    if not files.get("data"):
        raise ValueError("files.data must name the data file, or it must be given beside the mapping; got neither")
    return files


@dataclass
class _Importer:
    mapping: Mapping
    files: dict[str, list[Path]]
    limit: int
    given_pose: FloatArray | None
    given_track: pd.DataFrame | None
    clock_offset: float
    notes: list[str] = field(default_factory=list)
    _open: dict[Path, ArrayFile] = field(default_factory=dict)

    def run(self) -> Imported:
        m = self.mapping
        signal, shape = self._signal()
        signal, tones = self._tones(signal)
        order = np.argsort(tones, kind="stable")
        if (order != np.arange(tones.size)).any():
            signal, tones = signal[..., order], tones[order]
            self.notes.append("tones sorted by frequency")
        tx, rx, origin = self._geometry(shape, signal.shape)
        if m.path_offset is not None:
            signal = lengthen(signal, tones, self._offset(m.path_offset, signal.shape))
            self.notes.append("path offsets of the recorder undone")
        time = None if m.time is None else self._vector(m.time, "time", "time", along="scan")
        pose, track = self._poses(time, origin, signal.shape[0])
        attrs: dict[str, Any] = {"title": m.title, "source": m.source, "import_notes": self.notes}
        run = make_run(signal, tones, m.polarization, tx, rx, pose, time, attrs)
        return Imported(run, track, self.notes)

    def _arrays(self, file: str, variable: str, where: str) -> list[NDArray[Any]]:
        if file not in self.files:
            raise ValueError(f"{where}: file must be one of {', '.join(self.files)}, got {file!r}")
        found = []
        for path in self.files[file]:
            if path not in self._open:
                self._open[path] = open_arrays(path, self.limit)
            try:
                values = self._open[path].read(variable)
            except ValueError as error:
                raise ValueError(f"{where}: {error}") from None
            if values.dtype.kind not in "fciu":
                raise ValueError(f"{where}: {path}: {variable} must hold numbers, got {values.dtype}")
            found.append(values)
        return found

    def _signal(self) -> tuple[NDArray[Any], dict[str, int]]:
        spec = self.mapping.signal
        parts = self._arrays(spec.file, spec.variable, "signal")
        if spec.imaginary is not None:
            other = self._arrays(spec.file, spec.imaginary, "signal.imaginary")
            _same_shape(parts, other, "signal.imaginary")
            parts = [a + 1j * b for a, b in zip(parts, other, strict=True)]
        dims = list(spec.dims)
        for part in parts:
            if part.ndim != len(dims):
                raise ValueError(f"signal.dims must name the {part.ndim} axes of shape {part.shape}, got {dims}")
        signal = self._joined(parts, dims)
        if self.mapping.join.startswith("new"):
            dims = [self.mapping.join.split()[1], *dims]
        _plausible(signal, "signal")
        single = tuple(k for k, name in enumerate(dims) if name == "single")
        if any(signal.shape[k] != 1 for k in single):
            raise ValueError(f"signal.dims: an axis called single must have length 1, got shape {signal.shape}")
        signal = signal.squeeze(axis=single)
        dims = ["frequency" if name == "sample" else name for name in dims if name != "single"]
        if spec.conjugate:
            signal = signal.conj()
            self.notes.append("phases turned round (the recorder's convention is exp(+j2πfL/c))")
        wanted = [n for n in ("scan", "polarization", "pair", "tx", "rx", "frequency") if n in dims]
        signal = signal.transpose([dims.index(name) for name in wanted])
        shape = dict(zip(wanted, signal.shape, strict=True))
        if "tx" in shape:
            shape["pair"] = shape["tx"] * shape["rx"]
        return signal.reshape([shape.get(name, 1) for name in _ORDER]), shape

    def _joined(self, parts: list[NDArray[Any]], dims: list[str]) -> NDArray[Any]:
        join = self.mapping.join
        if join.startswith("new"):
            if join.split()[1] in dims:
                raise ValueError(f"join = {join!r} makes that dimension, signal.dims must not hold it: {dims}")
            _same_shape(parts[:1] * len(parts), parts, "signal")
            return np.stack(parts)
        if len(parts) == 1:
            return parts[0]
        if join not in dims:
            raise ValueError(f"join must be one of signal.dims {dims} to join {len(parts)} files, got {join!r}")
        axis = dims.index(join)
        shapes = {tuple(np.delete(part.shape, axis)) for part in parts}
        if len(shapes) > 1:
            raise ValueError(f"signal must have the same axes in all files but for {join}, got shapes {shapes}")
        return np.concatenate(parts, axis=axis)

    def _vector(self, spec: Quantity, kind: str, where: str, along: str = "") -> FloatArray:
        scale = factor(spec.unit, kind, f"{where}.unit")
        if spec.values is not None:
            values = np.asarray(spec.values, dtype=np.float64)
        else:
            parts = [_column(p, spec.column, where) for p in self._arrays(spec.file, str(spec.variable), where)]
            values = _real(self._assembled(parts, along, where), where)
        values = np.atleast_1d(values).ravel() * scale
        _plausible(values, where)
        return values - values[0] if spec.zero_first else values

    def _assembled(self, parts: list[NDArray[Any]], along: str, where: str) -> NDArray[Any]:
        if len(parts) > 1 and along == self.mapping.join.split()[-1]:
            return np.concatenate([np.atleast_1d(part) for part in parts])
        if any(part.shape != parts[0].shape or not np.array_equal(part, parts[0]) for part in parts[1:]):
            raise ValueError(f"{where} must be the same in all {len(parts)} files, it is not")
        return parts[0]

    def _tones(self, signal: NDArray[Any]) -> tuple[NDArray[Any], FloatArray]:
        m, count = self.mapping, signal.shape[-1]
        if m.frequency is not None:
            tones = self._vector(m.frequency, "frequency", "frequency")
            if tones.size != count:
                raise ValueError(f"frequency must have {count} tones as the signal has, got {tones.size}")
            check_frequency(np.sort(tones))
            if tones.max() > _HIGHEST_FREQUENCY:
                raise ValueError(f"frequency must be below {_HIGHEST_FREQUENCY:g} Hz, got {tones.max():g}: unit right?")
            return signal, tones
        spec: Samples = m.samples  # type: ignore[assignment]  # Mapping sees to it
        kind = "time" if spec.meaning == "delay" else "length"
        axis = self._vector(spec, kind, "samples") * {"delay": 1.0, "range": 2.0, "path": 1.0}[spec.meaning]
        delay = axis if spec.meaning == "delay" else axis / SPEED_OF_LIGHT
        scale = factor(spec.band_unit, "frequency", "samples.band_unit")
        band = (spec.band[0] * scale, spec.band[1] * scale)
        self.notes.append(f"impulse data taken to frequency, {band[0] / 1e9:g} to {band[1] / 1e9:g} GHz")
        return impulse_to_frequency(signal, delay, band, spec.pad)

    def _points(self, spec: Positions, where: str) -> FloatArray:
        scale = factor(spec.unit, "length", f"{where}.unit")
        if spec.values is not None:
            points = np.asarray(spec.values, dtype=np.float64)
        elif spec.variable is not None:
            points = _real(self._assembled(self._arrays(spec.file, spec.variable, where), "pair", where), where)
        else:
            along = "scan" if spec.frame == "lane" else "pair"
            axes = [
                self._assembled([p.ravel() for p in self._arrays(spec.file, str(v), where)], along, where)
                for v in (spec.x, spec.y, spec.z)
            ]
            points = np.stack([_real(axis, where) for axis in axes], axis=-1)
        if points.ndim < 2 or points.shape[-1] != 3:
            raise ValueError(f"{where} must have x, y and z along its last axis, got shape {points.shape}")
        points = points * scale
        _plausible(points, where)
        if spec.index is not None:
            points = points[..., self._index(spec.index, points.shape[-2], f"{where}.index"), :]
        return points

    def _index(self, spec: Index, count: int, where: str) -> NDArray[np.int64]:
        parts = self._arrays(spec.file, spec.variable, where)
        values = _real(self._assembled([_column(p, spec.column, where) for p in parts], "pair", where), where).ravel()
        rows = values - spec.first
        if not np.isfinite(rows).all() or (rows != np.round(rows)).any() or rows.min() < 0 or rows.max() >= count:
            raise ValueError(
                f"{where} must hold whole numbers from {spec.first} to {count - 1 + spec.first}, got {values.min():g} "
                f"to {values.max():g}"
            )
        return rows.astype(np.int64)

    def _geometry(
        self, sizes: dict[str, int], shape: tuple[int, ...]
    ) -> tuple[FloatArray, FloatArray, FloatArray | None]:
        m, pairs = self.mapping, shape[2]
        if m.antenna_position is not None:
            spec_tx = spec_rx = m.antenna_position
            names = ("antenna_position", "antenna_position")
        else:
            spec_tx, spec_rx = m.tx_position, m.rx_position  # type: ignore[assignment]  # Mapping sees to it
            names = ("tx_position", "rx_position")
        tx, rx = self._points(spec_tx, names[0]), self._points(spec_rx, names[1])
        if "tx" in sizes:
            rows = tx.shape[-2], rx.shape[-2]
            for name, count, side in zip(names, rows, ("tx", "rx"), strict=True):
                if count != sizes[side]:
                    raise ValueError(f"{name} must give {sizes[side]} antennas as the signal has, got {count}")
            tx, rx = np.repeat(tx, rows[1], axis=-2), np.concatenate([rx] * rows[0], axis=-2)
        origin = None
        if "lane" in (spec_tx.frame, spec_rx.frame):
            tx, rx, origin = _rigid(tx, rx, shape[0])
        for name, points in zip(names, (tx, rx), strict=True):
            if points.shape != (pairs, 3):
                raise ValueError(f"{name} must give x, y, z of {pairs} pairs as the signal has, got {points.shape}")
        return tx, rx, origin

    def _offset(self, spec: PathOffset, shape: tuple[int, ...]) -> FloatArray:
        values = self._vector(spec, "length", "path_offset", spec.along) * (2.0 if spec.meaning == "range" else 1.0)
        count = shape[0] if spec.along == "scan" else shape[2]
        if values.size not in (1, count) or not np.isfinite(values).all():
            raise ValueError(f"path_offset must be one finite length or one for each of {count} {spec.along}s")
        return values.reshape((-1, 1, 1) if spec.along == "scan" else (1, 1, -1))

    def _poses(
        self, time: FloatArray | None, origin: FloatArray | None, scans: int
    ) -> tuple[FloatArray, pd.DataFrame | None]:
        m = self.mapping
        if self.given_pose is not None:
            self.notes.append("poses given beside the mapping")
            return self.given_pose, None
        if self.given_track is not None:
            if time is None:
                raise ValueError("the mapping must have the table time, the radar's time of every scan, to use a track")
            self.notes.append(f"poses from a track given beside the mapping, at {self.clock_offset:g} s + radar time")
            return poses_at(self.given_track, time, self.clock_offset), self.given_track
        if m.pose is not None:
            pose = np.empty((scans, 6))
            for column, name in enumerate(POSE_COMPONENTS):
                unit, kind = (m.pose.unit, "length") if column < 3 else (m.pose.angle_unit, "angle")
                scale = factor(unit, kind, f"pose.{'unit' if column < 3 else 'angle_unit'}")
                pose[:, column] = scale * self._component(getattr(m.pose, name), m.pose.file, f"pose.{name}", scans)
            return pose, None
        if m.track is not None and time is not None:
            track = self._track()
            spec = m.track
            self.notes.append(f"poses from the track at {spec.clock_offset:g} s + {spec.clock_rate:g} · radar time")
            return poses_at(track, time, spec.clock_offset, spec.clock_rate, spec.max_gap), track
        if origin is None:
            raise ValueError(
                "where the vehicle was is missing: give pose, or track, or positions with frame = 'lane' in the "
                "mapping, or poses beside it"
            )
        pose = np.zeros((scans, 6))
        pose[:, :3] = origin
        return pose, None

    def _component(self, value: float | str, file: str, where: str, count: int) -> FloatArray:
        if not isinstance(value, str):
            return np.full(count, float(value))
        parts = [np.atleast_1d(part.squeeze()) for part in self._arrays(file, value, where)]
        values = _real(self._assembled(parts, "scan", where), where)
        if values.shape != (count,):
            raise ValueError(f"{where} must have {count} values, got shape {values.shape}")
        return values

    def _track(self) -> pd.DataFrame:
        spec = self.mapping.track
        if spec is None:
            raise ValueError("track is missing")
        position = self._points(spec.position, "track.position")
        time = self._vector(spec.time, "time", "track.time")
        angle = factor(spec.angle_unit, "angle", "track.angle_unit")
        file, count = spec.position.file, len(position)
        heading = (
            course(position)
            if spec.heading == "course"
            else angle * self._component(spec.heading, file, "track.heading", count)
        )
        tilt = [angle * self._component(getattr(spec, n), file, f"track.{n}", count) for n in ("pitch", "roll")]
        return reference_track(make_track(time, position, heading, *tilt), spec.lever_arm, spec.latency)


def _column(values: NDArray[Any], column: int | None, where: str) -> NDArray[Any]:
    if column is None:
        return np.atleast_1d(values.squeeze())
    if values.ndim != 2 or not 0 <= column < values.shape[1]:
        raise ValueError(f"{where}.column must be a column of the variable, got {column} for shape {values.shape}")
    return values[:, column]


def _real(values: NDArray[Any], where: str) -> FloatArray:
    if np.iscomplexobj(values):
        raise ValueError(f"{where} must be real numbers, got {values.dtype}")
    return np.asarray(values, dtype=np.float64)


def _same_shape(first: list[NDArray[Any]], second: list[NDArray[Any]], where: str) -> None:
    for a, b in zip(first, second, strict=True):
        if a.shape != b.shape:
            raise ValueError(f"{where} must have the same shape everywhere, got {a.shape} and {b.shape}")


def _plausible(values: NDArray[Any], where: str) -> None:
    """Refuse magnitudes that no instrument records but a wrong byte order makes."""
    size = np.abs(values[np.isfinite(values)])
    largest = float(size.max(initial=0.0))
    if largest > _LARGEST or 0 < largest < _SMALLEST:
        raise ValueError(
            f"{where} must lie between {_SMALLEST:g} and {_LARGEST:g} in magnitude, got up to {largest:g}: is the byte "
            "order wrong?"
        )


def _rigid(tx: FloatArray, rx: FloatArray, scans: int) -> tuple[FloatArray, FloatArray, FloatArray]:
    if tx.ndim != 3 or rx.ndim != 3 or len(tx) != scans or len(rx) != scans:
        raise ValueError(
            f"positions in the lane frame must have the shape (scan, pair, 3) for {scans} scans, got {tx.shape} and "
            f"{rx.shape}"
        )
    origin = tx.mean(axis=1)
    tx, rx = tx - origin[:, None], rx - origin[:, None]
    moved = max(float(np.abs(part - part[0]).max()) for part in (tx, rx))
    if not moved <= 1e-4:
        raise ValueError(
            f"positions in the lane frame must keep their form and heading from scan to scan within 0.1 mm, they move "
            f"by {moved:g} m; give pose and positions in the vehicle frame instead"
        )
    return tx[0], rx[0], origin


def impulse_to_frequency(
    samples: ArrayLike, delay: ArrayLike, band: tuple[float, float], pad: int = 1
) -> tuple[NDArray[np.complex128], NDArray[np.float64]]:
    """Take time-domain (impulse) data (..., delay) to tones: the spectrum (..., frequency), and the frequencies, Hz.

    A scatterer at the delay t gives ``exp(-j2πft)`` times the pulse's spectrum, since the axis keeps its start. Samples
    are real or analytic; two-way delays, s, are uniform; ``band``, Hz, ends below the Nyquist frequency. Outside the
    recorded time of ``1/Δf`` delays repeat; zeros make the record ``pad`` times as long and the tones denser.
    """
    values, axis = np.asarray(samples), np.asarray(delay, dtype=np.float64)
    if axis.ndim != 1 or axis.size < 2 or values.shape[-1] != axis.size:
        raise ValueError(f"delay must have one value per sample, got {axis.shape} for samples {values.shape}")
    step = float(np.diff(axis).mean())
    if not np.isfinite(axis).all() or step <= 0 or np.abs(np.diff(axis) - step).max() > 0.01 * step:
        raise ValueError("delay must increase in equal steps (within 1 %), got an uneven or falling axis")
    nyquist = 0.5 / step
    if not (0 < band[0] < band[1] <= nyquist):
        raise ValueError(f"band must lie between 0 and the Nyquist frequency {nyquist:g} Hz, got {band}")
    if pad < 1:
        raise ValueError(f"pad must be at least 1, got {pad}")
    count = axis.size * int(pad)
    frequency: NDArray[np.float64] = np.arange((count + 1) // 2) / (count * step)
    keep = np.flatnonzero((frequency >= band[0]) & (frequency <= band[1]))
    if not keep.size:
        raise ValueError(f"band must hold a tone; tones are {frequency[1]:g} Hz apart, got {band}")
    signal = np.fft.fft(values, count, axis=-1)[..., keep]
    return signal * np.exp(-2j * np.pi * frequency[keep] * axis[0]), frequency[keep]
