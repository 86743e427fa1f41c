"""Runs as Compensated Phase History Data (CPHD 1.1, NGA.STND.0068) and back, by sarkit.

One channel per pair and polarization, one vector per scan, FX domain, antenna positions per vector. The stabilization
reference point is fixed: a CPHD signal has the path to it taken off, and reading adds it again. What CPHD has no place
for (pose, antenna positions in the vehicle frame, attributes) travels in added parameters; files of other makers are
read without them.
"""

from __future__ import annotations

import json
import math
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from flgpr.door import parse_json
from flgpr.geo.anchor import Anchor
from flgpr.model import POSE_COMPONENTS, SPEED_OF_LIGHT, Grid, check_run, make_run, vehicle_to_lane
from flgpr.model.phase import lengthen
from flgpr.store.extras import MissingExtraError, optional
from flgpr.store.files import canonical_json, existing
from flgpr.store.outputs import whole_output

_NAMESPACE = "http://api.nsgreg.nga.mil/schema/cphd/1.1.0"
_VECTORS = ("TxPos", "TxVel", "RcvPos", "RcvVel", "SRPPos")
_ORDER = (
    "TxTime", "TxPos", "TxVel", "RcvTime", "RcvPos", "RcvVel", "SRPPos", "aFDOP", "aFRR1", "aFRR2", "FX1", "FX2",
    "TOA1", "TOA2", "TDTropoSRP", "SC0", "SCSS", "SIGNAL",
)  # fmt: skip
_ADDED = tuple(f"flgpr_{name}" for name in POSE_COMPONENTS)
_TIME = "flgpr_time"


def write_cphd(
    run: xr.Dataset, path: str | Path, anchor: Anchor, scene: Grid | None = None
) -> Path:
    """Write a run with uniform tones as CPHD; the file is whole or absent.

    The anchor tells where the lane lies: CPHD positions are geocentric. ``scene`` is the ground the data are about, in
    the lane frame, its centre the reference point; by default 20 m square ahead of the mean of the poses. It needs
    sarkit (MissingExtraError).
    """
    check_run(run)
    path = Path(path)
    sarkit = optional("sarkit.cphd", "cphd")
    frequency = run["frequency"].values
    _uniform(frequency)
    run = run.compute()  # channels cut across the store's chunks
    scene = scene or _ahead(run)
    center = np.array([scene.x.mean(), scene.y.mean(), 0.0])
    names = [
        f"{pair}_{label}"
        for label in run["polarization"].values
        for pair in range(run.sizes["pair"])
    ]
    pvps = {}
    signals = {}
    time = _times(run)
    for k, label in enumerate(run["polarization"].values):
        for pair in range(run.sizes["pair"]):
            name = f"{pair}_{label}"
            signals[name], pvps[name] = _channel(run, pair, k, time, anchor, center)
    with _without_sarkits_warnings():
        tree = _metadata(run, names, pvps, anchor, scene, time)
        root = sarkit.ElementWrapper(tree.getroot())
    dtype = sarkit.get_pvp_dtype(tree)
    arrays = {name: np.zeros(len(time), dtype) for name in names}
    for name, array in arrays.items():
        for quantity, value in pvps[name].items():
            array[quantity] = value
    # A vehicle that stands has no direction.
    with np.errstate(invalid="ignore", divide="ignore"), _without_sarkits_warnings():
        root["ReferenceGeometry"] = sarkit.compute_reference_geometry(tree, arrays[names[0]])
    written = sarkit.Metadata(xmltree=tree)
    with (
        whole_output(path, replace=True) as partial,
        partial.open("wb") as file,
        sarkit.Writer(file, written) as writer,
    ):
        for name in names:
            writer.write_signal(name, signals[name])
            writer.write_pvp(name, arrays[name])
    return path


