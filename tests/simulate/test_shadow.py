import dataclasses

import numpy as np
import pytest

from flgpr.model import Lane
from flgpr.simulate import Scene, Simulator
from flgpr.simulate.ground.layers import ScanView, Skeleton
from flgpr.simulate.ground.shadow import Shadows, Strip, shadow_strips
from flgpr.simulate.ground.terrain import TerrainHeights
from flgpr.simulate.scene import scene_tables as tables
from flgpr.simulate.scene.world import draw_world
from flgpr.simulate.simulator import array_state
from reference import slow_shadow
from simulate.conftest import BARE, STILL

TONES = np.linspace(0.5e9, 3.0e9, 101)
NODES = np.geomspace(0.5e9, 3.0e9, 5)
FLAT = TerrainHeights(tables.Terrain(), Lane(-1.5, 1.5, 0.0, 30.0), 1)


@pytest.fixture
def pair(quiet):
    """One antenna that sends and receives from 5 m."""
    one = quiet.model_copy(update={"tx": ((0.0, 0.0, 0.0),), "rx": ((0.0, 0.0, 0.0),)})
    return array_state(one, np.array([0.0, 0.0, 5.0, 0.0, 0.0, 0.0]))


@pytest.mark.parametrize("across", [0.0, 0.1, 0.35])
@pytest.mark.parametrize("radius", [0.05, 0.25])
def test_behind_a_high_strip_the_wave_comes_round_its_sides(pair, across, radius):
    """Against Huygens sources summed over exact distances on either side of the strip, which here is very high."""
    shadows = Shadows([Strip(0.0, 10.0, 0.0, 30.0, radius)], pair, TONES)
    point = np.array([across, 12.0, 0.0])
    found = shadows.factors(point[None, :], NODES)[0]
    slant = np.linalg.norm(point - [0, 0, 5.0])
    flat = np.hypot(*point[:2])
    along = 10.0 * 12.0 / flat
    offset = 10.0 * across / flat  # of the ray from the strip's middle, at its foot
    before = slant * along / flat
    behind = slant * (1 - along / flat)
    for factor, tone in zip(found, NODES, strict=True):
        shares = (-offset - radius, -offset + radius, before, behind, 299792458.0 / tone)
        blocked = slow_shadow.part_of_the_wave(*shares)
        assert factor == pytest.approx((1 - blocked) ** 2, abs=0.02)


def test_on_the_edge_of_the_shadow_the_top_stops_half(pair):
    """Knife edge: where the ray just touches the top, half of what a strip without end stops gets by."""
    edge = np.array([[0.0, 10.0 * 5.0 / 4.0, 0.0]])  # 1 m high, seen from 5 m
    low, high = (
        Shadows([Strip(0.0, 10.0, -50.0, top, 1.0)], pair, TONES).factors(edge, NODES)[0]
        for top in (1.0, 60.0)
    )
    np.testing.assert_allclose(high, (2 * np.sqrt(low) - 1) ** 2, atol=0.01)
    assert np.abs(low).mean() > 2 * np.abs(high).mean()


def test_the_shadow_ends_where_the_ray_passes_over_the_top(pair):
    """Past H/(h - H) of the distance the light comes back, sooner for short waves."""
    shadows = Shadows([Strip(0.0, 10.0, 0.0, 1.0, 0.5)], pair, TONES)
    y = np.array([10.8, 12.5, 14.5, 20.0])
    level = np.abs(shadows.factors(np.column_stack([0 * y, y, 0 * y]), NODES))
    assert np.all(level[0] < 0.5)
    assert level[0, -1] < 0.1
    assert np.all(np.abs(level[1] - 0.4) < 0.35)
    assert np.all(np.abs(level[3] - 1) < 0.25)
    assert np.all(np.diff(level[:3].mean(axis=1)) > 0)


