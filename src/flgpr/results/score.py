"""Scores a result against truth, and writes the files of a score.

No other module that makes a result sees the truth.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

import flgpr
from flgpr.door import MOST_JSON, Folder, listed_files
from flgpr.json_text import parse_json
from flgpr.results.description import plausible_poses
from flgpr.results.manifest import read_result_manifest
from flgpr.results.result import Result
from flgpr.results.view_files import plain_json
from flgpr.scoring import (
    Rules,
    Score,
    SideBySide,
    operating_row,
    refraction_shift,
    score,
    score_frames,
)
from flgpr.scoring.curve import held_pd_mean
from flgpr.store.view_format import VIEW_SCORE, sealed_view_score, view_score_body
from flgpr.types import BoolArray, Entries, FloatArray, floats

ROC_FORMAT = "flgpr-score"
ROC_VERSION = 1
COMPARISON_FORMAT = "flgpr-comparison"
# Columns of a curve that are alike for all subsets of the targets (rules 5 and 6), and the others.
_SHARED_COLUMNS = ("far", "n_false", "far_low", "far_high")
_SUBSET_COLUMNS = ("pd", "n_detected", "pd_low", "pd_high", "chance")
_MOST_DEPTHS = 6
_DEPTH_MARGIN = 5e-5  # m; depths are rounded to a tenth of a millimetre


def score_detections(result: Result, truth: pd.DataFrame, far: float = Rules.far) -> list[Score]:
    """Score the main result and every variant by the halo and the area of the recipe.

    Every place of the lane counts once here: a recipe whose area is "frames" is scored by the union
    of halos, and frame by frame by :func:`score_by_frames`.

    Parameters
    ----------
    result : Result
        The result.
    truth : pandas.DataFrame
        Targets, one row each.
    far : float
        FAR of the operating point, per m².

    Returns
    -------
    list of Score
        In the order of the result's detections.
    """
    table = result.recipe.score
    area = "union" if table.area == "frames" else table.area
    rules = Rules(halo=table.halo, area=area, far=far)
    scores = []
    for detection in result.detections:
        scores.append(
            score(
                detection.alarms,
                truth,
                result.lane,
                rules,
                name=detection.name,
                title=detection.title,
            )
        )
    shift = expected_shift(scores[0].matched.truth, result.manifest["run"])
    return [
        replace(scored, outcomes=scored.outcomes.assign(expected_shift=shift)) for scored in scores
    ]


def score_by_frames(result: Result, truth: pd.DataFrame, far: float = Rules.far) -> Score:
    """Score a result whose recipe has ``score.area = "frames"``: every frame counts its area.

    This is how Fuse et al. (2018) score.

    Parameters
    ----------
    result : Result
        The result.
    truth : pandas.DataFrame
        Targets, one row each.
    far : float
        FAR of the operating point, per m².

    Raises
    ------
    ValueError
        If the result has no alarms of single frames.
    """
    main = result.detections[0]
    if main.frames is None:
        raise ValueError(
            'score.area must be "frames" when the run is detected, so that the alarms of every '
            "frame are stored, got a result without them; run `flgpr.detect` again"
        )
    rules = Rules(halo=result.recipe.score.halo, far=far)
    title = f"{main.title}, every frame counts its area"
    return score_frames(
        *main.frames, truth, result.recipe.frame_area(), rules, name=main.name, title=title
    )


def expected_shift(truth: pd.DataFrame, run: Entries) -> FloatArray:
    """Estimate how far beyond each buried target its image lies when it is focused on the surface.

    Scoring does not correct for it. See :func:`flgpr.scoring.refraction_shift`.

    Parameters
    ----------
    truth : pandas.DataFrame
        Targets with ``x``, ``y`` and ``depth``, m.
    run : dict
        Description of the run, with its ``soil`` and poses.

    Returns
    -------
    (n_targets,) ndarray of float
        Mean over the scans, m; NaN where depth or soil is unknown.
    """
    soil = run.get("soil")
    permittivity = soil.get("permittivity") if isinstance(soil, dict) else None
    if not isinstance(permittivity, (int, float)) or isinstance(permittivity, bool):
        return np.full(len(truth), np.nan)
    x, y, depth = (floats(truth[name]) for name in ("x", "y", "depth"))
    shifts = []
    for pose in plausible_poses(run):
        distance = np.hypot(x - pose[0], y - pose[1])
        shifts.append(refraction_shift(depth, permittivity, pose[2], distance))
    return floats(np.mean(shifts, axis=0))


def roc_json(scored: Sequence[Score], notes: Mapping[str, Any]) -> str:
    """Return ``roc.json`` of scores by the same rules.

    An infinite threshold and all that is unknown are null.
    """
    detections = {entry.name: entry.summary() for entry in scored}
    return detections_json(scored[0].rules_summary(), notes, detections)


def comparison_json(
    comparison: SideBySide, rules: Mapping[str, Any], notes: Mapping[str, Any]
) -> str:
    """Return ``comparison.json`` of detectors side by side."""
    tables = {
        "points": _records(comparison.points),
        "pairs": _records(comparison.pairs),
        "means": _records(comparison.means),
    }
    return score_json_text(COMPARISON_FORMAT, rules, notes, tables)


def _records(table: pd.DataFrame | None) -> list[dict[Any, Any]] | None:
    """Return the rows of a table as JSON objects."""
    return None if table is None else table.to_dict("records")


def detections_json(
    rules: Mapping[str, Any], notes: Mapping[str, Any], detections: Mapping[str, Any]
) -> str:
    """Return the text of ``roc.json``, by rules, notes and the entries of each detection."""
    return score_json_text(ROC_FORMAT, rules, notes, {"detections": detections})


def score_json_text(
    name: str, rules: Mapping[str, Any], notes: Mapping[str, Any], entries: Mapping[str, Any]
) -> str:
    """Return the indented JSON of a score's file; what JSON cannot hold becomes null."""
    content = {
        "format": name,
        "version": ROC_VERSION,
        "flgpr": flgpr.__version__,
        "rules": rules,
        "notes": notes,
        **entries,
    }
    return json.dumps(plain_json(content), indent=1, allow_nan=False) + "\n"


