"""From features or images to scores: the estimators."""

from flgpr.detect.chip_detector import ChipDetector, load_detector
from flgpr.detect.deflection import DeflectionDetector, deflection_form
from flgpr.detect.linear_quadratic import LinearQuadraticForm
from flgpr.detect.neyman_pearson import NeymanPearsonDetector, neyman_pearson_form
from flgpr.detect.polarimetric_whitening import PolarimetricWhiteningFilter, magnitude_form

__all__ = [
    "ChipDetector",
    "DeflectionDetector",
    "LinearQuadraticForm",
    "NeymanPearsonDetector",
    "PolarimetricWhiteningFilter",
    "deflection_form",
    "load_detector",
    "magnitude_form",
    "neyman_pearson_form",
]
