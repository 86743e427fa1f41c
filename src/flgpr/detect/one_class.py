"""Novelty detection by relevance vectors, trained on mines alone (flsar2004, Sec. 3.5)."""

from __future__ import annotations

from typing import Any, Literal

import numpy as np
from scipy.special import expit
from sklearn.base import OutlierMixin
from sklearn.utils import check_random_state
from sklearn.utils.validation import validate_data

from flgpr.detect.rvm import Prior, RelevanceMachine
from flgpr.detect.rvm_fit import Algorithm, Kernel
from flgpr.types import ArrayLike, FloatArray, IntArray, floats

Formulation = Literal["offset", "no-bias", "reference"]
FORMULATIONS: tuple[Formulation, ...] = ("offset", "no-bias", "reference")


class OneClassRelevanceVectorMachine(OutlierMixin, RelevanceMachine):  # type: ignore[misc]  # no types
    """Detect novelty by a one-class relevance vector machine, trained with all labels l = +1.

    The text of the paper, taken at its word, collapses: with a free bias and a single label nothing
    but the bias survives, and every example is a mine with p near 1. Three ways out, of which the
    first is the default:

    - "offset": c(f) = Σ w_n K(f, f_n) - b0 with b0 = logit(1 - p0) fixed. Where a local kernel has
      died away, p = p0.
    - "no-bias": c(f) = Σ w_n K(f, f_n), closest to the text; p falls to 0.5 far from all mines.
    - "reference": a binary machine against points drawn uniformly over the box of the features.
      p/(1 - p) is then the mines' density over a constant; no clutter is used, but nothing is known
      outside the box.

    Parameters
    ----------
    kernel, gamma, degree, coef0, prior, rate, algorithm, n_starts, moderated, tol, max_iter
        As in :class:`RelevanceVectorClassifier`. The width refers to the standardised features.
    p0 : float
        Probability of a mine far from all mines ("offset").
    formulation : {"offset", "no-bias", "reference"}
        See above.
    standardize : bool
        Whether features are centred and scaled by the mean and standard deviation of the training
        mines.
    reject : float
        Share of the training mines that :meth:`predict` rejects; it sets ``offset_`` and nothing
        else.
    box : (feature, 2) array_like, optional
        Lowest and highest value of every feature ("reference"); by default the mines' range widened
        by half on either side.
    n_reference : int, optional
        Number of reference points; by default as many as mines.
    random_state : int, RandomState or None
        Source of the reference points.

    Attributes
    ----------
    relevance_ : (k,) ndarray of int
        Indices of the relevance vectors; with "reference" those from the number of mines on are
        reference points.
    offset_ : float
        Least probability that :meth:`predict` calls a mine.
    center_, scale_ : (feature,) ndarray
        Standardisation.
    dual_coef_, intercept_, alpha_, covariance_, log_evidence_, n_iter_, converged_, gamma_, rate_
        As in :class:`RelevanceVectorClassifier`.
    """

    def __init__(
        self,
        kernel: Kernel = "rbf",
        gamma: float | Literal["scale", "auto"] = "scale",
        p0: float = 0.01,
        formulation: Formulation = "offset",
        standardize: bool = True,
        degree: float = 3,
        coef0: float = 1.0,
        prior: Prior = "ard",
        rate: float | Literal["auto"] = "auto",
        algorithm: Algorithm = "fast",
        n_starts: int = 5,
        moderated: bool = True,
        tol: float = 1e-5,
        max_iter: int = 1000,
        reject: float = 0.05,
        box: ArrayLike | None = None,
        n_reference: int | None = None,
        random_state: int | np.random.RandomState | None = None,
    ) -> None:
        self.kernel = kernel
        self.gamma = gamma
        self.p0 = p0
        self.formulation = formulation
        self.standardize = standardize
        self.degree = degree
        self.coef0 = coef0
        self.prior = prior
        self.rate = rate
        self.algorithm = algorithm
        self.n_starts = n_starts
        self.moderated = moderated
        self.tol = tol
        self.max_iter = max_iter
        self.reject = reject
        self.box = box
        self.n_reference = n_reference
        self.random_state = random_state

    def fit(self, X: ArrayLike, y: Any = None) -> OneClassRelevanceVectorMachine:
        """Fit the machine to mines (sample, feature); ``y`` is ignored."""
        del y
        self._check_parameters()
        if self.formulation not in FORMULATIONS:
            raise ValueError(
                f"formulation must be one of {', '.join(FORMULATIONS)}, got {self.formulation!r}"
            )
        if not 0 < self.p0 < 1:
            raise ValueError(f"p0 must lie between 0 and 1, got {self.p0!r}")
        if not 0 <= self.reject < 1:
            raise ValueError(f"reject must be at least 0 and below 1, got {self.reject!r}")
        if self.formulation == "reference" and self._is_precomputed():
            raise ValueError(
                "kernel must be a function of examples with formulation 'reference', "
                "got 'precomputed'"
            )
        X = np.asarray(validate_data(self, X, dtype=np.float64))
        self._set_scale(X)
        Z = self._prepared(X)
        target = np.ones(len(Z))
        has_reference = self.formulation == "reference"
        if has_reference:
            extra = self._prepared(self._reference(X))
            Z = np.vstack([Z, extra])
            target = np.append(target, np.zeros(len(extra)))
        # Log odds of p0, which hold where a local kernel has died away.
        offset = 0.0
        if self.formulation == "offset":
            offset = float(np.log(self.p0 / (1 - self.p0)))
        self._solve(Z, target, has_reference, offset, None)
        self.offset_ = float(np.quantile(self.score_samples(X), self.reject))
        return self

    def _set_scale(self, X: FloatArray) -> None:
        """Set the standardisation, which a precomputed kernel does not have."""
        fixed = not self.standardize or self._is_precomputed()
        self.center_ = np.zeros(X.shape[1]) if fixed else X.mean(axis=0)
        spread = np.ones(X.shape[1]) if fixed else X.std(axis=0)
        self.scale_ = np.where(spread > 0, spread, 1.0)

    def _prepared(self, X: FloatArray) -> FloatArray:
        return floats((X - self.center_) / self.scale_)

    def _reference(self, X: FloatArray) -> FloatArray:
        """Draw the reference points uniformly over the box."""
        # The range of the mines, widened by half on either side.
        least = X.min(axis=0)
        greatest = X.max(axis=0)
        low = 1.5 * least - 0.5 * greatest
        high = 1.5 * greatest - 0.5 * least
        if self.box is not None:
            box = floats(self.box)
            if box.shape != (X.shape[1], 2) or not (box[:, 1] > box[:, 0]).all():
                raise ValueError(
                    f"box must hold a rising (low, high) for each of {X.shape[1]} features, "
                    f"got {self.box}"
                )
            low, high = box.T
        count = len(X) if self.n_reference is None else self.n_reference
        if not count >= 1:
            raise ValueError(f"n_reference must be at least 1, got {self.n_reference!r}")
        generator = check_random_state(self.random_state)
        return np.asarray(generator.uniform(low, high, (count, X.shape[1])))

    def score_samples(self, X: ArrayLike) -> FloatArray:
        """Return the probability of a mine, p(mine), of samples (sample, feature)."""
        return expit(self._log_odds(X))

    def decision_function(self, X: ArrayLike) -> FloatArray:
        """Return the probability of a mine less ``offset_``: positive for mines."""
        return self.score_samples(X) - self.offset_

    def predict(self, X: ArrayLike) -> IntArray:
        """Return 1 for mines and -1 for others."""
        return np.where(self.decision_function(X) >= 0, 1, -1)
