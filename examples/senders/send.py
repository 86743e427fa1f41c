#!/usr/bin/env python3
"""Send the scans of an array to ``flgpr live --tcp``: a pattern for the program of a radar.

    python send.py run.json scans.npy poses.csv 127.0.0.1:5601 4.2

``run.json`` describes the radar. ``scans.npy`` holds complex64 (scan, polarization, pair,
frequency). ``poses.csv`` has a line per scan, ``time,x,y,z,heading,pitch,roll`` in s, m and rad,
after a line of names; an empty time or pose is unknown. The last argument is the number of scans
per second; without it they are sent as fast as they are taken. Where ``flgpr live`` asks for a
secret, the variable FLGPR_LIVE_SECRET holds it. The formats stand in docs/reference/live-format.md.
flgpr itself is not needed here.
"""

import csv
import hmac
import math
import os
import socket
import struct
import sys
import time
import zlib
from pathlib import Path

import numpy as np

MAGIC = b"FLGPRSC1"


def frame(header, payload=b""):
    """Return a frame: its head, a header in JSON, what follows it, and a CRC-32 of all that."""
    text = header.encode()
    body = MAGIC + struct.pack("<IQ", len(text), len(payload)) + text + payload
    return body + struct.pack("<I", zlib.crc32(body))


def number(text):
    """Return a number of a table as JSON has it; null where it is unknown."""
    value = float(text) if text.strip() else math.nan
    return f"{value:.17g}" if math.isfinite(value) else "null"


def run_header(description):
    """Return the header of the frame that describes the radar: ``run.json`` and its kind."""
    members = description.strip().removeprefix("{")
    return '{"kind":"run",' + members


def scan_header(scan, line):
    """Return the header of the frame of a scan, from its line of the table of poses."""
    moment, *place = (number(text) for text in line)
    pose = "null" if "null" in place else f"[{','.join(place)}]"
    return f'{{"kind":"scan","scan":{scan},"time":{moment},"pose":{pose}}}'


def answer_challenge(connection, secret):
    """Show that we know the secret: 40 bytes come, and as many go back."""
    challenge = b""
    while len(challenge) < 40:
        data = connection.recv(40 - len(challenge))
        if not data:
            raise SystemExit("flgpr live asks for no secret")
        challenge += data
    connection.sendall(b"FLGPRAU1" + hmac.digest(secret, challenge, "sha256"))


def main(run_file, scans_file, poses_file, address, rate="0"):
    """Send all scans, each when it is due."""
    description = Path(run_file).read_text(encoding="utf-8")
    scans = np.load(scans_file, mmap_mode="r", allow_pickle=False)
    if scans.dtype != np.dtype("<c8"):
        raise SystemExit(f"{scans_file}: samples must be complex64, got {scans.dtype}")
    with open(poses_file, newline="", encoding="utf-8") as file:
        lines = list(csv.reader(file))[1:]
    if len(lines) != len(scans):
        raise SystemExit(f"{poses_file}: {len(lines)} poses for {len(scans)} scans")

    host, _, port = address.rpartition(":")
    seconds_per_scan = 1 / float(rate) if float(rate) > 0 else 0.0
    with socket.create_connection((host.strip("[]"), int(port)), timeout=10) as connection:
        secret = os.environ.get("FLGPR_LIVE_SECRET", "").strip().encode()
        if secret:
            answer_challenge(connection, secret)
        connection.settimeout(None)
        # Otherwise the last bytes of a scan may wait for the next scan.
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        connection.sendall(frame(run_header(description)))
        start = time.monotonic()
        for scan, line in enumerate(lines):
            due = start + scan * seconds_per_scan
            time.sleep(max(due - time.monotonic(), 0.0))
            samples = np.ascontiguousarray(scans[scan]).tobytes()
            connection.sendall(frame(scan_header(scan, line), samples))
        connection.sendall(frame('{"kind":"end"}'))
    print(f"sent {len(lines)} scans")


if __name__ == "__main__":
    if len(sys.argv) not in (5, 6):
        raise SystemExit("usage: send.py run.json scans.npy poses.csv ADDRESS:PORT [SCANS_PER_S]")
    main(*sys.argv[1:])
