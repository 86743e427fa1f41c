"""The mode of logistic weights under a Laplacian prior against another algorithm."""

import numpy as np
import pytest

from flgpr.kernels.laplacian_mode import laplacian_mode
from reference.laplacian_mode import liblinear_weights, penalised_loss


@pytest.fixture
def data():
    rng = np.random.default_rng(4)
    rows = rng.normal(size=(6, 60))
    target = (rows[0] - 0.5 * rows[1] + rng.normal(size=60) > 0).astype(float)
    return rows, target


@pytest.mark.parametrize("scale", [0.5, 3.0, 10.0])
def test_the_loss_is_the_least_that_another_algorithm_finds(data, scale):
    rows, target = data
    mode = laplacian_mode(rows, target, 0.0, scale, 1e-8, 100)
    assert mode.converged
    want = liblinear_weights(rows.T, target, scale)
    np.testing.assert_allclose(mode.weights, want, atol=1e-4)
    least = penalised_loss(rows.T, target, want, scale)
    assert penalised_loss(rows.T, target, mode.weights, scale) <= least + 1e-8


def test_every_weight_keeps_its_condition(data):
    """Slope -scale·sign(w), and at most the scale where w = 0."""
    rows, target = data
    scale = 4.0
    weights = laplacian_mode(rows, target, 0.3, scale, 1e-9, 100).weights
    slope = -rows @ (target - 1 / (1 + np.exp(-(weights @ rows + 0.3))))
    active = weights != 0
    assert 0 < active.sum() < len(weights)
    np.testing.assert_allclose(slope[active], -scale * np.sign(weights[active]), rtol=1e-7)
    assert np.abs(slope[~active]).max() <= scale


def test_a_scale_above_every_slope_leaves_all_weights_at_zero(data):
    rows, target = data
    mode = laplacian_mode(rows, target, 0.0, 1e3, 1e-8, 100)
    assert mode.converged
    assert not mode.weights.any()


def test_too_few_entries_are_reported(data):
    rows, target = data
    assert not laplacian_mode(rows, target, 0.0, 0.5, 1e-8, 1).converged
