"""Eq. 5-8 of Fuse et al. 2018 and Table II, and the least-squares form beside them."""

import numpy as np
import pytest
from scipy.sparse.linalg import lsqr
from tests.reference.fuse2018 import equation_3_matrix, equation_5_data, equations_5_to_8

from clutter.masked_scene import (
    FREQUENCY,
    GRID,
    PIXELS,
    REGION,
    RNG,
    RX,
    TX,
    data,
    disc,
    noise,
    operator_on,
)
from flgpr.clutter import (
    TABLE_II,
    Iterated,
    averaged,
    fallen_back,
    iterate_suppression,
    suppress_by_model,
)
from flgpr.imaging import ImagingOperator
from flgpr.model import SPEED_OF_LIGHT, Grid


@pytest.mark.parametrize("amplitude", ["region", "whole"])
def test_equations_5_to_8_term_by_term(amplitude):
    points = Grid.spanning((-0.6, 0.6), (3, 4), 0.1).points()
    mask = RNG.random(points.shape[:-1]) < 0.3
    region = (points[..., 1] > 3.45).astype(int)
    b = noise(1, 16, 99)
    A = equation_3_matrix(FREQUENCY, TX, RX, points.reshape(-1, 3))
    want = equations_5_to_8(
        b.ravel().astype(complex), A, mask.ravel(), region.ravel(), 3, amplitude == "whole"
    )
    got = iterate_suppression(b, operator_on, points, mask, region, 3, amplitude)
    assert got.iterations == 3
    for one, other in zip(got.data, want, strict=True):
        assert np.linalg.norm(one.ravel() - other) < 1e-4 * np.linalg.norm(b)
    np.testing.assert_allclose(
        got.residual[:, 0], [np.linalg.norm(w) / np.linalg.norm(b) for w in want], rtol=1e-4
    )


def peak_db(image, x, y):
    return 20 * np.log10(np.abs(image[0, 0])[disc(x, y, 0.15)].max())


def test_a_scatterer_under_the_mask_goes_and_one_outside_stays():
    strong = data(-1.0, 5.0, 10.0)
    weak = data(0.8, 3.4)
    image = operator_on(PIXELS)
    course = iterate_suppression(strong + weak, operator_on, PIXELS, disc(-1.0, 5.0), REGION)
    before = image.adjoint(strong + weak)
    after = image.adjoint(averaged(course, 6))
    assert peak_db(after, -1.0, 5.0) - peak_db(before, -1.0, 5.0) < -30
    assert peak_db(after, 0.8, 3.4) == pytest.approx(
        peak_db(image.adjoint(weak), 0.8, 3.4), abs=0.1
    )


@pytest.mark.parametrize("tolerance", [1e-2, 1e-3, 1e-5])
def test_a_scatterer_on_one_masked_pixel_goes_to_the_tolerance_at_once(tolerance):
    """One pixel under the mask: B is exactly one over the number of samples."""
    mask = np.zeros(GRID.shape, bool)
    mask[20, 40] = True
    b = equation_5_data([1.0], FREQUENCY, TX, RX, PIXELS[20, 40][None])[None]

    def coarse(points):
        return ImagingOperator(FREQUENCY, TX, RX, points, tolerance=tolerance)

    course = iterate_suppression(b, coarse, PIXELS, mask, REGION, 2)
    assert course.residual[-1, 0] < 2 * tolerance
    assert course.amplitude[0, 0, 0] == pytest.approx(1 / b[0].size, rel=4 * tolerance)
    assert np.abs(operator_on(PIXELS).adjoint(course.data[-1])).max() < 2 * tolerance * b.size


def test_every_sub_region_and_polarization_has_its_own_amplitude():
    b = np.concatenate(
        [data(-1.0, 5.0, 10.0) + data(0.5, 3.0), data(-1.0, 5.0) + data(0.5, 3.0, 3.0)]
    )
    mask = disc(-1.0, 5.0, 0.2) | disc(0.5, 3.0, 0.5)
    course = iterate_suppression(b, operator_on, PIXELS, mask, REGION, 7)
    assert course.amplitude.shape == (7, 2, 2)
    assert (course.amplitude > 0).all()
    assert not np.allclose(course.amplitude[0, 0], course.amplitude[0, 1], rtol=0.1)
    assert (np.diff(course.residual, axis=0) < 0).all()
    assert course.summary().startswith("7 iterations, residual ")


class Worse:
    """An operator whose forward model is too large for B to make up for: its adjoint does not see it all."""

    def __init__(self, operator):
        self.operator = operator

    def adjoint(self, b):
        return self.operator.adjoint(b)

    def forward(self, x):
        response = self.operator.forward(x)
        return response + 30 * np.roll(response, 40, axis=-1) * np.exp(
            2j * np.pi * np.arange(99) / 7
        )


