"""Scoring: alarms and truth in, ROC curves with intervals, comparisons, plans and reports out."""

from flgpr.scoring.area import union_area
from flgpr.scoring.assignment import assign, label_alarms
from flgpr.scoring.checks import as_lanes
from flgpr.scoring.curve import (
    CONVENTIONS,
    CURVE_COLUMNS,
    Convention,
    operating_row,
    pd_at,
    pd_mean,
    with_area,
)
from flgpr.scoring.intervals import clopper_pearson, poisson_interval
from flgpr.scoring.lane_roc import accumulated_area, far_area, roc, roc_of
from flgpr.scoring.matching import Match, match, select_targets

__all__ = [
    "CONVENTIONS",
    "CURVE_COLUMNS",
    "Convention",
    "Match",
    "accumulated_area",
    "as_lanes",
    "assign",
    "clopper_pearson",
    "far_area",
    "label_alarms",
    "match",
    "operating_row",
    "pd_at",
    "pd_mean",
    "poisson_interval",
    "roc",
    "roc_of",
    "select_targets",
    "union_area",
    "with_area",
]
