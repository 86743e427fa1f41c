"""Import by a mapping: arrays of other people's files become a run."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd
import xarray as xr
from numpy.typing import ArrayLike, NDArray

from flgpr.formats.arrays import LIMIT
from flgpr.formats.mapping import Mapping, PathOffset, Quantity, Samples, factor, read_mapping
from flgpr.formats.poses import read_poses, read_track_table
from flgpr.formats.sources import FloatArray, Sources, plausible
from flgpr.model import SPEED_OF_LIGHT, check_frequency, make_run
from flgpr.model.phase import lengthen
from flgpr.model.track import poses_at
from flgpr.store.files import faults_of

if TYPE_CHECKING:
    from flgpr.geo.anchor import Anchor

_ORDER = ("scan", "polarization", "pair", "frequency")
_HIGHEST_FREQUENCY = 1e12


@dataclass(frozen=True)
class Imported:
    """What an import brought."""

    run: xr.Dataset
    #: the track the poses come from, on its own clock; None if the poses came otherwise
    track: pd.DataFrame | None = None
    notes: list[str] = field(
        default_factory=list
    )  #: what was done to the data on the way, in words
    #: the anchor that the fixes themselves made, if they were asked to
    anchor: Anchor | None = None


def import_mapped(
    mapping: str | Path | Mapping,
    data: str | Path | Sequence[str | Path] | None = None,
    folder: str | Path | None = None,
    limit: int = LIMIT,
    pose: ArrayLike | None = None,
    track: pd.DataFrame | None = None,
    clock_offset: float = 0.0,
    anchor: Anchor | None = None,
    anchor_from_track: bool = False,
) -> Imported:
    """Import measured data by a mapping, see ``docs/exchange.md``; what is missing, damaged or does not fit is named.

    ``data`` are data files in place of the mapping's entry ``files.data``. The mapping's file names are relative to
    ``folder`` (by default that of the first data file), else to its own. ``limit`` is the largest array to read, bytes.
    ``pose`` (scan, 6) or ``track``, of the reference point, stand in place of the mapping's, such as from
    :func:`flgpr.formats.read_survey` or :func:`flgpr.formats.read_nmea`; time on that track is the
    radar's plus ``clock_offset``, s. ``anchor`` takes positions by longitude and latitude to the
    lane; with ``anchor_from_track`` they make their own (:func:`flgpr.geo.anchor_from_fixes`).
    """
    table = mapping if isinstance(mapping, Mapping) else read_mapping(mapping)
    given = [Path(data)] if isinstance(data, (str, Path)) else [Path(one) for one in data or ()]
    homes = [Path(folder)] if folder is not None else [given[0].parent] if given else []
    homes.append(Path() if isinstance(mapping, Mapping) else Path(mapping).parent)
    files = _files(table, homes, given)
    if pose is not None and track is not None:
        raise ValueError("pose and track both tell where the vehicle was: give one")
    where = None if pose is None else np.asarray(pose, dtype=np.float64)
    try:
        importer = _Importer(table, files, limit, where, track, clock_offset, anchor)
        importer.sources.anchor_from_track = anchor_from_track
        return importer.run()
    except ValueError as error:
        named = any(str(path) in str(error) for paths in files.values() for path in paths)
        if named or isinstance(mapping, Mapping):
            raise
        raise ValueError(f"{mapping}: {error}") from None


def _files(mapping: Mapping, homes: list[Path], given: list[Path]) -> dict[str, list[Path]]:
    files: dict[str, list[Path]] = {}
    for name, entry in mapping.files.items():
        if name == "data" and given:
            continue
        paths: list[Path] = []
        for pattern in [entry] if isinstance(entry, str) else entry:
            plain = not any(mark in pattern for mark in "*?[")
            tries = (
                [home / pattern] if plain else sorted(home.glob(pattern), key=_counted)
                for home in homes
            )
            hits = next((hit for hit in tries if any(path.is_file() for path in hit)), None)
            if hits is None:
                places = " or ".join(str(home) for home in dict.fromkeys(homes))
                raise FileNotFoundError(f"files.{name}: no file in {places} is called {pattern}")
            paths += hits
        files[name] = paths
    if given:
        files["data"] = given
    if not files.get("data"):
        raise ValueError(
            "files.data must name the data file, or it must be given beside the mapping; got neither"
        )
    return files


def _counted(path: Path) -> list[tuple[int, str]]:
    """Sort key by which scan_2 comes before scan_10."""
    return [
        (int(part), "") if part.isdecimal() else (-1, part)
        for part in re.split(r"(\d+)", str(path))
    ]


@dataclass
class _Importer:
    mapping: Mapping
    files: dict[str, list[Path]]
    limit: int
    given_pose: FloatArray | None
    given_track: pd.DataFrame | None
    clock_offset: float
    anchor: Anchor | None

    def __post_init__(self) -> None:
        self.sources = Sources(self.files, self.mapping.join, self.limit)
        self.notes = self.sources.notes

    def run(self) -> Imported:
        m = self.mapping
        signal, shape = self._signal()
        axis = m.frequency or m.samples
        with self.sources.entry(
            "frequency" if m.frequency else "samples", axis.file if axis else None
        ):
            signal, tones = self._tones(signal)
        order = np.argsort(tones, kind="stable")
        if (order != np.arange(tones.size)).any():
            signal = signal[..., order]
            tones = tones[order]
            self.notes.append("tones sorted by frequency")
        tx, rx, origin = self._geometry(shape, signal.shape)
        if m.path_offset is not None:
            with self.sources.entry("path_offset", m.path_offset.file):
                signal = lengthen(signal, tones, self._offset(m.path_offset, signal.shape))
            self.notes.append("path offsets of the recorder undone")
        time = None if m.time is None else self._time(m.time, signal.shape[0])
        pose, track = self._poses(time, origin, signal.shape[0])
        self._note_missing(signal)
        attrs: dict[str, Any] = {"title": m.title, "source": m.source, "import_notes": self.notes}
        with faults_of(self.files[m.signal.file][0]):
            run = make_run(signal, tones, m.polarization, tx, rx, pose, time, attrs)
        return Imported(run, track, self.notes, self.sources.anchor)

    def _note_missing(self, signal: NDArray[Any]) -> None:
        """Count the sweeps of a signal (scan, polarization, pair, tone) that are not whole."""
        missing = int(np.count_nonzero(~np.isfinite(signal).all(axis=-1)))
        if missing:
            self.notes.append(
                f"{missing} of {signal[..., 0].size} sweeps hold values that are no numbers, and count as missing"
            )

    def _signal(self) -> tuple[NDArray[Any], dict[str, int]]:
        spec = self.mapping.signal
        with self.sources.entry("signal", spec.file):
            parts = self.sources.arrays(spec.file, spec.variable, "signal")
            if spec.imaginary is not None:
                other = self.sources.arrays(spec.file, spec.imaginary, "signal.imaginary")
                _same_shape(parts, other, "signal.imaginary")
                parts = [a + 1j * b for a, b in zip(parts, other, strict=True)]
            if spec.interleaved:
                parts = [_complex(part) for part in parts]
            dims = list(spec.dims)
            if spec.shape is not None:
                parts = [_shaped(part, spec.shape) for part in parts]
            for part in parts:
                if part.ndim != len(dims):
                    raise ValueError(
                        f"signal.dims must name the {part.ndim} axes of shape {part.shape}, got {dims}"
                    )
            signal = self._joined(parts, dims)
            if self.mapping.join.startswith("new"):
                dims = [self.mapping.join.split()[1], *dims]
            plausible(signal, "signal")
            return self._ordered(signal, dims)

    def _ordered(
        self, signal: NDArray[Any], dims: list[str]
    ) -> tuple[NDArray[Any], dict[str, int]]:
        """Bring the axes into a run's order; scan axes of a raster become one."""
        single = tuple(k for k, name in enumerate(dims) if name == "single")
        if any(signal.shape[k] != 1 for k in single):
            raise ValueError(
                f"signal.dims: an axis called single must have length 1, got shape {signal.shape}"
            )
        signal = signal.squeeze(axis=single)
        dims = ["frequency" if name == "sample" else name for name in dims if name != "single"]
        if self.mapping.signal.conjugate:
            signal = signal.conj()
            self.notes.append("phases turned round (the recorder's convention is exp(+j2πfL/c))")
        names = ("scan", "polarization", "pair", "tx", "rx", "frequency")
        order = [k for name in names for k, dim in enumerate(dims) if dim == name]
        signal = signal.transpose(order)
        self.sources.grid = grid = signal.shape[: dims.count("scan")]
        if len(grid) > 1:
            self.notes.append(
                f"{' x '.join(map(str, grid))} positions made {math.prod(grid)} scans"
            )
            signal = signal.reshape(-1, *signal.shape[len(grid) :])
        wanted = [name for name in names if name in dims]
        shape = dict(zip(wanted, signal.shape, strict=True))
        if "tx" in shape:
            shape["pair"] = shape["tx"] * shape["rx"]
        return signal.reshape([shape.get(name, 1) for name in _ORDER]), shape

    def _joined(self, parts: list[NDArray[Any]], dims: list[str]) -> NDArray[Any]:
        join = self.mapping.join
        if join.startswith("new"):
            if join.split()[1] in dims:
                raise ValueError(
                    f"join = {join!r} makes that dimension, signal.dims must not hold it: {dims}"
                )
            _same_shape(parts[:1] * len(parts), parts, "signal")
            return np.stack(parts)
        if len(parts) == 1:
            return parts[0]
        if join not in dims:
            raise ValueError(
                f"join must be one of signal.dims {dims} to join {len(parts)} files, got {join!r}"
            )
        axis = dims.index(join)
        shapes = {tuple(np.delete(part.shape, axis)) for part in parts}
        if len(shapes) > 1:
            raise ValueError(
                f"signal must have the same axes in all files but for {join}, got shapes {shapes}"
            )
        return np.concatenate(parts, axis=axis)

    def _time(self, spec: Quantity, scans: int) -> FloatArray:
        time = self.sources.vector(spec, "time", "time", "scan", scans)
        if time.size != scans:
            with self.sources.entry("time", spec.file):
                raise ValueError(
                    f"time must have {scans} values, one for each scan, got {time.size}"
                )
        return time

    def _tones(self, signal: NDArray[Any]) -> tuple[NDArray[Any], FloatArray]:
        m = self.mapping
        count = signal.shape[-1]
        if m.frequency is not None:
            tones = self.sources.vector(m.frequency, "frequency", "frequency", count=count)
            if tones.size != count:
                raise ValueError(
                    f"frequency must have {count} tones as the signal has, got {tones.size}"
                )
            check_frequency(np.sort(tones))
            if tones.max() > _HIGHEST_FREQUENCY:
                raise ValueError(
                    f"frequency must be below {_HIGHEST_FREQUENCY:g} Hz, got {tones.max():g}: unit right?"
                )
            return signal, tones
        spec: Samples = m.samples  # type: ignore[assignment]  # Mapping sees to it
        kind = "time" if spec.meaning == "delay" else "length"
        axis = (
            self.sources.vector(spec, kind, "samples", count=count)
            * {"delay": 1.0, "range": 2.0, "path": 1.0}[spec.meaning]
        )
        delay = axis if spec.meaning == "delay" else axis / SPEED_OF_LIGHT
        scale = factor(spec.band_unit, "frequency", "samples.band_unit")
        band = (spec.band[0] * scale, spec.band[1] * scale)
        self.notes.append(
            f"impulse data taken to frequency, {band[0] / 1e9:g} to {band[1] / 1e9:g} GHz"
        )
        return impulse_to_frequency(signal, delay, band, spec.pad)

    def _geometry(
        self, sizes: dict[str, int], shape: tuple[int, ...]
    ) -> tuple[FloatArray, FloatArray, FloatArray | None]:
        m = self.mapping
        pairs = shape[2]
        if m.antenna_position is not None:
            spec_tx = spec_rx = m.antenna_position
            names = ("antenna_position", "antenna_position")
        else:
            # Mapping sees to it that both are there.
            spec_tx = m.tx_position  # type: ignore[assignment]
            spec_rx = m.rx_position  # type: ignore[assignment]
            names = ("tx_position", "rx_position")
        tx, rx = (
            self.sources.points(spec, name, "scan" if spec.frame == "lane" else "pair")
            for spec, name in ((spec_tx, names[0]), (spec_rx, names[1]))
        )
        if "lane" in (spec_tx.frame, spec_rx.frame):
            # Positions per scan of a single antenna need no axis for it.
            tx, rx = (part[:, None] if part.ndim == 2 and pairs == 1 else part for part in (tx, rx))
        if "tx" in sizes:
            rows = tx.shape[-2], rx.shape[-2]
            for name, count, side, spec in zip(
                names, rows, ("tx", "rx"), (spec_tx, spec_rx), strict=True
            ):
                if count != sizes[side]:
                    with self.sources.entry(name, spec.file):
                        raise ValueError(
                            f"{name} must give {sizes[side]} antennas as the signal has, got {count}"
                        )
            tx = np.repeat(tx, rows[1], axis=-2)
            rx = np.concatenate([rx] * rows[0], axis=-2)
        origin = None
        if "lane" in (spec_tx.frame, spec_rx.frame):
            with self.sources.entry(names[0], spec_tx.file):
                tx, rx, origin = _rigid(tx, rx, shape[0])
        for name, points, spec in zip(names, (tx, rx), (spec_tx, spec_rx), strict=True):
            if points.shape != (pairs, 3):
                with self.sources.entry(name, spec.file):
                    raise ValueError(
                        f"{name} must give x, y, z of {pairs} pairs as the signal has, got {points.shape}"
                    )
        return tx, rx, origin

    def _offset(self, spec: PathOffset, shape: tuple[int, ...]) -> FloatArray:
        values = self.sources.vector(spec, "length", "path_offset", spec.along) * (
            2.0 if spec.meaning == "range" else 1.0
        )
        count = shape[0] if spec.along == "scan" else shape[2]
        if values.size not in (1, count) or not np.isfinite(values).all():
            raise ValueError(
                f"path_offset must be one finite length or one for each of {count} {spec.along}s"
            )
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
                raise ValueError(
                    "the mapping must have the table time, the radar's time of every scan, to use a track"
                )
            self.notes += self.given_track.attrs.get("notes", [])
            self.notes.append(
                f"poses from a track given beside the mapping, at {self.clock_offset:g} s + radar time"
            )
            return poses_at(self.given_track, time, self.clock_offset), self.given_track
        if m.pose is not None:
            return read_poses(self.sources, m.pose, scans, self.anchor), None
        if m.track is not None and time is not None:
            track = read_track_table(self.sources, m.track, self.anchor)
            spec = m.track
            self.notes.append(
                f"poses from the track at {spec.clock_offset:g} s + {spec.clock_rate:g} · radar time"
            )
            with self.sources.entry("track", spec.time.file):
                return poses_at(
                    track, time, spec.clock_offset, spec.clock_rate, spec.max_gap
                ), track
        if origin is None:
            raise ValueError(
                "where the vehicle was is missing: give pose, or track, or positions with frame = 'lane' in the "
                "mapping, or poses beside it"
            )
        pose = np.zeros((scans, 6))
        pose[:, :3] = origin
        return pose, None


