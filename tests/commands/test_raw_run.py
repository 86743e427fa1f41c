"""What a run answers to the viewer's pages, against sums written out."""

import json

import numpy as np
import pytest

from flgpr.calibrate import disturbed_tones
from flgpr.commands import raw_run as raw_module
from flgpr.commands.raw_run import RawRun
from flgpr.store import open_run, save_run
from raw_lane import direct, make_raw_lane, values_of

STEPS = [
    {"do": "dewow", "length_ns": 5.0},
    {"do": "background"},
    {"do": "band", "low_ghz": 0.8, "high_ghz": 2.2},
    {"do": "power", "exponent": 1.5},
]


@pytest.fixture(scope="module")
def lane(tmp_path_factory):
    path = tmp_path_factory.mktemp("raw") / "run.zarr"
    make_raw_lane(path)
    return path


def test_decibels_are_the_greatest_amplitude_of_a_bin(lane, monkeypatch):
    monkeypatch.setattr(raw_module, "MOST_BINS", 200)
    answer = RawRun(lane).answer("bscan", {"polarization": "VV", "pair": "1"})
    run = open_run(lane)
    tones = run["frequency"].values
    count = 200
    stop = answer["delays_ns"]["stop"] * 1e-9
    assert stop == pytest.approx(1 / (tones[1] - tones[0]))
    delays = (
        stop * (np.arange(4 * count) + 0.5) / (4 * count)
    )  # 80 ns at four to a period of the band, 2 GHz
    amplitude = (
        np.abs(direct(run["signal"].values[:, 1, 1], tones, delays))
        .reshape(-1, count, 4)
        .max(axis=2)
    )
    one = [0, 20, 100, 159]
    seen = values_of(answer)[one]
    strong = amplitude[one] > 1e-2
    assert strong.sum() > 20
    np.testing.assert_allclose(seen[strong], 20 * np.log10(amplitude[one][strong]), atol=0.04)
    assert answer["top_db"] == pytest.approx(
        20 * np.log10(np.nanpercentile(amplitude, 99.8)), abs=0.05
    )


def test_uneven_tones_are_summed_as_they_are(tmp_path):
    tones = np.sort(np.random.default_rng(2).uniform(0.5e9, 2.5e9, 90))
    make_raw_lane(tmp_path / "uneven.zarr", 8, tones)
    raw = RawRun(tmp_path / "uneven.zarr")
    query = {"polarization": "HH", "pair": "0", "scale": "signed", "to_ns": "20"}
    answer = raw.answer("bscan", query)
    signal = open_run(tmp_path / "uneven.zarr")["signal"].values[:, 0, 0]
    expected = direct(signal, tones, 20e-9 * (np.arange(800) + 0.5) / 800).real
    np.testing.assert_allclose(
        values_of(answer) * answer["unit"], expected, atol=3e-3 * np.abs(expected).max()
    )
    with pytest.raises(ValueError, match="step 1, power: tones must be at least two and even"):
        raw.answer("bscan", query | {"steps": '[{"do": "power", "exponent": 1}]'})


def test_tones_that_something_else_transmits_on_are_found(lane, tmp_path):
    """Two neighbours and one alone, in one pair; noise and echoes alone disturb none."""
    run = open_run(lane).compute()
    signal = run["signal"].values.copy()
    rng = np.random.default_rng(1)
    for tone in (30, 31, 100):
        signal[:, :, 1, tone] += 5 * np.exp(2j * np.pi * rng.uniform(size=(160, 2)))
    save_run(run.assign(signal=(run["signal"].dims, signal)), tmp_path / "hit.zarr")
    raw = RawRun(tmp_path / "hit.zarr")
    query = {"polarization": "VV", "scan": "9", "steps": json.dumps(STEPS)}
    told = raw.answer("spectrum", query | {"pair": "1"})["disturbed_ghz"]
    np.testing.assert_allclose(told, run["frequency"].values[[30, 31, 100]] * 1e-9)
    assert raw.answer("spectrum", query | {"pair": "0"})["disturbed_ghz"] == []
    few = disturbed_tones(signal[:2, 0, 1])
    assert few.shape == (161,)
    assert not few.any()


