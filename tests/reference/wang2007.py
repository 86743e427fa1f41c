"""Wang et al. 2007, equation by equation, with loops."""

import math
from statistics import NormalDist

import numpy as np

from flgpr.kernels.sampling import bilinear
from reference.wang2007_polarimetry import (
    equation_10_entropy_alpha,
    equation_15_tau,
    psi_by_eigenvectors,
)


def r_k(v):
    m = sorted(abs(v).ravel())
    lowest = m[: int(0.75 * len(m))]
    return math.sqrt(sum(x * x for x in lowest) / len(lowest))


def equation_2_self_signature(scans):
    total = np.zeros(scans[0].shape, complex)
    for v in scans:
        m = np.abs(v)
        theta = np.angle(v)
        limit = m.mean() + 5 * m.std()
        for index in np.ndindex(v.shape):
            total[index] += min(m[index], limit) * np.exp(1j * theta[index]) / r_k(v)
    return total / len(scans)


def clipped(v):
    m = np.abs(v)
    return v * np.minimum(m, m.mean() + 5 * m.std()) / m


def window(array, y, x, size):
    hy = size[0] // 2
    hx = size[1] // 2
    return array[max(0, y - hy) : y + hy + 1, max(0, x - hx) : x + hx + 1]


def filtered(array, size, statistic):
    out = np.empty(array.shape)
    for y, x in np.ndindex(array.shape):
        out[y, x] = statistic(window(array, y, x, size))
    return out


def equation_4_gain_background(scans, b1, median_size, mean_size):
    total = np.zeros(b1.shape)
    for v in scans:
        m = np.abs(v / r_k(v) - b1)  # Eq. 3
        total += filtered(filtered(m, median_size, np.median), mean_size, np.mean)
    return total / len(scans)


def equation_5_magnitude(v, b1, b2):
    return np.abs((v / r_k(v) - b1) / b2)


def second_largest(values):
    seen = sorted(v for v in values if not math.isnan(v))
    if not seen:
        return math.nan
    return seen[0] if len(seen) == 1 else seen[-2]


def local_maxima(values, spacing, radius):
    ny, nx = values.shape
    found = []
    for y in range(1, ny - 1):
        for x in range(1, nx - 1):
            disc = [
                values[v, u]
                for v, u in np.ndindex(values.shape)
                if math.hypot((v - y) * spacing, (u - x) * spacing) <= radius + 1e-12
            ]
            if values[y, x] == max(disc):
                found.append((values[y, x], y, x))
    return sorted(found, reverse=True)


def equation_7_contrast(patch, inner, guard):
    n = patch.shape[0] // 2
    ins = []
    outs = []
    for y, x in np.ndindex(patch.shape):
        dy = abs(y - n)
        dx = abs(x - n)
        if dx <= inner[0] // 2 and dy <= inner[1] // 2:
            ins.append(patch[y, x])
        if dx > guard[0] // 2 or dy > guard[1] // 2:
            outs.append(patch[y, x])
    m_in = max(ins)
    mu = sum(outs) / len(outs)
    sigma = np.std(outs)
    return m_in, (m_in - mu) / sigma


