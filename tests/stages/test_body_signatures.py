"""The sensor and the window that simulated bodies are imaged with."""

from types import SimpleNamespace

import numpy as np
import pytest

from flgpr.model import load_sensor, make_run
from flgpr.stages.body_signatures import sensor_of, window_of


def setup_of(name="sri-array", shift=0.0, tones=None):
    """Make the setup of a run that a packaged sensor took, its transmitters moved along x."""
    sensor = load_sensor(name)
    tx, rx = (np.asarray(ends) for ends in sensor.pairs())
    frequency = sensor.tones.axis() if tones is None else tones
    values = {
        "tx_position": tx + [shift, 0.0, 0.0],
        "rx_position": rx,
        "frequency": frequency,
    }
    return SimpleNamespace(
        run={key: SimpleNamespace(values=value) for key, value in values.items()}
    )


def test_a_sensor_of_the_runs_array_has_no_errors_of_navigation():
    sensor = sensor_of(setup_of(shift=0.005), "sri-array")
    errors = sensor.errors
    assert (errors.missing, errors.position, errors.heading, errors.attitude) == (0, 0, 0, 0)
    assert sensor.pairs()[0] is not None
    assert load_sensor("sri-array").errors.position > 0


def test_another_array_is_refused():
    with pytest.raises(ValueError, match=r"map\.sensor must describe the run's array, got 'sri-"):
        sensor_of(setup_of(shift=0.5), "sri-array")


def test_other_tones_are_refused():
    tones = load_sensor("sri-array").tones.axis()
    tones[[3, 5]] += 1e6
    message = r"map\.sensor must have the run's tones, got 'sri-array', which lacks 2 of 1024"
    with pytest.raises(ValueError, match=message):
        sensor_of(setup_of(tones=tones), "sri-array")


def test_a_run_without_some_pairs_and_tones_is_still_of_its_array():
    setup = setup_of(tones=np.delete(load_sensor("sri-array").tones.axis(), [7, 500]))
    for end in ("tx_position", "rx_position"):
        setup.run[end].values = np.delete(setup.run[end].values, 4, axis=0)
    assert sensor_of(setup, "sri-array").pairs()[0].shape == (36, 3)


def test_the_runs_own_array_takes_antennas_and_errors_of_another():
    other = load_sensor("full-wave")
    tx, rx = other.pairs()
    pose = [[0.0, 0.0, 1.7, 0.0, 0.0, 0.0]]
    shape = (1, 1, len(tx), 40)
    run = make_run(np.zeros(shape), 1e9 + 5e6 * np.arange(40), ["VV"], tx, rx, pose)
    sensor = sensor_of(SimpleNamespace(run=run), "run", "sri-array")
    assert (sensor.polarization, sensor.height, sensor.tones.count) == (("VV",), 1.7, 40)
    np.testing.assert_array_equal(sensor.pairs(), (tx, rx))
    errors = load_sensor("sri-array").errors
    assert sensor.errors.antenna_phase == errors.antenna_phase > 0
    assert (sensor.errors.position, sensor.errors.missing) == (0, 0)


def test_a_window_can_be_compared():
    assert window_of(SimpleNamespace(window=None)) is None
    assert window_of(SimpleNamespace(window="hann")) == "hann"
    weights = window_of(SimpleNamespace(window=np.array([0.5, 1.0], np.float32)))
    assert weights == (0.5, 1.0)
    assert hash(weights) == hash((0.5, 1.0))
