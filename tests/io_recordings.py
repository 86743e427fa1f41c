"""Recordings as makers and users leave them, written byte by byte: variants of what :mod:`io_gpr` writes."""

import struct

import numpy as np

from io_geodesy import on_the_ellipsoid
from io_gpr import INTERVAL, SAMPLES, STEP, ZERO, gga, section, write_dt1, write_dzt

COUNTS = section(30)
TRACES = len(COUNTS)
ALONG = STEP * np.arange(TRACES)
WAY = np.stack([np.zeros(TRACES), ALONG, np.zeros(TRACES)], axis=1)
LONGITUDE, LATITUDE = on_the_ellipsoid(WAY)[:, :2].T

HEAD = 128  # bytes of a DT1's trace header
WORDS = {"number": 0, "position": 1, "bytes": 5, "receiver": 14, "transmitter": 17, "second": 23}
"""Words of 32 bits of a DT1's trace header."""


def notes_with(read, words):
    """Return the notes of a recording that hold these words."""
    return [note for note in read.history if words in note]


def set_dt1_words(path, word, values, width=2):
    """Overwrite a word of every trace header of a DT1 of ``width`` bytes a sample, little-endian."""
    raw = bytearray(path.read_bytes())
    size = HEAD + width * SAMPLES
    for trace, value in enumerate(values):
        at = trace * size + 4 * WORDS[word]
        raw[at : at + 4] = value if isinstance(value, bytes) else struct.pack("<f", value)
    path.write_bytes(raw)
    return path


def dt1_at(path, counts, places, **entries):
    """Write a DT1 whose trace headers hold these places, m."""
    return set_dt1_words(write_dt1(path, counts, **entries), "position", places)


def patched(path, *patches):
    """Overwrite bytes of a file: (offset, format, value) each."""
    raw = bytearray(path.read_bytes())
    for offset, form, value in patches:
        struct.pack_into(form, raw, offset, value)
    path.write_bytes(raw)
    return path


def two_headers(path, counts, name="300/800D", second="none"):
    """Write a DZT of two channels whose headers differ: 5 GHz and 10 GHz sampling, time zero at samples 20 and 10."""
    write_dzt(path, np.stack([counts, -counts], axis=1), names=(name, second))
    window = SAMPLES * INTERVAL * 1e9
    return patched(
        path, (1024 + 22, "<f", -ZERO * INTERVAL * 1e9 / 4), (1024 + 26, "<f", window / 2)
    )


def gps_lines(traces, latitude, longitude, form="dt1", **options):
    """Lines of a companion that gives each trace a position: ``form`` is that of "dt1" (from 1), "dzt" or "gp2"."""
    lines = (
        [";GPS@@@", ";Ver=1.1.0", "traces,odo_tick,pos(m),time_elapsed(s),GPS"]
        if form == "gp2"
        else []
    )
    for trace, lat, lon in zip(traces, latitude, longitude, strict=True):
        sentence = gga(lat, lon, 0, **options)
        if form == "gp2":
            lines.append(
                f'{trace + 1},{500 * trace},{STEP * trace:.6f},{0.1 * trace:.3f},"{sentence}"'
            )
        elif form == "dt1":
            lines += [f"Trace #{trace + 1} at position {STEP * trace:.6f}", sentence]
        else:
            lines += [f"$GSSIS,{trace},-1", sentence, ""]
    return "\r\n".join(lines) + "\r\n"


def segy_words(path, traces, extra=0, width=2, **words):
    """Set words of every trace header of a SEG-Y: name=(offset, format, function of the trace)."""
    raw = bytearray(path.read_bytes())
    size = 240 * (1 + extra) + width * SAMPLES
    for trace in range(traces):
        for offset, form, value in words.values():
            struct.pack_into(
                form, raw, 3600 + trace * size + offset, value(trace) if callable(value) else value
            )
    path.write_bytes(raw)
    return path


def with_extra_headers(path, traces, revision=b"\2\0", count=1, form=">i", width=2):
    """Give a SEG-Y of revision 2 extra headers of every trace, which hold a text as they do."""
    raw = path.read_bytes()
    head = bytearray(raw[:3600])
    head[3500:3502] = revision
    struct.pack_into(form, head, 3506, count)
    size = 240 + width * SAMPLES
    body = b""
    for trace in range(traces):
        record = raw[3600 + trace * size : 3600 + (trace + 1) * size]
        body += record[:240] + b"SEG00001".rjust(240, b"\0") * count + record[240:]
    path.write_bytes(bytes(head) + body)
    return path
