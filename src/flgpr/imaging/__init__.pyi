from flgpr.imaging.aperture import aperture_blocks, aperture_image
from flgpr.imaging.looks import count_looks
from flgpr.imaging.operator import ImagingOperator
from flgpr.imaging.scan import ScanImager

__all__ = [
    "ImagingOperator",
    "ScanImager",
    "aperture_blocks",
    "aperture_image",
    "count_looks",
]
