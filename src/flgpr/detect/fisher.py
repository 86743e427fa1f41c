"""Fisher's linear discriminant (Wang et al. 2007, Eq. 20 and 21)."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from sklearn.base import BaseEstimator, ClassifierMixin
from sklearn.utils.multiclass import check_classification_targets, type_of_target
from sklearn.utils.validation import _check_sample_weight, check_is_fitted, validate_data

FloatArray = NDArray[np.float64]


class FisherDiscriminant(ClassifierMixin, BaseEstimator):  # type: ignore[misc]
    """Project samples onto ``y = (u2 - u1)·S_w⁻¹``, the direction that parts two classes best.

    u1 and u2 are the classes' means, S_w is the within-class scatter over the number of samples. Weights count as
    repetitions. Directions without scatter (a constant or repeated feature) take no part.

    Parameters
    ----------
    rcond : float
        Scatter along a direction below this share of the largest counts as none.

    Attributes
    ----------
    classes_ : (2,) ndarray
        The classes; the second (mines) has the higher mean score.
    direction_ : (feature,) ndarray
        y of Eq. 20.
    threshold_ : float
        Half-way between the classes' mean scores; :meth:`predict` parts there.

    Examples
    --------
    >>> import numpy as np
    >>> from flgpr.detect import FisherDiscriminant
    >>> rng = np.random.default_rng(0)
    >>> clutter, mines = rng.normal(0, 1, (200, 2)), rng.normal((2, 0), 1, (50, 2))  # the first feature tells
    >>> X, y = np.concatenate([clutter, mines]), np.repeat([0, 1], [200, 50])
    >>> machine = FisherDiscriminant().fit(X, y)
    >>> (machine.direction_ / np.abs(machine.direction_).sum()).round(1)
    array([0.9, 0.1])
    """

    def __init__(self, rcond: float = 1e-12) -> None:
        self.rcond = rcond

    def fit(self, X: ArrayLike, y: ArrayLike, sample_weight: ArrayLike | None = None) -> FisherDiscriminant:
        """Find the direction from values (sample, feature) of two classes; weights say how often each counts."""
        values, labels = validate_data(self, X, y, dtype=np.float64)
        check_classification_targets(labels)
        kind = type_of_target(labels, input_name="y", raise_unknown=True)
        if kind != "binary":
            raise ValueError(f"Only binary classification is supported. The type of the target is {kind}.")
        weight = _check_sample_weight(sample_weight, values, dtype=np.float64, ensure_non_negative=True)
        self.classes_, label = np.unique(labels, return_inverse=True)
        if self.classes_.size != 2 or not all(weight[label == k].sum() > 0 for k in (0, 1)):
            raise ValueError(f"y must hold two classes with weight, got one class: {self.classes_}")
        means, scatter = class_moments(values, label, weight)
        self.direction_ = _solve(scatter, means[1] - means[0], self.rcond)
        self.threshold_ = float(self.direction_ @ (means[0] + means[1]) / 2)
        return self

    def decision_function(self, X: ArrayLike) -> FloatArray:
        """Confidence: the projection onto the direction, positive on the second class's side of the border."""
        check_is_fitted(self)
        values: FloatArray = validate_data(self, X, dtype=np.float64, reset=False)
        return np.asarray(values @ self.direction_ - self.threshold_)

    def predict(self, X: ArrayLike) -> NDArray[Any]:
        """Say the class on whose side of the border each sample lies."""
        check_is_fitted(self)
        return np.asarray(self.classes_[(self.decision_function(X) > 0).astype(np.intp)])

    def __sklearn_tags__(self) -> Any:
        tags = super().__sklearn_tags__()
        tags.classifier_tags.multi_class = False
        return tags


def class_moments(X: FloatArray, label: NDArray[Any], weight: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Means of the classes 0 and 1 and the within-class scatter S_w, weighted (Wang et al. 2007, Eq. 21)."""
    means = np.stack([np.average(X[label == k], axis=0, weights=weight[label == k]) for k in (0, 1)])
    centred = X - means[label.astype(np.intp)]
    return means, (centred * weight[:, None]).T @ centred / weight.sum()


def _solve(scatter: FloatArray, difference: FloatArray, rcond: float) -> FloatArray:
    """Solve in the units of each feature's own spread, so that a feature's unit decides nothing."""
    spread = np.sqrt(np.diag(scatter))
    use = spread > 0
    direction = np.zeros(difference.size)
    if use.any():
        scale = spread[use]
        inverse = np.linalg.pinv(scatter[np.ix_(use, use)] / np.outer(scale, scale), rcond=rcond, hermitian=True)
        direction[use] = inverse @ (difference[use] / scale) / scale
    return direction
