from flgpr.imaging.aperture import aperture_blocks as aperture_blocks
from flgpr.imaging.aperture import aperture_image as aperture_image
from flgpr.imaging.looks import count_looks as count_looks
from flgpr.imaging.operator import ImagingOperator as ImagingOperator
from flgpr.imaging.scan import ScanImager as ScanImager
