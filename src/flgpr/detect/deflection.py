"""Detectors of Cosgrove et al. 2004: deflection, Neyman-Pearson, polarimetric whitening filter."""

from __future__ import annotations

import warnings
from typing import Self

import numpy as np

from flgpr.detect.linear_quadratic import (
    LinearQuadraticForm,
    QuadraticDetector,
    as_moments,
    hermitian_form,
)
from flgpr.kernels.moments import check_samples, moments_estimator, sample_moments
from flgpr.types import AnyArray, ArrayLike, FloatArray, IntArray


def deflection_form(
    mean: ArrayLike, covariance: ArrayLike, gamma: float = 1.0, rank: int | None = None
) -> LinearQuadraticForm:
    """Return the form that maximises the deflection for known moments of the signal.

    The clutter is CN(0, I) and the data under H1 have the mean μ and the covariance C + I. With γ =
    1 nothing else is needed (Cosgrove et al. 2004, Eq. 5 and 6). With γ < 1 the generalised
    deflection (Eq. 3) also holds the variance under H1, which is taken as that of a circular
    Gaussian; its maximum solves::

        γA + (1-γ) R A R = C - μμ^H + γ(bμ^H + μb^H),   γb + (1-γ) R (b + Aμ) = μ,   R = C + I

    Parameters
    ----------
    mean, covariance : (n_features,), (n_features, n_features) array_like
        μ, whitened, and C, Hermitian; positive semidefinite for γ < 1.
    gamma : float
        γ, from 0 (variance under H1 only) to 1 (under H0 only).
    rank : int, optional
        Number of eigenvectors of A kept: the largest eigenvalues, for γ < 1 the largest in
        magnitude. None keeps all.

    Returns
    -------
    LinearQuadraticForm
        The form.

    Raises
    ------
    ValueError
        If γ is out of range or the shapes do not agree.
    """
    mu, C = as_moments(mean, covariance)
    if not 0 <= gamma <= 1:
        raise ValueError(f"gamma must lie between 0 and 1, got {gamma}")
    outer = np.outer(mu, mu.conj())
    if gamma == 1:
        return hermitian_form(C + outer, mu, rank)
    A, b = _generalised(mu, C, gamma)
    return hermitian_form(A, b, rank, by_magnitude=True)


def _generalised(mu: AnyArray, C: AnyArray, gamma: float) -> tuple[AnyArray, AnyArray]:
    """Solve for A and b in the eigenbasis of R.

    There A ↦ γA + (1-γ)RAR is a product element by element.
    """
    values, basis = np.linalg.eigh(C)
    d = values + 1
    m = basis.conj().T @ mu
    weight = 1 / (gamma + (1 - gamma) * np.outer(d, d))
    fixed = weight * (np.diag(values) - np.outer(m, m.conj()))

    # b enters conjugated as well, so the system is linear over the reals only: column k of each
    # half answers a unit vector, real or imaginary.
    def respond(b: AnyArray) -> AnyArray:
        cross = np.outer(b, m.conj())
        return gamma * b + (1 - gamma) * d * (b + (gamma * weight * (cross + cross.conj().T)) @ m)

    units = np.eye(m.size)
    answers = [respond(unit) for unit in units] + [respond(1j * unit) for unit in units]
    system = np.array([np.concatenate([a.real, a.imag]) for a in answers]).T
    right_side = m - (1 - gamma) * d * (fixed @ m)
    solution = np.linalg.solve(system, np.concatenate([right_side.real, right_side.imag]))
    b: AnyArray = solution[: m.size] + 1j * solution[m.size :]
    if not np.iscomplexobj(mu) and not np.iscomplexobj(C):
        b = b.real
    cross = np.outer(b, m.conj())
    A = fixed + gamma * weight * (cross + cross.conj().T)
    return basis @ A @ basis.conj().T, basis @ b


