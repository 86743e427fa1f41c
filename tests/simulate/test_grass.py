import numpy as np
import pytest

from flgpr.simulate import Scene, Simulator
from flgpr.simulate.ground.layers import GrassLayer, ScanView, albedo, optical_depth, through_grass
from flgpr.simulate.scene import scene_tables as tables
from flgpr.simulate.simulator import array_state
from simulate.conftest import BARE, STILL

GRASS = tables.Grass(
    height=0.3, water=1.5, texture_shape=None
)  # much of it, so that its own loss shows
TONES = np.array([0.75e9, 1.05e9, 1.4e9, 2.1e9, 2.8e9])


@pytest.fixture
def view(quiet):
    """A strip of ground at about one angle of incidence."""
    pose = np.array([0.0, 0.0, quiet.height, 0.0, 0.0, 0.0])
    return ScanView((-3.0, 3.0, 11.5, 12.5), pose, array_state(quiet, pose))


@pytest.fixture
def covariance(view):
    """Mean covariance (3, 3, frequency) per m² of HH, VV and cross, of the grass's scatterers in 40 worlds."""
    total = np.zeros((3, 3, TONES.size), complex)
    for seed in range(40):
        points, _, coefficient, basis, *_ = GrassLayer(GRASS, 60.0, seed, TONES).echoes(view)
        assert points[:, 2].min() >= 0
        assert 0.29 < points[:, 2].max() < 0.3
        spectra = np.einsum("irc,rcf->icf", coefficient, basis)
        total += np.einsum("iaf,ibf->abf", spectra, spectra.conj())
    return total / 40 / 6.0


def layer(upright):
    """σ⁰ of the layer by the integral over its height, with κ and loss of a polarization (natural units, 67.4°)."""
    sine = 12 / 13
    cosine = 5 / 13
    sine = 12 / 13
    depth = optical_depth(GRASS, TONES)
    along = depth * (cosine**2 + upright * sine**2)
    return 0.75 * albedo(GRASS, TONES) * cosine * (1 - np.exp(-2 * along / cosine))


def test_the_layer_s_echo_is_that_of_small_particles_with_their_loss(covariance):
    """14 400 scatterers: 3 standard errors are 2.5 %; the strip spans 65.5 to 68.5 degrees; two ranks err by 1 %."""
    hh = covariance[0, 0].real
    vv = covariance[1, 1].real
    np.testing.assert_allclose(hh / layer(1.0), 1, atol=0.05)
    np.testing.assert_allclose(vv / layer(GRASS.upright), 1, atol=0.05)


def test_cross_polarization_lies_7_db_below_hh_but_for_the_loss_of_v(covariance):
    cosine = 5 / 13
    sine = 12 / 13
    depth = optical_depth(GRASS, TONES)
    mean = depth * (1 + cosine**2 + GRASS.upright * sine**2) / 2
    want = (
        10**-0.7
        * 1.5
        * albedo(GRASS, TONES)
        * depth
        * cosine
        / (2 * mean)
        * (1 - np.exp(-2 * mean / cosine))
    )
    np.testing.assert_allclose(covariance[2, 2].real / want, 1, atol=0.06)
    level = 10 * np.log10(covariance[2, 2].real / covariance[0, 0].real)
    assert -9.5 < level.min() < level.max() < -7.0


def test_hh_and_vv_are_hardly_correlated(covariance):
    size = np.sqrt(covariance[0, 0].real * covariance[1, 1].real)
    np.testing.assert_allclose(np.abs(covariance[0, 1]) / size, GRASS.correlation, atol=0.04)
    assert np.all(np.abs(covariance[0, 2]) / size < 0.05)


