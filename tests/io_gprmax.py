"""The field of a short dipole, as textbooks have it."""

import numpy as np

SPEED = 299_792_458.0


def dipole_field(direction, offset, component, frequency):
    """Field of a short dipole of unit moment in air, near and far (Balanis 2016, Sec. 4.2), times j; V/m per A·m."""
    distance = np.linalg.norm(offset)
    ray, kr = offset / distance, 2 * np.pi * frequency / SPEED * distance
    size = 2 * np.pi * frequency * 4e-7 * np.pi / (4 * np.pi * distance) * np.exp(-1j * kr)
    along = (ray @ direction) * ray[component]
    return size * (direction[component] * (1 - 1j / kr - 1 / kr**2) - along * (1 - 3j / kr - 3 / kr**2))
