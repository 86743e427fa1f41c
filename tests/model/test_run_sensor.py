"""The sensor of a run: its own array, and what another sensor must tell."""

import numpy as np
import pytest

from flgpr.model import load_sensor, make_run, sensor_presets
from flgpr.model.run_sensor import preset_of, sensor_of_run

SRI = load_sensor("sri-array")
SAME_ARRAY = {"full-wave-echo": "full-wave"}  # which differ in what is simulated


def run_of(sensor, scans=2, tones=None, height=None):
    tx, rx = sensor.pairs()
    tones = sensor.tones.axis() if tones is None else tones
    pose = np.zeros((scans, 6))
    pose[:, 1] = np.arange(scans)
    pose[:, 2] = sensor.height if height is None else height
    shape = (scans, len(sensor.polarization), len(tx), len(tones))
    return make_run(np.zeros(shape, np.complex64), tones, sensor.polarization, tx, rx, pose)


@pytest.mark.parametrize("name", sensor_presets())
def test_the_run_of_a_packaged_sensor_gives_that_sensor(name):
    sensor = load_sensor(name)
    run = run_of(sensor)
    assert preset_of(run) == SAME_ARRAY.get(name, name)
    ours = sensor_of_run(run, sensor).model_dump()
    theirs = sensor.model_dump()
    for entry in ("name", "source"):
        del ours[entry], theirs[entry]
    for errors in (ours["errors"], theirs["errors"]):
        del errors["noise_range"]
    assert ours == theirs


def test_another_array_is_that_of_no_packaged_sensor():
    run = run_of(SRI)
    assert preset_of(run.isel(frequency=slice(0, 1000))) == ""
    assert preset_of(run.isel(pair=slice(0, 30))) == ""
    moved = run.assign(tx_position=run["tx_position"] + 0.05)
    assert preset_of(moved) == ""
    assert preset_of(run.isel(polarization=[1])) == "sri-array"  # of whose polarizations it has one
    assert preset_of(run.assign_coords(polarization=["HH", "VV", "VH"])) == ""


def test_pattern_and_errors_are_those_of_the_antennas_that_are_named():
    sensor = sensor_of_run(run_of(load_sensor("full-wave")), SRI, (-3.0, 3.0, 1.0, 9.0))
    assert sensor.antenna == SRI.antenna
    assert sensor.tilt == SRI.tilt
    assert sensor.errors.antenna_phase == SRI.errors.antenna_phase
    assert sensor.errors.noise_range == pytest.approx(3.2 * 1.5)
    assert sensor.footprint == (-3.0, 3.0, 1.0, 9.0)
    assert (len(sensor.tx), len(sensor.rx), sensor.height) == (2, 16, 1.5)


def test_noise_is_given_in_the_runs_band():
    sensor = sensor_of_run(run_of(load_sensor("dual-band-x"), tones=8e9 + 5e6 * np.arange(50)), SRI)
    assert sensor.errors.noise_band == (8e9, 8.245e9)


def test_the_height_is_rounded_so_that_lanes_share_a_sensor():
    heights = [sensor_of_run(run_of(SRI, height=height), SRI).height for height in (3.49, 3.515)]
    assert heights == [3.5, 3.5]
    with pytest.raises(ValueError, match=r"run\.pose must put .* above the ground, got 0 m"):
        sensor_of_run(run_of(SRI, height=0.0), SRI)


def test_missing_tones_are_among_the_sensors_and_uneven_ones_are_refused():
    tones = 1e9 + 5e6 * np.arange(60)
    some = np.delete(tones, [7, 8, 30])
    sensor = sensor_of_run(run_of(SRI, tones=some), SRI)
    np.testing.assert_allclose(sensor.tones.axis(), tones)
    single = sensor_of_run(run_of(SRI, tones=np.array([1e9])), SRI)
    np.testing.assert_allclose(single.tones.axis(), [1e9])
    with pytest.raises(ValueError, match=r"run\.frequency must lie on an even raster"):
        sensor_of_run(run_of(SRI, tones=np.geomspace(1e9, 2e9, 40)), SRI)


def test_pairs_that_are_not_all_of_an_array_stay_pairs():
    run = run_of(SRI).isel(pair=[0, 3, 20])
    sensor = sensor_of_run(run, SRI)
    assert sensor.scanned
    np.testing.assert_array_equal(sensor.pairs()[0], run["tx_position"].values)
    np.testing.assert_array_equal(sensor.pairs()[1], run["rx_position"].values)


def test_a_run_without_a_complete_scan_is_refused():
    run = run_of(SRI)
    run["valid"].values[:] = False
    with pytest.raises(ValueError, match="scan without missing sweeps"):
        sensor_of_run(run, SRI)
