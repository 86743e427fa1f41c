"""The XML tree of a run as CPHD (CPHD 1.1, NGA.STND.0068)."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from datetime import UTC, datetime
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from flgpr.geo.anchor import Anchor
from flgpr.json_text import canonical_json
from flgpr.model import POSE_COMPONENTS, Grid
from flgpr.store.extras import optional

FloatArray = NDArray[np.float64]
Vectors = dict[str, NDArray[Any]]
"""Parameters of a channel's vectors (scan, ...), by their names in CPHD."""
_NAMESPACE = "http://api.nsgreg.nga.mil/schema/cphd/1.1.0"
ADDED = tuple(f"flgpr_{name}" for name in POSE_COMPONENTS)
TIME = "flgpr_time"
_LONGEST_TITLE = 200  # characters
_WORD = 8  # bytes
_CORNERS = ((-1, 1), (1, 1), (1, -1), (-1, -1))
"""Signs of x and y from the centre of the scene, clockwise as CPHD has them."""


def metadata_tree(
    run: xr.Dataset,
    names: list[str],
    vectors: dict[str, Vectors],
    anchor: Anchor,
    scene: Grid,
    time: FloatArray,
) -> Any:
    """Return the XML tree of a run's channels.

    Parameters
    ----------
    run : xarray.Dataset
        The run.
    names : list of str
        Names of the channels, ``PAIR_POLARIZATION``.
    vectors : dict of str to dict
        Parameters of the vectors of every channel.
    anchor : Anchor
        States where the lane lies.
    scene : Grid
        The ground the data are about, in the lane frame.
    time : (scan,) ndarray of float
        Times of the scans, s.

    Returns
    -------
    lxml.etree._ElementTree
        The tree, complete but for the reference geometry.

    Raises
    ------
    MissingExtraError
        If sarkit is not installed.
    """
    root = _empty()
    first = vectors[names[0]]
    title = str(run.attrs.get("title", "run"))
    root["CollectionID"] = {
        "CollectorName": "flgpr",
        "CoreName": title[:_LONGEST_TITLE] or "run",
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
        "FxBand": {
            "FxMin": float(first["FX1"][0]),
            "FxMax": float(first["FX2"][0]),
        },
        "TOASwath": {
            "TOAMin": float(first["TOA1"][0]),
            "TOAMax": float(first["TOA2"][0]),
        },
    }
    _scene(root, anchor, scene)
    layout, bytes_of_vector = _layout(first)
    _data(root, names, run.sizes["scan"], run.sizes["frequency"], bytes_of_vector)
    _channels(root, run, names, first)
    root["PVP"] = layout
    middle, duration = _dwell(first)
    root["Dwell"] = {
        "NumCODTimes": 1,
        "CODTime": [{"Identifier": "all", "CODTimePoly": np.array([[middle]])}],
        "NumDwellTimes": 1,
        "DwellTime": [{"Identifier": "all", "DwellTimePoly": np.array([[duration]])}],
    }
    return root.elem.getroottree()


def _dwell(first: Vectors) -> tuple[float, float]:
    """Return the middle and the length of the time in which the reference point is seen, s."""
    out = np.linalg.norm(first["TxPos"] - first["SRPPos"], axis=1)
    back = np.linalg.norm(first["RcvPos"] - first["SRPPos"], axis=1)
    # The pulse is at the reference point after the way out, a share of the time there and back.
    two_way_time = first["RcvTime"] - first["TxTime"]
    reached = first["TxTime"] + out / (out + back) * two_way_time
    center = float((reached[0] + reached[-1]) / 2)
    duration = float(reached[-1] - reached[0])
    return center, duration


def _scene(root: Any, anchor: Anchor, scene: Grid) -> None:
    """Add where the scene lies."""
    x1, x2, y1, y2 = scene.extent()
    center = np.array([(x1 + x2) / 2, (y1 + y2) / 2, 0.0])
    lon, lat, height = anchor.to_geodetic(center)
    half = np.array([(x2 - x1) / 2, (y2 - y1) / 2])
    corners = []
    for side_x, side_y in _CORNERS:
        corners.append(center + [side_x * half[0], side_y * half[1], 0])
    corners_lat_lon = anchor.to_geodetic(np.array(corners))[:, [1, 0]]
    middle_pixel = np.array([(scene.nx - 1) / 2, (scene.ny - 1) / 2])
    root["SceneCoordinates"] = {
        "EarthModel": "WGS_84",
        "IARP": {
            "ECF": anchor.to_geocentric(center),
            "LLH": np.array([lat, lon, height]),
        },
        "ReferenceSurface": {
            "Planar": {
                "uIAX": anchor.turn([1.0, 0, 0]),
                "uIAY": anchor.turn([0, 1.0, 0]),
            }
        },
        "ImageArea": {
            "X1Y1": -half,
            "X2Y2": half,
        },
        "ImageAreaCornerPoints": corners_lat_lon,
        "ImageGrid": {
            "IARPLocation": middle_pixel,
            "IAXExtent": {
                "LineSpacing": scene.dx,
                "FirstLine": 0,
                "NumLines": scene.nx,
            },
            "IAYExtent": {
                "SampleSpacing": scene.dy,
                "FirstSample": 0,
                "NumSamples": scene.ny,
            },
        },
    }


