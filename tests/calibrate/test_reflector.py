import numpy as np
import pytest

from calibrate.echoes import C
from flgpr.calibrate import apply_pairs, estimate_pairs
from flgpr.model import make_run

FREQUENCY = np.linspace(0.8e9, 2.4e9, 81)
POINT = np.array([0.4, 9.0, 0.3])
TX = np.array([[-1.0, 0, 0], [-1.0, 0, 0], [1.0, 0, 0], [1.0, 0, 0]])
RX = np.array([[-0.4, 0, 0], [0.4, 0, 0.1], [-0.4, 0, 0], [0.4, 0, 0.1]])
DELAY = np.array([[0.0, 0.31e-9, -0.22e-9, 0.4e-9], [0.1e-9, 0.0, 0.05e-9, -0.3e-9]])
GAIN = np.array([[1.0, 0.7j, -1.3, 0.9 + 0.3j], [0.5, 1.1, 1.2j, 0.8]])


def measured(slope, noise=0.0, seed=1):
    rng = np.random.default_rng(seed)
    pose = np.zeros((6, 6))
    pose[:, 1] = np.linspace(0, 2.5, 6)
    pose[:, 2] = 1.8
    pose[:, 3] = np.linspace(-0.05, 0.05, 6)
    signal = np.zeros((6, 2, 4, FREQUENCY.size), complex)
    for scan, p in enumerate(pose):
        c = np.cos(p[3])
        s = np.sin(p[3])
        turn = np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]])
        legs = [np.linalg.norm(a @ turn.T + p[:3] - POINT, axis=1) for a in (TX, RX)]
        late = (legs[0] + legs[1]) / C + DELAY
        echo = np.exp(-2j * np.pi * FREQUENCY * late[..., None]) / (legs[0] * legs[1])[:, None]
        signal[scan] = echo * GAIN[..., None] * (FREQUENCY / FREQUENCY.mean()) ** slope
    signal += noise * (rng.normal(size=signal.shape) + 1j * rng.normal(size=signal.shape))
    return make_run(signal, FREQUENCY, ["HH", "VV"], TX, RX, pose)


@pytest.mark.parametrize(("kind", "slope"), [("sphere", 0.0), ("corner", 1.0)])
def test_delays_and_gains_are_found(kind, slope):
    fit = estimate_pairs(measured(slope), POINT, kind)
    np.testing.assert_allclose(fit.delay, DELAY, atol=2e-13)
    np.testing.assert_allclose(fit.gain, GAIN, rtol=3e-3)


def test_noise_only_makes_them_rough():
    fit = estimate_pairs(measured(0.0, noise=0.01), POINT)
    # 81 tones x 6 scans, amplitude 1/R² = 0.012: the delay's standard deviation is 1/(2π·B_rms·snr)
    # = 17 ps.
    np.testing.assert_allclose(fit.delay, DELAY, atol=5 * 17e-12)


def test_a_corrected_run_has_equal_pairs():
    run = measured(0.0)
    clean = apply_pairs(run, estimate_pairs(run, POINT))
    again = estimate_pairs(clean, POINT)
    np.testing.assert_allclose(again.delay, 0, atol=1e-13)
    np.testing.assert_allclose(again.gain, np.sqrt(np.mean(np.abs(GAIN) ** 2)), rtol=2e-3)


def test_no_echo_shows_in_the_contrast():
    rng = np.random.default_rng(0)
    run = measured(0.0)
    noise = run.assign(
        signal=run["signal"] * 0 + rng.normal(size=run["signal"].shape).astype(np.complex64)
    )
    assert estimate_pairs(run, POINT).contrast.min() > 4
    assert estimate_pairs(noise, POINT).contrast.max() < 3.5


def test_bad_input_is_named():
    run = measured(0.0)
    with pytest.raises(ValueError, match="kind"):
        estimate_pairs(run, POINT, "plate")
    with pytest.raises(ValueError, match="point"):
        estimate_pairs(run, POINT[:2])
    with pytest.raises(ValueError, match="search"):
        estimate_pairs(run, POINT, search=0)
    cross = run.assign_coords(polarization=["HV", "VH"])
    with pytest.raises(ValueError, match="HH or VV"):
        estimate_pairs(cross, POINT)
    fit = estimate_pairs(run, POINT)
    with pytest.raises(ValueError, match="4 pairs"):
        apply_pairs(run.isel(pair=[0, 1]), fit)
    silent = estimate_pairs(run.assign(signal=run["signal"] * (np.arange(4) != 2)[:, None]), POINT)
    with pytest.raises(ValueError, match="pair 2: a dead channel"):
        apply_pairs(run, silent)