def test_long_waves_fill_the_shadow_in(pair):
    shadows = Shadows([Strip(0.0, 10.0, 0.0, 1.0, 0.15)], pair, TONES)
    x = np.linspace(-0.12, 0.12, 25)  # over the ripples of the two sides' waves
    factor = shadows.factors(np.column_stack([x, np.full_like(x, 10.8), 0 * x]), NODES)
    level = np.sqrt((np.abs(factor) ** 2).mean(axis=0))
    assert np.all(np.diff(level) < 0)
    assert level[0] > 2 * level[-1]


def test_there_is_no_shadow_before_an_object_nor_beside_it_nor_on_itself(pair):
    shadows = Shadows([Strip(0.0, 10.0, 0.0, 1.0, 0.1)], pair, TONES)
    points = np.array(
        [[0.0, 9.9, 0.0], [0.0, 6.0, 0.0], [0.0, 10.0, 0.5], [0.0, 10.05, 0.0], [4.0, 12.0, 0.0]]
    )
    np.testing.assert_array_equal(shadows.factors(points, NODES), 1)
    assert abs(shadows.factors(np.array([[0.0, 11.0, 0.0]]), NODES)[0, -1]) < 0.9


def test_leaves_let_a_part_through(pair):
    bare = {"x": 0.0, "y": 10.0, "radius": 0.5, "height": 1.0}
    lane = Scene(length=30.0, objects=[{"kind": "bush"} | bare])
    (bush,) = shadow_strips((), lane.objects, FLAT, 1.3)
    assert bush.foliage == pytest.approx(1.3 * np.pi / 2 * 0.5)
    point = np.array([[0.0, 10.8, 0.0]])
    through = np.abs(Shadows([bush], pair, TONES).factors(point, NODES))[0]
    opaque = np.abs(Shadows([bush._replace(foliage=np.inf)], pair, TONES).factors(point, NODES))[0]
    clear = np.abs(Shadows([bush._replace(foliage=0.0)], pair, TONES).factors(point, NODES))[0]
    np.testing.assert_allclose(clear, 1)
    assert np.all((opaque < through) & (through < 1))
    # Where hardly anything comes round, what is left is the leaves' own loss both ways.
    assert 20 * np.log10(through[-1]) == pytest.approx(
        -2 * bush.foliage * np.sqrt(3.0 / 0.87), abs=2
    )


def test_who_throws_a_shadow():
    lane = Scene(
        length=30.0,
        targets=[
            {"kind": "metal", "x": 0, "y": 5, "depth": -0.15},
            {"kind": "metal", "x": 0, "y": 6, "depth": 0.05},
            {"kind": "plastic", "x": 0, "y": 7, "depth": -0.15},
        ],
        objects=[
            {"kind": "rock", "x": 0, "y": 8, "radius": 0.1},
            {"kind": "rock", "x": 0, "y": 9, "radius": 0.03},
            {"kind": "post", "x": 0, "y": 10, "height": 0.8},
            {"kind": "fiducial", "x": 0, "y": 11, "height": 0.5},
        ],
    )
    slope = TerrainHeights(tables.Terrain(slope_along=0.05), lane.lane, 1)
    world = draw_world(lane, 1)
    strips = shadow_strips(world.targets, world.objects, slope, 1.3)
    assert [strip.y for strip in strips] == [5, 8, 10]
    assert [strip.top - strip.bottom for strip in strips] == pytest.approx([0.15, 0.1, 0.8])
    assert [strip.bottom for strip in strips] == pytest.approx(
        [slope(0, y).item() for y in (5, 8, 10)]
    )


