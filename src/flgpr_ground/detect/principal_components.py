"""The Gaussian likelihood ratio of the principal components of mines (after Kositsky et al. 2002).

J. Kositsky, R. Cosgrove, C. Amazeen & P. Milanfar, "Results from a forward-looking GPR mine
detection system", Proc. SPIE 4742, 2002. Of that paper the abstract could be read. The equations
are those that three of its authors give for the same data and radar (Cosgrove et al. 2004, Sec. II,
the "generalized likelihood approach").
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any, Self

import numpy as np
from sklearn.base import BaseEstimator
from sklearn.utils.validation import check_is_fitted

from flgpr.detect.deflection import NeymanPearsonDetector
from flgpr.detect.linear_quadratic import LinearQuadraticForm
from flgpr.kernels.moments import check_samples
from flgpr.types import ArrayLike, FloatArray


class PrincipalComponentDetector(BaseEstimator):  # type: ignore[misc]
    """Score whitened samples by ``ln p(x | mine) / p(x | clutter)``.

    Clutter is ``CN(0, I)`` and a mine ``CN(μ, I + Σ_j v_j u_j u_jᴴ)``, where μ is the mean of the
    examples, ``u_j`` are their principal components and ``1 + v_j`` the variances along them: those
    of the largest ``rank`` that exceed the clutter's. They maximise the likelihood of the examples.
    Other than :class:`NeymanPearsonDetector`, whose score lacks a constant, scores of detectors of
    several looks add up to the likelihood ratio of all looks, if looks are independent.

    Parameters
    ----------
    rank : int
        Most principal components.

    Attributes
    ----------
    eigenvalues_ : (n_features,) ndarray
        ``v_j`` of all components from the largest down, also of those that are not used.
    forms_ : tuple of LinearQuadraticForm
        The log-likelihood ratio.
    """

    def __init__(self, rank: int = 3) -> None:
        self.rank = rank

    def fit(self, X: ArrayLike, y: ArrayLike | None = None) -> Self:  # noqa: ARG002
        """Fit the components to whitened target examples, real or complex; ``y`` is not used."""
        samples = check_samples(self, X, reset=True)
        trained = NeymanPearsonDetector(self.rank).fit(samples)
        self.eigenvalues_ = trained.eigenvalues_
        self.forms_ = (_with_determinant(trained.forms_[0]),)
        return self

    def decision_function(self, X: ArrayLike) -> FloatArray:
        """Return the log-likelihood ratios of whitened samples."""
        check_is_fitted(self)
        return self.forms_[0](check_samples(self, X, reset=False))


def _with_determinant(form: LinearQuadraticForm) -> LinearQuadraticForm:
    """Return the form of Eq. 2 less ``Σ ln(1 + v_j)``, the constant that it leaves out.

    Its strengths are ``v / (1 + v)``, and ``ln(1 + v) = -ln(1 - v / (1 + v))``.
    """
    log_determinant: Any = -np.log1p(-form.strength).sum()
    return replace(form, constant=form.constant - float(log_determinant))
