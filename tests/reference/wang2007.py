"""Wang et al. 2007, equation by equation, with loops."""

import math

import numpy as np


def r_k(v):
    m = sorted(abs(v).ravel())
    lowest = m[: int(0.75 * len(m))]
    return math.sqrt(sum(x * x for x in lowest) / len(lowest))


def equation_2_self_signature(scans):
    total = np.zeros(scans[0].shape, complex)
    for v in scans:
        m, theta = np.abs(v), np.angle(v)
        limit = m.mean() + 5 * m.std()
        for index in np.ndindex(v.shape):
            total[index] += min(m[index], limit) * np.exp(1j * theta[index]) / r_k(v)
    return total / len(scans)


def window(array, y, x, size):
    hy, hx = size[0] // 2, size[1] // 2
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
    ins, outs = [], []
    for y, x in np.ndindex(patch.shape):
        dy, dx = abs(y - n), abs(x - n)
        if dx <= inner[0] // 2 and dy <= inner[1] // 2:
            ins.append(patch[y, x])
        if dx > guard[0] // 2 or dy > guard[1] // 2:
            outs.append(patch[y, x])
    m_in, mu, sigma = max(ins), sum(outs) / len(outs), np.std(outs)
    return m_in, (m_in - mu) / sigma
