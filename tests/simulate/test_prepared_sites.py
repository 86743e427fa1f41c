"""The prepared test lanes: what the simulator draws has the statistics that the sites' files declare."""

import re
from importlib import resources

import numpy as np
import pytest

from flgpr.simulate import Scene, Simulator, sites
from flgpr.simulate.bodies.echoes import LayeredGround
from flgpr.simulate.ground.buried_spectra import BuriedSpectra, spectral_shapes
from flgpr.simulate.ground.roughness import UNEVEN_LENGTH, surface_heights
from flgpr.simulate.ground.subsurface import SubsurfaceField
from flgpr.simulate.ground.terrain import TerrainHeights
from flgpr.simulate.scene.world import BARE, MARGIN, draw_world
from flgpr.simulate.simulator import array_state
from simulate.conftest import STILL

PREPARED = ("prepared-sand", "prepared-earth", "prepared-gravel", "prepared-clay")
NATURAL = {
    "prepared-sand": "arid-sand",
    "prepared-earth": "temperate",
    "prepared-gravel": "gravel",
    "prepared-clay": "wet-clay",
}
# middles of ISO 8608's classes, m³
CLASS_A = 16e-6
CLASS_C = 256e-6

each = pytest.mark.parametrize("site", PREPARED)


def file_of(site):
    return (resources.files("flgpr.simulate.scene") / "sites" / f"{site}.toml").read_text(
        encoding="utf-8"
    )


def ranges(site):
    """Ranges that a site's file tells: {(table, entry): (least, greatest)}."""
    found = {}
    table = None
    for line in file_of(site).splitlines():
        if heading := re.fullmatch(r"\[(\w+)\]", line):
            table = heading[1]
        if told := re.match(r"# range (\w+) ([\d.e-]+) ([\d.e-]+)(:|$)", line):
            found[table, told[1]] = float(told[2]), float(told[3])
    return found


def test_they_are_packaged():
    assert set(PREPARED) <= set(sites())


# --- the files ---


@each
def test_every_entry_has_its_source(site):
    """A comment on its line or above it, back to the entry before, or the word that it is as the natural site's."""
    documented = False
    for line in file_of(site).splitlines():
        if line.startswith("#"):
            documented = True
        elif " = " in line:
            follows_a_sibling = line.startswith(("vertical", "model", "on"))
            assert "#" in line or documented or follows_a_sibling, line
            documented = False


@each
def test_an_entry_with_a_range_is_its_middle(site):
    """The geometric middle, or half where the range begins at nothing; three entries say why they are not."""
    told = ranges(site)
    assert {
        ("surface", "rms_height"),
        ("surface", "correlation_length"),
        ("surface", "unevenness"),
    } <= set(told)
    scene = Scene(site=site)
    for (table, entry), (least, greatest) in told.items():
        value = getattr(getattr(scene, table), entry)
        assert least <= value <= greatest, entry
        if entry in {"posts", "rut_depth"} or (site == "prepared-sand" and entry == "moisture"):
            continue
        if (site, entry) == ("prepared-gravel", "density"):  # what passes the sieve
            assert value == pytest.approx(10 * (1 - 1.25**-2.5), abs=0.05)
            continue
        middle = np.sqrt(least * greatest) if least > 0 else greatest / 2
        assert value == pytest.approx(middle, rel=0.1), entry


@each
def test_a_prepared_lane_is_in_no_part_worse_than_the_natural_site(site):
    lane = Scene(site=site)
    natural = Scene(site=NATURAL[site])
    assert lane.surface.rms_height < natural.surface.rms_height
    assert CLASS_A <= lane.surface.unevenness <= CLASS_C < natural.surface.unevenness
    assert lane.surface.cross_db < natural.surface.cross_db
    for table, entry in (
        ("clutter", "rocks"),
        ("clutter", "bushes"),
        ("clutter", "posts"),
        ("clutter", "patches"),
        ("stones", "density"),
        ("roots", "density"),
        ("lenses", "density"),
        ("heterogeneity", "deviation"),
        ("holes", "empty"),
        ("holes", "cap"),
        ("holes", "moisture"),
        ("holes", "rough_db"),
        ("terrain", "undulation"),
        ("terrain", "rut_depth"),
        ("grass", "height"),
    ):
        assert getattr(getattr(lane, table), entry) <= getattr(getattr(natural, table), entry), (
            table,
            entry,
        )
    for new, old in zip(lane.holes.looseness, natural.holes.looseness, strict=True):
        assert new == pytest.approx((old + 1) / 2, abs=1e-9)


