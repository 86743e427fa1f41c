"""Recordings in open formats, written byte by byte: OpenGPR and Seismic Unix."""

import json
import struct

import numpy as np

from io_gpr import INTERVAL, NOMINAL, STEP

SLICES = 12
CHANNELS = 3
SAMPLES = 64
RNG = np.random.default_rng(6)
COUNTS = RNG.integers(-3000, 3000, size=(SLICES, CHANNELS, SAMPLES))
EASTING = 614_325.0
NORTHING = 4_840_256.0


def way(slices=SLICES):
    step = np.arange(slices)
    return np.stack([EASTING + 0.3 * step, NORTHING + 0.4 * step, np.full(slices, 51.5)], axis=-1)


def slice_records(places):
    """Records of version 2 of places (slice, channel, 3): number, then top and bottom of every channel."""
    records = b""
    for number, channels in enumerate(places):
        records += struct.pack("<q", number)
        for x, y, height in channels:
            records += struct.pack("<8d", x, y, 0.0, height, x, y, 5.0, height - 5.0)
    return records


def write_ogpr(path, values=COUNTS, kind="<f4", places=None, srs=32632, version=None, **changes):
    """A preamble, a descriptor that tells where blocks lie, and the blocks; ``places`` may be their bytes."""
    volume = values.astype(kind).tobytes()
    geo = b"" if places is None else places
    if not isinstance(geo, bytes):
        geo = np.asarray(geo, "<f8").tobytes()
    slices, channels, samples = values.shape
    main = {
        "samplesCount": samples,
        "channelsCount": channels,
        "slicesCount": slices,
        "metadata": {"swathName": "S3"},
    }
    radar = {"samplingStep_m": STEP, "samplingTime_ns": INTERVAL * 1e9, "frequency_MHz": NOMINAL / 1e6,
             "propagationVelocity_mPerSec": 1e8, "polarization": "horizontal"}  # fmt: skip
    start = 4096
    blocks = [{"type": "Radar Volume", "valueType": "float" if kind == "<f4" else "int16", "byteOffset": start,
               "byteSize": len(volume), "radar": radar}]  # fmt: skip
    if geo:
        blocks.append(
            {"type": "Sample Geolocations", "byteOffset": start + len(volume), "byteSize": len(geo)}
        )
        if srs:
            blocks[-1]["srs"] = {"type": "EPSG", "value": srs}
    blocks.append({"type": "Markers", "byteOffset": start, "byteSize": 1})
    descriptor = {
        "version": version or {"major": 2, "minor": 0},
        "mainDescriptor": main | changes,
        "dataBlockDescriptors": blocks,
    }
    text = json.dumps(descriptor).encode()
    head = b"ogpr\n" + b"0" * 32 + b"\n" + f"{len(text):08x}\n".encode() + text
    path.write_bytes(head.ljust(start, b"\0") + volume + geo)
    return path


def write_su(path, counts, order="<", interval=INTERVAL, **words):
    """Traces as Seismic Unix writes them: 240 bytes, then floats."""
    data = b""
    for k, trace in enumerate(counts):
        head = bytearray(240)
        struct.pack_into(order + "H", head, 114, len(trace))
        struct.pack_into(order + "H", head, 116, round(interval * 1e12))
        struct.pack_into(order + "h", head, 70, -100)
        struct.pack_into(order + "h", head, 88, 1)
        struct.pack_into(
            order + "2i", head, 72, round(100 * STEP * k * 0.6), round(100 * STEP * k * 0.8)
        )
        data += bytes(head) + trace.astype(order + "f4").tobytes()
    path.write_bytes(data)
    return path
