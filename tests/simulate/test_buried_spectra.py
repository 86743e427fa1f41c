"""Spectra of buried points: transmission into the soil, and what depth takes from each tone."""

import numpy as np
import pytest

from simulate.buried_points import DRY, MOIST, flat_layer, given, sine_at, spectra_of, view_of


def test_buried_spheres_have_the_ratio_of_transmissions_and_no_cross(quiet):
    places = [(0.0, 7.0), (-3.0, 12.0), (2.0, 26.0)]
    layer, ground = flat_layer(given(places, 0.0), DRY, quiet)
    h, v, x = np.moveaxis(spectra_of(layer.echoes(view_of(quiet)))[..., 100], 1, 0)
    s = sine_at(places)
    c = np.sqrt(1 - s**2)
    q = np.sqrt(3.4 - s**2)
    n = np.sqrt(3.4)
    t_h = 2 * c / (c + q)
    t_v = 2 * n * c / (3.4 * c + q)
    np.testing.assert_allclose(np.abs(h), t_h**2, rtol=0.01)
    np.testing.assert_allclose(np.abs(v / h), (t_v / t_h) ** 2, rtol=0.01)
    assert not x.any()
    assert ground.real == [3.4]


@pytest.mark.parametrize("depth", [0.03, 0.12, 0.3])
def test_depth_takes_what_the_soil_takes(quiet, depth):
    places = [(0.0, 7.0), (-3.0, 12.0), (2.0, 26.0)]
    shallow, ground = flat_layer(given(places, 0.0), MOIST, quiet)
    deep, _ = flat_layer(given(places, depth), MOIST, quiet)
    ratio = (
        spectra_of(deep.echoes(view_of(quiet)))[:, 0]
        / spectra_of(shallow.echoes(view_of(quiet)))[:, 0]
    )
    normal = np.sqrt(ground.media[0] - sine_at(places)[:, None] ** 2)
    middle = normal[:, ground.frequency.size // 2].real[:, None]
    want = np.exp(-2j * ground.wavenumber * depth * (normal - middle))
    # What is lost must be right where it matters: errors count against the strongest tone and a
    # shallow point.
    assert np.abs(ratio - want).max() < 0.05 * np.abs(want).max() + 0.01
    assert np.abs(want).min() < 0.6
