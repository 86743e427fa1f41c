from flgpr.imaging.operator import ImagingOperator
from flgpr.imaging.scan import ScanImager, count_looks

__all__ = ["ImagingOperator", "ScanImager", "count_looks"]
