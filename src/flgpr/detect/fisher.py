"""Fisher's discriminant, histogram normalisation and weights of hits (Wang et al. 2007, II-E).

Misprints of the paper are corrected.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.special import ndtr, ndtri
from sklearn.base import BaseEstimator, ClassifierMixin, OneToOneFeatureMixin, TransformerMixin
from sklearn.utils.multiclass import check_classification_targets, type_of_target
from sklearn.utils.validation import _check_sample_weight, check_is_fitted, validate_data

from flgpr.types import AnyArray, ArrayLike, FloatArray, IntArray, floats


class FisherDiscriminant(ClassifierMixin, BaseEstimator):  # type: ignore[misc]
    """Project samples onto ``y = (u2 - u1)·S_w⁻¹``, the direction that separates two classes best.

    u1 and u2 are the classes' means, S_w is the within-class scatter over the number of samples.
    Weights count as repetitions. Directions without scatter (a constant or repeated feature) take
    no part.

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
        Half-way between the classes' mean scores, where :meth:`predict` decides.

    Examples
    --------
    >>> import numpy as np
    >>> from flgpr.detect import FisherDiscriminant
    >>> rng = np.random.default_rng(0)
    >>> clutter = rng.normal(0, 1, (200, 2))
    >>> mines = rng.normal((2, 0), 1, (50, 2))  # the first feature separates them
    >>> X = np.concatenate([clutter, mines])
    >>> machine = FisherDiscriminant().fit(X, np.repeat([0, 1], [200, 50]))
    >>> (machine.direction_ / np.abs(machine.direction_).sum()).round(1)
    array([0.9, 0.1])
    """

    def __init__(self, rcond: float = 1e-12) -> None:
        self.rcond = rcond

    def fit(
        self, X: ArrayLike, y: ArrayLike, sample_weight: ArrayLike | None = None
    ) -> FisherDiscriminant:
        """Fit the direction to samples of two classes.

        Parameters
        ----------
        X : (sample, feature) array_like
            Features.
        y : (sample,) array_like
            Classes.
        sample_weight : (sample,) array_like, optional
            How often each sample counts, by default once.

        Raises
        ------
        ValueError
            If there are not two classes with weight.
        """
        values, labels = validate_data(self, X, y, dtype=np.float64)
        check_classification_targets(labels)
        kind = type_of_target(labels, input_name="y", raise_unknown=True)
        if kind != "binary":
            raise ValueError(
                f"Only binary classification is supported. The type of the target is {kind}."
            )
        weight = _check_sample_weight(
            sample_weight, values, dtype=np.float64, ensure_non_negative=True
        )
        self.classes_, label = np.unique(labels, return_inverse=True)
        if self.classes_.size != 2 or not all(weight[label == k].sum() > 0 for k in (0, 1)):
            raise ValueError(f"y must hold two classes with weight, got one class: {self.classes_}")
        means, scatter = class_moments(values, label, weight)
        self.direction_ = _solve(scatter, means[1] - means[0], self.rcond)
        self.threshold_ = float(self.direction_ @ (means[0] + means[1]) / 2)
        return self

    def decision_function(self, X: ArrayLike) -> FloatArray:
        """Return the projection onto the direction, positive on the second class's side."""
        check_is_fitted(self)
        values: FloatArray = validate_data(self, X, dtype=np.float64, reset=False)
        return np.asarray(values @ self.direction_ - self.threshold_)

    def predict(self, X: ArrayLike) -> AnyArray:
        """Return the class on whose side of the threshold each sample lies."""
        check_is_fitted(self)
        return np.asarray(self.classes_[(self.decision_function(X) > 0).astype(np.intp)])

    def __sklearn_tags__(self) -> Any:
        tags = super().__sklearn_tags__()
        tags.classifier_tags.multi_class = False
        return tags


