"""Scores of any detector's alarm list as ``flgpr score`` writes them.

Curves and counts, no images.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from flgpr.door import MOST_JSON, Folder
from flgpr.json_text import parse_json
from flgpr.store import canonical_json
from flgpr.types import Entries

_FILES = {"roc.json": "flgpr-score", "comparison.json": "flgpr-comparison"}
_CURVE = (
    "pd",
    "pd_low",
    "pd_high",
    "chance",
    "far",
    "far_low",
    "far_high",
    "n_detected",
    "n_false",
)
_POINT = ("far_allowed", "n_targets", *_CURVE)
_RULES = ("convention", "area_rule", "halo_radius", "shared", "refraction", "level")
_TARGET = ("target_id", "kind", "depth", "far", "confidence")


def score_file(path: Path) -> Path | None:
    """Return the file of a score.

    Parameters
    ----------
    path : Path
        The file itself, or a folder of ``flgpr score``.

    Returns
    -------
    Path or None
        The file; None if there is none.
    """
    if path.is_dir():
        for name in _FILES:
            if Folder(path).has(name):
                return path / name
        return None
    if path.suffix == ".json" and path.is_file():
        return path.resolve()
    return None


NO_IMAGES: Entries = {"grid": None, "tile_rows": 0, "channel": ["", ""], "layers": []}
"""Entries of an index of what has no run-views."""


class IndexOnly:
    """What the page shows of a source without images: its index, and nothing else by default."""

    index: Entries

    def index_bytes(self) -> bytes:
        """Return the index as JSON."""
        return canonical_json(self.index)

    def score_bytes(self) -> bytes | None:
        """Return None: there is no score."""
        return None

    def tile(self, layer: int, level: int, tile: int) -> bytes | None:  # noqa: ARG002
        """Return None: there are no layers."""
        return None

    def evidence(self, detection: int, alarm: int) -> bytes | None:  # noqa: ARG002
        """Return None: nothing explains alarms."""
        return None


class ScoreFiles(IndexOnly):
    """The score of an alarm list, open or blind, or a comparison of several, in the viewer's form.

    Raises
    ------
    ValueError
        If the file is no score that can be shown.
    """

    def __init__(self, path: Path) -> None:
        self.folder = path.parent.resolve()
        try:
            content = parse_json(Folder(path.parent).read(path.name, MOST_JSON))
            if content["format"] not in _FILES.values() or content["version"] != 1:
                raise ValueError(f"format must be {' or '.join(_FILES.values())} version 1")
            if content["format"] == "flgpr-comparison":
                entries = _entries_by_detector(content)
            else:
                entries = content["detections"]
            detections = {}
            for name, entry in entries.items():
                detections[str(name)] = _view_entry(entry, content["rules"])
            stated = content["rules"]
            rules = {name: stated[name] for name in _RULES if name in stated}
            rules |= _truth_digest(content["notes"])
            view_score: Entries = {
                "halo": rules.get("halo_radius"),
                "truth": {"target_id": [], "x": [], "y": [], "kind": [], "depth": []},
                "objects": None,
                "kinds": [],
                "depths": [],
                "target_depth": [],
                "detections": detections,
                "rules": rules,
            }
            self._score = canonical_json(view_score)
        except (ValueError, KeyError, TypeError, AttributeError, IndexError, OSError) as error:
            raise ValueError(
                f"{path}: not a score that can be shown ({type(error).__name__}: {error})"
            ) from None
        self.title = f"{self.folder.name} (score)"
        self.index = _empty_index(self.folder.name, list(detections))

    def score_bytes(self) -> bytes:
        """Return the score as the page reads it."""
        return self._score


def _empty_index(title: str, names: Sequence[str]) -> Entries:
    """Return the index of detections without a lane, run-views and alarms."""
    scans: dict[str, list[Any]] = {name: [] for name in ("x", "y", "z", "heading", "masked")}
    alarms: dict[str, list[Any]] = {"x": [], "y": [], "confidence": []}
    detections = []
    for name in names:
        detections.append(
            {
                "name": name,
                "title": "",
                "alarms": alarms,
                "features": {},
                "contributions": None,
                "training": None,
            }
        )
    return {
        "title": title,
        "scored": True,
        "lane": {"x_min": 0.0, "x_max": 1.0, "y_min": 0.0, "y_max": 1.0},
        **NO_IMAGES,
        "scans": scans,
        "georeference": None,
        "detections": detections,
    }


def _truth_digest(notes: Mapping[str, Any]) -> Entries:
    """Return the digest of the truth, open or sealed, from the notes of a score.

    Of a comparison it is that of the first score.
    """
    levels = [notes]
    for entry in notes.values():
        if isinstance(entry, Mapping):
            levels.append(entry)
    for level in levels:
        for name in ("truth_sha256", "sealed_sha256"):
            if name in level:
                return {"truth": level[name]}
    return {}


def _entries_by_detector(comparison: Mapping[str, Any]) -> Entries:
    """Return the points of a comparison as an entry per detector."""
    entries: Entries = {}
    for row in comparison["points"]:
        entry = entries.setdefault(row["detector"], {"points": []})
        entry["points"].append(row)
    return entries


def _view_entry(entry: Mapping[str, Any], rules: Mapping[str, Any]) -> Entries:
    """Return a scored list in the viewer's form.

    It has a curve, points by group of targets, and what became of each target.
    """
    rows = entry["points"]
    # Of a blind or compared list there are points only, of an open one all of its curve.
    if "far_allowed" in rows[0]:
        points = []
        for row in rows:
            group = row.get("group", "all")
            points.append({"group": group} | _only(row, _POINT))
        rows = [row for row in rows if row.get("group", "all") == "all"]
        head = {
            "n_targets": rows[0]["n_targets"],
            "area": entry.get("area"),
            "point": None,
            "allowed": [row["far_allowed"] for row in rows],
        }
    else:
        points = _open_points(entry)
        operating = entry["operating_point"]
        point = {
            "row": _last(rows, operating["far_allowed"]),
            "few_halos": None,
            "far_asked": operating["far_asked"],
            "far_allowed": operating["far_allowed"],
        }
        head = {"n_targets": entry["n_targets"], "area": entry["area"], "point": point}

    curve = {"kind": None, "depth": None, "pd_mean": None, **head}
    curve["level"] = rules.get("level", 0.95)
    curve["threshold"] = [row.get("threshold") for row in rows]
    for name in _CURVE:
        if name == "chance":
            # Scores of an older version have none.
            curve[name] = [row.get(name) for row in rows]
        else:
            curve[name] = [row[name] for row in rows]

    targets = []
    for target in entry.get("targets", []):
        # A blind score states the allowed FAR from which a target is found.
        with_far = {"far": target.get("found_from")} | target
        targets.append(_only(with_far, _TARGET))
    return {
        "label": [],
        "target": [],
        "distance": [],
        "outcomes": {},
        "shared": {},
        "curves": [curve],
        "points": points,
        "targets": targets,
    }


def _open_points(entry: Mapping[str, Any]) -> list[Entries]:
    """Return the points of an open score.

    Of all targets at every allowed FAR, then of each kind.
    """
    rows = entry["points"]
    allowed = {entry["operating_point"]["far_allowed"]}
    for kind in entry["kinds"].values():
        allowed.update(row["far_allowed"] for row in kind["points"])
    counts = {"n_targets": entry["n_targets"], "area": entry["area"]}
    points = []
    for far in sorted(allowed):
        row = rows[_last(rows, far)]
        full_row = row | counts | {"far_allowed": far}
        points.append({"group": "all"} | _only(full_row, _POINT))
    for name, kind in entry["kinds"].items():
        for row in kind["points"]:
            full_row = {"n_targets": kind["n_targets"]} | row
            points.append({"group": name} | _only(full_row, _POINT))
    return points


def _only(row: Mapping[str, Any], names: Sequence[str]) -> Entries:
    """Return some entries of a row, None for those that it lacks."""
    return {name: row.get(name) for name in names}


def _last(rows: Sequence[Mapping[str, Any]], far: float) -> int:
    """Return the row of the lowest threshold whose FAR is allowed; the first row has no alarms."""
    return max(number for number, row in enumerate(rows) if row["far"] <= far)
