import numpy as np
import pytest
from scipy.special import j1
from scipy.stats import kstest

from flgpr.imaging import ScanImager
from flgpr.model import Antenna, Grid
from flgpr.model.refraction import apparent_shift
from flgpr.simulate import Scene, Simulator
from flgpr.simulate.ground import inclusions
from flgpr.simulate.ground.buried_spectra import LENS, BuriedSpectra, spectral_shapes
from flgpr.simulate.ground.subsurface import (
    Buried,
    SubsurfaceField,
    stone_radii,
    subsurface_layers,
)
from flgpr.simulate.scene.scene_tables import Stones
from simulate.buried_points import (
    DRY,
    MOIST,
    flat_layer,
    given,
    ground_of,
    sine_at,
    spectra_of,
    view_of,
)
from simulate.conftest import BARE, STILL

SPEED = 299792458.0


@pytest.fixture
def few_tones(quiet):
    return quiet.model_copy(
        update={"tones": quiet.tones.model_copy(update={"step": 40e6, "count": 64})}
    )


def test_stones_are_as_many_and_as_large_as_their_law(quiet):
    scene = Scene(soil=DRY, stones={"density": 2.0, "radius": (0.01, 0.08), "exponent": 2.5})
    ground = ground_of(DRY, quiet)
    spectra = BuriedSpectra(ground, spectral_shapes(scene, ground), 0.4)
    field = SubsurfaceField(scene, spectra, 30.0, 10.0, seed=1)
    count = sum(field.stones(ix, iy).depth.size for ix in range(30) for iy in range(30))
    assert abs(count - 1800) < 4 * np.sqrt(1800)
    radii = stone_radii(Stones(), np.random.default_rng(0).random(4000))
    low = 0.01
    high = 0.08
    d = 2.5

    def law(r):
        return (1 - (r / low) ** -d) / (1 - (high / low) ** -d)

    assert kstest(radii, law).pvalue > 1e-3
    assert kstest(radii, lambda r: law(r) ** 1.15).pvalue < 1e-3  # the test can tell


def test_a_buried_point_is_focused_at_its_apparent_shift(quiet):
    scene = Scene(soil=DRY, surface=BARE, track=STILL, length=30.0)
    layer, _ = flat_layer(given([(0.0, 12.0)], 0.15), DRY, quiet)
    simulator = Simulator(scene, quiet.model_copy(update={"antenna": Antenna()}), 1)
    simulator._layers = [layer]
    grid = Grid.spanning((-0.3, 0.3), (11.6, 12.8), 0.01)
    image = np.abs(
        next(iter(ScanImager(simulator.run(), grid, {"all": (0.45e9, 2.95e9)}))).values[0, 0]
    )
    row, column = np.unravel_index(image.argmax(), grid.shape)
    shift = float(apparent_shift(0.15, 3.4, sine_at([(0.0, 12.0)])[0]))
    assert shift > 0.2
    assert grid.y[row] == pytest.approx(12.0 + shift, abs=0.02)
    assert grid.x[column] == pytest.approx(0.0, abs=0.02)