def test_long_runs_and_little_memory_take_every_so_many_scans(lane, monkeypatch):
    query = {"polarization": "HH", "pair": "1"}
    monkeypatch.setattr(raw_module, "MOST_SCANS", 60)
    answer = RawRun(lane).answer("bscan", query)
    assert answer["scans"] == list(range(0, 160, 3))
    assert answer["missing"] == [1, 17, 18]  # scans 3, 51 and 54
    with pytest.raises(ValueError, match="scan must be one of those shown, of 160, got 1"):
        RawRun(lane).answer("spectrum", query | {"scan": "1"})
    size = open_run(lane)["signal"].nbytes // 2
    assert (
        len(RawRun(lane, size).answer("bscan", query)["scans"]) == 32
    )  # a fifth, for the copies at work
    assert RawRun(lane, size).answer("health", {})["channels"]["missing"] == [5, 6, 5, 5]


def test_a_moving_background_that_takes_long_is_refused(lane, monkeypatch):
    monkeypatch.setattr(raw_module, "_MOST_RUNNING", 1e5)
    query = {"polarization": "HH", "pair": "0", "steps": '[{"do": "background", "scans": 9}]'}
    with pytest.raises(ValueError, match="9 scans take too long here, use flgpr prepare"):
        RawRun(lane).answer("bscan", query)


def test_one_scan_on_the_ground_has_no_image(tmp_path):
    make_raw_lane(tmp_path / "air.zarr", 12)
    run = open_run(tmp_path / "air.zarr").compute()
    run["pose"][:, 2] = 0.0
    save_run(run.assign_attrs(sounding="ground-coupled"), tmp_path / "ground.zarr")
    raw = RawRun(tmp_path / "ground.zarr")
    query = {"polarization": "HH", "pair": "0", "permittivity": "6"}
    with pytest.raises(ValueError, match="whole must be true for antennas on the ground"):
        raw.answer("image", query | {"scan": "3"})
    assert raw.answer("image", query | {"whole": "true"})["up"][0] == "z"


@pytest.mark.parametrize("window", [1e9, 1e300])
def test_a_window_of_agc_longer_than_the_trace_is_as_long_as_it(lane, window):
    query = {"polarization": "HH", "pair": "0", "to_ns": "60"}
    answers = [
        RawRun(lane).answer(
            "bscan", query | {"steps": json.dumps([{"do": "agc", "window_ns": one}])}
        )["halves"]
        for one in (80.5, window)
    ]
    assert answers[0] == answers[1]


def test_a_simulated_run_says_where_its_echoes_end(tmp_path):
    """The ground ends with its far corner's path, the vehicle's own echoes with theirs; steps shift both."""
    from flgpr.model import SPEED_OF_LIGHT
    from flgpr.store import RunWriter

    tones = np.linspace(0.5e9, 2.5e9, 401)  # 200 ns unambiguous
    tx, rx = np.array([[-1.0, 0.0, 0.0]]), np.array([[1.0, 0.0, 0.0]])
    limits = {"footprint_m": [-2.0, 2.0, 3.0, 20.0], "own_echoes_path_m": 44.0}
    signal = np.random.default_rng(0).normal(size=(4, 1, 1, 401))
    for name, told in (("a", limits), ("b", {"footprint_m": [1, "x"], "own_echoes_path_m": None})):
        with RunWriter(
            tmp_path / f"{name}.zarr", tones, ["VV"], tx, rx, inputs={"made": 1}, limits=told
        ) as writer:
            for scan in signal:
                writer.append(scan, [0.0, 0.0, 5.0, 0.0, 0.0, 0.0])
    query = {"polarization": "VV", "pair": "0"}
    corner = np.array([2.0, 20.0, -5.0])
    path = np.linalg.norm(corner - tx[0]) + np.linalg.norm(corner - rx[0])
    ground, own = RawRun(tmp_path / "a.zarr").answer("bscan", query)["ends"]
    assert ground["delay_ns"] == pytest.approx(path / SPEED_OF_LIGHT * 1e9, abs=0.01)
    assert own["delay_ns"] == pytest.approx(44 / SPEED_OF_LIGHT * 1e9, abs=0.01)
    assert "20 m ahead" in ground["words"]
    assert "vehicle itself" in own["words"]

    later = json.dumps([{"do": "time-zero", "delay_ns": 10.0}])
    shifted = RawRun(tmp_path / "a.zarr").answer("bscan", query | {"steps": later})["ends"]
    assert shifted[1]["delay_ns"] == pytest.approx(own["delay_ns"] - 10, abs=0.01)
    near = RawRun(tmp_path / "a.zarr").answer("bscan", query | {"to_ns": "100"})
    assert near["ends"] == []  # what is not in the picture is not marked
    assert RawRun(tmp_path / "b.zarr").answer("bscan", query)["ends"] == []


def test_a_run_that_states_no_limits_has_no_ends(lane):
    assert RawRun(lane).answer("bscan", {"polarization": "HH", "pair": "0"})["ends"] == []
