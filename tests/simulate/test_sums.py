import numpy as np
import pytest

from flgpr.simulate.bodies.echoes import Echoes, sum_echoes
from flgpr.simulate.radar.spread import Spreader
from flgpr.simulate.simulator import array_state
from reference import slow_simulation

POSE = np.array(
    [0.3, 1.0, 5.0, 0.0, 0.0, 0.0]
)  # level: the slow twin's dipoles stand along x and z


def cloud(count, seed=0):
    rng = np.random.default_rng(seed)
    points = np.column_stack(
        [rng.uniform(-6, 6, count), rng.uniform(7, 26, count), rng.uniform(0, 0.5, count)]
    )
    return points, rng.normal(size=(count, 2, 3)) + 1j * rng.normal(size=(count, 2, 3))


def slow(sensor, points, spectrum, frequency):
    state = array_state(sensor, POSE)
    tx = state.position[state.tx]
    rx = state.position[state.rx]
    if sensor.antenna.kind == "dipole":
        return slow_simulation.sum_dipoles(points, spectrum, frequency, tx, rx)
    return slow_simulation.sum_points(
        points, spectrum, frequency, tx, rx, state.boresight, sensor.antenna.exponent
    )


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


@pytest.mark.parametrize("cross", [3, 4])
@pytest.mark.parametrize("kind", ["horn", "dipole"])
def test_single_echoes_are_summed_exactly(quiet, dipoles, kind, cross):
    """HH, HV, VH and VV of echoes whose HV and VH are the same (three channels) or not (four)."""
    constant = quiet.model_copy(
        update={"antenna": quiet.antenna.model_copy(update={"beam": "constant"})}
    )
    sensor = constant if kind == "horn" else dipoles
    frequency = sensor.tones.axis()
    state = array_state(sensor, POSE)
    points, coefficient = cloud(8, seed=3)
    echoes = Echoes()
    spectra = coefficient.reshape(8, 6)[:, :cross, None] * (frequency / 1e9)
    for point, spectrum in zip(points, spectra, strict=True):
        echoes.add(paths(state, point), point, spectrum)
    got = sum_echoes(echoes, state, frequency)
    assert got.shape[0] == 4
    want = slow(sensor, points, spectra, frequency) * np.sqrt(4 * np.pi)
    if kind == "horn":
        odd = want[3] if cross == 4 else 0
        want = np.stack([want[0], want[2] + odd, want[2] - odd, want[1]])
    assert np.linalg.norm(got - want) < 1e-4 * np.linalg.norm(want)


def paths(state, point):
    """Path there and back of every pair, m."""
    path = np.linalg.norm(state.position[state.tx] - point, axis=1)
    return path + np.linalg.norm(state.position[state.rx] - point, axis=1)


def test_an_echo_has_its_weights_in_every_pair(quiet):
    """One for HH, VV and the mean of HV and VH, one for half their difference."""
    frequency = quiet.tones.axis()
    state = array_state(quiet, POSE)
    points, coefficient = cloud(1, seed=4)
    path = paths(state, points[0])
    spectrum = coefficient.reshape(6)[:4, None] * (frequency / 1e9)
    weight = np.random.default_rng(5).normal(size=(2, state.tx.size))

    def summed(*arguments):
        echoes = Echoes()
        echoes.add(path, points[0], *arguments)
        return sum_echoes(echoes, state, frequency)

    plain = summed(spectrum)
    weighted = summed(spectrum, weight)
    for channels, row in (
        ([1, 0, 0, 0], 0),
        ([0, 0, 0, 1], 0),
        ([0, 0.5, 0.5, 0], 0),
        ([0, 0.5, -0.5, 0], 1),
    ):
        one, other = (np.tensordot(channels, signal, 1) for signal in (plain, weighted))
        np.testing.assert_allclose(other, one * weight[row][:, None], atol=1e-4 * np.abs(one).max())


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
