"""Principal component pursuit takes a matrix apart into low rank and sparse."""

import numpy as np

from flgpr_ground.stages.low_rank import low_rank_part


def test_clutter_of_rank_two_is_found_beneath_a_few_strong_echoes():
    rng = np.random.default_rng(5)

    def noise(*shape):
        return rng.normal(size=shape) + 1j * rng.normal(size=shape)

    clutter = noise(30, 2) @ noise(2, 60)
    sparse = np.zeros((30, 60), complex)
    places = rng.choice(30 * 60, 60, replace=False)
    sparse.flat[places] = 20 * noise(60)
    found = low_rank_part(clutter + sparse)
    assert np.linalg.norm(found - clutter) < 1e-2 * np.linalg.norm(clutter)
    size = np.linalg.svd(found, compute_uv=False)
    assert size[2] < 1e-2 * size[0]


def test_a_matrix_of_zeros_stays_zero():
    assert not low_rank_part(np.zeros((3, 5))).any()
