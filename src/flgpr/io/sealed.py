"""JSON files that carry their own digest, and names that must stay inside their folder."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from pathlib import Path, PurePosixPath
from typing import Any

from flgpr.io.files import canonical_json, sha256

MOST_BYTES = 256 * 2**20
"""Largest sealed file that is read."""


def seal(content: Mapping[str, Any]) -> bytes:
    """Write a JSON object with its own SHA-256 as last entry; NaN, infinity or an entry ``sha256`` is a ValueError."""
    if "sha256" in content:
        raise ValueError("content must not hold the entry sha256, which is added")
    whole = {**content, "sha256": sha256(canonical_json(content))}
    return json.dumps(whole, indent=1, allow_nan=False).encode() + b"\n"


def unseal(data: bytes) -> dict[str, Any]:
    """Read what :func:`seal` wrote, with ``sha256``; a byte that differs is a ValueError."""
    try:
        whole = json.loads(data)
        content = {name: value for name, value in whole.items() if name != "sha256"}
        same = seal(content) == data
    except (ValueError, AttributeError, RecursionError) as error:
        raise ValueError(f"it cannot be read ({error})") from None
    if not same:
        raise ValueError("it differs from what was written")
    return dict(whole)


def read_limited(path: Path, most: int = MOST_BYTES) -> bytes:
    """Read a file of at most so many bytes; a larger one is a ValueError."""
    with path.open("rb") as file:
        size = os.fstat(file.fileno()).st_size
        data = file.read(min(size, most) + 1)  # a buffer of this size is made at once
    if len(data) > most:
        raise ValueError(f"{path}: it must hold at most {most / 2**20:g} MiB, got more")
    return data


def inside(root: Path, name: str) -> Path:
    """Find a file of a folder by a relative name with forward slashes; one that leads out of it is a ValueError."""
    pure = PurePosixPath(name)
    if not name or "\0" in name or "\\" in name or pure.is_absolute() or ".." in pure.parts:
        raise ValueError(f"{root}: names must be relative and stay inside, got {name!r}")
    path = root / pure
    try:
        real = path.resolve()
    except (OSError, RuntimeError):
        raise ValueError(f"{root}: {name} is a symbolic link that leads nowhere") from None
    if not real.is_relative_to(root.resolve()):
        raise ValueError(f"{root}: {name} leads out of the folder, to {real}")
    return path
