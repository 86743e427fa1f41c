"""What the viewer shows, written with the result: the viewer itself only reads.

``view/index.json`` tells what there is; ``view/layers/*.f16`` hold one run-view channel at one level each; and
``view/evidence/*.f16`` what explains the alarms. All numbers in ``.f16`` files are little-endian half floats in dB.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr
from numpy.typing import NDArray

from flgpr.chain.evidence import Evidence, decibels
from flgpr.chain.lane_chain import MAIN, Detection, variations_of
from flgpr.chain.recipe import Recipe
from flgpr.model import Lane
from flgpr.results.description import left_out_scans
from flgpr.store import write_whole

VIEW_FORMAT = "flgpr-view"
VIEW_VERSION = 1
TILE_ROWS = 512
_PLACE = ("alarm_id", "x", "y", "confidence")


def write_view(
    folder: Path,
    detections: Sequence[Detection],
    lane: Lane,
    run: Mapping[str, Any],
    recipe: Recipe,
    border: float | None = None,
) -> None:
    """Write the viewer's files to ``folder/view``, main one first; ``border`` is where a learnt detector decides."""
    home = folder / "view"
    (home / "layers").mkdir(parents=True)
    (home / "evidence").mkdir()
    stages = _stages(recipe)
    views = [(one.name, stages.get(one.name, stages[MAIN]), one.view) for one in detections]
    before = detections[0].before
    channel = detections[0].channel
    if before is not None:
        views.insert(0, ("before", stages["before"], before))
    grid = _grid(views[0][2])
    for name, _, view in views:
        if _grid(view) != grid:
            raise ValueError(
                f"run-views must share one grid, got another in {name!r}: {_grid(view)} and {grid}"
            )
    index = {
        "format": VIEW_FORMAT,
        "version": VIEW_VERSION,
        "title": run.get("title", ""),
        "lane": asdict(lane),
        "grid": grid,
        "tile_rows": TILE_ROWS,
        "unit": "dB",
        "channel": list(channel)
        if channel
        else [str(views[-1][2][n].values[0]) for n in ("polarization", "subband")],
        "layers": [
            layer for name, stage, view in views for layer in _write_layers(home, name, stage, view)
        ],
        "scans": _scans(run),
        "sight": [recipe.image.y[0], recipe.run_view.y_max],
        "georeference": run.get("georeference"),
        "detections": [_write_detection(home, one) | {"border": border} for one in detections],
    }
    if recipe.image.frames == "all":
        index["aperture"] = True  # what explains alarms is of all scans
    write_whole(
        home / "index.json",
        json.dumps(plain_json(index), separators=(",", ":"), allow_nan=False) + "\n",
    )


def _stages(recipe: Recipe) -> dict[str, str]:
    """Say what the run-views show, by detection and ``before``: suppression is named only where clutter is removed."""
    told = {}
    for one in variations_of(recipe):
        removes = bool(recipe.clutter) or one.signature != "none" or one.suppressed
        told[one.name] = "after clutter suppression" if removes else "without clutter suppression"
        if one.name == MAIN:
            told["before"] = "before clutter suppression" if removes else "as imaged"
        if recipe.map is not None:
            told[one.name] = f"map by {recipe.map.stage}"
    return told


def pyramid(level: NDArray[np.float16]) -> Iterable[NDArray[np.float16]]:
    """Yield a run-view at every level down to one tile, each with half the rows before: two become their maximum."""
    yield level
    while len(level) > TILE_ROWS:
        if len(level) % 2:
            level = np.concatenate([level, level[-1:]])
        level = np.fmax(level[0::2], level[1::2])
        yield level


def _write_layers(
    home: Path, detection: str, stage: str, view: xr.DataArray
) -> Iterable[dict[str, Any]]:
    for p, polarization in enumerate(view["polarization"].values):
        for s, subband in enumerate(view["subband"].values):
            values = decibels(view.sel(polarization=polarization, subband=subband).values)
            seen = values[np.isfinite(values)].astype(np.float32)
            marks = np.percentile(seen, [1, 50, 99, 99.9, 100]) if seen.size else np.zeros(5)
            files = []
            for number, level in enumerate(pyramid(values)):
                name = f"layers/{detection}.{p}.{s}.{number}.f16"
                write_whole(home / name, level.astype("<f2").tobytes())
                files.append({"file": name, "rows": len(level)})
            yield {
                "detection": detection,
                "stage": stage,
                "polarization": str(polarization),
                "subband": str(subband),
                "percentiles": dict(
                    zip(("1", "50", "99", "99.9", "100"), np.round(marks, 2).tolist(), strict=True)
                ),
                "levels": files,
            }


