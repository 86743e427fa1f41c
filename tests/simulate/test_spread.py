import numpy as np
import pytest

from flgpr.simulate.radar.spread import Spreader
from flgpr.simulate.simulator import array_state
from simulate.scatterers import POSE, cloud, slow


@pytest.mark.parametrize("kind", ["horn", "dipole"])
def test_the_spreader_sums_scatterers_to_a_thousandth(quiet, dipoles, kind):
    sensor = quiet if kind == "horn" else dipoles
    frequency = sensor.tones.axis()
    points, coefficient = cloud(60)
    functions = np.stack([np.ones(frequency.size), np.linspace(0.5, 2, frequency.size)])
    spreader = Spreader(sensor.tones.start, sensor.tones.step, sensor.tones.count)
    got = spreader(
        points,
        coefficient.swapaxes(1, 2).astype(np.complex64),
        functions,
        array_state(sensor, POSE),
    )
    want = slow(sensor, points, np.einsum("irc,rf->icf", coefficient, functions), frequency)
    assert np.linalg.norm(got - want) < 1e-3 * np.linalg.norm(want)


def test_ranges_beyond_the_unambiguous_path_wrap(quiet):
    """A window of profile bins that is longer than c/df must not matter."""
    sensor = quiet.model_copy(
        update={"tones": quiet.tones.model_copy(update={"step": 40e6, "count": 64})}
    )
    frequency = sensor.tones.axis()
    points = np.array([[0.5, 25.0, 0.0]])
    spreader = Spreader(sensor.tones.start, sensor.tones.step, sensor.tones.count)
    one = np.ones((1, 3, 1), np.complex64)
    got = spreader(points, one, np.ones((1, frequency.size)), array_state(sensor, POSE))
    want = slow(sensor, points, np.ones((1, 3, frequency.size)), frequency)
    assert np.linalg.norm(got - want) < 1e-3 * np.linalg.norm(want)


@pytest.mark.parametrize("kind", ["horn", "dipole"])
def test_extra_path_delays_and_does_not_spread(quiet, dipoles, kind):
    sensor = quiet if kind == "horn" else dipoles
    frequency = sensor.tones.axis()
    points, coefficient = cloud(40, seed=5)
    extra = np.random.default_rng(6).uniform(0, 1.5, len(points))
    functions = np.exp(1j * np.linspace(0, 3, frequency.size)) * np.array([[1.0], [0.5]])
    spreader = Spreader(sensor.tones.start, sensor.tones.step, sensor.tones.count)
    values = coefficient.swapaxes(1, 2).astype(np.complex64)
    got = spreader(points, values, functions, array_state(sensor, POSE), extra)
    delay = np.exp(-4j * np.pi * frequency * extra[:, None] / 299792458.0)
    want = slow(
        sensor, points, np.einsum("irc,rf,if->icf", coefficient, functions, delay), frequency
    )
    assert np.linalg.norm(got - want) < 1e-3 * np.linalg.norm(want)
