"""What a recipe found on a lane: alarms with their confidence, ranked, and what explains them."""

from __future__ import annotations

from dataclasses import dataclass, field

import pandas as pd
import xarray as xr

from flgpr.engine import group_of
from flgpr.jit.threads import blas_on_one_thread
from flgpr.method.estimators import TrainedEstimator, probability
from flgpr.method.evidence import Evidence, confidence_contributions, in_order
from flgpr.method.imaged_run import ImagedRun, array_table
from flgpr.method.passes.run_view import alarms_by_frame
from flgpr.model import ALARM_COLUMNS, empty_table
from flgpr.types import Entries, FloatArray, IndexArray

MAIN = "main"
"""Name of a result's own detection; others may stand beside it, by the name of their recipe."""
AS_LEARNT = "confidence_as_learnt"
"""Column of the confidence that another ranking stands in for, on ground unlike the training."""


@dataclass(frozen=True)
class Detection:
    """What one recipe found."""

    name: str  #: "main" for a result's own recipe
    title: str  #: the words for it where several detections stand side by side
    #: alarm table, the most mine-like first; stages may have added columns to it
    alarms: pd.DataFrame
    view: xr.DataArray  #: run-view (polarization, subband, y, x) in units of the gain background
    notes: Entries = field(default_factory=dict)  #: figures worth reporting
    channel: tuple[str, str] | None = None  #: polarization and sub-band the alarms were raised on
    features: pd.DataFrame | None = None  #: features of every alarm
    contributions: pd.DataFrame | None = (
        None  #: what each feature adds to the confidence, per alarm
    )
    training: pd.DataFrame | None = None  #: features of the training alarms, with their ``label``
    evidence: Evidence | None = None  #: what explains the alarms, for the viewer
    before: xr.DataArray | None = None  #: run-view before clutter suppression, for the viewer
    earlier: xr.DataArray | None = None  #: run-view of an earlier drive, for the viewer
    #: alarms of every scan's own image, and the pose of each scan by its number, where the recipe
    #: scores by frames
    frames: tuple[pd.DataFrame, dict[int, FloatArray]] | None = None
    recipe_text: str = ""  #: TOML of its recipe, where that is not the result's own


@dataclass(frozen=True)
class RankedAlarms:
    """Alarms with a confidence, the most mine-like first."""

    alarms: pd.DataFrame
    features: pd.DataFrame  #: of the same index
    rows: IndexArray  #: their numbers among the alarms that were raised


@blas_on_one_thread()
def rank_alarms(lane: ImagedRun) -> RankedAlarms:
    """Score the alarms of a lane with the recipe's detector and rank them.

    Needs the results of the passes "alarms" and "features".

    Parameters
    ----------
    lane : ImagedRun
        The lane.

    Returns
    -------
    RankedAlarms
        The alarms that have a confidence.
    """
    features = lane.results["features"]
    if lane.explains:
        features = group_of(features, "features")
    alarms = lane.alarms()
    view_columns = [name for name in alarms.columns if name not in ("x", "y", "magnitude")]
    table = pd.concat([array_table(features), alarms[view_columns]], axis=1)

    alarms["confidence"] = lane.steps.confidence(table, alarms["magnitude"])
    if lane.replaces_map:
        as_learnt = pd.Series(lane.as_learnt_at(alarms), alarms.index)
        table[AS_LEARNT] = lane.steps.confidence(table, as_learnt)
        alarms["confidence"] = alarms["magnitude"].astype(float)
    alarms["scans"] = table["scans"]
    ranked = rank(alarms, table)
    detector = lane.steps.detector
    is_read = detector is not None and "magnitude" in detector.features
    if lane.recipe.features is None or is_read:
        with_magnitude = ranked.features.assign(magnitude=ranked.alarms["magnitude"])
        ranked = RankedAlarms(ranked.alarms, with_magnitude, ranked.rows)
    return ranked


