from flgpr.imaging.looks import count_looks
from flgpr.imaging.operator import ImagingOperator
from flgpr.imaging.scan import ScanImager

__all__ = ["ImagingOperator", "ScanImager", "count_looks"]