def _write_detection(home: Path, detection: Detection) -> dict[str, Any]:
    alarms = detection.alarms.reset_index(drop=True)
    features = detection.features
    if features is None:
        features = alarms[[name for name in alarms.columns if name not in _PLACE]].select_dtypes(
            "number"
        )
    contributions = detection.contributions
    entry: dict[str, Any] = {
        "name": detection.name,
        "title": detection.title,
        "notes": detection.notes,
        "alarms": {str(name): alarms[name].tolist() for name in alarms.columns if name in _PLACE},
        "features": _columns(features),
        "contributions": None if contributions is None else _columns(contributions),
        "training": None if detection.training is None else _distribution(detection.training),
        "main": detection.name == MAIN,
    }
    if detection.evidence is not None:
        entry["evidence"] = _write_evidence(home, detection.name, detection.evidence)
    return entry


def _columns(table: pd.DataFrame) -> dict[str, list[float]]:
    return {str(name): [_rounded(value) for value in table[name]] for name in table.columns}


def _rounded(value: float) -> float:
    return float(f"{value:.6g}") if np.isfinite(value) else float("nan")


def _distribution(training: pd.DataFrame) -> list[dict[str, Any]]:
    """Quantiles of every feature, per value of ``label`` where there is such a column."""
    groups = training.groupby("label") if "label" in training.columns else [("training", training)]
    shares = [0.0, 0.05, 0.25, 0.5, 0.75, 0.95, 1.0]
    return [
        {
            "label": str(label),
            "count": len(group),
            "shares": shares,
            "quantiles": {
                str(name): [_rounded(value) for value in group[name].dropna().quantile(shares)]
                for name in group.select_dtypes("number").columns
            },
        }
        for label, group in groups
    ]


def _write_evidence(home: Path, name: str, evidence: Evidence) -> dict[str, Any]:
    file = f"evidence/{name}.f16"
    write_whole(home / file, b"".join(block.astype("<f2").tobytes() for block in evidence.blocks))
    ends = np.cumsum([0, *(block.size for block in evidence.blocks)])
    return {
        "file": file,
        "polarization": evidence.polarization,
        "subband": evidence.subband,
        "patch": asdict(evidence.patch),
        "cut": evidence.cut.tolist(),
        "trace": evidence.trace.tolist(),
        "start": ends.tolist(),
        "scans": evidence.scans,
        "polarimetric": _columns(evidence.polarimetric),
        "adds": evidence.adds,
        "alone": evidence.alone,
        "causes": [
            [[_rounded(value) for value in row] for row in np.round(one, 3)]
            for one in evidence.causes
        ],
    }


def _grid(view: xr.DataArray) -> dict[str, float]:
    y = view["y"].values
    x = view["x"].values
    steps = {"dx": x[1] - x[0] if len(x) > 1 else 1.0, "dy": y[1] - y[0] if len(y) > 1 else 1.0}
    found = {"x": x[0], "y": y[0], "nx": len(x), "ny": len(y)} | steps
    return {
        name: round(float(value), 9) if name[0] != "n" else int(value)
        for name, value in found.items()
    }


def _scans(run: Mapping[str, Any]) -> dict[str, list[Any]]:
    pose = np.asarray(run.get("pose", np.zeros((0, 6))), dtype=np.float64).reshape(-1, 6)
    columns = {
        name: np.round(pose[:, i], 4).tolist() for i, name in enumerate(("x", "y", "z", "heading"))
    }
    return columns | {"masked": left_out_scans(run)}


def plain_json(value: Any) -> Any:
    """Make a value fit for JSON: NaN and infinity become null, arrays lists, NumPy numbers plain ones."""
    if isinstance(value, Mapping):
        return {str(key): plain_json(entry) for key, entry in value.items()}
    if isinstance(value, np.ndarray):
        return plain_json(value.tolist())
    if isinstance(value, list | tuple):
        return [plain_json(entry) for entry in value]
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, float):
        return value if np.isfinite(value) else None
    return value if isinstance(value, str | int | bool | None) else str(value)
