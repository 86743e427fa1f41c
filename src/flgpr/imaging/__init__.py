"""From runs to images: the imaging operator and its use scan by scan."""

from flgpr.imaging.operator import ImagingOperator

__all__ = ["ImagingOperator"]