def view_score(
    result: Result, scored: Sequence[Score], objects: pd.DataFrame | None = None
) -> bytes:
    """Return ``view/score.json``, which names the result it belongs to and its own digest.

    Parameters
    ----------
    result : Result
        The result that was scored.
    scored : sequence of Score
        Scores of its detections, by the same truth.
    objects : pandas.DataFrame, optional
        Objects that never score, such as rocks and posts.
    """
    truth = scored[0].matched.truth
    classes = depth_class_bounds(truth)
    content = plain_json(
        {
            "result_sha256": result.manifest["identity"],
            "halo": scored[0].rules.halo,
            "truth": truth.to_dict("list"),
            "objects": None if objects is None else objects.to_dict("list"),
            "kinds": sorted({str(kind) for kind in truth["kind"]}),
            "depths": [label for label, _ in classes],
            "target_depth": depth_labels(truth, classes),
            "detections": {entry.name: _view_entry(entry, classes) for entry in scored},
        }
    )
    return sealed_view_score(content)


def read_scored_truth(
    result: Result, folder: Path | None = None
) -> tuple[pd.DataFrame, pd.DataFrame | None] | None:
    """Read the truth and the objects that a result was scored with; None where it was not scored.

    Parameters
    ----------
    result : Result
        The result.
    folder : Path, optional
        Folder of the score, where it is not the result's own.

    Raises
    ------
    ValueError
        If the file is altered or belongs to another result.
    """
    if folder is None:
        # As its manifest lists them now: the result may have been scored since it was read.
        files = listed_files(result.folder, read_result_manifest(result.folder))
    else:
        files = Folder(folder)
    data = files.read_if_listed(VIEW_SCORE, MOST_JSON)
    if data is None:
        return None
    try:
        content = parse_json(view_score_body(data, result.manifest["identity"]))
        truth = pd.DataFrame(content["truth"])
        objects = None if content["objects"] is None else pd.DataFrame(content["objects"])
        return truth, objects
    except (ValueError, KeyError, TypeError) as error:
        path = files.root / VIEW_SCORE
        raise ValueError(f"{path}: it {error}; run `flgpr.score` again") from None


