"""Read a few bytes that would take any amount of memory or time, and tell what they take.

Each bomb is made in a folder and read in a process of its own, which may take 4 GB and a minute.
Usage::

    python evidence/bombs.py [NAME ...]

Prints a row for each: its size, the memory and the time that reading took (those of a file of the
same kind that holds nothing, which are mostly of loading libraries, in the first row), and the
first words of the error. With PYTHONPATH on the sources of an older version it measures that.
"""

from __future__ import annotations

import io
import json
import resource
import struct
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

_MOST_MEMORY = 4 * 2**30  # bytes of addresses of a process that reads
_MOST_TIME = 60.0  # s

ARRAYS = (
    "from flgpr.formats import open_arrays; a = open_arrays(PATH); [a.read(n) for n in a.arrays]"
)
RECIPE = "from flgpr.recipe.schema import parse_recipe; parse_recipe(open(PATH).read())"
SCAN = "from flgpr.live.senders import FrameStream; list(FrameStream().take(open(PATH, 'rb').read(), True))"
TABLE = "from flgpr.store import read_table; read_table(PATH, 'alarms')"
DZX = (
    "from pathlib import Path; from flgpr_exchange.gpr.dzx import read_dzx; notes = []; "
    "read_dzx(Path(PATH), 10, notes); print(*notes)"
)
LOADED = f"import flgpr.formats.arrays; {RECIPE.split(';')[0]}; {SCAN.split(';')[0]}"


def mcap(path: Path, encoding: str, data: bytes, definition: str = "") -> None:
    """Write a recording of one message."""
    from mcap.writer import CompressionType, Writer

    out = io.BytesIO()
    writer = Writer(out, compression=CompressionType.ZSTD)
    writer.start()
    schema = writer.register_schema("made/A", "ros2msg", definition.encode()) if definition else 0
    writer.add_message(writer.register_channel("/a", encoding, schema), 1, data, 1)
    writer.finish()
    path.write_bytes(out.getvalue())


def nested_types(path: Path) -> None:
    """Write a definition of 38 types that each hold the next one twice."""
    text = "A1 a\nA1 b\n"
    for level in range(1, 38):
        text += f"===\nMSG: made/A{level}\nA{level + 1} a\nA{level + 1} b\n"
    mcap(path, "cdr", b"\0\1\0\0", text + "===\nMSG: made/A38\nfloat64[0] none\n")


def long_paths(path: Path) -> None:
    """Write a message of 9,000 numbers below a name of a million letters."""
    content = {"k" * 1_000_000: {str(number): number for number in range(9_000)}}
    mcap(path, "json", json.dumps(content).encode())


def empty_messages(path: Path) -> None:
    """Write a message of 60 million messages that hold nothing."""
    count = 60_000_000
    content = b"\0\1\0\0" + struct.pack("<I", count) + bytes(count)
    mcap(path, "cdr", content, "Empty[] all\n===\nMSG: made/Empty\n")


