"""The deflection-optimal linear-quadratic detector (Cosgrove et al. 2004)."""

from __future__ import annotations

from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray
from sklearn.base import BaseEstimator
from sklearn.utils.validation import check_is_fitted

from flgpr.detect.complex_data import check_samples
from flgpr.detect.linear_quadratic import LinearQuadraticForm, as_moments, hermitian_form
from flgpr.kernels.moments import ESTIMATORS


def deflection_form(
    mean: ArrayLike, covariance: ArrayLike, gamma: float = 1.0, rank: int | None = None
) -> LinearQuadraticForm:
    """Form that maximises the deflection for known moments of the signal.

    The clutter is CN(0, I) and the data under H1 have the mean μ and the covariance C + I. With γ = 1 nothing else is
    needed (Cosgrove et al. 2004, Eq. 5 and 6). With γ < 1 the generalised deflection (Eq. 3) also holds the variance
    under H1, which is taken as that of a circular Gaussian; its maximum solves::

        γA + (1-γ) R A R = C - μμ^H + γ(bμ^H + μb^H),   γb + (1-γ) R (b + Aμ) = μ,   R = C + I

    Parameters
    ----------
    mean, covariance : (n_features,), (n_features, n_features) array_like
        μ, whitened, and C, Hermitian; positive semidefinite for γ < 1.
    gamma : float
        γ, from 0 (variance under H1 only) to 1 (under H0 only).
    rank : int, optional
        Number of eigenvectors of A kept: the largest eigenvalues, for γ < 1 the largest in magnitude. None keeps all.
    """
    mu, C = as_moments(mean, covariance)
    if not 0 <= gamma <= 1:
        raise ValueError(f"gamma must lie between 0 and 1, got {gamma}")
    outer = np.outer(mu, mu.conj())
    if gamma == 1:
        return hermitian_form(C + outer, mu, rank)
    A, b = _generalised(mu, C, gamma)
    return hermitian_form(A, b, rank, by_magnitude=True)


def _generalised(mu: NDArray[Any], C: NDArray[Any], gamma: float) -> tuple[NDArray[Any], NDArray[Any]]:
    """Solve for A and b in the eigenbasis of R, where A ↦ γA + (1-γ)RAR is a product element by element."""
    values, basis = np.linalg.eigh(C)
    d = values + 1
    m = basis.conj().T @ mu
    weight = 1 / (gamma + (1 - gamma) * np.outer(d, d))
    fixed = weight * (np.diag(values) - np.outer(m, m.conj()))

    # b enters conjugated as well, so the system is linear over the reals only: column k of each half answers a unit
    # vector, real or imaginary.
    def respond(b: NDArray[Any]) -> NDArray[Any]:
        cross = np.outer(b, m.conj())
        return gamma * b + (1 - gamma) * d * (b + (gamma * weight * (cross + cross.conj().T)) @ m)

    units = np.eye(m.size)
    answers = [respond(unit) for unit in units] + [respond(1j * unit) for unit in units]
    system = np.array([np.concatenate([a.real, a.imag]) for a in answers]).T
    wanted = m - (1 - gamma) * d * (fixed @ m)
    solved = np.linalg.solve(system, np.concatenate([wanted.real, wanted.imag]))
    b: NDArray[Any] = solved[: m.size] + 1j * solved[m.size :]
    if not np.iscomplexobj(mu) and not np.iscomplexobj(C):
        b = b.real
    cross = np.outer(b, m.conj())
    A = fixed + gamma * weight * (cross + cross.conj().T)
    return basis @ A @ basis.conj().T, basis @ b


def standardize(form: LinearQuadraticForm) -> LinearQuadraticForm:
    """Scale a form without offsets to mean zero and variance one under CN(0, I), so that forms can be compared.

    There ``E(T) = tr A`` and ``Var(T) = ||A||² + 2||b||²``, as its vectors are orthonormal.
    """
    spread = float(np.sqrt(np.sum(form.strength**2) + 2 * np.sum(np.abs(form.linear) ** 2)))
    scale = 1 / spread if spread > 0 else 1.0
    return LinearQuadraticForm(
        form.strength * scale,
        form.vectors,
        form.linear * scale,
        form.offset,
        (form.constant - float(form.strength.sum())) * scale,
    )


