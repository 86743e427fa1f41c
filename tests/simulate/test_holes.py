import numpy as np
import pytest
from scipy.special import j1, jv

from flgpr.model import load_sensor
from flgpr.simulate import Scene, Simulator, draw_world, world_description
from flgpr.simulate.bodies.echoes import LayeredGround
from flgpr.simulate.ground.holes import Hole, cap_flash, hole_factor, wall_flash
from simulate.conftest import BARE, STILL

MOIST = {"model": "mironov", "clay": 20.0, "moisture": 0.12}
SPEED = 299792458.0
TONES = np.linspace(0.5e9, 3e9, 51)
SAME = Hole(0.0, 12.0, 0.25, 0.3, 1.0, 0.0, 0.0)


def ground_of(soil):
    return LayeredGround(Scene(soil=soil).soil, None, TONES)


def test_holes_lie_over_the_share_of_targets_and_over_nothing():
    scene = Scene(
        soil=MOIST,
        length=500.0,
        draws=[
            {"kind": "metal", "depth": 0.05, "count": 300},
            {"kind": "metal", "depth": -0.15, "count": 50},
        ],
        holes={"over": 0.4, "empty": 0.05},
    )
    world = draw_world(scene, 3)
    over = [h for h in world.holes if h.target is not None]
    empty = [h for h in world.holes if h.target is None]
    assert abs(len(over) - 120) < 4 * np.sqrt(300 * 0.4 * 0.6)
    assert abs(len(empty) - 75) < 4 * np.sqrt(75)
    for hole in over:
        target = world.targets[hole.target]
        assert target.depth >= 0
        assert (hole.x, hole.y) == (target.x, target.y)
        assert hole.radius > target.radius
        assert hole.depth == target.depth + target.height
    assert len(world.patches) == len(world.holes)


def test_empty_holes_are_objects_and_never_truth():
    scene = Scene(
        length=100.0,
        holes={"empty": 0.1, "over": 1.0},
        draws=[{"kind": "plastic", "depth": 0.1, "count": 5}],
    )
    world = draw_world(scene, 1)
    table = world.objects_table()
    empty = [h for h in world.holes if h.target is None]
    assert len(empty) > 10
    assert (table["kind"] == "hole").sum() == len(empty)
    assert table["object_id"].is_unique
    assert len(world.truth()) == 5
    assert not world.truth()["kind"].isin(["hole"]).any()


def test_a_hole_of_the_soil_itself_changes_nothing():
    ground = ground_of(MOIST)
    extra, factor = hole_factor(SAME, 0.1, 0.92, ground)
    assert extra == pytest.approx(0, abs=1e-12)
    np.testing.assert_allclose(factor, 1, atol=1e-9)


def test_loose_soil_is_passed_sooner_and_with_less_loss():
    """Every term by hand: fill of 0.8 of the density, a cap of 2 cm, 10 cm deep."""
    ground = ground_of(MOIST)
    s = 0.92
    depth = 0.1
    hole = SAME._replace(looseness=0.8, cap=0.02)
    extra, factor = hole_factor(hole, depth, s, ground)
    fill = (1 + 0.8 * (np.sqrt(ground.media[0]) - 1)) ** 2
    way = (
        0.12 * np.sqrt(fill - s**2)
        - 0.02 * np.sqrt(1 - s**2)
        - depth * np.sqrt(ground.media[0] - s**2)
    )
    total = np.exp(-2j * ground.wavenumber * extra) * factor
    np.testing.assert_allclose(total, np.exp(-2j * ground.wavenumber * way), rtol=1e-9)
    flat, kept = hole_factor(hole._replace(cap=0.0), depth, s, ground)
    assert flat < -0.01
    assert (np.abs(kept) > 1).all()
    wetter, lost = hole_factor(hole._replace(cap=0.0, moisture=0.15), depth, s, ground)
    assert wetter > 0.01
    assert (np.abs(lost) < np.abs(kept)).all()


def test_a_target_in_a_hole_is_seen_through_it(quiet):
    """The simulated target's echo turns and grows by the factor, tone by tone."""
    target = {"kind": "metal", "x": 0.0, "y": 12.0, "depth": 0.1}
    loose = {
        "over": 1.0,
        "looseness": (0.8, 0.8000001),
        "moisture": 0.0,
        "cap": 0.0,
        "rough_db": 0.0,
    }
    base = {"soil": MOIST, "surface": BARE, "track": STILL, "targets": [target]}
    without = Simulator(Scene(**base), quiet, 1)
    within = Simulator(Scene(**base, holes=loose), quiet, 1)
    edges = within._layers
    within._layers = []
    ratio = within.scan(0)[0] / without.scan(0)[0]
    (hole,) = within.world.holes
    extra, factor = hole_factor(hole, 0.1, 12 / 13, within._ground)
    want = factor * np.exp(-2j * within._ground.wavenumber * extra)
    np.testing.assert_allclose(ratio, np.broadcast_to(want, ratio.shape), atol=2e-3)
    assert len(edges) == 1


