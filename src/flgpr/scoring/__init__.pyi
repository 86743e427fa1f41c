from flgpr.scoring.analysts import Agreement, agreement
from flgpr.scoring.area import union_area
from flgpr.scoring.assignment import assign, label_alarms
from flgpr.scoring.blind import PASSPHRASE_RULE, BlindScore, Registration, open_truth, score_blind, seal_truth
from flgpr.scoring.bootstrap import band, pd_mean_interval
from flgpr.scoring.boxes import box_peaks, box_roc, offset_boxes, peak_roc
from flgpr.scoring.breakdown import decision_curves, decision_table, pd_table
from flgpr.scoring.chance_level import Chance, chance, random_pd
from flgpr.scoring.checks import as_lanes
from flgpr.scoring.comparison import (
    Comparison,
    SideBySide,
    compare,
    mcnemar_test,
    paired_interval,
    side_by_side,
    sign_flip_test,
)
from flgpr.scoring.curve import (
    CONVENTIONS,
    CURVE_COLUMNS,
    Convention,
    operating_row,
    pd_at,
    pd_mean,
    with_area,
)
from flgpr.scoring.examples import example_roc
from flgpr.scoring.figures import figure_bytes, patch_figure, roc_figure
from flgpr.scoring.intervals import clopper_pearson, poisson_interval
from flgpr.scoring.lane_roc import accumulated_area, far_area, roc, roc_of
from flgpr.scoring.lane_score import Rules, Score, score
from flgpr.scoring.lane_splits import Split, splits
from flgpr.scoring.ledger import alarm_hash, content_hash, read_register, register, require_registered, require_truth
from flgpr.scoring.matching import Match, match, select_targets
from flgpr.scoring.planning import SamplePlan, area_needed, emplacement_plan, mines_needed, sample_size
from flgpr.scoring.refraction import Refraction, refraction_shift
from flgpr.scoring.survey import SurveyShare, jitter, survey_share

__all__ = [
    "CONVENTIONS",
    "CURVE_COLUMNS",
    "PASSPHRASE_RULE",
    "Agreement",
    "BlindScore",
    "Chance",
    "Comparison",
    "Convention",
    "Match",
    "Refraction",
    "Registration",
    "Rules",
    "SamplePlan",
    "Score",
    "SideBySide",
    "Split",
    "SurveyShare",
    "accumulated_area",
    "agreement",
    "alarm_hash",
    "area_needed",
    "as_lanes",
    "assign",
    "band",
    "box_peaks",
    "box_roc",
    "chance",
    "clopper_pearson",
    "compare",
    "content_hash",
    "decision_curves",
    "decision_table",
    "emplacement_plan",
    "example_roc",
    "far_area",
    "figure_bytes",
    "jitter",
    "label_alarms",
    "match",
    "mcnemar_test",
    "mines_needed",
    "offset_boxes",
    "open_truth",
    "operating_row",
    "paired_interval",
    "patch_figure",
    "pd_at",
    "pd_mean",
    "pd_mean_interval",
    "pd_table",
    "peak_roc",
    "poisson_interval",
    "random_pd",
    "read_register",
    "refraction_shift",
    "register",
    "require_registered",
    "require_truth",
    "roc",
    "roc_figure",
    "roc_of",
    "sample_size",
    "score",
    "score_blind",
    "seal_truth",
    "select_targets",
    "side_by_side",
    "sign_flip_test",
    "splits",
    "survey_share",
    "union_area",
    "with_area",
]
