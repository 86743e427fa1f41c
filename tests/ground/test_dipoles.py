"""Dipoles on a lattice against Mie's series, Born's approximation and continuity in a thin gap."""

import numpy as np
import pytest
from scipy.special import j1
from threadpoolctl import threadpool_limits

from flgpr.model import SPEED_OF_LIGHT
from flgpr.simulate.bodies.signature.body import Body
from flgpr_ground.signatures.dipoles import (
    Lattice,
    Waves,
    choose_cell,
    lattice_of,
    scattering_amplitudes,
    solve_box,
)
from reference.mie import sphere_amplitudes, unit_vectors
from simulate.lattices import own_axis_means

SINE = np.sin(np.radians(67))


@pytest.fixture(autouse=True, scope="module")
def one_thread():
    """Small matrix products lose by being shared out."""
    with threadpool_limits(1):
        yield


def sampled(inside, shape, cell, medium, soil, sub=4):
    """Lattice of a body given by a function of x, y and depth."""
    x, y, drop = ((np.arange(n * sub) + 0.5) * cell / sub for n in shape)
    fine = np.where(inside(x[:, None, None], y[:, None], drop), medium, soil).astype(complex)
    return Lattice(cell, own_axis_means(fine, sub))


def sphere(radius, count, medium, soil):
    cell = radius / count
    return sampled(
        lambda x, y, d: x**2 + y**2 + (d - radius) ** 2 < radius**2,
        (count, count, 2 * count),
        cell,
        medium,
        soil,
    )


def cylinder(layers, radius, cell, soil):
    """Upright round cylinder of (thickness, permittivity) layers, each a whole number of samples."""
    edges = np.cumsum([t for t, _ in layers])
    count = int(np.ceil(radius / cell - 1e-9)), int(np.ceil(edges[-1] / cell - 1e-9))
    media = np.array([eps for _, eps in layers] + [soil], complex)
    x = (np.arange(count[0] * 4) + 0.5) * cell / 4
    drop = (np.arange(count[1] * 4) + 0.5) * cell / 4
    column = media[np.searchsorted(edges, drop)]
    fine = np.where((x[:, None] ** 2 + x**2 < radius**2)[..., None], column, soil)
    return Lattice(cell, own_axis_means(fine, 4))


def box(*layers, elongation=1.0):
    return Body(
        name="box",
        shape="box",
        elongation=elongation,
        layers=[{"thickness": t, "zones": ((w, eps),)} for t, w, eps in layers],
    )


def rms_db(values):
    return 10 * np.log10(np.mean(np.abs(values) ** 2))


@pytest.mark.parametrize(
    ("medium", "soil", "wavenumber", "tolerance"),
    [
        (2.9, 3.5, 18.0, 0.05),
        (1.0, 3.5, 18.0, 0.07),
        (3.0, 9.0, 13.0, 0.06),
        (3.0, 9 - 1.2j, 13.0, 0.06),
    ],
)
def test_a_sphere_scatters_as_mie_says(medium, soil, wavenumber, tolerance):
    # k·a = 3.4 to 3.9
    radius = 0.1
    azimuth = np.array([0.0, 0.4, 1.3])
    kappa = wavenumber * SINE
    down = np.sqrt(wavenumber**2 * soil - kappa**2 + 0j)
    waves = Waves(np.full(3, kappa), azimuth)
    got = scattering_amplitudes(sphere(radius, 10, medium, soil), soil, wavenumber, waves)
    for sent, received in [(0, 0), (0, 1), (1, 2), (2, 0)]:
        centred = sphere_amplitudes(
            radius, medium, soil, wavenumber, kappa, azimuth[sent], azimuth[received]
        )
        expected = centred * np.exp(-2j * down * radius)  # from the centre to the level of the top
        np.testing.assert_allclose(
            got[:, received, :, sent], expected, atol=tolerance * np.abs(expected).max()
        )


def test_finer_cells_come_nearer_to_mie():
    wavenumber = 10.0
    soil = 3.5
    medium = 1.0
    radius = 0.1
    kappa = wavenumber * SINE
    centred = sphere_amplitudes(radius, medium, soil, wavenumber, kappa, 0.0, 0.0)
    expected = centred * np.exp(-2j * np.sqrt(wavenumber**2 * soil - kappa**2) * radius)
    waves = Waves(np.array([kappa]), np.zeros(1))
    error = [
        np.abs(
            scattering_amplitudes(sphere(radius, n, medium, soil), soil, wavenumber, waves)[
                :, 0, :, 0
            ]
            - expected
        )
        for n in (3, 10)
    ]
    assert error[1].max() < error[0].max() / 2
    assert error[1].max() < 0.03 * np.abs(expected).max()


