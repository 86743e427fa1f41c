"""What a run store declares, checked before anything of it is decoded: names, shapes, types, chunks and sizes.

A store may come from anywhere. Its chunks hold plain numbers and a checksum, nothing compressed, so that no file can
expand; every chunk that the declared shapes ask for must have been committed with exactly the size they ask for.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from itertools import product
from typing import Any, NamedTuple

from flgpr.door import parse_json

MAX_MEMORY = 2 * 10**9
"""Memory that reading may take unless told otherwise, bytes."""
DIMS = {
    "signal": ("scan", "polarization", "pair", "frequency"),
    "valid": ("scan", "polarization", "pair"),
    "pose": ("scan", "component"),
    "tx_position": ("pair", "axis"),
    "rx_position": ("pair", "axis"),
    "frequency": ("frequency",),
    "time": ("scan",),
}
_KINDS = {name: "float64" for name in DIMS} | {"signal": "complex64", "valid": "bool"}
_WIDTHS = {"complex64": 8, "float64": 8, "bool": 1}
_CRC = 4
_SCANS_HELD = 4
_LARGEST_DESCRIPTION = 16 * 2**20


class Layout(NamedTuple):
    """How an array lies in its store: in chunks of numbers in C order, after which a CRC-32C may stand."""

    shape: tuple[int, ...]
    chunks: tuple[int, ...]
    dtype: str
    big_endian: bool


def check_declared(
    files: Mapping[str, Mapping[str, Any]],
    read: Callable[[str], bytes | None],
    max_memory: int = MAX_MEMORY,
) -> dict[str, Layout]:
    """Check what a store declares against the committed ``files`` and the memory there is; give the arrays' layouts."""
    _description(files, read, "zarr.json", "group")
    layouts: dict[str, Layout] = {}
    sizes = {"axis": 3, "component": 6}
    held = 0.0
    for name, dims in DIMS.items():
        layout = layouts[name] = _layout(
            name, _description(files, read, f"{name}/zarr.json", "array")
        )
        shape = layout.shape
        chunks = layout.chunks
        for dim, length in zip(dims, shape, strict=True):
            if sizes.setdefault(dim, length) != length:
                raise ValueError(
                    f"{name}: dimension {dim} must have the length {sizes[dim]} everywhere, got {length}"
                )
        width = _WIDTHS[layout.dtype]
        held += (
            _SCANS_HELD * width * math.prod(chunks)
            if name == "signal"
            else width * math.prod(shape)
        )
        if held > max_memory:
            raise ValueError(
                f"{name}: the run must fit into max_memory = {max_memory / 1e9:.3g} GB, its arrays up to here take "
                f"{held / 1e9:.3g} GB (shape {shape}, chunks {chunks})"
            )
        _check_chunks(name, shape, chunks, width, files)
    return layouts


def _description(
    files: Mapping[str, Mapping[str, Any]], read: Callable[[str], bytes | None], key: str, kind: str
) -> dict[str, Any]:
    if key not in files:
        raise ValueError(f"{key} is not among the committed files")
    if files[key]["bytes"] > _LARGEST_DESCRIPTION:
        raise ValueError(
            f"{key} must have at most {_LARGEST_DESCRIPTION} bytes, got {files[key]['bytes']}"
        )
    description = parse_json(read(key) or b"")
    if not isinstance(description, dict) or (
        description.get("zarr_format"),
        description.get("node_type"),
    ) != (3, kind):
        raise ValueError(f"{key} must describe a Zarr v3 {kind}")
    return description


def _layout(name: str, description: dict[str, Any]) -> Layout:
    rank = len(DIMS[name])
    grid = description.get("chunk_grid")
    chunks = grid.get("configuration", {}).get("chunk_shape") if isinstance(grid, dict) else None
    shape = description.get("shape")
    for what, value in (("shape", shape), ("chunk shape", chunks)):
        if (
            not isinstance(value, list)
            or len(value) != rank
            or not all(type(n) is int and 0 < n < 2**53 for n in value)
        ):
            raise ValueError(
                f"{name}: its {what} must be {rank} positive whole numbers, got {value}"
            )
    if description.get("data_type") != _KINDS[name]:
        raise ValueError(
            f"{name}: its type must be {_KINDS[name]}, got {description.get('data_type')}"
        )
    if description.get("dimension_names") != list(DIMS[name]):
        raise ValueError(
            f"{name}: its dimensions must be {DIMS[name]}, got {description.get('dimension_names')}"
        )
    codecs = [
        codec.get("name") if isinstance(codec, dict) else codec
        for codec in description.get("codecs", [])
    ]
    if codecs not in (["bytes", "crc32c"], ["bytes"]) or description.get("storage_transformers"):
        raise ValueError(
            f"{name}: its codecs must be bytes and crc32c, nothing that expands, got {codecs}"
        )
    if description.get("chunk_key_encoding") != {
        "name": "default",
        "configuration": {"separator": "/"},
    }:
        raise ValueError(
            f"{name}: its chunks must have the default names, got {description.get('chunk_key_encoding')}"
        )
    endian = description["codecs"][0].get("configuration", {}).get("endian", "little")
    if endian not in ("little", "big"):
        raise ValueError(f"{name}: its bytes must be little or big endian, got {endian}")
    return Layout(tuple(shape), tuple(chunks), _KINDS[name], endian == "big")  # type: ignore[arg-type]


def _check_chunks(
    name: str,
    shape: tuple[int, ...],
    chunks: tuple[int, ...],
    width: int,
    files: Mapping[str, Mapping[str, Any]],
) -> None:
    counts = [-(-length // part) for length, part in zip(shape, chunks, strict=True)]
    if math.prod(counts) > len(files):
        raise ValueError(
            f"{name}: shape {shape} in chunks of {chunks} needs {math.prod(counts)} files, got less"
        )
    size = width * math.prod(chunks)
    for index in product(*map(range, counts)):
        key = "/".join([name, "c", *map(str, index)])
        if key not in files:
            raise ValueError(
                f"{key} must be among the committed files for shape {shape} in chunks of {chunks}"
            )
        if files[key]["bytes"] not in (size, size + _CRC):
            raise ValueError(
                f"{key} must have {size + _CRC} bytes for chunks of {chunks}, got {files[key]['bytes']}"
            )
