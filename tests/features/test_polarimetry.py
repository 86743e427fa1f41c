"""The test vectors of the decompositions in closed form, and slow twins on random scatterers."""

import numpy as np
import pytest

from flgpr.features import cameron, entropy_alpha
from flgpr.features.polarimetry import entropy_alpha_of
from reference import wang2007_polarimetry as reference

DEGREE = np.pi / 180


def turned(s, angle):
    c = np.cos(angle)
    d = np.sin(angle)
    r = np.array([[c, -d], [d, c]])
    return r @ np.asarray(s, complex) @ r.T


SPHERE = np.eye(2)
DIPOLE = np.diag([1.0, 0.0])
DIHEDRAL = np.diag([1.0, -1.0])
CYLINDER = np.diag([1.0, 0.5])
QUARTER = np.diag([1.0, 1j])
HELICES = [np.array([[1, sign * 1j], [sign * 1j, -1]]) / 2 for sign in (1, -1)]


def parts(s, shape=(7, 7)):
    return (np.full(shape, complex(s[i][j])) for i, j in ((0, 0), (0, 1), (1, 1)))


@pytest.mark.parametrize("phase", [1, 3e-4 * np.exp(2.1j)])
@pytest.mark.parametrize(
    ("scatterer", "alpha"),
    [
        (SPHERE, 0),
        (CYLINDER, 18.434949),
        *[(turned(DIPOLE, angle), 45) for angle in (0, 0.3, 1.2, np.pi / 2)],
        (QUARTER, 45),
        (np.diag([1, -0.5]), 71.565051),
        (DIHEDRAL, 90),
        (turned(DIHEDRAL, 0.4), 90),
        *[(helix, 90) for helix in HELICES],
    ],
)
def test_one_mechanism_has_no_entropy_and_its_alpha(scatterer, alpha, phase):
    h, a = entropy_alpha(*parts(phase * np.asarray(scatterer)))
    np.testing.assert_allclose(h, 0, atol=1e-6)
    np.testing.assert_allclose(a / DEGREE, alpha, atol=1e-6)


def mixture(scatterers):
    """All rotations side by side in one window."""
    hh, hv, vv = (
        np.array([[s[i][j] for s in scatterers]], complex) for i, j in ((0, 0), (0, 1), (1, 1))
    )
    return entropy_alpha(hh, hv, vv, window=(1, 2 * len(scatterers) - 1))


@pytest.mark.parametrize(
    ("scatterer", "entropy", "alpha"),
    [(DIPOLE, 0.9463946, 45), (DIHEDRAL, 0.6309298, 90), (SPHERE, 0, 0)],
)
def test_random_orientation(scatterer, entropy, alpha):
    h, a = mixture([turned(scatterer, np.pi * k / 64) for k in range(64)])
    np.testing.assert_allclose(h, entropy, atol=1e-6)
    np.testing.assert_allclose(a / DEGREE, alpha, atol=1e-6)


def test_equal_eigenvalues_are_full_entropy_at_sixty_degrees():
    h, a = entropy_alpha_of(0.3 * np.eye(3, dtype=complex))
    assert h == pytest.approx(1, abs=1e-12)
    assert a / DEGREE == pytest.approx(60, abs=1e-9)


def random_images(seed, shape):
    rng = np.random.default_rng(seed)
    return [rng.normal(size=shape) + 1j * rng.normal(size=shape) for _ in range(3)]


def test_entropy_alpha_is_equation_10_in_a_window_that_shrinks_at_the_border():
    hh, hv, vv = random_images(1, (6, 7))
    h, a = entropy_alpha(hh, hv, vv, window=(3, 5))
    for y, x in np.ndindex(hh.shape):
        inside = [(v, u) for v, u in np.ndindex(hh.shape) if abs(v - y) <= 1 and abs(u - x) <= 2]
        want = reference.equation_10_entropy_alpha(
            [[[hh[i], hv[i]], [hv[i], vv[i]]] for i in inside]
        )
        assert (h[y, x], a[y, x]) == pytest.approx(want, abs=1e-9)


def test_leading_axes_and_single_numbers():
    hh, hv, vv = random_images(2, (2, 3, 5, 6))
    h, a = entropy_alpha(hh, hv, vv)
    h1, a1 = entropy_alpha(hh[1, 2], hv[1, 2], vv[1, 2])
    np.testing.assert_allclose((h[1, 2], a[1, 2]), (h1, a1))
    assert entropy_alpha(1, 0, 0.5)[1].item() / DEGREE == pytest.approx(18.434949, abs=1e-6)


