"""flsar2004's prescreeners and features with loops."""

import math

import numpy as np


def paragraph_22_correlation(region, template):
    """Largest modulus of the inner product of a unit region and a unit template over every shift, zeros outside."""
    region = region / math.sqrt(np.sum(np.abs(region) ** 2))
    template = template / math.sqrt(np.sum(np.abs(template) ** 2))
    ny, nx = region.shape
    vy, vx = template.shape
    best = 0.0
    for dy in range(-vy + 1, ny):
        for dx in range(-vx + 1, nx):
            total = 0.0
            for v in range(vy):
                for u in range(vx):
                    if 0 <= v + dy < ny and 0 <= u + dx < nx:
                        total += region[v + dy, u + dx] * np.conj(template[v, u])
            best = max(best, abs(total))
    return best


def section_311_clusters(values, x, y, threshold, radius):
    """(place of the strongest pixel, amplitudes) of each cluster, strongest first; only local maxima lead one."""
    marked = [
        (values[j, i], j, i)
        for j in range(len(y))
        for i in range(len(x))
        if values[j, i] > threshold
    ]
    marked.sort(key=lambda m: (-m[0], m[1], m[2]))

    def near(m, n):
        return math.hypot(x[m[2]] - x[n[2]], y[m[1]] - y[n[1]]) <= radius + 1e-9

    leaders = [m for k, m in enumerate(marked) if not any(near(m, n) for n in marked[:k])]
    clusters = {m: [] for m in leaders}
    for m in marked:
        joined = next((leader for leader in leaders if near(m, leader)), None)
        if joined is not None:
            clusters[joined].append(m[0])
    return [((x[i], y[j]), amplitudes) for (_, j, i), amplitudes in clusters.items()]


def section_313_ratio(values, x, y, u, v, half_x, half_y):
    e_in = e_out = 0.0
    for j in range(len(y)):
        for i in range(len(x)):
            if abs(x[i] - u) <= 2 * half_x and abs(y[j] - v) <= 2 * half_y:
                if ((x[i] - u) / half_x) ** 2 + ((y[j] - v) / half_y) ** 2 <= 1:
                    e_in += values[j, i] ** 2
                else:
                    e_out += values[j, i] ** 2
    return e_out / e_in