@pytest.mark.parametrize("soil", [3.4, 3.4 - 0.3j])
@pytest.mark.parametrize(("nx", "ny", "nz"), [(20, 10, 9)])
def test_a_faint_box_scatters_as_born_says(soil, nx, ny, nz):
    cell = 0.005
    contrast = 0.01
    wavenumber = 27.0
    k = wavenumber * np.sqrt(complex(soil))
    kappa = wavenumber * SINE
    azimuth = np.array([0.1, 0.5])
    lattice = Lattice(cell, np.full((nx, ny, nz, 3), soil + contrast, complex))
    got = scattering_amplitudes(lattice, soil, wavenumber, Waves(np.full(2, kappa), azimuth))[
        :, 1, :, 0
    ]
    (a, of_sent), (b, of_received) = (unit_vectors(kappa, phi, k) for phi in azimuth)
    x, y, z = k * (a + b)
    half_x = nx * cell
    half_y = ny * cell
    height = nz * cell
    level = (
        4 * half_x * half_y * np.sinc(x.real * half_x / np.pi) * np.sinc(y.real * half_y / np.pi)
    )
    volume = level * (1 - np.exp(1j * z * height)) / (-1j * z)  # of e^{-jz·z} from -height to 0
    expected = wavenumber**2 / (4 * np.pi) * contrast * volume * (of_received @ of_sent.T)
    np.testing.assert_allclose(got, expected, atol=0.03 * np.abs(expected).max())


def test_a_faint_cylinder_has_equal_hh_and_vv_as_born_says():
    soil = 3.4
    contrast = 0.01
    wavenumber = 20.0
    radius = 0.1
    cell = 0.005
    nz = 12
    kappa = wavenumber * SINE
    z = -2 * np.sqrt(wavenumber**2 * soil - kappa**2)
    lattice = cylinder([(nz * cell, soil + contrast)], radius, cell, soil)
    got = scattering_amplitudes(lattice, soil, wavenumber, Waves(np.array([kappa]), np.zeros(1)))[
        :, 0, :, 0
    ]
    volume = 2 * np.pi * radius * j1(2 * kappa * radius) / (2 * kappa)
    volume = volume * (1 - np.exp(1j * z * nz * cell)) / (-1j * z)
    expected = wavenumber**2 / (4 * np.pi) * contrast * volume * np.eye(2)
    np.testing.assert_allclose(got, expected, atol=0.03 * np.abs(expected).max())


def test_a_thin_gap_raises_vv_by_the_normal_field():
    soil = 3.43
    wavenumber = 4.0
    refracted = SINE / np.sqrt(soil)
    body = box((0.003, 0.06, 1.0))
    lattice = lattice_of(body, soil, 0.0015)
    waves = Waves(np.array([wavenumber * SINE]), np.zeros(1))
    got = scattering_amplitudes(lattice, soil, wavenumber, waves)[:, 0, :, 0]
    expected = 1 - refracted**2 + soil * refracted**2
    assert abs(got[1, 1] / got[0, 0]) == pytest.approx(expected, rel=0.08)


@pytest.mark.slow("sums many dipoles")
def test_the_checked_figures_of_a_plastic_mine_in_arid_soil():
    # Radius 16 cm, height 15 cm, permittivity 3.0, with a gap of 1.5 cm on top or none, in F1 at 67
    # degrees.
    soil = 3.43
    levels = {}
    for name, layers in {"gap": [(0.015, 1.0), (0.135, 3.0)], "none": [(0.15, 3.0)]}.items():
        lattice = cylinder(layers, 0.16, 0.0075, soil)
        found = []
        for frequency in np.linspace(0.75e9, 1.35e9, 7):
            wavenumber = 2 * np.pi * frequency / SPEED_OF_LIGHT
            waves = Waves(np.array([wavenumber * SINE]), np.zeros(1))
            found.append(
                np.diag(scattering_amplitudes(lattice, soil, wavenumber, waves)[:, 0, :, 0])
            )
        levels[name] = np.array([rms_db(f) for f in np.array(found).T])
    # The figures of the physics note, HH and VV; without gap the analytic Born cylinder has -53.1
    # at these tones.
    np.testing.assert_allclose(levels["gap"], [-40.5, -36.9], atol=1.5)
    np.testing.assert_allclose(levels["none"], [-50.2, -50.5], atol=3)
    np.testing.assert_allclose(levels["none"], -53.1, atol=1)
    ratios = [np.diff(levels[name])[0] for name in ("gap", "none")]
    np.testing.assert_allclose(ratios, [3.6, -0.3], atol=0.6)


