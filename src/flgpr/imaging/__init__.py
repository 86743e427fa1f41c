"""From runs to images: the imaging operator and its use scan by scan."""

from flgpr.imaging.operator import ImagingOperator
from flgpr.imaging.scan import ScanImager

__all__ = ["ImagingOperator", "ScanImager"]
