"""Scores that are sums of kernels on training examples: support and relevance vector machines."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Self

import numpy as np

from flgpr.detect.scorers.checks import Checked, StoredScorer, refuse_unless
from flgpr.types import FloatArray

KERNELS = ("linear", "rbf", "laplacian", "poly", "sigmoid")
_VALUES_AT_ONCE = 2**22  # of a kernel matrix, in memory


@dataclass(frozen=True)
class KernelSum:
    """Terms of ``Σ a_n K(x, x_n) + b`` over vectors x_n."""

    vectors: FloatArray  #: (n_vectors, n_features) x_n
    weight: FloatArray  #: (n_vectors,) a_n
    intercept: float  #: b
    kernel: str
    gamma: float
    degree: float
    coef0: float

    def matrix(self, X: FloatArray) -> FloatArray:
        """Evaluate the kernel (n_samples, n_vectors)."""
        if self.kernel in ("rbf", "laplacian"):
            power = 2 if self.kernel == "rbf" else 1
            return rbf_values(X, self.vectors, self.gamma, power)
        product = X @ self.vectors.T
        if self.kernel == "linear":
            return np.asarray(product)
        shifted = self.gamma * product + self.coef0
        if self.kernel == "sigmoid":
            return np.asarray(np.tanh(shifted))
        return np.asarray(shifted**self.degree)

    @classmethod
    def of(cls, estimator: Any, vectors: Any, weight: Any, intercept: float, gamma: float) -> Self:
        """Return the terms of a fitted machine with one of the ``KERNELS``."""
        kernel = estimator.kernel
        known = isinstance(kernel, str) and kernel in KERNELS
        refuse_unless(known, f"kernel must be one of {', '.join(KERNELS)} for a detector", kernel)
        return cls(
            np.array(vectors, dtype=np.float64),
            np.array(np.ravel(weight), dtype=np.float64),
            float(intercept),
            str(kernel),
            float(gamma),
            float(estimator.degree),
            float(estimator.coef0),
        )

    @classmethod
    def taken(cls, checked: Checked, features: int) -> Self:
        """Return the terms of a file's settings and arrays."""
        weight = checked.array("weight", (None,))
        return cls(
            checked.array("vectors", (len(weight), features)),
            weight,
            checked.number("intercept"),
            checked.choice("kernel", KERNELS),
            checked.number("gamma", 0.0),
            checked.number("degree", 0.0, 100.0),
            checked.number("coef0"),
        )


def rbf_values(X: FloatArray, vectors: FloatArray, gamma: float, power: int = 2) -> FloatArray:
    """Evaluate ``exp(-γ Σ |x_i - z_i|^power)`` of samples and vectors.

    Parameters
    ----------
    X : (n_samples, n_features) ndarray
        Samples.
    vectors : (n_vectors, n_features) ndarray
        Vectors.
    gamma : float
        γ.
    power : {2, 1}
        2 makes the RBF kernel, 1 the Laplacian one.

    Returns
    -------
    (n_samples, n_vectors) ndarray
        Kernel matrix.
    """
    distance = np.zeros((len(X), len(vectors)))
    for feature in range(X.shape[1]):
        difference = X[:, feature, None] - vectors[:, feature]
        distance += difference**2 if power == 2 else np.abs(difference)
    return np.asarray(np.exp(-gamma * distance))


