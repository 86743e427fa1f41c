"""Round bodies on the lattices of coupled dipoles, which know only boxes otherwise."""

import numpy as np

from flgpr_ground.signatures.dipoles import Lattice


def own_axis_means(fine, sub):
    """Harmonic mean along an axis of the arithmetic means across, over blocks of sub³ samples."""
    nx, ny, nz = (n // sub for n in fine.shape)
    blocks = fine.reshape(nx, sub, ny, sub, nz, sub)
    means = [
        (
            1
            / np.mean(
                1 / blocks.mean(axis=tuple({1, 3, 5} - {axis}), keepdims=True),
                axis=axis,
                keepdims=True,
            )
        )
        for axis in (1, 3, 5)
    ]
    return np.stack([m[:, 0, :, 0, :, 0] for m in means], axis=-1)


def sample_round(body, cell, soil, sub=4):
    """Lattice of a round body without metal."""
    across = int(np.ceil(body.radius / cell - 1e-9))
    down = int(np.ceil(body.height / cell - 1e-9))
    x = (np.arange(across * sub) + 0.5) * cell / sub
    drop = (np.arange(down * sub) + 0.5) * cell / sub
    half_width = np.hypot(x[:, None], x)
    return Lattice(cell, own_axis_means(body.permittivity(half_width[..., None], drop, soil), sub))
