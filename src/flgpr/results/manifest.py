"""The manifest of a result folder: its seal, and the checks of one that may come from anywhere."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from flgpr.model import POSE_COMPONENTS
from flgpr.results.description import described_store
from flgpr.results.errors import ResultError
from flgpr.store import canonical_json, json_with_digest, sha256
from flgpr.store.files import read_with_digest

FORMAT = "flgpr-result"
VERSION = 2
MANIFEST = "manifest.json"
_TEXTS = ("title", "source", "path", "store_sha256")
_COUNTS = ("scans", "missing_sweeps", "pairs", "tones")
_ROWS = {"pose": len(POSE_COMPONENTS), "tx_m": 3, "rx_m": 3, "frequency_hz": 2}
"""How many numbers a row of an entry has."""

# Digest and size of a file; None for no file, and a size of None where it is not known.
Version = tuple[str | None, int | None]
# Versions of the files that are added to a folder later; several of a file while it is written.
Added = Mapping[str, list[Version]]


def sealed_manifest(content: dict[str, Any], added: Added) -> bytes:
    """Return the sealed content with its identity and the versions of files that were added."""
    digests = {}
    sizes = {}
    for name, versions in added.items():
        digests[name] = [digest for digest, _ in versions]
        sizes[name] = [size for _, size in versions]
    identity = sha256(canonical_json(content))
    return json_with_digest(
        {**content, "identity": identity, "added": digests, "added_sizes": sizes}
    )


def added_versions(manifest: Mapping[str, Any]) -> dict[str, list[Version]]:
    """Return the versions of files that were added, as :func:`sealed_manifest` lists them.

    Manifests of an older version have no sizes.
    """
    sizes = manifest.get("added_sizes", {})
    added = {}
    for name, digests in manifest["added"].items():
        unknown: list[int | None] = [None] * len(digests)
        added[name] = list(zip(digests, sizes.get(name, unknown), strict=True))
    return added


def read_result_manifest(folder: str | Path) -> dict[str, Any]:
    """Read the manifest of a result folder and no other file.

    Its ``identity`` does not change when files are added.

    Raises
    ------
    ResultError
        If the manifest is missing, altered or of another format.
    """
    folder = Path(folder)
    try:
        manifest = read_with_digest(folder, MANIFEST)
        if (manifest["format"], manifest["version"]) != (FORMAT, VERSION):
            raise ValueError(f"format must be {FORMAT} version {VERSION}")
        _check_origin(manifest)
        _check_description(manifest["run"])
        return manifest
    except OSError as error:
        raise ResultError(
            f"{folder}: not a complete result folder: {error.filename} is missing"
        ) from None
    except (KeyError, TypeError, AttributeError, ValueError, RecursionError) as error:
        raise ResultError(f"{folder}: manifest.json is altered: {error}") from None


def _check_origin(manifest: Mapping[str, Any]) -> None:
    """Check the types of what a manifest says of program and recipe; another type is a ValueError."""
    for name in ("flgpr", "python", "recipe_sha256", "identity"):
        value = manifest.get(name, "")
        if not isinstance(value, str):
            raise ValueError(f"{name} must be text, got {str(value)[:60]!r}")
    libraries = manifest.get("libraries", {})
    if not isinstance(libraries, dict):
        raise ValueError(f"libraries must be a table, got {str(libraries)[:60]!r}")


def _check_description(description: Any) -> None:
    """Check the types of what a manifest that may come from anywhere says of a run.

    Entries may be missing: results of older versions have fewer.

    Raises
    ------
    ValueError
        Naming the entry whose value is of another type than ``describe_run`` writes.
    """
    if not isinstance(description, dict):
        raise _other_type("run", "a table", description)
    for name in _TEXTS:
        if not isinstance(description.get(name, ""), str):
            raise _other_type(f"run.{name}", "text", description[name])
    for name in _COUNTS:
        count = description.get(name, 0)
        if type(count) is not int or count < 0:
            raise _other_type(f"run.{name}", "a count", count)
    motion = description.get("motion", {})
    if not isinstance(motion, dict):
        raise _other_type("run.motion", "a table", motion)
    _check_scan_numbers("run.masked_scans", description.get("masked_scans", []))
    _check_scan_numbers("run.motion.scans", motion.get("scans", []))
    _check_texts("run.motion.notes", motion.get("notes", []))
    _check_texts("run.polarizations", description.get("polarizations", []))
    for name, length in _ROWS.items():
        rows = description.get(name, [])
        try:
            np.asarray(rows, dtype=np.float64).reshape(-1, length)
        except (TypeError, ValueError):
            raise _other_type(f"run.{name}", f"rows of {length} numbers", rows) from None
    others = description.get("others", {})
    if not isinstance(others, dict):
        raise _other_type("run.others", "a table", others)
    for other in others.values():
        described_store(other)


def _check_scan_numbers(entry: str, numbers: Any) -> None:
    """Check that an entry is a list of scan numbers."""
    is_list = isinstance(numbers, list)
    if not is_list or not all(type(number) is int and number >= 0 for number in numbers):
        raise _other_type(entry, "a list of scan numbers", numbers)


def _check_texts(entry: str, texts: Any) -> None:
    """Check that an entry is a list of texts."""
    if not isinstance(texts, list) or not all(isinstance(text, str) for text in texts):
        raise _other_type(entry, "a list of texts", texts)


def _other_type(entry: str, rule: str, value: Any) -> ValueError:
    """Return the error of an entry that breaks its rule."""
    return ValueError(f"{entry} must be {rule}, got {str(value)[:60]!r}")
