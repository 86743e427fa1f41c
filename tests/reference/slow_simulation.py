"""The simulator's sums written out in double precision, scatterer by scatterer and tone by tone."""

import numpy as np

C = 299792458.0


def horn_gain(antenna, point, boresight, exponent):
    """Amplitude cos^(n/2) of the angle off the axis, over the distance; of one point or of many."""
    ray = point - antenna
    r = np.linalg.norm(ray, axis=-1)
    return np.maximum(ray @ boresight / r, 0.0) ** (exponent / 2) / r, r


def dipole_gain(antenna, point):
    """Answers of an x and a z dipole in the directions h and v across the ray, over the distance: (2, 2), r."""
    ray = point - antenna
    r = np.linalg.norm(ray)
    k = ray / r
    h = np.array([k[1], -k[0], 0]) / np.hypot(k[0], k[1])
    v = np.cross(h, k)
    if v[2] < 0:
        v = -v
    return np.array(
        [[axis @ h, axis @ v] for axis in (np.array([1.0, 0, 0]), np.array([0, 0, 1.0]))]
    ) / r, r


def sum_points(points, spectrum, frequency, tx, rx, boresight, exponent):
    """Horns: ``Σ_i g_t·g_r·spectrum_i(f)·exp(-j2πf(R_t + R_r)/c)``; spectrum (point, channel, frequency)."""
    out = np.zeros((spectrum.shape[1], len(tx), frequency.size), complex)
    for q in range(len(tx)):
        for point, values in zip(points, spectrum, strict=True):
            a, ra = horn_gain(tx[q], point, boresight, exponent)
            b, rb = horn_gain(rx[q], point, boresight, exponent)
            out[:, q] += a * b * values * np.exp(-2j * np.pi * frequency * (ra + rb) / C)
    return out


def sum_dipoles(points, spectrum, frequency, tx, rx):
    """Dipoles: HH, HV, VH, VV of scatterers with the matrix [[hh, x + y], [x - y, vv]] in the rays' own directions.

    Spectrum (point, 3 or 4, frequency) of hh, vv, x and y.
    """
    out = np.zeros((4, len(tx), frequency.size), complex)
    for q in range(len(tx)):
        for point, (hh, vv, x, *odd) in zip(points, spectrum, strict=True):
            y = odd[0] if odd else 0
            a, ra = dipole_gain(tx[q], point)
            b, rb = dipole_gain(rx[q], point)
            wave = np.exp(-2j * np.pi * frequency * (ra + rb) / C)
            for i in range(2):
                for j in range(2):
                    copolar = a[i, 0] * b[j, 0] * hh + a[i, 1] * b[j, 1] * vv
                    value = copolar + a[i, 0] * b[j, 1] * (x + y) + a[i, 1] * b[j, 0] * (x - y)
                    out[2 * i + j, q] += value * wave
    return out


def sum_swept(points, spectrum, frequency, tx, rx, boresight, exponents, drift):
    """Horns whose n depends on the tone and that move by ``drift`` in a sweep: every tone from its own places."""
    out = np.zeros((3, len(tx), frequency.size), complex)
    for k, f in enumerate(frequency):
        moved = drift * (k - frequency.size // 2) / frequency.size
        for q in range(len(tx)):
            a, ra = horn_gain(tx[q] + moved, points, boresight, exponents[k])
            b, rb = horn_gain(rx[q] + moved, points, boresight, exponents[k])
            out[:, q, k] = (a * b * np.exp(-2j * np.pi * f * (ra + rb) / C)) @ spectrum[:, :, k]
    return out