@pytest.mark.slow("repeats a draw until its statistics stand")
@pytest.mark.parametrize("tone", [20, 128, 230])
def test_the_uneven_soil_echoes_as_its_closed_form(quiet, tone):
    uneven = {"deviation": 0.5, "horizontal": 0.1, "vertical": 0.05, "depth": 0.4, "density": 60.0}
    scene = Scene(soil=MOIST, heterogeneity=uneven)
    ground = ground_of(MOIST, quiet)
    (layer,) = subsurface_layers(scene, (), ground, 1.0, seed=3)
    echoes = layer.echoes(view_of(quiet))
    power = np.abs(spectra_of(echoes)[..., tone]) ** 2
    s = sine_at(echoes.points[:, :2])
    k = ground.wavenumber[tone]
    eps = ground.media[0][tone]
    q = np.sqrt(eps - s**2)
    c = np.sqrt(1 - s**2)
    x_min, x_max, y_min, y_max = quiet.footprint
    area = (x_max - x_min) * (y_max - y_min)
    rate = 4 * k * np.abs(q.imag)
    for channel, t in ((0, 2 * c / (c + q)), (1, 2 * np.sqrt(eps) * c / (eps * c + q))):
        sigma = inclusions.volume_backscatter(k, s, eps.real, 0.5, 0.1, 0.05)
        want = area * np.mean(sigma * np.abs(t) ** 4 * (1 - np.exp(-rate * 0.4)) / rate)
        error = np.sqrt(np.sum(power[:, channel] ** 2))  # of a sum of independent terms
        assert error < 0.1 * want
        assert abs(power[:, channel].sum() - want) < 3 * error + 0.08 * want


def test_the_two_flashes_of_a_lens_are_born_s_disc(quiet):
    """Both flashes beyond the way to the disc's middle add up to k0²·δε·a²h/4·2J_1(x)/x·sqrt(4π)."""
    radius = 0.15
    thickness = 1e-4
    contrast = 0.7
    k = 2 * np.pi * 1.2e9 / SPEED
    near = complex(inclusions.lens(radius, contrast, thickness, k))
    for s in (0.8, 0.9, 0.97):
        x = 2 * k * radius * s
        both = s**-1.5 * (near * np.exp(1j * x) + np.conj(near) * np.exp(-1j * x))
        full = np.sqrt(4 * np.pi) * k**2 / 4 * contrast * radius**2 * thickness
        assert abs(both - full * 2 * j1(x) / x) < 0.05 * full * 2 * np.sqrt(2 / (np.pi * x**3)) * 2
    layer, _ = flat_layer(given([(0.0, 12.0)] * 2, 0.1, shape=LENS, reach=0.15), DRY, quiet)
    np.testing.assert_allclose(layer.echoes(view_of(quiet)).points[:, 1], 11.85, atol=1e-3)


def test_a_point_s_echo_does_not_depend_on_how_many_are_in_view(few_tones):
    """Above 256 KiB NumPy multiplies nameless arrays in place, with other last bits."""
    rng = np.random.default_rng(2)
    count = 15_000
    xy = np.stack([rng.uniform(-1, 1, count), rng.uniform(9, 14, count)], axis=1)
    size = rng.standard_normal(count) + 1j * rng.standard_normal(count)
    points = given(xy, 0.05, size)
    first = Buried(*(column[:500] for column in points))
    together, _ = flat_layer(points, MOIST, few_tones)
    alone, _ = flat_layer(first, MOIST, few_tones)
    view = view_of(few_tones)
    np.testing.assert_array_equal(
        together.echoes(view).coefficient[:500], alone.echoes(view).coefficient
    )


def test_a_field_along_a_root_makes_its_echo(quiet):
    """Across the look it answers H alone, along it V alone, and aslant both and HV."""
    middle = 128

    def echo(axis):
        layer, _ = flat_layer(given([(0.0, 12.0)], 0.0, 0.0, 1.0, axis), DRY, quiet)
        return np.abs(spectra_of(layer.echoes(view_of(quiet)))[0, :, middle])

    h, v, x = echo((1.0, 0.0, 0.0))
    assert h > 0.1
    assert max(v, x) < 0.02 * h
    h, v, x = echo((0.0, 1.0, 0.0))
    assert v > 0.1
    assert max(h, x) < 0.02 * v
    h, v, x = echo((np.sqrt(0.5), np.sqrt(0.5), 0.0))
    assert x == pytest.approx(np.sqrt(h * v), rel=0.02)