def test_a_common_factor_drops_out():
    images = random_images(3, (9, 9))
    factor = 250 * np.exp(1j)
    for f in (entropy_alpha, cameron):
        np.testing.assert_allclose(f(*(factor * one for one in images)), f(*images), atol=1e-12)


@pytest.mark.parametrize(
    ("scatterer", "tau", "psi", "period"),
    [
        (SPHERE, 0, 0, None),
        (DIHEDRAL, 0, 0, 90),
        (turned(DIHEDRAL, 25 * DEGREE), 0, 25, 90),
        (DIPOLE, 0, 0, 180),
        (turned(DIPOLE, 30 * DEGREE), 0, 30, 180),
        (turned(DIPOLE, 90 * DEGREE), 0, 90, 180),
        (turned(CYLINDER, -50 * DEGREE), 0, -50, 180),
        (turned(QUARTER, 10 * DEGREE), 0, 10, 90),
        (HELICES[0], 45, 0, None),
        (HELICES[1], 45, 0, None),
        ([[1, 0.2j], [0.2j, 0.8]], np.arctan(85**-0.5) / DEGREE, 45, 90),
    ],
)
def test_cameron_vectors(scatterer, tau, psi, period):
    s = np.asarray(scatterer, complex) * 1e-3 * np.exp(0.7j)
    got_tau, got_psi = (value.item() / DEGREE for value in cameron(s[0, 0], s[0, 1], s[1, 1]))
    assert got_tau == pytest.approx(tau, abs=1e-6)
    assert -90 < got_psi <= 90
    if period is not None:
        assert (got_psi - psi + period / 2) % period - period / 2 == pytest.approx(0, abs=1e-6)


def test_cameron_is_equations_13_to_15_by_search():
    rng = np.random.default_rng(5)
    for _ in range(10):
        hh, hv, vv = rng.normal(size=3) + 1j * rng.normal(size=3)
        s = np.array([[hh, hv], [hv, vv]])
        tau, psi = cameron(hh, hv, vv)
        assert tau.item() == pytest.approx(reference.equation_15_tau(s), abs=2e-6)
        gap = psi.item() - reference.psi_by_eigenvectors(s)
        assert (gap + np.pi / 2) % np.pi - np.pi / 2 == pytest.approx(0, abs=2e-4)


def test_eigenvalues_agree_with_a_general_solver():
    rng = np.random.default_rng(6)
    k = rng.normal(size=(50, 3, 4)) + 1j * rng.normal(size=(50, 3, 4))
    matrix = k @ k.conj().transpose(0, 2, 1)
    h, a = entropy_alpha_of(matrix)
    values, vectors = np.linalg.eigh(matrix)
    p = values / values.sum(axis=1, keepdims=True)
    np.testing.assert_allclose(h, -(p * np.log(p)).sum(axis=1) / np.log(3), atol=1e-12)
    np.testing.assert_allclose(a, (p * np.arccos(np.abs(vectors[:, 0]))).sum(axis=1), atol=1e-10)


def test_no_signal_has_no_value_and_bad_input_is_named():
    zero = np.zeros((3, 3))
    assert np.isnan(entropy_alpha(zero, zero, zero)).all()
    assert np.isnan(cameron(zero, zero, zero)).all()
    with pytest.raises(ValueError, match="same shape"):
        cameron(zero, zero, zero[:2])
    with pytest.raises(ValueError, match="odd"):
        entropy_alpha(zero, zero, zero, window=(4, 5))
    with pytest.raises(ValueError, match="finite"):
        entropy_alpha(zero + np.nan, zero, zero)


def test_entropy_and_alpha_of_canonical_scatterers_and_their_mixtures():
    trihedral = [1, 0, 0]
    dihedral = [0, 1, 0]
    dipole = [1 / np.sqrt(2), 1 / np.sqrt(2), 0]
    pure = [np.outer(v, v).astype(complex) for v in (trihedral, dihedral, dipole)]
    mixed = np.diag([1.0, 1.0, 0.0]).astype(complex)
    matrices = np.array([*pure, np.eye(3), mixed, np.zeros((3, 3))], dtype=complex)
    entropy, alpha = entropy_alpha_of(matrices)
    np.testing.assert_allclose(entropy[:5], [0, 0, 0, 1, np.log(2) / np.log(3)], atol=1e-6)
    np.testing.assert_allclose(np.degrees(alpha[:5]), [0, 90, 45, 60, 45], atol=1e-4)
    assert np.isnan(entropy[5])
    assert np.isnan(alpha[5])