def score_in_blocks(score: Any, X: FloatArray, vectors: int) -> FloatArray:
    """Score samples in blocks, so that no kernel matrix grows with their number."""
    if not len(X):
        return np.zeros(0)
    samples_at_once = max(1, _VALUES_AT_ONCE // max(vectors, 1))
    scores = []
    for begin in range(0, len(X), samples_at_once):
        scores.append(score(X[begin : begin + samples_at_once]))
    return np.concatenate(scores)


@dataclass(frozen=True)
class VectorScorer(StoredScorer):
    """Compute the decision function of a support vector machine, of two classes or of one."""

    terms: KernelSum
    threshold: float = 0.0

    def __call__(self, X: FloatArray) -> FloatArray:
        """Score samples (n_samples, n_features)."""
        return score_in_blocks(self._score, X, len(self.terms.weight))

    def _score(self, X: FloatArray) -> FloatArray:
        """Score samples that are few enough for their kernel matrix to be in memory."""
        return np.asarray(self.terms.matrix(X) @ self.terms.weight + self.terms.intercept)

    @classmethod
    def of(cls, estimator: Any) -> Self:
        """Return the scorer of a fitted machine."""
        weight = estimator.dual_coef_
        refuse_unless(weight.shape[0] == 1, "estimator must part two classes", weight.shape)
        intercept = float(np.ravel(estimator.intercept_)[0])
        vectors = estimator.support_vectors_
        return cls(KernelSum.of(estimator, vectors, weight, intercept, estimator._gamma))

    @classmethod
    def taken(cls, checked: Checked, features: int) -> Self:
        """Return the scorer of a file's settings and arrays."""
        return cls(KernelSum.taken(checked, features))


@dataclass(frozen=True)
class RelevanceScorer(StoredScorer):
    """Compute the log odds of a relevance vector machine.

    They are averaged over the weights' posterior if the machine is moderated.
    """

    terms: KernelSum
    #: (n_weights, n_weights) posterior covariance of the weights, the bias last if it has one
    covariance: FloatArray
    #: whether log odds m become m / sqrt(1 + π s²/8) with their variance s² (MacKay 1992)
    moderated: bool
    bias: bool  #: whether the intercept is a weight with a variance
    threshold: float = 0.0

    def __call__(self, X: FloatArray) -> FloatArray:
        """Score samples (n_samples, n_features)."""
        return score_in_blocks(self.log_odds, X, len(self.terms.weight))

    def log_odds(self, X: FloatArray) -> FloatArray:
        """Return the log odds of a mine (n_samples,)."""
        basis = self.terms.matrix(X)
        mean = basis @ self.terms.weight + self.terms.intercept
        if not self.moderated:
            return np.asarray(mean)
        if self.bias:
            basis = np.hstack([basis, np.ones((len(basis), 1))])
        variance = np.sum((basis @ self.covariance) * basis, axis=1)
        return np.asarray(mean / np.sqrt(1 + np.pi * np.maximum(variance, 0.0) / 8))

    @classmethod
    def of(cls, estimator: Any) -> Self:
        """Return the scorer of a fitted machine."""
        terms = KernelSum.of(
            estimator,
            estimator.relevance_vectors_,
            estimator.dual_coef_,
            estimator.intercept_,
            estimator.gamma_,
        )
        covariance = np.array(estimator.covariance_, dtype=np.float64)
        return cls(terms, covariance, bool(estimator.moderated), bool(estimator._has_bias))

    @classmethod
    def taken(cls, checked: Checked, features: int) -> Self:
        """Return the scorer of settings and arrays that may hold more."""
        terms = KernelSum.taken(checked, features)
        moderated = checked.flag("moderated")
        bias = checked.flag("bias")
        weights = len(terms.weight) + bias
        return cls(terms, checked.array("covariance", (weights, weights)), moderated, bias)


@dataclass(frozen=True)
class OneClassRelevanceScorer(StoredScorer):
    """Compute the probability of a mine by a one-class relevance vector machine.

    The least probability that it calls a mine is subtracted.
    """

    machine: RelevanceScorer
    own_centre: FloatArray  #: (n_features,) subtracted from the features before the kernel
    own_scale: FloatArray  #: (n_features,) by which they are then divided
    offset: float  #: least probability that it calls a mine
    threshold: float = 0.0

    def __call__(self, X: FloatArray) -> FloatArray:
        """Score samples (n_samples, n_features)."""
        log_odds = self.machine((X - self.own_centre) / self.own_scale)
        return np.asarray(logistic(log_odds) - self.offset)

    @classmethod
    def of(cls, estimator: Any) -> Self:
        """Return the scorer of a fitted machine."""
        centre = np.array(estimator.center_, dtype=np.float64)
        scale = np.array(estimator.scale_, dtype=np.float64)
        return cls(RelevanceScorer.of(estimator), centre, scale, float(estimator.offset_))

    @classmethod
    def taken(cls, checked: Checked, features: int) -> Self:
        """Return the scorer of a file's settings and arrays."""
        machine = RelevanceScorer.taken(checked, features)
        centre = checked.array("own_centre", (features,))
        scale = checked.array("own_scale", (features,))
        smallest = float(scale.min(initial=1.0))
        refuse_unless(bool((scale > 0).all()), "array 'own_scale' must be positive", smallest)
        return cls(machine, centre, scale, checked.number("offset"))


def logistic(x: FloatArray) -> FloatArray:
    """Return ``1 / (1 + exp(-x))`` without overflow."""
    small = np.exp(-np.abs(x))
    return np.asarray(np.where(x >= 0, 1 / (1 + small), small / (1 + small)))
