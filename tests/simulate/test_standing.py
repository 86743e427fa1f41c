"""Echoes of what stands on the ground: levels, places and draws that theory or the scene fixes."""

import numpy as np
import pytest

from flgpr.simulate.bodies.standing import bush_scatterers, object_echoes, standing_echoes
from flgpr.simulate.scene.scene import SceneObject, Target
from flgpr.simulate.simulator import array_state
from simulate.buried_points import DRY, POSE, ground_of

PLACE = {"x": 0.3, "y": 12.0}


@pytest.fixture(scope="module")
def state(quiet):
    return array_state(quiet, POSE)


@pytest.fixture(scope="module")
def ground(quiet):
    return ground_of(DRY, quiet)


def echoes_of(state, ground, seed=1, **entries):
    """Return the echoes of an object at the place."""
    return list(object_echoes(SceneObject(**PLACE, **entries), ground, state, seed))


def way_by(state, point):
    """Return the way (pair,) from the transmitters to a point and on to the receivers, m."""
    sent = np.linalg.norm(state.position[state.tx] - point, axis=1)
    taken = np.linalg.norm(state.position[state.rx] - point, axis=1)
    return sent + taken


def test_a_reflector_of_one_square_metre_has_its_amplitude_and_place(state, ground):
    (echo,) = echoes_of(state, ground, kind="fiducial", height=0.5)
    spectrum = echo.spectrum
    at_1_ghz = np.interp(1e9, ground.frequency, spectrum[0].real)
    # |S| = sqrt(cross section / 4 pi), and the cross section grows with the square of frequency.
    assert at_1_ghz == pytest.approx(1 / np.sqrt(4 * np.pi), rel=1e-6)
    np.testing.assert_allclose(spectrum[0] / ground.frequency, spectrum[0, 0] / ground.frequency[0])
    np.testing.assert_array_equal(spectrum[0], spectrum[1])
    assert not spectrum[2:].any()
    np.testing.assert_allclose(echo.path, way_by(state, [PLACE["x"], PLACE["y"], 0.5]))


def test_a_post_echoes_from_its_foot_its_top_and_its_image(state, ground):
    echoes = echoes_of(state, ground, kind="post", radius=0.05, height=1.5)
    assert [echo.position[2] for echo in echoes] == [0.0, 1.5, -1.5]
    foot, top, image = (np.abs(echo.spectrum[:2]).mean() for echo in echoes)
    assert foot > 10 * max(top, image)  # the corner adds up all along the post
    # The echo comes from the side of the post that faces the array.
    assert (echoes[0].path < way_by(state, [PLACE["x"], PLACE["y"], 0.0])).all()


def test_a_rock_is_drawn_from_the_seed_and_its_place(state, ground):
    first, again = (echoes_of(state, ground, kind="rock") for _ in range(2))
    other = echoes_of(state, ground, seed=2, kind="rock")
    np.testing.assert_array_equal(first[0].spectrum, again[0].spectrum)
    assert not np.array_equal(first[0].spectrum, other[0].spectrum)


def test_the_twigs_of_a_bush_have_its_cross_section_together():
    bush = SceneObject(**PLACE, kind="bush", radius=0.4, height=1.0, rcs_db=3.0)
    sections = []
    for seed in range(200):
        position, amplitude = bush_scatterers(bush, seed)
        sections.append(4 * np.pi * (np.abs(amplitude) ** 2).sum(axis=0))
        assert (position[:, 2] >= 0.05).all()
        assert (position[:, 2] <= 1.0).all()
    hh, vv, cross = np.mean(sections, axis=0)
    # 200 bushes of 24 twigs: the mean of 4800 exponential draws is within 6 % of its expectation.
    assert hh == pytest.approx(10**0.3, rel=0.06)
    assert vv == pytest.approx(10**0.3, rel=0.06)
    assert cross == pytest.approx(10**0.3 / 4, rel=0.06)


def test_a_plastic_mine_on_the_ground_is_weaker_than_one_of_metal(state, ground):
    powers = {}
    for kind in ("metal", "plastic"):
        target = Target(kind=kind, depth=-0.15, **PLACE)
        spectra = [echo.spectrum for echo in standing_echoes(target, ground, state)]
        assert not any(spectrum[2:].any() for spectrum in spectra)
        powers[kind] = sum((np.abs(spectrum) ** 2).sum() for spectrum in spectra)
    assert 0 < powers["plastic"] < 0.5 * powers["metal"]
