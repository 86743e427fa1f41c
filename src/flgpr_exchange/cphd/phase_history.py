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
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import xarray as xr

from flgpr.formats.reader import Explanation, Reader
from flgpr.geo.anchor import Anchor
from flgpr.json_text import parse_json
from flgpr.model import SPEED_OF_LIGHT, Grid, check_run, make_run, vehicle_to_lane
from flgpr.model.phase import lengthen
from flgpr.store.extras import MissingExtraError, optional
from flgpr.store.files import existing
from flgpr.store.outputs import atomic_output
from flgpr.types import AnyArray, ComplexArray, FloatArray, floats
from flgpr_exchange.cphd.tree import ADDED, TIME, Vectors, metadata_tree

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
    vectors: AnyArray  # (scan,) record of the vectors' parameters


def write_cphd(
    run: xr.Dataset, path: str | Path, anchor: Anchor, scene: Grid | None = None
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
    _check_even_tones(run["frequency"].values)
    run = run.compute()  # channels cut across the store's chunks

    scene = scene or _scene_ahead(run)
    center = np.array([scene.x.mean(), scene.y.mean(), 0.0])
    time = _times(run)
    signals = {}
    vectors = {}
    for number, label in enumerate(run["polarization"].values):
        for pair in range(run.sizes["pair"]):
            name = f"{pair}_{label}"
            signals[name], vectors[name] = _channel(run, pair, number, time, anchor, center)

    names = list(signals)
    with _without_sarkits_warnings():
        tree = metadata_tree(run, names, vectors, anchor, scene, time)
        root = sarkit.ElementWrapper(tree.getroot())
    dtype = sarkit.get_pvp_dtype(tree)
    records = {name: _vector_records(vectors[name], dtype, len(time)) for name in names}
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


def _vector_records(vectors: Vectors, dtype: np.dtype[Any], scans: int) -> AnyArray:
    """Return the records (scan,) of a channel's vectors; parameters that it lacks are 0."""
    records = np.zeros(scans, dtype)
    for parameter, values in vectors.items():
        records[parameter] = values
    return records


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
    with _faults_of_cphd(path):
        with path.open("rb") as file, sarkit.Reader(file) as reader:
            tree = reader.metadata.xmltree
            added = _added_parameters(tree)
            elements = tree.findall("{*}Data/{*}Channel")
            _check_declared(tree, elements, path)
            channels = {}
            for element in elements:
                name = element.findtext("{*}Identifier")
                channels[name] = _native(*reader.read_channel(name))
        return _assembled(tree, channels, added, anchor)


@contextmanager
def _faults_of_cphd(path: Path) -> Iterator[None]:
    """Turn whatever sarkit raises on a damaged file into one ValueError that names the file."""
    try:
        yield
    except (MissingExtraError, FileNotFoundError):
        raise
    except Exception as error:
        message = " ".join(str(error).split())[:200] or type(error).__name__
        raise ValueError(f"{path}: cannot be read as CPHD: {message}") from None


@contextmanager
def _without_sarkits_warnings() -> Iterator[None]:
    """Suppress what Python warns of in sarkit's own use of importlib.resources."""
    with warnings.catch_warnings():
        warnings.filterwarnings(
            "ignore", message=r"(read|open)_\w+ is deprecated", category=DeprecationWarning
        )
        yield


def _check_even_tones(frequency: FloatArray) -> None:
    """Refuse tones (frequency,), Hz, that CPHD cannot hold."""
    if frequency.size < 2:
        raise ValueError(f"CPHD needs at least two tones, got {frequency.size}")
    step = (frequency[-1] - frequency[0]) / (frequency.size - 1)
    even = frequency[0] + step * np.arange(frequency.size)
    off = np.abs(frequency - even).max()
    if off > _UNEVEN * step:
        raise ValueError(
            f"CPHD needs evenly spaced tones, these are up to {off:g} Hz off: "
            "select an even sub-band"
        )


def _scene_ahead(run: xr.Dataset) -> Grid:
    """Return the ground ahead of the mean of the poses."""
    pose = run["pose"].values
    x, y, z, heading = pose[:, :4].mean(axis=0)
    ahead = _AHEAD + abs(z)
    center_x = x + ahead * math.sin(heading)
    center_y = y + ahead * math.cos(heading)
    return Grid.spanning(
        (center_x - _SCENE_HALF, center_x + _SCENE_HALF),
        (center_y - _SCENE_HALF, center_y + _SCENE_HALF),
        0.1,
    )


def _times(run: xr.Dataset) -> FloatArray:
    """Return the time (scan,) since the first scan, s; scan numbers where it does not increase."""
    time = floats(run["time"].values)
    if np.isfinite(time).all() and (np.diff(time) > 0).all():
        return time - time[0]
    return np.arange(time.size, dtype=np.float64)


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
    tx = vehicle_to_lane(run["tx_position"].values[pair, None], pose)[:, 0]
    rx = vehicle_to_lane(run["rx_position"].values[pair, None], pose)[:, 0]
    range_tx = np.linalg.norm(tx - center, axis=1)
    range_rx = np.linalg.norm(rx - center, axis=1)
    path = range_tx + range_rx

    valid = run["valid"].values[:, polarization, pair]
    signal = run["signal"].values[:, polarization, pair]
    compensated = lengthen(signal, frequency, -path)
    signal = np.where(valid[:, None], compensated, 0).astype(np.complex64)

    step = float((frequency[-1] - frequency[0]) / (frequency.size - 1))
    scans = len(pose)
    velocity_tx = _velocity(tx, time)
    velocity_rx = _velocity(rx, time)
    # The rate of the mean of both ranges, from which CPHD has aFDOP.
    closing = np.zeros(scans)
    closing += _along(velocity_tx, tx - center, range_tx)
    closing += _along(velocity_rx, rx - center, range_rx)
    closing *= 0.5

    vectors: Vectors = {
        "TxTime": time,
        "TxPos": anchor.to_geocentric(tx),
        "TxVel": anchor.turn(velocity_tx),
        "RcvTime": time + path / SPEED_OF_LIGHT,
        "RcvPos": anchor.to_geocentric(rx),
        "RcvVel": anchor.turn(velocity_rx),
        "SRPPos": np.broadcast_to(anchor.to_geocentric(center), (scans, 3)),
        "aFDOP": -2 * closing / SPEED_OF_LIGHT,
        "aFRR1": np.zeros(scans),
        "aFRR2": np.zeros(scans),
        "FX1": np.full(scans, frequency[0]),
        "FX2": np.full(scans, frequency[-1]),
        "TOA1": np.full(scans, -_SWATH / step),
        "TOA2": np.full(scans, _SWATH / step),
        "TDTropoSRP": np.zeros(scans),
        "SC0": np.full(scans, frequency[0]),
        "SCSS": np.full(scans, step),
        "SIGNAL": valid.astype(np.int64),
    }
    for column, name in enumerate(ADDED):
        vectors[name] = pose[:, column]
    return signal, vectors


def _velocity(position: FloatArray, time: FloatArray) -> FloatArray:
    """Return the velocity (scan, 3) of positions (scan, 3), m/s; zero of a single one."""
    if len(position) < 2:
        return np.zeros_like(position)
    return np.gradient(position, time, axis=0)


def _along(velocity: FloatArray, offset: FloatArray, distance: FloatArray) -> FloatArray:
    """Return the component (scan,) of a velocity along the offset from the reference point."""
    unit = offset / np.maximum(distance, 1e-12)[:, None]
    return np.asarray((velocity * unit).sum(axis=1))


def _added_parameters(tree: Any) -> dict[str, str]:
    """Return the texts that flgpr added, by name."""
    texts = {}
    for parameter in tree.findall("{*}Channel/{*}AddedParameters/{*}Parameter"):
        name = parameter.get("name")
        if str(name).startswith("flgpr_"):
            texts[name] = parameter.text or ""
    return texts


def _check_declared(tree: Any, channels: list[Any], path: Path) -> None:
    """Refuse what cannot become a run before anything large is read."""
    domain = tree.findtext("{*}Global/{*}DomainType")
    if domain != "FX":
        raise ValueError(f"the domain must be FX, got {domain}")
    if not channels:
        raise ValueError("there is no channel")
    if any(channel.find("{*}CompressedSignalSize") is not None for channel in channels):
        raise ValueError("compressed signals cannot be read")
    sizes = set()
    for channel in channels:
        vectors = int(channel.findtext("{*}NumVectors"))
        samples = int(channel.findtext("{*}NumSamples"))
        sizes.add((vectors, samples))
    if len(sizes) > 1:
        raise ValueError(
            f"all channels must have the same vectors and samples, got {sorted(sizes)}"
        )
    # The narrowest format of samples has two bytes.
    scans, tones = sizes.pop()
    if scans * tones * len(channels) * 2 > path.stat().st_size:
        raise ValueError(
            f"it tells of {len(channels)} channels of {scans} x {tones} samples and holds less: "
            "truncated"
        )


def _assembled(
    tree: Any,
    channels: dict[str, _Channel],
    added: dict[str, str],
    anchor: Anchor | None,
) -> xr.Dataset:
    """Return the run of the channels of a file."""
    pairs, labels, position_of = _channel_order(tree, list(channels))
    first = next(iter(channels.values())).vectors
    parameters = first.dtype.names or ()
    frequency = _frequency(channels, added)
    shape = (len(first), len(labels), pairs, frequency.size)
    signal = np.full(shape, np.nan, np.complex64)

    sign = int(tree.findtext("{*}Global/{*}SGN"))
    for name, (samples, vectors) in channels.items():
        polarization, pair = position_of[name]
        path = _leg(vectors, "TxPos") + _leg(vectors, "RcvPos")
        known = vectors.dtype.names or ()
        if "AmpSF" in known:
            samples = samples * vectors["AmpSF"][:, None]
        # SGN is the sign of the phase of a delay: a run has -1.
        if sign > 0:
            samples = samples.conj()
        values = lengthen(samples, frequency, path)
        usable = np.ones(len(first), bool)
        if "SIGNAL" in known:
            usable = vectors["SIGNAL"] == 1
        signal[usable, polarization, pair] = values[usable]

    is_of_flgpr = "flgpr_tx_position" in added and set(ADDED) <= set(parameters)
    if is_of_flgpr:
        pose = np.stack([first[name] for name in ADDED], axis=1)
        tx = np.array(parse_json(added["flgpr_tx_position"]))
        rx = np.array(parse_json(added["flgpr_rx_position"]))
        times = [np.nan if time is None else time for time in parse_json(added[TIME])]
        time = np.array(times, dtype=np.float64)
        attrs = parse_json(added["flgpr_attrs"])
        return make_run(signal, frequency, labels, tx, rx, pose, time, attrs)

    vectors_of_pair = {}
    for name, channel in channels.items():
        _, pair = position_of[name]
        vectors_of_pair[pair] = channel.vectors
    tx, rx, pose = _geometry(vectors_of_pair, anchor)
    attrs = {
        "title": tree.findtext("{*}CollectionID/{*}CoreName") or "CPHD",
        "source": f"CPHD by {tree.findtext('{*}CollectionID/{*}CollectorName')}",
        "import_notes": _notes(channels, sign),
    }
    return make_run(signal, frequency, labels, tx, rx, pose, first["TxTime"], attrs)


def _notes(channels: dict[str, _Channel], sign: int) -> list[str]:
    """Return what is assumed, converted or left out of a file of another maker."""
    notes = ["the file states no heading, pitch and roll: 0 is taken, as the array lies"]
    if sign > 0:
        notes.append("the phases are conjugated: the file has the sign +1")
    total = sum(len(channel.vectors) for channel in channels.values())
    without_signal = 0
    scaled = 0
    delayed = 0
    for channel in channels.values():
        names = channel.vectors.dtype.names or ()
        if "SIGNAL" in names:
            without_signal += int(np.count_nonzero(channel.vectors["SIGNAL"] != 1))
        if "AmpSF" in names:
            scaled += int(np.count_nonzero(channel.vectors["AmpSF"] != 1))
        delays = [channel.vectors[name] for name in _ATMOSPHERE if name in names]
        if delays:
            delayed += int(np.count_nonzero(np.any(delays, axis=0)))
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


def _native(samples: AnyArray, vectors: AnyArray) -> _Channel:
    """Return a channel in the machine's byte order, its samples as complex numbers."""
    if samples.dtype.names:
        signal = samples["real"].astype(np.float32) + 1j * samples["imag"].astype(np.float32)
    else:
        signal = samples.astype(samples.dtype.newbyteorder("="))
    return _Channel(signal, vectors.astype(vectors.dtype.newbyteorder("=")))


def _leg(vectors: AnyArray, name: str) -> FloatArray:
    """Return the distance (scan,) of an antenna from the reference point, m."""
    offset = vectors[name] - vectors["SRPPos"]
    return floats(np.linalg.norm(offset, axis=1))


def _channel_order(
    tree: Any, names: list[str]
) -> tuple[int, list[str], dict[str, tuple[int, int]]]:
    """Sort channels into polarizations and pairs, in the order of the file.

    Returns the number of pairs, the polarizations, and where each channel goes in them.
    """
    label_of = _labels(tree)
    labels = list(dict.fromkeys(label_of[name] for name in names))
    counts = {label: 0 for label in labels}
    position_of = {}
    for name in names:
        label = label_of[name]
        position_of[name] = (labels.index(label), counts[label])
        counts[label] += 1
    if len(set(counts.values())) > 1:
        raise ValueError(f"every polarization must have the same number of channels, got {counts}")
    return counts[labels[0]], labels, position_of


def _labels(tree: Any) -> dict[str, str]:
    """Return the polarization of each channel."""
    label_of = {}
    for parameters in tree.findall("{*}Channel/{*}Parameters"):
        tx = parameters.findtext("{*}Polarization/{*}TxPol")
        rx = parameters.findtext("{*}Polarization/{*}RcvPol")
        label_of[parameters.findtext("{*}Identifier")] = f"{tx}{rx}"
    return label_of


def _frequency(channels: dict[str, _Channel], added: dict[str, str]) -> FloatArray:
    """Return the tones (frequency,) of all vectors, Hz."""
    starts = [channel.vectors["SC0"] for channel in channels.values()]
    steps = [channel.vectors["SCSS"] for channel in channels.values()]
    start = np.concatenate(starts)
    step = np.concatenate(steps)
    first_channel = next(iter(channels.values()))
    count = first_channel.signal.shape[1]
    if not np.isfinite([start, step]).all():
        raise ValueError("SC0 and SCSS must be finite")
    largest = _UNEVEN * abs(step[0])
    if np.ptp(start) > largest or np.ptp(step) * count > largest:
        raise ValueError("all vectors must have the same tones, SC0 and SCSS change")
    if "flgpr_frequency" in added:
        return np.array(parse_json(added["flgpr_frequency"]), dtype=np.float64)
    return floats(start[0] + step[0] * np.arange(count))


def _geometry(
    vectors_of_pair: dict[int, AnyArray], anchor: Anchor | None
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return positions (pair, 3) of transmitters and receivers, and poses (scan, 6)."""
    if anchor is None:
        raise ValueError(
            "an anchor is needed: positions are geocentric and the file does not say where the "
            "lane is"
        )
    sides = []
    for name in ("TxPos", "RcvPos"):
        positions = []
        for pair in sorted(vectors_of_pair):
            positions.append(anchor.from_geocentric(vectors_of_pair[pair][name]))
        sides.append(np.stack(positions, axis=1))
    tx, rx = sides

    origin = tx.mean(axis=1)
    local_tx = tx - origin[:, None]
    local_rx = rx - origin[:, None]
    moved_tx = float(np.abs(local_tx - local_tx[0]).max())
    moved_rx = float(np.abs(local_rx - local_rx[0]).max())
    moved = max(moved_tx, moved_rx)
    if not moved <= _LARGEST_MOTION:
        raise ValueError(
            "the array must keep its form and heading from vector to vector, "
            f"it moves by {moved:g} m"
        )
    pose = np.zeros((len(origin), 6))
    pose[:, :3] = origin
    return local_tx[0], local_rx[0], pose


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
        with _faults_of_cphd(path):
            with path.open("rb") as file, sarkit.Reader(file) as reader:
                tree = reader.metadata.xmltree
            channels = tree.findall("{*}Data/{*}Channel")
            vectors = channels[0].findtext("{*}NumVectors")
            samples = channels[0].findtext("{*}NumSamples")
            domain = tree.findtext("{*}Global/{*}DomainType")
            low = float(tree.findtext("{*}Global/{*}FxBand/{*}FxMin")) / 1e9
            high = float(tree.findtext("{*}Global/{*}FxBand/{*}FxMax")) / 1e9
            polarizations = sorted(set(_labels(tree).values()))
            collector = tree.findtext("{*}CollectionID/{*}CollectorName")
            is_ours = "flgpr_tx_position" in _added_parameters(tree)
        anchor = "" if is_ours else "; an anchor is needed to place the lane"
        lines = [
            f"{len(channels)} channels of {vectors} vectors x {samples} samples, {domain} domain",
            f"{low:.4g} to {high:.4g} GHz, polarizations {', '.join(polarizations)}",
            f"collected by {collector}, read without a mapping{anchor}",
        ]
        return Explanation(path, self.kind, lines, needs_mapping=False)


READER = CphdReader()
