import numpy as np
import pytest

from flgpr.calibrate import (
    DIHEDRAL,
    DIHEDRAL_45,
    TRIHEDRAL,
    estimate_distortion,
    remove_distortion,
    scattering_matrices,
)
from flgpr.model import make_run

KNOWN = np.array([TRIHEDRAL, DIHEDRAL, DIHEDRAL_45])


@pytest.fixture
def truth():
    """Crosstalk of -20 to -26 dB and imbalances of up to 3 dB and 40°, another for each of five tones."""
    rng = np.random.default_rng(8)
    sides = []
    for _ in range(2):
        side = np.zeros((5, 2, 2), complex)
        cross = 0.05 * rng.uniform(1, 2, (5, 2)) * np.exp(2j * np.pi * rng.random((5, 2)))
        side[:, 0, 0] = 1
        side[:, 0, 1] = cross[:, 0]
        side[:, 1, 0] = cross[:, 1]
        side[:, 1, 1] = rng.uniform(0.7, 1.4, 5) * np.exp(1j * rng.uniform(-0.7, 0.7, 5))
        sides.append(side)
    strength = rng.uniform(0.5, 2, (5, 3)) * np.exp(2j * np.pi * rng.random((5, 3)))
    measured = strength[..., None, None] * (sides[0][:, None] @ KNOWN @ sides[1][:, None])
    return *sides, measured


def test_distortion_is_found_from_three_reflectors(truth):
    rx, tx, measured = truth
    fit = estimate_distortion(measured, KNOWN)
    np.testing.assert_allclose(fit.rx, rx, atol=1e-7)
    np.testing.assert_allclose(fit.tx, tx, atol=1e-7)
    assert fit.misfit.max() < 1e-8


def test_the_misfit_is_the_noise(truth):
    _, _, measured = truth
    rng = np.random.default_rng(1)
    noise = 0.01 * (
        rng.normal(size=(400, *measured.shape[1:]))
        + 1j * rng.normal(size=(400, *measured.shape[1:]))
    )
    fit = estimate_distortion(measured[:1] + noise, KNOWN)
    # 12 complex numbers, 6 of R and T and 3 strengths fitted: a quarter of the noise's power is
    # left.
    expected = 0.01 * np.sqrt(2 * 12 * 0.25 / (np.abs(measured[0]) ** 2).sum())
    assert np.sqrt(np.mean(fit.misfit**2)) == pytest.approx(expected, rel=0.1)


def test_rows_receive_and_columns_transmit_and_hv_transmits_h():
    signal = np.arange(4).reshape(1, 4, 1, 1) + 0j
    run = make_run(
        signal, [1e9], ["HH", "HV", "VH", "VV"], [[0, 0, 0]], [[0, 0, 0]], np.zeros((1, 6))
    )
    # transmit H (column 0), receive V (row 1)
    assert scattering_matrices(run)[0, 0, 0].real.tolist() == [[0, 2], [1, 3]]


def test_a_distorted_run_becomes_clean(truth):
    rx, tx, measured = truth
    rng = np.random.default_rng(3)
    s = rng.normal(size=(2, 3, 5, 2, 2)) + 1j * rng.normal(size=(2, 3, 5, 2, 2))
    m = rx @ s @ tx
    order = {"VV": (1, 1), "HV": (1, 0), "HH": (0, 0), "VH": (0, 1)}
    data = np.stack([m[(..., *place)] for place in order.values()], axis=1)
    frequency = 1e9 + 1e7 * np.arange(5)
    run = make_run(
        data, frequency, list(order), np.zeros((3, 3)), np.zeros((3, 3)), np.zeros((2, 6))
    )
    clean = remove_distortion(run, estimate_distortion(measured, KNOWN))
    np.testing.assert_allclose(scattering_matrices(clean), s, atol=1e-5)


def test_too_few_reflectors_and_missing_polarizations_are_refused(truth, small_run):
    _, _, measured = truth
    with pytest.raises(ValueError, match="three linearly independent"):
        estimate_distortion(measured[:, :2], KNOWN[:2])
    with pytest.raises(ValueError, match="HV, VH missing"):
        scattering_matrices(small_run)
    with pytest.raises(ValueError, match="finite"):
        estimate_distortion(measured * np.nan, KNOWN)
    with pytest.raises(ValueError, match="shape"):
        estimate_distortion(measured[..., :1], KNOWN)
