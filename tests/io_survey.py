"""A survey of parallel lines over point reflectors, written as recordings."""

import numpy as np

from io_gpr import INTERVAL, NOMINAL, SAMPLES, SEPARATION, SPEED, STEP, ZERO, write_dt1

BODIES = ((0.5, 0.8, 0.4), (1.25, 1.4, 0.7))  # x, y and depth, m


def counts_along(x, y, scale=9000):
    """Counts (trace, sample) at places on the ground: Ricker pulses of the bodies, spreading left out."""
    time = (np.arange(SAMPLES) - ZERO) * INTERVAL
    total = np.zeros((len(x), SAMPLES))
    for bx, by, depth in BODIES:
        ways = [
            np.sqrt((bx - x) ** 2 + (by - y - side * SEPARATION / 2) ** 2 + depth**2)
            for side in (-1, 1)
        ]
        square = (np.pi * NOMINAL * (time - (sum(ways) / SPEED)[:, None])) ** 2
        total += scale * (1 - 2 * square) * np.exp(-square)
    return np.round(total).astype(np.int32)


def write_lines(folder, spacing=0.25, lines=8, traces=44, zigzag=False):
    """Lines along +y at x = 0, spacing, ...; every other one recorded backwards where they zigzag."""
    paths = []
    along = STEP * np.arange(traces)
    for k in range(lines):
        y = along[::-1] if zigzag and k % 2 else along
        paths.append(
            write_dt1(folder / f"line{k}.dt1", counts_along(np.full(traces, k * spacing), y))
        )
    return paths