def test_roots_of_every_direction_have_the_cross_level_of_thin_wires(few_tones):
    scene = Scene(
        soil=DRY,
        roots={"density": 3.0, "plunge": 0.0, "radius": (0.004, 0.0041), "loss_tangent": 0.0},
    )
    (layer,) = subsurface_layers(scene, (), ground_of(DRY, few_tones), 1.0, seed=5)
    echoes = layer.echoes(view_of(few_tones))
    power = np.sum(np.abs(spectra_of(echoes)[..., 32]) ** 2, axis=0)
    turn = np.linspace(0, np.pi, 200, endpoint=False)
    across = 2 * 3.4 / (22 + 3.4)
    s = sine_at(echoes.points[:, :2])
    inside = np.sqrt(1 - s**2 / 3.4)
    c = np.sqrt(1 - s**2)
    q = np.sqrt(3.4 - s**2)
    n = np.sqrt(3.4)
    ratio = n * (c + q) / (3.4 * c + q)  # t12 of V over that of H
    level = np.mean((across + (1 - across) * np.cos(turn) ** 2) ** 2)
    cross = np.mean(((1 - across) * np.cos(turn) * np.sin(turn)) ** 2) * np.mean(
        (inside * ratio) ** 2
    )
    assert power[2] / power[0] == pytest.approx(
        cross / level, rel=0.15
    )  # about 900 roots that turn twice
    assert -10 < 10 * np.log10(power[2] / power[0]) < -2


def test_stones_of_any_shape_depolarize_and_round_ones_do_not(few_tones):
    def cross(stretch):
        scene = Scene(soil=DRY, stones={"density": 5.0, "stretch": stretch})
        (layer,) = subsurface_layers(scene, (), ground_of(DRY, few_tones), 1.0, seed=5)
        power = np.sum(np.abs(spectra_of(layer.echoes(view_of(few_tones)))[..., 32]) ** 2, axis=0)
        return 10 * np.log10(power[2] / power[0] + 1e-30)

    assert cross(1.0) < -60
    assert -40 < cross(1.8) < -10


FULL = {
    "stones": {"density": 2.0},
    "roots": {"density": 0.3},
    "lenses": {"density": 0.3},
    "heterogeneity": {"deviation": 0.3, "density": 5.0},
    "holes": {"empty": 0.1, "over": 0.5},
}
LANE = {
    "soil": MOIST,
    "surface": {"density": 5.0},
    "length": 20.0,
    "track": {"positions": (0.0, 1.0, 2.5)},
}
MINES = {"draws": [{"kind": "metal", "depth": 0.05, "count": 4}], "clutter": {"rocks": 0.05}}


@pytest.mark.slow("simulates the lane several times")
def test_the_same_seed_gives_the_same_bits_in_any_order(few_tones):
    one, other = (Simulator(Scene(**LANE, **MINES, **FULL), few_tones, 7) for _ in range(2))
    forwards = [one.scan(k) for k in (0, 1, 2)]
    backwards = [other.scan(k) for k in (2, 1, 0)][::-1]
    for a, b in zip(forwards, backwards, strict=True):
        np.testing.assert_array_equal(a, b)
    assert not np.array_equal(
        Simulator(Scene(**LANE, **MINES, **FULL), few_tones, 8).scan(0), forwards[0]
    )


@pytest.mark.slow("simulates the lane several times")
def test_switched_off_it_is_the_world_without(few_tones):
    bare = Simulator(Scene(**LANE, **MINES), few_tones, 7)
    off = {name: table | {"on": False} for name, table in FULL.items()}
    np.testing.assert_array_equal(
        Simulator(Scene(**LANE, **MINES, **off), few_tones, 7).scan(0), bare.scan(0)
    )
    for name in FULL:
        one = Simulator(Scene(**LANE, **MINES, **(off | {name: FULL[name]})), few_tones, 7)
        assert not np.array_equal(one.scan(0), bare.scan(0)), name
        assert one.truth.equals(bare.truth), name
        assert one.objects[one.objects["kind"] != "hole"].equals(bare.objects), name
