from flgpr.clutter.background import gain_background, remove_background, scan_gain, self_signature
from flgpr.clutter.coherence import (
    Coherence,
    FrameStack,
    accuracy_needed,
    averaged_frames,
    coherent_loss_db,
    iterate_frames,
    measured_coherence,
)
from flgpr.clutter.iteration import TABLE_II, Iterated, averaged, equal_cost, iterate_suppression
from flgpr.clutter.masks import (
    ROADSIDE,
    Intersection,
    ThresholdCalibration,
    Thresholds,
    above,
    extended_mask,
    fundamental_mask,
    intersect,
    mixed_mask,
    roadside_mask,
    subregions,
)
from flgpr.clutter.standing import standing_field, subtract_standing
from flgpr.clutter.streaming import Background, BackgroundEstimator, CausalBackground, shared_gain, shared_level
from flgpr.clutter.suppression import Suppression, suppress_by_model
from flgpr.clutter.whitening import ClutterWhitener, whitening_matrix

__all__ = [
    "ROADSIDE",
    "TABLE_II",
    "Background",
    "BackgroundEstimator",
    "CausalBackground",
    "ClutterWhitener",
    "Coherence",
    "FrameStack",
    "Intersection",
    "Iterated",
    "Suppression",
    "ThresholdCalibration",
    "Thresholds",
    "above",
    "accuracy_needed",
    "averaged",
    "averaged_frames",
    "coherent_loss_db",
    "equal_cost",
    "extended_mask",
    "fundamental_mask",
    "gain_background",
    "intersect",
    "iterate_frames",
    "iterate_suppression",
    "measured_coherence",
    "mixed_mask",
    "remove_background",
    "roadside_mask",
    "scan_gain",
    "self_signature",
    "shared_gain",
    "shared_level",
    "standing_field",
    "subregions",
    "subtract_standing",
    "suppress_by_model",
    "whitening_matrix",
]
