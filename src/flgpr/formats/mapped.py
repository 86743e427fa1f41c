"""Import by a mapping: arrays of other people's files become a run."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd
import xarray as xr

from flgpr.formats.array_file import LIMIT
from flgpr.formats.impulse import impulse_to_frequency, negative_share
from flgpr.formats.mapping import (
    Mapping,
    PathOffset,
    Positions,
    Samples,
    Signal,
    factor,
    read_mapping,
)
from flgpr.formats.poses import read_poses, read_track_table
from flgpr.formats.sources import Sources, plausible
from flgpr.model import SPEED_OF_LIGHT, check_frequency, make_run
from flgpr.model.constants import DIMS
from flgpr.model.faults import faults_of
from flgpr.model.frames import rigid_array
from flgpr.model.phase import lengthen
from flgpr.model.track import poses_at
from flgpr.store.files import natural_order
from flgpr.types import AnyArray, ArrayLike, Entries, FloatArray, floats

if TYPE_CHECKING:
    from flgpr.geo.anchor import Anchor

_ORDER = DIMS["signal"]
_FILE_ORDER = ("scan", "polarization", "pair", "tx", "rx", "frequency")
"""Order of the axes before those of transmitters and receivers become pairs."""
_HIGHEST_FREQUENCY = 1e12
_TWO_WAY = {"delay": 1.0, "range": 2.0, "path": 1.0}  # factors to the path there and back
_SLOW = 1.5  # times the usual time between fixes, which is no gap
_ONE_SIGN = 0.99  # share of real parts that have one sign, as magnitudes and decibels do
_BOTH_SIGNS = 0.1  # share of imaginary parts of either sign, at least, as phases have
_LARGEST_MOTION = 1e-4  # m, of antennas in an array that keeps its form


@dataclass(frozen=True)
class Imported:
    """What an import brought."""

    run: xr.Dataset
    #: the track the poses come from, on its own clock; None if the poses came otherwise
    track: pd.DataFrame | None = None
    #: what was done to the data in the import, in words
    notes: list[str] = field(default_factory=list)
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
    max_gap: float = 1.0,
) -> Imported:
    """Import measured data by a mapping, see ``docs/guide/import-mapping.md``.

    Parameters
    ----------
    mapping : path or Mapping
        The mapping, or its file.
    data : path or sequence of path, optional
        Data files in place of the mapping's entry ``files.data``.
    folder : path, optional
        Where the files of the mapping are looked for first, by default the folder of the first data
        file; after it in the mapping's own.
    limit : int
        Largest array to read, bytes.
    pose : (scan, 6) array_like, optional
        Poses of the reference point in place of the mapping's, m and rad, such as from
        :func:`flgpr.formats.read_survey`.
    track : pandas.DataFrame, optional
        Track of the reference point in place of the mapping's, such as from
        :func:`flgpr.formats.read_nmea`.
    clock_offset : float
        Time on that track is the radar's plus this, s.
    anchor : Anchor, optional
        Takes positions by longitude and latitude to the lane.
    anchor_from_track : bool
        Whether such positions make their own anchor (:func:`flgpr.geo.anchor_from_fixes`).
    max_gap : float
        Longest gap between fixes of that track in which a scan may lie, s; of a slow track, half
        more than the usual time between them.

    Returns
    -------
    Imported
        The run, and what was done to have it.

    Raises
    ------
    ValueError
        If an entry or a file is damaged or does not fit; the error names both.
    FileNotFoundError
        If there is no file of a name.
    """
    table = mapping if isinstance(mapping, Mapping) else read_mapping(mapping)
    data_files = []
    if data is not None:
        data_files = list(map(Path, [data] if isinstance(data, (str, Path)) else data))
    folders = []
    if folder is not None:
        folders.append(Path(folder))
    elif data_files:
        folders.append(data_files[0].parent)
    folders.append(Path() if isinstance(mapping, Mapping) else Path(mapping).parent)

    files = _files(table, folders, data_files)
    if pose is not None and track is not None:
        raise ValueError("pose and track both tell where the vehicle was: give one")
    poses = None if pose is None else floats(pose)
    try:
        importer = _Importer(table, files, limit, poses, track, clock_offset, max_gap, anchor)
        importer.sources.anchor_from_track = anchor_from_track
        return importer.run()
    except ValueError as error:
        all_paths = (str(path) for paths in files.values() for path in paths)
        if isinstance(mapping, Mapping) or any(path in str(error) for path in all_paths):
            raise
        raise ValueError(f"{mapping}: {error}") from None


def _files(mapping: Mapping, folders: list[Path], data_files: list[Path]) -> dict[str, list[Path]]:
    """Return the files of every name in a mapping; ``data_files`` are those of ``data``."""
    files: dict[str, list[Path]] = {}
    for name, entry in mapping.files.items():
        if name == "data" and data_files:
            continue
        files[name] = []
        for pattern in [entry] if isinstance(entry, str) else entry:
            files[name] += _files_of(pattern, folders, name)
    if data_files:
        files["data"] = data_files
    if not files.get("data"):
        raise ValueError(
            "files.data must name the data file, or it must be given beside the mapping; "
            "got neither"
        )
    return files


def _files_of(pattern: str, folders: list[Path], name: str) -> list[Path]:
    """Return the files of a pattern in the first folder that holds any."""
    is_pattern = any(mark in pattern for mark in "*?[")
    for folder in folders:
        paths = [folder / pattern]
        if is_pattern:
            paths = sorted(folder.glob(pattern), key=natural_order)
        if any(path.is_file() for path in paths):
            return paths
    searched = " or ".join(str(folder) for folder in dict.fromkeys(folders))
    raise FileNotFoundError(f"files.{name}: no file in {searched} is called {pattern}")


@dataclass
class _Importer:
    """Puts a run together from the files of a mapping, step by step."""

    mapping: Mapping
    files: dict[str, list[Path]]
    limit: int
    poses: FloatArray | None  # in place of the mapping's
    track: pd.DataFrame | None  # in place of the mapping's
    clock_offset: float
    max_gap: float  # of that track
    anchor: Anchor | None

    def __post_init__(self) -> None:
        self.sources = Sources(self.files, self.mapping.join, self.limit)
        self.record: dict[str, float] = {}  # attributes of samples that became tones
        self.notes = self.sources.notes

    def run(self) -> Imported:
        """Read all entries and return the run."""
        mapping = self.mapping
        signal, sizes = self._signal()
        axis = mapping.frequency or mapping.samples
        axis_name = "frequency" if mapping.frequency else "samples"
        with self.sources.entry(axis_name, axis.file if axis else None):
            signal, tones = self._tones(signal)

        order = np.argsort(tones, kind="stable")
        if (order != np.arange(tones.size)).any():
            signal = signal[..., order]
            tones = tones[order]
            self.notes.append("tones sorted by frequency")

        tx, rx, origin = self._geometry(sizes, signal.shape)
        if mapping.path_offset is not None:
            with self.sources.entry("path_offset", mapping.path_offset.file):
                signal = lengthen(signal, tones, self._offset(mapping.path_offset, signal.shape))
            self.notes.append("path offsets of the recorder undone")

        time = None
        scans = signal.shape[0]
        if mapping.time is not None:
            time = self.sources.vector(mapping.time, "time", "time", "scan", scans)
            if time.size != scans:
                with self.sources.entry("time", mapping.time.file):
                    raise ValueError(
                        f"time must have {scans} values, one for each scan, got {time.size}"
                    )
        pose, track = self._poses(time, origin, scans)
        is_complete = np.isfinite(signal).all(axis=-1)
        missing = int(np.count_nonzero(~is_complete))
        if missing:
            self.notes.append(
                f"{missing} of {is_complete.size} sweeps hold values that are no numbers, "
                "and count as missing"
            )

        attrs: Entries = {
            "title": mapping.title,
            "source": mapping.source,
            "import_notes": self.notes,
        }
        if mapping.path_offset is None:
            attrs |= self.record
        with faults_of(self.files[mapping.signal.file][0]):
            run = make_run(signal, tones, mapping.polarization, tx, rx, pose, time, attrs)
        return Imported(run, track, self.notes, self.sources.anchor)

    def _signal(self) -> tuple[AnyArray, dict[str, int]]:
        """Return the signal in a run's order, and the lengths of the axes that it has."""
        spec = self.mapping.signal
        with self.sources.entry("signal", spec.file):
            blocks = self._signal_blocks(spec)
            dims = [name for name in spec.dims if name != "complex"]
            for block in blocks:
                if block.ndim != len(dims):
                    raise ValueError(
                        f"signal.dims must name the {block.ndim} axes of shape {block.shape}, "
                        f"got {dims}"
                    )
            signal = self._joined(blocks, dims)
            if self.mapping.join.startswith("new"):
                dims = [self.mapping.join.split()[1], *dims]
            plausible(signal, "signal")
            return self._ordered(signal, dims)

    def _signal_blocks(self, spec: Signal) -> list[AnyArray]:
        """Return the signal of every file as the mapping describes its numbers."""
        blocks = self.sources.arrays(spec.file, spec.variable, "signal")
        if spec.imaginary is not None:
            imaginary = self.sources.arrays(spec.file, spec.imaginary, "signal.imaginary")
            _same_shape(blocks, imaginary, "signal.imaginary")
            blocks = [a + 1j * b for a, b in zip(blocks, imaginary, strict=True)]
        if spec.phase is not None:
            phases = self.sources.arrays(spec.file, spec.phase, "signal.phase")
            _same_shape(blocks, phases, "signal.phase")
            self._note_kinds(blocks, phases, spec)
            blocks = [_of_polar(a, b, spec) for a, b in zip(blocks, phases, strict=True)]
        if spec.interleaved:
            blocks = [_complex(block) for block in blocks]
        if spec.shape is not None:
            blocks = [_shaped(block, spec.shape) for block in blocks]
        if "complex" in spec.dims:
            blocks = [_of_parts(block, spec.dims) for block in blocks]
        is_real = not any(np.iscomplexobj(block) for block in blocks)
        if self.mapping.frequency is not None and is_real:
            raise ValueError(
                "signal.variable must hold complex tones: without a phase nothing can be focused, "
                f"got real numbers ({blocks[0].dtype}): name signal.imaginary, or magnitude (dB or "
                'linear) with phase and phase_unit; interleaved = true, or "complex" in dims, where '
                "real and imaginary parts are one array"
            )
        if spec.phase is None and not is_real:
            self._note_polar(_flat(blocks))
        return blocks

    def _note_polar(self, signal: AnyArray) -> None:
        """Note parts that look like magnitudes and phases: of one sign, and of a turn at most."""
        unit = _unit_of_phases(signal.imag)
        if unit and max(np.mean(signal.real >= 0), np.mean(signal.real <= 0)) > _ONE_SIGN:
            self.notes.append(
                f"real parts are of one sign and imaginary parts reach {_largest(signal.imag):.4g}: are "
                f"they magnitudes, or decibels, and a phase in {unit}? Then give magnitude, phase and "
                "phase_unit in place of imaginary"
            )

    def _note_kinds(self, sizes: list[AnyArray], phases: list[AnyArray], spec: Signal) -> None:
        """Note magnitudes and phases that look like those of another unit."""
        magnitude, phase = _flat(sizes), _flat(phases)
        stated = "degrees" if spec.phase_unit == "deg" else "radians"
        unit = _unit_of_phases(phase)
        if unit and unit != stated:
            self.notes.append(
                f"signal.phase_unit is {spec.phase_unit}, and phases reach {_largest(phase):.4g}: are "
                f"they {unit}?"
            )
        if spec.magnitude == "linear" and not np.iscomplexobj(magnitude) and (magnitude < 0).any():
            self.notes.append(
                f"signal.magnitude is linear, and {np.mean(magnitude < 0):.0%} of the magnitudes are "
                "negative: are they dB?"
            )

    def _ordered(self, signal: AnyArray, dims: list[str]) -> tuple[AnyArray, dict[str, int]]:
        """Bring the axes into a run's order; scan axes of a raster become one."""
        single = [axis for axis, name in enumerate(dims) if name == "single"]
        if any(signal.shape[axis] != 1 for axis in single):
            raise ValueError(
                f"signal.dims: an axis called single must have length 1, got shape {signal.shape}"
            )
        signal = signal.squeeze(axis=tuple(single))
        # Samples count as the frequencies that they become.
        names = {"sample": "frequency"}
        dims = [names.get(name, name) for name in dims if name != "single"]
        if self.mapping.signal.conjugate:
            signal = signal.conj()
            self.notes.append("phases turned round (the recorder's convention is exp(+j2πfL/c))")

        order = sorted(range(len(dims)), key=lambda axis: _FILE_ORDER.index(dims[axis]))
        signal = signal.transpose(order)
        grid = signal.shape[: dims.count("scan")]
        self.sources.grid = grid
        if len(grid) > 1:
            lengths = " x ".join(map(str, grid))
            self.notes.append(f"{lengths} positions made {math.prod(grid)} scans")
            signal = signal.reshape(-1, *signal.shape[len(grid) :])

        known = [name for name in _FILE_ORDER if name in dims]
        sizes = dict(zip(known, signal.shape, strict=True))
        if "tx" in sizes:
            sizes["pair"] = sizes["tx"] * sizes["rx"]
        return signal.reshape([sizes.get(name, 1) for name in _ORDER]), sizes

    def _joined(self, blocks: list[AnyArray], dims: list[str]) -> AnyArray:
        """Return the signals of several files as one array."""
        join = self.mapping.join
        if join.startswith("new"):
            if join.split()[1] in dims:
                raise ValueError(
                    f"join = {join!r} makes that dimension, signal.dims must not hold it: {dims}"
                )
            _same_shape(blocks[:1] * len(blocks), blocks, "signal")
            return np.stack(blocks)
        if len(blocks) == 1:
            return blocks[0]
        if join not in dims:
            raise ValueError(
                f"join must be one of signal.dims {dims} to join {len(blocks)} files, got {join!r}"
            )
        axis = dims.index(join)
        shapes = {tuple(np.delete(block.shape, axis)) for block in blocks}
        if len(shapes) > 1:
            raise ValueError(
                f"signal must have the same axes in all files but for {join}, got shapes {shapes}"
            )
        return np.concatenate(blocks, axis=axis)

    def _tones(self, signal: AnyArray) -> tuple[AnyArray, FloatArray]:
        """Return the signal over frequency, and its tones (frequency,), Hz."""
        count = signal.shape[-1]
        if self.mapping.frequency is not None:
            tones = self.sources.vector(
                self.mapping.frequency, "frequency", "frequency", count=count
            )
            if tones.size != count:
                raise ValueError(
                    f"frequency must have {count} tones as the signal has, got {tones.size}"
                )
            check_frequency(np.sort(tones))
            if tones.max() > _HIGHEST_FREQUENCY:
                raise ValueError(
                    f"frequency must be below {_HIGHEST_FREQUENCY:g} Hz, got {tones.max():g}: "
                    "unit right?"
                )
            return signal, tones
        spec: Samples = self.mapping.samples  # type: ignore[assignment]  # Mapping sees to it
        kind = "time" if spec.meaning == "delay" else "length"
        stated = self.sources.vector(spec, kind, "samples", count=count)
        two_way = stated * _TWO_WAY[spec.meaning]
        delay = two_way if spec.meaning == "delay" else two_way / SPEED_OF_LIGHT
        scale = factor(spec.band_unit, "frequency", "samples.band_unit")
        low, high, carrier = (edge * scale for edge in (*spec.band, spec.carrier))
        self.notes.append(f"impulse data taken to frequency, {low / 1e9:g} to {high / 1e9:g} GHz")
        if carrier:
            self.notes.append(f"samples are at baseband, mixed down by {carrier / 1e9:g} GHz")
        elif np.iscomplexobj(signal):
            self.notes.append(
                "samples are complex and samples.carrier is not stated: they are taken as analytic "
                f"signals, and {100 * negative_share(signal):.3g} % of their power, at negative "
                "frequencies, is left out"
            )
        spectrum, tones = impulse_to_frequency(signal, delay, (low, high), spec.pad, carrier)
        window = float(np.diff(delay).mean()) * delay.size
        self.record = {"time_window_s": window, "first_sample_s": float(delay[0])}
        return spectrum, tones

    def _geometry(
        self, sizes: dict[str, int], shape: tuple[int, ...]
    ) -> tuple[FloatArray, FloatArray, FloatArray | None]:
        """Return antenna positions (pair, 3) of transmitters and receivers, m, and poses.

        Poses (scan, 6) of the vehicle frame are those of positions in the lane frame, else None.
        """
        pairs = shape[2]
        names = ["tx_position", "rx_position"]  # Mapping sees to it that both are there, or:
        if self.mapping.antenna_position is not None:
            names = ["antenna_position"] * 2
        entries: list[tuple[str, Positions]] = [
            (name, getattr(self.mapping, name)) for name in names
        ]
        in_lane = any(spec.frame == "lane" for _, spec in entries)
        sides = []
        for (name, spec), side in zip(entries, ("tx", "rx"), strict=True):
            along = "scan" if spec.frame == "lane" else "pair"
            points = self.sources.points(spec, name, along)
            if in_lane and pairs == 1 and points.ndim == 2:
                # Positions per scan of a single antenna need no axis for it.
                points = points[:, None]
            count = points.shape[-2]
            if sizes.get(side, count) != count:
                with self.sources.entry(name, spec.file):
                    raise ValueError(
                        f"{name} must give {sizes[side]} antennas as the signal has, got {count}"
                    )
            sides.append(points)

        tx, rx = sides
        if "tx" in sizes:
            # Pairs run over the receivers of the first transmitter, then of the second.
            transmitters = tx.shape[-2]
            tx = np.repeat(tx, rx.shape[-2], axis=-2)
            rx = np.concatenate([rx] * transmitters, axis=-2)
        origin = None
        if in_lane:
            name, spec = entries[0]
            with self.sources.entry(name, spec.file):
                scans = shape[0]
                if any(points.ndim != 3 or len(points) != scans for points in (tx, rx)):
                    raise ValueError(
                        "positions in the lane frame must have the shape (scan, pair, 3) for "
                        f"{scans} scans, got {tx.shape} and {rx.shape}"
                    )
                tx, rx, origin, moved = rigid_array(tx, rx)
                if not moved <= _LARGEST_MOTION:
                    raise ValueError(
                        "positions in the lane frame must keep their form and heading from scan "
                        f"to scan within 0.1 mm, they move by {moved:g} m; give pose and "
                        "positions in the vehicle frame instead"
                    )
        for (name, spec), points in zip(entries, (tx, rx), strict=True):
            if points.shape != (pairs, 3):
                with self.sources.entry(name, spec.file):
                    raise ValueError(
                        f"{name} must give x, y, z of {pairs} pairs as the signal has, "
                        f"got {points.shape}"
                    )
        return tx, rx, origin

    def _offset(self, spec: PathOffset, shape: tuple[int, ...]) -> FloatArray:
        """Return the path, m, that the recorder subtracted, for (scan, polarization, pair)."""
        scale = 2.0 if spec.meaning == "range" else 1.0  # a range counts there and back
        values = self.sources.vector(spec, "length", "path_offset", spec.along) * scale
        scans, _, pairs = shape[:3]
        count = scans if spec.along == "scan" else pairs
        if values.size not in (1, count) or not np.isfinite(values).all():
            raise ValueError(
                f"path_offset must be one finite length or one for each of {count} {spec.along}s"
            )
        return values.reshape((-1, 1, 1) if spec.along == "scan" else (1, 1, -1))

    def _poses(
        self, time: FloatArray | None, origin: FloatArray | None, scans: int
    ) -> tuple[FloatArray, pd.DataFrame | None]:
        """Return the poses (scan, 6), and the track they come from, if they come from one."""
        mapping = self.mapping
        if self.poses is not None:
            self.notes.append("poses given beside the mapping")
            return self.poses, None
        if self.track is not None:
            if time is None:
                raise ValueError(
                    "the mapping must have the table time, the radar's time of every scan, "
                    "to use a track"
                )
            self.notes += self.track.attrs.get("notes", [])
            self.notes.append(
                "poses from a track given beside the mapping, "
                f"at {self.clock_offset:g} s + radar time"
            )
            usual = float(np.median(np.diff(self.track["time"])))  # of a slow track, no gap
            gap = max(self.max_gap, _SLOW * usual)
            pose = poses_at(self.track, time, self.clock_offset, max_gap=gap)
            return pose, self.track
        if mapping.pose is not None:
            return read_poses(self.sources, mapping.pose, scans, self.anchor), None
        if mapping.track is not None and time is not None:
            track = read_track_table(self.sources, mapping.track, self.anchor)
            spec = mapping.track
            self.notes.append(
                f"poses from the track at {spec.clock_offset:g} s "
                f"+ {spec.clock_rate:g} · radar time"
            )
            with self.sources.entry("track", spec.time.file):
                pose = poses_at(track, time, spec.clock_offset, spec.clock_rate, spec.max_gap)
            return pose, track
        if origin is None:
            raise ValueError(
                "where the vehicle was is missing: give pose, or track, or positions with "
                "frame = 'lane' in the mapping, or poses beside it"
            )
        return origin, None


