"""Histogram specification to a truncated normal distribution (Wang et al. 2007, Sec. II-E, corrected)."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import ndtr, ndtri
from sklearn.base import BaseEstimator, OneToOneFeatureMixin, TransformerMixin
from sklearn.utils.validation import _check_sample_weight, check_is_fitted, validate_data

FloatArray = NDArray[np.float64]


class HistogramNormalizer(OneToOneFeatureMixin, TransformerMixin, BaseEstimator):  # type: ignore[misc]
    """Give every feature the distribution of a standard normal variable cut off at -1 and +1.

    With the N training values sorted, duplicates counted as often as they occur, the k-th goes to
    ``b_k = Φ⁻¹(Φ(-1) + (k-1)/(N-1)·(Φ(1) - Φ(-1)))``, so that b_1 = -1 and b_N = +1; equal values share the mean of
    their b. (The paper's pseudo-code takes the density at the old value instead of the new one and lacks a factor 2.)
    Between training values the map is linear; beyond them it goes on along the line through the two end pairs.
    ``knots_`` holds per feature the values a (rising) and the b they go to, (2, n).

    Examples
    --------
    >>> import numpy as np
    >>> from flgpr.detect import HistogramNormalizer
    >>> training = np.array([[1.0], [2.0], [4.0], [100.0]])
    >>> HistogramNormalizer().fit(training).transform(training).round(2).ravel()  # ranks alone count
    array([-1.  , -0.29,  0.29,  1.  ])
    """

    def fit(
        self,
        X: ArrayLike,
        y: Any = None,  # noqa: ARG002
        sample_weight: ArrayLike | None = None,
    ) -> HistogramNormalizer:
        """Learn the map from values (sample, feature); whole-numbered weights say how often each counts."""
        values: FloatArray = validate_data(self, X, dtype=np.float64)
        weight = _check_sample_weight(sample_weight, values, dtype=np.float64, ensure_non_negative=True)
        if (weight != np.rint(weight)).any():
            raise ValueError("sample_weight must hold whole numbers: how often each sample counts")
        if not weight.any():
            raise ValueError("sample_weight must not be zero for all samples")
        self.knots_ = [_knots(column, weight) for column in values.T]
        return self

    def transform(self, X: ArrayLike) -> FloatArray:
        """Apply the map; training values come to lie in [-1, 1]."""
        check_is_fitted(self)
        values: FloatArray = validate_data(self, X, dtype=np.float64, reset=False)
        columns = [_follow(column, knots) for column, knots in zip(values.T, self.knots_, strict=True)]
        return np.stack(columns, axis=1)


def _knots(values: FloatArray, weight: FloatArray) -> FloatArray:
    a, group = np.unique(values[weight > 0], return_inverse=True)
    count = np.bincount(group, weight[weight > 0]).astype(np.int64)
    total = int(count.sum())
    level = np.arange(total) / max(total - 1, 1) if total > 1 else np.array([0.5])
    b = ndtri(ndtr(-1.0) + level * (ndtr(1.0) - ndtr(-1.0)))
    start = np.concatenate([[0], np.cumsum(count)[:-1]])
    return np.stack([a, np.add.reduceat(b, start) / count])


def _follow(values: FloatArray, knots: FloatArray) -> FloatArray:
    a, b = knots
    if a.size == 1:
        return np.full(values.shape, b[0])
    result = np.interp(values, a, b)
    for outside, i, j in ((values < a[0], 0, 1), (values > a[-1], -1, -2)):
        gap = a[i] - a[j]
        result[outside] = b[i] + (values[outside] - a[i]) * ((b[i] - b[j]) / gap)
    return result
