"""Import of full-wave lanes: one NumPy archive with data, geometry and, if known, truth.

The archive holds ``data`` (scan, tx, rx, polarization, frequency), ``frequency_hz``,
``polarisation``, antenna positions ``tx_xyz_m`` (scan, tx, 3) and ``rx_xyz_m`` (scan, rx, 3) in the
lane frame, and optionally ``truth``, a JSON text with ``mines`` (kind, x, y, depth of the top),
``rocks`` (x, y, radius) and ``posts`` (x, y, height).
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
import xarray as xr

from flgpr.formats.arrays import open_arrays
from flgpr.json_text import parse_json
from flgpr.model import (
    OBJECT_COLUMNS,
    TRUTH_COLUMNS,
    check_objects,
    check_truth,
    empty_table,
    make_run,
)
from flgpr.model.frames import rigid_array
from flgpr.model.printable import printable
from flgpr.store.files import existing
from flgpr.store.store_layout import MAX_MEMORY
from flgpr.types import Entries

_ARRAYS = ("data", "frequency_hz", "polarisation", "tx_xyz_m", "rx_xyz_m")
_LARGEST_MOTION = 1e-6  # m, of antennas in an array that keeps its form


@dataclass(frozen=True)
class FullwaveLane:
    """A full-wave lane in flgpr's terms."""

    run: xr.Dataset  #: the run; its vehicle frame's origin is midway between the transmitters
    truth: pd.DataFrame | None  #: the mines; None if the archive does not hold them
    objects: pd.DataFrame | None  #: rocks and posts; None if the archive does not hold them


def import_fullwave(path: str | Path, max_memory: int = MAX_MEMORY) -> FullwaveLane:
    """Read a full-wave lane from its .npz archive.

    Parameters
    ----------
    path : path
        The archive.
    max_memory : int
        Bytes that each of its arrays may take.

    Returns
    -------
    FullwaveLane
        The run, and the truth if the archive holds it.

    Raises
    ------
    ValueError
        If an array is missing, shapes do not agree, or the array of antennas changes its form.
    """
    path = existing(path, "full-wave archive")
    opened = open_arrays(path, max_memory)
    missing = [name for name in _ARRAYS if name not in opened.arrays]
    if missing:
        raise ValueError(
            f"{path}: the archive must hold {', '.join(_ARRAYS)}; missing: {', '.join(missing)}"
        )
    data, frequency, polarization, tx, rx = map(opened.read, _ARRAYS)
    shapes = [(*data.shape[:1], count, 3) for count in data.shape[1:3]]
    if data.ndim != 5 or [tx.shape, rx.shape] != shapes:
        raise ValueError(
            f"{path}: data must be (scan, tx, rx, polarization, frequency) with tx_xyz_m "
            f"(scan, tx, 3) and rx_xyz_m (scan, rx, 3), got {data.shape}, {tx.shape}, {rx.shape}"
        )
    local_tx, local_rx, pose, moved = rigid_array(tx, rx)
    if moved > _LARGEST_MOTION:
        raise ValueError(
            f"{path}: the array must keep its form and heading from scan to scan, "
            "it moves by more than 1 µm"
        )

    scans, transmitters, receivers, polarizations, tones = data.shape
    shape = (scans, polarizations, transmitters * receivers, tones)
    signal = data.transpose(0, 3, 1, 2, 4).reshape(shape)
    attrs: Entries = {"source": "full-wave (FDTD) lane", "title": printable(path.stem)}
    truth = parse_json(str(opened.read("truth"))) if "truth" in opened.arrays else None
    if truth is not None and "soil_eps" in truth:
        attrs["soil"] = {
            "permittivity": float(truth["soil_eps"]),
            "conductivity": float(truth.get("soil_sigma", 0.0)),
        }
    # Pairs run over the receivers of the first transmitter, then of the second.
    tx_of_pair = np.repeat(local_tx, receivers, axis=0)
    rx_of_pair = np.tile(local_rx, (transmitters, 1))
    run = make_run(signal, frequency, polarization, tx_of_pair, rx_of_pair, pose, attrs=attrs)
    if truth is None:
        return FullwaveLane(run, None, None)
    return FullwaveLane(run, _truth_table(truth), _object_table(truth))


def _truth_table(truth: Entries) -> pd.DataFrame:
    """Return the mines of a world as a table of truth."""
    sizes = {name: truth.get(f"mine_{name}_m", np.nan) for name in ("radius", "height")}
    rows = []
    for number, (kind, x, y, depth) in enumerate(truth.get("mines", []), start=1):
        row = {"target_id": f"mine-{number}", "x": x, "y": y, "kind": kind, "depth": depth}
        rows.append(row | sizes)
    return check_truth(pd.DataFrame(rows)) if rows else empty_table(TRUTH_COLUMNS)


def _object_table(truth: Entries) -> pd.DataFrame:
    """Return the rocks and posts of a world as a table of objects."""
    rows = []
    for kind, size_name in (("rock", "radius"), ("post", "height")):
        for number, (x, y, size) in enumerate(truth.get(f"{kind}s", []), start=1):
            sizes = {"radius": np.nan, "height": np.nan} | {size_name: size}
            rows.append({"object_id": f"{kind}-{number}", "x": x, "y": y, "kind": kind, **sizes})
    return check_objects(pd.DataFrame(rows)) if rows else empty_table(OBJECT_COLUMNS)
