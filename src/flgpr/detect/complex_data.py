"""Validation of complex samples, which scikit-learn's own validation refuses."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from sklearn.base import BaseEstimator
from sklearn.utils.validation import validate_data


def check_samples(estimator: BaseEstimator, X: Any, reset: bool) -> NDArray[Any]:
    """Check samples that may be complex and note their number of features on the estimator.

    Parameters
    ----------
    estimator : BaseEstimator
        Gets ``n_features_in_`` when ``reset`` is true, is compared with it otherwise.
    X : (n_samples, n_features) array_like
        Real or complex samples.
    reset : bool
        Whether this is a fit.

    Returns
    -------
    (n_samples, n_features) ndarray of float64 or complex128
        The samples.

    Raises
    ------
    ValueError
        If ``X`` is not two-dimensional, holds too few samples, another number of features, or values that are not
        finite.
    """
    if not np.iscomplexobj(np.asarray(X)):
        return np.asarray(validate_data(estimator, X, reset=reset, dtype=np.float64))
    values = np.asarray(X, dtype=np.complex128)
    real = validate_data(estimator, values.real, reset=reset, dtype=np.float64)
    imaginary = validate_data(estimator, values.imag, reset=False, dtype=np.float64)
    return np.asarray(real + 1j * imaginary)
