"""What a manifest tells of a run."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from flgpr.io import read_manifest
from flgpr.model import complete_scans


def describe_run(run: xr.Dataset, path: str | Path | None = None) -> dict[str, Any]:
    """Describe a run for a manifest: counts, band, antennas, poses, missing sweeps, and the digest of its store."""
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
    if path is not None:
        description["path"] = str(Path(path).resolve())
        description["store_sha256"] = read_manifest(path)["sha256"]
    return description