def _same_shape(first: list[NDArray[Any]], second: list[NDArray[Any]], where: str) -> None:
    for a, b in zip(first, second, strict=True):
        if a.shape != b.shape:
            raise ValueError(
                f"{where} must have the same shape everywhere, got {a.shape} and {b.shape}"
            )


def _complex(values: NDArray[Any]) -> NDArray[Any]:
    if np.iscomplexobj(values) or not values.ndim or values.shape[-1] % 2:
        raise ValueError(
            f"signal.interleaved asks for pairs of real numbers, got {values.dtype} {values.shape}"
        )
    parts = values.astype(
        np.float32 if values.dtype.itemsize <= 2 or values.dtype == np.float32 else np.float64
    )
    return np.ascontiguousarray(parts).view(
        np.complex64 if parts.dtype == np.float32 else np.complex128
    )


def _shaped(values: NDArray[Any], shape: list[int]) -> NDArray[Any]:
    try:
        return values.reshape(shape)
    except ValueError:
        raise ValueError(
            f"signal.shape must hold {values.size} values of {values.shape}, got {shape}"
        ) from None


def _rigid(tx: FloatArray, rx: FloatArray, scans: int) -> tuple[FloatArray, FloatArray, FloatArray]:
    if tx.ndim != 3 or rx.ndim != 3 or len(tx) != scans or len(rx) != scans:
        raise ValueError(
            f"positions in the lane frame must have the shape (scan, pair, 3) for {scans} scans, got {tx.shape} and "
            f"{rx.shape}"
        )
    origin = tx.mean(axis=1)
    tx = tx - origin[:, None]
    rx = rx - origin[:, None]
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
    values = np.asarray(samples)
    axis = np.asarray(delay, dtype=np.float64)
    if axis.ndim != 1 or axis.size < 2 or values.shape[-1] != axis.size:
        raise ValueError(
            f"delay must have one value per sample, got {axis.shape} for samples {values.shape}"
        )
    step = float(np.diff(axis).mean())
    if not np.isfinite(axis).all() or step <= 0 or np.abs(np.diff(axis) - step).max() > 0.01 * step:
        raise ValueError(
            "delay must increase in equal steps (within 1 %), got an uneven or falling axis"
        )
    nyquist = 0.5 / step
    if not (0 < band[0] < band[1] <= nyquist):
        raise ValueError(
            f"band must lie between 0 and the Nyquist frequency {nyquist:g} Hz, got {band}"
        )
    if pad < 1:
        raise ValueError(f"pad must be at least 1, got {pad}")
    count = axis.size * int(pad)
    frequency: NDArray[np.float64] = np.arange((count + 1) // 2) / (count * step)
    keep = np.flatnonzero((frequency >= band[0]) & (frequency <= band[1]))
    if not keep.size:
        raise ValueError(f"band must hold a tone; tones are {frequency[1]:g} Hz apart, got {band}")
    signal = np.fft.fft(values, count, axis=-1)[..., keep]
    return signal * np.exp(-2j * np.pi * frequency[keep] * axis[0]), frequency[keep]
