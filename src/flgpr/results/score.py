"""Scoring a result against truth, the only place of a result's making that sees it, and the files of a score."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

import flgpr
from flgpr.door import MOST_JSON, Folder, parse_json
from flgpr.results.description import plausible_poses
from flgpr.results.result import Result, read_result_manifest
from flgpr.results.view_files import plain_json
from flgpr.scoring import (
    Rules,
    Score,
    SideBySide,
    operating_row,
    pd_mean,
    refraction_shift,
    roc_of,
    score,
    score_frames,
)
from flgpr.store import canonical_json, sha256
from flgpr.store.files import listed_files
from flgpr.trials import BlindScore

ROC_FORMAT = "flgpr-score"
ROC_VERSION = 1
COMPARISON_FORMAT = "flgpr-comparison"
_SHARED = (
    "far",
    "n_false",
    "far_low",
    "far_high",
)  # alike for all subsets of the targets (rules 5 and 6)
_OWN = ("pd", "n_detected", "pd_low", "pd_high", "chance")
_MOST_DEPTHS = 6
VIEW_SCORE = "view/score.json"


def score_detections(result: Result, truth: pd.DataFrame, far: float = Rules.far) -> list[Score]:
    """Score the main result and every variant by the halo and the area of the recipe, at an operating point.

    Places of the lane are scored once here: a recipe whose area is "frames" is scored by the union of halos, and frame
    by frame by :func:`score_by_frames`.
    """
    own = result.recipe.score
    rules = Rules(halo=own.halo, area="union" if own.area == "frames" else own.area, far=far)
    scored = [
        score(one.alarms, truth, result.lane, rules, name=one.name, title=one.title)
        for one in result.detections
    ]
    shift = expected_shift(scored[0].matched.truth, result.manifest["run"])
    return [replace(one, outcomes=one.outcomes.assign(expected_shift=shift)) for one in scored]


def score_by_frames(result: Result, truth: pd.DataFrame, far: float = Rules.far) -> Score:
    """Score a result whose recipe has ``score.area = "frames"``: every frame counts its area (Fuse et al. 2018)."""
    main = result.detections[0]
    if main.frames is None:
        raise ValueError(
            'score.area must be "frames" when the run is detected for its alarms to be kept frame by frame, got a '
            "result without them; run flgpr detect again"
        )
    rules = Rules(halo=result.recipe.score.halo, far=far)
    title = f"{main.title}, every frame counts its area"
    return score_frames(
        *main.frames, truth, result.recipe.frame_area(), rules, name=main.name, title=title
    )


def expected_shift(truth: pd.DataFrame, run: dict[str, Any]) -> NDArray[np.float64]:
    """Estimate how far (m) beyond each buried target its image lies when focused on the surface, a mean over the scans.

    Scoring does not correct for it; NaN where depth or soil is unknown. See :func:`flgpr.scoring.refraction_shift`.
    """
    if "soil" not in run:
        return np.full(len(truth), np.nan)
    x, y, depth = (truth[name].to_numpy(dtype=float) for name in ("x", "y", "depth"))
    soil = run["soil"]["permittivity"]
    poses = plausible_poses(run)
    shifts = [
        refraction_shift(depth, soil, pose[2], np.hypot(x - pose[0], y - pose[1])) for pose in poses
    ]
    return np.asarray(np.mean(shifts, axis=0), dtype=np.float64)


def roc_json(scored: Sequence[Score], notes: Mapping[str, Any]) -> str:
    """Write ``roc.json`` of scores by the same rules; an infinite threshold and all that is unknown are null."""
    return _roc_json(scored[0].told_rules(), notes, {one.name: one.told() for one in scored})


def blind_roc_json(told: BlindScore, notes: Mapping[str, Any]) -> str:
    """Write ``roc.json`` of a blind score: points per group at fixed FARs, no threshold and no place."""
    rules = {name: told.counts[name] for name in ("area_rule", "halo_radius")}
    counts = {name: value for name, value in told.counts.items() if name not in rules}
    main = {"title": "", **counts, "points": told.points.to_dict("records")}
    if told.targets is not None:
        main["targets"] = told.targets.to_dict("records")
    return _roc_json(rules, {"looks": told.looks, "lists": told.lists, **notes}, {"main": main})


def comparison_json(told: SideBySide, rules: Mapping[str, Any], notes: Mapping[str, Any]) -> str:
    """Write ``comparison.json`` of detectors side by side."""
    head = {"format": COMPARISON_FORMAT, "version": ROC_VERSION, "flgpr": flgpr.__version__}
    tables = {"points": told.points, "pairs": told.pairs, "means": told.means}
    rows = {
        name: None if table is None else table.to_dict("records") for name, table in tables.items()
    }
    return (
        json.dumps(
            plain_json({**head, "rules": rules, "notes": notes, **rows}), indent=1, allow_nan=False
        )
        + "\n"
    )


def _roc_json(
    rules: Mapping[str, Any], notes: Mapping[str, Any], detections: Mapping[str, Any]
) -> str:
    head = {"format": ROC_FORMAT, "version": ROC_VERSION, "flgpr": flgpr.__version__}
    content = plain_json({**head, "rules": rules, "notes": notes, "detections": detections})
    return json.dumps(content, indent=1, allow_nan=False) + "\n"


SCORE_FORMAT = "flgpr-view-score"
SCORE_VERSION = 1


def view_score(
    result: Result, scored: Sequence[Score], objects: pd.DataFrame | None = None
) -> bytes:
    """Make ``view/score.json``, which names the result it belongs to and its own digest."""
    truth = scored[0].matched.truth
    classes = depth_classes(truth)
    content = plain_json(
        {
            "result_sha256": result.manifest["identity"],
            "halo": scored[0].rules.halo,
            "truth": _columns(truth),
            "objects": None if objects is None else _columns(objects),
            "kinds": sorted({str(kind) for kind in truth["kind"]}),
            "depths": [label for label, _ in classes],
            "target_depth": depth_labels(truth, classes),
            "detections": {one.name: _scored(one, classes) for one in scored},
        }
    )
    body = canonical_json(content)
    head = {"format": SCORE_FORMAT, "version": SCORE_VERSION, "sha256": sha256(body)}
    return canonical_json(head)[:-1] + b',"content":' + body + b"}\n"


def read_scored_truth(
    result: Result, folder: Path | None = None
) -> tuple[pd.DataFrame, pd.DataFrame | None] | None:
    """Read truth and objects that a result, or a score's ``folder``, was scored with; None where it was not scored.

    A file that is altered or another result's is a ValueError.
    """
    files = (
        listed_files(result.folder, read_result_manifest(result.folder))
        if folder is None
        else Folder(folder)
    )
    path = files.root / VIEW_SCORE
    data = files.read_if_listed(VIEW_SCORE, MOST_JSON)
    if data is None:
        return None
    try:
        stored = parse_json(data)
        content = stored["content"]
        if sha256(canonical_json(content)) != stored["sha256"]:
            raise ValueError("it differs from what was written")
        if content["result_sha256"] != result.manifest["identity"]:
            raise ValueError("it belongs to another result")
        objects = content["objects"]
        return pd.DataFrame(content["truth"]), None if objects is None else pd.DataFrame(objects)
    except (ValueError, KeyError, TypeError) as error:
        raise ValueError(f"{path}: {error}; run flgpr score again") from None


def depth_classes(truth: pd.DataFrame) -> list[tuple[str, tuple[float, float]]]:
    """Divide targets by depth (least and largest, m): each depth for itself while they are few, else four quarters."""
    depths = np.unique(truth["depth"].dropna().to_numpy(dtype=np.float64).round(4))
    if len(depths) <= _MOST_DEPTHS:
        return [(f"{_centimetres(depth)} cm", (depth - 5e-5, depth + 5e-5)) for depth in depths]
    edges = np.quantile(depths, [0.25, 0.5, 0.75, 1.0], method="lower")
    lows = [float(depths[0]), *(float(depths[depths > edge][0]) for edge in edges[:-1])]
    return [
        (f"{_centimetres(low)} to {_centimetres(high)} cm", (low - 5e-5, float(high) + 5e-5))
        for low, high in zip(lows, edges, strict=True)
    ]


def depth_labels(
    truth: pd.DataFrame, classes: list[tuple[str, tuple[float, float]]]
) -> list[str | None]:
    """Name each target's depth class; None where the depth is unknown."""
    return [
        next((label for label, (low, high) in classes if low <= depth <= high), None)
        for depth in truth["depth"].to_numpy(dtype=np.float64)
    ]


