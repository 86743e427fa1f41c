"""The XML tree of a run as CPHD (CPHD 1.1, NGA.STND.0068), from ``templates/metadata.xml``."""

from __future__ import annotations

import json
import math
from datetime import UTC, datetime
from typing import Any

import numpy as np
import xarray as xr

from flgpr.geo.anchor import Anchor
from flgpr.json_text import canonical_json
from flgpr.model import POSE_COMPONENTS, Grid
from flgpr.model.run import polarizations_of
from flgpr.store.extras import optional
from flgpr.store.text import utc_text
from flgpr.types import Arrays, Entries, FloatArray, floats
from flgpr_exchange.documents import document

Vectors = Arrays
"""Parameters of a channel's vectors (scan, ...), by their names in CPHD."""
ADDED = tuple(f"flgpr_{name}" for name in POSE_COMPONENTS)
TIME = "flgpr_time"
_LONGEST_TITLE = 200  # characters
_WORD = 8  # bytes
_UNKNOWN = datetime.fromtimestamp(0, UTC)  # when the data were taken: CPHD must have a time
_CORNERS = ((-1, 1), (1, 1), (1, -1), (-1, -1))
"""Signs of x and y from the centre of the scene, clockwise as CPHD has them."""


def metadata_tree(
    run: xr.Dataset,
    vectors: dict[str, Vectors],
    anchor: Anchor,
    scene: Grid,
    begin: datetime | None = None,
) -> Any:
    """Return the XML tree of a run's channels.

    Parameters
    ----------
    run : xarray.Dataset
        The run.
    vectors : dict of str to dict
        Parameters of the vectors of every channel, in the order in which a file has them, by the
        names of the channels, ``PAIR_POLARIZATION``.
    anchor : Anchor
        States where the lane lies.
    scene : Grid
        The ground the data are about, in the lane frame.
    begin : datetime, optional
        Time of the first scan; by default the beginning of 1970.

    Returns
    -------
    lxml.etree._ElementTree
        The tree, complete but for the reference geometry.

    Raises
    ------
    MissingExtraError
        If sarkit is not installed.
    """
    first = next(iter(vectors.values()))
    layout, vector_bytes = _layout(first)
    out, back = leg(first, "TxPos"), leg(first, "RcvPos")
    # The pulse is at the reference point after the way out, a share of the time there and back.
    two_way_time = first["RcvTime"] - first["TxTime"]
    reached = first["TxTime"] + out / (out + back) * two_way_time
    # JSON has no NaN.
    times = [one if math.isfinite(one) else None for one in run["time"].values.tolist()]
    kept = {f"flgpr_{name}": run[name] for name in ("tx_position", "rx_position", "frequency")}
    added = {
        "flgpr_attrs": canonical_json(dict(run.attrs)).decode(),
        **{name: json.dumps(values.values.tolist()) for name, values in kept.items()},
        TIME: json.dumps(times),
    }
    text = document(
        "flgpr_exchange.cphd",
        "metadata.xml",
        title=str(run.attrs.get("title", "run"))[:_LONGEST_TITLE] or "run",
        begin=utc_text(begin or _UNKNOWN),
        first_time=float(first["TxTime"][0]),
        last_time=float(first["TxTime"][-1]),
        lowest=float(first["FX1"][0]),
        highest=float(first["FX2"][0]),
        nearest=float(first["TOA1"][0]),
        farthest=float(first["TOA2"][0]),
        place=_place(anchor, scene),
        scene=scene,
        scans=run.sizes["scan"],
        tones=run.sizes["frequency"],
        channels=[_channel(run, name) for name in vectors],
        added=added,
        layout=layout,
        vector_bytes=vector_bytes,
        dwell_middle=float((reached[0] + reached[-1]) / 2),
        dwell=float(reached[-1] - reached[0]),
    )
    etree = optional("lxml.etree", "cphd")
    # Times of a long run are more text than a parser takes from anybody.
    parser = etree.XMLParser(remove_blank_text=True, remove_comments=True, huge_tree=True)
    return etree.fromstring(text, parser).getroottree()


def leg(vectors: Vectors, name: str) -> FloatArray:
    """Return the distance (scan,) of an antenna from the reference point, m."""
    return floats(np.linalg.norm(vectors[name] - vectors["SRPPos"], axis=1))


def _place(anchor: Anchor, scene: Grid) -> Entries:
    """Return where the scene lies: its centre, axes and corners on the Earth."""
    x1, x2, y1, y2 = scene.extent()
    center = np.array([(x1 + x2) / 2, (y1 + y2) / 2, 0.0])
    lon, lat, height = anchor.to_geodetic(center).tolist()
    half = np.array([(x2 - x1) / 2, (y2 - y1) / 2, 0.0])
    corners = center + half * [(*signs, 0) for signs in _CORNERS]
    return {
        "geocentric": anchor.to_geocentric(center).tolist(),
        "geodetic": [lat, lon, height],
        "x_axis": anchor.turn([1.0, 0, 0]).tolist(),
        "y_axis": anchor.turn([0, 1.0, 0]).tolist(),
        "half": half[:2].tolist(),
        "corners": anchor.to_geodetic(corners)[:, [1, 0]].tolist(),
    }


def _channel(run: xr.Dataset, name: str) -> Entries:
    """Return name and polarization of a channel, and whether no sweep of it is missing."""
    pair, label = name.split("_")[:2]
    sweeps = run["valid"].values[:, polarizations_of(run).index(label), int(pair)]
    return {"name": name, "label": label, "complete": bool(sweeps.all())}


def _layout(first: Vectors) -> tuple[list[Entries], int]:
    """Return how the parameters of a vector lie in it, and its bytes; a number is a word."""
    offset = 0  # in words of 8 bytes
    layout = []
    for name, values in first.items():
        size, form = 1, "I8" if values.dtype.kind == "i" else "F8"
        if values.ndim > 1:
            size, form = 3, "X=F8;Y=F8;Z=F8;"
        place = {"name": name, "offset": offset, "size": size, "format": form}
        layout.append(place | {"added": name in ADDED})
        offset += size
    return layout, _WORD * offset
