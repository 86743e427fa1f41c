"""From images and alarms to features."""

from flgpr.features.contrast import PatchShape, local_contrast
from flgpr.features.range_cuts import clean_pixels, clutter_cuts, cuts_at, quiet_pixels, range_cuts, stack_channels

__all__ = [
    "PatchShape",
    "clean_pixels",
    "clutter_cuts",
    "cuts_at",
    "local_contrast",
    "quiet_pixels",
    "range_cuts",
    "stack_channels",
]
