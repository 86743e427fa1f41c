import numpy as np
import pandas as pd
import pytest

from flgpr.imaging import ScanImager
from flgpr.model import Grid, load_sensor
from flgpr.simulate import Scene, Simulator, simulate, sites
from flgpr.simulate.bodies.echoes import LayeredGround
from flgpr.simulate.bodies.rims import cylinder
from flgpr.simulate.bodies.targets import _cover_factor, target_echoes
from flgpr.simulate.ground.roughness import surface_backscatter
from flgpr.simulate.simulator import array_state, system_response
from simulate.conftest import BARE, STILL

DRY = {"model": "fixed", "permittivity": 3.4, "conductivity": 0.0}
WIDE = {"all": (0.45e9, 2.95e9)}
BANDS = {"low": (0.75e9, 1.35e9), "high": (2.25e9, 2.85e9)}


@pytest.fixture(scope="module")
def quiet(quiet):
    """Beams alike at all tones, as the radar equations below have them."""
    return quiet.model_copy(
        update={"antenna": quiet.antenna.model_copy(update={"beam": "constant"})}
    )


def scene(**parts):
    return Scene(**({"surface": BARE, "track": STILL, "length": 30.0} | parts))


def image_of(run, grid, subbands=None, window=None):
    return next(iter(ScanImager(run, grid, subbands or WIDE, window=window, tolerance=1e-4)))


def test_a_corner_reflector_images_at_its_place_and_analytic_level(quiet):
    run, _ = simulate(
        scene(objects=[{"kind": "fiducial", "x": 0.52, "y": 12.03, "height": 0.0}]), quiet, 1
    )
    grid = Grid.spanning((0.3, 0.8), (11.8, 12.3), 0.01)
    image = np.abs(image_of(run, grid).sel(polarization="HH").values[0])
    row, column = np.unravel_index(image.argmax(), grid.shape)
    assert abs(grid.x[column] - 0.52) <= 0.005 + 1e-9
    assert abs(grid.y[row] - 12.03) <= 0.005 + 1e-9
    tx, rx = quiet.pairs()
    point = np.array([0.52, 12.03, 0.0])
    up = np.array([0, 0, quiet.height])
    axis = np.array([0, np.cos(quiet.tilt), -np.sin(quiet.tilt)])
    frequency = quiet.tones.axis()
    inside = (frequency >= WIDE["all"][0]) & (frequency <= WIDE["all"][1])
    # Radar equation: sqrt(G_t·G_r)·λ/((4π)^1.5·R_t·R_r)·sqrt(σ), σ = (f/GHz)² m², summed over pairs
    # and tones.
    sigma = np.sqrt((frequency / 1e9) ** 2)
    total = 0.0
    for t, r in zip(tx + up, rx + up, strict=True):
        ray_t = point - t
        ray_r = point - r
        d_t = np.linalg.norm(ray_t)
        d_r = np.linalg.norm(ray_r)
        pattern = (ray_t @ axis / d_t) * (ray_r @ axis / d_r)
        total += pattern / (d_t * d_r) * np.sum((system_response(quiet, frequency) * sigma)[inside])
    assert 20 * np.log10(image.max() / total) == pytest.approx(0, abs=0.1)


@pytest.mark.parametrize("permittivity", [2.5, 3.4, 8.0])
def test_a_mine_s_two_rims_lie_32_cm_apart_in_any_soil(quiet, permittivity):
    """Of rays, and no bottom: what a body solved by full wave sends from between its rims does not matter here."""
    soil = {"model": "fixed", "permittivity": permittivity, "conductivity": 0.0}
    target = {"kind": "metal", "x": 0.0, "y": 12.0, "depth": 0.1, "profile": cylinder(0.16, 1.0)}
    run, _ = simulate(scene(soil=soil, targets=[target]), quiet, 1)
    grid = Grid.spanning((-0.02, 0.02), (11.3, 13.0), 0.01)
    cut = np.abs(image_of(run, grid, window="hann").sel(polarization="VV").values[0, :, 2])
    peaks = [i for i in range(1, cut.size - 1) if cut[i] > max(cut[i - 1], cut[i + 1])]
    near, far = sorted(sorted(peaks, key=lambda i: cut[i])[-2:])
    assert cut[near] > 0.25 * cut.max()
    assert (far - near) * 0.01 == pytest.approx(0.32, abs=0.04)


