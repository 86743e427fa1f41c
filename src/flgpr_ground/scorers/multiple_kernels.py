"""Scores of a support vector machine on a weighted sum of kernels, one for a group of features."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Self

import numpy as np

from flgpr.detect.scorers.checks import Checked, StoredScorer, refuse_unless
from flgpr.detect.scorers.kernel_machines import rbf_values, score_in_blocks
from flgpr.types import FloatArray, IntArray, floats


@dataclass(frozen=True)
class MultipleKernelScorer(StoredScorer):
    """Compute ``Σ_n a_n Σ_m θ_m exp(-γ_m |x_m - x_nm|²) + b``."""

    vectors: FloatArray  #: (n_vectors, n_features) x_n
    weight: FloatArray  #: (n_vectors,) a_n
    group: IntArray  #: (n_features,) number m of the kernel that reads a feature
    kernel_weight: FloatArray  #: (n_groups,) θ_m
    gamma: FloatArray  #: (n_groups,) γ_m
    intercept: float  #: b
    threshold: float = 0.0

    def __call__(self, X: FloatArray) -> FloatArray:
        """Score samples (n_samples, n_features)."""
        return score_in_blocks(self._score, X, len(self.weight))

    def _score(self, X: FloatArray) -> FloatArray:
        """Score samples that are few enough for their kernel matrices to be in memory."""
        score = np.full(len(X), self.intercept)
        for number in np.flatnonzero(self.kernel_weight):
            columns = np.flatnonzero(self.group == number)
            kernel = rbf_values(X[:, columns], self.vectors[:, columns], self.gamma[number])
            score += self.kernel_weight[number] * (kernel @ self.weight)
        return score

    @classmethod
    def of(cls, estimator: Any) -> Self:
        """Return the scorer of a fitted machine."""
        groups = estimator.groups_
        return cls(
            floats(estimator.support_vectors_),
            floats(estimator.dual_coef_),
            np.repeat(np.arange(len(groups)), groups).astype(np.int64),
            floats(estimator.kernel_weights_),
            floats(estimator.gamma_),
            float(estimator.intercept_),
        )

    @classmethod
    def taken(cls, checked: Checked, features: int) -> Self:
        """Return the scorer of a file's settings and arrays.

        Every feature belongs to a kernel that is there, and neither weights nor widths of kernels
        are negative.
        """
        weight = checked.array("weight", (None,))
        vectors = checked.array("vectors", (len(weight), features))
        group = checked.array("group", (features,), np.int64)
        kernel_weight = checked.array("kernel_weight", (None,))
        gamma = checked.array("gamma", (len(kernel_weight),))
        scorer = cls(vectors, weight, group, kernel_weight, gamma, checked.number("intercept"))
        count = len(kernel_weight)
        rule = f"array 'kernel_weight' must be of 1 to {features}"
        refuse_unless(1 <= count <= features, rule, count)
        known = bool(((group >= 0) & (group < count)).all())
        refuse_unless(known, f"array 'group' must be from 0 to {count - 1}", group.tolist())
        for name, values in (("kernel_weight", kernel_weight), ("gamma", gamma)):
            lowest = float(values.min())
            refuse_unless(lowest >= 0, f"array {name!r} must not be negative", lowest)
        return scorer
