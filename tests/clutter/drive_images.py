"""Images of a short drive: a pattern that stays, noise, and a target that comes nearer."""

import numpy as np

SHAPE = (3, 2, 40, 34)
WINDOWS = (7, 5), (11, 9)


def drive_images():
    """Return six scan images of ``SHAPE``, each with a gain of its own."""
    rng = np.random.default_rng(7)
    fixed = rng.normal(size=SHAPE) + 1j * rng.normal(size=SHAPE)
    level = np.linspace(1, 3, SHAPE[2])[:, None] * np.array([1, 5, 0.2])[:, None, None, None]
    images = []
    for k in range(6):
        image = fixed + 0.5 * (rng.normal(size=SHAPE) + 1j * rng.normal(size=SHAPE))
        image[..., 5 * k + 3, 12] += 40
        images.append(((0.5 + k) * level * image).astype(np.complex64))
    return images