def _same_shape(first: list[AnyArray], second: list[AnyArray], where: str) -> None:
    """Refuse arrays whose shapes differ."""
    for a, b in zip(first, second, strict=True):
        if a.shape != b.shape:
            raise ValueError(
                f"{where} must have the same shape everywhere, got {a.shape} and {b.shape}"
            )


def _complex(values: AnyArray) -> AnyArray:
    """Return complex numbers of real and imaginary parts that alternate along the last axis."""
    if np.iscomplexobj(values) or not values.ndim or values.shape[-1] % 2:
        raise ValueError(
            f"signal.interleaved asks for pairs of real numbers, got {values.dtype} {values.shape}"
        )
    # Counts of up to 16 bit are exact in single precision, which takes half the memory.
    if values.dtype.itemsize <= 2 or values.dtype == np.float32:
        return np.ascontiguousarray(values, np.float32).view(np.complex64)
    return np.ascontiguousarray(values, np.float64).view(np.complex128)


def _flat(blocks: list[AnyArray]) -> AnyArray:
    """Return the values of blocks in a row; those of a single one are not copied."""
    return blocks[0].ravel() if len(blocks) == 1 else np.concatenate([b.ravel() for b in blocks])


def _largest(values: AnyArray) -> float:
    """Return the largest magnitude of values, without those that are no numbers."""
    return float(np.nanmax(np.abs(values), initial=0.0))