def read_cphd(path: str | Path, anchor: Anchor | None = None) -> xr.Dataset:
    """Read CPHD in the FX domain, whose channels have the same vectors and the same uniform tones, as a run.

    Files of other makers need the anchor, where the lane lies; ours carry theirs. Without poses in the file, the
    vehicle frame has lane axes and its origin at the mean of the transmit positions of each vector, and the array must
    keep its form and heading. It needs sarkit (MissingExtraError).
    """
    path = existing(path)
    sarkit = optional("sarkit.cphd", "cphd")
    try:
        with path.open("rb") as file, sarkit.Reader(file) as reader:
            tree = reader.metadata.xmltree
            added = _added(tree)
            channels = tree.findall("{*}Data/{*}Channel")
            _declared(tree, channels, path)
            parts = {
                c.findtext("{*}Identifier"): reader.read_channel(c.findtext("{*}Identifier"))
                for c in channels
            }
        return _assembled(tree, parts, added, anchor)
    except (MissingExtraError, FileNotFoundError):
        raise
    except Exception as error:
        words = " ".join(str(error).split())[:200] or type(error).__name__
        raise ValueError(f"{path}: cannot be read as CPHD: {words}") from None


@contextmanager
def _without_sarkits_warnings() -> Iterator[None]:
    """Keep back what sarkit makes Python say of its own use of importlib.resources."""
    with warnings.catch_warnings():
        warnings.filterwarnings(
            "ignore", message=r"(read|open)_\w+ is deprecated", category=DeprecationWarning
        )
        yield


def _uniform(frequency: NDArray[np.float64]) -> None:
    if frequency.size < 2:
        raise ValueError(f"CPHD needs at least two tones, got {frequency.size}")
    step = (frequency[-1] - frequency[0]) / (frequency.size - 1)
    off = np.abs(frequency - (frequency[0] + step * np.arange(frequency.size))).max()
    if off > 1e-6 * step:
        raise ValueError(
            f"CPHD needs evenly spaced tones, these are up to {off:g} Hz off: select an even sub-band"
        )


def _ahead(run: xr.Dataset) -> Grid:
    pose = run["pose"].values
    x, y, z, heading = pose[:, :4].mean(axis=0)
    ahead = 10.0 + abs(z)
    return Grid.spanning(
        (x + ahead * math.sin(heading) - 10, x + ahead * math.sin(heading) + 10),
        (y + ahead * math.cos(heading) - 10, y + ahead * math.cos(heading) + 10),
        0.1,
    )


def _times(run: xr.Dataset) -> NDArray[np.float64]:
    time = np.asarray(run["time"].values, dtype=np.float64)
    if np.isfinite(time).all() and (np.diff(time) > 0).all():
        return time - time[0]
    return np.arange(time.size, dtype=np.float64)


