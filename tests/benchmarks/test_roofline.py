"""Limits of the machine: counted work over the time of a clock."""

from types import SimpleNamespace

import pytest
from numba import get_num_threads

from imaging_speed import roofline


@pytest.fixture
def two_seconds(monkeypatch):
    """Let the work take two seconds by the clock."""
    clock = iter([10.0, 12.0])
    monkeypatch.setattr(roofline, "time", SimpleNamespace(perf_counter=clock.__next__))


def test_bytes_are_those_that_are_read_and_written(two_seconds):
    assert roofline.peak_bandwidth() == 16_000_000 * 4 * 2 / 2


def test_operations_are_two_per_multiply_add_of_every_thread(two_seconds):
    tasks = 4 * get_num_threads()
    multiply_adds = tasks * 1_000_000 * 12 * 16
    assert roofline.peak_flops() == pytest.approx(2 * multiply_adds / 2)
