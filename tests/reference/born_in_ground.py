"""Echo of a body of small contrast in flat soil, slowly: Born's approximation, with rays through the surface.

By reciprocity the field at the receiver is ``∫ jωε0 (ε - ε_soil) E_tx·E_rx dV`` over the body, where both fields are
those that the two dipoles would have in the soil alone, per unit current moment (Chew 1995, Ch. 8).
"""

import numpy as np

SPEED = 299_792_458.0
MU = 4e-7 * np.pi


def cylinder_cells(radius, top, bottom, x, y, cell=0.02):
    """Centres (cell, 3) of cells in an upright cylinder and the volume of each, m and m³."""
    flat = (np.arange(-int(np.ceil(radius / cell)), int(np.ceil(radius / cell))) + 0.5) * cell
    count = max(1, round((top - bottom) / cell))
    z = bottom + (np.arange(count) + 0.5) * (top - bottom) / count
    points = np.stack(np.meshgrid(flat, flat, z, indexing="ij"), axis=-1).reshape(-1, 3)
    points = points[np.hypot(points[:, 0], points[:, 1]) <= radius]
    return points + [x, y, 0.0], np.pi * radius**2 * (top - bottom) / len(points)


def dipole_below(antenna, direction, points, frequency, permittivity):
    """Electric field (point, 3) in the soil of a short dipole of unit moment above it, one tone; far field, rays."""
    index = np.sqrt(permittivity)
    offset = points[:, :2] - antenna[:2]
    across = np.hypot(*offset.T)
    high = antenna[2]
    deep = -points[:, 2]
    run = across * high / (high + deep / index.real)  # ground range at which the ray enters
    for _ in range(30):  # Snell's law by Newton's method
        sine = run / np.hypot(run, high)
        below = (across - run) / np.hypot(across - run, deep)
        slope = (
            high**2 / np.hypot(run, high) ** 3
            + index.real * deep**2 / np.hypot(across - run, deep) ** 3
        )
        run = run - (sine - index.real * below) / slope
    above = np.hypot(run, high)
    under = np.hypot(across - run, deep)
    sine = run / above
    cosine = high / above
    inner = np.sqrt(1 - (sine / index.real) ** 2)  # cosine below
    ahead = np.column_stack([offset / across[:, None], np.zeros(len(points))])
    up = np.array([0.0, 0.0, 1.0])
    ray = sine[:, None] * ahead - cosine[:, None] * up
    horizontal = np.cross(up, ahead)
    upright, upright_below = (
        c[:, None] * ahead + s[:, None] * up
        for s, c in ((sine, cosine), (sine / index.real, inner))
    )
    assert np.allclose((ray * upright).sum(axis=1), 0)
    through_s = 2 * cosine / (cosine + index * inner)
    through_p = 2 * cosine / (index * cosine + inner)
    # The two radii of the wave front grow more slowly under the surface.
    spread = np.sqrt(
        (above + under / index.real) * (above + under * cosine**2 / (index.real * inner**2))
    )
    k = 2 * np.pi * frequency / SPEED
    size = (
        -1j
        * 2
        * np.pi
        * frequency
        * MU
        / (4 * np.pi * spread)
        * np.exp(-1j * k * (above + index * under))
    )
    parts = (horizontal @ direction * through_s, upright @ direction * through_p)
    return size[:, None] * (parts[0][:, None] * horizontal + parts[1][:, None] * upright_below)


def born_echo(tx, rx, directions, points, volume, contrast, frequency, permittivity):
    """Field at the receiver over current moment, times j; contrast (point,) is ε - ε_soil at one tone."""
    sent = dipole_below(tx, directions[0], points, frequency, permittivity)
    received = dipole_below(rx, directions[1], points, frequency, permittivity)
    current = 2j * np.pi * frequency / (MU * SPEED**2) * contrast * volume
    return 1j * (current * (sent * received).sum(axis=1)).sum()
