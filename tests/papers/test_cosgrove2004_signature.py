"""Measures of signatures: humps, correlation, fourth moment and what stands out."""

import numpy as np
import pytest
import xarray as xr

from flgpr_papers.cosgrove2004.recipe import study_recipe
from flgpr_papers.cosgrove2004.signature import (
    fourth_moment_ratio,
    hump_count,
    polarization_correlation,
    visible_mines,
    wide_boxes,
)

pytestmark = pytest.mark.slow("studies of papers")


@pytest.fixture
def rng():
    return np.random.default_rng(2004)


def test_humps_are_what_stands_out():
    place = np.arange(28)
    humps = np.exp(-(((place - 6) / 2) ** 2)) + 0.8 * np.exp(-(((place - 20) / 2) ** 2))
    assert hump_count(humps, 0.25) == 2
    assert hump_count(humps + 0.1 * (place % 2), 0.25) == 2  # ripple below the share does not count
    assert hump_count(np.ones(28), 0.25) == 0


def test_correlation_does_not_hang_on_level_or_phase(rng):
    signature = rng.normal(size=28) + 1j * rng.normal(size=28)
    assert polarization_correlation(np.concatenate([signature, 0.2j * signature])) == pytest.approx(
        1
    )
    apart = rng.normal(size=(400, 56)) + 1j * rng.normal(size=(400, 56))
    # Of independent halves of n samples the squared correlation has the mean 1/n.
    mean_square = np.mean([polarization_correlation(one) ** 2 for one in apart])
    assert mean_square == pytest.approx(1 / 28, rel=0.2)


def test_fourth_moment_tells_gaussian_clutter_from_k_distributed(rng):
    gaussian = rng.normal(size=(20_000, 3)) + 1j * rng.normal(size=(20_000, 3))
    assert fourth_moment_ratio(gaussian) == pytest.approx(2, abs=0.1)
    texture = rng.gamma(4, 1 / 4, size=(20_000, 1))  # of shape ν the ratio is 2 (1 + 1/ν)
    assert fourth_moment_ratio(np.sqrt(texture) * gaussian) == pytest.approx(2.5, abs=0.15)


def test_visible_mines_stand_out_of_the_boxes_at_their_range():
    recipe = study_recipe()
    x = np.linspace(-2, 2, 81)
    y = np.linspace(12, 28, 401)
    rng = np.random.default_rng(3)
    values = rng.normal(size=(1, y.size, x.size)) + 1j * rng.normal(size=(1, y.size, x.size))
    values[0, np.abs(y - 20).argmin(), np.abs(x - 0.5).argmin()] = 50
    image = xr.DataArray(
        values, dims=("polarization", "y", "x"), coords={"polarization": ["HH"], "y": y, "x": x}
    )
    assert visible_mines(recipe, image) == [False, True, False]
    above = [at_mine > at_clutter.max() for at_mine, at_clutter in wide_boxes(recipe, image)]
    assert above == [False, True, False]