def _channel(
    run: xr.Dataset,
    pair: int,
    polarization: int,
    time: NDArray[np.float64],
    anchor: Anchor,
    center: NDArray[np.float64],
) -> tuple[NDArray[np.complex64], dict[str, NDArray[Any]]]:
    frequency = run["frequency"].values
    pose = run["pose"].values
    tx, rx = (
        vehicle_to_lane(run[name].values[pair, None], pose)[:, 0]
        for name in ("tx_position", "rx_position")
    )
    range_tx, range_rx = (np.linalg.norm(antenna - center, axis=1) for antenna in (tx, rx))
    valid = run["valid"].values[:, polarization, pair]
    signal = run["signal"].values[:, polarization, pair]
    signal = np.where(
        valid[:, None], lengthen(signal, frequency, -(range_tx + range_rx)), 0
    ).astype(np.complex64)
    step = float((frequency[-1] - frequency[0]) / (frequency.size - 1))
    scans = len(pose)
    velocity = [np.gradient(p, time, axis=0) if scans > 1 else np.zeros_like(p) for p in (tx, rx)]
    unit = [
        (p - center) / np.maximum(r, 1e-12)[:, None] for p, r in ((tx, range_tx), (rx, range_rx))
    ]
    closing = 0.5 * sum((v * u).sum(axis=1) for v, u in zip(velocity, unit, strict=True))
    full = {
        "TxTime": time,
        "TxPos": anchor.to_geocentric(tx),
        "TxVel": anchor.turn(velocity[0]),
        "RcvTime": time + (range_tx + range_rx) / SPEED_OF_LIGHT,
        "RcvPos": anchor.to_geocentric(rx),
        "RcvVel": anchor.turn(velocity[1]),
        "SRPPos": np.broadcast_to(anchor.to_geocentric(center), (scans, 3)),
        "aFDOP": -2 * closing / SPEED_OF_LIGHT,
        "aFRR1": np.zeros(scans),
        "aFRR2": np.zeros(scans),
        "FX1": np.full(scans, frequency[0]),
        "FX2": np.full(scans, frequency[-1]),
        "TOA1": np.full(scans, -0.4 / step),
        "TOA2": np.full(scans, 0.4 / step),
        "TDTropoSRP": np.zeros(scans),
        "SC0": np.full(scans, frequency[0]),
        "SCSS": np.full(scans, step),
        "SIGNAL": valid.astype(np.int64),
        **{name: pose[:, column] for column, name in enumerate(_ADDED)},
    }
    return signal, full


def _metadata(
    run: xr.Dataset, names: list[str], pvps: dict[str, dict[str, NDArray[Any]]], anchor: Anchor,
    scene: Grid, time: NDArray[np.float64],
) -> Any:  # fmt: skip
    root = _empty()
    scans = run.sizes["scan"]
    tones = run.sizes["frequency"]
    first = pvps[names[0]]
    root["CollectionID"] = {
        "CollectorName": "flgpr",
        "CoreName": str(run.attrs.get("title", "run"))[:200] or "run",
        "CollectType": "BISTATIC",
        "RadarMode": {"ModeType": "DYNAMIC STRIPMAP"},
        "Classification": "UNCLASSIFIED",
        "ReleaseInfo": "UNRESTRICTED",
    }
    root["Global"] = {
        "DomainType": "FX",
        "SGN": -1,
        "Timeline": {
            "CollectionStart": datetime(1970, 1, 1, tzinfo=UTC),
            "TxTime1": float(time[0]),
            "TxTime2": float(time[-1]),
        },
        "FxBand": {"FxMin": float(first["FX1"][0]), "FxMax": float(first["FX2"][0])},
        "TOASwath": {"TOAMin": float(first["TOA1"][0]), "TOAMax": float(first["TOA2"][0])},
    }
    _scene(root, anchor, scene)
    _data(root, names, scans, tones)
    _channels(root, run, names, first)
    _layout(root)
    middle, duration = _dwell(first)
    root["Dwell"] = {
        "NumCODTimes": 1,
        "CODTime": [{"Identifier": "all", "CODTimePoly": np.array([[middle]])}],
        "NumDwellTimes": 1,
        "DwellTime": [{"Identifier": "all", "DwellTimePoly": np.array([[duration]])}],
    }
    return root.elem.getroottree()


def _dwell(first: dict[str, NDArray[Any]]) -> tuple[float, float]:
    out = np.linalg.norm(first["TxPos"] - first["SRPPos"], axis=1)
    back = np.linalg.norm(first["RcvPos"] - first["SRPPos"], axis=1)
    middle = first["TxTime"] + out / (out + back) * (first["RcvTime"] - first["TxTime"])
    return float((middle[0] + middle[-1]) / 2), float(middle[-1] - middle[0])


