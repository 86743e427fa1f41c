"""Slow twins of Cosgrove et al. 2004, written from its equations."""

import numpy as np


def equation_2(x, mu, C):
    """Neyman-Pearson statistic, by inverting C + I."""
    rest = x - mu
    return float((-rest.conj() @ np.linalg.inv(C + np.eye(mu.size)) @ rest + x.conj() @ x).real)


def equation_4(x, A, b):
    """Linear-quadratic form."""
    return float((x.conj() @ A @ x + x.conj() @ b + b.conj() @ x).real)


def equations_7_to_12(x, examples, rank, ddof):
    """Detector output for one vector after training on examples, example by example."""
    count, features = examples.shape
    A = np.zeros((features, features), complex)
    b = np.zeros(features, complex)
    for example in examples:
        A += np.outer(example, example.conj()) / (count - ddof)
        b += example / count
    A -= np.eye(features)
    sigma, u = np.linalg.eigh(A)
    total = 2 * (x.conj() @ b).real
    for j in np.argsort(-sigma)[:rank]:
        total += sigma[j] * abs(x.conj() @ u[:, j]) ** 2
    return float(total)


def deflection(A, b, mu, C, gamma=1.0):
    """Generalised deflection (Eq. 3) of Eq. 4 from its mean and variance for circular Gaussian data."""
    R = C + np.eye(mu.size)
    eye = np.eye(mu.size)
    gain = np.trace(A @ C).real + (mu.conj() @ A @ mu).real + 2 * (b.conj() @ mu).real

    def variance(S, centre):
        g = b + A @ centre
        return np.trace(A @ S @ A @ S).real + 2 * (g.conj() @ S @ g).real

    return gain**2 / (gamma * variance(eye, 0 * mu) + (1 - gamma) * variance(R, mu))


def likelihood_map(image, shape, score):
    """Score of the chip about every pixel, pixel by pixel; NaN where it leaves the image."""
    (v, u), (channels, rows, columns) = shape, image.shape
    out = np.full((rows, columns), np.nan)
    for row in range(rows):
        for column in range(columns):
            top = row - v // 2
            left = column - u // 2
            if top < 0 or left < 0 or top + v > rows or left + u > columns:
                continue
            cut = np.concatenate(
                [image[c, top : top + v, left : left + u].ravel() for c in range(channels)]
            )
            if np.isfinite(cut).all():
                out[row, column] = score(cut)
    return out


def circular(rng, mean, covariance, count):
    """Draw CN(mean, covariance), one vector per row."""
    root = np.linalg.cholesky(covariance)
    noise = rng.normal(size=(2, count, mean.size)) / np.sqrt(2)
    return mean + (noise[0] + 1j * noise[1]) @ root.T


def tau_scale(values):
    """τ-scale of Yohai & Zamar 1988 with its location, value by value."""
    median = np.median(values)
    spread = np.median(np.abs(values - median))
    weights = [max(1 - ((v - median) / (4.5 * spread)) ** 2, 0) ** 2 for v in values]
    location = sum(w * v for w, v in zip(weights, values, strict=True)) / sum(weights)
    squares = [min(((v - location) / spread) ** 2, 9.0) for v in values]
    return location, spread * np.sqrt(sum(squares) / len(squares))


def ogk_distances(rows):
    """Squared robust distance of every row by two passes over orthogonal pairs (Maronna & Zamar 2002, Sec. 4)."""
    z = rows
    for _ in range(2):
        features = z.shape[1]
        y = z / [tau_scale(z[:, j])[1] for j in range(features)]
        U = np.eye(features)
        for j in range(features):
            for k in range(features):
                if j != k:
                    U[j, k] = (
                        tau_scale(y[:, j] + y[:, k])[1] ** 2 - tau_scale(y[:, j] - y[:, k])[1] ** 2
                    ) / 4
        z = y @ np.linalg.eigh(U)[1]
    away = [(z[:, j] - tau_scale(z[:, j])[0]) / tau_scale(z[:, j])[1] for j in range(z.shape[1])]
    return np.sum(np.square(away), axis=0)