@pytest.mark.parametrize(
    ("site", "permittivity", "loss_tangent", "of_the_model"),
    [
        ("prepared-sand", 3.0, 0.013, 0.055),
        ("prepared-earth", 6.6, 0.07, 0.090),
        ("prepared-gravel", 6.0, 0.06, None),
        ("prepared-clay", 12.6, 0.24, 0.161),
    ],
)
def test_permittivity_and_loss_at_1_ghz(site, permittivity, loss_tangent, of_the_model):
    soil = Scene(site=site).soil
    eps = soil.media(1e9)[-1].item()
    assert eps.real == pytest.approx(permittivity, abs=0.05)
    assert -eps.imag / eps.real == pytest.approx(loss_tangent, rel=1e-9)
    if of_the_model is not None:
        own = soil.model_copy(update={"loss_tangent": None}).media(1e9)[-1].item()
        assert -own.imag / own.real == pytest.approx(of_the_model, abs=0.0005)


# --- the surface ---


def profile_spectrum(cycles, rms_height, length):
    """One-sided spectrum of a profile of exponential correlation, m³, over the waves per metre."""
    return 4 * rms_height**2 * length / (1 + (2 * np.pi * cycles * length) ** 2)


def declared_spectrum(surface, cycles):
    """Of the short part and of ISO 8608's ``G0·(n/0.1)^-2``, which levels out beyond 2π·0.5 m, one by one."""
    flattened = cycles**2 + 1 / (2 * np.pi * UNEVEN_LENGTH) ** 2
    uneven = surface.unevenness * 0.1**2 / flattened
    return profile_spectrum(cycles, surface.rms_height, surface.correlation_length) + uneven


@each
def test_the_drawn_surface_has_the_declared_rms_height(site):
    """One place in each of 600 worlds: three standard errors of a variance are 17 %; a natural site's is twice it."""
    surface = Scene(site=site).surface
    heights = np.array([surface_heights(surface, seed)(0.3, 12.0) for seed in range(600)])
    uneven_variance = np.pi**2 * 0.1**2 * surface.unevenness * UNEVEN_LENGTH
    declared = surface.rms_height**2 + uneven_variance
    assert np.mean(heights**2) == pytest.approx(declared, rel=0.17)
    natural = Scene(site=NATURAL[site]).surface
    assert (
        natural.rms_height**2 + np.pi**2 * 0.1**2 * natural.unevenness * UNEVEN_LENGTH
        > 2 * declared
    )


@pytest.mark.slow("repeats a draw until its statistics stand")
@each
def test_the_drawn_surface_has_the_declared_spectrum(site):
    """Periodograms of profiles of 8 m, over octaves of wavelengths from 1 m to 6 cm."""
    surface = Scene(site=site).surface
    step = 0.01
    points = 800
    along = np.arange(points) * step
    window = np.hanning(points)
    cycles = np.fft.rfftfreq(points, step)
    power = []
    for seed in range(48):
        profile = surface_heights(surface, seed)(np.zeros(points), along)
        power.append(2 * step * np.abs(np.fft.rfft(profile * window)) ** 2 / np.sum(window**2))
    power = np.array(power)
    for octave in (1.0, 2.0, 4.0, 8.0):
        inside = (cycles >= octave) & (cycles < 2 * octave)
        found = power[:, inside].mean(axis=1)
        declared = declared_spectrum(surface, cycles[inside]).mean()
        error = found.std() / np.sqrt(found.size)
        assert error < 0.12 * declared  # the test can tell 3 dB
        assert found.mean() == pytest.approx(declared, abs=3.5 * error + 0.04 * declared), octave


