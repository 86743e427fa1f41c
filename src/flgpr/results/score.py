"""Scoring a result against truth: the only place of a result's making that sees it."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from flgpr.chain.lane_chain import Detection
from flgpr.model import check_truth
from flgpr.results.result import Result
from flgpr.scoring import assign, label_alarms, match, pd_mean, refraction_shift, roc_of


@dataclass(frozen=True)
class Score:
    """One detection, scored.

    Attributes
    ----------
    detection : Detection
        What was scored.
    outcomes : DataFrame
        One row per target: its best alarm, that alarm's distance and offset ``dx``, ``dy`` (m), rank, and the false
        alarms at or above it; see :func:`flgpr.scoring.assign`.
    labels : DataFrame
        One row per alarm: detection, ignored, false or outside.
    curve : DataFrame
        ROC with its counts and intervals.
    """

    detection: Detection
    outcomes: pd.DataFrame
    labels: pd.DataFrame
    curve: pd.DataFrame


def score(result: Result, truth: pd.DataFrame) -> list[Score]:
    """Score the main result and every variant by the halo rules of Wang et al. 2007.

    Parameters
    ----------
    result : Result
        A result folder, read.
    truth : DataFrame
        Truth table.

    Returns
    -------
    list of Score
        In the order of ``result.detections``.

    Raises
    ------
    ValueError
        If the truth breaks a rule or lies elsewhere than the lane.
    """
    table = check_truth(truth)
    scored = []
    for detection in result.detections:
        matched = match(detection.alarms, table, result.lane, result.recipe.score.halo)
        curve = roc_of(matched, area=result.recipe.score.area)
        outcomes = assign(matched, area=result.recipe.score.area)
        found = outcomes["alarm"].to_numpy(dtype=int)
        for axis in ("x", "y"):
            place = np.append(detection.alarms[axis].to_numpy(dtype=float), np.nan)[found]
            outcomes["d" + axis] = place - outcomes[axis]
        outcomes["expected_shift"] = expected_shift(outcomes, result.manifest["run"])
        scored.append(Score(detection, outcomes, label_alarms(matched), curve))
    return scored


def expected_shift(truth: pd.DataFrame, run: dict[str, Any]) -> NDArray[np.float64]:
    """Estimate how far beyond a buried target its image lies when focused on the surface, averaged over the scans.

    Scoring does not correct for it; it explains what is seen. See :func:`flgpr.scoring.refraction_shift`.

    Parameters
    ----------
    truth : DataFrame
        Truth table.
    run : dict
        Description of the run; without ``soil`` nothing is expected.

    Returns
    -------
    (target,) ndarray
        Shift away from the array, m; NaN where depth or soil is unknown.
    """
    if "soil" not in run:
        return np.full(len(truth), np.nan)
    x, y, depth = (truth[name].to_numpy(dtype=float) for name in ("x", "y", "depth"))
    permittivity = run["soil"]["permittivity"]
    shifts = [
        refraction_shift(depth, permittivity, pose[2], np.hypot(x - pose[0], y - pose[1])) for pose in run["pose"]
    ]
    return np.asarray(np.mean(shifts, axis=0), dtype=np.float64)


def roc_json(scored: list[Score]) -> str:
    """Write scores as JSON text.

    Parameters
    ----------
    scored : list of Score
        Scores.

    Returns
    -------
    str
        Per detection its convention, counts, PD_mean and ROC points with intervals; an infinite threshold is null.
    """
    content = {
        one.detection.name: {
            "title": one.detection.title,
            "convention": one.curve.attrs,
            "pd_mean": pd_mean(one.curve) if one.curve.attrs["n_targets"] else None,
            "points": one.curve.to_dict("records"),
            "targets": one.outcomes.to_dict("records"),
        }
        for one in scored
    }
    return json.dumps(_plain(content), indent=1, allow_nan=False) + "\n"


def _plain(value: Any) -> Any:
    if isinstance(value, dict):
        return {str(key): _plain(entry) for key, entry in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(entry) for entry in value]
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value if isinstance(value, str | int | float | bool | None) else str(value)
