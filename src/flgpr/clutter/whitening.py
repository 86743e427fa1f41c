"""Mean and covariance of clutter, and whitening by them (Cosgrove et al. 2004, Sec. II)."""

from __future__ import annotations

from typing import Self

import numpy as np
from sklearn.base import BaseEstimator, TransformerMixin
from sklearn.utils.validation import check_is_fitted

from flgpr.jit.threads import blas_on_one_thread
from flgpr.kernels.moments import check_samples, moments_estimator
from flgpr.types import AnyArray, ArrayLike

BASES = ("eigen", "cholesky", "symmetric")


def whitening_matrix(covariance: ArrayLike, basis: str = "eigen") -> AnyArray:
    """Compute a matrix W with ``W C W^H = I`` for a covariance C.

    All such matrices differ by a unitary factor, to which linear-quadratic detectors are blind.

    Parameters
    ----------
    covariance : (n_features, n_features) array_like
        C, Hermitian and positive definite.
    basis : {"eigen", "cholesky", "symmetric"}
        Scaled eigenvectors, the inverse Cholesky factor, or ``C^(-1/2)``.

    Returns
    -------
    (n_features, n_features) ndarray
        W.

    Raises
    ------
    ValueError
        If the basis is unknown, or C is not Hermitian or not positive definite.

    Examples
    --------
    >>> import numpy as np
    >>> from flgpr.clutter import whitening_matrix
    >>> covariance = np.array([[4.0, 1.0], [1.0, 2.0]])
    >>> w = whitening_matrix(covariance)
    >>> np.allclose(w @ covariance @ w.conj().T, np.eye(2))
    True
    """
    C = np.asarray(covariance)
    if basis not in BASES:
        raise ValueError(f"basis must be one of {', '.join(BASES)}, got {basis!r}")
    if C.ndim != 2 or C.shape[0] != C.shape[1] or not np.allclose(C, C.conj().T):
        raise ValueError(f"covariance must be a Hermitian matrix, got one of shape {C.shape}")
    with blas_on_one_thread():
        return _whitening_matrix(C, basis)


def _whitening_matrix(C: AnyArray, basis: str) -> AnyArray:
    """Compute the matrix of :func:`whitening_matrix` for a Hermitian covariance."""
    values, vectors = np.linalg.eigh(C)
    if not values[0] > values.size * np.finfo(np.float64).eps * values[-1]:
        raise ValueError(
            "covariance must be positive definite, got eigenvalues from "
            f"{values[0]:g} to {values[-1]:g}; take more clutter samples or shrinkage"
        )
    if basis == "cholesky":
        return np.asarray(np.linalg.inv(np.linalg.cholesky(C)))
    rows = vectors.conj().T / np.sqrt(values)[:, None]
    if basis == "symmetric":
        return np.asarray(vectors @ rows)
    return np.asarray(rows)


class ClutterWhitener(TransformerMixin, BaseEstimator):  # type: ignore[misc]
    """Whiten features by the mean and covariance of the clutter (Cosgrove et al. 2004, Sec. II).

    Whitened clutter is CN(0, I).

    Parameters
    ----------
    moments : {"sample", "ledoit-wolf", "oas", "ogk", "clipped"}
        Estimator of mean and covariance: sample moments; two ways to shrink the covariance to a
        multiple of the identity (Ledoit & Wolf 2004; Chen et al. 2010); sample moments without the
        outliers found by orthogonal pairs (Maronna & Zamar 2002); or sample moments of vectors
        whose energy is clipped at the median.
    basis : {"eigen", "cholesky", "symmetric"}
        As in :func:`whitening_matrix`.

    Attributes
    ----------
    mean_, covariance_ : (n_features,), (n_features, n_features) ndarray
        Clutter mean and covariance.
    matrix_ : (n_features, n_features) ndarray
        Whitening matrix.
    """

    def __init__(self, moments: str = "sample", basis: str = "eigen") -> None:
        self.moments = moments
        self.basis = basis

    def fit(self, X: ArrayLike, y: ArrayLike | None = None) -> Self:  # noqa: ARG002
        """Estimate mean and covariance of clutter.

        Parameters
        ----------
        X : (n_samples, n_features) array_like
            Samples without targets, real or complex.
        y : ignored
            There for the interface of scikit-learn.

        Raises
        ------
        ValueError
            If ``moments`` is unknown, or the covariance is singular.
        """
        estimate = moments_estimator(self.moments)
        samples = check_samples(self, X, reset=True, minimum=2)
        with blas_on_one_thread():
            self.mean_, self.covariance_ = estimate(samples)
        self.matrix_ = whitening_matrix(self.covariance_, self.basis)
        return self

    def transform(self, X: ArrayLike) -> AnyArray:
        """Return whitened samples, ``W (x - mean)`` of every row of (n_samples, n_features)."""
        check_is_fitted(self)
        samples = check_samples(self, X, reset=False)
        with blas_on_one_thread():
            return np.asarray((samples - self.mean_) @ self.matrix_.T)
