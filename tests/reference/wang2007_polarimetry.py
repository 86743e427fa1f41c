"""Wang et al. 2007, Eq. 9-15, for one scattering matrix at a time, by general-purpose linear algebra and search."""

import math

import numpy as np


def equation_10_entropy_alpha(scatterers, share=None):
    """H and alpha of weighted 2 x 2 scattering matrices."""
    share = np.full(len(scatterers), 1 / len(scatterers)) if share is None else share
    q = np.zeros((3, 3), complex)
    for weight, s in zip(share, scatterers, strict=True):
        row = np.array([s[0][0] + s[1][1], s[0][0] - s[1][1], 2 * s[0][1]]).reshape(1, 3)
        q += weight * row.T @ row.conj() / 2
    values, vectors = np.linalg.eigh(q)
    p = np.clip(values, 0, None) / np.clip(values, 0, None).sum()
    h = -sum(x * math.log(x, 3) for x in p if x > 0)
    alpha = sum(x * math.acos(min(1.0, abs(e[0]))) for x, e in zip(p, vectors.T, strict=True))
    return h, alpha


def inner(a, b):
    return (np.asarray(a).ravel() * np.asarray(b).conj().ravel()).sum()


def _trial(t):
    return np.array([[np.cos(t), np.sin(t)], [np.sin(t), -np.cos(t)]]) / math.sqrt(2)


def equation_14_symmetric_part(s):
    """S_sym by trying many angles, then more about the best of them (Eq. 13 and 14)."""
    s_a = np.eye(2) / math.sqrt(2)
    centre = 0.0
    reach = math.pi / 2
    for _ in range(8):
        angles = np.linspace(centre - reach, centre + reach, 41)
        centre = angles[np.abs(np.tensordot(s, _trial(angles))).argmax()]
        reach = reach / 10
    return inner(s, s_a) * s_a + inner(s, _trial(centre)) * _trial(centre)


def equation_15_tau(s):
    s_sym = equation_14_symmetric_part(s)
    cosine = abs(inner(s_sym, s)) / (np.linalg.norm(s_sym) * np.linalg.norm(s))
    return math.acos(min(1.0, cosine))


def psi_by_eigenvectors(s):
    """Angle of the eigenvector of S_sym with the eigenvalue of larger modulus."""
    s_sym = equation_14_symmetric_part(s)
    phase = s_sym / s_sym.ravel()[np.argmax(np.abs(s_sym))]
    values, vectors = np.linalg.eig(phase)
    x, y = vectors[:, np.argmax(np.abs(values))]
    turn = x if abs(x) >= abs(y) else y
    x, y = (x / turn).real, (y / turn).real
    psi = math.atan2(y, x)
    return psi - math.pi if psi > math.pi / 2 else psi + math.pi if psi <= -math.pi / 2 else psi
