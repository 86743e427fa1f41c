"""Scores by the density of training examples: mixtures, tails, copulas and neighbours."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from scipy.special import logsumexp

from flgpr.detect.scorers.checks import Checked, StoredScorer, refuse_unless
from flgpr.types import FloatArray, floats

METHODS = ("largest", "mean", "median")
_DISTANCES_AT_ONCE = 2**22  # in memory


@dataclass(frozen=True)
class MixtureScorer(StoredScorer):
    """Compute the log density of a mixture of Gaussians, less the least that is called a mine."""

    own_centre: FloatArray  #: (n_features,) subtracted from the features first
    own_scale: FloatArray  #: (n_features,) by which they are then divided
    share: FloatArray  #: (n_components,) of the components, with the sum 1
    mean: FloatArray  #: (n_components, n_features)
    #: (n_components, n_features, n_features) R with R·Rᵀ the inverse covariance, triangular
    root: FloatArray
    offset: float
    threshold: float = 0.0

    def __call__(self, X: FloatArray) -> FloatArray:
        """Score samples.

        Parameters
        ----------
        X : (n_samples, n_features) ndarray
            Samples.

        Returns
        -------
        (n_samples,) ndarray
            Log density less the offset.
        """
        z = (X - self.own_centre) / self.own_scale
        logs = np.empty((len(z), len(self.share)))
        components = zip(self.share, self.mean, self.root, strict=True)
        for k, (share, mean, root) in enumerate(components):
            distance = np.sum(((z - mean) @ root) ** 2, axis=1)
            log_determinant = np.sum(np.log(np.diagonal(root)))  # of the root
            logs[:, k] = np.log(share) + log_determinant - distance / 2
        constant = z.shape[1] / 2 * math.log(2 * math.pi)
        return logsumexp(logs, axis=1) - constant - self.offset

    @classmethod
    def of(cls, estimator: Any) -> Self:
        """Return the scorer of a fitted mixture of any shape of covariance."""
        mixture = estimator.mixture_
        count, features = mixture.means_.shape
        roots = floats(mixture.precisions_cholesky_)
        if mixture.covariance_type == "tied":
            roots = np.broadcast_to(roots, (count, features, features))
        elif mixture.covariance_type in ("diag", "spherical"):
            roots = roots.reshape(count, -1, 1) * np.eye(features)
        arrays = (estimator.center_, estimator.scale_, mixture.weights_, mixture.means_, roots)
        centre, scale, share, mean, root = map(floats, arrays)
        return cls(centre, scale, share, mean, root, float(estimator.offset_))

    @classmethod
    def taken(cls, checked: Checked, features: int) -> Self:
        """Return the scorer of a file's settings and arrays.

        Shares, scales and the roots' diagonals must be positive.
        """
        share = checked.array("share", (None,))
        scorer = cls(
            checked.array("own_centre", (features,)),
            checked.array("own_scale", (features,)),
            share,
            checked.array("mean", (len(share), features)),
            checked.array("root", (len(share), features, features)),
            checked.number("offset"),
        )
        refuse_unless(len(share) > 0, "array 'share' must hold a component", len(share))
        diagonal = np.diagonal(scorer.root, axis1=1, axis2=2)
        for name, values in (("share", share), ("own_scale", scorer.own_scale), ("root", diagonal)):
            positive = bool((values > 0).all())
            refuse_unless(positive, f"array {name!r} must be positive", float(values.min()))
        return scorer


@dataclass(frozen=True)
class TailScorer(StoredScorer):
    """Compute how far a sample lies in the tails of every feature (ECOD, Li et al. 2022).

    A larger score is less like the examples. The tails are those of the training examples and the
    samples together, as in PyOD: a score depends on what else is scored with it.
    """

    examples: FloatArray  #: (n_examples, n_features)
    threshold: float

    def __call__(self, X: FloatArray) -> FloatArray:
        """Score samples (n_samples, n_features)."""
        if not len(X):
            return np.zeros(0)
        left, right, skewed = tail_logs(np.concatenate([self.examples, X]))
        scores = self._joined(left, right, skewed).sum(axis=1)
        return scores[-len(X) :]

    @staticmethod
    def _joined(left: FloatArray, right: FloatArray, skewed: FloatArray) -> FloatArray:
        """Combine the tails of every feature."""
        return np.maximum(skewed, np.maximum(left, right))

    @classmethod
    def of(cls, estimator: Any) -> Self:
        """Return the scorer of a fitted estimator of PyOD."""
        return cls(floats(estimator.X_train), float(estimator.threshold_))

    @classmethod
    def taken(cls, checked: Checked, features: int) -> Self:
        """Return the scorer of a file's settings and arrays."""
        return cls(checked.array("examples", (None, features)), checked.number("threshold"))


