"""From alarms to numbers: patches, local contrast, ratios and polarimetric decompositions."""

from flgpr.features.alarm_features import FEATURES, POLARIMETRIC, FeatureSettings, FeatureSums
from flgpr.features.contrast import PatchShape, local_contrast
from flgpr.features.polarimetry import cameron, entropy_alpha
from flgpr.features.range_cuts import clean_pixels, clutter_cuts, cuts_at, quiet_pixels, range_cuts, stack_channels

__all__ = [
    "FEATURES",
    "POLARIMETRIC",
    "FeatureSettings",
    "FeatureSums",
    "PatchShape",
    "cameron",
    "clean_pixels",
    "clutter_cuts",
    "cuts_at",
    "entropy_alpha",
    "local_contrast",
    "quiet_pixels",
    "range_cuts",
    "stack_channels",
]
