"""``make bench`` prints the table of the measurement it asks for."""

import pandas as pd
import pytest

import imaging_speed.__main__ as bench


@pytest.fixture
def asked(monkeypatch):
    """Arguments of the measurements, which are not made."""
    calls = []
    row = {"work": "15 images", "code": "flgpr cpu", "time": 0.25, "error": 2e-4, "rate": 4e9}

    def measure(peers, rounds, device):
        calls.append((peers, rounds, device))
        if rounds < 1:
            raise ValueError("rounds must be at least 1")
        table = pd.DataFrame([row | {"ratio": 1.0, "roofline": 0.5}])
        table.attrs.update(flops=9e10, bandwidth=1.2e10, missing=["finufft"] if peers else [])
        return table

    monkeypatch.setattr(bench, "bench_imaging", measure)
    return calls


def test_options_arrive_and_the_table_is_printed(asked, capsys):
    bench.main(["--rounds", "3", "--peers"])
    assert asked == [(True, 3, "cpu")]
    told = capsys.readouterr().out
    assert "| 15 images | flgpr cpu | 250.0 | 2.0e-04 | 4.00 | 1.00 | 50% |" in told
    assert "90 GFLOP/s in single precision, 12.0 GB/s" in told
    assert "Not installed and so not measured: finufft" in told


def test_a_refusal_is_one_line(asked, capsys):
    with pytest.raises(SystemExit) as ended:
        bench.main(["--rounds", "0"])
    assert ended.value.code == 2
    assert capsys.readouterr().err.endswith("error: rounds must be at least 1\n")