def depth_class_bounds(truth: pd.DataFrame) -> list[tuple[str, tuple[float, float]]]:
    """Return classes of the targets' depths.

    Each depth by itself while they are few, else quarters. A class is its label and its least and
    largest depth, m.
    """
    depths = np.unique(floats(truth["depth"].dropna()).round(4))
    classes = []
    if len(depths) <= _MOST_DEPTHS:
        for depth in depths:
            limits = (depth - _DEPTH_MARGIN, depth + _DEPTH_MARGIN)
            classes.append((f"{_centimetres(depth)} cm", limits))
        return classes
    edges = np.quantile(depths, [0.25, 0.5, 0.75, 1.0], method="lower")
    low = float(depths[0])
    for edge in edges:
        limits = (low - _DEPTH_MARGIN, float(edge) + _DEPTH_MARGIN)
        classes.append((f"{_centimetres(low)} to {_centimetres(edge)} cm", limits))
        deeper = depths[depths > edge]
        if deeper.size:
            low = float(deeper[0])
    return classes


def depth_labels(
    truth: pd.DataFrame, classes: list[tuple[str, tuple[float, float]]]
) -> list[str | None]:
    """Return the label of each target's depth class; None where the depth is unknown."""
    labels = []
    for depth in floats(truth["depth"]):
        fitting = [label for label, (low, high) in classes if low <= depth <= high]
        labels.append(fitting[0] if fitting else None)
    return labels


def _centimetres(depth: float) -> str:
    """Return a depth in m as text in cm."""
    return f"{100 * depth:.3g}"


def _view_entry(scored: Score, classes: list[tuple[str, tuple[float, float]]]) -> Entries:
    """Return what the viewer shows of a detection's score: a curve per kind and depth class."""
    truth = scored.matched.truth
    kinds: list[str | None] = [None, *sorted({str(kind) for kind in truth["kind"]})]
    depths: list[str | None] = [None, *(label for label, _ in classes)]
    labels = [label or "" for label in depth_labels(truth, classes)]
    depth_of_target = np.array(labels, dtype=object)
    curves = []
    for kind, depth in product(kinds, depths):
        chosen = np.ones(len(truth), dtype=bool)
        if kind is not None:
            chosen &= (truth["kind"].astype(str) == kind).to_numpy()
        if depth is not None:
            chosen &= depth_of_target == depth
        if chosen.any() or not len(truth):
            curves.append({"kind": kind, "depth": depth, **_curve(scored, chosen)})
    curve = scored.curve
    point: Entries = {
        "row": int(operating_row(curve, scored.far)),
        "few_halos": scored.few_halos,
        "far_asked": scored.rules.far,
        "far_allowed": scored.far,
    }
    return {
        "label": scored.labels["label"].tolist(),
        "target": scored.labels["target"].tolist(),
        "distance": scored.labels["distance"].tolist(),
        "outcomes": scored.outcomes.to_dict("list"),
        "shared": {
            "area": float(curve.iloc[-1]["area"]),
            "level": curve.attrs["level"],
            "point": point,
            "threshold": curve["threshold"].tolist(),
            **_rounded(curve, _SHARED_COLUMNS),
        },
        "curves": curves,
    }


def _curve(scored: Score, chosen: BoolArray) -> Entries:
    """Return the curve of the chosen targets."""
    curve = scored.curve_of(chosen if len(chosen) else None)
    return {
        "n_targets": int(curve.iloc[-1]["n_targets"]),
        "pd_mean": held_pd_mean(curve) if len(chosen) else None,
        **_rounded(curve, _SUBSET_COLUMNS),
    }


def _rounded(curve: pd.DataFrame, names: tuple[str, ...]) -> dict[str, list[float]]:
    """Return columns of a curve with five significant digits."""
    rounded = {}
    for name in names:
        rounded[name] = [float(f"{value:.5g}") for value in curve[name]]
    return rounded