def rank(alarms: pd.DataFrame, features: pd.DataFrame) -> RankedAlarms:
    """Drop alarms without a confidence, sort and name the rest, and keep their features in step.

    Parameters
    ----------
    alarms : DataFrame
        Alarms with the column ``confidence``.
    features : DataFrame
        Their features, of the same index.

    Returns
    -------
    RankedAlarms
        The most confident first; equal ones stay in their order.
    """
    table = alarms[alarms["confidence"].notna()]
    table = table.sort_values("confidence", ascending=False, kind="stable")
    features = features.loc[table.index].reset_index(drop=True)
    rows = table.index.to_numpy()
    table = table.reset_index(drop=True)
    table["alarm_id"] = [f"alarm-{number}" for number in range(1, len(table) + 1)]
    columns = [column.name for column in ALARM_COLUMNS if column.name in table.columns]
    if not len(table):
        table = empty_table(ALARM_COLUMNS)
    return RankedAlarms(table[columns], features, rows)


@blas_on_one_thread()
def assemble(lane: ImagedRun, ranked: RankedAlarms) -> Detection:
    """Return the ranked alarms of a lane with its run-view and what explains them.

    Needs the results of all passes. What explains alarms is there only where the lane gathers it.
    """
    alarms = ranked.alarms
    for stage in lane.columns:
        for name in stage.alarm_columns:
            alarms = alarms.assign(**{name: ranked.features[name]})
    if lane.replaces_map:
        alarms = alarms.assign(**{AS_LEARNT: ranked.features[AS_LEARNT]})
    elif _gives_odds(lane) and not (lane.comparison is not None and lane.comparison.unlike):
        alarms = alarms.assign(p=[round(probability(odds), 4) for odds in alarms["confidence"]])
    frames = alarms_by_frame(lane) if "frames" in lane.results else None
    entries: Entries = {
        "notes": _notes(lane),
        "features": ranked.features,
        "frames": frames,
    }
    if lane.explains:
        screen = lane.recipe.prescreen
        sums = lane.evidence_sums()
        sums.merge(group_of(lane.results["features"], "explain"))
        evidence = in_order(sums.result(), ranked.rows)
        entries |= {
            "channel": (screen.polarization, screen.subband),
            "contributions": _contributions(lane, ranked, evidence),
            "evidence": evidence,
            "before": lane.view("before"),
            "earlier": None if lane.earlier is None else lane.view("earlier"),
        }
    return Detection(MAIN, lane.recipe.description, alarms, lane.view(), **entries)


def _gives_odds(lane: ImagedRun) -> bool:
    """Return whether the confidence is the log odds of a mine: only then it is calibrated."""
    detector = lane.model.detector
    return isinstance(detector, TrainedEstimator) and detector.linear_in_magnitude


def _contributions(lane: ImagedRun, ranked: RankedAlarms, evidence: Evidence) -> pd.DataFrame:
    """Return what adds up to the confidence of every alarm."""
    detector = lane.model.detector
    confidence = ranked.alarms["confidence"]
    if lane.replaces_map:
        return pd.DataFrame({"map": confidence.to_numpy()})
    if detector is None:
        return pd.DataFrame({lane.steps.single: confidence.to_numpy()})
    if _gives_odds(lane) and evidence.adds:
        at_zero, at_one = detector.confidence(pd.DataFrame({"magnitude": [0.0, 1.0]}))
        return confidence_contributions(evidence, at_one - at_zero, confidence)
    return detector.contributions(ranked.features)


def _notes(lane: ImagedRun) -> Entries:
    """Return figures worth reporting, and what the confidence is made of."""
    notes: Entries = {}
    detector = lane.model.detector
    if lane.replaces_map:
        notes["confidence"] = "map"
    elif detector is not None:
        notes["confidence"] = " + ".join(detector.features)
    elif lane.recipe.features is not None:
        notes["confidence"] = lane.steps.single
    for stage in lane.all_stages:
        notes |= stage.notes()
    return notes
