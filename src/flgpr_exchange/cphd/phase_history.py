"""Runs as Compensated Phase History Data (CPHD 1.1, NGA.STND.0068) and back, by sarkit.

One channel per pair and polarization, one vector per scan, FX domain, antenna positions per vector.
The stabilization reference point is fixed: a CPHD signal has the path to it taken off, and reading
adds it again. What has no element in CPHD (pose, antenna positions in the vehicle frame,
attributes) travels in added parameters; files of other makers are read without them.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import datetime
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import xarray as xr

from flgpr.formats.array_file import faults_of_parser
from flgpr.formats.reader import Explanation, Reader
from flgpr.geo.anchor import Anchor
from flgpr.json_text import parse_json
from flgpr.model import SPEED_OF_LIGHT, Grid, check_run, make_run, vehicle_to_lane
from flgpr.model.frames import rigid_array
from flgpr.model.phase import lengthen
from flgpr.store.extras import optional
from flgpr.store.files import existing
from flgpr.store.outputs import atomic_output
from flgpr.types import AnyArray, ComplexArray, FloatArray, floats
from flgpr_exchange.cphd.tree import ADDED, TIME, Vectors, leg, metadata_tree

_ATMOSPHERE = ("TDTropoSRP", "TDIonoSRP")
"""Delays of a vector that the atmosphere makes."""
_SCENE_HALF = 10.0  # m, half the side of the scene that is taken where none is given
_AHEAD = 10.0  # m, from an antenna on the ground to the centre of that scene
_LARGEST_MOTION = 1e-3  # m, of antennas in an array that keeps its form
_UNEVEN = 1e-6  # share of a step by which tones may differ
_SWATH = 0.4  # of the unambiguous delay, to either side of the reference point


class _Channel(NamedTuple):
    """A channel as it was read."""

    signal: AnyArray  # (scan, frequency)
    vectors: Vectors


def write_cphd(
    run: xr.Dataset,
    path: str | Path,
    anchor: Anchor,
    scene: Grid | None = None,
    begin: datetime | None = None,
) -> Path:
    """Write a run as CPHD; the file is complete or absent.

    It needs sarkit.

    Parameters
    ----------
    run : xarray.Dataset
        A run with evenly spaced tones.
    path : path
        The file to write; one that exists is replaced.
    anchor : Anchor
        States where the lane lies: CPHD positions are geocentric.
    scene : Grid, optional
        The ground the data are about, in the lane frame, its centre the reference point; by default
        20 m square ahead of the mean of the poses.
    begin : datetime, optional
        Time of the first scan, with its time zone; by default the file says 1970, for it must say
        something.

    Returns
    -------
    Path
        The file.

    Raises
    ------
    ValueError
        If the run breaks a rule, or its tones are uneven or fewer than two.
    MissingExtraError
        If sarkit is not installed.
    """
    check_run(run)
    path = Path(path)
    sarkit = optional("sarkit.cphd", "cphd")
    frequency = run["frequency"].values
    if frequency.size < 2:
        raise ValueError(f"CPHD needs at least two tones, got {frequency.size}")
    even, step = np.linspace(frequency[0], frequency[-1], frequency.size, retstep=True)
    off = np.abs(frequency - even).max()
    if off > _UNEVEN * step:
        raise ValueError(
            f"CPHD needs evenly spaced tones, these are up to {off:g} Hz off: "
            "select an even sub-band"
        )
    run = run.compute()  # channels cut across the store's chunks

    if scene is None:
        x, y, z, heading = run["pose"].values[:, :4].mean(axis=0)
        ahead = _AHEAD + abs(z)
        center_x = x + ahead * math.sin(heading)
        center_y = y + ahead * math.cos(heading)
        scene = Grid.spanning(
            (center_x - _SCENE_HALF, center_x + _SCENE_HALF),
            (center_y - _SCENE_HALF, center_y + _SCENE_HALF),
            0.1,
        )
    center = np.array([scene.x.mean(), scene.y.mean(), 0.0])
    time = floats(run["time"].values)
    time = time - time[0]
    if not (np.isfinite(time).all() and (np.diff(time) > 0).all()):
        time = np.arange(time.size, dtype=np.float64)
    signals = {}
    vectors = {}
    for number, label in enumerate(run["polarization"].values):
        for pair in range(run.sizes["pair"]):
            name = f"{pair}_{label}"
            signals[name], vectors[name] = _channel(run, pair, number, time, anchor, center)

    names = list(signals)
    with _without_sarkits_warnings():
        tree = metadata_tree(run, vectors, anchor, scene, begin)
        root = sarkit.ElementWrapper(tree.getroot())
    dtype = sarkit.get_pvp_dtype(tree)
    records = {name: np.zeros(len(time), dtype) for name in names}
    for name, record in records.items():
        for parameter, values in vectors[name].items():
            record[parameter] = values
    # A vehicle that stands has no direction.
    with np.errstate(invalid="ignore", divide="ignore"), _without_sarkits_warnings():
        root["ReferenceGeometry"] = sarkit.compute_reference_geometry(tree, records[names[0]])

    metadata = sarkit.Metadata(xmltree=tree)
    with (
        atomic_output(path, replace=True) as partial,
        partial.open("wb") as file,
        sarkit.Writer(file, metadata) as writer,
    ):
        for name in names:
            writer.write_signal(name, signals[name])
            writer.write_pvp(name, records[name])
    return path


def read_cphd(path: str | Path, anchor: Anchor | None = None) -> xr.Dataset:
    """Read CPHD as a run.

    It must be in the FX domain, and its channels must have the same vectors and the same uniform
    tones. Without poses in the file, the vehicle frame has lane axes and its origin at the mean of
    the transmit positions of each vector, and the array must keep its form and heading. It needs
    sarkit.

    Parameters
    ----------
    path : path
        The file.
    anchor : Anchor, optional
        States where the lane lies. Files of other makers need it; those of flgpr hold the lane's
        positions.

    Returns
    -------
    xarray.Dataset
        The run (:func:`flgpr.model.make_run`).

    Raises
    ------
    ValueError
        If the file is damaged, cannot become a run, or needs an anchor.
    MissingExtraError
        If sarkit is not installed.
    """
    path = existing(path)
    sarkit = optional("sarkit.cphd", "cphd")
    with faults_of_parser(path, "CPHD", (FileNotFoundError,)):
        with path.open("rb") as file, sarkit.Reader(file) as reader:
            head = _head_of(reader)
            _check_declared(head, path)
            channels = {}
            for name in head.channels:
                samples, vectors = reader.read_channel(name)
                if samples.dtype.names:
                    real, imaginary = (samples[part].astype("f4") for part in ("real", "imag"))
                    signal = real + 1j * imaginary
                else:
                    signal = samples.astype(samples.dtype.newbyteorder("="))
                native = vectors.astype(vectors.dtype.newbyteorder("="))
                names = native.dtype.names or ()
                channels[name] = _Channel(signal, {name: native[name] for name in names})
        return _assembled(head, channels, anchor)


class _Head(NamedTuple):
    """What the XML of a file states."""

    tree: Any
    channels: dict[str, tuple[int, int]]  # vectors and samples of each, in the order of the file
    labels: dict[str, str]  # polarization of each channel
    added: dict[str, str]  # texts that flgpr added, by name

    def text(self, *path: str) -> Any:
        """Return the text of an element; None if there is none."""
        return self.tree.findtext("/".join(f"{{*}}{name}" for name in path))


def _head_of(reader: Any) -> _Head:
    """Return what the XML of an opened file states."""
    tree = reader.metadata.xmltree
    channels = {}
    for channel in tree.findall("{*}Data/{*}Channel"):
        sizes = [int(channel.findtext(f"{{*}}{name}")) for name in ("NumVectors", "NumSamples")]
        channels[channel.findtext("{*}Identifier")] = (sizes[0], sizes[1])
    labels = {}
    for parameters in tree.findall("{*}Channel/{*}Parameters"):
        ends = (parameters.findtext(f"{{*}}Polarization/{{*}}{end}Pol") for end in ("Tx", "Rcv"))
        labels[parameters.findtext("{*}Identifier")] = "".join(map(str, ends))
    added = {}
    for parameter in tree.findall("{*}Channel/{*}AddedParameters/{*}Parameter"):
        if str(parameter.get("name")).startswith("flgpr_"):
            added[parameter.get("name")] = parameter.text or ""
    return _Head(tree, channels, labels, added)


@contextmanager
def _without_sarkits_warnings() -> Iterator[None]:
    """Suppress what Python warns of in sarkit's own use of importlib.resources."""
    with warnings.catch_warnings():
        warnings.filterwarnings(
            "ignore", message=r"(read|open)_\w+ is deprecated", category=DeprecationWarning
        )
        yield


