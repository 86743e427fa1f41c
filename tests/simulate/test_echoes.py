"""Echoes of single objects are summed as their slow sum says."""

import numpy as np
import pytest

from flgpr.simulate.bodies.echoes import Echo, sum_echoes, without_difference
from flgpr.simulate.simulator import array_state
from simulate.scatterers import POSE, cloud, slow


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
    echoes = []
    spectra = coefficient.reshape(8, 6)[:, :cross, None] * (frequency / 1e9)
    for point, spectrum in zip(points, spectra, strict=True):
        four_rows = spectrum if cross == 4 else without_difference(spectrum)
        echoes.append(Echo(paths(state, point), point, four_rows))
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
        return sum_echoes([Echo(path, points[0], *arguments)], state, frequency)

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
