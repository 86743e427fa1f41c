"""The relevance vector machine as a classifier (Tipping 2001; Tipping & Faul 2003)."""

from __future__ import annotations

import warnings
from dataclasses import replace
from typing import Any, Literal

import numpy as np
from scipy.special import expit
from sklearn.base import BaseEstimator, ClassifierMixin, clone
from sklearn.exceptions import ConvergenceWarning
from sklearn.utils.multiclass import check_classification_targets, type_of_target
from sklearn.utils.validation import check_is_fitted, validate_data

from flgpr.detect.rvm_fit import (
    ALGORITHMS,
    Algorithm,
    Kernel,
    SparseFit,
    evaluate_kernel,
    fit_laplacian_map,
    fit_sparse,
    resolve_gamma,
)
from flgpr.types import AnyArray, ArrayLike, FloatArray, IntArray, floats

Prior = Literal["ard", "laplacian", "laplacian-map"]
PRIORS: tuple[Prior, ...] = ("ard", "laplacian", "laplacian-map")


def moderate(mean: FloatArray, variance: FloatArray) -> FloatArray:
    """Return κ m with κ = (1 + π s²/8)^(-1/2), whose σ is about the mean of σ (MacKay 1992).

    The mean is over a normal argument of the mean m and the variance s².
    """
    return np.asarray(mean / np.sqrt(1 + np.pi * variance / 8))


class RelevanceMachine(BaseEstimator):  # type: ignore[misc]  # scikit-learn has no types
    """Base of the binary and the one-class machine: kernel, fit, argument of σ."""

    kernel: Kernel
    gamma: float | Literal["scale", "auto"]
    degree: float
    coef0: float
    prior: Prior
    rate: float | Literal["auto"]
    algorithm: Algorithm
    n_starts: int
    moderated: bool
    tol: float
    max_iter: int

    def _check_parameters(self) -> None:
        if self.prior not in PRIORS:
            raise ValueError(f"prior must be one of {', '.join(PRIORS)}, got {self.prior!r}")
        if self.algorithm not in ALGORITHMS:
            raise ValueError(
                f"algorithm must be one of {', '.join(ALGORITHMS)}, got {self.algorithm!r}"
            )
        for name, count in (("n_starts", self.n_starts), ("max_iter", self.max_iter)):
            if not count >= 1:
                raise ValueError(f"{name} must be at least 1, got {count!r}")
        if not self.tol > 0:
            raise ValueError(f"tol must be positive, got {self.tol!r}")
        if self.rate != "auto" and not (isinstance(self.rate, (int, float)) and self.rate > 0):
            raise ValueError(f"rate must be a positive number or 'auto', got {self.rate!r}")

    def _prepared(self, X: FloatArray) -> FloatArray:
        """Return examples as the kernel takes them."""
        return X

    def _is_precomputed(self) -> bool:
        """Whether the features are the kernel's values themselves."""
        return isinstance(self.kernel, str) and self.kernel == "precomputed"

    def _kernel(self, X: FloatArray, centres: FloatArray) -> FloatArray:
        return evaluate_kernel(self.kernel, X, centres, self.gamma_, self.degree, self.coef0)

    def _solve(
        self, X: FloatArray, target: FloatArray, bias: bool, offset: float, start: SparseFit | None
    ) -> None:
        """Fit the weights and set the fitted attributes; the bias is the last column."""
        if self._is_precomputed() and X.shape[0] != X.shape[1]:
            raise ValueError(
                "X must be the square kernel matrix of the training examples, "
                f"got the shape {X.shape}"
            )
        self.gamma_ = resolve_gamma(self.gamma, X)
        design = self._kernel(X, X)
        if bias:
            design = np.hstack([design, np.ones((len(X), 1))])
        if self.prior == "laplacian-map":
            rate = 1.0 if self.rate == "auto" else self.rate
            fit = fit_laplacian_map(
                design, target, offset=offset, rate=rate, tol=self.tol, max_iter=self.max_iter
            )
        else:
            fit = fit_sparse(
                design,
                target,
                offset=offset,
                algorithm=self.algorithm,
                rate=self.rate if self.prior == "laplacian" else 0.0,
                n_starts=self.n_starts,
                start=start,
                tol=self.tol,
                max_iter=self.max_iter,
            )
        if not fit.converged:
            warnings.warn(
                f"no convergence after {fit.n_iter} iterations: raise max_iter or tol",
                ConvergenceWarning,
                stacklevel=3,
            )
        vectors = fit.active < len(X)
        self.relevance_: IntArray = fit.active[vectors]
        self.relevance_vectors_ = X[self.relevance_]
        self.dual_coef_ = fit.mean[vectors]
        self.intercept_ = float(fit.mean[~vectors].sum()) + offset
        self.alpha_ = fit.alpha
        self.covariance_ = fit.covariance
        self.log_evidence_ = fit.log_evidence
        self.n_iter_ = fit.n_iter
        self.converged_ = fit.converged
        self.rate_ = fit.rate
        self._fit_result = fit
        self._has_bias = bool((~vectors).any())

    def _argument(self, X: ArrayLike) -> tuple[FloatArray, FloatArray]:
        """Return mean and variance of the argument of σ."""
        check_is_fitted(self, "dual_coef_")
        X = self._prepared(np.asarray(validate_data(self, X, reset=False, dtype=np.float64)))
        if self._is_precomputed():
            basis = X[:, self.relevance_]
        elif len(self.relevance_):
            basis = self._kernel(X, self.relevance_vectors_)
        else:
            basis = np.zeros((len(X), 0))
        mean = basis @ self.dual_coef_ + self.intercept_
        if self._has_bias:
            basis = np.hstack([basis, np.ones((len(basis), 1))])
        return mean, np.einsum("nk,kl,nl->n", basis, self.covariance_, basis)

    def _log_odds(self, X: ArrayLike) -> FloatArray:
        mean, variance = self._argument(X)
        return moderate(mean, variance) if self.moderated else mean

    def predict_proba(self, X: ArrayLike) -> FloatArray:
        """Return the probabilities of the two classes (flsar2004, Eq. 4).

        They are those in ``classes_``, or of one class no mine and a mine.
        """
        p = expit(self._log_odds(X))
        return np.column_stack([1 - p, p])

    def __sklearn_tags__(self) -> Any:
        tags = super().__sklearn_tags__()
        tags.input_tags.pairwise = self._is_precomputed()
        return tags


