"""The steps of a radargram in their order, and the window that they take."""

import numpy as np
import pytest

from flgpr.clutter import dewow_traces, level_traces, remove_mean_trace
from flgpr.clutter.radargram_steps import (
    assumed_window,
    process_traces,
    samples_until,
    window_samples,
)

DELAY = 1e-10 * np.arange(200)  # a record of 20 ns


@pytest.fixture
def traces():
    return np.random.default_rng(1).normal(size=(6, 200)) + np.linspace(0, 5, 200)


def test_steps_are_taken_in_their_order_and_stated(traces):
    processed = process_traces(traces, 9, dewow=True, background=True, gain=True)
    expected = level_traces(remove_mean_trace(dewow_traces(traces, 9)), 9)
    np.testing.assert_array_equal(processed.values, expected)
    assert [step.split()[0] for step in processed.steps] == ["dewow", "mean", "gain:"]
    assert processed.unit == "amplitude over the line's level at that time"


def test_without_steps_traces_stay_as_recorded(traces):
    processed = process_traces(traces, 9, dewow=False, background=False, gain=False)
    np.testing.assert_array_equal(processed.values, traces)
    assert (processed.unit, processed.steps) == ("counts of the recorder", ())


def test_the_window_is_odd_and_of_two_periods_or_a_tenth_of_the_record():
    assert window_samples(DELAY, 500e6, None) == 41  # 4 ns
    assert window_samples(DELAY, None, None) == 21  # 2 ns
    assert window_samples(DELAY, 500e6, 1e-9) == 11
    assert window_samples(DELAY, 20e9, None) == 3
    with pytest.raises(ValueError, match="window must be from 0 to the record's 20 ns, got 30 ns"):
        window_samples(DELAY, None, 30e-9)


def test_an_assumed_window_is_stated():
    assert "2 periods of the antenna's 500 MHz" in assumed_window(500e6)
    assert "10 % of the record" in assumed_window(None)


def test_samples_are_counted_up_to_a_time():
    assert samples_until(DELAY, None) == 200
    assert samples_until(DELAY, 1e-9) == 11
    with pytest.raises(ValueError, match="until must be a time after the first two samples"):
        samples_until(DELAY, 0.0)
