"""Imaging is timed beside its error, and the table says what was not measured."""

import pytest

from imaging_speed import peers, speed


@pytest.mark.slow("images with every engine")
def test_every_case_is_within_its_tolerance_and_counted(few_pixels, monkeypatch):
    monkeypatch.setattr(peers.importlib.util, "find_spec", lambda name: None)
    table = speed.bench_imaging(rounds=1)
    limits = table["work"].map(
        lambda work: 1e-5 if "1e-5" in work else 5e-4 if "15" in work else 1e-3
    )
    assert (table["error"] < limits).all()
    assert (table["error"] > 1e-7).all()
    images = table["work"].map(lambda work: 15 if "15" in work else 3 if "3" in work else 1)
    assert (table["rate"] * table["time"]).to_numpy() == pytest.approx(72 * 36 * images.to_numpy())
    assert (table["ratio"] == 1).all()
    assert ((table["roofline"] > 0) & (table["roofline"] < 1)).all()
    text = speed.format_bench(table)
    assert text.count("\n") == len(table) + 3
    assert "| 15 images | flgpr cpu |" in text
    table.attrs["missing"] = peers.missing_peers()
    assert speed.format_bench(table).endswith(
        "Not installed and so not measured: finufft, fastsar (extra bench)."
    )


def test_a_bench_has_a_round():
    with pytest.raises(ValueError, match=r"rounds must be at least 1, got 0"):
        speed.bench_imaging(rounds=0)
