"""From images to cleaned images: self-signature, gain background, model-based suppression."""

from flgpr.clutter.background import gain_background, remove_background, scan_gain, self_signature
from flgpr.clutter.suppression import Suppression, suppress_by_model

__all__ = [
    "Suppression",
    "gain_background",
    "remove_background",
    "scan_gain",
    "self_signature",
    "suppress_by_model",
]