SQUARE = box((0.012, 0.06, 1.0), (0.03, 0.06, 3.0))
OBLONG = box((0.03, 0.0325, 3.0), elongation=140 / 65)
COARSE = {"cells_per_wavelength": 8.0}


@pytest.mark.parametrize("body", [SQUARE, OBLONG])
def test_changing_places_of_the_antennas_transposes_the_matrix(body):
    soil = 5 - 0.4j
    args = ([0.8, 0.95], [0.2])
    there = solve_box(body, 1.5e9, soil, *args, [0.7], **COARSE)
    back = solve_box(body, 1.5e9, soil, *args, [-0.7], **COARSE)
    assert np.abs(there[..., 1] - there[..., 2]).max() > 1e-3 * np.abs(there).max()
    np.testing.assert_allclose(there, back[..., [0, 2, 1, 3]], atol=1e-4 * np.abs(there).max())


def test_a_square_looks_the_same_after_a_quarter_turn_and_in_its_mirror():
    soil = 4 - 0.1j
    separation = [0.5]
    signs = np.array([1, -1, -1, 1])
    aspects = [0.2, 0.2 + np.pi / 2, -0.2]
    first, turned, mirrored = solve_box(SQUARE, 1.5e9, soil, [0.9], aspects, separation, **COARSE)[
        0
    ]
    far = solve_box(SQUARE, 1.5e9, soil, [0.9], [0.2], [-0.5], **COARSE)[0, 0]
    scale = np.abs(first).max()
    np.testing.assert_allclose(turned, first, atol=1e-2 * scale)
    np.testing.assert_allclose(mirrored, signs * far, atol=1e-2 * scale)
    long_side, end = solve_box(OBLONG, 1.5e9, soil, [0.9], [0.0, np.pi / 2], **COARSE)[0]
    assert np.abs(long_side - end).max() > 0.1 * np.abs(end).max()


def test_symmetric_geometry_has_no_cross_polarization():
    found = solve_box(SQUARE, 1.5e9, 4 - 0.1j, [0.9], [0.0, np.pi / 4], **COARSE)
    assert np.abs(found[..., 1:3]).max() < 5e-3 * np.abs(found).max()


def test_cells_that_are_cut_do_not_change_the_answer_much():
    body = SQUARE
    soil = 3.4
    wavenumber = 30.0
    waves = Waves(np.array([wavenumber * SINE]), np.zeros(1))
    fits, cut = (
        np.diag(
            scattering_amplitudes(lattice_of(body, soil, cell), soil, wavenumber, waves)[:, 0, :, 0]
        )
        for cell in (0.003, 0.0034)
    )
    np.testing.assert_allclose(cut, fits, atol=0.05 * np.abs(fits).max())


def test_a_lattice_holds_the_whole_of_every_medium():
    body = SQUARE
    soil = 4.0
    cell = 0.0047
    lattice = lattice_of(body, soil, cell)
    upright = (
        soil - 1 / (1 / lattice.permittivity[..., 2]).mean(axis=2)[0, 0],
        lattice.permittivity.shape[2] * cell,
    )
    expected = (soil - upright[1] / (0.012 + 0.03 / 3 + (upright[1] - 0.042) / soil), upright[1])
    np.testing.assert_allclose(upright, expected, rtol=1e-9)
    assert choose_cell(body, soil, 30.0, 9.0, 10**6) == pytest.approx(0.006)
    assert choose_cell(body, soil, 30.0, 9.0, 8) == pytest.approx(
        (4 * 0.06**2 * 0.042 / 8) ** (1 / 3)
    )


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"frequency": 0.0}, "frequency must be positive, got 0.0"),
        (
            {"permittivity": 3 + 0.1j},
            "permittivity must be of real part >= 1 and imaginary part <= 0",
        ),
        ({"sines": [1.0]}, "sines must be from 0 to below 1"),
        ({"cells_per_wavelength": 2.0}, "cells_per_wavelength must be at least 4"),
        (
            {"body": SQUARE.model_copy(update={"shape": "round"})},
            "body must be a box without metal",
        ),
    ],
)
def test_bad_input_is_told(change, message):
    arguments = {
        "body": SQUARE,
        "frequency": 1e9,
        "permittivity": 3.4,
        "sines": [0.9],
        "aspects": [0.0],
    }
    with pytest.raises(ValueError, match=message):
        solve_box(**(arguments | change))
