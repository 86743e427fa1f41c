"""The relevance vector machine of Tipping 2001, dense and slow: every basis function, every matrix written out."""

import numpy as np


def sigma(a):
    return 1 / (1 + np.exp(-a))


def equation_24_log_posterior(w, design, t, alpha, offset=0.0):
    y = sigma(design @ w + offset)
    return np.log(np.where(t == 1, y, 1 - y)).sum() - 0.5 * w @ np.diag(alpha) @ w


def mode_and_covariance(design, t, alpha, offset=0.0):
    """Newton's method (Eq. 25-26), halving steps that do not climb."""
    w = np.zeros(design.shape[1])
    for _ in range(200):
        y = sigma(design @ w + offset)
        B = np.diag(y * (1 - y))
        H = design.T @ B @ design + np.diag(alpha)
        g = design.T @ (t - y) - alpha * w
        step = np.linalg.solve(H, g)
        least = equation_24_log_posterior(w, design, t, alpha, offset) - 1e-12
        while equation_24_log_posterior(w + step, design, t, alpha, offset) < least:
            step = step / 2
        w = w + step
        if np.abs(step).max() < 1e-10:
            break
    y = sigma(design @ w + offset)
    B = np.diag(y * (1 - y))
    return w, np.linalg.inv(design.T @ B @ design + np.diag(alpha)), B, y


def log_evidence(design, t, alpha, offset=0.0):
    """Laplace's approximation of log p(t | alpha)."""
    w, covariance, _, _ = mode_and_covariance(design, t, alpha, offset)
    peak = equation_24_log_posterior(w, design, t, alpha, offset)
    return peak + 0.5 * np.sum(np.log(alpha)) + 0.5 * np.linalg.slogdet(covariance)[1]


def equation_16_updates(design, t, rounds, offset=0.0, threshold=1e9):
    """All precisions at once, alpha = gamma / w², those beyond the threshold pruned."""
    active = np.arange(design.shape[1])
    alpha = np.ones(design.shape[1])
    for _ in range(rounds):
        w, covariance, _, _ = mode_and_covariance(design[:, active], t, alpha, offset)
        gamma = 1 - alpha * np.diag(covariance)
        alpha = gamma / w**2
        keep = alpha < threshold
        active = active[keep]
        alpha = alpha[keep]
    return active, alpha


def sparsity_and_quality(design, t, active, alpha, offset=0.0):
    """s and q of every basis function by the formulas of Tipping & Faul 2003, Eq. 24-25, with the targets t-hat."""
    phi = design[:, active]
    w, covariance, B, y = mode_and_covariance(phi, t, alpha, offset)
    t_hat = phi @ w + np.linalg.inv(B) @ (t - y)
    s = np.empty(design.shape[1])
    q = np.empty(design.shape[1])
    for i in range(design.shape[1]):
        column = design[:, i]
        S = column @ B @ column - column @ B @ phi @ covariance @ phi.T @ B @ column
        Q = column @ B @ t_hat - column @ B @ phi @ covariance @ phi.T @ B @ t_hat
        own = np.flatnonzero(active == i)
        if own.size:
            a = alpha[own[0]]
            S, Q = a * S / (a - S), a * Q / (a - S)
        s[i] = S
        q[i] = Q
    return s, q