class RelevanceVectorClassifier(ClassifierMixin, RelevanceMachine):  # type: ignore[misc]
    """Classify by a relevance vector machine for two classes (flsar2004, Sec. 3.4).

    It is that of Tipping (2001, Sec. 3) and Tipping & Faul (2003):
    p(second class | f) = σ(Σ w_n K(f, f_n) + w_0), where an evidence maximum leaves few w_n that
    are not zero.

    Parameters
    ----------
    kernel : str or callable
        "rbf", "laplacian", "poly", "linear", "sigmoid", "precomputed", or a function of two arrays
        of examples. It need not be a Mercer kernel.
    gamma : float or {"scale", "auto"}
        Width of the kernel, as in ``sklearn.svm.SVC``.
    degree, coef0 : float
        Parameters of the polynomial and sigmoid kernels.
    bias : bool
        Whether there is a w_0; it is subject to the prior like every weight.
    prior : {"ard", "laplacian", "laplacian-map"}
        "ard": a normal prior of own precision for each weight (Tipping 2001), the precisions by the
        evidence. "laplacian": besides an exponential prior on the variances, still by the evidence.
        "laplacian-map": the Laplacian prior on the weights themselves, at their mode (flsar2004,
        par. 30): a convex problem of one solution, which keeps more vectors than the evidence does.
    rate : float or "auto"
        Rate of the exponential prior, the square of the Laplacian's λ; "auto" learns it, or is 1
        with "laplacian-map".
    algorithm : {"fast", "ard"}
        Growing by the marginal likelihood (Tipping & Faul 2003), or pruning all (Tipping 2001). It
        does not matter with "laplacian-map", nor does n_starts.
    n_starts : int
        Starts of "fast", one by single best actions and the others from different first vectors;
        the evidence has many local maxima.
    moderated : bool
        Whether probabilities average over the weights' posterior, σ(κ m), or use their mode, σ(m).
    tol, max_iter : float, int
        What is left to gain at the end, as in ``fit_sparse``, and most iterations of one ascent.

    Attributes
    ----------
    classes_ : (2,) ndarray
        Labels; the second is the positive class.
    relevance_, relevance_vectors_, dual_coef_ : (k,), (k, feature), (k,) ndarray
        Indices of the relevance vectors, the vectors, and their weights w_n.
    intercept_ : float
        w_0.
    alpha_, covariance_ : ndarray
        Prior precisions and posterior covariance of the weights, the bias last where it stayed.
    log_evidence_ : float
        Log marginal likelihood (Laplace's approximation).
    n_iter_, converged_ : int, bool
        Iterations over all starts, and whether the tolerance was reached.
    gamma_, rate_ : float
        Values in use.
    """

    def __init__(
        self,
        kernel: Kernel = "rbf",
        gamma: float | Literal["scale", "auto"] = "scale",
        degree: float = 3,
        coef0: float = 1.0,
        bias: bool = True,
        prior: Prior = "ard",
        rate: float | Literal["auto"] = "auto",
        algorithm: Algorithm = "fast",
        n_starts: int = 5,
        moderated: bool = True,
        tol: float = 1e-5,
        max_iter: int = 1000,
    ) -> None:
        self.kernel = kernel
        self.gamma = gamma
        self.degree = degree
        self.coef0 = coef0
        self.bias = bias
        self.prior = prior
        self.rate = rate
        self.algorithm = algorithm
        self.n_starts = n_starts
        self.moderated = moderated
        self.tol = tol
        self.max_iter = max_iter

    def fit(self, X: ArrayLike, y: ArrayLike) -> RelevanceVectorClassifier:
        """Fit the machine to examples (sample, feature) of two labels."""
        return self._fit_from(X, y, None)

    def _fit_from(
        self, X: ArrayLike, y: ArrayLike, start: SparseFit | None
    ) -> RelevanceVectorClassifier:
        self._check_parameters()
        X, y = validate_data(self, X, y, dtype=np.float64)
        check_classification_targets(y)
        if type_of_target(y) == "multiclass":
            raise ValueError(
                "Only binary classification is supported: y must hold 2 classes, got "
                f"{len(np.unique(y))}; wrap the machine in OneVsRestClassifier for more"
            )
        self.classes_, code = np.unique(y, return_inverse=True)
        if len(self.classes_) != 2:
            raise ValueError(f"y must hold 2 classes, got one class only: {self.classes_[0]!r}")
        self._solve(np.asarray(X), code.astype(np.float64), self.bias, 0.0, start)
        return self

    def decision_function(self, X: ArrayLike) -> FloatArray:
        """Return the log odds of the second class, the argument of σ (flsar2004, Eq. 1).

        They are moderated if the probabilities are.
        """
        return self._log_odds(X)

    def predict(self, X: ArrayLike) -> AnyArray:
        """Return the more likely class."""
        positive = self.decision_function(X) > 0
        return self.classes_[positive.astype(int)]

    def __sklearn_tags__(self) -> Any:
        tags = super().__sklearn_tags__()
        tags.classifier_tags.multi_class = False
        return tags