def _channel(
    run: xr.Dataset,
    pair: int,
    polarization: int,
    time: FloatArray,
    anchor: Anchor,
    center: FloatArray,
) -> tuple[ComplexArray, Vectors]:
    """Return a channel's signal (scan, frequency) and its vectors.

    The path to the reference point ``center`` is taken off the signal.
    """
    frequency = run["frequency"].values
    pose = run["pose"].values
    scans = len(pose)
    valid = run["valid"].values[:, polarization, pair]
    path = np.zeros(scans)
    closing = np.zeros(scans)
    sides: dict[str, tuple[FloatArray, FloatArray]] = {}
    for side in ("tx", "rx"):
        place = vehicle_to_lane(run[f"{side}_position"].values[pair, None], pose)[:, 0]
        velocity = np.gradient(place, time, axis=0) if scans > 1 else np.zeros_like(place)
        offset = place - center
        distance = np.linalg.norm(offset, axis=1)
        path += distance
        # The rate of the mean of both ranges, from which CPHD has aFDOP.
        unit = offset / np.maximum(distance, 1e-12)[:, None]
        closing += (velocity * unit).sum(axis=1)
        sides[side] = (anchor.to_geocentric(place), anchor.turn(velocity))
    closing *= 0.5

    signal = run["signal"].values[:, polarization, pair]
    compensated = lengthen(signal, frequency, -path)
    signal = np.where(valid[:, None], compensated, 0).astype(np.complex64)

    step = float((frequency[-1] - frequency[0]) / (frequency.size - 1))
    constants = {
        "aFRR1": 0.0,
        "aFRR2": 0.0,
        "FX1": frequency[0],
        "FX2": frequency[-1],
        "TOA1": -_SWATH / step,
        "TOA2": _SWATH / step,
        "TDTropoSRP": 0.0,
        "SC0": frequency[0],
        "SCSS": step,
    }
    vectors: Vectors = {
        "TxTime": time,
        "TxPos": sides["tx"][0],
        "TxVel": sides["tx"][1],
        "RcvTime": time + path / SPEED_OF_LIGHT,
        "RcvPos": sides["rx"][0],
        "RcvVel": sides["rx"][1],
        "SRPPos": np.broadcast_to(anchor.to_geocentric(center), (scans, 3)),
        "aFDOP": -2 * closing / SPEED_OF_LIGHT,
        **{name: np.full(scans, value) for name, value in constants.items()},
        "SIGNAL": valid.astype(np.int64),
        **dict(zip(ADDED, pose.T, strict=True)),
    }
    return signal, vectors


