"""From features to scores: the estimators and the search for features."""

from flgpr.detect.fisher import FisherDiscriminant
from flgpr.detect.forward_search import Fold, SearchStep, forward_search, make_fold, single_features
from flgpr.detect.normalizer import HistogramNormalizer
from flgpr.detect.weights import hit_weights

__all__ = [
    "FisherDiscriminant",
    "Fold",
    "HistogramNormalizer",
    "SearchStep",
    "forward_search",
    "hit_weights",
    "make_fold",
    "single_features",
]
