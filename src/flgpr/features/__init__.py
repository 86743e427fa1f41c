"""From alarms to numbers: patches, local contrast, ratios and polarimetric decompositions."""

from flgpr.features.alarm_features import FEATURES, POLARIMETRIC, FeatureSettings, FeatureSums
from flgpr.features.contrast import PatchShape, local_contrast
from flgpr.features.polarimetry import cameron, entropy_alpha

__all__ = [
    "FEATURES",
    "POLARIMETRIC",
    "FeatureSettings",
    "FeatureSums",
    "PatchShape",
    "cameron",
    "entropy_alpha",
    "local_contrast",
]
