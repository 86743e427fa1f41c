"""What parallel dielectric cylinders scatter of a line source, exactly: Mie's series of each, joined by Graf's theorem.

Everything is two-dimensional, E along the cylinders, with ``exp(+jωt)``: a wave that travels away over a length L has
the phase ``-kL``. Series and addition theorem are those of textbooks (Balanis 2012, Advanced Engineering
Electromagnetics, Sec. 11.5 and 11.6; Abramowitz & Stegun 9.1.79).
"""

from itertools import pairwise

import numpy as np
from scipy.special import h2vp, hankel2, jv, jvp

SPEED = 299_792_458.0


def reflections(wavenumber, radius, permittivity, orders):
    """Return the coefficients (order,) by which a cylinder turns incident waves J_n into outgoing ones H_n."""
    inside = wavenumber * np.sqrt(permittivity)
    x = wavenumber * radius
    y = inside * radius
    above = wavenumber * jvp(orders, x) * jv(orders, y) - inside * jv(orders, x) * jvp(orders, y)
    below = wavenumber * h2vp(orders, x) * jv(orders, y) - inside * hankel2(orders, x) * jvp(
        orders, y
    )
    return -above / below


def scattered(cylinders, frequency, sources, receivers):
    """Return the scattered field (source, receiver) of line sources, whose own field at a distance R is H_0(kR).

    ``cylinders`` are (x, y, radius, permittivity) each, m; ``sources`` and ``receivers`` (n, 2) m.
    """
    wavenumber = 2 * np.pi * frequency / SPEED
    places = np.array([cylinder[:2] for cylinder in cylinders])
    orders = [highest_orders(wavenumber, *cylinder[2:]) for cylinder in cylinders]
    starts = np.cumsum([0, *(n.size for n in orders)])
    own = [slice(a, b) for a, b in pairwise(starts)]
    turned = [
        reflections(wavenumber, radius, permittivity, n)[:, None]
        for (_, _, radius, permittivity), n in zip(cylinders, orders, strict=True)
    ]
    system = np.eye(starts[-1], dtype=complex)
    wave = np.empty((starts[-1], len(sources)), complex)
    for p, n in enumerate(orders):
        for q, m in enumerate(orders):
            if p != q:  # what cylinder q sends out, as waves about cylinder p
                away, angle = polar(places[p] - places[q])
                change = m[None] - n[:, None]
                system[own[p], own[q]] = (
                    -turned[p] * hankel2(change, wavenumber * away) * np.exp(1j * change * angle)
                )
        away, angle = polar(sources - places[p])
        incident = hankel2(n[:, None], wavenumber * away) * np.exp(-1j * n[:, None] * angle)
        wave[own[p]] = turned[p] * incident
    outgoing = np.linalg.solve(system, wave)
    field = np.zeros((len(sources), len(receivers)), complex)
    for p, n in enumerate(orders):
        away, angle = polar(receivers - places[p])
        waves = hankel2(n[:, None], wavenumber * away) * np.exp(1j * n[:, None] * angle)
        field += outgoing[own[p]].T @ waves
    return field


def highest_orders(wavenumber, radius, permittivity):
    """Return the orders (order,) that a cylinder needs, from the lowest to the highest."""
    most = int(np.ceil(1.2 * wavenumber * radius * np.sqrt(permittivity) + 8))
    return np.arange(-most, most + 1)


def polar(offset):
    x, y = np.moveaxis(np.asarray(offset), -1, 0)
    return np.hypot(x, y), np.arctan2(y, x)