def class_moments(
    X: FloatArray, label: AnyArray, weight: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Compute the weighted means of two classes and their within-class scatter.

    Parameters
    ----------
    X : (sample, feature) ndarray
        Features.
    label : (sample,) ndarray
        Classes, 0 or 1.
    weight : (sample,) ndarray
        Weights of the samples.

    Returns
    -------
    means : (2, feature) ndarray
        Means of the classes.
    scatter : (feature, feature) ndarray
        S_w of Wang et al. 2007, Eq. 21.
    """
    mean_0 = np.average(X[label == 0], axis=0, weights=weight[label == 0])
    mean_1 = np.average(X[label == 1], axis=0, weights=weight[label == 1])
    means = np.stack([mean_0, mean_1])
    centred = X - means[label.astype(np.intp)]
    weighted = centred * weight[:, None]
    return means, weighted.T @ centred / weight.sum()


def _solve(scatter: FloatArray, difference: FloatArray, rcond: float) -> FloatArray:
    """Solve for the direction with every feature in units of its spread: units do not matter."""
    spread = np.sqrt(np.diag(scatter))
    varies = spread > 0
    direction = np.zeros(difference.size)
    if varies.any():
        scale = spread[varies]
        scaled = scatter[np.ix_(varies, varies)] / np.outer(scale, scale)
        inverse = np.linalg.pinv(scaled, rcond=rcond, hermitian=True)
        direction[varies] = inverse @ (difference[varies] / scale) / scale
    return direction


def hit_weights(
    target: ArrayLike,
    distance: ArrayLike,
    w0: float,
    beta: ArrayLike = 1.0,
    label_radius: float = 1.0,
) -> IntArray:
    """Return how often each alarm enters the training set (Wang et al. 2007, Eq. 18 and 19).

    It is W = max(1, round(W0·β·w)) for hits, 1 for false alarms. ``w`` divides a target's weight
    among its alarms in proportion to ``exp(-d²/r²)``; halves are rounded up.

    Parameters
    ----------
    target : (alarm,) array_like of int
        Number of the target that each alarm hits, -1 for a false alarm.
    distance : (alarm,) array_like
        Distance d to that target, m; not read for false alarms.
    w0 : float
        W0, number of false alarms per target.
    beta : float or (alarm,) array_like
        β: 1 for hits on mines, 0.5 for hits on simulants.
    label_radius : float
        r, r_label, the radius within which alarms were labelled hits, m.

    Returns
    -------
    (alarm,) ndarray of int
        W.

    Raises
    ------
    ValueError
        If the shapes differ, a parameter is negative, or a hit has no distance.

    Examples
    --------
    A false alarm, two hits of one mine, and a hit of another:

    >>> from flgpr.detect import hit_weights
    >>> hit_weights([-1, 0, 0, 1], [9.0, 0.0, 0.5, 1.0], w0=10)
    array([ 1,  6,  4, 10])
    """
    hit_of = np.asarray(target, dtype=np.int64)
    d = floats(distance)
    if hit_of.ndim != 1 or d.shape != hit_of.shape:
        raise ValueError(
            f"target and distance must have one entry per alarm, got {hit_of.shape} and {d.shape}"
        )
    factor = np.broadcast_to(floats(beta), hit_of.shape)
    if not (np.isfinite(w0) and w0 >= 0 and label_radius > 0 and (factor >= 0).all()):
        raise ValueError(
            "w0, beta must not be negative, label_radius positive, "
            f"got {w0}, {factor}, {label_radius}"
        )
    weights = np.ones(hit_of.size, np.int64)
    hit = hit_of >= 0
    if not hit.any():
        return weights
    if not (np.isfinite(d[hit]).all() and (d[hit] >= 0).all()):
        raise ValueError("distance must be finite and not negative for every hit")

    # w of Eq. 19: a hit's share of its target's weight.
    _, group = np.unique(hit_of[hit], return_inverse=True)
    proximity = np.exp(-((d[hit] / label_radius) ** 2))
    of_target = np.bincount(group, proximity)
    share = proximity / of_target[group]
    rounded = np.floor(w0 * factor[hit] * share + 0.5)
    weights[hit] = np.maximum(1, rounded.astype(np.int64))  # Eq. 18
    return weights


class HistogramNormalizer(OneToOneFeatureMixin, TransformerMixin, BaseEstimator):  # type: ignore[misc]
    """Map every feature to the distribution of a standard normal variable cut off at -1 and +1.

    With the N training values sorted, duplicates counted as often as they occur, the k-th goes to
    ``b_k = Φ⁻¹(Φ(-1) + (k-1)/(N-1)·(Φ(1) - Φ(-1)))``, so that b_1 = -1 and b_N = +1; equal values
    share the mean of their b. (The paper's pseudo-code takes the density at the old value instead
    of the new one and lacks a factor 2.) Between training values the map is linear; beyond them it
    continues along the line through the two end pairs. ``knots_`` holds per feature the rising
    values a and their b, (2, n).

    Examples
    --------
    >>> import numpy as np
    >>> from flgpr.detect import HistogramNormalizer
    >>> training = np.array([[1.0], [2.0], [4.0], [100.0]])
    >>> normalizer = HistogramNormalizer().fit(training)
    >>> normalizer.transform(training).round(2).ravel()  # ranks alone count
    array([-1.  , -0.29,  0.29,  1.  ])
    """

    def fit(
        self,
        X: ArrayLike,
        y: Any = None,  # noqa: ARG002
        sample_weight: ArrayLike | None = None,
    ) -> HistogramNormalizer:
        """Fit the map to values (sample, feature); whole weights say how often each counts."""
        values: FloatArray = validate_data(self, X, dtype=np.float64)
        weight = _check_sample_weight(
            sample_weight, values, dtype=np.float64, ensure_non_negative=True
        )
        if (weight != np.rint(weight)).any():
            raise ValueError("sample_weight must hold whole numbers: how often each sample counts")
        if not weight.any():
            raise ValueError("sample_weight must not be zero for all samples")
        self.knots_ = [_knots(column, weight) for column in values.T]
        return self

    def transform(self, X: ArrayLike) -> FloatArray:
        """Return the mapped values (sample, feature); those of training lie in [-1, 1]."""
        check_is_fitted(self)
        values: FloatArray = validate_data(self, X, dtype=np.float64, reset=False)
        columns = [
            _follow(column, knots) for column, knots in zip(values.T, self.knots_, strict=True)
        ]
        return np.stack(columns, axis=1)


def _knots(values: FloatArray, weight: FloatArray) -> FloatArray:
    """Return the values a of a feature and the b that they are mapped to, (2, n)."""
    a, group = np.unique(values[weight > 0], return_inverse=True)
    count = np.bincount(group, weight[weight > 0]).astype(np.int64)
    total = int(count.sum())
    level = np.array([0.5])
    if total > 1:
        level = np.arange(total) / max(total - 1, 1)
    b = ndtri(ndtr(-1.0) + level * (ndtr(1.0) - ndtr(-1.0)))
    # Equal values share the mean of their b.
    start = np.concatenate([[0], np.cumsum(count)[:-1]])
    mean_b = np.add.reduceat(b, start) / count
    return np.stack([a, mean_b])


def _follow(values: FloatArray, knots: FloatArray) -> FloatArray:
    """Map values by the knots: linear between them and along the end pairs beyond."""
    a, b = knots
    if a.size == 1:
        return np.full(values.shape, b[0])
    result = np.interp(values, a, b)
    for outside, i, j in ((values < a[0], 0, 1), (values > a[-1], -1, -2)):
        gap = a[i] - a[j]
        result[outside] = b[i] + (values[outside] - a[i]) * ((b[i] - b[j]) / gap)
    return result