def test_bounces_under_the_surface_reach_the_far_rim_only(quiet):
    """Every way in and out by n and m bounces that fit on the top, summed one by one."""
    ground = LayeredGround(scene(soil=DRY).soil, None, np.array([0.8e9, 1.0e9, 1.2e9]))
    target = scene(targets=[{"kind": "metal", "x": 0.0, "y": 12.0, "depth": 0.05}]).targets[0]
    sine = 0.9
    cosine = np.sqrt(3.4 - sine**2) / np.sqrt(3.4)  # in the soil
    shift = 2 * 0.05 * (sine / np.sqrt(3.4)) / cosine
    q = ground.wavenumber * np.sqrt(3.4 - sine**2)
    r_h, r_v = (-r for r in ground.reflection(sine))  # from below
    for i, (up, metal) in enumerate(((r_h, -1.0), (r_v, 1.0))):
        total = 0.0
        for n in range(50):
            for m in range(50):
                part = np.prod(
                    [np.clip(2 * target.radius / shift - b + 1, 0, 1) if b else 1.0 for b in (n, m)]
                )
                total = total + part * (up * metal * np.exp(-2j * q * 0.05)) ** (n + m)
        np.testing.assert_allclose(_cover_factor(sine, target, ground)[i], total, rtol=1e-9)


def test_the_near_rim_does_not_hear_the_cover(quiet):
    """Of rays, which are left for bodies of a profile of one's own."""

    def ripple(side):
        profile = cylinder(0.16, 0.15)
        world = scene(
            soil=DRY,
            targets=[{"kind": "metal", "x": 0.0, "y": 12.0, "depth": 0.05, "profile": profile}],
        )
        ground = LayeredGround(world.soil, None, np.linspace(0.5e9, 1.5e9, 201))
        state = array_state(quiet, np.array([0, 0, quiet.height, 0, 0, 0]))
        echoes = list(target_echoes(world.targets[0], ground, state))
        level = np.abs(echoes[side].spectrum[0]) * np.sqrt(
            ground.frequency
        )  # a rim's amplitude falls as 1/sqrt(k)
        return level.max() / level.min()

    near = 0
    far = 1
    assert ripple(near) == pytest.approx(1, abs=1e-6)
    assert ripple(far) > 4


def test_a_mine_on_the_ground_is_a_corner_as_strong_as_its_formula(quiet):
    """-5 dBsm·|R|² at 1.05 GHz for HH, within what the rims of its top add."""
    band = {"F1": (0.95e9, 1.15e9)}
    grid = Grid.spanning((-0.3, 0.3), (11.5, 12.3), 0.02)

    def peak(**parts):
        run, _ = simulate(scene(soil=DRY, **parts), quiet, 1)
        return np.abs(image_of(run, grid, band).sel(polarization="HH").values).max()

    mine = peak(targets=[{"kind": "metal", "x": 0.0, "y": 12.0, "depth": -0.15}])
    corner = peak(
        objects=[{"kind": "fiducial", "x": 0.0, "y": 11.84, "height": 0.0, "rcs_db": 0.0}]
    )
    cosine = quiet.height / np.hypot(quiet.height, 11.84)
    inside = np.sqrt(3.4 - 1 + cosine**2)
    r_h = (cosine - inside) / (cosine + inside)
    level = 20 * np.log10(mine / corner) + 20 * np.log10(
        1.05
    )  # the corner reflector's 0 dBsm are at 1 GHz
    assert level == pytest.approx(-5.3 + 20 * np.log10(abs(r_h)), abs=4)


