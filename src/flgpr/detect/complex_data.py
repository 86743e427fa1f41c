"""Validation of complex samples, which scikit-learn's own validation refuses."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from sklearn.base import BaseEstimator
from sklearn.utils.validation import validate_data


def check_samples(estimator: BaseEstimator, X: Any, reset: bool) -> NDArray[Any]:
    """Check samples (n_samples, n_features) that may be complex, and give them in double precision.

    A fit resets ``n_features_in_`` of the estimator; otherwise the samples must have as many.
    """
    if not np.iscomplexobj(np.asarray(X)):
        return np.asarray(validate_data(estimator, X, reset=reset, dtype=np.float64))
    values = np.asarray(X, dtype=np.complex128)
    real = validate_data(estimator, values.real, reset=reset, dtype=np.float64)
    imaginary = validate_data(estimator, values.imag, reset=False, dtype=np.float64)
    return np.asarray(real + 1j * imaginary)
