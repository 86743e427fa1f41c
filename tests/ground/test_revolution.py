"""Round bodies mode by mode against Mie's series, Born's approximation, reciprocity, and the surface in the grid."""

import numpy as np
import pytest
from scipy.special import j1
from threadpoolctl import threadpool_limits

from flgpr.model import SPEED_OF_LIGHT
from flgpr.simulate.bodies.signature.body import Body
from flgpr_ground.signatures import revolution
from flgpr_ground.signatures.revolution import (
    ModalSolver,
    make_grid,
    solve_round,
    spectral_path,
    with_surface,
)
from reference.mie import sphere_amplitudes

SINE = np.sin(np.radians(67))
DEEP = np.array([np.inf])


@pytest.fixture(autouse=True, scope="module")
def one_thread():
    """Small matrix products lose by being shared out."""
    with threadpool_limits(1):
        yield


def body(*layers):
    """Body of (thickness, *zones) layers."""
    return Body(name="body", layers=[{"thickness": t, "zones": zones} for t, *zones in layers])


def solved(it, wavenumber, soil, separations=(0.0,), cells=8.0):
    """Answer deep in the soil at one sine: (separation, 4)."""
    frequency = wavenumber * SPEED_OF_LIGHT / (2 * np.pi)
    return solve_round(it, frequency, soil, np.array([SINE]), np.array(separations), DEEP, cells)[
        0, 0
    ]


def sphere(radius, count, medium):
    """Sphere as a stack of discs, each of its slice's volume."""
    edge = np.linspace(-radius, radius, count + 1)
    square = radius**2 - (edge[:-1] ** 2 + edge[:-1] * edge[1:] + edge[1:] ** 2) / 3
    return body(*((2 * radius / count, (float(np.sqrt(s)), medium)) for s in square))


def mie(radius, medium, soil, wavenumber, separations):
    """HH, VV and half sum and difference of HV and VH of a sphere about the middle of its top (separation, 4)."""
    kappa = wavenumber * SINE
    rise = np.exp(-2j * np.sqrt(wavenumber**2 * soil - kappa**2 + 0j) * radius)
    (hh, vh), (hv, vv) = np.moveaxis(
        [sphere_amplitudes(radius, medium, soil, wavenumber, kappa, 0.0, s) for s in separations],
        0,
        -1,
    )
    return np.stack([hh, vv, (hv + vh) / 2, (hv - vh) / 2], axis=-1) * rise


def error(got, want):
    return np.abs(got - want).max() / np.abs(want).max()


@pytest.mark.parametrize(
    ("medium", "soil", "wavenumber", "tolerance"),
    [(2.9, 3.5, 14.0, 0.05), (1.0, 3.5, 10.0, 0.03), (3.0, 9 - 1.2j, 10.0, 0.05)],
)
def test_a_dielectric_sphere_scatters_as_mie_says(medium, soil, wavenumber, tolerance):
    """Sixteen discs; in all channels, their signs and phases included, at three azimuths of the receiver."""
    separations = (0.0, 0.4, 1.3)
    want = mie(0.1, medium, soil, wavenumber, separations)
    assert np.abs(want[1:, 3]).min() > 0.1 * np.abs(want).max()
    assert error(solved(sphere(0.1, 16, medium), wavenumber, soil, separations), want) < tolerance


@pytest.mark.slow("solves fields on fine grids")
@pytest.mark.parametrize(("soil", "wavenumber"), [(3.5, 14.0), (3.5 - 0.2j, 10.0)])
def test_a_metal_sphere_scatters_as_mie_says_in_the_limit_of_thin_discs(soil, wavenumber):
    """The staircase's error goes with the discs' thickness: it halves, and without its first order little is left."""
    separations = (0.0, 0.4, 1.3)
    want = mie(
        0.1, 1 - 1e5j, soil, wavenumber, separations
    )  # surface impedance 0.6 % of the soil's
    coarse, fine = (
        solved(sphere(0.1, n, "metal"), wavenumber, soil, separations, 16.0) for n in (12, 24)
    )
    assert error(fine, want) < 0.6 * error(coarse, want)
    assert error(2 * fine - coarse, want) < 0.08


@pytest.mark.slow("solves fields on fine grids")
@pytest.mark.parametrize("soil", [3.4, 3.4 - 0.03j])
@pytest.mark.parametrize("wavenumber", [9.0, 12.0])
def test_a_faint_cylinder_has_equal_hh_and_vv_as_born_says(soil, wavenumber):
    radius = 0.12
    height = 0.06
    contrast = 0.001
    x = 2 * wavenumber * radius * SINE
    down = np.sqrt(wavenumber**2 * soil - (wavenumber * SINE) ** 2 + 0j)
    disc = np.pi * radius**2 * 2 * j1(x) / x
    want = wavenumber**2 / (4 * np.pi) * disc * (1 - np.exp(-2j * down * height)) / (2j * down)
    plain, faint = (
        solved(body((height, (radius, 3.4 + d))), wavenumber, soil, cells=32.0)[0, :2]
        for d in (0.0, contrast)
    )
    np.testing.assert_allclose((faint - plain) / contrast, want, atol=0.03 * abs(want))