def equation_7_mean_over_scans(images, alarms, y_max, inner=(5, 3), guard=(9, 7)):
    """Take magnitudes (y, x, values, pose) scan by scan, patches cut at the border; weigh C by the peaks."""
    along = 0.1 * np.arange(-12, 13)
    total = np.zeros(len(alarms))
    weight = np.zeros(len(alarms))
    scans = np.zeros(len(alarms))
    for y, x, values, pose in images:
        for i, (u, v) in enumerate(zip(alarms["x"] - pose[0], alarms["y"] - pose[1], strict=True)):
            if v > y_max:
                continue
            row, column = np.meshgrid(
                (v + along - y[0]) / (y[1] - y[0]),
                (u + along - x[0]) / (x[1] - x[0]),
                indexing="ij",
            )
            patch = bilinear(values, row, column).astype(float)
            dy, dx = np.abs(np.mgrid[-12:13, -12:13])
            inside = patch[(dx <= inner[0] // 2) & (dy <= inner[1] // 2)]
            outside = patch[(dx > guard[0] // 2) | (dy > guard[1] // 2)]
            outside = outside[np.isfinite(outside)]
            if np.isfinite(inside).all() and outside.size > 1 and outside.std() > 0:
                peak = inside.max()
                total[i] += peak * (peak - outside.mean()) / outside.std()
                weight[i] += peak
                scans[i] += 1
    return total / np.where(scans > 0, weight, np.nan), scans


def _inner(patch, size):
    n = patch.shape[-1] // 2
    return patch[
        ..., n - size[1] // 2 : n + size[1] // 2 + 1, n - size[0] // 2 : n + size[0] // 2 + 1
    ]


def equations_6_to_17_features(magnitude, coherent, inner, guard, psi="circular"):
    """Take patches (polarization HH VV HV, y, x) of every scan that counts; ``inner`` is cross-track x down-track."""
    m = {
        pol: [_inner(patch[p], inner).max() for patch in magnitude]
        for p, pol in enumerate(("HH", "VV", "HV"))
    }
    mu = {
        pol: [_inner(patch[p], inner).mean() for patch in magnitude]
        for p, pol in enumerate(("HH", "VV", "HV"))
    }
    ten = {}
    for p, pol in enumerate(("HH", "VV")):
        c = [equation_7_contrast(patch[p].astype(float), inner, guard)[1] for patch in magnitude]
        ratio = [a / b for a, b in zip(mu[pol], mu["HV"], strict=True)]
        ten[f"M_{pol}"] = max(m[pol])
        ten[f"C_{pol}"] = sum(w * v for w, v in zip(m[pol], c, strict=True)) / sum(m[pol])
        ten[f"R_{pol}_HV"] = sum(w * v for w, v in zip(m[pol], ratio, strict=True)) / sum(m[pol])
    sums = dict.fromkeys(("P_H", "P_alpha", "P_tau", "P_psi"), 0.0)
    turn = 0j
    for patch, weight in zip(coherent, m["HH"], strict=True):
        n = patch.shape[-1] // 2
        pixels = inner[0] * inner[1]
        for y in range(n - inner[1] // 2, n + inner[1] // 2 + 1):
            for x in range(n - inner[0] // 2, n + inner[0] // 2 + 1):
                s = [
                    [[hh, hv], [hv, vv]]
                    for hh, vv, hv in patch[:, y - 2 : y + 3, x - 2 : x + 3].reshape(3, -1).T
                ]
                h, alpha = equation_10_entropy_alpha(s)
                here = np.array(
                    [[patch[0, y, x], patch[2, y, x]], [patch[2, y, x], patch[1, y, x]]]
                )
                angle = psi_by_eigenvectors(here)
                turn += weight * np.exp(2j * angle) / pixels
                for name, value in zip(sums, (h, alpha, equation_15_tau(here), angle), strict=True):
                    sums[name] += weight * value / pixels
    ten |= {name: value / sum(m["HH"]) for name, value in sums.items()}
    if psi == "circular":
        ten["P_psi"] = np.angle(turn) / 2
    return ten


def equation_19_w(distances, r_label):
    """Shares of the alarms of one target."""
    w = [math.exp(-(d**2) / r_label**2) for d in distances]
    return [x / sum(w) for x in w]


def equation_18_weights(target, distance, w0, beta, r_label):
    weights = []
    for i, t in enumerate(target):
        if t < 0:
            weights.append(1)
            continue
        same = [j for j in range(len(target)) if target[j] == t]
        w = equation_19_w([distance[j] for j in same], r_label)[same.index(i)]
        weights.append(max(1, math.floor(w0 * beta[i] * w + 0.5)))
    return weights


def normalised_b(k, n):
    """b_k of the corrected normalisation, by the standard library."""
    phi = NormalDist()
    return phi.inv_cdf(phi.cdf(-1) + (k - 1) / (n - 1) * (phi.cdf(1) - phi.cdf(-1)))


def equation_20_direction(samples, label):
    u1, u2 = (samples[label == k].mean(axis=0) for k in (0, 1))
    s_w = np.zeros((samples.shape[1],) * 2)
    for x, k in zip(samples, label, strict=True):
        d = x - (u2 if k else u1)
        s_w += np.outer(d, d)
    return (u2 - u1) @ np.linalg.inv(s_w / len(samples))