class DeflectionDetector(BaseEstimator):  # type: ignore[misc]
    """Detector that maximises the deflection, trained on a few whitened target examples.

    ``Â = Σ x x^H / (N - ddof) - I``, ``b̂ = mean x``, and the score is
    ``Σ σ_j |u_j^H x|² + 2 Re(b̂^H x)`` over the largest eigenvalues of Â (Cosgrove et al. 2004, Eq. 7-12).

    With fewer examples than features, Eq. 7 gives the eigenvalue -1 in every direction that no example reaches, against
    the paper's "all > 0". Nothing was learned there, so these directions are never used; ``n_unseen_`` counts them.

    Parameters
    ----------
    rank : int or None
        M', number of eigenvectors kept; 0 leaves the linear part alone, the matched filter. None keeps all that the
        examples reach.
    ddof : int
        Divisor N - ddof of Eq. 7: 0 is unbiased, 1 is the paper's.
    gamma : float
        γ of the generalised deflection (Eq. 3); 1 is the paper's.
    positive : bool
        Whether to leave out eigenvectors with negative eigenvalues, the projection of Â on the positive semidefinite
        matrices.
    moments : {"sample", "ledoit-wolf", "oas", "robust", "clipped"}
        Estimator of mean and covariance of the examples; "sample" is Eq. 7 and 8.
    classes : {"pooled", "separate"}
        Whether examples of all classes train one form, or each class its own. The score is then the largest over the
        classes' forms, each scaled to mean zero and variance one on clutter.

    Attributes
    ----------
    eigenvalues_ : (n_features,) or (n_classes, n_features) ndarray
        All eigenvalues of Â, from the largest down.
    n_unseen_ : int or (n_classes,) ndarray
        Number of directions that no example reaches.
    forms_ : tuple of LinearQuadraticForm
        One form, or one per class of ``labels_``, which is empty unless classes are separate.

    Examples
    --------
    Whitened samples of clutter have unit variance; targets have more of it in one direction.

    >>> import numpy as np
    >>> from flgpr.detect import DeflectionDetector
    >>> rng = np.random.default_rng(0)
    >>> targets = rng.normal(size=(16, 4)) * [5, 1, 1, 1]
    >>> detector = DeflectionDetector(rank=1).fit(targets)
    >>> scores = detector.decision_function([[5.0, 0, 0, 0], [0, 5.0, 0, 0]])
    >>> bool(scores[0] > scores[1])
    True
    """

    def __init__(
        self,
        rank: int | None = 3,
        ddof: int = 0,
        gamma: float = 1.0,
        positive: bool = False,
        moments: str = "sample",
        classes: str = "pooled",
    ) -> None:
        self.rank = rank
        self.ddof = ddof
        self.gamma = gamma
        self.positive = positive
        self.moments = moments
        self.classes = classes

    def fit(self, X: ArrayLike, y: ArrayLike | None = None) -> Self:
        """Learn from whitened target examples (n_samples, n_features), real or complex.

        ``y``, the class of each, is used with ``classes="separate"`` only.
        """
        self._check_parameters()
        samples = check_samples(self, X, reset=True)
        if self.classes == "separate":
            if y is None or np.shape(y) != (samples.shape[0],):
                raise ValueError(
                    f'y must hold a class for each of the {samples.shape[0]} samples with classes="separate", '
                    f"got {'none' if y is None else np.shape(y)}"
                )
            self.labels_ = np.unique(np.asarray(y))
            learned = [self._learn(samples[np.asarray(y) == label]) for label in self.labels_]
            self.forms_ = tuple(standardize(form) for form, _, _ in learned)
            self.eigenvalues_ = np.stack([values for _, values, _ in learned])
            self.n_unseen_: int | NDArray[np.int64] = np.array([unseen for _, _, unseen in learned])
            return self
        form, self.eigenvalues_, self.n_unseen_ = self._learn(samples)
        self.forms_, self.labels_ = (form,), np.empty(0)
        return self

    def decision_function(self, X: ArrayLike) -> NDArray[np.float64]:
        """Score whitened samples: higher means more like a target (Cosgrove et al. 2004, Eq. 12)."""
        check_is_fitted(self)
        samples = check_samples(self, X, reset=False)
        return np.asarray(np.max([form(samples) for form in self.forms_], axis=0))

    def _check_parameters(self) -> None:
        if self.rank is not None and self.rank < 0:
            raise ValueError(f"rank must be None or at least 0, got {self.rank}")
        if self.ddof < 0:
            raise ValueError(f"ddof must be at least 0, got {self.ddof}")
        if not 0 <= self.gamma <= 1:
            raise ValueError(f"gamma must lie between 0 and 1, got {self.gamma}")
        if self.moments not in ESTIMATORS:
            raise ValueError(f"moments must be one of {', '.join(ESTIMATORS)}, got {self.moments!r}")
        if self.classes not in ("pooled", "separate"):
            raise ValueError(f"classes must be pooled or separate, got {self.classes!r}")

    def _learn(self, samples: NDArray[Any]) -> tuple[LinearQuadraticForm, NDArray[np.float64], int]:
        """Form, all eigenvalues of Â and the number of unseen directions of one class."""
        count, features = samples.shape
        if count <= self.ddof:
            raise ValueError(
                f"ddof must be smaller than the number of examples, got {self.ddof} with n_samples = {count}"
            )
        if self.moments == "sample":
            mean = samples.mean(axis=0)
            second = samples.T @ samples.conj() / (count - self.ddof)
        else:
            mean, covariance = ESTIMATORS[self.moments](samples)
            second = covariance + np.outer(mean, mean.conj())
        values, vectors = np.linalg.eigh(second)
        values, vectors = values[::-1], vectors[:, ::-1]
        unseen = int(np.count_nonzero(values <= features * np.finfo(np.float64).eps * max(values[0], 0.0)))
        strength = np.where(np.arange(features) < features - unseen, values - 1, -1.0)
        if self.gamma < 1:
            return self._generalised(mean, second), strength, unseen
        kept = np.arange(features - unseen)[: self.rank]
        if self.positive:
            kept = kept[strength[kept] > 0]
        form = LinearQuadraticForm(strength[kept], vectors[:, kept].T.copy(), mean, np.zeros(kept.size))
        return form, strength, unseen

    def _generalised(self, mean: NDArray[Any], second: NDArray[Any]) -> LinearQuadraticForm:
        # The signal's covariance must be one: what the estimate has below zero is noise of the estimate.
        values, vectors = np.linalg.eigh(second - np.outer(mean, mean.conj()) - np.eye(mean.size))
        covariance = (vectors * np.clip(values, 0, None)) @ vectors.conj().T
        form = deflection_form(mean, covariance, self.gamma, self.rank)
        kept = form.strength > 0 if self.positive else np.ones(form.rank, bool)
        return LinearQuadraticForm(form.strength[kept], form.vectors[kept], form.linear, form.offset[kept])
