"""Detectors that know no target: the polarimetric whitening filter and the magnitude of one channel."""

from __future__ import annotations

from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray
from sklearn.base import BaseEstimator
from sklearn.utils.validation import check_is_fitted

from flgpr.detect.complex_data import check_samples
from flgpr.detect.linear_quadratic import LinearQuadraticForm
from flgpr.kernels.moments import ESTIMATORS


class PolarimetricWhiteningFilter(BaseEstimator):  # type: ignore[misc]
    """Energy of a pixel after its polarizations are decorrelated: ``x^H Σ^-1 x`` (Novak et al. 1993).

    Σ, ``covariance_``, is the second moment of clutter pixels, as the clutter is taken to have no mean. Any set of
    polarizations will do; Cosgrove et al. 2004 (Sec. III-C and IV-B) use HH and VV. The form, for chips of one pixel,
    is the only one in ``forms_``.

    Parameters
    ----------
    moments : {"sample", "ledoit-wolf", "oas", "robust", "clipped"}
        Estimator of Σ; all but "sample" estimate a mean, whose outer product is added.
    """

    def __init__(self, moments: str = "sample") -> None:
        self.moments = moments

    def fit(self, X: ArrayLike, y: ArrayLike | None = None) -> Self:  # noqa: ARG002
        """Learn the clutter from its pixels, (n_samples, n_features) with a feature per polarization."""
        if self.moments not in ESTIMATORS:
            raise ValueError(f"moments must be one of {', '.join(ESTIMATORS)}, got {self.moments!r}")
        samples = check_samples(self, X, reset=True)
        mean, covariance = ESTIMATORS[self.moments](samples)
        self.covariance_: NDArray[Any] = covariance + np.outer(mean, mean.conj())
        values, vectors = np.linalg.eigh(self.covariance_)
        if not values[0] > values.size * np.finfo(np.float64).eps * values[-1]:
            raise ValueError(
                f"X must span all {values.size} features for Σ to have an inverse, got n_samples = {samples.shape[0]} "
                f"with second moments from {values[0]:g} to {values[-1]:g}"
            )
        zero = np.zeros(values.size)
        self.forms_ = (LinearQuadraticForm(1 / values, vectors.T.copy(), zero, zero),)
        return self

    def decision_function(self, X: ArrayLike) -> NDArray[np.float64]:
        """Score pixels by their whitened energy, whose mean over the clutter is the number of polarizations."""
        check_is_fitted(self)
        return self.forms_[0](check_samples(self, X, reset=False))


def magnitude_form(channels: int, channel: int = 0) -> LinearQuadraticForm:
    """Form ``|x_channel|²`` on pixels of several channels: thresholding one polarization's image."""
    if not 0 <= channel < channels:
        raise ValueError(f"channel must be from 0 to {channels - 1}, got {channel}")
    return LinearQuadraticForm(np.ones(1), np.eye(channels)[[channel]], np.zeros(channels), np.zeros(1))
