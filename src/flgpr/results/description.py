"""What a manifest tells of a run."""

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


def describe_run(
    run: xr.Dataset, path: str | Path | None = None, limits: MotionLimits | None = None
) -> dict[str, Any]:
    """Describe a run for a manifest: counts, band, antennas, poses, missing sweeps, and the digest of its store.

    ``motion`` tells what positions are not plausible by the ``limits``, in words and numbers, where some are not.
    """
    frequency = run["frequency"].values
    complete = complete_scans(run)
    description = {
        "title": str(run.attrs.get("title", Path(path).stem if path else "run")),
        "source": str(run.attrs.get("source", "")),
        "scans": int(run.sizes["scan"]),
        "masked_scans": [int(scan) for scan in np.flatnonzero(~complete)],
        "missing_sweeps": int(np.count_nonzero(~run["valid"].values)),
        "pairs": int(run.sizes["pair"]),
        "polarizations": [str(label) for label in run["polarization"].values],
        "tones": int(frequency.size),
        "frequency_hz": [float(frequency[0]), float(frequency[-1])],
        "tx_m": np.unique(run["tx_position"].values, axis=0).tolist(),
        "rx_m": np.unique(run["rx_position"].values, axis=0).tolist(),
        "pose": run["pose"].values.tolist(),
    }
    description |= {name: run.attrs[name] for name in ("soil", "georeference") if name in run.attrs}
    motion = judge_run(run, limits)
    if motion.notes():
        description["motion"] = motion.as_json() | {"notes": motion.notes()}
    if path is not None:
        description["path"] = str(Path(path).resolve())
        description["store_sha256"] = read_manifest(path)["sha256"]
    return description


def left_out_scans(described: Mapping[str, Any]) -> list[int]:
    """List the scans of a described run that no image is made of: with missing sweeps, or a pose that is not plausible.

    A run that was described before poses were judged has the first alone.
    """
    implausible = described.get("motion", {}).get("scans", [])
    return sorted({*described.get("masked_scans", []), *implausible})


def plausible_poses(described: Mapping[str, Any]) -> NDArray[np.float64]:
    """Give the poses (scan, 6) of a described run that are plausible."""
    poses = np.asarray(described.get("pose", np.zeros((0, 6))), dtype=np.float64).reshape(-1, 6)
    return np.delete(poses, described.get("motion", {}).get("scans", []), axis=0)
