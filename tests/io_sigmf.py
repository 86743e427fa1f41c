"""SigMF recordings as other programs write them."""

import hashlib
import json

import numpy as np

TONES = 1e9 + 1e6 * np.arange(4)
"""Frequencies that a stepped recording steps through, Hz."""
DWELL = 3
"""Samples of each of them."""


def write(folder, data, content=None, captures=None, **more):
    """Write a recording of bytes; entries of the core with underscores become its names."""
    name = more.pop("name", "a")
    entries = {"core:datatype": "cf32_le", "core:version": "1.2.5"} | (content or {})
    metadata = {"global": entries, "captures": captures or [], "annotations": []} | more
    (folder / f"{name}.sigmf-data").write_bytes(data)
    path = folder / f"{name}.sigmf-meta"
    path.write_text(json.dumps(metadata))
    return path


def digest(data):
    return hashlib.sha512(data).hexdigest()


def stepped(sweeps=2, extra=0):
    """Return samples (sample, channel) of a stepped recording of two channels, and its captures."""
    rng = np.random.default_rng(3)
    count = sweeps * TONES.size + extra
    samples = rng.normal(size=(count * DWELL, 2)) + 1j * rng.normal(size=(count * DWELL, 2))
    captures = [
        {
            "core:sample_start": DWELL * number,
            "core:frequency": TONES[number % TONES.size],
            "core:datetime": f"2026-05-04T09:30:{number:02d}.5Z",
            "core:geolocation": {
                "type": "Point",
                "coordinates": [11.3, 47.9 + 1e-6 * number, 512.0],
            },
            "rig:position": [0.0, 0.1 * number, 1.5],
        }
        for number in range(count)
    ]
    return samples.astype("<c8"), captures