def test_a_level_mine_has_no_cross_polarization_and_a_tilted_one_some(quiet):
    """Before the middle of a symmetric array, whose oblique pairs see some, with opposite signs on its two sides."""
    receivers = np.asarray(quiet.rx)
    both = np.concatenate([receivers, receivers * [-1, 1, 1]])
    mirrored = quiet.model_copy(update={"rx": tuple(map(tuple, both.tolist()))})

    def ratio(tilt, azimuth, x=(-0.5, 0.5)):
        target = {
            "kind": "metal",
            "x": 0.0,
            "y": 12.0,
            "depth": 0.05,
            "tilt": tilt,
            "azimuth": azimuth,
        }
        run, _ = simulate(scene(targets=[target]), mirrored, 1)
        image = np.abs(image_of(run, Grid.spanning(x, (11.5, 12.9), 0.05)))
        level = dict(zip(run["polarization"].values, image.values.max(axis=(1, 2, 3)), strict=True))
        return 20 * np.log10(max(level["HV"], 1e-30) / level["HH"])

    middle = (-0.001, 0.001)
    assert ratio(0.0, 0.0, middle) < -60
    assert -40 < ratio(0.0, 0.0) < -25
    assert -35 < ratio(np.radians(4), np.pi / 2, middle) < -10


def test_depth_attenuates_and_shifts_and_plastic_is_weaker_than_metal(quiet):
    def peak(**target):
        soil = {"model": "mironov", "clay": 20, "moisture": 0.12}
        run, _ = simulate(scene(soil=soil, targets=[{"x": 0.0, "y": 12.0} | target]), quiet, 1)
        grid = Grid.spanning((-0.5, 0.5), (11.4, 13.2), 0.02)
        image = np.abs(
            image_of(run, grid, {"F1": (0.75e9, 1.35e9)}).sel(polarization="HH").values[0]
        )
        return image.max()

    metal = [peak(kind="metal", depth=d) for d in (0.05, 0.10, 0.15)]
    assert metal[0] > 1.1 * metal[1] > 1.2 * metal[2]
    assert peak(kind="plastic", depth=0.05) < 0.8 * metal[0]


def test_the_same_seed_gives_the_same_bits_in_any_order(quiet):
    draws = [{"kind": "metal", "depth": 0.05, "count": 3}]
    lane = Scene(site="arid-sand", length=20.0, draws=draws, surface={"density": 3.0})
    tones = quiet.tones.model_copy(update={"step": 40e6, "count": 64})
    sensor = load_sensor("sri-array").model_copy(update={"rx": quiet.rx, "tones": tones})
    one = Simulator(lane, sensor, 7)
    other = Simulator(lane, sensor, 7)
    pd.testing.assert_frame_equal(one.truth, other.truth)
    forwards = [one.scan(k) for k in (0, 3, 5)]
    backwards = [other.scan(k) for k in (5, 3, 0)][::-1]
    for a, b in zip(forwards, backwards, strict=True):
        np.testing.assert_array_equal(a, b)
    assert not np.array_equal(Simulator(lane, sensor, 8).scan(0), forwards[0], equal_nan=True)


@pytest.mark.slow("simulates a lane at each of the sites")
@pytest.mark.parametrize("site", sites())
def test_every_site_makes_a_lane_with_its_targets(site, quiet):
    draws = [{"kind": "plastic", "depth": 0.1, "count": 4}]
    lane = Scene(site=site, length=20.0, draws=draws, surface={"density": 3.0})
    run, truth = simulate(
        lane.model_copy(update={"track": lane.track.model_copy(update=STILL)}), quiet, 3
    )
    assert len(truth) == 4
    assert (truth["kind"] == "plastic").all()
    assert lane.lane.contains(truth["x"], truth["y"]).all()
    assert truth["depth"].mean() == pytest.approx(0.1, abs=0.02)
    assert run["valid"].values.all()


