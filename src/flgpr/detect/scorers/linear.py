"""Scores that are linear in the features: logistic regression and linear discriminant analysis."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Self

import numpy as np

from flgpr.detect.scorers.checks import Checked, StoredScorer, refuse_unless
from flgpr.types import Entries, FloatArray


@dataclass(frozen=True)
class LinearScorer(StoredScorer):
    """Compute ``w · x + b``: for a logistic regression the log odds of a mine."""

    weight: FloatArray  #: (n_features,) w
    intercept: float  #: b
    #: whether examples weighed alike, so that the log odds are those of the examples' frequencies
    unweighted: bool
    threshold: float = 0.0

    def __call__(self, X: FloatArray) -> FloatArray:
        """Score samples (n_samples, n_features)."""
        return np.asarray(X @ self.weight + self.intercept)

    def settings(self) -> Entries:
        """Return the intercept, and whether examples weighed alike."""
        return {"intercept": self.intercept, "plain": self.unweighted}

    @classmethod
    def of(cls, estimator: Any) -> Self:
        """Return the scorer of a fitted estimator of two classes."""
        shape = estimator.coef_.shape
        refuse_unless(shape[0] == 1, "estimator must part two classes", shape)
        weight = np.array(estimator.coef_[0], dtype=np.float64)
        intercept = float(np.ravel(estimator.intercept_)[0])
        unweighted = getattr(estimator, "class_weight", None) is None
        return cls(weight, intercept, unweighted)

    @classmethod
    def taken(cls, checked: Checked, features: int) -> Self:
        """Return the scorer of a file's settings and arrays."""
        return cls(
            checked.array("weight", (features,)),
            checked.number("intercept"),
            checked.flag("plain"),
        )