def test_the_flashes_of_wall_and_cap_are_their_disc_s_transform():
    k = 2 * np.pi * 1.05e9 / SPEED
    s = 0.92
    soil = 4.0
    contrast = -0.4
    hole = SAME._replace(cap=0.015)
    x = 2 * k * hole.radius * s
    turn = np.exp(1j * x)
    wall = sum(wall_flash(hole, contrast, soil, 0.0, s, k, side) * turn**side for side in (1, -1))
    scale = (
        np.sqrt(4 * np.pi) * k**2 / 4 * contrast * hole.radius**2 / (2j * k * np.sqrt(soil - s**2))
    )
    assert abs(wall - scale * 2 * j1(x) / x) < 0.1 * abs(scale) * np.sqrt(8 / (np.pi * x**3))
    h, v = np.sum(
        [np.array(cap_flash(hole, soil, s, k, side)) * turn**side for side in (1, -1)], axis=0
    )
    c = np.sqrt(1 - s**2)
    q = np.sqrt(soil - s**2)
    height = 4 * np.pi * hole.cap * jv(2, x) / (2 * k * s) ** 2
    level = np.sqrt(4 * np.pi) * k**2 * c**2 / np.pi
    assert (
        abs(h - level * (soil - 1) / (c + q) ** 2 * height)
        < 0.3 * abs(h) + 0.2 * level * hole.cap / k**2
    )
    assert abs(v) > 2 * abs(h)
    rough = wall_flash(hole, contrast, soil, 0.02, s, k, 1)
    assert abs(rough) == pytest.approx(
        abs(wall_flash(hole, contrast, soil, 0.0, s, k, 1)) * np.exp(-0.5 * (2 * k * 0.02 * s) ** 2)
    )


def test_an_empty_hole_echoes_as_its_contrast(quiet):
    """The echo is there, and grows with the contrast."""

    def level(looseness):
        table = {
            "empty": 0.3,
            "looseness": (looseness, looseness + 1e-6),
            "moisture": 0.0,
            "cap": 0.0,
            "wall": 0.0,
        }
        scene = Scene(soil=MOIST, surface=BARE, track=STILL, length=30.0, holes=table)
        return Simulator(scene, quiet, 4)

    strong = level(0.7)
    weak = level(0.9)
    ratio = np.linalg.norm(strong.scan(0)[0]) / np.linalg.norm(weak.scan(0)[0])
    soil = np.sqrt(strong._ground.real[0])
    contrast = [(1 + f * (soil - 1)) ** 2 - soil**2 for f in (0.7, 0.9)]
    assert ratio == pytest.approx(contrast[0] / contrast[1], rel=0.02)


@pytest.mark.slow("simulates the scene several times")
def test_a_scene_told_thing_by_thing_is_the_same_scene(quiet):
    scene = Scene(
        soil=MOIST,
        surface={"density": 4.0},
        track=STILL,
        length=20.0,
        draws=[{"kind": "metal", "depth": 0.05, "count": 6}],
        holes={"over": 1.0, "empty": 0.05, "rough_db": 6.0},
        clutter={"rocks": 0.1, "patches": 0.05},
    )
    one = Scene.model_validate(world_description(scene, 5))
    assert draw_world(one, 5).patches == draw_world(scene, 5).patches
    assert draw_world(one, 5).holes == draw_world(scene, 5).holes
    ours, theirs = (Simulator(some, quiet, 5).scan(0) for some in (one, scene))
    np.testing.assert_allclose(ours, theirs, atol=1e-6 * np.abs(theirs).max())
    assert (
        not draw_world(Scene.model_validate(world_description(scene, 5) | {"targets": []}), 5)
        .truth()
        .size
    )


def test_bodies_are_what_their_absence_takes_away_but_for_the_disturbed_ground(quiet):
    """Array errors, noise and all: what the bodies add does not hold the grain of the ground over them."""
    radar = quiet.model_copy(update={"errors": load_sensor("sri-array").errors})

    def added(**holes):
        scene = Scene(
            soil=MOIST, surface={"density": 4.0}, track=STILL, length=20.0, shadow={"on": False}, holes=holes,
            draws=[{"kind": "metal", "depth": 0.05, "count": 6}], clutter={"rocks": 0.0, "patches": 0.0},
        )  # fmt: skip
        without = Scene.model_validate(world_description(scene, 5) | {"targets": []})
        simulator = Simulator(scene, radar, 5)
        return simulator.bodies(0), simulator.scan(0) - Simulator(without, radar, 5).scan(0)

    ours, theirs = added(on=False)
    np.testing.assert_allclose(ours, theirs, atol=1e-4 * np.abs(theirs).max())
    ours, theirs = added(over=1.0, empty=0.0, rough_db=12.0)
    assert np.linalg.norm(theirs - ours) > 0.1 * np.linalg.norm(ours)
