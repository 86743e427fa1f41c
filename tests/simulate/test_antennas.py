"""Statistics of the antennas' errors, each from what it does to a wave."""

import numpy as np
import pytest

from flgpr.model import Antenna, Sensor, load_sensor, sensor_presets
from flgpr.simulate.radar.impair import (
    AntennaErrors,
    Impairments,
    random_response,
    resonance,
    slow_change,
)

PLAIN = np.ones((4, 18, 256), np.complex64)


def with_errors(sensor, **errors):
    return Sensor.model_validate(sensor.model_dump() | {"errors": errors})


def of_many_seeds(sensor, count, **errors):
    """Ports (seed, side, antenna, port, frequency) of scan 0; an array has too few antennas for a statistic."""
    sensor = with_errors(sensor, **errors)
    return np.array([AntennaErrors(sensor, seed).ports(0) for seed in range(count)])


def rms_within(values, want):
    """Whether an rms of independent normal values agrees with what it should be, to three of its own errors."""
    assert np.sqrt(np.mean(values**2)) == pytest.approx(want, rel=3 / np.sqrt(2 * values.size))


def test_ports_have_the_gain_phase_and_delay_errors_asked_for(quiet):
    ports = of_many_seeds(quiet, 40, antenna_gain_db=0.6, antenna_phase=0.07)[..., 0]
    rms_within(20 * np.log10(np.abs(ports)), 0.6)
    rms_within(np.angle(ports), 0.07)
    late = of_many_seeds(quiet, 40, antenna_delay=12e-12)
    step = np.angle(late[..., 1:] * late[..., :-1].conj()).mean(axis=-1)
    rms_within(step / (2 * np.pi * 10e6), 12e-12)


def test_a_delay_moves_the_peak_and_every_pair_has_that_of_its_antennas(quiet):
    errors = AntennaErrors(with_errors(quiet, antenna_delay=2e-9), 3)
    got = errors.apply(PLAIN, 0)
    span = 1 / 10e6
    late = np.argmax(np.abs(np.fft.ifft(got, 16 * 256)), axis=-1) / (16 * 256) * span
    late = (late + span / 2) % span - span / 2
    ports = errors.ports(0)
    own = -np.angle(ports[..., 1] * ports[..., 0].conj()) / (2 * np.pi * 10e6)
    first, second = quiet.pair_indices()
    want = np.array([own[0][first, i] + own[1][second, j] for i in range(2) for j in range(2)])
    np.testing.assert_allclose(late, want, atol=0.1e-9)
    assert np.ptp(want) > 2e-9


def test_reciprocity_breaks_with_the_errors_of_ports(quiet):
    """HV and VH, the same of any passive scatterer, differ by gain errors of four ports of two antennas."""
    sensor = with_errors(quiet, antenna_gain_db=0.6)
    got = np.array([AntennaErrors(sensor, seed).apply(PLAIN, 0)[:, 0, 0] for seed in range(400)])
    rms_within(20 * np.log10(np.abs(got[:, 1] / got[:, 2])), 0.6 * 2)


def test_ports_drift_slowly_by_their_rms(quiet):
    sensor = with_errors(quiet, antenna_gain_db=0.6, antenna_drift=0.3)
    db = np.array(
        [
            [20 * np.log10(np.abs(AntennaErrors(sensor, s).ports(k)[..., 0])) for k in (0, 1, 600)]
            for s in range(20)
        ]
    )
    rms_within(db[:, 2] - db[:, 0], 0.6 * 0.3 * np.sqrt(2))
    assert np.abs(db[:, 1] - db[:, 0]).max() < 0.05 * np.abs(db[:, 2] - db[:, 0]).max()
    rms_within(slow_change(1, "drift", 7, (4000,), 60).view(float) * np.sqrt(2), 1.0)


def test_imbalance_is_common_to_all_antennas_of_a_side(quiet):
    ports = of_many_seeds(quiet, 300, imbalance_db=0.5, imbalance_phase=0.09)
    ratio = ports[:, :, :, 1, 0] / ports[:, :, :, 0, 0]
    np.testing.assert_allclose(ratio, ratio[:, :, :1] * np.ones((1, 1, ratio.shape[2])))
    rms_within(20 * np.log10(np.abs(ratio[:, :, 0])), 0.5)
    rms_within(np.angle(ratio[:, :, 0]), 0.09)


def test_leakage_in_frequency_has_its_level_and_coherence(quiet):
    only_h = PLAIN * np.array([1, 0, 0, 0], np.complex64)[:, None, None]
    sensor = with_errors(quiet, isolation_db=-20.0, isolation_bandwidth=100e6)
    leaked = np.array([AntennaErrors(sensor, seed).apply(only_h, 0)[1] for seed in range(12)])
    level = np.mean(np.abs(leaked[:, :9]) ** 2)  # nine receivers of their own
    assert 10 * np.log10(level) == pytest.approx(-20, abs=0.6)
    rng = np.random.default_rng(0)
    frequency = quiet.tones.axis()
    drawn = random_response(rng, (600,), frequency, 100e6)
    apart = 10  # tones of 10 MHz
    coherence = np.mean(drawn[:, apart:] * drawn[:, :-apart].conj())
    assert abs(coherence) ** 2 == pytest.approx(0.5, abs=0.08)
    assert np.mean(np.abs(drawn) ** 2) == pytest.approx(1, abs=0.05)