def test_scatterers_in_the_shade_keep_their_spectrum_times_the_factor(quiet):
    """The factor at the skeleton's few tones goes through the band as the factor of every tone does."""
    sensor = quiet
    frequency = quiet.tones.axis()
    pose = np.array([0.0, 0.0, sensor.height, 0.0, 0.0, 0.0])
    simulator = Simulator(Scene(track=STILL, surface={"density": 3.0}), sensor, 1, errors=False)
    array = dataclasses.replace(array_state(sensor, pose), tx=np.array([0]), rx=np.array([5]))
    strips = [Strip(0.0, 10.0, 0.0, 1.0, 0.3), Strip(-1.0, 9.0, 0.0, 0.5, 0.1, 6.0)]
    shadows = Shadows(strips, array, frequency)
    layer = simulator._layers[0]
    skeleton = Skeleton(
        [layer], ScanView(sensor.footprint, pose, array_state(sensor, pose)), frequency
    )
    found = layer.echoes(ScanView(sensor.footprint, pose, array))
    values = skeleton.values(found)
    points = found.points
    at_nodes = values.copy()
    shadows.darken(at_nodes, points, skeleton.nodes)
    dark = np.abs(at_nodes / values - 1).max(axis=(1, 2)) > 0.2
    assert 10 < dark.sum() < 0.3 * len(points)
    spectra = np.einsum("irc,rcf->icf", found.coefficient[dark], found.basis)
    beam = slow_beam(points[dark], array, frequency)[:, None]
    want = spectra * beam * shadows.factors(points[dark], frequency)[:, None]
    got = np.einsum(
        "icr,ir,rf->icf",
        at_nodes[dark],
        slow_beam(points[dark], array, skeleton.nodes),
        skeleton.functions,
    )
    assert np.linalg.norm(got - want) < 0.1 * np.linalg.norm(want)


def slow_beam(points, array, frequency):
    """Two-way amplitude (point, frequency) of the only pair's beam."""
    cosine = np.ones(len(points))
    for antenna in (array.tx[0], array.rx[0]):
        ray = points - array.position[antenna]
        cosine *= np.maximum(ray @ array.boresight / np.linalg.norm(ray, axis=1), 0)
    return cosine[:, None] ** (0.5 * array.exponents(frequency))


def test_a_target_behind_a_post_is_darker_by_the_factor(quiet):
    post = {"kind": "post", "x": 0.0, "y": 10.0, "radius": 0.3, "height": 1.5}
    corner = {"kind": "fiducial", "x": 0.0, "y": 12.0}
    lane = Scene(surface=BARE, track=STILL, length=30.0, objects=[post, corner])
    alone = Simulator(lane.model_copy(update={"objects": lane.objects[:1]}), quiet, 1).scan(0)
    lit = Simulator(lane, quiet, 1).scan(0) - alone
    on = lane.model_copy(update={"shadow": tables.Shadow(on=True)})
    dark = Simulator(on, quiet, 1).scan(0) - alone
    array = array_state(quiet, np.array([0.0, 0.0, quiet.height, 0.0, 0.0, 0.0]))
    shadows = Shadows([Strip(0.0, 10.0, 0.0, 1.5, 0.3)], array, quiet.tones.axis())
    want = shadows.body_factor(np.array([0.0, 12.0, 0.0]))
    np.testing.assert_allclose(dark[0], lit[0] * want, rtol=1e-3, atol=1e-5 * np.abs(lit).max())
    assert np.linalg.norm(dark) < 0.6 * np.linalg.norm(lit)


def test_switched_off_is_the_lit_lane_to_the_bit(quiet):
    post = {"kind": "post", "x": 0.0, "y": 10.0, "radius": 0.1, "height": 1.0}
    lane = Scene(length=30.0, track=STILL, surface={"density": 5.0}, objects=[post])
    lit = Simulator(lane, quiet, 4).scan(0)
    off = lane.model_copy(update={"shadow": tables.Shadow(on=False)})
    np.testing.assert_array_equal(Simulator(off, quiet, 4).scan(0), lit)
    one, other = (
        Simulator(lane.model_copy(update={"shadow": tables.Shadow(on=True)}), quiet, 4).scan(0)
        for _ in range(2)
    )
    np.testing.assert_array_equal(one, other)
    assert np.linalg.norm(one - lit) > 0.005 * np.linalg.norm(lit)