def _scene(root: Any, anchor: Anchor, scene: Grid) -> None:
    x1, x2, y1, y2 = scene.extent()
    center = np.array([(x1 + x2) / 2, (y1 + y2) / 2, 0.0])
    lon, lat, height = anchor.to_geodetic(center)
    half = np.array([(x2 - x1) / 2, (y2 - y1) / 2])
    corners = [
        center + [sx * half[0], sy * half[1], 0] for sx, sy in ((-1, 1), (1, 1), (1, -1), (-1, -1))
    ]
    places = anchor.to_geodetic(np.array(corners))[:, [1, 0]]
    root["SceneCoordinates"] = {
        "EarthModel": "WGS_84",
        "IARP": {"ECF": anchor.to_geocentric(center), "LLH": np.array([lat, lon, height])},
        "ReferenceSurface": {
            "Planar": {"uIAX": anchor.turn([1.0, 0, 0]), "uIAY": anchor.turn([0, 1.0, 0])}
        },
        "ImageArea": {"X1Y1": -half, "X2Y2": half},
        "ImageAreaCornerPoints": places,
        "ImageGrid": {
            "IARPLocation": np.array([(scene.nx - 1) / 2, (scene.ny - 1) / 2]),
            "IAXExtent": {"LineSpacing": scene.dx, "FirstLine": 0, "NumLines": scene.nx},
            "IAYExtent": {"SampleSpacing": scene.dy, "FirstSample": 0, "NumSamples": scene.ny},
        },
    }


def _empty() -> Any:
    etree = optional("lxml.etree", "cphd")
    return optional("sarkit.cphd", "cphd").ElementWrapper(
        etree.Element(f"{{{_NAMESPACE}}}CPHD", nsmap={None: _NAMESPACE})
    )


def _elements(block: str, name: str, records: list[dict[str, Any]]) -> Iterator[Any]:
    """Make a block's elements of a name, each in a tree of its own: in one, every value is looked up among all."""
    for record in records:
        root = _empty()
        root[block] = {name: [record]}
        yield root.elem[0][0]


def _data(root: Any, names: list[str], scans: int, tones: int) -> None:
    words = len(_ORDER) + 2 * len(_VECTORS) + len(_ADDED)
    channels = [
        {
            "Identifier": name,
            "NumVectors": scans,
            "NumSamples": tones,
            "SignalArrayByteOffset": k * scans * tones * 8,
            "PVPArrayByteOffset": k * scans * words * 8,
        }
        for k, name in enumerate(names)
    ]
    root["Data"] = {
        "SignalArrayFormat": "CF8",
        "NumBytesPVP": 8 * words,
        "NumCPHDChannels": len(names),
        "Channel": _elements("Data", "Channel", channels),
        "NumSupportArrays": 0,
    }


def _channels(root: Any, run: xr.Dataset, names: list[str], first: dict[str, NDArray[Any]]) -> None:
    scans = run.sizes["scan"]
    valid = run["valid"].values
    parameters = []
    for name in names:
        pair = int(name.split("_")[0])
        label = name.split("_")[1]
        k = [str(one) for one in run["polarization"].values].index(label)
        parameters.append(
            {
                "Identifier": name,
                "RefVectorIndex": scans // 2,
                "FXFixed": True,
                "TOAFixed": True,
                "SRPFixed": True,
                "SignalNormal": bool(valid[:, k, pair].all()),
                "Polarization": {"TxPol": label[0], "RcvPol": label[1]},
                "FxC": float(first["FX1"][0] + first["FX2"][0]) / 2,
                "FxBW": float(first["FX2"][0] - first["FX1"][0]),
                "TOASaved": float(first["TOA2"][0] - first["TOA1"][0]),
                "DwellTimes": {"CODId": "all", "DwellId": "all"},
            }
        )
    said = [
        ("flgpr_attrs", canonical_json({str(k): v for k, v in run.attrs.items()}).decode()),
        ("flgpr_tx_position", json.dumps(run["tx_position"].values.tolist())),
        ("flgpr_rx_position", json.dumps(run["rx_position"].values.tolist())),
        ("flgpr_frequency", json.dumps(run["frequency"].values.tolist())),
        (
            _TIME,
            json.dumps([None if not math.isfinite(t) else t for t in run["time"].values.tolist()]),
        ),
    ]
    root["Channel"] = {
        "RefChId": names[0],
        "FXFixedCPHD": True,
        "TOAFixedCPHD": True,
        "SRPFixedCPHD": True,
        "Parameters": _elements("Channel", "Parameters", parameters),
        "AddedParameters": {"Parameter": said},
    }


