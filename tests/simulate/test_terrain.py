import numpy as np
import pytest

from flgpr.imaging import ScanImager
from flgpr.model import Grid, Lane, attitude_matrix, heading_matrix
from flgpr.simulate import Scene, Simulator, simulate
from flgpr.simulate.ground.roughness import surface_backscatter
from flgpr.simulate.ground.terrain import TerrainHeights
from flgpr.simulate.scene import scene_tables as tables
from flgpr.simulate.simulator import array_state
from simulate.conftest import BARE, STILL

LANE = Lane(-1.5, 1.5, 0.0, 60.0)


def terrain(seed=1, **entries):
    return TerrainHeights(tables.Terrain(**entries), LANE, seed)


def test_undulation_has_its_height_length_and_slope():
    """One place in each of 800 worlds: 3 standard errors of a variance are 15 %, of a correlation at most 0.11."""
    s = 0.02
    length = 2.0
    lags = (0.5 * length, length, 2 * length)
    xy = np.array(
        [[0.3, 20.0], *([0.3 + lag, 20.0] for lag in lags), *([0.3, 20.0 + lag] for lag in lags)]
    )
    relief = np.array(
        [terrain(seed, undulation=s, undulation_length=length).relief(xy) for seed in range(800)]
    )
    np.testing.assert_allclose(relief[:, :, 0].var(axis=0), s**2, rtol=0.15)
    np.testing.assert_allclose(relief[:, 0, 1:].var(axis=0), 2 * s**2 / length**2, rtol=0.15)
    found = np.mean(relief[:, :1, 0] * relief[:, 1:, 0], axis=0) / s**2
    np.testing.assert_allclose(found, np.tile(np.exp(-np.array([0.25, 1.0, 4.0])), 2), atol=0.11)


def test_slopes_are_the_derivative_of_the_height():
    entries = {"slope_along": 0.03, "slope_across": -0.02, "undulation": 0.02, "rut_depth": 0.05}
    ground = terrain(**entries)
    step = 0.02
    xy = np.random.default_rng(0).uniform([-2, 0], [2, 20], (2000, 2))
    slope = ground.relief(xy)[:, 1:]
    for axis, (move, mean) in enumerate(zip(np.eye(2) * step, (-0.02, 0.03), strict=True)):
        difference = (ground.relief(xy + move) - ground.relief(xy - move))[:, 0] / (2 * step)
        assert (difference - slope[:, axis]).std() < 0.1 * slope[:, axis].std()
        assert slope[:, axis].mean() == pytest.approx(mean, abs=0.01)


def test_the_height_does_not_depend_on_what_else_is_asked_for():
    ground = terrain(undulation=0.02, rut_depth=0.05)
    xy = np.random.default_rng(0).uniform([-7, 0], [7, 60], (50, 2))
    one_by_one = [ground(x, y).item() for x, y in xy]
    np.testing.assert_allclose(ground.relief(xy)[:, 0], one_by_one, atol=1e-12)
    assert np.abs(terrain(2, undulation=0.02).relief(xy)[:, 0] - one_by_one).max() > 0.01


def test_the_lattice_holds_the_cell_of_every_place_whatever_rounding_does():
    """A place on a node may fall into the cell after it."""
    ground = terrain(undulation=0.02, undulation_length=2.1, rut_depth=0.05)
    for first in range(-30, 30):
        for cells in range(40):
            steps = np.array([0.175, ground.table.rut_wander_length / 200])
            low, high = first * steps, (first + cells) * steps
            origin, step, nodes = ground._undulation(np.array([[low[0]] * 2, [high[0]] * 2]))
            assert int((high[0] - origin[0]) / step) + 1 < len(nodes)
            start, pitch, line = ground._rut_line(np.array([low[1], high[1]]))
            assert int((high[1] - start) / pitch) + 1 < len(line)