def _check_declared(head: _Head, path: Path) -> None:
    """Refuse what cannot become a run before anything large is read."""
    domain = head.text("Global", "DomainType")
    if domain != "FX":
        raise ValueError(f"the domain must be FX, got {domain}")
    if not head.channels:
        raise ValueError("there is no channel")
    if head.text("Data", "Channel", "CompressedSignalSize") is not None:
        raise ValueError("compressed signals cannot be read")
    sizes = set(head.channels.values())
    if len(sizes) > 1:
        raise ValueError(
            f"all channels must have the same vectors and samples, got {sorted(sizes)}"
        )
    # The narrowest format of samples has two bytes.
    scans, tones = sizes.pop()
    if scans * tones * len(head.channels) * 2 > path.stat().st_size:
        raise ValueError(
            f"it tells of {len(head.channels)} channels of {scans} x {tones} samples and holds "
            "less: truncated"
        )


def _assembled(head: _Head, channels: dict[str, _Channel], anchor: Anchor | None) -> xr.Dataset:
    """Return the run of the channels of a file."""
    added = head.added
    # Polarizations and pairs, in the order of the file.
    names_of: dict[str, list[str]] = {}
    for name in channels:
        names_of.setdefault(head.labels[name], []).append(name)
    counts = {label: len(names) for label, names in names_of.items()}
    if len(set(counts.values())) > 1:
        raise ValueError(f"every polarization must have the same number of channels, got {counts}")
    labels = list(names_of)
    first = next(iter(channels.values())).vectors
    frequency = _frequency(channels, added)
    shape = (len(first["TxTime"]), len(labels), counts[labels[0]], frequency.size)
    signal = np.full(shape, np.nan, np.complex64)

    sign = int(head.text("Global", "SGN"))
    for polarization, names in enumerate(names_of.values()):
        for pair, name in enumerate(names):
            samples, vectors = channels[name]
            path = leg(vectors, "TxPos") + leg(vectors, "RcvPos")
            if "AmpSF" in vectors:
                samples = samples * vectors["AmpSF"][:, None]
            # SGN is the sign of the phase of a delay: a run has -1.
            if sign > 0:
                samples = samples.conj()
            values = lengthen(samples, frequency, path)
            usable = vectors["SIGNAL"] == 1 if "SIGNAL" in vectors else np.ones(len(path), bool)
            signal[usable, polarization, pair] = values[usable]

    if "flgpr_tx_position" in added and set(ADDED) <= set(first):
        pose = np.stack([first[name] for name in ADDED], axis=1)
        tx = np.array(parse_json(added["flgpr_tx_position"]))
        rx = np.array(parse_json(added["flgpr_rx_position"]))
        times = [np.nan if time is None else time for time in parse_json(added[TIME])]
        time = np.array(times, dtype=np.float64)
        attrs = parse_json(added["flgpr_attrs"])
        return make_run(signal, frequency, labels, tx, rx, pose, time, attrs)

    pairs = [first] * shape[2]  # of polarizations that share a pair the last one of the file
    for name, channel in channels.items():
        pairs[names_of[head.labels[name]].index(name)] = channel.vectors
    tx, rx, pose = _geometry(pairs, anchor)
    attrs = {
        "title": head.text("CollectionID", "CoreName") or "CPHD",
        "source": f"CPHD by {head.text('CollectionID', 'CollectorName')}",
        "import_notes": _notes(channels, sign),
    }
    return make_run(signal, frequency, labels, tx, rx, pose, first["TxTime"], attrs)