def standardize(form: LinearQuadraticForm) -> LinearQuadraticForm:
    """Scale a form without offsets to mean zero and variance one under CN(0, I).

    Forms can then be compared. Under CN(0, I) ``E(T) = tr A`` and ``Var(T) = ||A||² + 2||b||²``, as
    the form's vectors are orthonormal.
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


class DeflectionDetector(QuadraticDetector):
    """Maximise the deflection, trained on a few whitened target examples.

    ``Â = Σ x x^H / (N - ddof) - I``, ``b̂ = mean x``, and the score is ``Σ σ_j |u_j^H x|² + 2
    Re(b̂^H x)`` over the largest eigenvalues of Â (Cosgrove et al. 2004, Eq. 7-12).

    With fewer examples than features, Eq. 7 gives the eigenvalue -1 in every direction that no
    example reaches, against the paper's "all > 0". Nothing was learned there, so these directions
    are never used; ``n_unseen_`` counts them.

    Parameters
    ----------
    rank : int or None
        M', number of eigenvectors kept; 0 leaves the linear part alone, the matched filter. None
        keeps all that the examples reach.
    ddof : int
        Divisor N - ddof of Eq. 7: 0 is unbiased, 1 is the paper's. Only ``moments="sample"`` has
        it; with another estimator a value other than 0 is a UserWarning.
    gamma : float
        γ of the generalised deflection (Eq. 3); 1 is the paper's.
    positive : bool
        Whether to leave out eigenvectors with negative eigenvalues, the projection of Â on the
        positive semidefinite matrices.
    moments : {"sample", "ledoit-wolf", "oas", "ogk", "clipped"}
        Estimator of mean and covariance of the examples; "sample" is Eq. 7 and 8. "ogk" leaves out
        examples far from the rest (the paper's reference 29); it works with fewer examples than
        features, too.
    classes : {"pooled", "separate"}
        Whether examples of all classes train one form, or each class its own. The score is then the
        largest over the classes' forms, each scaled to mean zero and variance one on clutter.

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
        """Fit the detector to whitened target examples.

        Parameters
        ----------
        X : (n_samples, n_features) array_like
            Examples, real or complex.
        y : (n_samples,) array_like, optional
            Class of each example; used with ``classes="separate"`` only.

        Raises
        ------
        ValueError
            If a parameter breaks its rule or classes are missing.
        """
        self._check_parameters()
        samples = check_samples(self, X, reset=True)
        if self.classes == "separate":
            if y is None or np.shape(y) != (samples.shape[0],):
                raise ValueError(
                    f"y must hold a class for each of the {samples.shape[0]} samples "
                    f'with classes="separate", got {"none" if y is None else np.shape(y)}'
                )
            self.labels_ = np.unique(np.asarray(y))
            learned = [self._learn(samples[np.asarray(y) == label]) for label in self.labels_]
            self.forms_ = tuple(standardize(form) for form, _, _ in learned)
            self.eigenvalues_ = np.stack([values for _, values, _ in learned])
            self.n_unseen_: int | IntArray = np.array([unseen for _, _, unseen in learned])
            return self
        form, self.eigenvalues_, self.n_unseen_ = self._learn(samples)
        self.forms_ = (form,)
        self.labels_ = np.empty(0)
        return self

    def _check_parameters(self) -> None:
        if self.rank is not None and self.rank < 0:
            raise ValueError(f"rank must be at least 0, or not given, got {self.rank}")
        if self.ddof < 0:
            raise ValueError(f"ddof must be at least 0, got {self.ddof}")
        if not 0 <= self.gamma <= 1:
            raise ValueError(f"gamma must lie between 0 and 1, got {self.gamma}")
        moments_estimator(self.moments)
        if self.classes not in ("pooled", "separate"):
            raise ValueError(f"classes must be pooled or separate, got {self.classes!r}")
        _warn_of_unused_ddof(self.moments, self.ddof)

    def _learn(self, x: AnyArray) -> tuple[LinearQuadraticForm, FloatArray, int]:
        """Return the form, all eigenvalues of Â and the number of unseen directions of a class."""
        N, M = x.shape
        if self.ddof >= N:
            raise ValueError(
                f"ddof must be smaller than the number of examples, got {self.ddof} "
                f"with n_samples = {N}"
            )
        if self.moments == "sample":
            b_hat = x.mean(axis=0)  # Eq. 8
            second_moment = x.T @ x.conj() / (N - self.ddof)
        else:
            b_hat, covariance = moments_estimator(self.moments)(x)
            second_moment = covariance + np.outer(b_hat, b_hat.conj())
        A_hat = second_moment - np.eye(M)  # Eq. 7
        sigma, u = np.linalg.eigh(A_hat)  # Eq. 9, ascending
        sigma = sigma[::-1]
        u = u[:, ::-1]
        # Where no example reaches, the second moment is zero and Eq. 7 says -1, but for rounding.
        rounding = M * np.finfo(np.float64).eps * (sigma[0] + 1)
        unseen = int(np.count_nonzero(sigma + 1 <= rounding))
        sigma = np.where(np.arange(M) < M - unseen, sigma, -1.0)
        if self.gamma < 1:
            return self._generalised(b_hat, second_moment), sigma, unseen
        used = np.arange(M - unseen)[: self.rank]  # the M' of Eq. 12
        if self.positive:
            used = used[sigma[used] > 0]
        form = LinearQuadraticForm(sigma[used], u[:, used].T.copy(), b_hat, np.zeros(used.size))
        return form, sigma, unseen

    def _generalised(self, mean: AnyArray, second: AnyArray) -> LinearQuadraticForm:
        """Return the form of the generalised deflection from the moments of one class."""
        # Negative eigenvalues, which no covariance has, are noise of the estimate.
        values, vectors = np.linalg.eigh(second - np.outer(mean, mean.conj()) - np.eye(mean.size))
        covariance = (vectors * np.clip(values, 0, None)) @ vectors.conj().T
        form = deflection_form(mean, covariance, self.gamma, self.rank)
        if not self.positive:
            return LinearQuadraticForm(form.strength, form.vectors, form.linear, form.offset)
        positive = form.strength > 0
        return LinearQuadraticForm(
            form.strength[positive], form.vectors[positive], form.linear, form.offset[positive]
        )


def _warn_of_unused_ddof(moments: str, ddof: int) -> None:
    """Warn of a divisor that the chosen estimator does not use."""
    if moments != "sample" and ddof != 0:
        warnings.warn(
            f"ddof = {ddof} has no effect with moments = {moments!r}, "
            "which has a divisor of its own: leave it 0",
            UserWarning,
            stacklevel=4,
        )


def neyman_pearson_form(
    mean: ArrayLike, covariance: ArrayLike, rank: int | None = None
) -> LinearQuadraticForm:
    """Return the log-likelihood ratio of CN(μ, C + I) to CN(0, I) as a form.

    The constant determinant is left out. With the eigenvalues λ and eigenvectors u of C no large
    matrix is inverted (Cosgrove et al. 2004, Eq. 2)::

        T = -(x-μ)^H (C+I)^-1 (x-μ) + x^H x
          = Σ λ_j/(1+λ_j) |u_j^H (x-μ)|² + 2 Re(μ^H x) - |μ|²

    Parameters
    ----------
    mean, covariance : (n_features,), (n_features, n_features) array_like
        μ, whitened, and C, Hermitian with eigenvalues above -1.
    rank : int, optional
        Number of eigenvectors of C kept, those of the largest eigenvalues; None keeps all.

    Returns
    -------
    LinearQuadraticForm
        The form.

    Raises
    ------
    ValueError
        If the shapes do not agree or an eigenvalue is -1 or less.
    """
    mu, C = as_moments(mean, covariance)
    values, vectors = np.linalg.eigh(C)
    if values[0] <= -1:
        raise ValueError(f"covariance must have eigenvalues above -1, got {values[0]:g}")
    return _from_eigenvectors(mu, values[::-1][:rank], vectors[:, ::-1][:, :rank])


def _from_eigenvectors(mu: AnyArray, values: FloatArray, vectors: AnyArray) -> LinearQuadraticForm:
    """Return the form of Eq. 2 from eigenvalues and eigenvectors of C."""
    rows = vectors.T.copy()
    energy = float(np.sum(np.abs(mu) ** 2))
    return LinearQuadraticForm(values / (1 + values), rows, mu, rows.conj() @ mu, -energy)


class NeymanPearsonDetector(QuadraticDetector):
    """Score by the Gaussian likelihood ratio (Cosgrove et al. 2004, Eq. 2).

    Its moments are estimated from whitened target examples. The covariance of the examples less I
    estimates C. As a covariance has no negative eigenvalue, negative ones are set to zero; a low
    rank and shrinkage keep the inverse in Eq. 2 from following the noise of a few examples.

    Parameters
    ----------
    rank : int or None
        Number of eigenvectors of C kept; None keeps all positive ones.
    shrinkage : float
        Share by which the estimate of C is moved towards zero, from 0 to 1.
    ddof : int
        Divisor N - ddof of the covariance; 0 is maximum likelihood. Only ``moments="sample"`` has
        it.
    moments : {"sample", "ledoit-wolf", "oas", "ogk", "clipped"}
        Estimator of mean and covariance.

    Attributes
    ----------
    eigenvalues_ : (n_features,) ndarray
        Eigenvalues of the estimate of C from the largest down, before negative ones are set to
        zero.
    forms_ : tuple of LinearQuadraticForm
        The form.
    """

    def __init__(
        self, rank: int | None = 3, shrinkage: float = 0.0, ddof: int = 0, moments: str = "sample"
    ) -> None:
        self.rank = rank
        self.shrinkage = shrinkage
        self.ddof = ddof
        self.moments = moments

    def fit(self, X: ArrayLike, y: ArrayLike | None = None) -> Self:  # noqa: ARG002
        """Fit the detector to whitened target examples, real or complex; ``y`` is not used."""
        if self.rank is not None and self.rank < 0:
            raise ValueError(f"rank must be at least 0, or not given, got {self.rank}")
        if not 0 <= self.shrinkage <= 1:
            raise ValueError(f"shrinkage must lie between 0 and 1, got {self.shrinkage}")
        estimate = moments_estimator(self.moments)
        _warn_of_unused_ddof(self.moments, self.ddof)
        samples = check_samples(self, X, reset=True)
        if not 0 <= self.ddof < samples.shape[0]:
            raise ValueError(
                f"ddof must be from 0 to below n_samples = {samples.shape[0]}, got {self.ddof}"
            )
        if self.moments == "sample":
            mean, covariance = sample_moments(samples, self.ddof)
        else:
            mean, covariance = estimate(samples)
        values, vectors = np.linalg.eigh(covariance - np.eye(mean.size))
        self.eigenvalues_ = values[::-1].copy()
        used = np.flatnonzero(values > 0)[::-1][: self.rank]
        shrunk = (1 - self.shrinkage) * values[used]
        self.forms_ = (_from_eigenvectors(mean, shrunk, vectors[:, used]),)
        return self


class PolarimetricWhiteningFilter(QuadraticDetector):
    """Score pixels by the energy of decorrelated polarizations, ``x^H Σ^-1 x`` (Novak et al. 1993).

    Σ, ``covariance_``, is the second moment of clutter pixels, as the clutter is taken to have no
    mean; the mean score of clutter is the number of features. Any set of polarizations will do;
    Cosgrove et al. 2004 (Sec. III-C and IV-B) use HH and VV. The form, for chips of one pixel, is
    the only one in ``forms_``.

    Parameters
    ----------
    moments : {"sample", "ledoit-wolf", "oas", "ogk", "clipped"}
        Estimator of Σ; all but "sample" estimate a mean, whose outer product is added.
    """

    def __init__(self, moments: str = "sample") -> None:
        self.moments = moments

    def fit(self, X: ArrayLike, y: ArrayLike | None = None) -> Self:  # noqa: ARG002
        """Fit the filter to pixels of clutter, (n_samples, n_features): one per polarization."""
        estimate = moments_estimator(self.moments)
        samples = check_samples(self, X, reset=True)
        mean, covariance = estimate(samples)
        self.covariance_: AnyArray = covariance + np.outer(mean, mean.conj())
        values, vectors = np.linalg.eigh(self.covariance_)
        if not values[0] > values.size * np.finfo(np.float64).eps * values[-1]:
            raise ValueError(
                f"X must span all {values.size} features for Σ to have an inverse, "
                f"got n_samples = {samples.shape[0]} "
                f"with second moments from {values[0]:g} to {values[-1]:g}"
            )
        zero = np.zeros(values.size)
        self.forms_ = (LinearQuadraticForm(1 / values, vectors.T.copy(), zero, zero),)
        return self


def magnitude_form(channels: int, channel: int = 0) -> LinearQuadraticForm:
    """Return the form ``|x_channel|²`` on pixels of several channels: one polarization alone."""
    if not 0 <= channel < channels:
        raise ValueError(f"channel must be from 0 to {channels - 1}, got {channel}")
    return LinearQuadraticForm(
        np.ones(1), np.eye(channels)[[channel]], np.zeros(channels), np.zeros(1)
    )