def test_ruts_have_their_depth_width_and_spacing():
    ground = terrain(rut_depth=0.06, rut_width=0.2, rut_spacing=1.6, rut_wander=0.0)
    np.testing.assert_allclose(ground([-0.8, 0.8], 7.0), -0.06, rtol=1e-6)
    np.testing.assert_allclose(ground([-0.9, -0.7, 0.7, 0.9], 7.0), -0.03, rtol=1e-6)
    assert abs(ground(0.0, 7.0)) < 1e-6


def test_ruts_wander_as_far_as_told():
    across = np.linspace(0.2, 2.2, 201)
    ground = [
        terrain(seed, rut_depth=0.06, rut_width=0.2, rut_spacing=2.4, rut_wander=0.2)
        for seed in range(200)
    ]
    right = [across[g(across, 30.0).argmin()] for g in ground]
    assert np.mean(right) == pytest.approx(1.2, abs=0.05)
    assert np.std(right) == pytest.approx(0.2, rel=0.2)


def test_the_vehicle_stands_on_the_ground():
    ground = terrain(slope_along=0.05, slope_across=-0.03)
    pose = np.array([[0.3, 12.0, 5.0, 0.4, 0.0, 0.0]])
    followed = ground.follow(pose)[0]
    assert followed[2] == pytest.approx(5.0 + ground(0.3, 12.0).item())
    turn = heading_matrix(followed[3]) @ attitude_matrix(followed[4], followed[5])
    normal = np.array([-np.tan(-0.03), -np.tan(0.05), 1.0])
    assert normal @ turn[:, 0] == pytest.approx(0, abs=2e-3)
    assert normal @ turn[:, 1] == pytest.approx(0, abs=2e-3)
    np.testing.assert_array_equal(terrain(slope_along=0.05, follow=False).follow(pose), pose)


def test_wheels_in_ruts_sink_and_one_wheel_in_a_rut_rolls():
    ground = terrain(rut_depth=0.05, rut_spacing=1.6, rut_wander=0.0, rut_width=0.2)
    inside, beside = ground.follow(np.array([[0.0, 10.0, 5.0, 0, 0, 0], [1.6, 10.0, 5.0, 0, 0, 0]]))
    assert inside[2] == pytest.approx(4.95)
    assert inside[5] == pytest.approx(0, abs=1e-9)
    assert beside[2] == pytest.approx(4.975)
    assert abs(beside[5]) == pytest.approx(np.arctan(0.05 / 1.6), rel=1e-3)
    lowered = attitude_matrix(0.0, beside[5]) @ np.array([-1.0, 0.0, 0.0])
    assert lowered[2] < 0  # the left wheel is in the right rut


@pytest.mark.parametrize("height", [0.3, -0.3])
def test_a_raised_point_appears_nearer_and_a_sunk_one_farther(quiet, height):
    """Where the path is as long over the ground at z = 0: towards the radar by about z·cotθ."""
    slope = {"slope_along": float(np.arctan(-height / 3.0)), "follow": False}
    thing = {"kind": "fiducial", "x": 0.0, "y": 12.0}
    lane = Scene(surface=BARE, track=STILL, length=30.0, terrain=slope, objects=[thing])
    run, _ = simulate(lane, quiet, 1)
    grid = Grid.spanning((-0.1, 0.1), (11.4, 12.6), 0.01)
    image = np.abs(
        next(iter(ScanImager(run, grid, {"all": (0.45e9, 2.95e9)})))
        .sel(polarization="HH")
        .values[0]
    )
    found = grid.y[np.unravel_index(image.argmax(), image.shape)[0]]
    exact = np.sqrt(12.0**2 + (5.0 - height) ** 2 - 5.0**2)
    assert found == pytest.approx(exact, abs=0.012)
    assert found - 12.0 == pytest.approx(-height * 5.0 / 12.0, abs=0.02)