@pytest.fixture(scope="module")
def clutter(quiet):
    """Images (seed, polarization, sub-band, y, x) of bare rough ground without texture, HH and VV."""
    grid = Grid.spanning((-2.0, 2.0), (10.0, 14.0), 0.25)
    surface = {"texture_shape": None, "phase_screen": False}
    rough = Scene(soil=DRY, surface=surface, track=STILL, length=30.0)
    runs = (simulate(rough, quiet, seed)[0] for seed in range(8))
    return np.array(
        [image_of(run, grid, BANDS).sel(polarization=["HH", "VV"]).values for run in runs]
    )


def expected_power(quiet, subband, surface):
    """Mean |image|² at (0, 12) m: over all ground in view, σ⁰·dA times the squared image of one scatterer of 1 m².

    All of it, for what folds in from beyond the unambiguous path and through grating lobes is clutter too.
    """
    frequency = quiet.tones.axis()
    inside = (frequency >= subband[0]) & (frequency <= subband[1])
    tx, rx = (p + np.array([0, 0, quiet.height]) for p in quiet.pairs())
    axis = np.array([0, np.cos(quiet.tilt), -np.sin(quiet.tilt)])
    centre = np.array([0.0, 12.0, 0.0])
    fine = Grid.spanning((-6.95, 6.95), (5.55, 27.9), 0.2)
    points = fine.points().reshape(-1, 3)
    sine = np.hypot(points[:, 0], points[:, 1]) / np.linalg.norm(
        points - [0, 0, quiet.height], axis=1
    )
    response = system_response(quiet, frequency)[inside]
    level = response * np.sqrt(surface(frequency[inside], sine[:, None]))
    image = np.zeros((2, len(points)), complex)
    for t, r in zip(tx, rx, strict=True):
        ray_t = points - t
        ray_r = points - r
        d_t = np.linalg.norm(ray_t, axis=1)
        d_r = np.linalg.norm(ray_r, axis=1)
        gain = np.maximum(ray_t @ axis / d_t, 0) * np.maximum(ray_r @ axis / d_r, 0) / (d_t * d_r)
        focus = np.linalg.norm(centre - t) + np.linalg.norm(centre - r)
        turn = np.exp(2j * np.pi / 299792458.0 * (focus - d_t - d_r)[:, None] * frequency[inside])
        image += gain * np.einsum("pf,cpf->cp", turn, level)
    return np.sum(np.abs(image) ** 2, axis=1) * fine.dx * fine.dy


@pytest.mark.slow("repeats a draw until its statistics stand")
@pytest.mark.parametrize("number", range(len(BANDS)))
def test_clutter_images_have_the_level_of_sigma0_and_rayleigh_statistics(quiet, clutter, number):
    middle = clutter[:, :, number, 6:11, 6:11]
    band = list(BANDS.values())[number]
    want = expected_power(
        quiet, band, lambda f, s: surface_backscatter(f, s, 3.4, 0.005, 0.05, np.radians(5))
    )
    got = np.mean(np.abs(middle) ** 2, axis=(0, 2, 3))
    np.testing.assert_allclose(10 * np.log10(got / want), 0, atol=1.0)
    intensity = np.abs(clutter[:, 0, number]) ** 2
    intensity = intensity / intensity.mean(axis=0)
    assert np.var(intensity) == pytest.approx(
        1.0, abs=0.35
    )  # Rayleigh amplitude: exponential intensity


def test_clutter_decorrelates_with_frequency(clutter):
    a = clutter[:4, 0, 0].ravel()
    b = clutter[:4, 0, 1].ravel()
    assert np.abs(np.vdot(a, b)) / np.linalg.norm(a) / np.linalg.norm(b) < 0.25