@pytest.mark.parametrize("coupling", [0.0, 1e4])
def test_what_diverges_is_told_and_its_best_iteration_stands_in(coupling):
    """Also where an echo from outside the image holds nearly all of the energy."""
    b = data(-1.0, 5.0) + 0.1 * noise(1, 16, 99)
    b = b + coupling * np.exp(-2j * np.pi * FREQUENCY * 21.0 / SPEED_OF_LIGHT)
    course = iterate_suppression(
        b, lambda points: Worse(operator_on(points)), PIXELS, disc(-1.0, 5.0), REGION
    )
    assert course.iterations == 7
    assert course.diverged
    (best,) = course.best(7)
    assert best == course.residual[:, 0].argmin() < 7
    assert f"the last is worse than iteration {best}" in course.summary()
    assert fallen_back(course, 6) == {0: best}
    assert np.array_equal(averaged(course, 6), course.data[best])
    paper = (course.data[6].astype(complex) + course.data[7]) / 2
    np.testing.assert_allclose(averaged(course, 6, fall_back=False), paper, rtol=1e-5, atol=1e-6)


def some_spots(seed, operator_on):
    """Data of five scatterers of unlike strength, for an array of its own."""
    rng = np.random.default_rng(seed)
    places = rng.uniform((-1.5, 3), (1.5, 5.5), (5, 2))
    strengths = rng.uniform(0.3, 3, 5)
    one = np.ones((1, 1, 1))
    return sum(
        s * operator_on([[x, y, 0.0]]).forward(one)
        for s, (x, y) in zip(strengths, places, strict=True)
    )


@pytest.mark.parametrize("seed", [0, 1])
def test_an_array_thinned_in_frequency_diverges_and_the_average_does_not(seed):
    """Tones 0.5 GHz apart are ambiguous: B of the strongest pixel is too much, and iterations overshoot by turns."""

    def thinned(points):
        return ImagingOperator(FREQUENCY[::20], TX, RX, points, tolerance=1e-5)

    b = some_spots(seed, thinned)
    course = iterate_suppression(b, thinned, PIXELS, np.ones(GRID.shape, bool), REGION)
    assert course.diverged
    assert course.residual[-1, 0] > 2
    assert fallen_back(course, 6) == {}
    assert np.linalg.norm(averaged(course, 6)) < 0.1 * np.linalg.norm(b)
    single = course.data[course.best(7)[0]]
    assert np.linalg.norm(averaged(course, 6)) < np.linalg.norm(single)


@pytest.fixture(scope="module")
def sparse():
    """An array and tones so sparse that the residual rises on the way, with A as a matrix, and sub-regions."""
    points = Grid.spanning((-1.5, 1.5), (3, 5.5), 0.1).points()
    tones = FREQUENCY[::4]
    pairs = slice(None, None, 2)

    def operator_on(on):
        return ImagingOperator(tones, TX[pairs], RX[pairs], on, tolerance=1e-6)

    A = equation_3_matrix(tones, TX[pairs], RX[pairs], points.reshape(-1, 3))
    return operator_on, points, (points[..., 1] > 4.25).astype(int), A


@pytest.mark.slow("iterates with the slow twin")
@pytest.mark.parametrize(("seed", "diverges"), [(0, False), (2, False), (1, True)])
def test_all_seven_iterations_are_those_of_the_equations_through_a_rise(sparse, seed, diverges):
    """The slow twin knows nothing of a residual: it iterates Eq. 5 to 8 seven times, whatever comes."""
    operator_on, points, region, A = sparse
    mask = np.ones(region.shape, bool)
    b = some_spots(seed, operator_on)
    want = equations_5_to_8(b.ravel().astype(complex), A, mask.ravel(), region.ravel(), 7)
    got = iterate_suppression(b, operator_on, points, mask, region)
    residual = np.array([np.linalg.norm(one) for one in want]) / np.linalg.norm(b)
    assert (np.diff(residual) > 0).any()
    for one, other in zip(got.data, want, strict=True):
        assert np.linalg.norm(one.ravel() - other) < 1e-3 * np.linalg.norm(b)
    np.testing.assert_allclose(got.residual[:, 0], residual, rtol=1e-3)
    assert got.rises == (np.diff(residual) > 0).sum()
    assert got.diverged == diverges == bool(residual[-1] > residual.min())
    mean = (want[6] + want[7]) / 2
    np.testing.assert_allclose(
        averaged(got, 6, fall_back=False).ravel(), mean, atol=1e-3 * np.abs(mean).max()
    )


def made_up(*residuals):
    """A course whose residual is given, for one polarization or several side by side."""
    residual = np.array(residuals, dtype=float).reshape(len(residuals), -1)
    data = [np.asarray(one, np.complex64)[:, None, None] for one in residual]
    energy = residual**2 - residual[0] ** 2
    return Iterated(
        tuple(data),
        residual,
        np.ones((len(data) - 1, 1, 1)),
        energy,
        np.full(energy[1:].shape, 1e-6),
    )


