"""``flgpr bench imaging`` prints the table of the measurement it asks for."""

import pandas as pd
import pytest
from typer.testing import CliRunner

from flgpr.commands import imaging_speed
from flgpr.commands.app import app


@pytest.fixture
def asked(monkeypatch):
    """Arguments of the measurements, which are not made."""
    calls = []
    row = {"work": "15 images", "code": "flgpr cpu", "time": 0.25, "error": 2e-4, "rate": 4e9}

    def measure(peers, rounds, device):
        calls.append((peers, rounds, device))
        table = pd.DataFrame([row | {"ratio": 1.0, "roofline": 0.5}])
        table.attrs.update(flops=9e10, bandwidth=1.2e10, missing=["finufft"] if peers else [])
        return table

    monkeypatch.setattr(imaging_speed, "bench_imaging", measure)
    return calls


def test_options_arrive_and_the_table_is_printed(asked):
    done = CliRunner().invoke(app, ["bench", "imaging", "--rounds", "3", "--peers"])
    assert done.exit_code == 0, done.output
    assert asked == [(True, 3, "cpu")]
    assert "| 15 images | flgpr cpu | 250.0 | 2.0e-04 | 4.00 | 1.00 | 50% |" in done.stdout
    assert "90 GFLOP/s in single precision, 12.0 GB/s" in done.stdout
    assert "Not installed and so not measured: finufft" in done.stdout


def test_there_is_at_least_one_round(asked):
    assert CliRunner().invoke(app, ["bench", "imaging", "--rounds", "0"]).exit_code == 2
    assert asked == []
