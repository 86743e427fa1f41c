"""From images and alarms to features."""

from flgpr.features.contrast import PatchShape, local_contrast
from flgpr.features.registration import Registration, register_fiducials
from flgpr.features.templates import (
    clutter_tiles,
    cut_regions,
    max_correlation,
    mean_template,
    principal_templates,
    template_features,
)

__all__ = [
    "PatchShape",
    "Registration",
    "clutter_tiles",
    "cut_regions",
    "local_contrast",
    "max_correlation",
    "mean_template",
    "principal_templates",
    "register_fiducials",
    "template_features",
]
