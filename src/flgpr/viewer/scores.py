"""Scores as ``flgpr score`` writes them, of any detector's alarm list: curves and counts without pictures."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from flgpr.door import MOST_JSON, Folder, parse_json
from flgpr.store import canonical_json

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
    """Find the file of a score at a path: itself, or in a folder of ``flgpr score``; None if there is none."""
    if path.is_dir():
        return next((path / name for name in _FILES if Folder(path).has(name)), None)
    return path.resolve() if path.suffix == ".json" and path.is_file() else None


class IndexOnly:
    """What the page shows of a source that has no pictures: its index, and nothing else unless told."""

    index: dict[str, Any]

    def index_bytes(self) -> bytes:
        """Write the index as JSON."""
        return canonical_json(self.index)

    def score_bytes(self) -> bytes | None:
        """Tell that there is no score."""
        return None

    def tile(self, layer: int, level: int, tile: int) -> bytes | None:  # noqa: ARG002
        """Tell that there are no layers."""
        return None

    def evidence(self, detection: int, alarm: int) -> bytes | None:  # noqa: ARG002
        """Tell that nothing explains alarms."""
        return None


class ScoreFiles(IndexOnly):
    """The score of an alarm list, open or blind, or a comparison of several: what was told, in the viewer's form."""

    def __init__(self, path: Path) -> None:
        self.folder = path.parent.resolve()
        try:
            told = parse_json(Folder(path.parent).read(path.name, MOST_JSON))
            if told["format"] not in _FILES.values() or told["version"] != 1:
                raise ValueError(f"format must be {' or '.join(_FILES.values())} version 1")
            several = (
                _compared(told) if told["format"] == "flgpr-comparison" else told["detections"]
            )
            detections = {str(name): _scored(one, told["rules"]) for name, one in several.items()}
            rules = {name: told["rules"][name] for name in _RULES if name in told["rules"]}
            self._score = canonical_json(_score(detections, {**rules, **_truth(told["notes"])}))
        except (ValueError, KeyError, TypeError, AttributeError, IndexError, OSError) as error:
            raise ValueError(
                f"{path}: not a score that can be shown ({type(error).__name__}: {error})"
            ) from None
        self.title = f"{self.folder.name} (score)"
        nowhere: dict[str, list[Any]] = {name: [] for name in ("x", "y", "z", "heading", "masked")}
        alarms: dict[str, list[Any]] = {"x": [], "y": [], "confidence": []}
        self.index = {
            "title": self.folder.name,
            "scored": True,
            "lane": {"x_min": 0.0, "x_max": 1.0, "y_min": 0.0, "y_max": 1.0},
            "grid": None,
            "tile_rows": 0,
            "channel": ["", ""],
            "layers": [],
            "scans": nowhere,
            "georeference": None,
            "detections": [
                {
                    "name": name,
                    "title": "",
                    "alarms": alarms,
                    "features": {},
                    "contributions": None,
                    "training": None,
                }
                for name in detections
            ],
        }

    def score_bytes(self) -> bytes:
        """Give the score as the page reads it."""
        return self._score


def _score(detections: Mapping[str, Any], rules: Mapping[str, Any]) -> dict[str, Any]:
    return {
        "halo": rules.get("halo_radius"),
        "truth": {"target_id": [], "x": [], "y": [], "kind": [], "depth": []},
        "objects": None,
        "kinds": [],
        "depths": [],
        "target_depth": [],
        "detections": detections,
        "rules": rules,
    }


def _truth(notes: Mapping[str, Any]) -> dict[str, Any]:
    """Take the digest of the truth, open or sealed, out of the notes of a score or of the first compared."""
    flat = [notes, *(one for one in notes.values() if isinstance(one, Mapping))]
    found = [one[name] for one in flat for name in ("truth_sha256", "sealed_sha256") if name in one]
    return {"truth": found[0]} if found else {}


def _compared(told: Mapping[str, Any]) -> dict[str, Any]:
    """Take the points of a comparison apart by detector."""
    names = dict.fromkeys(row["detector"] for row in told["points"])
    return {
        name: {"points": [row for row in told["points"] if row["detector"] == name]}
        for name in names
    }


def _scored(told: Mapping[str, Any], rules: Mapping[str, Any]) -> dict[str, Any]:
    """Lay out one scored list: its curve, its points by group of targets, and what became of each target."""
    rows = told["points"]
    if "far_allowed" in rows[0]:  # blind, or compared: points are all there is
        points = [{"group": row.get("group", "all")} | _only(row, _POINT) for row in rows]
        rows = [row for row in rows if row.get("group", "all") == "all"]
        head = {"n_targets": rows[0]["n_targets"], "area": told.get("area"), "point": None}
        head["allowed"] = [row["far_allowed"] for row in rows]
    else:
        head = {"n_targets": told["n_targets"], "area": told["area"]}
        kinds = {name: one["points"] for name, one in told["kinds"].items()}
        at = told["operating_point"]
        allowed = sorted(
            {at["far_allowed"], *(row["far_allowed"] for one in kinds.values() for row in one)}
        )
        whole = [rows[_last(rows, far)] | head | {"far_allowed": far} for far in allowed]
        points = [{"group": "all"} | _only(row, _POINT) for row in whole]
        points += [
            {"group": name} | _only({"n_targets": told["kinds"][name]["n_targets"]} | row, _POINT)
            for name, one in kinds.items()
            for row in one
        ]
        few = {"row": _last(rows, at["far_allowed"]), "few_halos": None}
        head["point"] = few | {"far_asked": at["far_asked"], "far_allowed": at["far_allowed"]}
    shared = {
        "level": rules.get("level", 0.95),
        "threshold": [row.get("threshold") for row in rows],
    }
    curve = {"kind": None, "depth": None, "pd_mean": None, **head, **shared}
    curve |= {
        name: [row.get(name) if name == "chance" else row[name] for row in rows] for name in _CURVE
    }
    targets = [
        _only({"far": one.get("found_from")} | one, _TARGET) for one in told.get("targets", [])
    ]
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


def _only(row: Mapping[str, Any], names: Sequence[str]) -> dict[str, Any]:
    return {name: row.get(name) for name in names}


def _last(rows: Sequence[Mapping[str, Any]], far: float) -> int:
    """Find the lowest threshold whose false alarm rate is allowed; the first row has none."""
    return max(number for number, row in enumerate(rows) if row["far"] <= far)