def _notes(channels: dict[str, _Channel], sign: int) -> list[str]:
    """Return what is assumed, converted or left out of a file of another maker."""
    notes = ["the file states no heading, pitch and roll: 0 is taken, as the array lies"]
    if sign > 0:
        notes.append("the phases are conjugated: the file has the sign +1")
    total = sum(len(channel.vectors["TxTime"]) for channel in channels.values())
    without_signal = scaled = delayed = np.intp(0)
    for channel in channels.values():
        vectors = channel.vectors
        without_signal += np.count_nonzero(vectors.get("SIGNAL", 1) != 1)
        scaled += np.count_nonzero(vectors.get("AmpSF", 1) != 1)
        delays = [vectors[name] for name in _ATMOSPHERE if name in vectors]
        delayed += np.count_nonzero(np.any(delays, axis=0))
    if without_signal:
        notes.append(f"{without_signal} of {total} vectors hold no signal (SIGNAL)")
    if scaled:
        notes.append(f"{scaled} of {total} vectors are scaled by their AmpSF")
    if delayed:
        names_of_delays = " and ".join(_ATMOSPHERE)
        notes.append(
            f"the delays of the atmosphere of {delayed} of {total} vectors ({names_of_delays}) "
            "are not taken off"
        )
    return notes


def _frequency(channels: dict[str, _Channel], added: dict[str, str]) -> FloatArray:
    """Return the tones (frequency,) of all vectors, Hz."""
    start, step = (
        np.concatenate([channel.vectors[name] for channel in channels.values()])
        for name in ("SC0", "SCSS")
    )
    count = next(iter(channels.values())).signal.shape[1]
    if not np.isfinite([start, step]).all():
        raise ValueError("SC0 and SCSS must be finite")
    largest = _UNEVEN * abs(step[0])
    if np.ptp(start) > largest or np.ptp(step) * count > largest:
        raise ValueError("all vectors must have the same tones, SC0 and SCSS change")
    if "flgpr_frequency" in added:
        return np.array(parse_json(added["flgpr_frequency"]), dtype=np.float64)
    return floats(start[0] + step[0] * np.arange(count))