def test_a_rise_that_recovers_ends_nothing():
    recovers = made_up(1.0, 0.5, 0.4, 0.6, 0.3, 0.25, 0.22, 0.2)
    assert (recovers.rises, recovers.diverged, recovers.best(7).tolist()) == (1, False, [7])
    assert recovers.rise == pytest.approx(0.5)
    assert "1 of them raised it, by up to 50 %" in recovers.summary()
    assert averaged(recovers, 6).item() == pytest.approx(0.21)
    assert averaged(recovers, 2).item() == pytest.approx(
        0.4
    )  # #2 ends with the rise: the iteration before stands in
    assert averaged(recovers, 2, fall_back=False).item() == pytest.approx(0.5)


def test_every_polarization_falls_back_by_itself():
    both = made_up(
        (1, 1), (0.5, 0.9), (0.4, 1.2), (0.3, 1.5), (0.25, 2), (0.22, 3), (0.2, 4), (0.1, 5)
    )
    assert both.best(7).tolist() == [7, 1]
    assert averaged(both, 6)[:, 0, 0].tolist() == pytest.approx([0.15, 0.9])


@pytest.mark.parametrize("seed", [14, 17])
def test_the_iteration_recovers_from_a_transient_rise(seed):
    """Under a wide mask another pixel becomes the strongest: its B is once too much for the rest."""
    b = some_spots(seed, operator_on)
    course = iterate_suppression(b, operator_on, PIXELS, np.ones(GRID.shape, bool), REGION)
    assert course.rises >= 1
    assert not course.diverged
    assert course.residual[-1, 0] < 0.1
    paper = (course.data[6].astype(complex) + course.data[7]) / 2
    np.testing.assert_allclose(averaged(course, 6), paper, rtol=1e-4, atol=1e-6)


def test_a_wide_mask_over_noise_never_lets_the_residual_rise_unreported():
    for share in (0.05, 0.5, 1.0):
        mask = RNG.random(GRID.shape) < share
        course = iterate_suppression(noise(2, 16, 99), operator_on, PIXELS, mask, REGION)
        rose = (np.diff(course.residual, axis=0) > 1e-6).any(axis=1)
        assert course.iterations == 7
        assert course.rises >= rose.sum()
        assert course.diverged == bool(
            (course.residual[-1] > course.residual.min(axis=0) + 1e-6).any()
        )


def test_table_two_averages():
    course = iterate_suppression(data(-1.0, 5.0), operator_on, PIXELS, disc(-1, 5), REGION)
    assert list(TABLE_II) == list(range(7))
    np.testing.assert_allclose(averaged(course, 0), course.data[0])
    for k in range(1, 7):
        mean = (course.data[k].astype(complex) + course.data[k + 1]) / 2
        np.testing.assert_allclose(averaged(course, k), mean, rtol=1e-5, atol=1e-7)
    with pytest.raises(ValueError, match="one of"):
        averaged(course, 7)
    short = iterate_suppression(data(-1.0, 5.0), operator_on, PIXELS, disc(-1, 5), REGION, 2)
    with pytest.raises(ValueError, match="needs 7 iterations"):
        averaged(short, 6)


def test_an_empty_mask_and_zero_data_change_nothing():
    b = data(-1.0, 5.0)
    assert np.array_equal(
        iterate_suppression(b, operator_on, PIXELS, disc(50, 50), REGION).data[-1], b
    )
    assert not iterate_suppression(0 * b, operator_on, PIXELS, disc(-1, 5), REGION).data[-1].any()
    with pytest.raises(ValueError, match="iterations"):
        iterate_suppression(b, operator_on, PIXELS, disc(-1, 5), REGION, 0)
    with pytest.raises(ValueError, match="shape of the pixels"):
        iterate_suppression(b, operator_on, PIXELS, disc(-1, 5)[:-1], REGION)
    with pytest.raises(ValueError, match="within the sub-regions"):
        iterate_suppression(b, operator_on, PIXELS, disc(-1, 5), REGION - 2)


def test_least_squares_has_the_iterates_of_lsqr():
    points = Grid.spanning((-0.4, 0.4), (3, 3.5), 0.1).points().reshape(-1, 3)
    A = equation_3_matrix(FREQUENCY, TX, RX, points)
    b = noise(1, 16, 99)
    for count in (1, 3, 8):
        x = lsqr(A, b.ravel().astype(complex), atol=0, btol=0, iter_lim=count)[0]
        want = b.ravel() - A @ x
        got = suppress_by_model(b, operator_on(points), count).data
        assert np.linalg.norm(got.ravel() - want) < 1e-4 * np.linalg.norm(want)
