"""From features or images to scores: the estimators."""

from flgpr.detect.one_class import OneClassRelevanceVectorMachine
from flgpr.detect.one_class_mixture import GaussianMixtureNovelty
from flgpr.detect.rvm import RelevanceVectorClassifier, leave_one_out

__all__ = [
    "GaussianMixtureNovelty",
    "OneClassRelevanceVectorMachine",
    "RelevanceVectorClassifier",
    "leave_one_out",
]