def test_more_is_lost_at_high_frequencies_at_grazing_and_in_v():
    sine = np.array([0.5, 0.8, 0.95])
    loss = through_grass(GRASS, TONES, sine)
    assert loss.shape == (3, 3, TONES.size)
    assert np.all(np.diff(loss, axis=1) < 0)
    assert np.all(np.diff(loss, axis=2) < 0)
    assert np.all(loss[1] < loss[2])
    assert np.all(loss[2] < loss[0])
    # One way each of H and V.
    np.testing.assert_allclose(loss[2], np.sqrt(loss[0] * loss[1]))
    # At 60 degrees the way is twice the height, and power falls by τ for each way.
    tau = 0.13 * 1.5 * TONES / 1.4e9
    np.testing.assert_allclose(
        through_grass(GRASS, TONES, np.sqrt(0.75))[0] ** 2, np.exp(-2 * 2 * tau)
    )
    assert np.all(through_grass(GRASS.model_copy(update={"on": False}), TONES, sine) == 1)


def test_a_mine_under_grass_is_weaker_by_the_loss_of_both_ways(quiet):
    mute = GRASS.model_copy(update={"albedo": 0.0})
    mine = {"kind": "metal", "x": 0.0, "y": 12.0, "depth": 0.05}
    lane = Scene(surface=BARE, track=STILL, length=30.0, targets=[mine])
    bare = Simulator(lane, quiet, 1).scan(0)
    grown = Simulator(lane.model_copy(update={"grass": mute}), quiet, 1).scan(0)
    want = through_grass(GRASS, quiet.tones.axis(), 12 / 13)
    for name, loss in (("HH", want[0]), ("VV", want[1])):
        channel = quiet.polarization.index(name)
        np.testing.assert_allclose(
            grown[channel], bare[channel] * loss, rtol=1e-3, atol=1e-4 * np.abs(bare).max()
        )
    assert np.linalg.norm(grown) < 0.5 * np.linalg.norm(bare)


def test_what_rises_above_the_grass_keeps_its_level(quiet):
    lane = Scene(
        surface=BARE,
        track=STILL,
        length=30.0,
        objects=[{"kind": "fiducial", "x": 0, "y": 12, "height": 0.4}],
    )
    mute = GRASS.model_copy(update={"albedo": 0.0})
    bare, grown = (
        Simulator(lane.model_copy(update={"grass": g}), quiet, 1).scan(0)
        for g in (tables.Grass(), mute)
    )
    np.testing.assert_allclose(grown, bare, rtol=1e-5, atol=1e-6 * np.abs(bare).max())


def test_the_surface_is_seen_through_the_grass(quiet):
    lane = Scene(track=STILL, length=30.0, surface={"density": 2.0})
    power = []
    for grass in (tables.Grass(), GRASS):
        simulator = Simulator(lane.model_copy(update={"grass": grass}), quiet, 1)
        found = simulator._layers[0].echoes(
            simulator._view(array_state(quiet, simulator.pose[0]), simulator.pose[0])
        )
        middle = quiet.tones.count // 2
        power.append(np.abs(np.einsum("irc,rc->ic", found.coefficient, found.basis[:, :, middle])))
    sine = np.hypot(*found.points[:, :2].T) / np.hypot(
        np.hypot(*found.points[:, :2].T), quiet.height
    )
    want = through_grass(GRASS, quiet.tones.axis()[middle : middle + 1], sine)[..., 0]
    near = sine < 0.95
    np.testing.assert_allclose((power[1] / power[0])[near], want.T[near], rtol=0.05)


def test_the_same_seed_grows_the_same_grass_and_none_is_the_bare_lane(quiet):
    lane = Scene(length=20.0, track=STILL, surface={"density": 3.0})
    bare = Simulator(lane, quiet, 4).scan(0)
    mown = lane.model_copy(update={"grass": GRASS.model_copy(update={"on": False})})
    np.testing.assert_array_equal(Simulator(mown, quiet, 4).scan(0), bare)
    one, other = (
        Simulator(lane.model_copy(update={"grass": GRASS}), quiet, 4).scan(0) for _ in range(2)
    )
    np.testing.assert_array_equal(one, other)
    assert np.linalg.norm(one - bare) > 0.1 * np.linalg.norm(bare)
