"""Make the conformance set of run stores: three that must be read, three that must be refused.

    python evidence/make_conformance.py [tests/data/run-stores]

``expected.json`` beside them says what a reader must find, or why it must refuse. What a store is like is specified in
docs/reference/run-store.md.
"""

from __future__ import annotations

import json
import shutil
import sys
from pathlib import Path

import numpy as np

from flgpr.model import make_run
from flgpr.store import open_run, save_run

PAIRS = [[-0.5, 0.0, 0.2], [0.5, 0.0, 0.2]]
CHUNK = "signal/c/1/0/0/0"


def small_run(missing: bool = False, uneven: bool = False):
    """Return three scans of two pairs, two polarizations and four tones: numbers that a reader can recompute.

    The signal of scan s, polarization p, pair k and tone f is ``(s + 1) + 0.1 p + 0.01 k + 0.001j f``.
    """
    scan, polarization, pair, tone = np.ogrid[:3, :2, :2, :4]
    signal = (scan + 1) + 0.1 * polarization + 0.01 * pair + 0.001j * tone
    if missing:
        signal[1, 0, 1, 2] = np.nan
    frequency = 0.5e9 + 25e6 * np.arange(4)
    if uneven:
        frequency = np.array([0.5e9, 0.6e9, 0.625e9, 1.5e9])
    pose = np.zeros((3, 6))
    pose[:, 1] = [0.0, 0.5, 1.0]
    pose[:, 2] = 1.5
    time = np.array([0.0, np.nan, 0.5]) if uneven else np.array([0.0, 0.25, 0.5])
    attrs = {"lane": "conformance", "note": "Straße, 道路"}
    return make_run(signal, frequency, ["HH", "VV"], PAIRS, PAIRS, pose, time, attrs)


def expected_of(path: Path) -> dict:
    """Return what a reader finds in a store."""
    run = open_run(path).load()
    signal = run["signal"].values
    finite = signal[np.isfinite(signal)]
    return {
        "sizes": {name: run.sizes[name] for name in ("scan", "polarization", "pair", "frequency")},
        "frequency": run["frequency"].values.tolist(),
        "polarization": run["polarization"].values.tolist(),
        "pose": run["pose"].values.tolist(),
        "time": [None if np.isnan(t) else t for t in run["time"].values.tolist()],
        "sweeps_not_valid": int((~run["valid"].values).sum()),
        "sum_of_finite_samples": [float(finite.real.sum()), float(finite.imag.sum())],
        "attrs": run.attrs,
    }


def main() -> None:
    """Write the stores and what is expected of them."""
    root = Path(sys.argv[1] if len(sys.argv) > 1 else "tests/data/run-stores")
    shutil.rmtree(root, ignore_errors=True)
    root.mkdir(parents=True)
    expected: dict[str, dict] = {}
    runs = {
        "plain": small_run(),
        "missing-sweep": small_run(missing=True),
        "uneven-tones": small_run(uneven=True),
    }
    for name, run in runs.items():
        expected[name] = {"read": expected_of(save_run(run, root / f"{name}.zarr"))}
    damage = {
        "missing-chunk": "a chunk that the manifest lists is missing",
        "altered-chunk": "a chunk has another SHA-256 than the manifest says",
        "not-committed": "there is no manifest: writing was interrupted",
    }
    for name, reason in damage.items():
        path = root / f"{name}.zarr"
        shutil.copytree(root / "plain.zarr", path)
        chunk = path / CHUNK
        if name == "missing-chunk":
            chunk.unlink()
        elif name == "altered-chunk":
            data = bytearray(chunk.read_bytes())
            data[0] ^= 1
            chunk.write_bytes(bytes(data))
        else:
            (path / "commit.json").unlink()
        expected[name] = {"refuse": reason}
    text = json.dumps(expected, indent=1, ensure_ascii=False)
    (root / "expected.json").write_text(text + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
