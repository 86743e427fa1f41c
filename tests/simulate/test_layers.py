"""A beam that narrows with frequency, and an array that moves during its sweep, against sums tone by tone."""

import dataclasses

import numpy as np
import pytest

from flgpr.model import Sensor
from flgpr.simulate import Scene, Simulator
from flgpr.simulate.bodies.echoes import Echo, sum_echoes, without_difference
from flgpr.simulate.ground.layers import PointEchoes, ScanView, Skeleton, sum_layers
from flgpr.simulate.radar.spread import Spreader
from flgpr.simulate.simulator import array_state, sweep_drift
from reference import slow_simulation
from simulate.conftest import STILL

POSE = np.array([0.3, 1.0, 5.0, 0.0, 0.0, 0.0])
ALONG = np.array([0.004, 0.08, 0.0])  # 20 ms at 4 m/s


def few(sensor, beam="aperture", pairs=slice(0, 18, 5)):
    """A state of few pairs, and the tones."""
    data = sensor.model_dump() | {"antenna": sensor.antenna.model_dump() | {"beam": beam}}
    sensor = Sensor.model_validate(data)
    state = array_state(sensor, POSE)
    return sensor, dataclasses.replace(state, tx=state.tx[pairs].copy(), rx=state.rx[pairs].copy())


def slow(points, spectrum, frequency, state):
    tx = state.position[state.tx]
    rx = state.position[state.rx]
    exponents = state.exponents(frequency)
    return slow_simulation.sum_swept(
        points, spectrum, frequency, tx, rx, state.boresight, exponents, state.drift
    )


def apart(got, want):
    return np.linalg.norm(got - want) / np.linalg.norm(want)


@pytest.mark.parametrize(
    ("beam", "drift"), [("aperture", 0.0), ("constant", 1.0), ("aperture", 1.0)]
)
def test_single_echoes_have_the_beam_and_the_motion_of_every_tone(quiet, beam, drift):
    sensor, state = few(quiet, beam)
    state = dataclasses.replace(state, drift=drift * ALONG)
    frequency = sensor.tones.axis()
    rng = np.random.default_rng(2)
    points = np.column_stack([rng.uniform(-5, 5, 6), rng.uniform(7, 26, 6), rng.uniform(0, 1, 6)])
    spectra = (rng.normal(size=(6, 3, 1)) + 1j * rng.normal(size=(6, 3, 1))) * (frequency / 1e9)
    echoes = []
    for point, spectrum in zip(points, spectra, strict=True):
        path = np.linalg.norm(state.position[:, None] - point, axis=-1)[:, 0]
        path = path[state.tx] + path[state.rx]
        echoes.append(Echo(path, point, without_difference(spectrum)))
    want = np.sqrt(4 * np.pi) * slow(points, spectra, frequency, state)
    assert apart(sum_echoes(echoes, state, frequency)[[0, 3, 1]], want) < 0.005
    plain = dataclasses.replace(state, growth=0.0, drift=np.zeros(3))
    assert apart(sum_echoes(echoes, plain, frequency)[[0, 3, 1]], want) > 0.2


class Strewn:
    """Two hundred points with the spectra of a simulator's layer."""

    def __init__(self, layer, sensor, count=150):
        state = array_state(sensor, POSE)
        found = layer.echoes(ScanView(sensor.footprint, POSE, state))
        chosen = np.linspace(0, len(found.points) - 1, count).astype(int)
        self.found = PointEchoes(*(part[chosen] for part in found[:3]), found.basis)

    def echoes(self, view):
        return self.found


@pytest.mark.parametrize("site", ["arid-sand", "temperate"])
def test_layers_have_the_beam_of_every_tone_and_pair(quiet, site):
    sensor, state = few(quiet)
    simulator = Simulator(
        Scene(site=site, track=STILL, surface={"density": 3.0}), sensor, 1, errors=False
    )
    frequency = sensor.tones.axis()
    view = ScanView(sensor.footprint, POSE, state)
    spreader = Spreader(sensor.tones.start, sensor.tones.step, sensor.tones.count)
    skeleton = Skeleton(
        simulator._layers, ScanView(sensor.footprint, POSE, array_state(sensor, POSE)), frequency
    )
    assert skeleton.nodes.size <= 7
    still = [dataclasses.replace(one, growth=0.0) for one in (state, array_state(sensor, POSE))]
    plain = Skeleton(simulator._layers, ScanView(sensor.footprint, POSE, still[1]), frequency)
    for layer in simulator._layers[:2]:
        some = Strewn(layer, sensor)
        got = sum_layers([some], view, spreader, skeleton)
        delay = np.exp(-4j * np.pi * frequency * some.found.extra[:, None] / slow_simulation.C)
        spectra = np.einsum("irc,rcf,if->icf", some.found.coefficient, some.found.basis, delay)
        want = slow(some.found.points, spectra, frequency, state)
        assert apart(got, want) < 0.02
        assert (
            apart(
                sum_layers([some], ScanView(sensor.footprint, POSE, still[0]), spreader, plain),
                want,
            )
            > 0.2
        )