def test_ringing_dies_away_as_its_quality_says():
    frequency = np.arange(1, 4096) * 2e6
    late = np.abs(np.fft.ifft(resonance(frequency, np.array(1e9), 20.0)))
    time = np.arange(frequency.size) / (frequency.size * 2e6)
    some = (time > 5e-9) & (time < 25e-9)
    decay = np.polyfit(time[some], np.log(late[some]), 1)[0]
    assert decay == pytest.approx(-np.pi * 1e9 / 20, rel=0.02)
    assert abs(resonance(np.array([1e9]), np.array(1e9), 20.0)[0]) == 1


def test_antennas_ring_at_their_level_behind_the_direct_wave(quiet):
    ringing = {"ringing_db": -20.0, "ringing_q": 15.0, "ringing_frequencies": (1.2e9,)}
    late = of_many_seeds(quiet, 30, **ringing) - 1
    peak = np.abs(late).max(axis=-1)
    np.testing.assert_allclose(20 * np.log10(peak), -20, atol=0.2)
    where = quiet.tones.axis()[np.abs(late).argmax(axis=-1)]
    rms_within(where / 1.2e9 - 1, 0.02)


def test_bursts_hit_runs_of_tones_at_their_rate_and_level(quiet):
    options = {
        "clutter_to_noise_db": 15.0,
        "burst_probability": 0.1,
        "burst_tones": (8, 16),
        "burst_db": (20.0, 20.0),
    }
    errors = Impairments(with_errors(quiet, **options), 3)
    bursts = np.array([errors.bursts(k) for k in range(150)])
    inside = np.abs(bursts[:, 0]) > 0
    length = inside.sum(axis=-1)
    hit = length > 0
    assert hit.mean() == pytest.approx(0.1, abs=3 * np.sqrt(0.09 / hit.size))
    assert length[hit].min() == 8
    assert length[hit].max() == 16
    edges = np.abs(np.diff(inside.astype(int), axis=-1, prepend=0, append=0)).sum(axis=-1)
    assert (edges[hit] == 2).all()
    power = np.abs(bursts[:, 0][inside]) ** 2 / errors.noise_power
    np.testing.assert_allclose(10 * np.log10(power), 20, atol=1e-3)
    tone = np.angle(bursts[:, 0][inside])
    assert abs(np.mean(np.exp(1j * tone))) < 4 / np.sqrt(tone.size)
    np.testing.assert_array_equal(
        errors.bursts(7), Impairments(with_errors(quiet, **options), 3).bursts(7)
    )


def test_reported_pitch_and_roll_have_their_error(quiet):
    errors = Impairments(with_errors(quiet, attitude=0.003), 6)
    reported = errors.reported_pose(np.zeros((600, 6)))
    rms_within(reported[:, 4], 0.003)
    rms_within(reported[:, 5], 0.003)
    assert not reported[:, :4].any()


def test_scans_have_the_same_errors_in_any_order(quiet):
    every = {
        "antenna_gain_db": 0.6,
        "antenna_delay": 12e-12,
        "antenna_drift": 0.3,
        "isolation_db": -22.0,
    }
    every |= {
        "isolation_bandwidth": 1e8,
        "imbalance_db": 0.5,
        "ringing_db": -25.0,
        "ringing_frequencies": (1e9,),
    }
    every |= {"clutter_to_noise_db": 15.0, "burst_probability": 0.3}
    sensor = with_errors(quiet, **every)
    there = Impairments(sensor, 1)
    back = Impairments(sensor, 1)
    forward = [there.apply(PLAIN, k) for k in (0, 70)]
    backward = [back.apply(PLAIN, k) for k in (70, 0)]
    np.testing.assert_array_equal(forward, backward[::-1])
    assert not np.array_equal(forward[0], Impairments(sensor, 2).apply(PLAIN, 0))


def test_an_apertures_beam_narrows_as_its_gain_grows():
    antenna = Antenna(gain_db=7.8, gain_frequency=1e9, exponent=2.0, beam="aperture")
    frequency = np.array([3e9, 6e9, 12e9])
    exponent = antenna.exponents(frequency)
    width = 2 * np.arccos(0.5 ** (1 / exponent))
    np.testing.assert_allclose(width * frequency, width[-1] * frequency[-1], rtol=0.02)
    gain = 7.8 + 20 * np.log10(frequency / 1e9)
    np.testing.assert_allclose(10 * np.log10(2 * (exponent + 1)), gain, atol=0.05)
    assert antenna.exponents(np.array([0.3e9]))[0] == 0
    assert (Antenna(exponent=2.0).exponents(frequency) == 2).all()


@pytest.mark.parametrize("preset", sensor_presets())
def test_presets_have_beams_of_their_gain(preset):
    antenna = load_sensor(preset).antenna
    if antenna.kind == "dipole":
        assert preset.startswith("full-wave")  # whose array is ideal
        return
    assert antenna.beam == "aperture"
    assert 10 * np.log10(2 * (antenna.exponent + 1)) == pytest.approx(antenna.gain_db, abs=0.2)


def test_limits_in_the_wrong_order_are_refused(quiet):
    with pytest.raises(
        ValueError, match="burst_tones must be the least and the greatest value, got 9 and 3"
    ):
        with_errors(quiet, burst_tones=(9, 3))