def wide_chunk(path: Path) -> None:
    """Write an array of ten million zeros in one chunk of 3.9 GB."""
    import h5py

    chunk = 490_000_000
    with h5py.File(path, "w") as file:
        item = file.create_dataset(
            "a", (10_000_000,), "f8", chunks=(chunk,), maxshape=(None,), compression="gzip"
        )
        # The chunk itself: zeros, packed by pieces so that this process needs no 3.9 GB.
        import zlib

        packer = zlib.compressobj(9)
        packed = b"".join(packer.compress(bytes(2**20)) for _ in range(8 * chunk // 2**20 + 1))
        item.id.write_direct_chunk((0,), packed + packer.flush())


def many_cells(path: Path) -> None:
    """Write a line of 60 million empty cells behind a comment."""
    path.write_bytes(b"# ours\n" + b";" * 60_000_000 + b"\n")


def wide_run(path: Path) -> None:
    """Write the frame of a description of 40,000 polarizations and 50,000 pairs."""
    from flgpr.store import encode_frame

    point = [0, 0, 0]
    content = {
        "format": "flgpr-live-run",
        "version": 1,
        "polarization": ["HH"] * 40_000,
        "frequency_hz": [1e9],
        "tx_m": [point] * 50_000,
        "rx_m": [point] * 50_000,
    }
    path.write_bytes(encode_frame("run", content))


def unknown_tables(path: Path) -> None:
    """Write a recipe of 2,000 unknown tables."""
    path.write_text("".join(f"[unknown-table-{number}]\na = 1\n" for number in range(2000)))


def many_elements(path: Path) -> None:
    """Write 64 MiB of empty elements."""
    path.write_bytes(b"<DZX>" + b"<a/>" * (2**24 - 10) + b"</DZX>")


BOMBS: dict[str, tuple[str, Callable[[Path], object], str, str]] = {
    "nothing": ("libraries alone", Path.touch, "a", LOADED),
    "types": ("MCAP definition that nests 38 types", nested_types, "a.mcap", ARRAYS),
    "paths": ("JSON keys below a key of a million letters", long_paths, "a.mcap", ARRAYS),
    "empty": ("60 million empty messages in one", empty_messages, "a.mcap", ARRAYS),
    "chunk": ("one HDF5 chunk of 3.9 GB", wide_chunk, "a.h5", ARRAYS),
    "cells": ("a line of 60 million cells in an array", many_cells, "a.csv", ARRAYS),
    "alarms": ("the same as a list of alarms", many_cells, "a.csv", TABLE),
    "run": ("live description of 40,000 x 50,000", wide_run, "a.frame", SCAN),
    "recipe": ("recipe of 2,000 unknown tables", unknown_tables, "a.toml", RECIPE),
    "elements": ("DZX of 64 MiB of elements", many_elements, "a.dzx", DZX),
}


def read(path: Path, code: str) -> tuple[float, float, str]:
    """Return memory, MB, and time, s, that a process takes which reads a file, and its last words."""

    def limit() -> None:
        resource.setrlimit(resource.RLIMIT_AS, (_MOST_MEMORY, _MOST_MEMORY))

    program = (
        f"PATH = {str(path)!r}\nimport sys, resource\ntry:\n    exec({code!r})\n"
        "except BaseException as error:\n    print(type(error).__name__ + ':', str(error))\n"
        "finally:\n"
        "    both = resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN\n"
        "    print('\\nMEMORY', max(resource.getrusage(who).ru_maxrss for who in both))\n"
    )
    begin = time.monotonic()
    with tempfile.TemporaryFile() as out:
        process = subprocess.Popen(
            [sys.executable, "-c", program], stdout=out, stderr=out, preexec_fn=limit
        )
        memory = 0.0
        while process.poll() is None and time.monotonic() - begin < _MOST_TIME:
            memory = max(memory, _resident(process.pid))
            time.sleep(0.05)
        seconds = time.monotonic() - begin
        process.kill()
        process.wait()
        out.seek(0)
        text = out.read().decode(errors="replace")
    words, _, peak = text.rpartition("\nMEMORY ")
    if peak.strip().isdigit():
        memory = max(memory, int(peak) / 1e3)
        return memory, seconds, f"{len(words)} characters: {' '.join(words.split())[:90]}"
    return memory, seconds, "ended by us" if seconds >= _MOST_TIME else " ".join(text.split())[-90:]


def _resident(process: int) -> float:
    """Return the memory that a process holds now, MB."""
    try:
        pages = int(Path(f"/proc/{process}/statm").read_text().split()[1])
    except (OSError, IndexError):
        return 0.0
    return pages * resource.getpagesize() / 1e6


def main() -> None:
    """Read every bomb, or those that are named."""
    chosen = sys.argv[1:] or list(BOMBS)
    print(f"| bomb | size, kB | memory, MB | time, s | told |\n|{'---|' * 5}")
    for name in chosen:
        what, write, file_name, code = BOMBS[name]
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / file_name
            write(path)
            size = path.stat().st_size / 1e3
            memory, seconds, words = read(path, code)
        print(f"| {what} | {size:.3g} | {memory:.0f} | {seconds:.1f} | {words} |", flush=True)


if __name__ == "__main__":
    main()
