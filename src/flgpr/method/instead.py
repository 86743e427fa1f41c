"""What stands in for a detection on ground that is unlike the training, and thresholds for a rate.

A covariance that is a little off is mended by the lane's own clutter (``passes/run_view.py``). Farther
off, the recipe that `flgpr recipe for` makes for the run ranks by contrast: it has learnt nothing. What
was measured stays, as a detection beside it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pandas as pd

from flgpr.method.detection import AS_LEARNT, MAIN, Detection
from flgpr.method.evidence import in_order
from flgpr.method.imaged_run import ImagedRun
from flgpr.method.sections import section_lane, seen_part
from flgpr.method.stands_out import (
    ABOVE,
    RateThreshold,
    bright_beside,
    own_threshold,
    training_threshold,
    what_stands_out,
)
from flgpr.recipe.make import fit_recipe
from flgpr.recipe.schema import parse_recipe, seen_lane
from flgpr.types import Entries, FloatArray

BESIDE = "as-learnt"
"""Name of the detection as it was learnt, where another stands in for it."""
_DONE = {
    "own": "ranked by the likelihood in the lane's own clutter instead",
    "contrast": "ranked by contrast instead",
    "": "they are kept, as asked for",
}


def contrast_lane(lane: ImagedRun) -> tuple[ImagedRun, str] | None:
    """Return the lane as the recipe that ranks by contrast sees it, and the text of that recipe.

    The pixels of the run-view stay the same, and what earlier drives predict is subtracted if it was.
    None where no recipe can be made for the run.
    """
    others = None if lane.earlier is None else lane.setup.others
    try:
        text = fit_recipe(lane.run, again=others is not None)
        recipe = parse_recipe(text)
    except ValueError:
        return None
    own = lane.recipe.run_view
    same = {"x": own.x, "y": own.y, "spacing": own.spacing}
    recipe = recipe.model_copy(
        update={
            "run_view": recipe.run_view.model_copy(update=same),
            "prescreen": recipe.prescreen.model_copy(
                update={"density": lane.recipe.prescreen.density}
            ),
            "motion": lane.recipe.motion,
            "features": None,
            "confidence": "contrast",
        }
    )
    section = replace(lane.section, threshold=None)
    contrast = ImagedRun(
        lane.run, recipe, lane.lane, section=section, others=others, explains=lane.explains
    )
    return contrast, text


def put_instead(
    lane: ImagedRun, learnt: Detection, by_contrast: Detection, text: str
) -> list[Detection]:
    """Return the detection by contrast, and beside it the one as it was learnt.

    Alarms by contrast have the confidence of the learnt alarm next to them, where one lies within
    the radius of the recipe's alarms.
    """
    near = _nearest_confidence(by_contrast.alarms, learnt.alarms, lane.recipe.prescreen.radius)
    main = replace(
        by_contrast,
        name=MAIN,
        title="ranked by contrast, on ground unlike the training",
        alarms=by_contrast.alarms.assign(**{AS_LEARNT: near}),
        recipe_text=text,
    )
    title = "as learnt, on ground unlike the training: its confidences do not hold"
    beside = replace(learnt, name=BESIDE, title=title, before=None, earlier=None)
    return [main, beside]


def rank_by_column(lane: ImagedRun, learnt: Detection) -> list[Detection]:
    """Return the same alarms ranked by their contrast, where no recipe can be made for the run."""
    if learnt.features is None or lane.steps.single not in learnt.features:
        return [learnt]
    alarms = learnt.alarms.assign(**{AS_LEARNT: learnt.alarms["confidence"]})
    alarms["confidence"] = learnt.features[lane.steps.single].to_numpy()
    order = np.argsort(-alarms["confidence"].to_numpy(), kind="stable")
    contrast = pd.DataFrame({lane.steps.single: alarms["confidence"].to_numpy()[order]})
    evidence = learnt.evidence
    return [
        replace(
            learnt,
            alarms=alarms.iloc[order].reset_index(drop=True),
            features=learnt.features.iloc[order].reset_index(drop=True),
            contributions=None if learnt.contributions is None else contrast,
            evidence=None if evidence is None else in_order(evidence, order),
        )
    ]


def _nearest_confidence(alarms: pd.DataFrame, learnt: pd.DataFrame, radius: float) -> FloatArray:
    """Return the confidence of the learnt alarm next to each alarm; NaN where none is within a radius."""
    found = np.full(len(alarms), np.nan)
    if not len(learnt):
        return found
    places = alarms[["x", "y"]].to_numpy(dtype=float)
    others = learnt[["x", "y"]].to_numpy(dtype=float)
    distance = np.linalg.norm(places[:, None] - others, axis=-1)
    nearest = distance.argmin(axis=1)
    near = distance.min(axis=1) <= radius
    found[near] = learnt["confidence"].to_numpy(dtype=float)[nearest[near]]
    return found


def describe_trust(lane: ImagedRun, detections: Sequence[Detection]) -> Entries:
    """Return what a manifest says of how far a detection can be trusted.

    ``stands_out`` always, ``far`` where a false-alarm rate was asked for, ``unlike`` where the
    ground was compared.
    """
    searched = section_lane(lane.recipe, lane.lane, lane.section)
    ground = seen_part(searched, seen_lane(lane.run, lane.recipe))
    detector = None if lane.substitute else lane.model.detector
    stands_out = what_stands_out(detections[0].alarms, ground, detector)
    described: Entries = {"stands_out": stands_out.as_json()}
    said = [sentence for stage in lane.all_stages for sentence in stage.sentences()]
    for stage in lane.columns:
        said += stage.of_alarms(detections[0].alarms)
    fits_roadside = any(name.endswith(".roadside") for name in lane.recipe.named())
    if lane.recipe.confidence == "contrast" and lane.model.detector is None and not fits_roadside:
        said += bright_beside(detections[0].alarms, lane.lane)
    described["stands_out"]["notes"][1:1] = said
    if lane.trust.far is not None:
        described["far"] = rate_threshold(lane, detections[0].alarms).as_json(
            int(detections[0].alarms[ABOVE].sum())
        )
    comparison = lane.comparison
    if comparison is None:
        return described

    alarms = detections[0].alarms
    more = []
    if lane.substitute and AS_LEARNT in alarms:
        known = int(alarms[AS_LEARNT].notna().sum())
        more.append(
            f"of {len(alarms)} alarms {known} were alarms as learnt, too: their confidence stays in "
            f"{AS_LEARNT}"
        )
    if len(detections) > 1:
        count = len(detections[1].alarms)
        more.append(f"all {count} alarms as learnt are in variants/{BESIDE}/alarms.csv")
    unlike = comparison.as_json(_DONE[lane.substitute], more)
    unlike |= {"choice": lane.trust.unlike, "substitute": lane.substitute}
    if len(detections) > 1:
        unlike["recipe"] = detections[0].recipe_text
    return described | {"unlike": unlike}


def rate_threshold(lane: ImagedRun, alarms: pd.DataFrame) -> RateThreshold:
    """Return the threshold of the confidence for the false-alarm rate that was asked for.

    It is that of the training lanes, and the lane's own where nothing was learnt, or another
    ranking stands in for what was.
    """
    if lane.trust.far is None:
        raise ValueError("far must be given for a threshold, got none")
    if lane.model.detector is None or lane.substitute:
        inside = section_lane(lane.recipe, lane.lane, lane.section)
        counts = inside.contains(alarms["x"], alarms["y"])
        return own_threshold(
            alarms["confidence"].to_numpy(float)[counts], inside.area, lane.trust.far
        )
    ground = lane.model.ground
    return training_threshold([] if ground is None else ground.free, lane.trust.far)


def mark_threshold(lane: ImagedRun, detection: Detection) -> Detection:
    """Return a detection whose alarms say whether they lie above the threshold for a rate."""
    if lane.trust.far is None:
        return detection
    threshold = rate_threshold(lane, detection.alarms).threshold
    above = detection.alarms["confidence"] > (np.inf if threshold is None else threshold)
    return replace(detection, alarms=detection.alarms.assign(**{ABOVE: above.astype(int)}))