def _layout(root: Any) -> None:
    dtype = optional("sarkit.cphd", "cphd").binary_format_string_to_dtype
    forms = {name: "X=F8;Y=F8;Z=F8;" for name in _VECTORS} | {"SIGNAL": "I8"}
    offset = 0
    table = {}
    for name in (*_ORDER, *_ADDED):
        size = 3 if name in _VECTORS else 1
        table[name] = {"Offset": offset, "Size": size, "dtype": dtype(forms.get(name, "F8"))}
        offset += size
    added = [{"Name": name, **table.pop(name)} for name in _ADDED]
    root["PVP"] = {**table, "AddedPVP": added}


def _added(tree: Any) -> dict[str, str]:
    parameters = tree.findall("{*}Channel/{*}AddedParameters/{*}Parameter")
    return {
        one.get("name"): one.text or ""
        for one in parameters
        if str(one.get("name")).startswith("flgpr_")
    }


def _declared(tree: Any, channels: list[Any], path: Path) -> None:
    """Refuse what cannot become a run before anything large is read."""
    domain = tree.findtext("{*}Global/{*}DomainType")
    if domain != "FX":
        raise ValueError(f"the domain must be FX, got {domain}")
    if not channels:
        raise ValueError("there is no channel")
    if any(c.find("{*}CompressedSignalSize") is not None for c in channels):
        raise ValueError("compressed signals cannot be read")
    sizes = {(int(c.findtext("{*}NumVectors")), int(c.findtext("{*}NumSamples"))) for c in channels}
    if len(sizes) > 1:
        raise ValueError(
            f"all channels must have the same vectors and samples, got {sorted(sizes)}"
        )
    scans, tones = sizes.pop()
    if scans * tones * len(channels) * 2 > path.stat().st_size:
        raise ValueError(
            f"it tells of {len(channels)} channels of {scans} x {tones} samples and holds less: truncated"
        )


def _assembled(
    tree: Any,
    parts: dict[str, tuple[NDArray[Any], NDArray[Any]]],
    added: dict[str, str],
    anchor: Anchor | None,
) -> xr.Dataset:
    native = {
        name: (_native(s), p.astype(p.dtype.newbyteorder("="))) for name, (s, p) in parts.items()
    }
    pairs, labels, channel_of = _channel_order(tree, list(native))
    first = next(iter(native.values()))[1]
    frequency = _frequency(native, added)
    scans = len(first)
    signal = np.full((scans, len(labels), pairs, frequency.size), np.nan, np.complex64)
    sign = int(tree.findtext("{*}Global/{*}SGN"))
    for name, (samples, pvp) in native.items():
        k, pair = channel_of[name]
        path = _leg(pvp, "TxPos") + _leg(pvp, "RcvPos")
        if "AmpSF" in (pvp.dtype.names or ()):
            samples = samples * pvp["AmpSF"][:, None]
        values = lengthen(samples.conj() if sign > 0 else samples, frequency, path)
        good = pvp["SIGNAL"] == 1 if "SIGNAL" in (pvp.dtype.names or ()) else np.ones(scans, bool)
        signal[good, k, pair] = values[good]
    if all(name in (first.dtype.names or ()) for name in _ADDED) and "flgpr_tx_position" in added:
        pose = np.stack([first[name] for name in _ADDED], axis=1)
        tx, rx = (np.array(parse_json(added[f"flgpr_{side}_position"])) for side in ("tx", "rx"))
        time = np.array(
            [np.nan if t is None else t for t in parse_json(added[_TIME])], dtype=np.float64
        )
        return make_run(
            signal, frequency, labels, tx, rx, pose, time, parse_json(added["flgpr_attrs"])
        )
    tx, rx, pose = _geometry(
        {channel_of[name][1]: pvp for name, (_, pvp) in native.items()}, anchor
    )
    title = tree.findtext("{*}CollectionID/{*}CoreName") or "CPHD"
    source = f"CPHD by {tree.findtext('{*}CollectionID/{*}CollectorName')}"
    return make_run(
        signal, frequency, labels, tx, rx, pose, first["TxTime"], {"title": title, "source": source}
    )


