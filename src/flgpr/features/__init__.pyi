from flgpr.features.alarm_features import FEATURES, POLARIMETRIC, FeatureSettings, FeatureSums
from flgpr.features.contrast import ContrastSums, local_contrast
from flgpr.features.cuts import clean_pixels, clutter_cuts, cuts_at, quiet_pixels, range_cuts, stack_channels
from flgpr.features.patch import PatchShape
from flgpr.features.polarimetry import cameron, entropy_alpha
from flgpr.features.registration import Registration, register_fiducials
from flgpr.features.templates import (
    align_phases,
    clutter_tiles,
    cut_regions,
    max_correlation,
    mean_template,
    principal_templates,
    template_features,
)

__all__ = [
    "FEATURES",
    "POLARIMETRIC",
    "ContrastSums",
    "FeatureSettings",
    "FeatureSums",
    "PatchShape",
    "Registration",
    "align_phases",
    "cameron",
    "clean_pixels",
    "clutter_cuts",
    "clutter_tiles",
    "cut_regions",
    "cuts_at",
    "entropy_alpha",
    "local_contrast",
    "max_correlation",
    "mean_template",
    "principal_templates",
    "quiet_pixels",
    "range_cuts",
    "register_fiducials",
    "stack_channels",
    "template_features",
]
