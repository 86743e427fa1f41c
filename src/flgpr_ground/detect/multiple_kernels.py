"""A support vector machine on a weighted sum of kernels, whose weights are learnt (MKL).

After Havens et al., "Multiple kernel learning for explosive hazard detection in forward-looking
ground-penetrating radar", Proc. SPIE 8357, 2012, with the group lasso of Xu, Jin, Yang, King & Lyu,
"Simple and efficient multiple kernel learning by group lasso", ICML 2010.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterator, Sequence
from itertools import accumulate, pairwise
from typing import Any, Literal, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray
from sklearn.base import BaseEstimator, ClassifierMixin
from sklearn.exceptions import ConvergenceWarning
from sklearn.metrics.pairwise import rbf_kernel
from sklearn.svm import SVC
from sklearn.utils.multiclass import check_classification_targets, type_of_target
from sklearn.utils.validation import check_is_fitted, validate_data

from flgpr.types import AnyArray, FloatArray, floats

_FINER = 0.01
_REMEMBERED = 2**29
"""Most bytes of kernel matrices that stay in memory; more are computed anew in every round."""


class MultipleKernelClassifier(ClassifierMixin, BaseEstimator):  # type: ignore[misc]  # no types
    """Part two classes by a support vector machine on a convex combination of RBF kernels.

    Every kernel ``K_m(x, z) = exp(-γ_m |x_m - z_m|²)`` reads one group of features, and the machine
    reads ``K = Σ θ_m K_m`` with ``θ_m ≥ 0`` and ``Σ θ_m = 1``. Rounds of two steps solve for both:
    the machine on the sum so far, and then ``θ_m = |f_m| / Σ_k |f_k|``, where
    ``|f_m|² = θ_m² (α∘y)ᵀ K_m (α∘y)`` is the squared norm of what kernel m adds to the score (Xu et
    al. 2010, for p = 1, the group lasso). The weights begin alike. All kernels are one at distance
    zero, so that no further scale lies between them.

    Parameters
    ----------
    groups : sequence of int, optional
        Numbers of features of the groups, which follow one another; by default every feature is a
        group.
    C : float
        Cost of an example on the wrong side.
    gamma : "scale" or float
        γ of all kernels; "scale" is one over the number of a group's features times the variance of
        their values, as in scikit-learn.
    class_weight : "balanced", dict or None
        Cost of the classes as in scikit-learn: "balanced" is the inverse of their shares.
    tol : float
        Largest change of a weight in the last round.
    max_iter : int
        Most rounds.

    Attributes
    ----------
    kernel_weights_ : (n_groups,) ndarray
        θ.
    gamma_ : (n_groups,) ndarray
        γ.
    groups_ : tuple of int
        Numbers of features of the groups.
    support_vectors_ : (n_vectors, n_features) ndarray
        Examples that the score is made of.
    dual_coef_ : (n_vectors,) ndarray
        ``α∘y`` of these.
    intercept_ : float
        Constant of the score.
    n_iter_ : int
        Rounds.
    """

    def __init__(
        self,
        groups: Sequence[int] | None = None,
        C: float = 1.0,
        gamma: float | Literal["scale"] = "scale",
        class_weight: Literal["balanced"] | dict[Any, float] | None = None,
        tol: float = 1e-3,
        max_iter: int = 200,
    ) -> None:
        self.groups = groups
        self.C = C
        self.gamma = gamma
        self.class_weight = class_weight
        self.tol = tol
        self.max_iter = max_iter

    def fit(self, X: ArrayLike, y: ArrayLike) -> Self:
        """Fit the weights and the machine to examples (sample, feature) of two labels."""
        X, y = validate_data(self, X, y, dtype=np.float64)
        check_classification_targets(y)
        if type_of_target(y) == "multiclass":
            raise ValueError(
                "Only binary classification is supported: y must hold 2 classes, got "
                f"{len(np.unique(y))}; wrap the machine in OneVsRestClassifier for more"
            )
        self.classes_ = np.unique(y)
        if len(self.classes_) != 2:
            raise ValueError(f"y must hold 2 classes, got one class only: {self.classes_[0]!r}")
        if not self.tol > 0:
            raise ValueError(f"tol must be positive, got {self.tol!r}")
        if not self.max_iter >= 1:
            raise ValueError(f"max_iter must be at least 1, got {self.max_iter!r}")
        samples = floats(X)
        self.groups_ = _checked_groups(self.groups, samples.shape[1])
        self.gamma_ = self._widths(samples)
        self._solve(samples, np.asarray(y))
        return self

    def _widths(self, X: FloatArray) -> FloatArray:
        """Return γ of every kernel."""
        if self.gamma != "scale":
            if not self.gamma > 0:
                raise ValueError(f"gamma must be positive or 'scale', got {self.gamma!r}")
            return np.full(len(self.groups_), float(self.gamma))
        widths = []
        for columns in columns_of_groups(self.groups_):
            spread = float(X[:, columns].var()) * len(columns)
            widths.append(1 / spread if spread > 0 else 1.0)
        return np.array(widths)

    def _solve(self, X: FloatArray, y: AnyArray) -> None:
        """Go through rounds of machine and weights until the weights stand still."""
        kernels = _Kernels(X, self.groups_, self.gamma_)
        weights = np.full(len(self.groups_), 1 / len(self.groups_))
        for number in range(1, self.max_iter + 1):
            # The machine is solved more finely than the weights, which its residue would move.
            machine = SVC(
                C=self.C,
                kernel="precomputed",
                class_weight=self.class_weight,
                tol=self.tol * _FINER,
            )
            machine.fit(kernels.weighted(weights), y)
            coefficients = machine.dual_coef_[0]
            # A weight is in proportion to the norm of its kernel's share of the solution.
            norms = weights * kernels.norms(machine.support_, coefficients)
            # Without a single support vector there is nothing that a weight could add to.
            new_weights = norms / norms.sum() if norms.sum() > 0 else weights
            change = float(np.abs(new_weights - weights).max())
            if change <= self.tol or number == self.max_iter:
                break
            weights = new_weights
        if change > self.tol:
            warnings.warn(
                f"kernel weights still change by {change:.2g} after {number} rounds; "
                "raise max_iter or tol",
                ConvergenceWarning,
                stacklevel=3,
            )
        self.kernel_weights_ = weights
        self.support_vectors_ = X[machine.support_]
        self.dual_coef_ = np.array(coefficients)
        self.intercept_ = float(machine.intercept_[0])
        self.n_iter_ = number

    def decision_function(self, X: ArrayLike) -> FloatArray:
        """Return the scores (n_samples,), positive for the second class."""
        check_is_fitted(self)
        samples = np.asarray(validate_data(self, X, reset=False, dtype=np.float64))
        score = np.full(len(samples), self.intercept_)
        terms = zip(columns_of_groups(self.groups_), self.gamma_, self.kernel_weights_, strict=True)
        for columns, gamma, weight in terms:
            kernel = rbf_kernel(samples[:, columns], self.support_vectors_[:, columns], gamma)
            score += weight * (kernel @ self.dual_coef_)
        return score

    def predict(self, X: ArrayLike) -> AnyArray:
        """Return the class on whose side a sample lies."""
        positive = self.decision_function(X) > 0
        return self.classes_[positive.astype(int)]

    def __sklearn_tags__(self) -> Any:
        tags = super().__sklearn_tags__()
        tags.classifier_tags.multi_class = False
        return tags


class _Kernels:
    """The kernel matrices of training examples, remembered where they are small enough."""

    def __init__(self, X: FloatArray, groups: Sequence[int], gamma: FloatArray) -> None:
        self._given = list(zip(columns_of_groups(groups), gamma, strict=True))
        self._X = X
        self._matrices: list[FloatArray] = []
        if 8 * len(groups) * len(X) ** 2 <= _REMEMBERED:
            self._matrices = list(self)

    def __iter__(self) -> Iterator[FloatArray]:
        if self._matrices:
            return iter(self._matrices)
        return (rbf_kernel(self._X[:, columns], gamma=gamma) for columns, gamma in self._given)

    def weighted(self, weights: FloatArray) -> FloatArray:
        """Return the weighted sum of the matrices."""
        total = np.zeros((len(self._X), len(self._X)))
        for weight, kernel in zip(weights, self, strict=True):
            total += weight * kernel
        return total

    def norms(self, support: NDArray[np.int32], coefficients: FloatArray) -> FloatArray:
        """Return ``((α∘y)ᵀ K_m (α∘y))^½`` of every kernel."""
        among = np.ix_(support, support)
        squares = [coefficients @ kernel[among] @ coefficients for kernel in self]
        return np.sqrt(np.maximum(squares, 0.0))


def columns_of_groups(groups: Sequence[int]) -> Iterator[range]:
    """Yield the columns of every group of features that follow one another."""
    for first, end in pairwise([0, *accumulate(groups)]):
        yield range(first, end)


def _checked_groups(groups: Sequence[int] | None, features: int) -> tuple[int, ...]:
    """Return the sizes of the groups, which must be positive and add up to the features."""
    if groups is None:
        return (1,) * features
    sizes = tuple(int(size) for size in groups)
    if not all(size >= 1 for size in sizes) or sum(sizes) != features:
        raise ValueError(f"groups must be positive and add up to {features} features, got {sizes}")
    return sizes