def _centimetres(depth: float) -> str:
    return f"{100 * depth:.3g}"


def _scored(one: Score, classes: list[tuple[str, tuple[float, float]]]) -> Mapping[str, Any]:
    truth = one.matched.truth
    kinds: list[str | None] = [None, *sorted({str(kind) for kind in truth["kind"]})]
    depths: list[str | None] = [None, *(label for label, _ in classes)]
    of_target = np.array([label or "" for label in depth_labels(truth, classes)], dtype=object)
    curves = []
    for kind, depth in product(kinds, depths):
        chosen = np.ones(len(truth), dtype=bool)
        if kind is not None:
            chosen &= (truth["kind"].astype(str) == kind).to_numpy()
        if depth is not None:
            chosen &= of_target == depth
        if chosen.any() or not len(truth):
            curves.append({"kind": kind, "depth": depth, **_curve(one, chosen)})
    return {
        "label": one.labels["label"].tolist(),
        "target": one.labels["target"].tolist(),
        "distance": one.labels["distance"].tolist(),
        "outcomes": _columns(one.outcomes),
        "shared": _shared(one),
        "curves": curves,
    }


def _shared(one: Score) -> dict[str, Any]:
    attrs = {"area": float(one.curve.iloc[-1]["area"]), "level": one.curve.attrs["level"]}
    point: dict[str, Any] = {
        "row": int(operating_row(one.curve, one.far)),
        "few_halos": one.few_halos,
    }
    point |= {"far_asked": one.rules.far, "far_allowed": one.far}
    return {
        **attrs,
        "point": point,
        "threshold": one.curve["threshold"].tolist(),
        **_rounded(one.curve, _SHARED),
    }


def _curve(one: Score, chosen: NDArray[np.bool_]) -> dict[str, Any]:
    subset = chosen if len(chosen) else None
    options: dict[str, Any] = {
        "area": one.rules.area,
        "frame_area": one.rules.frame_area,
        "level": one.rules.level,
    }
    curve = one.chance.beside(roc_of(one.matched, subset, **options), subset)
    mean = pd_mean(curve) if len(chosen) else None
    return {"n_targets": int(curve.iloc[-1]["n_targets"]), "pd_mean": mean, **_rounded(curve, _OWN)}


def _rounded(curve: pd.DataFrame, names: tuple[str, ...]) -> dict[str, list[float]]:
    return {name: [float(f"{value:.5g}") for value in curve[name]] for name in names}


def _columns(table: pd.DataFrame) -> dict[str, list[Any]]:
    return {str(name): table[name].tolist() for name in table.columns}
