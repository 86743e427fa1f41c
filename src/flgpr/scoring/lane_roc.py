"""ROC of an alarm list against a lane's truth, by the six rules of Wang et al. 2007.

Tables also say which alarm found which target.

Examples
--------
>>> import pandas as pd
>>> from flgpr.model import Lane
>>> from flgpr.scoring import roc
>>> alarms = pd.DataFrame({"x": [0.2, 1.0, -1.1], "y": [10.3, 44.0, 30.1]})
>>> alarms["confidence"] = [3, 2, 1]
>>> truth = pd.DataFrame({"target_id": ["a", "b"], "x": [0.0, -1.0], "y": [10.0, 30.0]})
>>> truth = truth.assign(kind="metal", depth=0.05)
>>> curve = roc(alarms, truth, Lane(-2.0, 2.0, 0.0, 60.0), halo=1.0)
>>> curve[["threshold", "pd", "far", "n_detected", "n_false"]].round(4)
   threshold   pd     far  n_detected  n_false
0        inf  0.0  0.0000           0        0
1        3.0  0.5  0.0000           1        0
2        2.0  0.5  0.0043           1        1
3        1.0  1.0  0.0043           2        1
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Literal

import numpy as np
import pandas as pd

from flgpr.scoring.curve import count_at, describe, make_curve
from flgpr.scoring.matching import (
    LaneLike,
    Match,
    Subset,
    first_of_each,
    match,
    one_of,
    select_targets,
)
from flgpr.scoring.places import Refraction, survey_share

AreaRule = Literal["union", "paper", "frames"]


def roc(
    alarms: pd.DataFrame,
    truth: pd.DataFrame,
    lane: LaneLike,
    halo: float = 1.0,
    subset: Subset = None,
    *,
    area: AreaRule = "union",
    frame_area: float | None = None,
    halo_as: Literal["radius", "diameter"] = "radius",
    assignment: Literal["halo", "nearest"] = "halo",
    shared: Literal["drop", "count"] = "drop",
    refraction: Refraction | None = None,
    survey_error: float | None = None,
    level: float = 0.95,
) -> pd.DataFrame:
    """Compute the ROC of an alarm list (Wang et al. 2007, Sec. II-F, rules 1 to 6).

    The first row is the threshold +inf, where nothing is declared; one row follows for every
    distinct confidence of the table, so that ties are one step, and subsets share thresholds.

    Parameters
    ----------
    alarms, truth : DataFrame
        Alarm table and truth table; several lanes are named in the column ``lane``.
    lane : Lane, mapping, Series or DataFrame
        The scored lane, or several by name, see ``flgpr.scoring.as_lanes``.
    halo, halo_as : float, {"radius", "diameter"}
        Size of the halo, m, whose border is within, and what it is (a diameter in Fuse et al.).
    subset, shared : None, str, sequence, mapping or callable; {"drop", "count"}
        Targets to score (``select_targets``; rules 5 and 6), and whether an alarm near another
        target is dropped or may detect one of them, so that it is found alike in every subset.
    area, frame_area : {"union", "paper", "frames"}, float
        Lane less the union of halos; lane less N·π·r²; ``frame_area``, m², of all frames.
    assignment : {"halo", "nearest"}
        Whether an alarm detects every target in reach or only the nearest.
    refraction, survey_error, level : Refraction, float, float
        Moves buried targets to their images; survey's deviation per axis, m; of exact intervals.

    Returns
    -------
    DataFrame
        ``threshold``, ``pd`` (NaN without targets), ``far`` (per m²), their intervals, counts and
        ``area`` (m²); ``attrs`` name the convention and all choices.

    Raises
    ------
    ValueError
        If a table, the lane or an option is not valid, or the area is not positive.
    """
    matched = match(
        alarms, truth, lane, halo, halo_as=halo_as, assignment=assignment, refraction=refraction
    )
    curve = roc_of(matched, subset, area=area, frame_area=frame_area, shared=shared, level=level)
    curve.attrs["assignment"] = assignment
    if survey_error is not None:
        curve.attrs["survey_error"] = float(survey_error)
        curve.attrs["survey_share_of_halo"] = survey_share(survey_error, matched.halo).share
    return curve


def roc_of(
    matched: Match,
    subset: Subset = None,
    *,
    area: AreaRule = "union",
    frame_area: float | None = None,
    shared: Literal["drop", "count"] = "drop",
    level: float = 0.95,
) -> pd.DataFrame:
    """Compute the ROC of alarms that are matched already.

    Parameters
    ----------
    matched : Match
        Alarms and targets, see :func:`flgpr.scoring.match`.
    subset, area, frame_area, shared, level
        As for :func:`roc`.

    Returns
    -------
    DataFrame
        As of :func:`roc`.

    Raises
    ------
    ValueError
        If an option is not valid, or the area is not positive.
    """
    one_of("shared", shared, ("drop", "count"))
    chosen = select_targets(matched.truth, subset)
    _, best_confidence, _ = matched.best(chosen, shared)
    scores = best_confidence[chosen]
    thresholds = np.append(np.inf, np.unique(matched.confidence)[::-1])
    attrs = {
        **describe("frames" if area == "frames" else "lane"),
        "area_rule": area,
        "halo_radius": matched.halo,
        "lanes": list(matched.lanes),
        "n_alarms": len(matched.alarms),
        "n_known_targets": len(matched.truth),
        "subset": _describe_subset(subset),
        "shared": shared,
        "refraction": "none" if matched.refraction is None else str(matched.refraction),
    }
    return make_curve(
        thresholds,
        count_at(thresholds, scores),
        count_at(thresholds, matched.confidence[matched.false]),
        int(chosen.sum()),
        far_area(matched, area, frame_area),
        attrs,
        level,
    )


def far_area(matched: Match, area: AreaRule, frame_area: float | None = None) -> float:
    """Compute the area that a FAR refers to.

    Parameters
    ----------
    matched : Match
        Alarms and targets, see :func:`flgpr.scoring.match`.
    area, frame_area
        Rule of the area, and the area of all frames, m², as for :func:`roc`.

    Returns
    -------
    float
        The area, m².

    Raises
    ------
    ValueError
        If ``frame_area`` is missing or superfluous, or the area is not positive.
    """
    one_of("area", area, ("union", "paper", "frames"))
    if (area == "frames") != (frame_area is not None):
        raise ValueError(
            'frame_area must be given with area="frames" and only then, '
            f"got {frame_area} with {area!r}"
        )
    if frame_area is not None:
        total = float(frame_area)
    else:
        total = float(matched.lane_areas("paper" if area == "paper" else "union").sum())
    lanes = sum(lane.area for lane in matched.lanes.values())
    # Rounding leaves a trace of area where halos cover the lane to the last point.
    if not total > 1e-9 * lanes:
        raise ValueError(
            f"area must be positive, got {total:g} m² by the rule {area!r}: "
            f"{len(matched.truth)} halos of radius {matched.halo:g} m in {lanes:g} m² of lane; "
            "is the halo in metres?"
        )
    return total


def accumulated_area(
    frames: int,
    x_span: tuple[float, float] = (-7.0, 7.0),
    y_span: tuple[float, float] = (5.0, 10.0),
) -> float:
    """Compute the area of all frames, the same ground counted again in each.

    It is the area of the FAR of Fuse et al. 2018, Fig. 9.

    Parameters
    ----------
    frames : int
        Number of frames.
    x_span, y_span : tuple of float
        Cross-range and down-track extent of the detection area of one frame, m; the paper's by
        default.

    Returns
    -------
    float
        The area, m².

    Raises
    ------
    ValueError
        If there is no frame, or an extent is not positive.
    """
    width = x_span[1] - x_span[0]
    length = y_span[1] - y_span[0]
    if frames < 1 or width <= 0 or length <= 0:
        raise ValueError(
            "frames and extents must be positive, "
            f"got {frames} frames of {width:g} m by {length:g} m"
        )
    return frames * width * length


def _describe_subset(subset: Subset) -> str:
    """Return a short description of a subset of targets."""
    if subset is None:
        return "all targets"
    if isinstance(subset, str):
        return subset
    if isinstance(subset, Mapping):
        conditions = []
        for name, value in subset.items():
            text = _describe_subset(value) if callable(value) else value
            conditions.append(f"{name}={text}")
        return ", ".join(conditions)
    if callable(subset):
        return str(getattr(subset, "__name__", "predicate"))
    return "chosen targets"


def assign(
    matched: Match, area: AreaRule = "union", frame_area: float | None = None
) -> pd.DataFrame:
    """Return the best alarm of every target, and the false alarm rate at which it is found.

    Parameters
    ----------
    matched : Match
        Alarms and targets, see :func:`flgpr.scoring.match`.
    area, frame_area
        Area of the FAR, as for :func:`flgpr.scoring.roc`.

    Returns
    -------
    DataFrame
        The truth table's columns and, per target: ``detected``, whether any alarm is in its halo;
        ``alarm``, row of its best alarm (-1 for none); ``confidence`` (-inf for none); ``distance``
        of that alarm, m (NaN); ``rank`` among all alarms, 1 for the highest, ties sharing the best
        rank (0 for none); ``n_false``, the false alarms at or above that confidence; ``far``, the
        same per m² (inf for none): the FAR at which the target is found.
    """
    alarm, confidence, distance = matched.best()
    is_detected = alarm >= 0
    total = far_area(matched, area, frame_area)
    n_false = count_at(confidence, matched.confidence[matched.false])
    n_above = count_at(np.nextafter(confidence, np.inf), matched.confidence)
    return matched.truth.assign(
        detected=is_detected,
        alarm=alarm,
        confidence=confidence,
        distance=distance,
        rank=np.where(is_detected, n_above + 1, 0),
        n_false=n_false,
        far=np.where(is_detected, n_false / total, np.inf),
    )


def label_alarms(matched: Match) -> pd.DataFrame:
    """Return the alarm table of a match with what every alarm counts as.

    Parameters
    ----------
    matched : Match
        Alarms and targets, see :func:`flgpr.scoring.match`.

    Returns
    -------
    DataFrame
        The alarm table with ``label``: "detection" (the best alarm of a target), "ignored" (in a
        halo, but another alarm is better), "false", or "outside" (in no halo and outside the lane);
        ``target``, row of the nearest target within a halo (-1 for none); and ``distance`` to it, m
        (NaN for none).
    """
    best, _, _ = matched.best()
    outside_halos = np.where(matched.false, "false", "outside")
    label = np.where(matched.in_halo, "ignored", outside_halos).astype(object)
    label[best[best >= 0]] = "detection"

    target = np.full(len(label), -1)
    distance = np.full(len(label), np.nan)
    nearest = first_of_each(matched.pair_alarm, matched.pair_distance, matched.pair_target)
    target[matched.pair_alarm[nearest]] = matched.pair_target[nearest]
    distance[matched.pair_alarm[nearest]] = matched.pair_distance[nearest]
    return matched.alarms.assign(label=label, target=target, distance=distance)