def _empty() -> Any:
    """Return an empty tree."""
    etree = optional("lxml.etree", "cphd")
    element = etree.Element(f"{{{_NAMESPACE}}}CPHD", nsmap={None: _NAMESPACE})
    return optional("sarkit.cphd", "cphd").ElementWrapper(element)


def _elements(block: str, name: str, records: list[dict[str, Any]]) -> Iterator[Any]:
    """Yield a block's elements of a name, each of a tree of its own."""
    for record in records:
        # In a single tree sarkit looks every value up among all, so that the time grows as their
        # square.
        root = _empty()
        root[block] = {name: [record]}
        yield root.elem[0][0]


def _data(root: Any, names: list[str], scans: int, tones: int, bytes_of_vector: int) -> None:
    """Add how the arrays of the channels lie in the file."""
    bytes_of_signal = scans * tones * _WORD  # complex numbers of two floats
    channels = []
    for number, name in enumerate(names):
        channel = {
            "Identifier": name,
            "NumVectors": scans,
            "NumSamples": tones,
            "SignalArrayByteOffset": number * bytes_of_signal,
            "PVPArrayByteOffset": number * scans * bytes_of_vector,
        }
        channels.append(channel)
    root["Data"] = {
        "SignalArrayFormat": "CF8",
        "NumBytesPVP": bytes_of_vector,
        "NumCPHDChannels": len(names),
        "Channel": _elements("Data", "Channel", channels),
        "NumSupportArrays": 0,
    }


def _channels(root: Any, run: xr.Dataset, names: list[str], first: Vectors) -> None:
    """Add the parameters of the channels, and what of a run has no element in CPHD."""
    valid = run["valid"].values
    labels = [str(label) for label in run["polarization"].values]
    lowest = first["FX1"][0]
    highest = first["FX2"][0]
    parameters = []
    for name in names:
        pair, label = name.split("_")[:2]
        sweeps = valid[:, labels.index(label), int(pair)]
        parameters.append(
            {
                "Identifier": name,
                "RefVectorIndex": run.sizes["scan"] // 2,
                "FXFixed": True,
                "TOAFixed": True,
                "SRPFixed": True,
                "SignalNormal": bool(sweeps.all()),
                "Polarization": {"TxPol": label[0], "RcvPol": label[1]},
                "FxC": float(lowest + highest) / 2,
                "FxBW": float(highest - lowest),
                "TOASaved": float(first["TOA2"][0] - first["TOA1"][0]),
                "DwellTimes": {"CODId": "all", "DwellId": "all"},
            }
        )

    attrs = {str(name): value for name, value in run.attrs.items()}
    times = []
    for time in run["time"].values.tolist():
        # JSON has no NaN.
        times.append(time if math.isfinite(time) else None)
    added = [
        ("flgpr_attrs", canonical_json(attrs).decode()),
        ("flgpr_tx_position", json.dumps(run["tx_position"].values.tolist())),
        ("flgpr_rx_position", json.dumps(run["rx_position"].values.tolist())),
        ("flgpr_frequency", json.dumps(run["frequency"].values.tolist())),
        (TIME, json.dumps(times)),
    ]
    root["Channel"] = {
        "RefChId": names[0],
        "FXFixedCPHD": True,
        "TOAFixedCPHD": True,
        "SRPFixedCPHD": True,
        "Parameters": _elements("Channel", "Parameters", parameters),
        "AddedParameters": {"Parameter": added},
    }


def _layout(first: Vectors) -> tuple[dict[str, Any], int]:
    """Return how the parameters of a vector lie in it, and its bytes; a number is a word."""
    dtype = optional("sarkit.cphd", "cphd").binary_format_string_to_dtype
    offset = 0  # in words of 8 bytes
    table = {}
    for name, values in first.items():
        size = 1
        form = "I8" if values.dtype.kind == "i" else "F8"
        if values.ndim > 1:
            size = 3
            form = "X=F8;Y=F8;Z=F8;"
        table[name] = {"Offset": offset, "Size": size, "dtype": dtype(form)}
        offset += size
    added = [{"Name": name, **table.pop(name)} for name in ADDED]
    return {**table, "AddedPVP": added}, _WORD * offset
