"""Novelty detection by a mixture of Gaussians, the rival that flsar2004 names (par. 36)."""

from __future__ import annotations

from typing import Any, Literal

import numpy as np
from sklearn.base import BaseEstimator, OutlierMixin
from sklearn.mixture import GaussianMixture
from sklearn.utils.validation import check_is_fitted, validate_data

from flgpr.types import ArrayLike, FloatArray, IntArray


class GaussianMixtureNovelty(OutlierMixin, BaseEstimator):  # type: ignore[misc]  # scikit-learn has no types
    """Detect novelty by a mixture of Gaussians fitted to mines; its log density is the score.

    The number of components is chosen by the minimum description length, which for a mixture is
    half its BIC.

    Parameters
    ----------
    max_components : int
        Most components tried.
    covariance_type : {"full", "tied", "diag", "spherical"}
        Shape of the components.
    reg_covar : float
        Added to the variances of the standardised features.
    reject : float
        Share of the training mines that :meth:`predict` rejects.
    random_state : int, RandomState or None
        Source of the starts.

    Attributes
    ----------
    mixture_, n_components_ : GaussianMixture, int
        The mixture, of standardised features, and the number of its components.
    center_, scale_ : (feature,) ndarray
        Standardisation.
    offset_ : float
        Least log density that :meth:`predict` calls a mine.
    """

    def __init__(
        self,
        max_components: int = 5,
        covariance_type: Literal["full", "tied", "diag", "spherical"] = "full",
        reg_covar: float = 1e-3,
        reject: float = 0.05,
        random_state: int | np.random.RandomState | None = None,
    ) -> None:
        self.max_components = max_components
        self.covariance_type = covariance_type
        self.reg_covar = reg_covar
        self.reject = reject
        self.random_state = random_state

    def fit(self, X: ArrayLike, y: Any = None) -> GaussianMixtureNovelty:
        """Fit the mixture to mines (sample, feature), at least two; ``y`` is ignored."""
        del y
        if not self.max_components >= 1:
            raise ValueError(f"max_components must be at least 1, got {self.max_components!r}")
        if not 0 <= self.reject < 1:
            raise ValueError(f"reject must be at least 0 and below 1, got {self.reject!r}")
        X = np.asarray(validate_data(self, X, dtype=np.float64, ensure_min_samples=2))
        self.center_ = X.mean(axis=0)
        spread = X.std(axis=0)
        self.scale_ = np.where(spread > 0, spread, 1.0)
        Z = (X - self.center_) / self.scale_
        mixtures = []
        for components in range(1, min(self.max_components, len(Z)) + 1):
            mixture = GaussianMixture(
                components,
                covariance_type=self.covariance_type,
                reg_covar=self.reg_covar,
                n_init=3,
                max_iter=500,
                tol=1e-3,
                random_state=self.random_state,
            )
            mixtures.append(mixture.fit(Z))
        self.mixture_ = min(mixtures, key=lambda mixture: mixture.bic(Z))
        self.n_components_ = int(self.mixture_.n_components)
        self.offset_ = float(np.quantile(self.score_samples(X), self.reject))
        return self

    def score_samples(self, X: ArrayLike) -> FloatArray:
        """Return the log density of the standardised features."""
        check_is_fitted(self, "mixture_")
        X = np.asarray(validate_data(self, X, reset=False, dtype=np.float64))
        return np.asarray(self.mixture_.score_samples((X - self.center_) / self.scale_))

    def decision_function(self, X: ArrayLike) -> FloatArray:
        """Return the log density less ``offset_``: positive for mines."""
        return self.score_samples(X) - self.offset_

    def predict(self, X: ArrayLike) -> IntArray:
        """Return 1 for mines and -1 for others."""
        return np.where(self.decision_function(X) >= 0, 1, -1)
