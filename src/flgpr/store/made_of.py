"""The record of what a run store was made of, by which the same call knows it again.

It lies in the store and is no part of the run: readers of runs ignore it.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from flgpr.door import MOST_JSON, Folder
from flgpr.json_text import canonical_json, parse_json, sha256
from flgpr.store.files import write_whole
from flgpr.store.journal import difference
from flgpr.store.run_store import CommittedFiles, read_manifest
from flgpr.types import FloatArray

MADE_OF = "made-of.json"
"""File that records what a store's scans depend on, by which the same call knows it again."""


def describe_inputs(
    frequency: FloatArray,
    polarization: list[str],
    tx_position: FloatArray,
    rx_position: FloatArray,
    attrs: dict[str, Any],
    inputs: dict[str, Any] | None,
) -> dict[str, Any]:
    """Return a description of all that the scans of a store depend on.

    Parameters
    ----------
    frequency : (frequency,) ndarray
        Tones, Hz.
    polarization : list of str
        Labels of the polarizations.
    tx_position, rx_position : (pair, 3) ndarray
        Positions of the antennas, m.
    attrs : dict
        Attributes of the run.
    inputs : dict or None
        What else the scans depend on, such as digests of files.

    Returns
    -------
    dict
        The description, as JSON holds it.
    """
    return {
        "frequency": sha256(frequency.tobytes()),
        "polarization": polarization,
        "tx_position": sha256(tx_position.tobytes()),
        "rx_position": sha256(rx_position.tobytes()),
        "attrs": attrs,
        "inputs": inputs or {},
    }


def write_record(
    root: Path, commit: str, about: Mapping[str, Any], limits: Mapping[str, Any]
) -> None:
    """Write the record into a store.

    Parameters
    ----------
    root : Path
        The store.
    commit : str
        Digest of its manifest.
    about : mapping
        What :func:`describe_inputs` returned.
    limits : mapping
        What ends in the scans because of how they were made; left out where it is empty.
    """
    record: dict[str, Any] = {"commit": commit, "about": about}
    if limits:
        record["limits"] = limits
    write_whole(root / MADE_OF, canonical_json(record) + b"\n")


def _read_record(root: Path, manifest: Mapping[str, Any]) -> Any:
    """Return the record of what a store was made of; None if it is of another commit."""
    stored = parse_json(Folder(root).read(MADE_OF, MOST_JSON))
    return stored if stored["commit"] == manifest["sha256"] else None


def read_limits(root: str | Path) -> dict[str, Any]:
    """Return what ends in a store's scans because of how they were made.

    Parameters
    ----------
    root : str or path
        The store.

    Returns
    -------
    dict
        As given to :class:`flgpr.store.RunWriter`; empty where the store does not record it, or records it for
        other scans.
    """
    try:
        stored = _read_record(Path(root), read_manifest(root))
        limits = {} if stored is None else stored["limits"]
    except (OSError, ValueError, KeyError, TypeError, AttributeError):
        return {}
    return limits if isinstance(limits, dict) else {}


def difference_from_stored(root: Path, about: dict[str, Any]) -> str | None:
    """Return the first difference between what a store was made of and ``about``.

    Parameters
    ----------
    root : Path
        The store.
    about : dict
        What :func:`describe_inputs` returned.

    Returns
    -------
    str or None
        The difference, empty if there is none; None if the store is incomplete or does not record
        it.
    """
    try:
        manifest = read_manifest(root)
        stored = _read_record(root, manifest)
        CommittedFiles(root, manifest["files"]).check_sizes()
        if stored is None:
            return None
        return difference(stored["about"], parse_json(canonical_json(about)))
    except (OSError, ValueError, KeyError, TypeError, AttributeError):
        return None
