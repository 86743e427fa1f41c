import itertools

import numpy as np
import pytest

from flgpr.model import SPEED_OF_LIGHT, Sensor
from flgpr.simulate import Scene, Simulator
from flgpr.simulate.radar.impair import Impairments, signature_end
from simulate.conftest import BARE


def with_errors(sensor, **errors):
    return Sensor.model_validate(sensor.model_dump() | {"errors": errors})


SILENCE = np.zeros((4, 18, 256), np.complex64)


def test_every_error_can_be_switched_off(quiet):
    signal = np.random.default_rng(0).normal(size=(4, 18, 256)).astype(np.complex64)
    np.testing.assert_array_equal(Impairments(quiet, 1).apply(signal, 3), signal)


def test_noise_has_its_variance_and_interference_its_level(quiet):
    errors = Impairments(with_errors(quiet, clutter_to_noise_db=15.0, interference_tones=10), 1)
    noise = np.array([errors.apply(SILENCE, k) for k in range(6)])
    power = np.mean(np.abs(noise) ** 2, axis=(0, 1, 2)) / errors.noise_power
    hit = power > 5
    assert hit.sum() == 10
    assert np.median(power[~hit]) == pytest.approx(1, abs=0.05)
    assert (10 * np.log10(power[hit]) > 9).all()
    assert (10 * np.log10(power[hit]) < 31).all()


def test_gain_changes_by_its_rms_from_scan_to_scan(quiet):
    errors = Impairments(with_errors(quiet, gain_db=1.0), 2)
    gains = [20 * np.log10(np.abs(errors.apply(SILENCE + 1, k)[0, 0, 0])) for k in range(400)]
    assert np.std(gains) == pytest.approx(1.0, rel=3 / np.sqrt(2 * 400))


def test_leakage_is_at_the_isolation(quiet):
    errors = Impairments(with_errors(quiet, isolation_db=-20.0), 2)
    signal = SILENCE.copy()
    signal[0] = 1
    leaked = errors.apply(signal, 0)
    np.testing.assert_allclose(20 * np.log10(np.abs(leaked[1:3])), -20, atol=1e-3)
    np.testing.assert_allclose(20 * np.log10(np.abs(leaked[3])), -40, atol=1e-3)


def test_the_self_signature_stays_and_drifts_a_little(quiet):
    errors = Impairments(with_errors(quiet, self_signature_db=15.0, self_signature_drift=0.02), 4)
    scans = np.array([errors.apply(SILENCE, k) for k in range(60)])
    drift = np.linalg.norm(scans - scans.mean(axis=0)) / np.linalg.norm(scans)
    assert 0.01 < drift < 0.03


def test_missing_sweeps_are_nan_at_their_rate(quiet):
    errors = Impairments(with_errors(quiet, missing=0.1), 5)
    lost = np.array([np.isnan(errors.apply(SILENCE, k)).any(axis=2)[0] for k in range(100)])
    assert lost.mean() == pytest.approx(0.1, abs=3 * np.sqrt(0.09 / lost.size))


def test_reported_poses_have_their_errors(quiet):
    errors = Impairments(with_errors(quiet, position=0.02, heading=0.004), 6)
    reported = errors.reported_pose(np.zeros((500, 6)))
    assert reported[:, :3].std() == pytest.approx(0.02, rel=0.1)
    assert reported[:, 3].std() == pytest.approx(0.004, rel=0.12)
    assert not reported[:, 4:].any()


def test_a_vehicle_wanders_stops_leaves_and_comes_back(quiet):
    track = {
        "start": 0.0,
        "stop": 60.0,
        "step": (1.0, 1.0),
        "wander": 0.4,
        "stops": [(10.0, 3)],
        "departures": [{"start": 30.0, "length": 12.0}],
    }
    pose = Simulator(Scene(surface=BARE, track=track, length=60.0), quiet, 1).pose
    time = Simulator(Scene(surface=BARE, track=track, length=60.0), quiet, 1).time
    y = pose[:, 1]
    assert (y == 10.0).sum() == 4
    assert not ((y >= 30.0) & (y < 42.0)).any()
    assert (y >= 42.0).any()
    assert (np.diff(time) > 0).all()
    assert 0.1 < pose[:, 0].std() < 0.8
    moving = np.diff(y) > 0
    slope = np.arctan2(np.diff(pose[:, 0])[moving], np.diff(y)[moving])
    middle = (pose[1:, 3] + pose[:-1, 3])[moving] / 2
    near = np.diff(y)[moving] < 2
    np.testing.assert_allclose(slope[near], middle[near], atol=0.02)


def test_the_self_signature_ends_at_its_path_and_not_before(quiet):
    """Its range profile has echoes up to the end, and behind it nothing but the window's skirts."""
    own = {"self_signature_db": 15.0, "self_signature_drift": 0.0}
    tones = {"start": 0.5e9, "step": 2.5e6, "count": 256}  # 120 m of path unambiguous
    sensor = Sensor.model_validate(quiet.model_dump() | {"errors": own, "tones": tones})
    errors = Impairments(sensor, 4)
    signature = errors.apply(SILENCE, 0)[0]
    step = errors.frequency[1] - errors.frequency[0]
    span = SPEED_OF_LIGHT / step
    end = signature_end(sensor)
    assert sensor.footprint[3] * 2 < end < 0.9 * span
    profile = np.abs(np.fft.ifft(signature * np.hanning(256), 2048, axis=1)) ** 2
    path = np.arange(2048) / 2048 * span
    cell = 4 * SPEED_OF_LIGHT / (256 * step)
    before = profile[:, (path > 0.8 * end) & (path < end - cell)].mean()
    behind = profile[:, (path > end + cell) & (path < span - cell)].mean()
    assert 10 * np.log10(before / behind) > 20


def disturbed(errors, scan):
    power = np.mean(np.abs(errors.apply(SILENCE, scan)) ** 2, axis=(0, 1)) / errors.noise_power
    return set(np.flatnonzero(power > 5).tolist())


def test_continuous_interference_stands_for_its_scans_and_is_silent_for_others(quiet):
    parts = {"clutter_to_noise_db": 15.0, "interference_tones": 20}
    all_of_them = disturbed(Impairments(with_errors(quiet, **parts), 1), 0)
    comes_and_goes = Impairments(with_errors(quiet, **parts, interference_scans=8), 1)
    heard = [disturbed(comes_and_goes, scan) for scan in range(64)]
    assert set.union(*heard) == all_of_them
    share = np.mean([len(tones) / 20 for tones in heard])
    # 20 interferers in 8 to 9 periods of an even chance each.
    assert share == pytest.approx(0.5, abs=4 * 0.5 / np.sqrt(160))
    changes = sum(len(one ^ other) for one, other in itertools.pairwise(heard))
    assert changes / 63 == pytest.approx(20 / 8 / 2, rel=0.4)
    longest = max(changes_of(tone, heard) for tone in all_of_them)
    assert longest <= 9


def changes_of(tone, heard):
    stands = [tone in tones for tones in heard]
    return sum(one != other for one, other in itertools.pairwise(stands))


def test_continuous_interference_fills_its_channel(quiet):
    parts = {"clutter_to_noise_db": 15.0, "interference_tones": 3}
    alone = disturbed(Impairments(with_errors(quiet, **parts), 2), 0)
    wide = disturbed(Impairments(with_errors(quiet, **parts, interference_width=4), 2), 0)
    assert wide == {tone + k for tone in alone for k in range(4) if tone + k < 256}
