"""The mode of logistic weights under a Laplacian prior, by scikit-learn's liblinear, which has another algorithm."""

import numpy as np
import sklearn
from sklearn.linear_model import LogisticRegression

SCIKIT_LEARN = tuple(int(part) for part in sklearn.__version__.split(".")[:2])
LAPLACIAN = {"l1_ratio": 1.0} if SCIKIT_LEARN >= (1, 8) else {"penalty": "l1"}


def liblinear_weights(design, target, scale):
    """Give the weights (basis,) at the least penalised loss."""
    machine = LogisticRegression(
        **LAPLACIAN,
        solver="liblinear",
        C=1 / scale,
        tol=1e-10,
        max_iter=20_000,
        fit_intercept=False,
    )
    return machine.fit(design, target).coef_[0]


def penalised_loss(design, target, weights, scale, offset=0.0):
    """-log p(t | w) + scale · Σ|w|."""
    argument = design @ weights + offset
    sign = 2 * np.asarray(target) - 1
    return np.logaddexp(0, -sign * argument).sum() + scale * np.abs(weights).sum()
