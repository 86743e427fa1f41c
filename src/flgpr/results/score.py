"""Scoring a result against truth, the only place of a result's making that sees it, and the file of a score."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

import flgpr
from flgpr.results.result import Result
from flgpr.results.view_files import plain_json
from flgpr.scoring import BlindScore, Rules, Score, SideBySide, refraction_shift, score

ROC_FORMAT, ROC_VERSION = "flgpr-score", 1
COMPARISON_FORMAT = "flgpr-comparison"


def score_detections(result: Result, truth: pd.DataFrame, far: float = Rules.far) -> list[Score]:
    """Score the main result and every variant by the halo and the area of the recipe, at an operating point."""
    rules = Rules(halo=result.recipe.score.halo, area=result.recipe.score.area, far=far)
    scored = [score(one.alarms, truth, result.lane, rules, name=one.name, title=one.title) for one in result.detections]
    shift = expected_shift(scored[0].matched.truth, result.manifest["run"])
    return [replace(one, outcomes=one.outcomes.assign(expected_shift=shift)) for one in scored]


def expected_shift(truth: pd.DataFrame, run: dict[str, Any]) -> NDArray[np.float64]:
    """Estimate how far (m) beyond each buried target its image lies when focused on the surface, a mean over the scans.

    Scoring does not correct for it; NaN where depth or soil is unknown. See :func:`flgpr.scoring.refraction_shift`.
    """
    if "soil" not in run:
        return np.full(len(truth), np.nan)
    x, y, depth = (truth[name].to_numpy(dtype=float) for name in ("x", "y", "depth"))
    soil = run["soil"]["permittivity"]
    shifts = [refraction_shift(depth, soil, pose[2], np.hypot(x - pose[0], y - pose[1])) for pose in run["pose"]]
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
    rows = {name: None if table is None else table.to_dict("records") for name, table in tables.items()}
    return json.dumps(plain_json({**head, "rules": rules, "notes": notes, **rows}), indent=1, allow_nan=False) + "\n"


def _roc_json(rules: Mapping[str, Any], notes: Mapping[str, Any], detections: Mapping[str, Any]) -> str:
    head = {"format": ROC_FORMAT, "version": ROC_VERSION, "flgpr": flgpr.__version__}
    content = plain_json({**head, "rules": rules, "notes": notes, "detections": detections})
    return json.dumps(content, indent=1, allow_nan=False) + "\n"
