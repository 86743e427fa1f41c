"""Import of full-wave lanes: one NumPy archive with data, geometry and, if known, truth.

The archive holds ``data`` (scan, tx, rx, polarization, frequency), ``frequency_hz``, ``polarisation``, antenna
positions ``tx_xyz_m`` (scan, tx, 3) and ``rx_xyz_m`` (scan, rx, 3) in the lane frame, and optionally ``truth``, a JSON
text with ``mines`` (kind, x, y, depth of the top), ``rocks`` (x, y, radius) and ``posts`` (x, y, height).
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr
from numpy.typing import NDArray

from flgpr.door import parse_json
from flgpr.formats.arrays import open_arrays
from flgpr.model import (
    OBJECT_COLUMNS,
    TRUTH_COLUMNS,
    check_objects,
    check_truth,
    empty_table,
    make_run,
)
from flgpr.store.files import existing
from flgpr.store.store_layout import MAX_MEMORY

_ARRAYS = ("data", "frequency_hz", "polarisation", "tx_xyz_m", "rx_xyz_m")


@dataclass(frozen=True)
class FullwaveLane:
    """A full-wave lane in flgpr's terms."""

    run: xr.Dataset  #: the run; its vehicle frame's origin is midway between the transmitters
    truth: pd.DataFrame | None  #: the mines; None if the archive does not tell
    objects: pd.DataFrame | None  #: rocks and posts; None if the archive does not tell


def import_fullwave(path: str | Path, max_memory: int = MAX_MEMORY) -> FullwaveLane:
    """Read a full-wave lane from its .npz archive, whose arrays may take ``max_memory`` bytes each."""
    path = existing(path, "full-wave archive")
    arrays = _load(path, max_memory)
    data = arrays["data"]
    tx = arrays["tx_xyz_m"]
    rx = arrays["rx_xyz_m"]
    if (
        data.ndim != 5
        or tx.shape != (*data.shape[:2], 3)
        or rx.shape != (data.shape[0], data.shape[2], 3)
    ):
        raise ValueError(
            f"{path}: data must be (scan, tx, rx, polarization, frequency) with tx_xyz_m (scan, tx, 3) and rx_xyz_m "
            f"(scan, rx, 3), got {data.shape}, {tx.shape}, {rx.shape}"
        )
    origin = tx.mean(axis=1)
    local_tx = tx - origin[:, None]
    local_rx = rx - origin[:, None]
    if np.abs(local_tx - local_tx[0]).max() > 1e-6 or np.abs(local_rx - local_rx[0]).max() > 1e-6:
        raise ValueError(
            f"{path}: the array must keep its form and heading from scan to scan, it moves by more than 1 µm"
        )
    scans, transmitters, receivers, polarizations, tones = data.shape
    signal = data.transpose(0, 3, 1, 2, 4).reshape(
        scans, polarizations, transmitters * receivers, tones
    )
    pose = np.zeros((scans, 6))
    pose[:, :3] = origin
    told = parse_json(str(arrays["truth"])) if "truth" in arrays else None
    attrs: dict[str, Any] = {"source": "full-wave (FDTD) lane", "title": path.stem}
    if told is not None and "soil_eps" in told:
        attrs["soil"] = {
            "permittivity": float(told["soil_eps"]),
            "conductivity": float(told.get("soil_sigma", 0.0)),
        }
    run = make_run(
        signal,
        arrays["frequency_hz"],
        arrays["polarisation"],
        np.repeat(local_tx[0], receivers, axis=0),
        np.tile(local_rx[0], (transmitters, 1)),
        pose,
        attrs=attrs,
    )
    return FullwaveLane(run, *(_tables(told) if told is not None else (None, None)))


def _load(path: Path, max_memory: int) -> dict[str, NDArray[Any]]:
    opened = open_arrays(path, max_memory)
    missing = [name for name in _ARRAYS if name not in opened.arrays]
    if missing:
        raise ValueError(
            f"{path}: the archive must hold {', '.join(_ARRAYS)}; missing: {', '.join(missing)}"
        )
    return {name: opened.read(name) for name in (*_ARRAYS, "truth") if name in opened.arrays}


def _tables(world: dict[str, Any]) -> tuple[pd.DataFrame, pd.DataFrame]:
    mines = [
        {"target_id": f"mine-{i + 1}", "x": x, "y": y, "kind": kind, "depth": depth}
        | {
            "radius": world.get("mine_radius_m", np.nan),
            "height": world.get("mine_height_m", np.nan),
        }
        for i, (kind, x, y, depth) in enumerate(world.get("mines", []))
    ]
    rocks = [
        {
            "object_id": f"rock-{i + 1}",
            "x": x,
            "y": y,
            "kind": "rock",
            "radius": radius,
            "height": np.nan,
        }
        for i, (x, y, radius) in enumerate(world.get("rocks", []))
    ]
    posts = [
        {
            "object_id": f"post-{i + 1}",
            "x": x,
            "y": y,
            "kind": "post",
            "radius": np.nan,
            "height": height,
        }
        for i, (x, y, height) in enumerate(world.get("posts", []))
    ]
    truth = check_truth(pd.DataFrame(mines)) if mines else empty_table(TRUTH_COLUMNS)
    objects = (
        check_objects(pd.DataFrame(rocks + posts))
        if rocks or posts
        else empty_table(OBJECT_COLUMNS)
    )
    return truth, objects