class CopulaScorer(TailScorer):
    """Compute how far a sample lies in the tails of the copula (COPOD, Li et al. 2020)."""

    @staticmethod
    def _joined(left: FloatArray, right: FloatArray, skewed: FloatArray) -> FloatArray:
        return np.maximum(skewed, (left + right) / 2)


def tail_logs(X: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return -log of the shares in the left tail, the right tail, and the one on the skewed side.

    The shares are of samples that are at most, and at least, as large, feature by feature (Li et
    al. 2022).

    Parameters
    ----------
    X : (n_samples, n_features) ndarray
        Samples.

    Returns
    -------
    left, right, skewed : (n_samples, n_features) ndarray
        Negative logarithms of the shares.
    """
    left, right = (-np.log(_share_up_to(values)) for values in (X, -X))
    side = np.sign(np.mean((X - X.mean(axis=0)) ** 3, axis=0))
    # A symmetric feature counts both tails.
    skewed = -left * np.sign(side - 1) + right * np.sign(side + 1)
    return left, right, skewed


def _share_up_to(X: FloatArray) -> FloatArray:
    """Return the share of samples that are at most as large, feature by feature."""
    columns = [np.searchsorted(np.sort(column), column, side="right") for column in X.T]
    return np.stack(columns, axis=1) / len(X)


@dataclass(frozen=True)
class NeighbourScorer(StoredScorer):
    """Compute the distance from the nearest training examples."""

    examples: FloatArray  #: (n_examples, n_features)
    neighbours: int  #: number of nearest examples that count
    method: str  #: "largest" of their distances, "mean" or "median"
    power: float  #: p of the Minkowski distance; infinity is written as 0
    threshold: float

    def __call__(self, X: FloatArray) -> FloatArray:
        """Score samples (n_samples, n_features)."""
        if not len(X):
            return np.zeros(0)
        samples_at_once = max(1, _DISTANCES_AT_ONCE // max(len(self.examples), 1))
        scores = [
            self._score(X[begin : begin + samples_at_once])
            for begin in range(0, len(X), samples_at_once)
        ]
        return np.concatenate(scores)

    def _score(self, X: FloatArray) -> FloatArray:
        """Score samples that are few enough for all their distances to be in memory."""
        nearest = np.sort(self._distances(X), axis=1)[:, : self.neighbours]
        if self.method == "largest":
            return nearest[:, -1]
        return nearest.mean(axis=1) if self.method == "mean" else np.median(nearest, axis=1)

    def _distances(self, X: FloatArray) -> FloatArray:
        """Return the distances (n_samples, n_examples)."""
        total = np.zeros((len(X), len(self.examples)))
        for feature in range(X.shape[1]):
            difference = np.abs(X[:, feature, None] - self.examples[:, feature])
            if self.power == 0:
                total = np.maximum(total, difference)
            else:
                total = total + difference**self.power
        return total if self.power == 0 else total ** (1 / self.power)

    @classmethod
    def of(cls, estimator: Any) -> Self:
        """Return the scorer of a fitted estimator of PyOD, with one of four metrics."""
        metric = estimator.metric
        powers = {"minkowski": estimator.p, "euclidean": 2, "manhattan": 1, "chebyshev": 0}
        known = isinstance(metric, str) and metric in powers and not estimator.metric_params
        refuse_unless(known, f"metric must be one of {', '.join(powers)} for a detector", metric)
        return cls(
            floats(estimator.neigh_._fit_X),
            int(estimator.n_neighbors),
            str(estimator.method),
            float(powers[metric]),
            float(estimator.threshold_),
        )

    @classmethod
    def taken(cls, checked: Checked, features: int) -> Self:
        """Return the scorer of a file's settings and arrays."""
        examples = checked.array("examples", (None, features))
        scorer = cls(
            examples,
            checked.whole("neighbours", 1, max(len(examples), 1)),
            checked.choice("method", METHODS),
            checked.number("power", 0.0, 100.0),
            checked.number("threshold"),
        )
        refuse_unless(len(examples) > 0, "array 'examples' must hold an example", len(examples))
        return scorer