def test_a_mine_lies_below_the_ground_above_it(quiet):
    """On a plateau the mine's echo is that of a lower radar over level ground, to the bit of rounding."""
    mine = {"kind": "metal", "x": 0.0, "y": 12.0, "depth": 0.08}
    slope = {"slope_along": float(np.arctan(-0.1)), "follow": False}
    lane = Scene(surface=BARE, track=STILL, length=30.0, targets=[mine])
    raised = Simulator(lane.model_copy(update={"terrain": tables.Terrain(**slope)}), quiet, 1).scan(
        0
    )
    low = quiet.model_copy(update={"height": quiet.height - 0.3})
    want = Simulator(lane, low, 1).scan(0)
    assert np.linalg.norm(raised - want) < 1e-4 * np.linalg.norm(want)


@pytest.mark.parametrize("along", [0.1, -0.1])
def test_sigma0_is_that_of_the_local_angle(quiet, along):
    """Every scatterer's power on a slope over that on level ground, against σ⁰ at the angle to the slope's normal."""
    soil = {"model": "fixed", "permittivity": 3.4}
    level = Scene(soil=soil, length=30.0, track=STILL, surface={"density": 3.0})
    slope = tables.Terrain(slope_along=along, slope_across=0.02, follow=False)
    power = []
    sines = []
    for lane in (level, level.model_copy(update={"terrain": slope})):
        simulator = Simulator(lane, quiet, 1, errors=False)
        array = array_state(quiet, simulator.pose[0])
        view = simulator._view(array, simulator.pose[0])
        found = simulator._layers[0].echoes(view)
        middle = quiet.tones.count // 2
        power.append(
            np.abs(np.einsum("irc,rc->ic", found.coefficient, found.basis[:, :, middle])) ** 2
        )
        ground = lane.terrain
        plane = np.tan([ground.slope_across, ground.slope_along])
        ray = (
            view.centre
            - found.points
            - np.outer(found.points[:, :2] @ plane - 15 * plane[1], [0, 0, 1])
        )
        normal = np.array([-plane[0], -plane[1], 1.0])
        cosine = ray @ normal / np.linalg.norm(ray, axis=1) / np.linalg.norm(normal)
        sines.append(np.sqrt(1 - cosine**2))
    tone = quiet.tones.axis()[middle]
    want = [surface_backscatter(tone, sine, 3.4, 0.005, 0.05, np.radians(5)) for sine in sines]
    for channel in (0, 1):
        ratio = power[1][:, channel] / power[0][:, channel]
        expected = want[1][channel] / want[0][channel]
        inside = sines[1] < 0.99
        np.testing.assert_allclose(10 * np.log10(ratio / expected)[inside], 0, atol=0.15)
        turned = 10 * np.log10(np.median(ratio))
        assert (
            turned > 1 if along > 0 else turned < -1
        )  # ground that rises away from the radar faces it


def test_switched_off_is_the_level_lane_to_the_bit(quiet):
    lane = Scene(
        length=20.0,
        track=STILL,
        surface={"density": 5.0},
        targets=[{"kind": "metal", "x": 0, "y": 12, "depth": 0.05}],
    )
    hilly = tables.Terrain(undulation=0.05, rut_depth=0.05, slope_along=0.02)
    off = lane.model_copy(update={"terrain": hilly.model_copy(update={"on": False})})
    level = Simulator(lane, quiet, 4).scan(0)
    np.testing.assert_array_equal(Simulator(off, quiet, 4).scan(0), level)
    one, other = (
        Simulator(lane.model_copy(update={"terrain": hilly}), quiet, 4).scan(0) for _ in range(2)
    )
    np.testing.assert_array_equal(one, other)
    assert np.linalg.norm(one - level) > 0.5 * np.linalg.norm(level)


def test_ground_that_faces_away_is_grazed():
    ground = terrain(slope_along=-0.4)
    centre = np.array([0.0, 0.0, 12.0])
    assert ground.local_sine(np.array([[0.0, 100.0, 0.0]]), centre)[0] == 1.0
    assert terrain(slope_along=0.4).local_sine(np.array([[0.0, 100.0, 0.0]]), centre)[
        0
    ] == pytest.approx(0.9746, abs=1e-3)
