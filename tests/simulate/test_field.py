"""Scatterers of the surface: their places and statistics."""

import numpy as np
import pytest

from flgpr.simulate.ground.field import SurfaceField, jittered
from flgpr.simulate.scene.scene import Surface


def test_every_scatterer_has_a_cell_of_its_own_and_power_is_shared_out_evenly():
    """Three in a resolution cell give its power less spread than ten strewn at random do: 0.03 against 0.05."""
    field = SurfaceField(Surface(texture_shape=None), (), 7.0, seed=1)
    assert field.per_tile == 9
    tile = np.floor((field.tile(2, 3).xy - [2, 3]) * 3).astype(int)
    assert len({tuple(cell) for cell in tile}) == 9
    rng = np.random.default_rng(0)
    spread = []
    for cells in ((26, 26), (47, 47)):  # 3 and 10 per cell of 1 in 15 x 15
        power = []
        for _ in range(400):
            place = (
                15 * (jittered(rng, cells) if cells[0] == 26 else rng.random((47 * 47, 2))) - 7.5
            )
            power.append(np.prod(np.sinc(place) ** 2, axis=1).sum() * 225 / len(place))
        assert np.mean(power) == pytest.approx(1, abs=0.05)
        spread.append(np.var(power))
    assert spread[0] < 0.75 * spread[1]


@pytest.mark.parametrize(("shape", "want"), [(None, 2.0), (2.0, 3.0), (5.0, 2.4)])
def test_scatterers_are_k_distributed(shape, want):
    """E|z|⁴/(E|z|²)² is 2(1 + 1/ν) for texture of shape ν, and 2 without."""
    surface = Surface(texture_shape=shape, texture_length=0.3, correlation=0.65)
    field = SurfaceField(surface, (), 40.0, seed=1)
    z = np.concatenate([field.tile(i, j).amplitude for i in range(30) for j in range(30)])
    power = np.abs(z[:, 0].astype(complex)) ** 2
    assert np.mean(power**2) / np.mean(power) ** 2 == pytest.approx(want, rel=0.08)
    assert power.sum() == pytest.approx(900, rel=0.08)
    assert np.abs(np.vdot(z[:, 0], z[:, 1])) / np.linalg.norm(z[:, 0]) / np.linalg.norm(
        z[:, 1]
    ) == pytest.approx(0.65, abs=0.03)
