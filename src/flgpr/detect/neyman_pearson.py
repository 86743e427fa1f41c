"""The Gaussian Neyman-Pearson detector with estimated moments (Cosgrove et al. 2004, Sec. II-A)."""

from __future__ import annotations

from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray
from sklearn.base import BaseEstimator
from sklearn.utils.validation import check_is_fitted

from flgpr.detect.complex_data import check_samples
from flgpr.detect.linear_quadratic import LinearQuadraticForm, as_moments
from flgpr.kernels.moments import ESTIMATORS, sample_moments


def neyman_pearson_form(mean: ArrayLike, covariance: ArrayLike, rank: int | None = None) -> LinearQuadraticForm:
    """Log-likelihood ratio of CN(μ, C + I) to CN(0, I), without its constant determinant.

    ``T = -(x-μ)^H (C+I)^-1 (x-μ) + x^H x = Σ λ_j/(1+λ_j) |u_j^H (x-μ)|² + 2 Re(μ^H x) - |μ|²`` with the eigenvalues λ
    and eigenvectors u of C (Cosgrove et al. 2004, Eq. 2): no large matrix is inverted. ``mean`` is μ, whitened, and
    ``covariance`` C, Hermitian with eigenvalues above -1; ``rank`` is the number of its eigenvectors kept, those of the
    largest eigenvalues, None for all.
    """
    mu, C = as_moments(mean, covariance)
    values, vectors = np.linalg.eigh(C)
    if values[0] <= -1:
        raise ValueError(f"covariance must have eigenvalues above -1, got {values[0]:g}")
    return _from_eigenvectors(mu, values[::-1][:rank], vectors[:, ::-1][:, :rank])


def _from_eigenvectors(mu: NDArray[Any], values: NDArray[np.float64], vectors: NDArray[Any]) -> LinearQuadraticForm:
    rows = vectors.T.copy()
    energy = float(np.sum(np.abs(mu) ** 2))
    return LinearQuadraticForm(values / (1 + values), rows, mu, rows.conj() @ mu, -energy)


class NeymanPearsonDetector(BaseEstimator):  # type: ignore[misc]
    """Gaussian likelihood ratio (Cosgrove et al. 2004, Eq. 2) with moments estimated from whitened target examples.

    The covariance of the examples less I estimates C. As a covariance has no negative eigenvalue, negative ones are set
    to zero; a low rank and shrinkage keep the inverse in Eq. 2 from following the noise of a few examples.

    Parameters
    ----------
    rank : int or None
        Number of eigenvectors of C kept; None keeps all positive ones.
    shrinkage : float
        Share by which the estimate of C is moved towards zero, from 0 to 1.
    ddof : int
        Divisor N - ddof of the covariance; 0 is maximum likelihood.
    moments : {"sample", "ledoit-wolf", "oas", "robust", "clipped"}
        Estimator of mean and covariance.

    Attributes
    ----------
    eigenvalues_ : (n_features,) ndarray
        Eigenvalues of the estimate of C from the largest down, before negative ones are set to zero.
    forms_ : tuple of LinearQuadraticForm
        The form.
    """

    def __init__(self, rank: int | None = 3, shrinkage: float = 0.0, ddof: int = 0, moments: str = "sample") -> None:
        self.rank = rank
        self.shrinkage = shrinkage
        self.ddof = ddof
        self.moments = moments

    def fit(self, X: ArrayLike, y: ArrayLike | None = None) -> Self:  # noqa: ARG002
        """Learn from whitened target examples (n_samples, n_features), real or complex; ``y`` is not used."""
        if self.rank is not None and self.rank < 0:
            raise ValueError(f"rank must be None or at least 0, got {self.rank}")
        if not 0 <= self.shrinkage <= 1:
            raise ValueError(f"shrinkage must lie between 0 and 1, got {self.shrinkage}")
        if self.moments not in ESTIMATORS:
            raise ValueError(f"moments must be one of {', '.join(ESTIMATORS)}, got {self.moments!r}")
        samples = check_samples(self, X, reset=True)
        if not 0 <= self.ddof < samples.shape[0]:
            raise ValueError(f"ddof must be from 0 to below n_samples = {samples.shape[0]}, got {self.ddof}")
        if self.moments == "sample":
            mean, covariance = sample_moments(samples, self.ddof)
        else:
            mean, covariance = ESTIMATORS[self.moments](samples)
        values, vectors = np.linalg.eigh(covariance - np.eye(mean.size))
        self.eigenvalues_ = values[::-1].copy()
        kept = np.flatnonzero(values > 0)[::-1][: self.rank]
        self.forms_ = (_from_eigenvectors(mean, (1 - self.shrinkage) * values[kept], vectors[:, kept]),)
        return self

    def decision_function(self, X: ArrayLike) -> NDArray[np.float64]:
        """Score whitened samples: the log-likelihood ratio up to a constant (Cosgrove et al. 2004, Eq. 2)."""
        check_is_fitted(self)
        return self.forms_[0](check_samples(self, X, reset=False))
