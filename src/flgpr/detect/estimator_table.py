"""The estimators that a recipe may name as its detector. None of them is loaded here.

Estimators come with the package or from another distribution, which offers a mapping of names to
:class:`Estimator` by an entry point of the group "flgpr.estimators".
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from importlib import import_module
from importlib.metadata import entry_points
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from flgpr.detect.scorers.checks import StoredScorer

GROUP = "flgpr.estimators"
"""Group of the entry points of estimators."""


@dataclass(frozen=True)
class Estimator:
    """What is known of an estimator before it is trained.

    Classes are named as "module:Class". Only training loads the first; a model holds arrays and
    settings, which the second reads.
    """

    trained: str  #: class that is trained, with ``fit``
    scorer: str  #: class of ``flgpr.detect.scorers`` that scores with what was learnt
    #: whether it reads features in groups: each entry of a detector's ``features`` is one
    grouped: bool = False
    outward: bool = False  #: whether its scores grow with what is unlike the examples
    least: int = 1  #: examples that it needs
    #: whose distance it scores by, unless the option "n_neighbors" says otherwise; it then needs
    #: one example more
    neighbours: int = 0
    needs: str = ""  #: library that flgpr does not bring along, and how it is installed


_MACHINES = "flgpr.detect.scorers.kernel_machines"
_LINEAR = "flgpr.detect.scorers.linear:LinearScorer"
PACKAGED = {
    "rvm": Estimator("flgpr.detect.rvm:RelevanceVectorClassifier", f"{_MACHINES}:RelevanceScorer"),
    "one-class-rvm": Estimator(
        "flgpr.detect.one_class:OneClassRelevanceVectorMachine",
        f"{_MACHINES}:OneClassRelevanceScorer",
    ),
    "svm": Estimator("sklearn.svm:SVC", f"{_MACHINES}:VectorScorer"),
    "one-class-svm": Estimator("sklearn.svm:OneClassSVM", f"{_MACHINES}:VectorScorer"),
    "logistic": Estimator("sklearn.linear_model:LogisticRegression", _LINEAR),
    "lda": Estimator("sklearn.discriminant_analysis:LinearDiscriminantAnalysis", _LINEAR, least=3),
}
"""Estimators of the package by the names that recipes use."""


@cache
def known_estimators() -> Mapping[str, Estimator]:
    """Return the estimators of the package and those that other distributions offer, by name."""
    known = dict(PACKAGED)
    for entry_point in entry_points(group=GROUP):
        offered: Mapping[str, Estimator] = entry_point.load()
        for name, estimator in offered.items():
            known.setdefault(name, estimator)
    return known


def find_estimator(name: str) -> Estimator:
    """Find an estimator by its name in recipes; another name is a ValueError."""
    if name in PACKAGED:
        return PACKAGED[name]
    known = known_estimators()
    if name not in known:
        raise ValueError(f"estimator must be one of {', '.join(known)}, got {str(name)[:60]!r}")
    return known[name]


def trained_class(name: str) -> Any:
    """Load the class of an estimator that is trained, by its name in recipes.

    Raises
    ------
    ModuleNotFoundError
        If it comes from a library that is not installed.
    """
    estimator = find_estimator(name)
    try:
        return _load(estimator.trained)
    except ModuleNotFoundError as error:
        if not estimator.needs:
            raise
        raise ModuleNotFoundError(f"estimator {name} needs {estimator.needs}") from error


def scorer_class(name: str) -> type[StoredScorer]:
    """Load the class that scores with what an estimator has learnt, by its name in recipes."""
    scorer: type[StoredScorer] = _load(find_estimator(name).scorer)
    return scorer


def _load(path: str) -> Any:
    """Load a class by its "module:Class"."""
    module, _, name = path.partition(":")
    return getattr(import_module(module), name)
