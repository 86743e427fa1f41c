"""From images to cleaned images: self-signature, gain background, model-based suppression."""

from flgpr.clutter.background import gain_background, remove_background, scan_gain, self_signature
from flgpr.clutter.streaming import Background, BackgroundEstimator, CausalBackground, shared_gain
from flgpr.clutter.suppression import Suppression, suppress_by_model
from flgpr.clutter.whitening import ClutterWhitener, whitening_matrix

__all__ = [
    "Background",
    "BackgroundEstimator",
    "CausalBackground",
    "ClutterWhitener",
    "Suppression",
    "gain_background",
    "remove_background",
    "scan_gain",
    "self_signature",
    "shared_gain",
    "suppress_by_model",
    "whitening_matrix",
]