def _geometry(
    pairs: list[Vectors], anchor: Anchor | None
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return positions (pair, 3) of transmitters and receivers, and poses (scan, 6)."""
    if anchor is None:
        raise ValueError(
            "an anchor is needed: positions are geocentric and the file does not say where the "
            "lane is"
        )
    tx, rx = (
        np.stack([anchor.from_geocentric(vectors[name]) for vectors in pairs], axis=1)
        for name in ("TxPos", "RcvPos")
    )
    local_tx, local_rx, pose, moved = rigid_array(tx, rx)
    if not moved <= _LARGEST_MOTION:
        raise ValueError(
            "the array must keep its form and heading from vector to vector, "
            f"it moves by {moved:g} m"
        )
    return local_tx, local_rx, pose


class CphdReader(Reader):
    """Compensated Phase History Data, imported by a command of their own."""

    kind = "CPHD file"
    names = "CPHD"

    def owns(self, path: Path, head: bytes) -> bool:  # noqa: ARG002
        """Return whether the file begins with the signature."""
        return head.startswith(b"CPHD/")

    def explain(self, path: Path, limit: int) -> Explanation:  # noqa: ARG002
        """Return channels, band and collector."""
        sarkit = optional("sarkit.cphd", "cphd")
        with faults_of_parser(path, "CPHD", (FileNotFoundError,)):
            with path.open("rb") as file, sarkit.Reader(file) as reader:
                head = _head_of(reader)
            vectors, samples = next(iter(head.channels.values()))
            domain = head.text("Global", "DomainType")
            low = float(head.text("Global", "FxBand", "FxMin")) / 1e9
            high = float(head.text("Global", "FxBand", "FxMax")) / 1e9
            polarizations = sorted(set(head.labels.values()))
            collector = head.text("CollectionID", "CollectorName")
        is_ours = "flgpr_tx_position" in head.added
        anchor = "" if is_ours else "; an anchor is needed to place the lane"
        lines = [
            f"{len(head.channels)} channels of {vectors} vectors x {samples} samples, {domain} "
            "domain",
            f"{low:.4g} to {high:.4g} GHz, polarizations {', '.join(polarizations)}",
            f"collected by {collector}, read without a mapping{anchor}",
        ]
        return Explanation(path, self.kind, lines, needs_mapping=False)


READER = CphdReader()
