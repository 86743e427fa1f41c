"""Other imaging codes compute what the operator computes, where they are installed."""

import numpy as np
import pytest

from imaging_speed import cases, peers
from imaging_speed.speed import bench_imaging


def test_peers_compute_the_same(few_pixels):
    pytest.importorskip("finufft")
    table = bench_imaging(peers=True, rounds=1)
    finufft = table[table["code"].str.startswith("finufft")]
    assert set(finufft["work"]) == {"15 images", "15 images, 1e-5", "one channel", "forward"}
    assert (finufft["error"] < 5e-3).all()
    assert (table.loc[table["code"].str.startswith("numpy"), "error"] < 2e-2).all()


def test_peers_that_are_not_installed_are_named(monkeypatch):
    installed = {"fastsar"}
    monkeypatch.setattr(
        peers.importlib.util, "find_spec", lambda name: name if name in installed else None
    )
    assert peers.missing_peers() == ["finufft"]
    assert peers.missing_peers("cuda") == ["cufinufft"]
    installed |= {"finufft", "cufinufft"}
    assert peers.missing_peers() == peers.missing_peers("cuda") == []


def test_numpy_computes_the_images_and_is_always_there(few_pixels, monkeypatch):
    monkeypatch.setattr(peers.importlib.util, "find_spec", lambda name: None)
    scan = cases.sri_scan()
    exact = cases.direct_sums(scan)
    peer_cases = peers.peer_cases(scan, exact)
    assert peer_cases
    for case in peer_cases:
        assert case.code.startswith("numpy")
        value = case.run()[..., exact.pixel]
        error = np.linalg.norm(value - case.exact) / np.linalg.norm(case.exact)
        assert error < 2e-2, case.work
