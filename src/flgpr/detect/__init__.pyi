from flgpr.detect.chip_detector import ChipDetector
from flgpr.detect.deflection import DeflectionDetector, deflection_form
from flgpr.detect.fisher import FisherDiscriminant
from flgpr.detect.linear_quadratic import LinearQuadraticForm
from flgpr.detect.neyman_pearson import NeymanPearsonDetector, neyman_pearson_form
from flgpr.detect.normalizer import HistogramNormalizer
from flgpr.detect.one_class import OneClassRelevanceVectorMachine
from flgpr.detect.one_class_mixture import GaussianMixtureNovelty
from flgpr.detect.polarimetric_whitening import PolarimetricWhiteningFilter, magnitude_form
from flgpr.detect.rvm import RelevanceVectorClassifier, leave_one_out
from flgpr.detect.search import Fold, SearchStep, forward_search, make_fold, single_features
from flgpr.detect.weights import hit_weights

__all__ = [
    "ChipDetector",
    "DeflectionDetector",
    "FisherDiscriminant",
    "Fold",
    "GaussianMixtureNovelty",
    "HistogramNormalizer",
    "LinearQuadraticForm",
    "NeymanPearsonDetector",
    "OneClassRelevanceVectorMachine",
    "PolarimetricWhiteningFilter",
    "RelevanceVectorClassifier",
    "SearchStep",
    "deflection_form",
    "forward_search",
    "hit_weights",
    "leave_one_out",
    "magnitude_form",
    "make_fold",
    "neyman_pearson_form",
    "single_features",
]
