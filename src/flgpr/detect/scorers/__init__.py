"""Scores of trained estimators from named arrays, a few settings, and plain arithmetic.

An estimator is trained by the library that it comes from. What its scores depend on is then
extracted: arrays of numbers, and settings that JSON can hold. Scores are computed from these alone.
So a model file needs no library to be read, holds nothing that could run, and scores the same
whichever version of a library trained it.
"""

from __future__ import annotations

from collections.abc import Mapping
from importlib import import_module
from typing import Any

from flgpr.detect.scorers.checks import Arrays, StoredScorer

_SCORERS = {
    "rvm": "kernel_machines:RelevanceScorer",
    "one-class-rvm": "kernel_machines:OneClassRelevanceScorer",
    "svm": "kernel_machines:VectorScorer",
    "one-class-svm": "kernel_machines:VectorScorer",
    "mkl": "multiple_kernels:MultipleKernelScorer",
    "logistic": "linear:LinearScorer",
    "lda": "linear:LinearScorer",
    "random-forest": "trees:ForestScorer",
    "gradient-boosting": "trees:BoostedScorer",
    "isolation-forest": "trees:IsolationScorer",
    "mixture": "densities:MixtureScorer",
    "ecod": "densities:TailScorer",
    "copod": "densities:CopulaScorer",
    "knn": "densities:NeighbourScorer",
}
"""Scorers by the name of their estimator in recipes."""


def scorer_class(name: str) -> type[StoredScorer]:
    """Return the scorer's class of an estimator, by its name in recipes.

    Another name is a ValueError.
    """
    if name not in _SCORERS:
        raise ValueError(f"estimator must be one of {', '.join(_SCORERS)}, got {str(name)[:60]!r}")
    module, _, class_name = _SCORERS[name].partition(":")
    scorer: type[StoredScorer] = getattr(
        import_module(f"flgpr.detect.scorers.{module}"), class_name
    )
    return scorer


def scorer_of(name: str, estimator: Any) -> StoredScorer:
    """Return the scorer of a fitted estimator; one that it cannot represent is a ValueError."""
    return scorer_class(name).of(estimator)


def restored_scorer(
    name: str, settings: Mapping[str, Any], arrays: Arrays, features: int
) -> StoredScorer:
    """Return the scorer that a file holds.

    What breaks a rule of its estimator is a ValueError.
    """
    return scorer_class(name).restored(settings, arrays, features)