def _unit_of_phases(values: AnyArray) -> str:
    """Return the unit in which values of both signs reach half a turn and no more; empty if in none."""
    has_both = _BOTH_SIGNS < np.mean(values > 0) < 1 - _BOTH_SIGNS if values.size else False
    for unit, half_turn in (("degrees", 180.0), ("radians", np.pi)):
        if has_both and 0.8 * half_turn < _largest(values) <= 1.001 * half_turn:
            return unit
    return ""


def _of_polar(magnitude: AnyArray, phase: AnyArray, spec: Signal) -> AnyArray:
    """Return complex numbers of a magnitude, in dB or as it is, and a phase."""
    if np.iscomplexobj(magnitude) or np.iscomplexobj(phase):
        raise ValueError("signal.magnitude and signal.phase must hold real numbers")
    size = floats(magnitude)
    if spec.magnitude == "dB":
        with np.errstate(over="ignore"):  # what is too large is refused with the signal
            size = 10.0 ** (size / 20)
    angle = np.radians(phase) if spec.phase_unit == "deg" else phase
    return np.asarray(size * np.exp(1j * floats(angle)))


def _of_parts(values: AnyArray, dims: list[str]) -> AnyArray:
    """Return complex numbers of an axis that holds real and imaginary parts, which goes."""
    axis = dims.index("complex")
    if np.iscomplexobj(values) or values.ndim != len(dims) or values.shape[axis] != 2:
        raise ValueError(
            "signal.dims: the axis called complex must hold two real numbers, of "
            f"{len(dims)} axes, got {values.dtype} {values.shape}"
        )
    real, imaginary = np.moveaxis(values, axis, 0)
    return np.asarray(real + 1j * imaginary)


def _shaped(values: AnyArray, shape: list[int]) -> AnyArray:
    """Return values in another shape."""
    try:
        return values.reshape(shape)
    except ValueError:
        raise ValueError(
            f"signal.shape must hold {values.size} values of {values.shape}, got {shape}"
        ) from None
