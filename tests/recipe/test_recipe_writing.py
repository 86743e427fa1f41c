"""The text of a recipe holds the figures that were chosen, and the reason for each beside it."""

from dataclasses import replace

import numpy as np
import pytest

from flgpr.recipe.choice import figures_of
from flgpr.recipe.radar_setup import RadarSetup
from flgpr.recipe.schema import parse_recipe
from flgpr.recipe.writing import fitted_text


@pytest.fixture(scope="module")
def figures():
    antennas = np.array([[-1.0, 0.0, 2.0], [0.0, 0.0, 2.0], [1.0, 0.0, 2.0]])
    poses = np.zeros((6, 6))
    poses[:, 1] = np.arange(6)
    tones = 1e9 + 5e6 * np.arange(200)
    setup = RadarSetup(["HH", "VV", "HV"], tones, antennas, antennas, poses)
    return figures_of(setup)


def test_the_recipe_reads_as_the_figures_are(figures):
    recipe = parse_recipe(fitted_text(figures))
    assert recipe.image.x == figures.image_x
    assert recipe.image.y == figures.image_y
    assert recipe.run_view.y_max == figures.y_max
    assert recipe.prescreen.polarization == figures.polarization
    assert list(recipe.image.subbands) == list(figures.bands)
    assert recipe.features is not None


def test_every_reason_of_a_drive_stands_beside_its_entry(figures):
    text = fitted_text(figures)
    assert "image.frames" in figures.reasons
    for entry, reason in figures.reasons.items():
        assert (f"# {reason}" in text) is (entry not in ("image.frames", "clutter"))


def test_an_aperture_is_one_frame_and_few_polarizations_have_no_features(figures):
    setup = replace(figures.setup, aperture=True, polarizations=["HH"])
    figures = replace(figures, setup=setup)
    text = fitted_text(figures)
    assert f'frames = "all"  # {figures.reasons["image.frames"]}' in text
    assert "[features]" not in text
    assert "Local contrast after Wang et al. 2007" in text
