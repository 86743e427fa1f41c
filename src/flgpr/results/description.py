"""The description of a run in a manifest."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from flgpr.model import complete_scans
from flgpr.model.motion import judge_run
from flgpr.model.plausible import MotionLimits
from flgpr.store import read_manifest

_COPIED_ATTRIBUTES = ("soil", "georeference")


def describe_run(
    run: xr.Dataset, path: str | Path | None = None, limits: MotionLimits | None = None
) -> dict[str, Any]:
    """Return the description of a run for a manifest.

    Parameters
    ----------
    run : xarray.Dataset
        The run.
    path : path, optional
        Its store. With it the description holds the path and the digest of the store.
    limits : MotionLimits, optional
        What a vehicle can do; None takes the default limits.

    Returns
    -------
    dict
        Counts, band, antennas, poses and missing sweeps. ``motion`` lists in words and numbers the
        positions that are not plausible by ``limits``, where there are any.
    """
    frequency = run["frequency"].values
    incomplete = np.flatnonzero(~complete_scans(run))
    default_title = Path(path).stem if path else "run"
    description: dict[str, Any] = {
        "title": str(run.attrs.get("title", default_title)),
        "source": str(run.attrs.get("source", "")),
        "scans": int(run.sizes["scan"]),
        "masked_scans": [int(scan) for scan in incomplete],
        "missing_sweeps": int(np.count_nonzero(~run["valid"].values)),
        "pairs": int(run.sizes["pair"]),
        "polarizations": [str(label) for label in run["polarization"].values],
        "tones": int(frequency.size),
        "frequency_hz": [float(frequency[0]), float(frequency[-1])],
        "tx_m": np.unique(run["tx_position"].values, axis=0).tolist(),
        "rx_m": np.unique(run["rx_position"].values, axis=0).tolist(),
        "pose": run["pose"].values.tolist(),
    }
    for name in _COPIED_ATTRIBUTES:
        if name in run.attrs:
            description[name] = run.attrs[name]
    motion = judge_run(run, limits)
    if motion.notes():
        description["motion"] = motion.as_json() | {"notes": motion.notes()}
    if path is not None:
        description["path"] = str(Path(path).resolve())
        description["store_sha256"] = read_manifest(path)["sha256"]
    return description


def described_store(description: Any) -> tuple[str, str]:
    """Return the path and the digest of the store of a run, as its description in a manifest tells.

    Raises
    ------
    ValueError
        If it does not tell them as text: the run was in memory, or the manifest is forged.
    """
    path = description.get("path") if isinstance(description, dict) else None
    digest = description.get("store_sha256") if isinstance(description, dict) else None
    if not isinstance(path, str) or not isinstance(digest, str):
        raise ValueError(
            "the manifest of the result must name the store of its run by path and digest, got "
            f"{str(path)[:60]!r} and {str(digest)[:60]!r}"
        )
    return path, digest


def left_out_scans(description: Mapping[str, Any]) -> list[int]:
    """Return the scans of a described run that no image is made of, ascending.

    They have missing sweeps or a pose that is not plausible. A description of an older version,
    from before poses were judged, lists the first only.
    """
    incomplete = description.get("masked_scans", [])
    implausible = description.get("motion", {}).get("scans", [])
    return sorted({*incomplete, *implausible})


def plausible_poses(description: Mapping[str, Any]) -> NDArray[np.float64]:
    """Return the poses (scan, 6) of a described run that are plausible."""
    poses = np.asarray(description.get("pose", np.zeros((0, 6))), dtype=np.float64).reshape(-1, 6)
    implausible = description.get("motion", {}).get("scans", [])
    return np.delete(poses, implausible, axis=0)
