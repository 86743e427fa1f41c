"""Mie's series for a homogeneous sphere in a medium that may absorb (Bohren & Huffman 1983, section 4.4)."""

import numpy as np
from scipy.special import spherical_jn, spherical_yn


def coefficients(size, index):
    """a_n and b_n (their Eq. 4.53) of a sphere with size parameter and relative index, for fields e^{+jωt}."""
    order = np.arange(1, int(abs(size) + 4 * abs(size) ** (1 / 3) + 8))

    def riccati(z, function):
        return z * function(order, z), function(order, z) + z * function(order, z, derivative=True)

    psi, psi_slope = riccati(size, spherical_jn)
    chi, chi_slope = riccati(size, spherical_yn)
    xi = psi - 1j * chi
    xi_slope = psi_slope - 1j * chi_slope
    inner, inner_slope = riccati(index * size, spherical_jn)
    a = (index * inner * psi_slope - psi * inner_slope) / (
        index * inner * xi_slope - xi * inner_slope
    )
    b = (inner * psi_slope - index * psi * inner_slope) / (
        inner * xi_slope - index * xi * inner_slope
    )
    return a, b


def amplitudes(size, index, cosine):
    """S1 and S2 (their Eq. 4.74) at a scattering angle given by its cosine, complex for complex wave vectors."""
    a, b = coefficients(size, index)
    s1 = s2 = 0j
    before = 0
    pi = 1
    for n in range(1, a.size + 1):
        tau = n * cosine * pi - (n + 1) * before
        weight = (2 * n + 1) / (n * (n + 1))
        s1 += weight * (a[n - 1] * pi + b[n - 1] * tau)
        s2 += weight * (a[n - 1] * tau + b[n - 1] * pi)
        before, pi = pi, ((2 * n + 1) * cosine * pi - (n + 1) * before) / n
    return s1, s2


def unit_vectors(transverse, azimuth, wavenumber):
    """Direction of a downgoing wave in the soil, and its H and V vectors as the signatures have them."""
    down = np.sqrt(wavenumber**2 - transverse**2 + 0j)
    c = np.cos(azimuth)
    s = np.sin(azimuth)
    direction = np.array([transverse * c, transverse * s, -down]) / wavenumber
    return direction, np.array(
        [[-s, c, 0], np.array([down * c, down * s, transverse]) / wavenumber]
    )


def sphere_amplitudes(radius, inside, outside, wavenumber, transverse, sent, received):
    """F (2 received, 2 sent), m, about the sphere's centre; waves go down with azimuths ``sent`` and ``received``."""
    k = wavenumber * np.sqrt(complex(outside))
    incoming, of_sent = unit_vectors(transverse, sent, k)
    back, of_received = unit_vectors(transverse, received, k)
    outgoing = -back
    s1, s2 = amplitudes(k * radius, np.sqrt(complex(inside) / outside), incoming @ outgoing)
    normal = np.cross(incoming, outgoing)
    normal = of_sent[0] if np.allclose(normal, 0) else normal / np.sqrt(normal @ normal)
    across = s1 * np.outer(of_received @ normal, of_sent @ normal)
    along = s2 * np.outer(
        of_received @ np.cross(normal, outgoing), of_sent @ np.cross(normal, incoming)
    )
    return (across + along) / (1j * k)
