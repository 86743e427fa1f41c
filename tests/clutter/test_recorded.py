"""The usual steps on recorded traces, against sums written out."""

import numpy as np
import pytest

from flgpr.clutter import dewow_traces, level_traces

RNG = np.random.default_rng(3)
TRACES = RNG.normal(size=(6, 40))


def running_mean(trace, window):
    """Average over the window around a sample, or what of it lies in the trace."""
    half = window // 2
    return np.array([trace[max(k - half, 0) : k + half + 1].mean() for k in range(trace.size)])


@pytest.mark.parametrize("window", [3, 9, 79])
def test_dewow_subtracts_the_running_mean(window):
    expected = [trace - running_mean(trace, window) for trace in TRACES]
    np.testing.assert_allclose(dewow_traces(TRACES, window), expected, atol=1e-12)


def test_dewow_removes_an_offset_and_the_middle_of_a_ramp():
    ramp = np.linspace(5, 9, 40)[None]
    np.testing.assert_allclose(dewow_traces(ramp, 9)[0, 4:-4], 0, atol=1e-12)
    np.testing.assert_allclose(dewow_traces(np.full((1, 40), 7.0), 9), 0, atol=1e-12)


def test_gain_brings_every_time_to_level_one_by_one_curve():
    decay = np.exp(-np.arange(40) / 9)
    signs = np.where(RNG.random((6, 40)) < 0.5, -1.0, 1.0)
    strong = signs * decay
    strong[0] *= 2  # a stronger trace stays stronger
    leveled = level_traces(strong, 3)
    np.testing.assert_allclose(np.abs(leveled[0] / leveled[1]), 2.0, rtol=1e-9)
    level = np.sqrt((leveled[:, 1:-1] ** 2).mean(axis=0))
    np.testing.assert_allclose(level, level.mean(), rtol=1e-6)


def test_gain_is_limited():
    late = np.ones((2, 40))
    late[:, 20:] = 1e-9
    assert np.abs(level_traces(late, 3)[:, -1]).max() == pytest.approx(1e-6)


def test_a_trace_without_data_stays_so_and_does_not_count():
    gaps = TRACES.copy()
    gaps[3] = np.nan
    others = [0, 1, 2, 4, 5]
    for step in (lambda t: level_traces(t, 5), lambda t: dewow_traces(t, 5)):
        made = step(gaps)
        assert np.isnan(made[3]).all()
        np.testing.assert_allclose(made[others], step(TRACES[others]), atol=1e-12)


def test_silence_stays_silence():
    assert not level_traces(np.zeros((2, 10)), 3).any()


@pytest.mark.parametrize(
    ("step", "rule"),
    [
        (lambda: dewow_traces(TRACES, 2), "window of dewow must be at least 3 samples, got 2"),
        (lambda: level_traces(TRACES, 1), "window of gain must be at least 3 samples, got 1"),
        (
            lambda: level_traces(np.full((2, 9), np.nan), 3),
            "gain must be estimated from at least 1 trace with data",
        ),
    ],
)
def test_what_cannot_be_done_is_refused(step, rule):
    with pytest.raises(ValueError, match=rule):
        step()
