import numpy as np
import pytest

from flgpr.commands import imaging_cases as bench_cases
from flgpr.commands import imaging_peers as bench_peers
from flgpr.commands import imaging_speed as bench
from flgpr.model import Grid


@pytest.fixture
def small(monkeypatch):
    monkeypatch.setattr(bench_cases, "GRID", Grid(-1.0, 9.0, 9, 8, 0.2, 0.2))
    monkeypatch.setattr(bench_cases, "CHECKED_PIXELS", 40)
    monkeypatch.setattr(bench_cases, "CHECKED_TONES", 11)


def test_every_case_is_within_its_tolerance_and_counted(small, monkeypatch):
    monkeypatch.setattr(bench_peers.importlib.util, "find_spec", lambda name: None)
    table = bench.bench_imaging(rounds=1)
    limits = table["work"].map(
        lambda work: 1e-5 if "1e-5" in work else 5e-4 if "15" in work else 1e-3
    )
    assert (table["error"] < limits).all()
    assert (table["error"] > 1e-7).all()
    images = table["work"].map(lambda work: 15 if "15" in work else 3 if "3" in work else 1)
    assert (table["rate"] * table["time"]).to_numpy() == pytest.approx(72 * 36 * images.to_numpy())
    assert (table["ratio"] == 1).all()
    assert ((table["roofline"] > 0) & (table["roofline"] < 1)).all()
    text = bench.format_bench(table)
    assert text.count("\n") == len(table) + 3
    assert "| 15 images | flgpr cpu |" in text
    table.attrs["missing"] = bench_peers.missing_peers()
    assert bench.format_bench(table).endswith(
        "Not installed and so not measured: finufft, fastsar (extra bench)."
    )


def test_peers_compute_the_same(small):
    pytest.importorskip("finufft")
    table = bench.bench_imaging(peers=True, rounds=1)
    finufft = table[table["code"].str.startswith("finufft")]
    assert set(finufft["work"]) == {"15 images", "15 images, 1e-5", "one channel", "forward"}
    assert (finufft["error"] < 5e-3).all()
    assert (table.loc[table["code"].str.startswith("numpy"), "error"] < 2e-2).all()


def test_the_scan_is_that_of_the_sensor():
    scan = bench_cases.sri_scan()
    assert scan.data.shape == (3, 36, 1024)
    assert np.ptp(scan.frequency) == pytest.approx(1023 * 2.5e6)
    assert len(scan.pixels) == 91_200
    with pytest.raises(ValueError, match=r"rounds must be at least 1, got 0"):
        bench.bench_imaging(rounds=0)
