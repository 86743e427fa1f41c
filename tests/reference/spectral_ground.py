"""A short dipole over plane ground by its spectrum of plane waves (Weyl 1919, Sommerfeld 1926), summed outright.

Every plane wave, propagating or fading, is reflected by Fresnel's coefficient of its own angle. Nothing is assumed of
angle or distance, so that this is the exact field above flat soil.
"""

import numpy as np

C = 299792458.0
VACUUM_PERMEABILITY = 4e-7 * np.pi


def reflected_field(tx, rx, sent, taken, frequency, permittivity, angles=3000, azimuths=400):
    """j times the reflected field along ``taken`` of a unit current moment along ``sent``, V/m per A·m.

    ``tx`` and ``rx`` are places (3,), m, over the plane z = 0.
    """
    k = 2 * np.pi * frequency / C
    # From 0 to a right angle, and on along the imaginary axis, where waves fade with height.
    ends = 4.0
    real = (np.arange(angles) + 0.5) / angles * np.pi / 2
    fading = (np.arange(angles) + 0.5) / angles * ends
    theta = np.concatenate([real + 0j, np.pi / 2 + 1j * fading])
    weight = np.concatenate(
        [np.full(angles, np.pi / 2 / angles) + 0j, np.full(angles, 1j * ends / angles)]
    )
    sine, cosine = np.sin(theta), np.cos(theta)
    inner = np.sqrt(permittivity - sine**2)
    reflect_s = (cosine - inner) / (cosine + inner)
    reflect_p = (permittivity * cosine - inner) / (permittivity * cosine + inner)
    height = tx[2] + rx[2]
    radial = weight * k * sine * np.exp(-1j * k * cosine * height)
    dx, dy = rx[0] - tx[0], rx[1] - tx[1]
    total = 0j
    for phi in 2 * np.pi * np.arange(azimuths) / azimuths:
        c, s = np.cos(phi), np.sin(phi)
        across = np.array([-s, c, 0.0])
        # h x k/k of the wave that goes down, and of the one that comes up.
        down = np.stack([-cosine * c, -cosine * s, -sine])
        up = np.stack([cosine * c, cosine * s, -sine])
        in_s = reflect_s * (across @ sent) * (across @ taken)
        in_p = reflect_p * (sent @ down) * (taken @ up)
        phase = np.exp(-1j * k * sine * (c * dx + s * dy))
        total += (radial * (in_s + in_p) * phase).sum()
    # d(kx) d(ky)/kz = k·sin(theta) d(theta) d(phi)
    total *= 2 * np.pi / azimuths
    return -1j * 2 * np.pi * frequency * VACUUM_PERMEABILITY / (8 * np.pi**2) * total