@pytest.mark.parametrize(("seconds", "most"), [(0.01, 0.03), (0.02, 0.04), (0.05, 0.06)])
def test_clutter_seen_in_motion_is_that_of_every_tones_place(quiet, seconds, most):
    sensor, state = few(quiet, "constant")
    state = dataclasses.replace(state, drift=np.array([0.0, 4.0, 0.0]) * seconds)
    frequency = sensor.tones.axis()
    rng = np.random.default_rng(5)
    points = np.column_stack([rng.uniform(-5, 5, 200), rng.uniform(7, 26, 200), np.zeros(200)])
    values = (rng.normal(size=(200, 3, 1)) + 1j * rng.normal(size=(200, 3, 1))).astype(np.complex64)
    functions = np.ones((1, frequency.size))
    spreader = Spreader(sensor.tones.start, sensor.tones.step, sensor.tones.count)
    got = spreader(points, values, functions, state)
    want = slow(points, values * functions, frequency, state)
    assert apart(got, want) < most
    stood = spreader(points, values, functions, dataclasses.replace(state, drift=np.zeros(3)))
    assert apart(stood, want) > 10 * most


def test_motion_moves_the_peak_by_carrier_over_bandwidth(quiet):
    """A point straight ahead on the ground seems ``v·T·sinθ·fc/B`` nearer than it is in the middle of the sweep."""
    sensor, state = few(quiet, "constant", slice(0, 1))
    frequency = sensor.tones.axis()
    spreader = Spreader(sensor.tones.start, sensor.tones.step, sensor.tones.count)
    point = np.array([[0.3, 16.0, 0.0]])
    one = np.ones((1, 3, 1), np.complex64)
    peaks = []
    for drift in (0.0, 0.04):
        moving = dataclasses.replace(state, drift=np.array([0.0, drift, 0.0]))
        signal = spreader(point, one, np.ones((1, frequency.size)), moving)[0, 0]
        steps = 64 * frequency.size
        peaks.append(
            np.argmax(np.abs(np.fft.ifft(signal * np.hanning(frequency.size), steps)))
            / steps
            / 10e6
        )
    carrier = frequency[frequency.size // 2]
    bandwidth = frequency.size * 10e6
    ray = point[0] - state.position[[state.tx[0], state.rx[0]]]
    rate = -np.sum(ray @ [0.0, 0.04, 0.0] / np.linalg.norm(ray, axis=1))
    shift = (peaks[1] - peaks[0]) * slow_simulation.C
    assert shift == pytest.approx(rate * carrier / bandwidth, abs=0.004)


def test_a_standing_vehicle_sweeps_like_an_instant_and_motion_is_off_without_errors(quiet):
    pose = np.zeros((4, 6))
    pose[:, 1] = [0.0, 2.0, 4.0, 4.0]
    time = np.array([0.0, 1.0, 2.0, 3.0])
    drift = sweep_drift(pose, time, 0.05)
    np.testing.assert_allclose(drift[:2, 1], 0.1)
    assert not sweep_drift(pose, time, 0.0).any()
    assert drift[3, 1] == 0
    data = quiet.model_dump() | {"errors": {"sweep_time": 0.05}}
    scene = Scene(
        track={"positions": (0.0, 2.0)},
        surface={"density": 2.0},
        objects=[{"kind": "fiducial", "x": 0, "y": 12}],
    )
    moving = Simulator(scene, Sensor.model_validate(data), 1)
    still = Simulator(scene, quiet, 1)
    np.testing.assert_array_equal(
        Simulator(scene, Sensor.model_validate(data), 1, errors=False).scan(0), still.scan(0)
    )
    assert apart(moving.scan(0), still.scan(0)) > 0.1
    np.testing.assert_array_equal(
        moving.scan(1), Simulator(scene, Sensor.model_validate(data), 1).scan(1)
    )


def test_the_skeleton_takes_dipoles_with_ground_below_and_behind(dipoles):
    """Spectra are carried from the chosen tones to all tones, ahead and behind alike."""
    sensor = dipoles.model_copy(update={"height": 1.2, "footprint": (-3.0, 3.0, -5.0, 5.0)})
    simulator = Simulator(
        Scene(site="temperate", track=STILL, surface={"density": 20.0}), sensor, 1, errors=False
    )
    view = simulator._view(simulator._array(0), simulator.pose[0])
    frequency = sensor.tones.axis()
    skeleton = simulator._skeleton
    assert np.isfinite(skeleton.functions).all()
    for layer in simulator._layers[:2]:
        echoes = layer.echoes(view)
        want = np.einsum("irc,rcf->icf", echoes.coefficient, echoes.basis)
        got = skeleton.values(echoes) @ skeleton.functions
        for part in (echoes.points[:, 1] < 0, echoes.points[:, 1] > 0):
            assert part.sum() > 200
            assert apart(got[part], want[part]) < 0.03
    assert frequency.size == skeleton.functions.shape[1]
    assert np.isfinite(simulator.scan(0)).all()
