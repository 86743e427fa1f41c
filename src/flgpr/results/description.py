"""The description of a run in a manifest, and the checks of a manifest from anywhere."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from flgpr.model import POSE_COMPONENTS, complete_scans
from flgpr.model.motion import judge_run
from flgpr.model.plausible import MotionLimits
from flgpr.store import read_manifest
from flgpr.types import Entries, FloatArray, PathLike, floats

_COPIED_ATTRIBUTES = ("soil", "georeference")
_ROWS = {"pose": len(POSE_COMPONENTS), "tx_m": 3, "rx_m": 3, "frequency_hz": 2}
"""How many numbers a row of an entry has."""


def _is_count(value: Any) -> bool:
    return type(value) is int and value >= 0


def _is_text(value: Any) -> bool:
    return isinstance(value, str)


def _is_finding(value: Any) -> bool:
    return isinstance(value, dict) and _is_text(value.get("sentence"))


def _are_counts(value: Any) -> bool:
    """Return whether a value is a list of counts."""
    return isinstance(value, list) and all(map(_is_count, value))


_RULES: dict[str, Callable[[Any], bool]] = {
    "text": _is_text,
    "a count": _is_count,
    "a table": lambda value: isinstance(value, dict),
    "a list of scan numbers": _are_counts,
    "a list of numbers from 0": _are_counts,
    "a number or null": lambda value: (
        value is None or (type(value) in (int, float) and math.isfinite(value))
    ),
    "a list of texts": lambda value: isinstance(value, list) and all(map(_is_text, value)),
    "a list of findings": lambda value: isinstance(value, list) and all(map(_is_finding, value)),
}
"""What an entry of a manifest may have to be, in words and as a check."""
_EMPTY: Entries = {"text": "", "a count": 0, "a table": {}, "a number or null": None}
"""What a missing entry stands for; a list where none is named."""
_ORIGIN = {
    "text": ("flgpr", "python", "recipe_sha256", "identity"),
    "a table": ("libraries",),
}
_LEFT_OUT = {
    "a table": ("left_out",),
    "a list of numbers from 0": ("left_out.pairs", "left_out.tones"),
}
_RUN = {
    "a table": ("motion", "unlike", "far", "stands_out", "others", *_LEFT_OUT["a table"]),
    "text": ("title", "source", "path", "store_sha256", "stands_out.source"),
    "a count": ("scans", "missing_sweeps", "pairs", "tones"),
    "a list of scan numbers": ("masked_scans", "motion.scans"),
    "a list of texts": (
        "polarizations",
        "motion.notes",
        "unlike.notes",
        "far.notes",
        "stands_out.notes",
    ),
    "a number or null": ("stands_out.border",),
    "a list of findings": ("health",),
    "a list of numbers from 0": _LEFT_OUT["a list of numbers from 0"],
}
"""Entries by the rule that they must keep; tables come before what they hold."""


def describe_run(
    run: xr.Dataset, path: PathLike | None = None, limits: MotionLimits | None = None
) -> Entries:
    """Return the description of a run for a manifest.

    Parameters
    ----------
    run : xarray.Dataset
        The run.
    path : path, optional
        Its store. With it the description holds the path and the digest of the store.
    limits : MotionLimits, optional
        What a vehicle can do; None takes the default limits.

    Returns
    -------
    dict
        Counts, band, antennas, poses and missing sweeps. ``motion`` lists in words and numbers the
        positions that are not plausible by ``limits``, where there are any.
    """
    frequency = run["frequency"].values
    incomplete = np.flatnonzero(~complete_scans(run))
    default_title = Path(path).stem if path else "run"
    description: Entries = {
        "title": str(run.attrs.get("title", default_title)),
        "source": str(run.attrs.get("source", "")),
        "scans": int(run.sizes["scan"]),
        "masked_scans": [int(scan) for scan in incomplete],
        "missing_sweeps": int(np.count_nonzero(~run["valid"].values)),
        "pairs": int(run.sizes["pair"]),
        "polarizations": [str(label) for label in run["polarization"].values],
        "tones": int(frequency.size),
        "frequency_hz": [float(frequency[0]), float(frequency[-1])],
        "tx_m": np.unique(run["tx_position"].values, axis=0).tolist(),
        "rx_m": np.unique(run["rx_position"].values, axis=0).tolist(),
        "pose": run["pose"].values.tolist(),
    }
    for name in _COPIED_ATTRIBUTES:
        if name in run.attrs:
            description[name] = run.attrs[name]
    motion = judge_run(run, limits)
    if motion.notes():
        description["motion"] = motion.as_json() | {"notes": motion.notes()}
    if path is not None:
        description["path"] = str(Path(path).resolve())
        description["store_sha256"] = read_manifest(path)["sha256"]
    return description


def check_origin(manifest: Mapping[str, Any]) -> None:
    """Check the types of what a manifest says of program and recipe; another type is a ValueError."""
    _check_entries(manifest, _ORIGIN)


def check_description(description: Any) -> None:
    """Check the types of what a manifest that may come from anywhere says of a run.

    Entries may be missing: results of older versions have fewer.

    Raises
    ------
    ValueError
        Naming the entry whose value is of another type than ``describe_run`` writes.
    """
    if not isinstance(description, dict):
        raise _other_type("run", "a table", description)
    _check_entries(description, _RUN, "run.")
    for name, length in _ROWS.items():
        rows = description.get(name, [])
        try:
            floats(rows).reshape(-1, length)
        except (TypeError, ValueError):
            raise _other_type(f"run.{name}", f"rows of {length} numbers", rows) from None
    for name, other in description.get("others", {}).items():
        described_store(other)
        _check_entries(other, _LEFT_OUT, f"run.others.{name}.")


def _check_entries(
    entries: Mapping[str, Any], rules: Mapping[str, tuple[str, ...]], prefix: str = ""
) -> None:
    """Refuse an entry that breaks its rule; one within a table is named TABLE.ENTRY."""
    for rule, names in rules.items():
        for name in names:
            table, _, entry = name.rpartition(".")
            holder = entries.get(table, {}) if table else entries
            value = holder.get(entry, _EMPTY.get(rule, []))
            if not _RULES[rule](value):
                raise _other_type(prefix + name, rule, value)


def _other_type(entry: str, rule: str, value: Any) -> ValueError:
    """Return the error of an entry that breaks its rule."""
    return ValueError(f"{entry} must be {rule}, got {str(value)[:60]!r}")


def described_store(description: Any) -> tuple[str, str]:
    """Return the path and the digest of the store of a run, as its description in a manifest tells.

    Raises
    ------
    ValueError
        If it does not tell them as text: the run was in memory, or the manifest is forged.
    """
    stated = description if isinstance(description, dict) else {}
    path, digest = stated.get("path"), stated.get("store_sha256")
    if not isinstance(path, str) or not isinstance(digest, str):
        raise ValueError(
            "the manifest of the result must name the store of its run by path and digest, got "
            f"{str(path)[:60]!r} and {str(digest)[:60]!r}"
        )
    return path, digest


def left_out_scans(description: Mapping[str, Any]) -> list[int]:
    """Return the scans of a described run that no image is made of, ascending.

    They have missing sweeps or a pose that is not plausible. A description of an older version,
    from before poses were judged, lists the first only.
    """
    incomplete = description.get("masked_scans", [])
    implausible = description.get("motion", {}).get("scans", [])
    return sorted({*incomplete, *implausible})


def plausible_poses(description: Mapping[str, Any]) -> FloatArray:
    """Return the poses (scan, 6) of a described run that are plausible."""
    poses = floats(description.get("pose", np.zeros((0, 6)))).reshape(-1, 6)
    implausible = description.get("motion", {}).get("scans", [])
    return np.delete(poses, implausible, axis=0)