def test_a_solid_of_small_contrast_has_equal_hh_and_vv():
    hh, vv = np.abs(solved(body((0.06, (0.12, 3.2))), 12.0, 3.4)[0, :2])
    assert 20 * np.log10(vv / hh) == pytest.approx(0, abs=0.3)


@pytest.mark.parametrize(("soil", "inner"), [(3.43, 1.0), (5.0, 2.0)])
def test_a_thin_gap_raises_vv_by_the_normal_field(soil, inner):
    hh, vv = np.abs(solved(body((0.002, (0.16, inner))), 6.0, soil, cells=12.0)[0, :2])
    refracted = SINE**2 / soil
    assert 20 * np.log10(vv / hh) == pytest.approx(
        20 * np.log10(1 - refracted + soil / inner * refracted), abs=0.7
    )


FUZE = body((0.02, (0.06, 1.0)), (0.04, (0.03, "metal"), (0.07, 2.9)))


@pytest.mark.parametrize("mode", [0, 1, 2])
def test_transmitter_and_receiver_may_change_places(mode, monkeypatch):
    """T is symmetric in HH and in VV and antisymmetric between H and V, evanescent waves included."""
    monkeypatch.setattr(revolution, "_RANK", 0.0)
    soil = 4 - 0.2j
    wavenumber = 15.0
    waves = spectral_path(wavenumber * np.sqrt(soil), FUZE.radius).transverse[::6]
    waves = np.concatenate([waves, wavenumber * np.array([0.8, 0.95])])
    answer = ModalSolver(make_grid(FUZE, soil, wavenumber, 6.0), soil, wavenumber, mode).answer(
        waves
    )
    signs = np.repeat([1, -1], waves.size)
    np.testing.assert_allclose(
        answer, signs[:, None] * answer.T * signs, atol=1e-10 * np.abs(answer).max()
    )
    cross = np.abs(answer[waves.size :, : waves.size]).max() / np.abs(answer).max()
    assert cross < 1e-10 if mode == 0 else cross > 0.01


@pytest.mark.slow("solves fields on fine grids")
@pytest.mark.parametrize(
    ("it", "limit"),
    [(body((0.12, (0.16, "metal"))), 0.23), (body((0.015, (0.16, 1.0)), (0.1, (0.16, 2.9))), 0.06)],
)
def test_twice_the_cells_halve_the_error(it, limit):
    sines = np.array([0.8, 0.92])
    apart = np.array([0.0, 0.4])
    coarse, fine, finest = (
        solve_round(it, 0.8e9, 3.5 - 0.05j, sines, apart, DEEP, c) for c in (8.0, 16.0, 32.0)
    )
    assert error(coarse, finest) < limit
    assert error(fine, finest) < error(coarse, finest) / 2


@pytest.mark.slow("solves fields on fine grids")
@pytest.mark.parametrize("depth", [0.015, 0.045])
@pytest.mark.parametrize("frequency", [0.6e9, 1.0e9])
@pytest.mark.parametrize(
    ("it", "least"),
    [
        (body((0.12, (0.16, "metal"))), 0.2),
        (body((0.015, (0.16, 1.0)), (0.135, (0.16, 2.9))), 0.04),
    ],
)
def test_the_surface_s_multiples_are_those_of_a_surface_in_the_grid(it, least, frequency, depth):
    soil = 3.5 * (1 - 0.01j)
    wavenumber = 2 * np.pi * frequency / SPEED_OF_LIGHT
    path = spectral_path(wavenumber * np.sqrt(soil), it.radius)
    sines = wavenumber * np.array([0.85, 0.92, 0.97])
    grids = make_grid(it, soil, wavenumber, 8.0), make_grid(it, soil, wavenumber, 8.0, cover=depth)
    added = []
    whole = []
    alone = []
    for mode in range(3):
        below, with_air = (ModalSolver(grid, soil, wavenumber, mode) for grid in grids)
        answer = below.answer(np.concatenate([path.transverse, sines]))
        added.append(with_surface(answer, path, mode, soil, wavenumber, depth))
        alone.append(below.answer(sines + 0j))
        whole.append(with_air.answer(sines + 0j))
    assert error(np.array(added), np.array(whole)) < 0.06
    assert error(np.array(alone), np.array(whole)) > least  # without them it is another answer