@each
def test_undulation_and_ruts_are_as_declared(site):
    scene = Scene(site=site)
    level = scene.terrain.model_copy(update={"rut_depth": 0.0})
    place = np.array([[0.3, 20.0]])
    drawn = [TerrainHeights(level, scene.lane, seed).relief(place)[0, 0] for seed in range(600)]
    assert np.std(drawn) == pytest.approx(scene.terrain.undulation, rel=0.09)
    # As much as the uneven ground's class has in waves of 3 to 30 m: G0·0.1²·(30 - 3) under the
    # root.
    assert scene.terrain.undulation == pytest.approx(
        np.sqrt(scene.surface.unevenness * 0.1**2 * 27), rel=0.02
    )
    if scene.terrain.rut_depth > 0:
        straight = scene.terrain.model_copy(update={"undulation": 0.0, "rut_wander": 0.0})
        middle = scene.terrain.rut_spacing / 2
        assert TerrainHeights(straight, scene.lane, 1)(middle, 7.0) == pytest.approx(
            -scene.terrain.rut_depth, rel=1e-3
        )


def small_perturbation(frequency, sine, eps, surface):
    """HH and VV of the first order, of the two spectra side by side and without tilt (Ulaby et al. 1982, Sec. 12-5)."""
    k = 2 * np.pi * frequency / 299_792_458.0
    cosine = np.sqrt(1 - sine**2)
    inside = np.sqrt(eps - sine**2)
    hh = (eps - 1) / (cosine + inside) ** 2
    vv = (eps - 1) * (eps * (1 + sine**2) - sine**2) / (eps * cosine + inside) ** 2
    bragg = 2 * k * sine
    spectrum = 0.0
    uneven = np.sqrt(np.pi**2 * 0.1**2 * surface.unevenness * UNEVEN_LENGTH)
    for height, length in (
        (surface.rms_height, surface.correlation_length),
        (uneven, UNEVEN_LENGTH),
    ):
        spectrum = spectrum + height**2 * length**2 * (1 + (bragg * length) ** 2) ** -1.5
    level = 8 * k**4 * cosine**4 * spectrum
    return level * np.abs(hh) ** 2, level * np.abs(vv) ** 2


@pytest.mark.slow("repeats a draw until its statistics stand")
@each
def test_simulated_scatterers_have_the_sigma0_of_small_perturbation(site, quiet):
    """Six worlds of 3,000 scatterers on the site's own terrain, from below F1 to F4.

    Texture of shape 8 over 0.6 m and speckle leave an error of some 2 %; the slight tilt adds at most 2 % more. The
    simulator carries a site's spectrum by three functions of frequency, fitted where the echo is strong. At 0.6 GHz,
    where gravel is 16 dB weaker than at 2.55 GHz, it is 0.5 dB off.
    """
    scene = Scene(
        site=site, length=30.0, track=STILL, clutter=BARE, holes={"on": False}, stones={"on": False},
        lenses={"on": False}, heterogeneity={"on": False}, surface={"density": 10.0},
    )  # fmt: skip
    tones = quiet.tones.axis()
    chosen = [np.abs(tones - f).argmin() for f in (0.6e9, 1.05e9, 1.8e9, 2.55e9)]
    ratios = []
    cross = []
    agreement = []
    for seed in range(6):
        simulator = Simulator(scene, quiet, seed, errors=False)
        pose = simulator.pose[0]
        view = simulator._view(array_state(quiet, pose), pose)
        echoes = simulator._layers[0].echoes(view)
        sine = view.sine(echoes.points)
        gentle = sine < 0.97
        for tone in chosen:
            amplitude = np.einsum("irc,rc->ic", echoes.coefficient, echoes.basis[:, :, tone])[
                gentle
            ]
            eps = scene.soil.media(tones[tone])[-1].item()
            declared = small_perturbation(tones[tone], sine[gentle], eps, scene.surface)
            # Every scatterer's amplitude over its own declared level: HV goes with HH.
            hh, vv, hv = (
                amplitude / np.sqrt(np.stack([declared[0], declared[1], declared[0]], axis=1))
            ).T
            per_area = simulator._layers[0]._field.per_tile
            ratios.append([np.mean(np.abs(one) ** 2) * per_area for one in (hh, vv)])
            cross.append(np.mean(np.abs(hv) ** 2) * per_area)
            agreement.append(np.abs(np.vdot(hh, vv)) / np.linalg.norm(hh) / np.linalg.norm(vv))
    level = 10 * np.log10(np.reshape(ratios, (6, 4, 2)).mean(axis=0))
    np.testing.assert_allclose(level[1:], 0, atol=0.35)
    np.testing.assert_allclose(level[0], 0, atol=0.75)
    assert 10 * np.log10(np.mean(cross)) == pytest.approx(scene.surface.cross_db, abs=0.35)
    assert np.mean(agreement) == pytest.approx(scene.surface.correlation, abs=0.03)


