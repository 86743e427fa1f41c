"""Checks of what a run store declares: names, shapes, types, chunks and sizes.

They are made before anything is decoded, because a store may come from anywhere. Its chunks hold
plain numbers and a checksum, nothing compressed, so that no file can expand. Every chunk of the
declared shapes must be among the committed files and have exactly the declared size.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from itertools import product
from typing import Any, NamedTuple

from flgpr.json_text import parse_json
from flgpr.model.constants import DIMS

MAX_MEMORY = 2 * 10**9
"""Memory that reading may take by default, bytes."""
_KINDS = {name: "float64" for name in DIMS} | {"signal": "complex64", "valid": "bool"}
_WIDTHS = {"complex64": 8, "float64": 8, "bool": 1}
_CHUNK_KEYS = {"name": "default", "configuration": {"separator": "/"}}
"""How Zarr names the files of chunks by default: NAME/c/0/0/..."""
_CRC = 4  # bytes
_SCANS_IN_MEMORY = 4
_LARGEST_DESCRIPTION = 16 * 2**20  # bytes


class ArrayLayout(NamedTuple):
    """How an array lies in its store: chunks of numbers in C order, with or without a CRC-32C."""

    shape: tuple[int, ...]  #: of the array
    chunks: tuple[int, ...]  #: shape of a chunk
    dtype: str  #: "float64", "complex64" or "bool"
    big_endian: bool  #: byte order


def check_declared(
    files: Mapping[str, Mapping[str, Any]],
    read: Callable[[str], bytes],
    max_memory: int = MAX_MEMORY,
) -> dict[str, ArrayLayout]:
    """Return the layouts of a store's arrays, checked against the committed files and the memory.

    Parameters
    ----------
    files : mapping of str to mapping
        The committed files, with their ``bytes``.
    read : callable
        Returns the verified content of a file.
    max_memory : int
        Memory that the small arrays and a few scans may take, bytes.

    Returns
    -------
    dict of str to ArrayLayout
        The layout of each array, by name.

    Raises
    ------
    ValueError
        If the store declares anything else than a run, or too much memory.
    """
    group = _description(files, read, "zarr.json", "group")
    consolidated = _consolidated(group)
    layouts: dict[str, ArrayLayout] = {}
    sizes = {"axis": 3, "component": 6}
    needed = 0.0
    for name, dims in DIMS.items():
        description = _description(files, read, f"{name}/zarr.json", "array")
        layout = _layout(name, description)
        for dim, length in zip(dims, layout.shape, strict=True):
            if sizes.setdefault(dim, length) != length:
                raise ValueError(
                    f"{name}: dimension {dim} must have the length {sizes[dim]} everywhere, "
                    f"got {length}"
                )
        needed += _memory_needed(name, layout)
        if needed > max_memory:
            raise ValueError(
                f"{name}: the run must fit into max_memory = {max_memory / 1e9:.3g} GB, "
                f"its arrays up to here take {needed / 1e9:.3g} GB "
                f"(shape {layout.shape}, chunks {layout.chunks})"
            )
        _check_chunks(name, layout, files)
        if consolidated is not None and consolidated.get(name) != description:
            raise ValueError(
                f"{name}: the group's consolidated metadata must be the array's own, got others"
            )
        layouts[name] = layout
    return layouts


def _memory_needed(name: str, layout: ArrayLayout) -> int:
    """Return the bytes that an array takes in memory: all of it, or a few scans of the signal."""
    width = _WIDTHS[layout.dtype]
    if name == "signal":
        return _SCANS_IN_MEMORY * width * math.prod(layout.chunks)
    return width * math.prod(layout.shape)


def _description(
    files: Mapping[str, Mapping[str, Any]], read: Callable[[str], bytes], key: str, kind: str
) -> dict[str, Any]:
    """Return the description of a group or an array of Zarr."""
    if key not in files:
        raise ValueError(f"{key} is not among the committed files")
    if files[key]["bytes"] > _LARGEST_DESCRIPTION:
        raise ValueError(
            f"{key} must have at most {_LARGEST_DESCRIPTION} bytes, got {files[key]['bytes']}"
        )
    description = parse_json(read(key))
    is_zarr_3 = isinstance(description, dict) and description.get("zarr_format") == 3
    if not is_zarr_3 or description.get("node_type") != kind:
        raise ValueError(f"{key} must describe a Zarr v3 {kind}")
    return dict(description)


def _consolidated(group: Mapping[str, Any]) -> dict[str, Any] | None:
    """Return the descriptions of arrays that the group repeats; None if it repeats none."""
    stated = group.get("consolidated_metadata")
    if stated is None:
        return None
    metadata = stated.get("metadata") if isinstance(stated, dict) else None
    if not isinstance(metadata, dict):
        raise ValueError("zarr.json: consolidated_metadata must hold the arrays' metadata")
    return metadata


def _layout(name: str, description: dict[str, Any]) -> ArrayLayout:
    """Return the layout of an array, whose description must be as run stores are written."""
    rank = len(DIMS[name])
    grid = description.get("chunk_grid")
    stated_chunks: Any = None
    if isinstance(grid, dict):
        stated_chunks = grid.get("configuration", {}).get("chunk_shape")
    shape = _shape(f"{name}: its shape", description.get("shape"), rank)
    chunks = _shape(f"{name}: its chunk shape", stated_chunks, rank)
    if description.get("data_type") != _KINDS[name]:
        raise ValueError(
            f"{name}: its type must be {_KINDS[name]}, got {description.get('data_type')}"
        )
    if description.get("dimension_names") != list(DIMS[name]):
        raise ValueError(
            f"{name}: its dimensions must be {DIMS[name]}, got {description.get('dimension_names')}"
        )
    codecs = []
    for codec in description.get("codecs", []):
        codecs.append(codec.get("name") if isinstance(codec, dict) else codec)
    is_plain = codecs in (["bytes", "crc32c"], ["bytes"])
    if not is_plain or description.get("storage_transformers"):
        raise ValueError(
            f"{name}: its codecs must be bytes and crc32c, nothing that expands, got {codecs}"
        )
    key_encoding = description.get("chunk_key_encoding")
    if key_encoding != _CHUNK_KEYS:
        raise ValueError(f"{name}: its chunks must have the default names, got {key_encoding}")
    endian = description["codecs"][0].get("configuration", {}).get("endian", "little")
    if endian not in ("little", "big"):
        raise ValueError(f"{name}: its bytes must be little or big endian, got {endian}")
    return ArrayLayout(shape, chunks, _KINDS[name], endian == "big")


def _shape(label: str, value: Any, rank: int) -> tuple[int, ...]:
    """Return a declared shape, which must be of ``rank`` positive whole numbers."""
    is_list = isinstance(value, list) and len(value) == rank
    if not is_list or not all(type(n) is int and 0 < n < 2**53 for n in value):
        raise ValueError(f"{label} must be {rank} positive whole numbers, got {value}")
    return tuple(value)


def _check_chunks(name: str, layout: ArrayLayout, files: Mapping[str, Mapping[str, Any]]) -> None:
    """Refuse an array of which a chunk was not committed or has another size."""
    shape = layout.shape
    chunks = layout.chunks
    counts = []
    for length, chunk_length in zip(shape, chunks, strict=True):
        rounded_up = -(-length // chunk_length)  # exact: lengths may be beyond a float's digits
        counts.append(rounded_up)
    # First their number: a hostile shape would make the loop over the chunks endless.
    needed = math.prod(counts)
    if needed > len(files):
        raise ValueError(
            f"{name}: shape {shape} in chunks of {chunks} needs {needed} files, got less"
        )
    size = _WIDTHS[layout.dtype] * math.prod(chunks)
    for index in product(*map(range, counts)):
        key = "/".join([name, "c", *map(str, index)])
        if key not in files:
            raise ValueError(
                f"{key} must be among the committed files for shape {shape} in chunks of {chunks}"
            )
        if files[key]["bytes"] not in (size, size + _CRC):
            raise ValueError(
                f"{key} must have {size + _CRC} bytes for chunks of {chunks}, "
                f"got {files[key]['bytes']}"
            )