def _native(samples: NDArray[Any]) -> NDArray[Any]:
    if samples.dtype.names:
        return samples["real"].astype(np.float32) + 1j * samples["imag"].astype(np.float32)
    return samples.astype(samples.dtype.newbyteorder("="))


def _leg(pvp: NDArray[Any], name: str) -> NDArray[np.float64]:
    return np.asarray(np.linalg.norm(pvp[name] - pvp["SRPPos"], axis=1), dtype=np.float64)


def _channel_order(
    tree: Any, names: list[str]
) -> tuple[int, list[str], dict[str, tuple[int, int]]]:
    """Sort channels into polarizations and pairs, in the order of the file."""
    known: dict[str, str] = {}
    for one in tree.findall("{*}Channel/{*}Parameters"):
        tx, rx = (one.findtext(f"{{*}}Polarization/{{*}}{side}") for side in ("TxPol", "RcvPol"))
        known[one.findtext("{*}Identifier")] = f"{tx}{rx}"
    labels = list(dict.fromkeys(known[name] for name in names))
    counts = {label: 0 for label in labels}
    channel_of = {}
    for name in names:
        label = known[name]
        channel_of[name] = (labels.index(label), counts[label])
        counts[label] += 1
    if len(set(counts.values())) > 1:
        raise ValueError(f"every polarization must have the same number of channels, got {counts}")
    return counts[labels[0]], labels, channel_of


def _frequency(
    native: dict[str, tuple[NDArray[Any], NDArray[Any]]], added: dict[str, str]
) -> NDArray[np.float64]:
    start = np.concatenate([pvp["SC0"] for _, pvp in native.values()])
    step = np.concatenate([pvp["SCSS"] for _, pvp in native.values()])
    count = next(iter(native.values()))[0].shape[1]
    if not (np.isfinite(start).all() and np.isfinite(step).all()):
        raise ValueError("SC0 and SCSS must be finite")
    if np.ptp(start) > 1e-6 * abs(step[0]) or np.ptp(step) * count > 1e-6 * abs(step[0]):
        raise ValueError("all vectors must have the same tones, SC0 and SCSS change")
    if "flgpr_frequency" in added:
        return np.array(parse_json(added["flgpr_frequency"]), dtype=np.float64)
    return np.asarray(start[0] + step[0] * np.arange(count), dtype=np.float64)


def _geometry(
    pvps: dict[int, NDArray[Any]], anchor: Anchor | None
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    if anchor is None:
        raise ValueError(
            "an anchor is needed: positions are geocentric and the file does not say where the lane is"
        )
    tx, rx = (
        np.stack([anchor.from_geocentric(pvps[pair][name]) for pair in sorted(pvps)], axis=1)
        for name in ("TxPos", "RcvPos")
    )
    origin = tx.mean(axis=1)
    local = [part - origin[:, None] for part in (tx, rx)]
    moved = max(float(np.abs(part - part[0]).max()) for part in local)
    if not moved <= 1e-3:
        raise ValueError(
            f"the array must keep its form and heading from vector to vector, it moves by {moved:g} m"
        )
    pose = np.zeros((len(origin), 6))
    pose[:, :3] = origin
    return local[0][0], local[1][0], pose