# --- what lies in the soil and stands beside it ---


@each
def test_stones_per_square_metre_and_their_sizes(site, quiet):
    scene = Scene(site=site)
    ground = LayeredGround(scene.soil, None, quiet.tones.axis())
    spectra = BuriedSpectra(ground, spectral_shapes(scene, ground), scene.stones.depth)
    field = SubsurfaceField(scene, spectra, 20.0, 10.0, seed=1)
    side = 30
    depths = np.concatenate(
        [field.stones(ix, iy).depth for ix in range(side) for iy in range(side)]
    )
    expected = scene.stones.density * side**2
    assert abs(depths.size - expected) < 4 * np.sqrt(expected)
    least, greatest = scene.stones.radius
    assert depths.min() >= least
    assert depths.max() <= scene.stones.depth
    assert greatest <= (0.0125 if site == "prepared-gravel" else 0.025)


@each
def test_holes_are_as_declared(site):
    """A lane of 20 km, whose targets all lie in holes: 150 empty ones, give or take four standard errors."""
    draws = [{"kind": "metal", "depth": 0.1, "count": 400}]
    scene = Scene(site=site, length=20_000.0, clutter=BARE, draws=draws)
    world = draw_world(scene, 3)
    over = [hole for hole in world.holes if hole.target is not None]
    empty = len(world.holes) - len(over)
    assert len(over) == 400
    expected = scene.holes.empty * scene.lane.area
    assert abs(empty - expected) < 4 * np.sqrt(expected)
    looseness = [hole.looseness for hole in world.holes]
    least, greatest = scene.holes.looseness
    assert least <= min(looseness) <= max(looseness) <= greatest <= 1
    assert np.mean(looseness) == pytest.approx((least + greatest) / 2, abs=0.1 * (greatest - least))
    assert np.std([hole.cap for hole in world.holes]) == pytest.approx(scene.holes.cap, rel=0.13)
    assert np.std([hole.moisture for hole in world.holes]) == pytest.approx(
        scene.holes.moisture, rel=0.13
    )


@each
def test_growth_and_roadside_are_as_declared(site):
    scene = Scene(site=site, length=4000.0, holes={"on": False})
    assert not scene.grass.grown
    assert scene.roots.density == 0
    world = draw_world(scene, 5)
    road = scene.length + 2 * MARGIN
    for kind, per_metre in (
        ("bush", scene.clutter.bushes),
        ("post", scene.clutter.posts),
        ("rock", 0.0),
    ):
        things = [thing for thing in world.objects if thing.kind == kind]
        expected = per_metre * road
        assert abs(len(things) - expected) <= 4 * np.sqrt(expected), kind
        near, far = scene.clutter.roadside
        assert all(near <= abs(thing.x) <= far for thing in things)
    ground = 2 * scene.clutter.roadside[1] * road
    expected = scene.clutter.patches * ground
    assert abs(len(world.patches) - expected) < 4 * np.sqrt(expected)