def leave_one_out(
    machine: RelevanceVectorClassifier, X: ArrayLike, y: ArrayLike, *, warm: bool = False
) -> tuple[FloatArray, list[RelevanceVectorClassifier]]:
    """Test every example on a machine fitted to all the others (flsar2004, par. 45).

    Parameters
    ----------
    machine : RelevanceVectorClassifier
        Its parameters; it is not fitted itself.
    X, y : (sample, feature), (sample,) array_like
        Examples, not a precomputed kernel, and their labels.
    warm : bool
        Whether each fold begins once by single actions and once with the vectors of the machine
        fitted to all examples, less the one left out. Quicker; it may end in another maximum of the
        evidence (compare ``log_evidence_``).

    Returns
    -------
    probability : (sample,) ndarray
        Held-out probability of the second class.
    machines : list of RelevanceVectorClassifier
        The machine of every fold.
    """
    X = floats(X)
    y = np.asarray(y)
    full = clone(machine).fit(X, y)._fit_result if warm else None
    machines = []
    probability = np.empty(len(X))
    for n in range(len(X)):
        training = np.arange(len(X)) != n
        start = None if full is None else _without(full, n)
        machines.append(clone(machine)._fit_from(X[training], y[training], start))
        probability[n] = machines[-1].predict_proba(X[n : n + 1])[0, 1]
    return probability, machines


def _without(fit: SparseFit, n: int) -> SparseFit:
    """Return a model of the design without basis function n."""
    remains = fit.active != n
    active = fit.active[remains]
    return replace(
        fit,
        active=active - (active > n),
        alpha=fit.alpha[remains],
        mean=fit.mean[remains],
        covariance=fit.covariance[np.ix_(remains, remains)],
        n_iter=0,
        converged=False,
    )
