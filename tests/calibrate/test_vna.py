import numpy as np
import pytest

from flgpr.calibrate import divide_by_through, remove_delay, subtract_standard
from flgpr.model import make_run

FREQUENCY = np.linspace(0.5e9, 3e9, 51)
C = 299_792_458.0


def sweeps(per_pair, scans=1):
    data = np.broadcast_to(np.asarray(per_pair)[None, None], (scans, 1, 2, 51))
    return make_run(
        data, FREQUENCY, ["VV"], np.zeros((2, 3)), np.zeros((2, 3)), np.zeros((scans, 6))
    )


@pytest.fixture
def parts():
    """Cables of 2.1 and 3.4 ns with loss, a switch's leakage, a joint of 9 cm, and a scene."""
    phase = -2j * np.pi * FREQUENCY
    cable = np.stack([0.8 * np.exp(phase * 2.1e-9), 0.6j * np.exp(phase * 3.4e-9)])
    leak = 0.05 * np.exp(phase * np.array([[1e-9], [1.5e-9]]))
    scene = np.stack([np.exp(phase * 20 / C), 0.4 * np.exp(phase * 23 / C)])
    return cable, leak, scene


def test_short_then_through_leave_the_scene(parts):
    cable, leak, scene = parts
    joint = np.exp(-2j * np.pi * FREQUENCY * 0.09 / C)
    run = sweeps(cable * scene + leak, 3)
    short = sweeps(leak, 2)
    through = subtract_standard(sweeps(cable * joint + leak), short)
    clean = divide_by_through(subtract_standard(run, short), through, 0.09)
    np.testing.assert_allclose(clean["signal"].values[2, 0], scene, atol=1e-5)


def test_cable_delay(parts):
    cable, _, scene = parts
    clean = remove_delay(sweeps(cable * scene), [2.1e-9, 3.4e-9])
    np.testing.assert_allclose(
        clean["signal"].values[0, 0], [0.8 * scene[0], 0.6j * scene[1]], atol=1e-5
    )


def test_standards_must_fit(parts):
    cable, leak, _ = parts
    run = sweeps(cable)
    with pytest.raises(ValueError, match="same frequency"):
        subtract_standard(run, sweeps(leak).assign_coords(frequency=FREQUENCY + 1))
    with pytest.raises(ValueError, match="2 pairs"):
        subtract_standard(run, sweeps(leak).isel(pair=[0]))
    with pytest.raises(ValueError, match="must not be zero"):
        divide_by_through(run, sweeps(0 * leak))
    with pytest.raises(ValueError, match="every sweep"):
        subtract_standard(run, sweeps(np.where([[True], [False]], leak, np.nan)))
    with pytest.raises(ValueError, match="delay"):
        remove_delay(run, [1e-9, 2e-9, 3e-9])
