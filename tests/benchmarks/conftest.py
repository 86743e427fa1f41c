"""Let the tests find the benchmarks, and time imaging on little."""

import sys
from pathlib import Path

import pytest

from flgpr.model import Grid

sys.path.append(str(Path(__file__).parents[2] / "benchmarks"))

from imaging_speed import cases


@pytest.fixture
def few_pixels(monkeypatch):
    """Let the scan at which imaging is timed have a few pixels, all of them checked at a few tones."""
    monkeypatch.setattr(cases, "GRID", Grid(-1.0, 9.0, 9, 8, 0.2, 0.2))
    monkeypatch.setattr(cases, "CHECKED_PIXELS", 40)
    monkeypatch.setattr(cases, "CHECKED_TONES", 11)
