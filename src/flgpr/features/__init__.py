"""From images and alarms to features."""

from flgpr.features.contrast import PatchShape, local_contrast

__all__ = ["PatchShape", "local_contrast"]
